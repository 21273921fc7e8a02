//! What several looks say of a window's own points, put together.

use super::{Look, Sight};
use crate::label::{Cause, Labels, NONE};
use crate::segmentor::Segmented;
use crate::union_find::UnionFind;

/// The own points of a window with the labels of all looks at it. Labels that share a point are one.
pub struct Said {
    /// The first label that each own point got, or why it got none.
    labels: Vec<i32>,
    /// How many labels there are.
    count: u32,
    same: Vec<[u32; 2]>,
    seeded: Option<Vec<bool>>,
    sights: Vec<Sight>,
    of_context: Vec<i32>,
    undecided: Vec<u32>,
    rest: Segmented,
}

impl From<Look> for Said {
    fn from(Look { mut segmented, sights, of_context }: Look) -> Self {
        Self {
            labels: segmented.labels.of_points().to_vec(),
            count: segmented.labels.count() as u32,
            same: Vec::new(),
            seeded: segmented.seeded.take(),
            sights,
            of_context,
            undecided: segmented.undecided.take().unwrap_or_default(),
            rest: segmented,
        }
    }
}

impl Said {
    /// Adds a label, which may hold a seed or not.
    pub fn add_label(&mut self, is_seeded: bool) -> i32 {
        if let Some(seeded) = &mut self.seeded {
            seeded.push(is_seeded);
        }
        self.count += 1;
        self.count as i32 - 1
    }

    /// An own point has this label, too.
    pub fn label(&mut self, point: u32, label: i32) {
        let known = &mut self.labels[point as usize];
        if *known < 0 {
            *known = label;
        } else {
            self.same.push([*known as u32, label as u32]);
        }
    }

    /// An own point has been decided to have no label.
    pub fn explain(&mut self, point: u32, cause: Cause) {
        let known = &mut self.labels[point as usize];
        if *known < 0 {
            *known = cause.label();
        }
    }

    /// A point beyond has this label.
    pub fn see(&mut self, sight: Sight) {
        self.sights.push(sight);
    }

    /// Some own points, in ascending order, have been decided; `looked_at` others were looked at for it.
    pub fn decide(&mut self, points: &[u32], looked_at: u64) {
        self.undecided.retain(|point| points.binary_search(point).is_err());
        self.rest.tally.returned_points += looked_at;
    }

    /// What all looks say together.
    pub fn together(self) -> Look {
        let mut sets = UnionFind::new(self.count as usize);
        self.same.iter().for_each(|&[a, b]| sets.union(a, b));
        let whole = sets.into_representatives();
        let labelled: Vec<u32> =
            (0..).zip(&self.labels).filter(|(_, label)| **label >= 0).map(|(point, _)| point).collect();
        let whole_of = |&point: &u32| whole[self.labels[point as usize] as usize];
        let labels = Labels::from_representatives(labelled.iter().map(whole_of), whole.len());
        let mut number = vec![NONE as i32; whole.len()];
        for (point, &label) in labelled.iter().zip(labels.of_points()) {
            number[whole_of(point) as usize] = label;
        }
        let number_of = |label: i32| number[whole[label as usize] as usize];
        let seeded = self.seeded.map(|seeded| {
            let mut together = vec![false; labels.count()];
            for (label, _) in (0..).zip(seeded).filter(|&(label, is_seeded)| is_seeded && number_of(label) >= 0) {
                together[number_of(label) as usize] = true;
            }
            together
        });
        let sights = self.sights.iter().map(|sight| Sight { label: number_of(sight.label), ..*sight });
        let sights = sights.filter(|sight| sight.label >= 0).collect();
        let mut labels = labels.spread(&labelled, self.labels.len(), Cause::BySegmentor);
        for (point, cause) in
            (0..).zip(&self.labels).filter_map(|(point, &label)| Some((point, Cause::of_label(label)?)))
        {
            labels.because([point], cause);
        }
        let mut segmented = Segmented { labels, seeded, ..self.rest };
        segmented.tally.waiting_points = self.undecided.len() as u64;
        segmented.tally.decided_points = (self.labels.len() - self.undecided.len()) as u64;
        segmented.undecided = Some(self.undecided);
        let of_context = self.of_context.iter().map(|&label| if label < 0 { label } else { number_of(label) });
        Look { segmented, sights, of_context: of_context.collect() }
    }
}
