//! The language of criteria, filters and calculators.
//!
//! A [`Criterion`] says whether a point and its neighbor belong together, a [`Filter`] whether a point takes part, a
//! [`Calculator`] gives each point a number. All are texts, read once, bound to the columns of a window, and then
//! evaluated for each point or pair. `docs/expressions.md` is the language's page.
//!
//! After the generic filters and calculators of OPALS (TU Wien) as far as they are public, with the operators of C and
//! the functions of PDAL's expressions. The pair variables and the symmetry check are ours.
//!
//! ```
//! use streamseg::expression::{Criterion, Pair};
//!
//! let criterion = Criterion::parse("abs(Z - n[0].Z) < 0.15")?;
//! let z = [1.0, 1.1, 2.0];
//! let bound = criterion.bind(|name| (name == "Z").then_some(&z[..]))?;
//! let pair = Pair { dist: 1.0, dist2d: 1.0, dz: 0.1 };
//! assert!(bound.holds(0, 1, &pair) && !bound.holds(0, 2, &pair));
//! # Ok::<(), streamseg::error::Error>(())
//! ```

mod counterexample;
mod normal_form;
mod operands;
mod operation;
mod parse;
mod precedence;
mod problem;
mod program;
mod region;
mod symmetry;
mod syntax;
mod tree;

use crate::attribute::meant;
use crate::error::Result;
pub use symmetry::Symmetry;

use problem::{Kind, mistake, suggestion};
use program::Program;
use tree::{Node, Tree};

/// A column for each attribute of a tree.
type Columns<'a> = [&'a [f64]];

/// What two points have in common besides their attributes, in units of the coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pair {
    /// The distance in space.
    pub dist: f64,
    /// The distance on the map.
    pub dist2d: f64,
    /// How much higher the neighbor is than the point.
    pub dz: f64,
}

impl Pair {
    /// Of a neighbor that lies this far from the point along x, y and z.
    pub fn of_offset([dx, dy, dz]: [f64; 3]) -> Pair {
        let squared = dx * dx + dy * dy;
        Pair { dist: (squared + dz * dz).sqrt(), dist2d: squared.sqrt(), dz }
    }
}

/// A text and what it means.
#[derive(Debug, Clone)]
struct Expression {
    kind: Kind,
    text: String,
    tree: Tree,
}

impl Expression {
    fn parse(kind: Kind, text: &str) -> Result<Self> {
        Ok(Expression { kind, text: text.to_owned(), tree: parse::parse(kind, text)? })
    }

    fn attributes(&self) -> impl Iterator<Item = &str> {
        self.tree.attributes.iter().map(|attribute| attribute.name.as_str())
    }

    fn check(&self, available: &[impl AsRef<str>]) -> Result<()> {
        for attribute in &self.tree.attributes {
            let name = self.meant(&attribute.name, attribute.at, available)?;
            if let Some((other, at)) = &attribute.respelled
                && self.meant(other, *at, available)? != name
            {
                let problem = format!("'{other}' and '{}' are different attributes; use one of them", attribute.name);
                return Err(mistake(self.kind, &self.text, *at, problem));
            }
        }
        Ok(())
    }

    /// The attribute that is meant by a name in the text.
    fn meant<'a>(&self, name: &str, at: usize, available: &'a [impl AsRef<str>]) -> Result<&'a str> {
        let known = available.iter().map(AsRef::as_ref);
        let problem = match meant(name, known.clone()) {
            Ok(Some(found)) => return Ok(found),
            Ok(None) => format!("there is no attribute '{name}'{}", suggestion(name, known)),
            Err(ambiguous) => ambiguous.to_string(),
        };
        Err(mistake(self.kind, &self.text, at, problem))
    }

    fn bind<'a>(&self, columns: impl Fn(&str) -> Option<&'a [f64]>) -> Result<Program<'a>> {
        let column = |attribute: &tree::Attribute| {
            columns(&attribute.name).ok_or_else(|| {
                let problem = format!("there is no attribute '{}'", attribute.name);
                mistake(self.kind, &self.text, attribute.at, problem)
            })
        };
        let columns: Vec<_> = self.tree.attributes.iter().map(column).collect::<Result<_>>()?;
        Ok(Program::new(&self.tree, &columns))
    }
}

