//! A temporary file of numbers, written and read by where they lie.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};

use bytemuck::Pod;

use crate::error::{Error, Result};

/// The file; there is none before something is written.
#[derive(Debug, Default)]
pub(crate) struct WordFile(Option<File>);

impl WordFile {
    /// Writes words from the byte `at` on. After a failure the same can be tried again.
    pub fn write_at<T: Pod>(&mut self, at: u64, words: &[T]) -> Result<()> {
        if words.is_empty() {
            return Ok(());
        }
        let mut write = || {
            let file = match &mut self.0 {
                Some(file) => file,
                none => none.insert(tempfile::tempfile()?),
            };
            file.seek(SeekFrom::Start(at))?;
            file.write_all(bytemuck::cast_slice(words))
        };
        write().map_err(|e| Error::spool("written", e))
    }

    /// Reads so many words that were written from the byte `at` on.
    pub fn read_at<T: Pod>(&mut self, at: u64, count: usize) -> Result<Vec<T>> {
        let mut words = vec![T::zeroed(); count];
        if let Some(file) = &mut self.0 {
            file.seek(SeekFrom::Start(at))
                .and_then(|_| file.read_exact(bytemuck::cast_slice_mut(&mut words)))
                .map_err(|e| Error::spool("read", e))?;
        }
        Ok(words)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_from_where_they_were_written() {
        let mut file = WordFile::default();
        file.write_at::<i64>(0, &[]).unwrap();
        assert!(file.read_at::<i64>(0, 0).unwrap().is_empty());
        file.write_at(16, &[[1.5, -0.0]]).unwrap();
        file.write_at(0, &[7i64, -1]).unwrap();
        assert_eq!(file.read_at::<i64>(8, 1).unwrap(), [-1i64]);
        assert_eq!(file.read_at::<f64>(16, 2).unwrap(), [1.5, -0.0f64]);
        let Err(Error::Spool { doing: "read", .. }) = file.read_at::<f64>(16, 3) else { panic!("there are no more") };
    }
}
