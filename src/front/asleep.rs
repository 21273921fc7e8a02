//! Places that no point but one beyond a line can give further neighbors.

use crate::neighborhood::Opening;

/// Sleeping places, line by line.
#[derive(Debug, Default)]
pub(super) struct Asleep {
    lines: Vec<Line>,
}

#[derive(Debug)]
struct Line {
    beyond: Opening,
    places: Vec<[f64; 2]>,
}

impl Asleep {
    /// Puts a place to sleep until there is one beyond.
    pub(super) fn put(&mut self, place: [f64; 2], beyond: Opening) {
        match self.lines.iter_mut().find(|line| line.beyond.is_beyond_the_line_of(&beyond)) {
            Some(line) => line.places.push(place),
            None => self.lines.push(Line { beyond, places: vec![place] }),
        }
    }

    /// Takes out the places of all lines beyond which one of the `new` places lies.
    pub(super) fn wake(&mut self, new: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let is_beyond = |line: &mut Line| new.iter().any(|place| line.beyond.holds(*place));
        self.lines.extract_if(.., is_beyond).flat_map(|line| line.places).collect()
    }

    /// How many places sleep.
    pub(super) fn len(&self) -> usize {
        self.lines.iter().map(|line| line.places.len()).sum()
    }
}
