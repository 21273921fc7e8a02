//! How much memory a run takes, as far as it depends on its windows: what a budget leaves room for.
//!
//! What is under way at the same time: windows at work, one per thread; the points of these, of the two woven last and of
//! what is read ahead; and a window's segment ids on their way out.

use std::str::FromStr;

use crate::error::{Error, Result};
use crate::segmentor::Segmentor;

/// What the program takes without any window: interpreter, libraries, buffers. Measured, as all numbers here.
const PROGRAM: u64 = 80_000_000;

/// What reading, spooling and writing take at most, before and after the windows.
pub(super) const READING: u64 = 135_000_000;

/// What a history takes on top: the libraries that write it, and rows that wait.
const HISTORY: u64 = 90_000_000;

/// Bytes of a point in memory: position and point id.
const POINT: u64 = 32;

/// Bytes of an attribute of a point.
const ATTRIBUTE: u64 = 8;

/// Bytes of a point on its way out: raw and carried ids, and its place in the weaver's tables.
const WOVEN: u64 = 48;

/// Windows in scope besides those at work: the two woven last, and what is read ahead.
const BESIDE: u64 = 3;

/// Out of 100 bytes that windows may take, so many are planned with; the rest is for what cannot be foreseen.
const PLANNED: u64 = 85;

const UNITS: [(&str, f64); 10] = [
    ("B", 1.0),
    ("KB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("TB", 1e12),
    ("KIB", 1024.0),
    ("MIB", 1_048_576.0),
    ("GIB", 1_073_741_824.0),
    ("TIB", 1_099_511_627_776.0),
    ("", 1.0),
];

/// The most memory that a run may take, the program and its libraries included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    bytes: u64,
}

impl Default for Budget {
    /// 512 MB.
    fn default() -> Self {
        Self { bytes: 512_000_000 }
    }
}

impl Budget {
    /// A budget of so many bytes.
    ///
    /// # Errors
    /// If it is 0.
    pub fn new(bytes: u64) -> Result<Self> {
        if bytes == 0 { Err(refused(bytes)) } else { Ok(Self { bytes }) }
    }

    /// How many bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl FromStr for Budget {
    type Err = Error;

    /// Reads a number with a unit: "512MB", "1.5 GiB".
    fn from_str(text: &str) -> Result<Self> {
        let trimmed = text.trim();
        let digits = trimmed.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(trimmed.len());
        let (number, unit) = trimmed.split_at(digits);
        let factor = UNITS.iter().find(|(name, _)| name.eq_ignore_ascii_case(unit)).map(|(_, factor)| factor);
        match (number.trim().parse::<f64>(), factor) {
            (Ok(number), Some(factor)) if number.is_finite() && number * factor >= 1.0 => {
                Self::new((number * factor) as u64)
            }
            _ => Err(refused(format!("'{text}'"))),
        }
    }
}

fn refused(given: impl std::fmt::Display) -> Error {
    Error::parameter("max_memory", given, "a number of bytes above 0, or one with a unit: '512MB', '2GB', '1.5 GiB'")
}

/// What a point takes while it is in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Footprint {
    program: u64,
    /// Of a window that is being segmented, for each point that it loads.
    work: u64,
    /// Of a span in scope.
    scope: u64,
}

impl Footprint {
    /// What windows of this segmentor take, with a history or without.
    pub fn of(segmentor: &dyn Segmentor, with_history: bool) -> Self {
        let scope = POINT + ATTRIBUTE * segmentor.reads().len() as u64;
        let program = PROGRAM + if with_history { HISTORY } else { 0 };
        Self { program, work: scope + segmentor.bytes_per_point() as u64, scope }
    }

    /// Bytes per point of a window at work.
    pub fn work(&self) -> u64 {
        self.work
    }

    /// Bytes per point in scope.
    pub fn scope(&self) -> u64 {
        self.scope
    }

    /// Bytes without any window.
    pub fn program(&self) -> u64 {
        self.program
    }

    /// Bytes that a run takes whose largest window loads so many points, with so many windows at a time.
    pub fn peak(&self, points: u64, at_a_time: usize) -> u64 {
        (self.program + points * self.per_point(at_a_time)).max(READING)
    }

    /// The budget that windows of so many points need, one at a time.
    pub fn needed(&self, points: u64) -> u64 {
        self.program + points * self.per_point(1) * 100 / PLANNED
    }

    /// How many points each window may load.
    pub fn room(&self, budget: Budget, at_a_time: usize) -> u64 {
        budget.bytes.saturating_sub(self.program) * PLANNED / 100 / self.per_point(at_a_time)
    }

    /// Bytes for each point of the largest window.
    fn per_point(&self, at_a_time: usize) -> u64 {
        let at_a_time = at_a_time as u64;
        at_a_time * self.work + (at_a_time + BESIDE) * self.scope + WOVEN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_a_number_with_a_unit() {
        for (text, bytes) in [
            ("512MB", 512_000_000),
            ("2GB", 2_000_000_000),
            ("1.5 GiB", 1_610_612_736),
            (" 64 mib ", 67_108_864),
            ("300000000", 300_000_000),
            ("10kB", 10_000),
        ] {
            assert_eq!(text.parse::<Budget>().map(|budget| budget.bytes()).ok(), Some(bytes), "{text}");
        }
        for text in ["", "MB", "0MB", "-1GB", "0.2 B", "12 parsecs", "nan", "inf", "1 2 MB", "512M", "1e9"] {
            let error = text.parse::<Budget>().unwrap_err().to_string();
            assert!(error.starts_with(&format!("max_memory is '{text}', allowed: a number of bytes")), "{error}");
        }
        assert!(Budget::new(0).is_err());
    }

    #[test]
    fn what_there_is_room_for_keeps_to_the_budget() {
        let footprint = Footprint { program: PROGRAM, work: 300, scope: 40 };
        for bytes in [1, 100_000_000, 256_000_000, 4_000_000_000] {
            let budget = Budget::new(bytes).unwrap();
            for at_a_time in 1..9 {
                let room = footprint.room(budget, at_a_time);
                assert!(room == 0 || footprint.peak(room, at_a_time) <= bytes.max(READING));
                assert!(room >= footprint.room(budget, at_a_time + 1));
            }
            let alone = footprint.room(budget, 1);
            assert!(footprint.needed(alone) <= bytes.max(PROGRAM));
        }
    }
}
