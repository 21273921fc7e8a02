//! Attributes of points beside their position: columns of numbers, found by name.
//!
//! Names are those of LAS dimensions and of computed features. Case and underscores do not matter: `ReturnNumber` is
//! `return_number`. A value that is missing is NaN.

use crate::error::{Error, Result};

/// Other names of the same, in letters: LAS calls some dimensions differently from format to format, and normals have
/// short names.
const SYNONYMS: [(&str, &str); 6] = [
    ("scananglerank", "scanangle"),
    ("scanchannel", "scannerchannel"),
    ("infrared", "nir"),
    ("nx", "normalx"),
    ("ny", "normaly"),
    ("nz", "normalz"),
];

/// How alike two names of the same attribute are, the most alike first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Likeness {
    /// Letter by letter.
    Exact,
    /// But for case, underscores and blanks.
    Letters,
    /// Two words for one thing.
    Synonym,
}

/// Whether two names mean the same attribute.
pub fn is_same_name(a: &str, b: &str) -> bool {
    likeness(a, b).is_some()
}

/// How alike two names are, if they can mean the same attribute.
pub fn likeness(a: &str, b: &str) -> Option<Likeness> {
    if a == b {
        Some(Likeness::Exact)
    } else if letters(a).eq(letters(b)) {
        Some(Likeness::Letters)
    } else {
        word(a).eq(word(b)).then_some(Likeness::Synonym)
    }
}

/// The one of `names` that is meant by `name`: the most alike.
///
/// # Errors
/// If two are equally alike.
pub fn meant<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Result<Option<&'a str>> {
    let mut best: Option<(Likeness, &'a str)> = None;
    let mut rival = None;
    for other in names {
        let Some(likeness) = likeness(name, other) else { continue };
        match best {
            Some((so_far, known)) if so_far == likeness && known != other => rival = Some(other),
            Some((so_far, _)) if so_far <= likeness => {}
            _ => (best, rival) = (Some((likeness, other)), None),
        }
    }
    match (best, rival) {
        (Some((_, first)), Some(second)) => {
            Err(Error::AmbiguousAttribute { name: name.into(), first: first.into(), second: second.into() })
        }
        (best, _) => Ok(best.map(|(_, name)| name)),
    }
}

fn letters(name: &str) -> impl Iterator<Item = u8> + '_ {
    name.bytes().filter(|byte| !matches!(byte, b'_' | b' ')).map(|byte| byte.to_ascii_lowercase())
}

/// The letters of a name, or those of its synonym.
fn word(name: &str) -> impl Iterator<Item = u8> + '_ {
    let synonym = SYNONYMS.iter().find(|(other, _)| letters(name).eq(other.bytes()));
    letters(synonym.map_or(name, |(_, usual)| *usual))
}

/// Columns of attributes, one value per point each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    columns: Vec<(String, Vec<f64>)>,
}

impl Columns {
    /// Adds a column, or replaces the one of exactly this name.
    pub fn set(&mut self, name: &str, values: Vec<f64>) {
        match self.columns.iter_mut().find(|(other, _)| other == name) {
            Some((_, column)) => *column = values,
            None => self.columns.push((name.to_string(), values)),
        }
    }

    /// The values of the attribute whose name is the most like this one.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        let alike = self.columns.iter().filter_map(|(other, values)| Some((likeness(name, other)?, values)));
        alike.min_by_key(|(likeness, _)| *likeness).map(|(_, values)| values.as_slice())
    }

    /// The names there are.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().map(|(name, _)| name.as_str())
    }

    /// The values of the points at `positions` only.
    #[must_use]
    pub fn select(&self, positions: &[u32]) -> Self {
        let select = |values: &Vec<f64>| positions.iter().map(|&i| values[i as usize]).collect();
        Self { columns: self.columns.iter().map(|(name, values)| (name.clone(), select(values))).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_the_same_whatever_their_case_underscores_and_blanks() {
        let mut columns = Columns::default();
        columns.set("return_number", vec![1.0, 2.0, 3.0]);
        columns.set("Intensity", vec![7.0; 3]);
        columns.set("Intensity", vec![8.0, 9.0, 10.0]);
        columns.set("normal x", vec![0.0; 3]);
        assert_eq!(columns.get("ReturnNumber"), Some(&[1.0, 2.0, 3.0][..]));
        assert_eq!(columns.select(&[2, 0]).get("intensity"), Some(&[10.0, 8.0][..]));
        assert_eq!(columns.get("NormalX"), Some(&[0.0; 3][..]));
        assert_eq!(columns.get("Intens"), None);
        assert_eq!(columns.names().collect::<Vec<_>>(), ["return_number", "Intensity", "normal x"]);
    }

    #[test]
    fn of_columns_with_like_names_the_most_like_one_is_found() {
        let mut columns = Columns::default();
        for (value, name) in [(1.0, "nx"), (2.0, "normal_x"), (3.0, "NormalX"), (4.0, "scan_angle_rank")] {
            columns.set(name, vec![value]);
        }
        let of = |name| columns.get(name).map(|values| values[0]);
        assert_eq!([of("nx"), of("normal_x"), of("NormalX")], [Some(1.0), Some(2.0), Some(3.0)]);
        assert_eq!([of("NX"), of("ScanAngle")], [Some(1.0), Some(4.0)]);
    }

    #[test]
    fn exact_spelling_wins_and_two_equally_alike_are_refused() {
        let meant = |name: &str, names: &[&'static str]| meant(name, names.iter().copied()).map_err(|e| e.to_string());
        assert_eq!(meant("height", &["Height", "height"]), Ok(Some("height")));
        assert_eq!(meant("HEIGHT", &["height", "other"]), Ok(Some("height")));
        assert_eq!(meant("NormalX", &["nx", "normal x"]), Ok(Some("normal x")));
        assert_eq!(meant("nX", &["nx", "normal x", "NormalX"]), Ok(Some("nx")));
        assert_eq!(meant("nothing", &["nx"]), Ok(None));
        let told = meant("HEIGHT", &["Height", "height"]).unwrap_err();
        assert!(told.contains("'Height'") && told.contains("'height'"), "{told}");
    }
}
