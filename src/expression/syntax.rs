//! The grammar, and what is wrong with a text that is not of it.

use pest::Parser;
use pest::error::{ErrorVariant, InputLocation};
use pest::iterators::Pair;

use super::problem::{Kind, mistake};
use crate::error::{Error, Result};

/// In a module of its own, where the lints leave generated code alone.
mod grammar {
    #![allow(missing_docs, clippy::pedantic)]

    #[derive(pest_derive::Parser)]
    #[grammar = "expression/expression.pest"]
    pub(in super::super) struct Grammar;
}

use grammar::Grammar;
pub(super) use grammar::Rule;

/// A text may have so many characters.
const LONGEST: usize = 4096;

/// Brackets may be open in brackets, and values wait for the rest of a calculation, so many at a time.
pub(super) const DEEPEST: usize = 64;

/// The expression that the text is.
pub(super) fn read(kind: Kind, text: &str) -> Result<Pair<'_, Rule>> {
    check_size(kind, text)?;
    let whole = Grammar::parse(Rule::text, text).map_err(|error| explained(kind, text, &error))?.next();
    whole.ok_or_else(|| mistake(kind, text, 0, "there is nothing to read"))
}

/// Refuses what is too long, and what is nested too deeply for the parser, which is recursive.
fn check_size(kind: Kind, text: &str) -> Result<()> {
    if let Some((at, _)) = text.char_indices().nth(LONGEST) {
        return Err(mistake(kind, text, at, format!("the text is too long, allowed: {LONGEST} characters")));
    }
    let mut brackets = Brackets::default();
    for (at, c) in text.char_indices() {
        brackets.pass(c);
        if brackets.open.len() > DEEPEST {
            return Err(mistake(kind, text, at, format!("brackets are nested too deeply, allowed: {DEEPEST} levels")));
        }
    }
    Ok(())
}

/// Says what was found where the grammar came to its end, and what may stand there.
fn explained(kind: Kind, text: &str, error: &pest::error::Error<Rule>) -> Error {
    let (InputLocation::Pos(at) | InputLocation::Span((at, _))) = error.location;
    let rest = &text[at..];
    let found = match rest.chars().next() {
        None if text.trim().is_empty() => "the text is empty".to_owned(),
        None => "the text ends here".to_owned(),
        Some(c) if c.is_alphanumeric() || c == '_' => {
            let word: String = rest.chars().take_while(|&c| c.is_alphanumeric() || c == '_').take(20).collect();
            format!("found '{word}'")
        }
        Some(c) => format!("found '{}'", c.escape_debug()),
    };
    let expected = match &error.variant {
        ErrorVariant::ParsingError { positives, .. } => expected(text, positives, at),
        ErrorVariant::CustomError { message } => message.clone(),
    };
    mistake(kind, text, at, format!("{found}, {expected}"))
}

fn expected(text: &str, rules: &[Rule], at: usize) -> String {
    let mut allowed: Vec<&str> = rules.iter().filter_map(|&rule| description(rule)).collect();
    allowed.sort_unstable();
    allowed.dedup();
    if allowed.contains(&VALUE) {
        allowed.retain(|&text| text != NAME && text != "a number");
    }
    let hint = match text[at..].chars().next() {
        Some('[') => "; square brackets follow n, Generic, Region and Class, or stand around the name of an attribute",
        Some('&') => "; 'and' is written and or &&",
        Some('|') => "; 'or' is written or or ||",
        Some('<' | '>' | '=') => "; comparisons are written < <= > >= == !=",
        Some('*') => "; a power is written ^",
        Some('.') => "; an attribute of the neighbor is written n[0].Z",
        Some(',') => "; the decimal sign is a point, and commas stand only between what a function is given",
        _ => "",
    };
    let mut brackets = Brackets::default();
    text[..at].chars().for_each(|c| brackets.pass(c));
    if allowed != [VALUE] && allowed != [NAME] {
        allowed.extend(brackets.closing());
    }
    format!("allowed here: {}{hint}", allowed.join(", "))
}

/// Which brackets are open. One that does not match closes nothing, so these are never fewer than the parser finds.
#[derive(Default)]
struct Brackets {
    open: Vec<char>,
}

impl Brackets {
    fn pass(&mut self, c: char) {
        match c {
            '(' | '[' | '?' => self.open.push(c),
            ')' => drop(self.open.pop_if(|open| *open == '(')),
            ']' => drop(self.open.pop_if(|open| *open == '[')),
            ':' => drop(self.open.pop_if(|open| *open == '?')),
            _ => {}
        }
    }

    /// What closes the last one.
    fn closing(&self) -> Option<&'static str> {
        self.open.last().map(|open| match open {
            '(' => "')'",
            '[' => "']'",
            _ => "':'",
        })
    }
}

const VALUE: &str = "a value such as 1.5, Z or abs(Z)";
const NAME: &str = "the name of an attribute";

/// What a rule of the grammar is called in messages.
fn description(rule: Rule) -> Option<&'static str> {
    Some(match rule {
        Rule::EOI => "the end",
        Rule::expression | Rule::attribute => VALUE,
        Rule::name | Rule::quoted_name => NAME,
        Rule::number => "a number",
        Rule::coordinate => "a coordinate",
        Rule::class_name => "a class",
        Rule::index => "0",
        Rule::dot => "'.'",
        Rule::add | Rule::or | Rule::and | Rule::choose => "an operator such as + < and",
        _ => return None,
    })
}
