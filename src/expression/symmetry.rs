//! Whether a criterion is the same from either end: P(p, n) = P(n, p).
//!
//! Both are brought to a normal form in which the order of sums, products, `and`, `or` and the like does not count, nor
//! the sign below an even function. Equal forms are equal criteria. If the forms differ, numbers are tried out: a pair
//! for which the two differ is an example; without one nothing is known.
//!
//! The forms are those of real numbers. Where two forms are equal, computed values may still differ by rounding.

use super::counterexample::counterexample;
use super::normal_form::Forms;
use super::tree::Tree;

/// Whether a criterion is the same from either end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Symmetry {
    /// It is. Rounding apart: whoever needs the same answer to the last bit asks with the smaller point id first.
    Proven,
    /// It is not.
    Disproven {
        /// Attributes with which it holds one way and not the other, for people.
        example: String,
    },
    /// No proof and no counterexample was found.
    Unknown,
}

impl Symmetry {
    pub(super) fn of(tree: &Tree) -> Symmetry {
        let mut forms = Forms::default();
        let forward = forms.of_tree(tree, false);
        let backward = forms.of_tree(tree, true);
        if forward.is_some() && forward == backward {
            return Symmetry::Proven;
        }
        counterexample(tree).map_or(Symmetry::Unknown, |example| Symmetry::Disproven { example })
    }
}
