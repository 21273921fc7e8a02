//! How large a segment may be, and how segments are ordered by their size.
//!
//! A size is a number of points. It is known when the segment is closed: when no later window can touch it.

use std::str::FromStr;

use crate::error::{Error, Result, at_least_one};

/// The sizes that are kept; segments of other sizes are left out of the final result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SizeLimits {
    min: u64,
    max: Option<u64>,
}

impl Default for SizeLimits {
    /// Every segment is kept.
    fn default() -> Self {
        Self { min: 1, max: None }
    }
}

impl SizeLimits {
    /// Keeps segments of at least `min` points and, if there is a `max`, of at most that many.
    ///
    /// # Errors
    /// If `min` is 0, or `max` is below it.
    pub fn new(min: usize, max: Option<usize>) -> Result<Self> {
        at_least_one("min_segment_size", min)?;
        match max {
            Some(max) if max < min => Err(Error::InvalidParameter {
                name: "max_segment_size",
                given: format!("{max} with a min_segment_size of {min}"),
                allowed: "at least min_segment_size, or none",
            }),
            _ => Ok(Self { min: min as u64, max: max.map(|max| max as u64) }),
        }
    }

    /// The fewest points of a segment that is kept.
    pub fn min(&self) -> u64 {
        self.min
    }

    /// The most points of a segment that is kept; none = any number.
    pub fn max(&self) -> Option<u64> {
        self.max
    }

    /// Whether a segment of so many points is kept.
    pub fn contains(&self, points: u64) -> bool {
        points >= self.min && self.max.is_none_or(|max| points <= max)
    }
}

/// The order in which final segments are numbered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sort {
    /// Not numbered anew: the smallest raw id of each segment, so in the order in which they were first seen.
    #[default]
    Native,
    /// From 1, the smallest segment first.
    Ascending,
    /// From 1, the largest segment first.
    Descending,
}

impl Sort {
    /// The name, as users type it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Ascending => "ascending",
            Self::Descending => "descending",
        }
    }
}

impl FromStr for Sort {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        [Self::Native, Self::Ascending, Self::Descending].into_iter().find(|sort| sort.name() == name).ok_or_else(
            || Error::parameter("sort", format!("'{name}'"), "'native', 'ascending' or 'descending' (by size)"),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_inclusive_and_have_to_be_in_order() {
        let limits = SizeLimits::new(3, Some(5)).unwrap();
        assert_eq!([2, 3, 5, 6].map(|points| limits.contains(points)), [false, true, true, false]);
        assert!(SizeLimits::default().contains(u64::MAX) && !SizeLimits::default().contains(0));
        assert!(SizeLimits::new(0, None).unwrap_err().to_string().contains("min_segment_size is 0"));
        let crossed = SizeLimits::new(5, Some(4)).unwrap_err().to_string();
        assert!(crossed.contains("max_segment_size is 4 with a min_segment_size of 5"), "{crossed}");
    }

    #[test]
    fn an_order_has_a_name() {
        for sort in [Sort::Native, Sort::Ascending, Sort::Descending] {
            assert_eq!(sort.name().parse::<Sort>().unwrap(), sort);
        }
        let wrong = "up".parse::<Sort>().unwrap_err().to_string();
        assert_eq!(wrong, "sort is 'up', allowed: 'native', 'ascending' or 'descending' (by size)");
    }
}
