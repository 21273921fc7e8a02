//! Lays a cloud that is in any order into slabs, in bounded memory, and hands the slabs out along the direction.
//!
//! Points wait in memory, slab by slab, until there are [`SPOOL_MEMORY`] bytes of them; then every slab's points go to
//! the end of one temporary file and the slab remembers where. Inside a slab the points keep the order of the stream.
//! Slabs without points are passed over, so a stray point far away costs nothing. When the first slab is handed out all
//! have been counted, so a span may be filled up with as many slabs as hold no more than so many points.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};

use super::{Chunk, PointIds, SlabIndex, Span, SpanSource};
use crate::error::{Error, Result};
use crate::lattice::Lattice;

/// How many bytes of points wait in memory before they go to disk.
const SPOOL_MEMORY: usize = 16 << 20;

/// Bytes of a point without attributes.
const BYTES_PER_POINT: usize = size_of::<[f64; 3]>() + size_of::<i64>();

/// An iterator of spans by width over chunks in any order.
pub struct Slabs<C> {
    /// The source until it is spooled.
    chunks: Option<C>,
    slab_of: SlabIndex,
    lattice: Lattice,
    spool: Spool,
    waiting: BTreeMap<i64, Slab>,
    index: u64,
    /// Most points of several slabs in one span.
    most: usize,
}

impl<C: Iterator<Item = Result<Chunk>>> Slabs<C> {
    pub(crate) fn new(chunks: C, slab_of: SlabIndex, lattice: Lattice) -> Self {
        let spool = Spool { file: None, attributes: 0, bytes: 0, memory: SPOOL_MEMORY };
        Self { chunks: Some(chunks), slab_of, lattice, spool, waiting: BTreeMap::new(), index: 0, most: 0 }
    }

    /// Hands out consecutive slabs together while they hold no more than so many points.
    pub(crate) fn filled_up_to(self, points: usize) -> Self {
        Self { most: points, ..self }
    }

    fn spool_all(&mut self, chunks: C) -> Result<()> {
        let mut point_id = 0;
        let mut at = 0;
        for chunk in chunks {
            let chunk = chunk?;
            for (position, point) in chunk.points.iter().enumerate() {
                // A point with no valid position stays with the points it came with.
                at = self.slab_of.of(point)?.unwrap_or(at);
                let slab = self.waiting.entry(at).or_default();
                slab.point_ids.push(point_id);
                slab.held.append(&chunk, position..position + 1);
                point_id += 1;
            }
            self.spool.bytes += chunk.points.len() * bytes_per_point(chunk.attributes.len());
            if self.spool.bytes >= self.spool.memory {
                self.spool.write(&mut self.waiting).map_err(|e| Error::spool("written", e))?;
            }
        }
        if self.spool.file.is_some() {
            // Where some are on disk all go there: the windows that follow can use the memory.
            self.spool.write(&mut self.waiting).map_err(|e| Error::spool("written", e))?;
        }
        Ok(())
    }

    /// The first slab that waits, and the number of the one it starts from, filled up with those behind it.
    fn next_slab(&mut self) -> Option<(i64, Slab)> {
        let (at, mut slab) = self.waiting.pop_first()?;
        while let Some(next) = self.waiting.first_entry()
            && slab.len() + next.get().len() <= self.most
        {
            slab.append(next.remove());
        }
        Some((at, slab))
    }
}

impl<C: Iterator<Item = Result<Chunk>>> Iterator for Slabs<C> {
    type Item = Result<Span>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(chunks) = self.chunks.take()
            && let Err(error) = self.spool_all(chunks)
        {
            self.waiting.clear();
            return Some(Err(error));
        }
        let (at, slab) = self.next_slab()?;
        let index = self.index;
        self.index += 1;
        // Slabs passed over have no points, so the extent goes on to the next that has some.
        let (first, end) = ((index > 0).then_some(at), self.waiting.keys().next().copied());
        let extent = Some(self.slab_of.extent(first, end, &self.lattice));
        Some(match self.spool.read(slab) {
            Ok(points) => {
                let (point_ids, Chunk { points, attributes }) = in_stream_order(points);
                Ok(Span { index, point_ids: PointIds::Listed(point_ids), points, attributes, extent })
            }
            Err(error) => Err(Error::spool("read", error)),
        })
    }
}

impl<C: Iterator<Item = Result<Chunk>> + Send> SpanSource for Slabs<C> {
    fn stop(&mut self) {
        self.chunks = None;
        self.waiting.clear();
    }
}

/// The points of one slab: those already on disk, and those that wait in memory.
#[derive(Default)]
struct Slab {
    written: Vec<Stretch>,
    point_ids: Vec<i64>,
    held: Chunk,
}

impl Slab {
    fn len(&self) -> usize {
        self.point_ids.len() + self.written.iter().map(|stretch| stretch.points).sum::<usize>()
    }

    fn append(&mut self, next: Slab) {
        self.written.extend(next.written);
        self.point_ids.extend(next.point_ids);
        self.held.append(&next.held, 0..next.held.points.len());
    }
}

/// Points of several slabs in the order of their ids.
fn in_stream_order((point_ids, chunk): (Vec<i64>, Chunk)) -> (Vec<i64>, Chunk) {
    if point_ids.is_sorted() {
        return (point_ids, chunk);
    }
    let mut order: Vec<u32> = (0..point_ids.len() as u32).collect();
    // Not unstable: this sort makes use of the order that the points of each slab are in.
    order.sort_by_key(|&i| point_ids[i as usize]);
    (order.iter().map(|&i| point_ids[i as usize]).collect(), chunk.in_order(&order))
}

