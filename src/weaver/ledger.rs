//! What became of ids, on disk: for more segments than memory should hold.
//!
//! An `SQLite` database without a name, in a temporary file that nobody else sees and that is gone when it is closed, or when the
//! process ends. Nothing is ever committed, for there is nothing to be kept safe.

use std::io;

use rusqlite::{Connection, params};

use super::out_of_scope::Fate;
use crate::error::{Error, Result};
use crate::label::SegmentId;

/// Eight megabytes of it are kept in memory.
const SET_UP: &str = "
    PRAGMA journal_mode = OFF;
    PRAGMA synchronous = OFF;
    PRAGMA temp_store = FILE;
    PRAGMA cache_size = -8192;
    CREATE TABLE fate (id INTEGER PRIMARY KEY, becomes INTEGER, points INTEGER, has_seed INTEGER);
    BEGIN;
";

/// The fates of many ids.
#[derive(Debug)]
pub(super) struct Ledger(Connection);

impl Ledger {
    /// An empty ledger.
    pub(super) fn new() -> Result<Self> {
        let open = || {
            let database = Connection::open("")?;
            database.execute_batch(SET_UP)?;
            Ok(Self(database))
        };
        open().map_err(|e| failed("written", e))
    }

    /// Notes what became of ids, in place of what was known of them.
    pub(super) fn note(&self, fates: impl Iterator<Item = (SegmentId, Fate)>) -> Result<()> {
        let note = || {
            let mut insert = self.0.prepare_cached("INSERT OR REPLACE INTO fate VALUES (?, ?, ?, ?)")?;
            for (id, fate) in fates {
                match fate {
                    Fate::Became(next) => insert.execute(params![id, next, None::<i64>, None::<bool>])?,
                    Fate::Closed { points, has_seed } => {
                        insert.execute(params![id, None::<i64>, points as i64, has_seed])?
                    }
                    Fate::Open => insert.execute(params![id, None::<i64>, None::<i64>, None::<bool>])?,
                };
            }
            Ok(())
        };
        note().map_err(|e| failed("written", e))
    }

    /// What became of an id, if that was noted.
    pub(super) fn fate(&self, id: SegmentId) -> Result<Option<Fate>> {
        let find = || {
            let mut select = self.0.prepare_cached("SELECT becomes, points, has_seed FROM fate WHERE id = ?")?;
            let mut rows = select.query([id])?;
            let Some(row) = rows.next()? else { return Ok(None) };
            Ok(Some(match (row.get(0)?, row.get::<_, Option<i64>>(1)?) {
                (Some(next), _) => Fate::Became(next),
                (None, Some(points)) => Fate::Closed { points: points as u64, has_seed: row.get(2)? },
                (None, None) => Fate::Open,
            }))
        };
        find().map_err(|e| failed("read", e))
    }
}

fn failed(doing: &'static str, cause: rusqlite::Error) -> Error {
    Error::spool(doing, io::Error::other(cause))
}
