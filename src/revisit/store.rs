//! Points that have gone out of scope, on disk, to be found again by where they are.
//!
//! A temporary [`Database`] of blobs.

use rusqlite::params;

use super::raster::Cell;
use crate::disk::Database;
use crate::error::Result;
use crate::label::SegmentId;
use crate::segmentor::Plane;

/// Pages of 16 KB suit blobs of some KB; 16 MB of them are kept in memory.
const PAGE_BYTES: usize = 1 << 14;
const CACHED_PAGES: usize = 1 << 10;

const TABLES: &str = "
    CREATE TABLE stored (row INTEGER, col INTEGER, span INTEGER, points BLOB, PRIMARY KEY (row, col, span));
    CREATE TABLE plane (segment_id INTEGER PRIMARY KEY, plane BLOB);
";

/// What is stored of a point beside its attributes, in words of 8 bytes: its id, its segment, its position.
const WORDS: usize = 5;

/// Some points of one span in one block of the map.
#[derive(Debug, Default, Clone, PartialEq)]
pub(super) struct Stored {
    pub point_ids: Vec<i64>,
    pub raw_ids: Vec<SegmentId>,
    pub points: Vec<[f64; 3]>,
    pub attributes: Vec<Vec<f64>>,
}

/// The store.
pub(super) struct Store {
    database: Database,
    /// How many attributes a point has.
    attributes: usize,
    packed: Vec<u8>,
}

impl Store {
    /// An empty store.
    pub fn new() -> Result<Self> {
        let database = Database::new(PAGE_BYTES, CACHED_PAGES, TABLES)?;
        Ok(Self { database, attributes: 0, packed: Vec::new() })
    }

    /// Stores the points of a span that lie in a block; spans and attributes are the same for all.
    pub fn put(&mut self, block: Cell, span: u64, stored: &Stored) -> Result<()> {
        self.attributes = stored.attributes.len();
        self.packed.clear();
        self.packed.extend_from_slice(bytemuck::cast_slice(&stored.point_ids));
        self.packed.extend_from_slice(bytemuck::cast_slice(&stored.raw_ids));
        self.packed.extend_from_slice(bytemuck::cast_slice(&stored.points));
        for values in &stored.attributes {
            self.packed.extend_from_slice(bytemuck::cast_slice(values));
        }
        self.database.write(|database| {
            let mut insert = database.prepare_cached("INSERT INTO stored VALUES (?, ?, ?, ?)")?;
            insert.execute(params![block.row, block.column, span as i64, self.packed]).map(drop)
        })
    }

    /// Stores the planes of segments whose ids start from `first`.
    pub fn put_planes(&mut self, first: SegmentId, planes: &[Plane]) -> Result<()> {
        self.database.write(|database| {
            let mut insert = database.prepare_cached("INSERT INTO plane VALUES (?, ?)")?;
            (first..).zip(planes).try_for_each(|(segment_id, plane)| {
                insert.execute(params![segment_id, bytemuck::bytes_of(&words(plane))]).map(drop)
            })
        })
    }

    /// The plane of a segment, if it has one.
    pub fn plane(&self, segment_id: SegmentId) -> Result<Option<Plane>> {
        self.database.read(|database| {
            let mut select = database.prepare_cached("SELECT plane FROM plane WHERE segment_id = ?")?;
            let mut rows = select.query([segment_id])?;
            let Some(row) = rows.next()? else { return Ok(None) };
            Ok(bytemuck::try_pod_read_unaligned(row.get_ref(0)?.as_blob()?).ok().map(plane_of))
        })
    }

