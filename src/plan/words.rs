//! A plan in words and numbers, for people.

use super::{Plan, PlannedWindow, READING};
use crate::span::Direction;
use crate::window::Halo;

impl Plan {
    /// What was chosen and why: a label and what there is to say, line by line, for a run on so many threads.
    pub fn explain(&self, threads: usize) -> Vec<(&'static str, String)> {
        let mut lines = vec![
            (
                "points",
                format!(
                    "{} in {} slabs, each {} wide",
                    count(self.points),
                    count(self.slabs as u64),
                    short(self.width())
                ),
            ),
            ("reach", self.reach_in_words()),
            ("halo", self.halo_in_words()),
            ("direction", self.direction_in_words()),
            (
                "memory",
                format!(
                    "{} at most: about {} for the program, the rest for windows; per point {} bytes in a window at work, {} in a span in scope",
                    bytes(self.budget.bytes()),
                    bytes(self.footprint.program()),
                    self.footprint.work(),
                    self.footprint.scope()
                ),
            ),
            (
                "room",
                format!(
                    "{} points a window, with up to {} at a time",
                    count(self.room() as u64),
                    plural(self.at_a_time as u64, "window")
                ),
            ),
            ("windows", self.windows_in_words()),
        ];
        let density = |window: &&PlannedWindow| window.own as f64 / window.length;
        let by_density = |a: &&PlannedWindow, b: &&PlannedWindow| density(a).total_cmp(&density(b));
        lines.extend(self.windows.iter().max_by(by_density).map(|window| ("densest", in_words(window))));
        lines.extend(self.windows.iter().min_by(by_density).map(|window| ("thinnest", in_words(window))));
        let peak = bytes(self.peak(threads));
        lines.push((
            "expected",
            format!("a peak of about {peak} with {} at a time", plural(self.working(threads) as u64, "window")),
        ));
        lines.extend(self.warning().map(|warning| ("warning", warning)));
        lines
    }

    fn reach_in_words(&self) -> String {
        let reach = self.exactness.reach();
        if reach > 0.0 && reach.is_finite() {
            format!("pairs of points within {reach} have to share a window, so windows overlap by one slab or more")
        } else {
            "how far points are looked at together has no limit, so windows overlap by as much as there is room for"
                .into()
        }
    }

    fn halo_in_words(&self) -> String {
        match self.halo {
            Halo::None => "none: nothing beside a window has to be loaded".into(),
            Halo::Length(length) => format!("{length} on either side of a window, loaded to be looked at"),
            Halo::SpanBeyond(0.0) => "a span on either side of a window: how far would be enough cannot be told".into(),
            Halo::SpanBeyond(length) => {
                format!("{length} and a span on either side of a window: how far would be enough cannot be told")
            }
        }
    }

    fn direction_in_words(&self) -> String {
        let (chosen, other) = if self.direction() == Direction::X { ("x", "y") } else { ("y", "x") };
        let [along_x, along_y] = self.smallest;
        format!(
            "along {chosen}, where the smallest window loads {} points at the densest place; along {other} it would be {}",
            count(along_x.min(along_y)),
            count(along_x.max(along_y))
        )
    }

    fn windows_in_words(&self) -> String {
        let loaded: u64 = self.windows.iter().map(|window| window.loaded).sum();
        let times = loaded as f64 / self.points.max(1) as f64;
        let most = count(self.most_points());
        format!(
            "{} of up to {most} points; each point is loaded {times:.2} times on average",
            count(self.windows.len() as u64)
        )
    }
}

/// The warning that what comes before and after the windows does not keep to the budget.
pub(super) fn too_little(plan: &Plan) -> String {
    format!(
        "reading and writing take about {}, more than the max_memory of {}; give at least that",
        bytes(READING),
        bytes(plan.budget.bytes())
    )
}

/// The warning that windows do not keep to the budget.
pub(super) fn too_dense(needed: u64, plan: &Plan) -> String {
    let advice = if needed > READING { ", or a smaller distance" } else { "" };
    format!(
        "the densest place needs windows of {} points and a budget of about {}, some of it in reserve, more than the max_memory of {}; give at least that{advice}",
        count(plan.most_points()),
        bytes(needed.max(READING).next_multiple_of(1_000_000)),
        bytes(plan.budget.bytes())
    )
}

fn in_words(window: &PlannedWindow) -> String {
    let PlannedWindow { spans, length, own, loaded } = window;
    let halo = if loaded > own { format!(", {} with the halo", count(*loaded)) } else { String::new() };
    format!("{} over a length of {}: {} points{halo}", plural(*spans as u64, "span"), short(*length), count(*own))
}

/// A length with no more digits than it needs.
fn short(length: f64) -> f64 {
    (length * 1e6).round() / 1e6
}

/// A number with commas between thousands.
fn count(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

fn plural(number: u64, noun: &str) -> String {
    format!("{} {noun}{}", count(number), if number == 1 { "" } else { "s" })
}

fn bytes(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{} bytes", count(bytes)),
        1_000_000..10_000_000_000 => format!("{} MB", bytes / 1_000_000),
        _ => format!("{} GB", bytes / 1_000_000_000),
    }
}
