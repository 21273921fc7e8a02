//! A RECIPE: all that is done to a window, from its points to their labels.
//!
//! 1. *Preprocess*: each [`Stage`] hands on fewer points.
//! 2. *Features* that are needed and that the cloud does not have are computed. What is computed for a point is final only
//!    where all that it depends on has been loaded, so from here on the window is smaller by that much.
//! 3. *Filter*: points that the filter leaves out take no part; the seed filter says who may be the first of a segment.
//! 4. *Segment*, and spread the labels over all points again.
//!
//! To the pipeline a recipe is a [`Segmentor`] like any other.

use std::sync::Arc;

use crate::attribute::{Likeness, is_same_name, likeness, meant};
use crate::error::{Error, Result};
use crate::expression::Filter;
use crate::features::{Feature, Fit, compute, compute_and_keep};
use crate::label::Cause;
use crate::neighborhood::{Grid, Search};
use crate::preprocessing::{Preprocessed, Stage, apply_all, total_halo};
use crate::segmentor::{Exactness, Plane, Segmented, Segmentor, segment};
use crate::window::{Halo, Window};

/// The coordinates, as attributes.
const COORDINATES: [&str; 3] = ["X", "Y", "Z"];

/// More neighbors than this are searched for again rather than kept for all points at the same time.
const MOST_KEPT: usize = 256;

/// Bytes of a point in a window that is made of another: position, id, what it stands for.
const BYTES_PER_COPY: usize = 48;

/// The attributes that are one vector: all from the cloud, or all computed.
const NORMAL: [&str; 3] = ["NormalX", "NormalY", "NormalZ"];

/// What a recipe is made of.
#[derive(Clone)]
pub struct Ingredients {
    /// Steps before anything else, in order.
    pub stages: Vec<Arc<dyn Stage>>,
    /// Which points take part.
    pub filter: Option<Filter>,
    /// Which points may be the first of a segment.
    pub seed_filter: Option<Filter>,
    /// How planes are fitted where features are computed.
    pub fit: Fit,
    /// Who labels what is left.
    pub segmentor: Arc<dyn Segmentor>,
}

/// Which points of a window take part.
#[derive(Default)]
struct TakingPart {
    kept: Vec<u32>,
    /// Those about which the window does not hold all that decides whether they do, and how.
    undecided: Vec<u32>,
}

/// Preprocessing, features, filters and a segmentor in one.
pub struct Recipe {
    ingredients: Ingredients,
    /// The columns of the cloud that are needed.
    reads: Vec<String>,
    /// The coordinates that are needed as columns.
    coordinates: Vec<usize>,
    /// The features that the cloud does not have.
    features: Vec<Feature>,
    search: Option<Search>,
}

impl Recipe {
    /// A recipe for a cloud that has the attributes `available`; if it `has_more`, any other name may be one too.
    ///
    /// # Errors
    /// If something needs an attribute that the cloud does not have and that cannot be computed.
    pub fn new(ingredients: Ingredients, available: &[String], has_more: bool) -> Result<Self> {
        let mut recipe = Self {
            reads: vec![],
            coordinates: vec![],
            features: vec![],
            search: ingredients.segmentor.neighborhood(),
            ingredients,
        };
        let mut needed = recipe.ingredients.segmentor.attributes();
        let known = known_to_all(available, recipe.search.is_some());
        if !has_more {
            recipe.ingredients.segmentor.check(&known)?;
        }
        for filter in [&recipe.ingredients.filter, &recipe.ingredients.seed_filter].into_iter().flatten() {
            if !has_more {
                recipe.check_features(filter.attributes(), available)?;
                filter.check(&known)?;
            }
            needed.extend(filter.attributes().map(ToString::to_string));
        }
        let normal = normal_columns(&needed, available);
        for name in needed {
            if NORMAL.iter().any(|part| is_same_name(part, &name)) {
                recipe.provide(&name, &normal, false)?;
            } else {
                recipe.provide(&name, available, has_more)?;
            }
        }
        Ok(recipe)
    }