fn bytes_per_point(attributes: usize) -> usize {
    BYTES_PER_POINT + attributes * size_of::<f64>()
}

/// Where some points of a slab lie in the file: their ids, their coordinates, then attribute by attribute.
struct Stretch {
    start: u64,
    points: usize,
}

struct Spool {
    file: Option<File>,
    /// How many attributes a written point has.
    attributes: usize,
    bytes: usize,
    memory: usize,
}

impl Spool {
    fn write(&mut self, slabs: &mut BTreeMap<i64, Slab>) -> io::Result<()> {
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile()?),
        };
        let mut end = file.seek(SeekFrom::End(0))?;
        let mut writer = BufWriter::with_capacity(1 << 20, file);
        for slab in slabs.values_mut().filter(|slab| !slab.point_ids.is_empty()) {
            let Chunk { points, attributes } = std::mem::take(&mut slab.held);
            writer.write_all(bytemuck::cast_slice(&std::mem::take(&mut slab.point_ids)))?;
            writer.write_all(bytemuck::cast_slice(&points))?;
            for values in &attributes {
                writer.write_all(bytemuck::cast_slice(values))?;
            }
            slab.written.push(Stretch { start: end, points: points.len() });
            end += (points.len() * bytes_per_point(attributes.len())) as u64;
            self.attributes = attributes.len();
        }
        self.bytes = 0;
        writer.flush()
    }

    fn read(&mut self, slab: Slab) -> io::Result<(Vec<i64>, Chunk)> {
        let Some(file) = &mut self.file else { return Ok((slab.point_ids, slab.held)) };
        let written: usize = slab.written.iter().map(|stretch| stretch.points).sum();
        let mut point_ids = vec![0i64; written];
        let mut points = vec![[0.0f64; 3]; written];
        let mut attributes = vec![vec![0.0f64; written]; self.attributes];
        let mut at = 0;
        for stretch in &slab.written {
            let range = at..at + stretch.points;
            file.seek(SeekFrom::Start(stretch.start))?;
            file.read_exact(bytemuck::cast_slice_mut(&mut point_ids[range.clone()]))?;
            file.read_exact(bytemuck::cast_slice_mut(&mut points[range.clone()]))?;
            for values in &mut attributes {
                file.read_exact(bytemuck::cast_slice_mut(&mut values[range.clone()]))?;
            }
            at = range.end;
        }
        let mut chunk = Chunk { points, attributes };
        point_ids.extend(slab.point_ids);
        chunk.append(&slab.held, 0..slab.held.points.len());
        Ok((point_ids, chunk))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::span::Direction;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_point_comes_out_once_in_its_slab_in_stream_order(
            xs in prop::collection::vec(prop_oneof![4 => -50.0f64..50.0, 1 => Just(f64::NAN)], 1..200),
            chunk_size in 1usize..50,
            memory in prop_oneof![Just(1usize), Just(500), Just(usize::MAX)],
            most in prop_oneof![Just(0usize), 1usize..60],
        ) {
            let chunks = xs.chunks(chunk_size).map(|xs| Ok(Chunk {
                points: xs.iter().map(|&x| [x, 1.0, 2.0]).collect(),
                attributes: vec![xs.to_vec()],
            })).collect::<Vec<_>>();
            let slab_of = SlabIndex::new(7.0, Direction::X, &Lattice::REAL);
            let mut slabs = Slabs::new(chunks.into_iter(), slab_of, Lattice::REAL).filled_up_to(most);
            slabs.spool.memory = memory;

            let mut seen = vec![false; xs.len()];
            let mut last_slab = i64::MIN;
            let mut high = f64::NEG_INFINITY;
            for (i, span) in slabs.enumerate() {
                let span = span.unwrap();
                prop_assert_eq!(span.index, i as u64);
                let PointIds::Listed(ids) = &span.point_ids else { panic!("listed") };
                prop_assert!(ids.windows(2).all(|w| w[0] < w[1]));
                let extent = span.extent.unwrap();
                prop_assert_eq!(extent.low, high);
                high = extent.high;
                let mut slabs = std::collections::BTreeSet::new();
                prop_assert_eq!(span.attributes[0].len(), ids.len());
                for ((&id, point), value) in ids.iter().zip(&span.points).zip(&span.attributes[0]) {
                    prop_assert_eq!(value.to_bits(), xs[id as usize].to_bits());
                    prop_assert!(!std::mem::replace(&mut seen[id as usize], true));
                    prop_assert_eq!(point[0].to_bits(), xs[id as usize].to_bits());
                    if let Some(at) = slab_of.of(point).unwrap() {
                        prop_assert!(extent.low <= point[0] && point[0] < extent.high);
                        slabs.insert(at);
                    }
                }
                prop_assert!(slabs.len() <= 1 || ids.len() <= most);
                if let (Some(&first), Some(&last)) = (slabs.first(), slabs.last()) {
                    prop_assert!(first > last_slab);
                    last_slab = last;
                }
            }
            prop_assert!(seen.into_iter().all(|s| s));
            prop_assert_eq!(high, f64::INFINITY);
        }
    }
}
