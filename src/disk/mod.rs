//! What a run keeps on disk as long as it lasts: a [database](Database), or a [file of words](WordFile).
//!
//! Both lie in the folder for temporary files, which `TMPDIR` names, without a name there. So nobody else sees them, and they
//! are gone when the run ends, however it ends.

mod database;
mod words;

pub(crate) use database::Database;
pub(crate) use words::WordFile;