    /// Refuses features that the cloud does not have and that nothing could be computed from: a better answer than that
    /// there is no such attribute.
    fn check_features<'a>(&self, names: impl Iterator<Item = &'a str>, available: &[String]) -> Result<()> {
        let is_read = |name: &str| available.iter().any(|column| is_same_name(column, name));
        match names.filter(|name| !is_read(name)).find_map(Feature::by_name) {
            Some(feature) if self.search.is_none() => {
                Err(Error::NoNeighborhood { name: feature.name(), segmentor: self.name().into() })
            }
            _ => Ok(()),
        }
    }

    /// The features that are computed because the cloud does not have them.
    pub fn computes(&self) -> &[Feature] {
        &self.features
    }

    /// Decides where an attribute comes from. Coordinates are those of the points, whatever a file calls its whole
    /// numbers; for all else the cloud comes first, so that what was measured or computed with more care is used.
    fn provide(&mut self, name: &str, available: &[String], has_more: bool) -> Result<()> {
        let column = meant(name, available.iter().map(String::as_str))?;
        if let Some(axis) = axis_of(column.unwrap_or(name), available) {
            if !self.coordinates.contains(&axis) {
                self.coordinates.push(axis);
            }
        } else if let Some(column) = column {
            if !self.reads.iter().any(|read| read == column) {
                self.reads.push(column.to_string());
            }
        } else if let Some(feature) = Feature::by_name(name) {
            if self.search.is_none() {
                return Err(Error::NoNeighborhood { name: feature.name(), segmentor: self.name().into() });
            }
            if !self.features.contains(&feature) {
                self.features.push(feature);
            }
        } else if has_more {
            self.reads.push(name.to_string());
        } else {
            return Err(Error::unknown_attribute(name, &known_to_all(available, self.search.is_some())));
        }
        Ok(())
    }

    /// Whether features decide who takes part.
    fn filter_computes(&self) -> bool {
        let is_computed = |name: &str| self.features.iter().any(|feature| is_same_name(feature.name(), name));
        self.ingredients.filter.as_ref().is_some_and(|filter| filter.attributes().any(is_computed))
    }

    /// How far around a point its features depend on others; 0 if none are computed.
    fn feature_reach(&self) -> f64 {
        self.search.filter(|_| !self.features.is_empty()).map_or(0.0, |search| search.reach())
    }

    fn add_columns(&self, window: &mut Window) {
        for &axis in &self.coordinates {
            let lattice = *window.lattice();
            let values = window.points().iter().map(|point| lattice.real(point)[axis]).collect();
            window.columns_mut().set(COORDINATES[axis], values);
        }
        let (Some(search), false) = (self.search, self.features.is_empty()) else { return };
        let fit = self.ingredients.fit;
        let (points, point_ids, lattice) = (window.points(), window.point_ids(), window.lattice());
        let computed = if self.keeps_neighbors(search) {
            let (computed, kept) = compute_and_keep(points, point_ids, lattice, search, fit, &self.features);
            window.set_neighborhoods(kept);
            computed
        } else {
            compute(points, point_ids, lattice, search, fit, &self.features)
        };
        for (feature, values) in self.features.iter().zip(computed.columns) {
            window.columns_mut().set(feature.name(), values);
        }
        if search.reach() == f64::INFINITY {
            let is_final = window.points().iter().zip(&computed.support).map(|(p, &r)| window.holds(p, r)).collect();
            window.set_final(is_final);
        } else {
            // Now and then one reach for all is less than each point's own, but it says which part of the map is final.
            window.shrink(search.reach());
        }
    }

    /// Whether the neighbors found for features are those that the segmentor would find: with a filter they are not, since
    /// features are those of the whole cloud. How many lie within a radius has no limit, and neither has the memory.
    fn keeps_neighbors(&self, search: Search) -> bool {
        let Ingredients { segmentor, filter, .. } = &self.ingredients;
        segmentor.looks_at_neighbors()
            && filter.is_none()
            && matches!(search, Search::Nearest { k, .. } if k <= MOST_KEPT)
    }

    /// The positions of the points that take part; none if all do.
    fn taking_part(&self, window: &Window) -> Result<Option<TakingPart>> {
        let everywhere = window.extent().is_none() || self.feature_reach() == 0.0;
        if everywhere && self.ingredients.filter.is_none() {
            return Ok(None);
        }
        let filter = self.ingredients.filter.as_ref();
        let filter = filter.map(|filter| filter.bind(|name| window.columns().get(name))).transpose()?;
        // Whoever looks at neighbors has to know that there may be more of them.
        let is_open = self.filter_computes() && matches!(self.exactness(), Exactness::WithHalo { .. });
        let may_take_part = |i: u32| is_open && !window.is_final(i);
        let passes = |i: u32| filter.as_ref().is_none_or(|filter| filter.holds(i as usize));
        let mut taking_part = TakingPart::default();
        for i in 0..window.points().len() as u32 {
            let is_held = everywhere || window.holds(&window.points()[i as usize], 0.0);
            if is_held && (passes(i) || may_take_part(i)) {
                taking_part.kept.push(i);
            } else if !is_held && (self.filter_computes() || passes(i)) {
                taking_part.undecided.push(i);
            }
        }
        Ok(Some(taking_part))
    }

    fn mark_seeds(&self, window: &mut Window) -> Result<()> {
        let Some(filter) = &self.ingredients.seed_filter else { return Ok(()) };
        let filter = filter.bind(|name| window.columns().get(name))?;
        let seeds = (0..window.points().len()).map(|i| filter.holds(i)).collect();
        window.set_seeds(seeds);
        Ok(())
    }

    /// Features, filters and segmentor, without the stages.
    fn segment_prepared(&self, mut window: Window) -> Result<Segmented> {
        self.add_columns(&mut window);
        let taking_part = self.taking_part(&window)?;
        let all = window.points().len();
        if let Some(TakingPart { kept, .. }) = &taking_part {
            window = window.restricted(kept);
        }
        self.mark_seeds(&mut window)?;
        let mut segmented = segment(&*self.ingredients.segmentor, &window)?;
        segmented.seeded = window.seeds().map(|seeds| {
            let mut seeded = vec![false; segmented.labels.count()];
            for (&label, _) in
                segmented.labels.of_points().iter().zip(seeds).filter(|(label, seed)| **label >= 0 && **seed)
            {
                seeded[label as usize] = true;
            }
            seeded
        });
        if let Some(TakingPart { kept, undecided }) = taking_part {
            segmented = segmented.spread(&kept, all, Cause::Filtered);
            if segmented.undecided.is_some() || !self.ingredients.stages.is_empty() {
                segmented = segmented.leaving_open(undecided);
            } else {
                segmented.labels.because(undecided, Cause::Undecided);
            }
        }
        Ok(segmented)
    }
}

