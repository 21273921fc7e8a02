//! The criterion language.
