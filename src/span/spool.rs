//! Points that wait in their slabs: in memory until there are [`SPOOL_MEMORY`] bytes of them, then in one temporary file.
//!
//! Inside a slab the points keep the order of the stream. What a slab leaves in the file when it is handed on is written
//! to again.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::ops::{Range, RangeInclusive};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::{Archive, Chunk, Extent, PointIds, SlabIndex, Span};
use crate::error::{Error, Result};
use crate::lattice::Lattice;

/// How many bytes of points wait in memory before they go to disk.
const SPOOL_MEMORY: usize = 16 << 20;

/// Bytes of a point without attributes.
const BYTES_PER_POINT: usize = size_of::<[f64; 3]>() + size_of::<i64>();

/// Points of a stream, slab by slab.
pub(super) struct Spool {
    places: Places,
    lattice: Lattice,
    slabs: BTreeMap<i64, Slab>,
    /// The id of the next point that comes.
    next_id: i64,
    /// The number of the next slab that is handed on, and the slabs before which all have been.
    index: u64,
    open_from: i64,
    /// How many points wait.
    points: u64,
    /// Bytes of those in memory, and how many there can be.
    bytes: usize,
    pub(super) memory: usize,
    /// Most points of several slabs that are handed on as one span; 0 = each is one.
    pub(super) most: usize,
    file: SpoolFile,
}

impl Spool {
    pub(super) fn new(slab_of: SlabIndex, lattice: Lattice) -> Self {
        Self {
            places: Places::new(slab_of),
            lattice,
            slabs: BTreeMap::new(),
            next_id: 0,
            index: 0,
            open_from: i64::MIN,
            points: 0,
            bytes: 0,
            memory: SPOOL_MEMORY,
            most: 0,
            file: SpoolFile::default(),
        }
    }

    /// Makes room for a slab that will have points.
    pub(super) fn expect(&mut self, at: i64) {
        self.slabs.entry(at).or_default();
    }

    /// Puts the next points of the stream into their slabs, and tells `note` which slab lies where some of them lie. Points
    /// of a slab that has been handed on go to the next that has not.
    pub(super) fn lay(&mut self, chunk: &Chunk, mut note: impl FnMut(i64, Range<i64>)) -> Result<()> {
        let Self { places, slabs, next_id: first_id, open_from, .. } = self;
        places.for_each_run(&chunk.points, |at, run| {
            let ids = *first_id + run.start as i64..*first_id + run.end as i64;
            note(at, ids.clone());
            let slab = slabs.entry(at.max(*open_from)).or_default();
            slab.point_ids.extend(ids);
            slab.held.append(chunk, run);
        })?;
        self.next_id += chunk.points.len() as i64;
        self.points += chunk.points.len() as u64;
        self.bytes += chunk.points.len() * bytes_per_point(chunk.attributes.len());
        Ok(())
    }

    /// The id of the next point that comes.
    pub(super) fn next_id(&self) -> i64 {
        self.next_id
    }

    /// How many points wait.
    pub(super) fn points(&self) -> u64 {
        self.points
    }

    /// Writes everything to disk if too much of it is in memory.
    pub(super) fn relieve(&mut self) -> Result<()> {
        if self.bytes >= self.memory { self.write() } else { Ok(()) }
    }

    /// Writes everything to disk if some of it is there already: the windows that follow can use the memory.
    pub(super) fn settle(&mut self) -> Result<()> {
        if self.file.is_open() { self.write() } else { Ok(()) }
    }

    fn write(&mut self) -> Result<()> {
        self.bytes = 0;
        self.file.write(self.slabs.values_mut()).map_err(|e| Error::spool("written", e))
    }

    /// The first slab, filled up with those behind it, and the numbers of the first and the last of them.
    fn pop_filled(&mut self) -> Option<(RangeInclusive<i64>, Slab)> {
        let (first, mut slab) = self.slabs.pop_first()?;
        let mut last = first;
        while let Some(next) = self.slabs.first_entry()
            && slab.len() + next.get().len() <= self.most
            && self.most > 0
        {
            last = *next.key();
            slab.append(next.remove());
        }
        Some((first..=last, slab))
    }

    /// Takes out the first slab, or as many as there is room for, as the span that follows those taken out before.
    pub(super) fn hand_on(&mut self) -> Option<Result<Span>> {
        let (taken, slab) = self.pop_filled()?;
        let index = self.index;
        self.index += 1;
        self.open_from = taken.end() + 1;
        self.bytes = self.bytes.saturating_sub(slab.held.points.len() * bytes_per_point(slab.held.attributes.len()));
        // Slabs passed over have no points, so the extent goes on to the next that has some.
        let (first, end) = ((index > 0).then_some(*taken.start()), self.slabs.keys().next().copied());
        let extent = Some(self.places.slab_of.extent(first, end, &self.lattice));
        Some(match self.file.take(slab) {
            Ok(points) => {
                let (point_ids, Chunk { points, attributes }) = in_stream_order(points);
                self.points -= points.len() as u64;
                Ok(Span { index, point_ids: PointIds::Listed(point_ids), points, attributes, extent })
            }
            Err(error) => Err(Error::spool("read", error)),
        })
    }