/// The axis that a name or column stands for. Where a file has coordinates under their own names, others that differ
/// from them in case are something else.
fn axis_of(name: &str, available: &[String]) -> Option<usize> {
    let axis = COORDINATES.iter().position(|axis| is_same_name(axis, name))?;
    let is_other = name != COORDINATES[axis] && [name, COORDINATES[axis]].iter().all(|one| has(one, available));
    (!is_other).then_some(axis)
}

fn has(name: &str, available: &[String]) -> bool {
    available.iter().any(|column| column == name)
}

/// The columns that parts of the normal are read from: those of a spelling, long or short, in which the cloud has all
/// parts that are needed. Parts of two normals are none.
fn normal_columns(needed: &[String], available: &[String]) -> Vec<String> {
    let family = |is_short: bool| {
        available.iter().filter(move |column| {
            let alike = NORMAL.iter().find_map(|part| likeness(part, column));
            alike.is_some_and(|likeness| (likeness == Likeness::Synonym) == is_short)
        })
    };
    let is_whole = |is_short: bool| {
        NORMAL.iter().all(|part| {
            let is_needed = needed.iter().any(|name| is_same_name(part, name));
            !is_needed || family(is_short).any(|column| is_same_name(part, column))
        })
    };
    [false, true].into_iter().filter(|&is_short| is_whole(is_short)).flat_map(family).cloned().collect()
}

