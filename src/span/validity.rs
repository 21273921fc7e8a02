//! Finds points that cannot be computed with, at the place where chunks come in.

use super::Chunk;
use crate::error::{Error, Result};
use crate::lattice::is_valid;

/// What becomes of points with NaN, infinite or absurdly large coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Invalid {
    /// The stream ends with an error that names the first of them. The points before it are kept, but for a stored cloud
    /// that is laid into slabs: its slabs would have holes.
    #[default]
    Reject,
    /// They take part in no segmentation and come out with no segment.
    Drop,
}

/// The chunks of a source, up to the first invalid point if such are rejected.
pub fn checked<C>(chunks: C, invalid: Invalid) -> Checked<C::IntoIter>
where
    C: IntoIterator<Item = Result<Chunk>>,
{
    Checked { chunks: chunks.into_iter(), invalid, next_id: 0, failure: None }
}

/// See [`checked`].
pub struct Checked<C> {
    chunks: C,
    invalid: Invalid,
    next_id: i64,
    failure: Option<Error>,
}

impl<C: Iterator<Item = Result<Chunk>>> Iterator for Checked<C> {
    type Item = Result<Chunk>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(error) = self.failure.take() {
            return Some(Err(error));
        }
        let mut chunk = match self.chunks.next()? {
            Ok(chunk) => chunk,
            error => return Some(error),
        };
        if self.invalid == Invalid::Reject
            && let Some(position) = chunk.points.iter().position(|point| !is_valid(point))
        {
            let point_id = self.next_id + position as i64;
            self.failure = Some(Error::NotFinite { point_id, position: chunk.points[position] });
            chunk.points.truncate(position);
            chunk.attributes.iter_mut().for_each(|values| values.truncate(position));
        }
        self.next_id += chunk.points.len() as i64;
        Some(Ok(chunk))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chunks() -> Vec<Result<Chunk>> {
        let chunk = |xs: &[f64]| {
            Ok(Chunk { points: xs.iter().map(|&x| [x, 0.0, 0.0]).collect(), attributes: vec![xs.to_vec()] })
        };
        vec![chunk(&[1.0, 2.0]), chunk(&[3.0, f64::NAN, 4.0]), chunk(&[5.0])]
    }

    #[test]
    fn the_first_invalid_point_is_named_and_those_before_it_are_kept() {
        let mut checked = checked(chunks(), Invalid::Reject);
        assert_eq!(checked.next().unwrap().unwrap().points.len(), 2);
        let cut = checked.next().unwrap().unwrap();
        assert_eq!((cut.points.len(), cut.attributes[0].len()), (1, 1));
        let error = checked.next().unwrap().unwrap_err();
        assert!(matches!(error, Error::NotFinite { point_id: 3, .. }), "{error}");
    }

    #[test]
    fn dropped_points_pass_through_to_be_counted() {
        let lengths: Vec<_> = checked(chunks(), Invalid::Drop).map(|c| c.unwrap().points.len()).collect();
        assert_eq!(lengths, [2, 3, 1]);
    }
}
