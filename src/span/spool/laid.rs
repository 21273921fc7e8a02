//! The slabs of a cloud that has come to its end, to be read in any order.

use std::io;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::file::SpoolFile;
use super::{Slab, in_stream_order};
use crate::error::{Error, Result};
use crate::span::{Archive, Chunk, Extent, PointIds, Span};

/// The spans of a cloud that has come to its end.
pub struct Laid {
    pub(super) extents: Vec<Extent>,
    pub(super) slabs: Vec<Slab>,
    pub(super) file: Mutex<SpoolFile>,
}

impl Archive for Arc<OnceLock<Laid>> {
    fn extents(&self) -> &[Extent] {
        self.get().map_or(&[], |laid| &laid.extents)
    }

    fn read(&self, index: u64) -> Result<Span> {
        let missing = || Error::spool("read", io::ErrorKind::NotFound.into());
        let Laid { extents, slabs, file } = self.get().ok_or_else(missing)?;
        let slab = slabs.get(index as usize).ok_or_else(missing)?;
        let (extent, mut file) = (Some(extents[index as usize]), file.lock().unwrap_or_else(PoisonError::into_inner));
        let (point_ids, Chunk { points, attributes }) =
            in_stream_order(file.read(slab).map_err(|e| Error::spool("read", e))?);
        Ok(Span { index, point_ids: PointIds::Listed(point_ids), points, attributes, extent })
    }
}