/// The coordinates, the attributes of the cloud, and the features, if there is a neighborhood to compute them from.
fn known_to_all(available: &[String], has_neighborhood: bool) -> Vec<String> {
    let mut known: Vec<String> = COORDINATES.map(str::to_string).to_vec();
    known.extend(available.iter().filter(|column| axis_of(column, available).is_none()).cloned());
    for feature in Feature::ALL.iter().filter(|_| has_neighborhood).map(|feature| feature.name()) {
        if !known.iter().any(|other| is_same_name(other, feature)) {
            known.push(feature.to_string());
        }
    }
    known
}

impl Segmentor for Recipe {
    fn name(&self) -> &str {
        self.ingredients.segmentor.name()
    }

    fn exactness(&self) -> Exactness {
        let stages = &self.ingredients.stages;
        if total_halo(stages) == f64::INFINITY {
            // Such as statistics of what has come so far: they depend on how the cloud is cut.
            return Exactness::Measured { reach: f64::INFINITY, halo: f64::INFINITY };
        }
        let halo = total_halo(stages) + self.feature_reach();
        let displacement: f64 = stages.iter().map(|stage| stage.displacement()).sum();
        let exactness = self.ingredients.segmentor.exactness();
        // What windows leave open is decided for the points of the cloud, not for others in their place.
        let exactness = if stages.is_empty() { exactness } else { exactness.without_proof() };
        exactness.with_halo(halo).with_reach(2.0 * displacement)
    }

    /// Where there is no limit to what decides about a point, at least what the stages need is loaded, and a span beyond.
    fn halo(&self) -> Halo {
        let of_stages = self.ingredients.stages.iter().map(|stage| stage.halo()).filter(|halo| halo.is_finite());
        match self.exactness().halo() {
            Halo::SpanBeyond(length) => Halo::SpanBeyond(length + of_stages.sum::<f64>()),
            halo => halo,
        }
    }

    fn is_concurrent(&self) -> bool {
        self.ingredients.segmentor.is_concurrent() && self.ingredients.stages.iter().all(|stage| stage.is_concurrent())
    }

    fn reads(&self) -> Vec<String> {
        self.reads.clone()
    }

    /// What decides about a point, if the points that are looked at are those of the cloud: after a stage, what is around
    /// its neighbors decides whether they are there.
    fn neighborhood(&self) -> Option<Search> {
        self.search.filter(|_| self.ingredients.stages.is_empty())
    }

    fn bytes_per_point(&self) -> usize {
        // What takes part is copied, with all its columns.
        let columns = self.coordinates.len() + self.features.len() + self.reads.len();
        let copies = (1 + self.ingredients.stages.len()) * (BYTES_PER_COPY + columns * size_of::<f64>());
        let kept = match self.search {
            Some(search @ Search::Nearest { k, .. }) if self.keeps_neighbors(search) => k * size_of::<u32>(),
            _ => 0,
        };
        // The grid of the features is gone when the segmentor begins.
        let working = Grid::BYTES_PER_POINT.max(self.ingredients.segmentor.bytes_per_point());
        copies + columns * size_of::<f64>() + kept + working
    }

    fn segment(&self, window: &Window) -> Result<Segmented> {
        let Preprocessed { window, successors, undecided } = apply_all(&self.ingredients.stages, window)?;
        let segmented = self.segment_prepared(window)?;
        if self.ingredients.stages.is_empty() {
            return Ok(segmented);
        }
        Ok(segmented.take(&successors, Cause::Removed).leaving_open(undecided))
    }

    fn cause(&self) -> Cause {
        self.ingredients.segmentor.cause()
    }

    fn agree(&self, a: &Plane, b: &Plane) -> bool {
        self.ingredients.segmentor.agree(a, b)
    }
}
