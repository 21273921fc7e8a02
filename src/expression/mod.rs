//! The criterion language.

use crate::error::Result;

/// Which points take part.
#[derive(Debug, Clone, PartialEq)]
pub struct Filter;

/// A filter over columns.
pub struct BoundFilter<'a>(std::marker::PhantomData<&'a ()>);

impl Filter {
    /// Reads a filter.
    ///
    /// # Errors
    /// If it is none.
    pub fn parse(_: &str) -> Result<Self> {
        Ok(Self)
    }

    /// The text it was read from.
    pub fn text(&self) -> &str {
        ""
    }

    /// The attributes that it names.
    pub fn attributes(&self) -> impl Iterator<Item = &str> {
        std::iter::empty()
    }

    /// Looks its attributes up.
    ///
    /// # Errors
    /// If there is one that is not there.
    pub fn bind<'a>(&self, _: impl Fn(&str) -> Option<&'a [f64]>) -> Result<BoundFilter<'a>> {
        Ok(BoundFilter(std::marker::PhantomData))
    }
}

impl BoundFilter<'_> {
    /// Whether the point takes part.
    pub fn holds(&self, _: usize) -> bool {
        true
    }
}
