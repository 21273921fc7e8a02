//! The temporary file in which the points of slabs wait. What a slab leaves when it is read is written to again.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};

use super::{Slab, bytes_per_point};
use crate::span::Chunk;

/// Where some points of a slab lie in the file: their ids, their coordinates, then attribute by attribute.
pub(super) struct Stretch {
    pub(super) start: u64,
    pub(super) points: usize,
}

/// A temporary file, as long as at some time needed.
#[derive(Default)]
pub(super) struct SpoolFile {
    file: Option<File>,
    /// How many attributes a written point has.
    attributes: usize,
    pub(super) end: u64,
    /// Bytes that are not needed any more: where such a gap starts, and how long it is.
    gaps: BTreeMap<u64, u64>,
}

impl SpoolFile {
    pub(super) fn is_open(&self) -> bool {
        self.file.is_some()
    }

    pub(super) fn write<'a>(&mut self, slabs: impl Iterator<Item = &'a mut Slab>) -> io::Result<()> {
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
    pub(super) fn take(&mut self, slab: Slab) -> io::Result<(Vec<i64>, Chunk)> {
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

    pub(super) fn read(&mut self, slab: &Slab) -> io::Result<(Vec<i64>, Chunk)> {
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
