//! What is wrong with a text, told so that people can mend it: which column, what is there, what may be there.

use std::fmt::{self, Display};

use strsim::damerau_levenshtein;

use crate::error::Error;

/// What a text is used as, in the words of the messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Criterion,
    Filter,
    Calculator,
}

impl Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Kind::Criterion => "criterion",
            Kind::Filter => "filter",
            Kind::Calculator => "calculator",
        })
    }
}

/// As much of a text is shown on either side of a mistake.
const SHOWN: usize = 50;

/// A mistake at this byte of the text: the problem, the text around it, and a caret below the place.
pub(super) fn mistake(kind: Kind, text: &str, at: usize, problem: impl Display) -> Error {
    let column = text[..at].chars().count();
    let start = column.saturating_sub(SHOWN);
    let excerpt: String =
        text.chars().skip(start).take(2 * SHOWN).map(|c| if c.is_control() { ' ' } else { c }).collect();
    let before = if start > 0 { "…" } else { "" };
    let after = if text.chars().nth(start + 2 * SHOWN).is_some() { "…" } else { "" };
    let indent = " ".repeat(before.chars().count() + column - start);
    Error::Expression {
        kind: kind.to_string(),
        column: column + 1,
        problem: problem.to_string(),
        picture: format!("  {before}{excerpt}{after}\n  {indent}^"),
    }
}

/// Says what a name could have meant and what names there are.
pub(super) fn suggestion<'a>(name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let distance = |known: &str| damerau_levenshtein(&name.to_lowercase(), &known.to_lowercase());
    let near = known.clone().min_by_key(|known| distance(known)).filter(|near| 3 * distance(near) <= near.len() + 2);
    let near = near.map(|near| format!(", did you mean '{near}'?")).unwrap_or_default();
    let list = known.collect::<Vec<_>>().join(", ");
    format!("{near}; there are: {}", if list.is_empty() { "none" } else { &list })
}