    /// All spans, to be read in any order.
    pub(super) fn lay_out(&mut self) -> Laid {
        let (numbers, slabs): (Vec<i64>, Vec<Slab>) =
            std::iter::from_fn(|| self.pop_filled()).map(|(taken, slab)| (*taken.start(), slab)).unzip();
        let extent = |(at, &number): (usize, &i64)| {
            self.places.slab_of.extent((at > 0).then_some(number), numbers.get(at + 1).copied(), &self.lattice)
        };
        let extents = numbers.iter().enumerate().map(extent).collect();
        Laid { extents, slabs, file: Mutex::new(std::mem::take(&mut self.file)) }
    }

    /// How long the file is.
    #[cfg(test)]
    pub(super) fn bytes_on_disk(&self) -> u64 {
        self.file.end
    }

    /// Forgets everything that waits.
    pub(super) fn clear(&mut self) {
        self.slabs.clear();
        self.points = 0;
    }
}

/// The spans of a cloud that has come to its end.
pub(super) struct Laid {
    extents: Vec<Extent>,
    slabs: Vec<Slab>,
    file: Mutex<SpoolFile>,
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

/// Tells in which slab each point of a stream lies, run by run.
pub(super) struct Places {
    slab_of: SlabIndex,
    /// The slab of the last point.
    at: i64,
}

impl Places {
    pub(super) fn new(slab_of: SlabIndex) -> Self {
        Self { slab_of, at: 0 }
    }

    /// Calls `each` with a slab and the positions of consecutive points that lie there. A point with no valid position
    /// stays with the points it came with.
    pub(super) fn for_each_run(&mut self, points: &[[f64; 3]], mut each: impl FnMut(i64, Range<usize>)) -> Result<()> {
        let mut start = 0;
        for (position, point) in points.iter().enumerate() {
            let at = self.slab_of.of(point)?.unwrap_or(self.at);
            if at != self.at {
                if start < position {
                    each(self.at, start..position);
                }
                (self.at, start) = (at, position);
            }
        }
        if start < points.len() {
            each(self.at, start..points.len());
        }
        Ok(())
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

/// A temporary file, as long as at some time needed.
#[derive(Default)]
struct SpoolFile {
    file: Option<File>,
    /// How many attributes a written point has.
    attributes: usize,
    end: u64,
    /// Bytes that are not needed any more: where such a gap starts, and how long it is.
    gaps: BTreeMap<u64, u64>,
}

impl SpoolFile {
    fn is_open(&self) -> bool {
        self.file.is_some()
    }

    fn write<'a>(&mut self, slabs: impl Iterator<Item = &'a mut Slab>) -> io::Result<()> {
        let file = match self.file.take() {
            Some(file) => file,
            None => tempfile::tempfile()?,
        };
        let mut writer = BufWriter::with_capacity(1 << 20, file);
        let mut at = writer.stream_position()?;
        for slab in slabs.filter(|slab| !slab.point_ids.is_empty()) {
            let Chunk { points, attributes } = std::mem::take(&mut slab.held);
            let bytes = (points.len() * bytes_per_point(attributes.len())) as u64;
            let start = self.find_room(bytes);
            if start != at {
                writer.seek(SeekFrom::Start(start))?;
            }
            writer.write_all(bytemuck::cast_slice(&std::mem::take(&mut slab.point_ids)))?;
            writer.write_all(bytemuck::cast_slice(&points))?;
            for values in &attributes {
                writer.write_all(bytemuck::cast_slice(values))?;
            }
            slab.written.push(Stretch { start, points: points.len() });
            at = start + bytes;
            self.attributes = attributes.len();
        }
        self.file = Some(writer.into_inner().map_err(io::IntoInnerError::into_error)?);
        Ok(())
    }

    /// The first gap with room for so many bytes, or the end of the file.
    fn find_room(&mut self, bytes: u64) -> u64 {
        let Some((start, room)) = self.gaps.iter().map(|(&start, &room)| (start, room)).find(|gap| gap.1 >= bytes)
        else {
            let start = self.end;
            self.end += bytes;
            return start;
        };
        self.gaps.remove(&start);
        if room > bytes {
            self.gaps.insert(start + bytes, room - bytes);
        }
        start
    }

    /// Makes a gap, one with those beside it.
    fn leave(&mut self, start: u64, bytes: u64) {
        let (mut start, mut end) = (start, start + bytes);
        if let Some((&before, &room)) = self.gaps.range(..start).next_back()
            && before + room == start
        {
            self.gaps.remove(&before);
            start = before;
        }
        if let Some(room) = self.gaps.remove(&end) {
            end += room;
        }
        self.gaps.insert(start, end - start);
    }

    /// Reads a slab and leaves its place.
    fn take(&mut self, slab: Slab) -> io::Result<(Vec<i64>, Chunk)> {
        if self.file.is_none() {
            return Ok((slab.point_ids, slab.held));
        }
        let read = self.read(&slab)?;
        let bytes = bytes_per_point(self.attributes);
        for Stretch { start, points } in slab.written {
            self.leave(start, (points * bytes) as u64);
        }
        Ok(read)
    }

    fn read(&mut self, slab: &Slab) -> io::Result<(Vec<i64>, Chunk)> {
        let Some(file) = &mut self.file else { return Ok((slab.point_ids.clone(), slab.held.clone())) };
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
        point_ids.extend_from_slice(&slab.point_ids);
        chunk.append(&slab.held, 0..slab.held.points.len());
        Ok((point_ids, chunk))
    }
}