macro_rules! expression {
    ($(#[$about:meta])* $name:ident, $bound:ident) => {
        $(#[$about])*
        #[derive(Debug, Clone)]
        pub struct $name(Expression);

        impl $name {
            /// Reads a text: its syntax and types. Which attributes there are is asked by `check` and `bind`.
            ///
            /// # Errors
            ///
            /// If the text is not of the language, with the column and what is allowed there.
            pub fn parse(text: &str) -> Result<Self> {
                Expression::parse(Kind::$name, text).map($name)
            }

            /// The text as it was given.
            pub fn text(&self) -> &str {
                &self.0.text
            }

            /// The attributes it needs, each once, as first written.
            pub fn attributes(&self) -> impl Iterator<Item = &str> {
                self.0.attributes()
            }

            /// Checks that every attribute it needs is among the available ones, whatever the case of letters.
            ///
            /// # Errors
            ///
            /// If one is not, with its column and the attributes there are.
            pub fn check(&self, available: &[impl AsRef<str>]) -> Result<()> {
                self.0.check(available)
            }

            /// Binds it to columns with one value per point, NaN where there is none. `columns` is asked for each of
            /// `attributes` as it is written there.
            ///
            /// # Errors
            ///
            /// If there is no such column.
            pub fn bind<'a>(&self, columns: impl Fn(&str) -> Option<&'a [f64]>) -> Result<$bound<'a>> {
                self.0.bind(columns).map($bound)
            }
        }
    };
}

expression! {
    /// Whether a point and its neighbor belong together.
    Criterion, BoundCriterion
}

expression! {
    /// Whether a point takes part.
    Filter, BoundFilter
}

expression! {
    /// A number for each point, which may be invalid.
    Calculator, BoundCalculator
}

impl Criterion {
    /// Whether it holds for every pair, whatever the attributes are.
    pub fn is_always_true(&self) -> bool {
        matches!(self.0.tree.nodes[self.0.tree.root], Node::Truth(true))
    }

    /// Whether it is the same from either end. Takes up to some milliseconds.
    pub fn symmetry(&self) -> Symmetry {
        Symmetry::of(&self.0.tree)
    }
}

/// A criterion and the columns of a window.
#[derive(Debug, Clone)]
pub struct BoundCriterion<'a>(Program<'a>);

impl BoundCriterion<'_> {
    /// Whether a point and its neighbor, both by their positions in the columns, belong together.
    ///
    /// # Panics
    ///
    /// If a column ends before that position.
    #[inline]
    pub fn holds(&self, point: usize, neighbor: usize, pair: &Pair) -> bool {
        self.0.value(point, neighbor, pair) != 0.0
    }
}

/// A filter and the columns of a window.
#[derive(Debug, Clone)]
pub struct BoundFilter<'a>(Program<'a>);

impl BoundFilter<'_> {
    /// Whether the point at this position of the columns takes part.
    ///
    /// # Panics
    ///
    /// If a column ends before that position.
    #[inline]
    pub fn holds(&self, point: usize) -> bool {
        self.0.value(point, point, &Pair::default()) != 0.0
    }
}

/// A calculator and the columns of a window.
#[derive(Debug, Clone)]
pub struct BoundCalculator<'a>(Program<'a>);

impl BoundCalculator<'_> {
    /// The number for the point at this position of the columns; NaN if it is invalid.
    ///
    /// # Panics
    ///
    /// If a column ends before that position.
    #[inline]
    pub fn value(&self, point: usize) -> f64 {
        self.0.value(point, point, &Pair::default())
    }
}