    /// Shows what is stored of a block, of the spans from `first` up to `end`, in the order of the spans, as long as `show`
    /// asks for more. The answer is the span after the last one shown; none if all were shown.
    pub fn each(&self, block: Cell, first: u64, end: u64, mut show: impl FnMut(Stored) -> bool) -> Result<Option<u64>> {
        self.database.read(|database| {
            let mut select = database.prepare_cached(
                "SELECT span, points FROM stored WHERE row = ? AND col = ? AND span >= ? AND span < ? ORDER BY span",
            )?;
            let mut rows = select.query(params![block.row, block.column, first as i64, end as i64])?;
            while let Some(row) = rows.next()? {
                let span: i64 = row.get(0)?;
                if !show(unpack(row.get_ref(1)?.as_blob()?, self.attributes)) {
                    return Ok(Some(span as u64 + 1));
                }
            }
            Ok(None)
        })
    }
}

/// A plane as words of 8 bytes; whole numbers this small are exact.
fn words(plane: &Plane) -> [f64; 14] {
    let &Plane { center: [x, y, z], normal: [u, v, w], sigma0, points, covariance: [xx, xy, xz, yy, yz, zz] } = plane;
    [x, y, z, u, v, w, sigma0, points as f64, xx, xy, xz, yy, yz, zz]
}

fn plane_of([x, y, z, u, v, w, sigma0, points, xx, xy, xz, yy, yz, zz]: [f64; 14]) -> Plane {
    let covariance = [xx, xy, xz, yy, yz, zz];
    Plane { center: [x, y, z], normal: [u, v, w], sigma0, points: points as u64, covariance }
}

fn unpack(packed: &[u8], attributes: usize) -> Stored {
    let points = packed.len() / (size_of::<u64>() * (WORDS + attributes));
    let mut rest = packed;
    let mut take = |words: usize| {
        let (bytes, others) = rest.split_at(words * points * size_of::<u64>());
        rest = others;
        bytes
    };
    Stored {
        point_ids: bytemuck::pod_collect_to_vec(take(1)),
        raw_ids: bytemuck::pod_collect_to_vec(take(1)),
        points: bytemuck::pod_collect_to_vec(take(3)),
        attributes: (0..attributes).map(|_| bytemuck::pod_collect_to_vec(take(1))).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(first: i64, points: i64) -> Stored {
        let ids = first..first + points;
        Stored {
            point_ids: ids.clone().collect(),
            raw_ids: ids.clone().map(|id| id % 3 - 1).collect(),
            points: ids.clone().map(|id| [id as f64, -0.0, f64::MIN_POSITIVE]).collect(),
            attributes: vec![ids.map(|id| id as f64 / 7.0).collect()],
        }
    }

    #[test]
    fn what_is_stored_comes_back_to_the_last_bit_in_the_order_of_spans() {
        let mut store = Store::new().unwrap();
        let block = Cell { row: -4, column: 1 << 50 };
        // More than the cache holds.
        for span in (0..300u64).rev() {
            store.put(block, span, &stored(span as i64 * 10_000, span as i64 * 10)).unwrap();
            store.put(Cell { row: -4, column: 0 }, span, &stored(0, 2000)).unwrap();
        }
        let mut span = 7;
        let rest = store.each(block, span, 200, |found| {
            assert_eq!(found, stored(span as i64 * 10_000, span as i64 * 10));
            span += 1;
            true
        });
        assert_eq!((rest.unwrap(), span), (None, 200));
        let mut shown = 0;
        let stopped = store.each(block, 290, 300, |_| {
            shown += 1;
            shown < 3
        });
        assert_eq!(stopped.unwrap(), Some(293));
        assert_eq!(store.each(Cell { row: 0, column: 0 }, 0, 300, |_| panic!("there is nothing")).unwrap(), None);
    }

    #[test]
    fn planes_are_kept_by_segment() {
        let plane = |i: u64| {
            let covariance = [0.1, 0.2, 0.3, 0.4, 0.5, i as f64];
            Plane { center: [i as f64; 3], normal: [0.0, 0.6, -0.8], sigma0: 0.01, points: 3 + i, covariance }
        };
        let mut store = Store::new().unwrap();
        store.put_planes(7, &[plane(1), plane(2)]).unwrap();
        assert_eq!(store.plane(8).unwrap(), Some(plane(2)));
        assert_eq!(store.plane(9).unwrap(), None);
    }
}
