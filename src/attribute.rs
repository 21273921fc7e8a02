//! Attributes of points beside their position: columns of numbers, found by name.
//!
//! Names are those of LAS dimensions and of computed features. Case and underscores do not matter: `ReturnNumber` is
//! `return_number`. A value that is missing is NaN.

/// Whether two names mean the same attribute.
pub fn is_same_name(a: &str, b: &str) -> bool {
    letters(a).eq(letters(b))
}

fn letters(name: &str) -> impl Iterator<Item = u8> {
    name.bytes().filter(|byte| *byte != b'_').map(|byte| byte.to_ascii_lowercase())
}

/// Columns of attributes, one value per point each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Columns {
    columns: Vec<(String, Vec<f64>)>,
}

impl Columns {
    /// Adds a column, or replaces the one of the same name.
    pub fn set(&mut self, name: &str, values: Vec<f64>) {
        match self.columns.iter_mut().find(|(other, _)| is_same_name(other, name)) {
            Some((_, column)) => *column = values,
            None => self.columns.push((name.to_string(), values)),
        }
    }

    /// The values of the attribute of this name.
    pub fn get(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|(other, _)| is_same_name(other, name)).map(|(_, values)| values.as_slice())
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
    fn names_are_the_same_whatever_their_case_and_underscores() {
        let mut columns = Columns::default();
        columns.set("return_number", vec![1.0, 2.0, 3.0]);
        columns.set("Intensity", vec![7.0; 3]);
        columns.set("INTENSITY", vec![8.0, 9.0, 10.0]);
        assert_eq!(columns.get("ReturnNumber"), Some(&[1.0, 2.0, 3.0][..]));
        assert_eq!(columns.select(&[2, 0]).get("intensity"), Some(&[10.0, 8.0][..]));
        assert_eq!(columns.get("Intens"), None);
        assert_eq!(columns.names().collect::<Vec<_>>(), ["return_number", "Intensity"]);
    }
}
