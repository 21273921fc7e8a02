//! What became of ids, on disk: for more segments than memory should hold.
//!
//! A temporary [`Database`]: a ledger that could not be written once knows nothing any more.

use rusqlite::params;

use super::out_of_scope::Fate;
use crate::disk::Database;
use crate::error::Result;
use crate::label::SegmentId;

/// Eight megabytes of it are kept in memory.
const PAGE_BYTES: usize = 1 << 12;
const CACHED_PAGES: usize = 1 << 11;

const TABLES: &str = "CREATE TABLE fate (id INTEGER PRIMARY KEY, becomes INTEGER, points INTEGER, has_seed INTEGER);";

/// The fates of many ids.
#[derive(Debug)]
pub(super) struct Ledger(Database);

impl Ledger {
    /// An empty ledger.
    pub(super) fn new() -> Result<Self> {
        Database::new(PAGE_BYTES, CACHED_PAGES, TABLES).map(Self)
    }

    /// Notes what became of ids, in place of what was known of them.
    pub(super) fn note(&self, fates: impl Iterator<Item = (SegmentId, Fate)>) -> Result<()> {
        self.0.write(|database| {
            let mut insert = database.prepare_cached("INSERT OR REPLACE INTO fate VALUES (?, ?, ?, ?)")?;
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
        })
    }

    /// What became of an id, if that was noted.
    pub(super) fn fate(&self, id: SegmentId) -> Result<Option<Fate>> {
        self.0.read(|database| {
            let mut select = database.prepare_cached("SELECT becomes, points, has_seed FROM fate WHERE id = ?")?;
            let mut rows = select.query([id])?;
            let Some(row) = rows.next()? else { return Ok(None) };
            Ok(Some(match (row.get(0)?, row.get::<_, Option<i64>>(1)?) {
                (Some(next), _) => Fate::Became(next),
                (None, Some(points)) => Fate::Closed { points: points as u64, has_seed: row.get(2)? },
                (None, None) => Fate::Open,
            }))
        })
    }
}
