//! How many spans windows have, and how far around them more of the cloud is loaded.

use crate::error::{Error, Result, at_least_one};

/// How many spans a window has and how many of them it shares with the next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WindowSize {
    spans: usize,
    overlap: usize,
    /// So many points, halo included, a window of more spans than that may load; none = it has no more.
    room: Option<usize>,
}

impl Default for WindowSize {
    /// The paper's: 3 spans, 1 of them shared.
    fn default() -> Self {
        Self { spans: 3, overlap: 1, room: None }
    }
}

impl WindowSize {
    /// Windows of `spans` spans, `overlap` of them shared with the next window.
    ///
    /// # Errors
    /// If there is no span, or the window would not move on.
    pub fn new(spans: usize, overlap: usize) -> Result<Self> {
        at_least_one("spans", spans)?;
        if overlap >= spans {
            return Err(Error::InvalidParameter {
                name: "overlap",
                given: format!("{overlap} of {spans} spans"),
                allowed: "fewer spans than the window has, or the window would never move on",
            });
        }
        Ok(Self { spans, overlap, room: None })
    }

    /// Windows of at least so many spans, and of as many more as load no more than `points` points, halo included: long
    /// where the cloud is thin, short where it is dense.
    #[must_use]
    pub fn with_room(self, points: usize) -> Self {
        Self { room: Some(points), ..self }
    }

    /// How many points windows of more spans than they need may load.
    pub fn room(&self) -> Option<usize> {
        self.room
    }

    /// Spans per window, or the least of them where there is room for more.
    pub fn spans(&self) -> usize {
        self.spans
    }

    /// Spans that two consecutive windows share.
    pub fn overlap(&self) -> usize {
        self.overlap
    }

    /// By how many spans the window moves on, or the least of them where there is room for more.
    pub fn advance(&self) -> usize {
        self.spans - self.overlap
    }
}

/// How far around a window's own spans more of the cloud is loaded, only to be looked at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Halo {
    /// Nothing more.
    #[default]
    None,
    /// All that lies within this length, in units of the coordinates.
    Length(f64),
    /// All that lies within this length, and one span more on either side: how far would be enough cannot be told.
    SpanBeyond(f64),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_has_to_move() {
        assert!(WindowSize::new(3, 3).unwrap_err().to_string().contains("overlap is 3 of 3 spans"));
        assert!(WindowSize::new(0, 0).is_err());
    }
}
