//! Which operators there are, and how tightly each of them binds.

use super::operation::Operation;
use super::syntax::Rule;

/// How tightly an operator binds.
pub(super) fn precedence(rule: Rule) -> u8 {
    match rule {
        Rule::choose => 1,
        Rule::or => 2,
        Rule::and => 3,
        Rule::not => 4,
        Rule::equal | Rule::not_equal => 5,
        Rule::less | Rule::less_equal | Rule::greater | Rule::greater_equal => 6,
        Rule::add | Rule::subtract => 7,
        Rule::multiply | Rule::divide | Rule::remainder => 8,
        Rule::minus | Rule::plus => 9,
        _ => 10,
    }
}

/// Of two such operators in a row the right one is done first.
pub(super) fn is_done_from_the_right(rule: Rule) -> bool {
    matches!(rule, Rule::choose | Rule::power)
}

pub(super) fn operation(rule: Rule) -> Option<Operation> {
    Some(match rule {
        Rule::choose => Operation::Choose,
        Rule::or => Operation::Or,
        Rule::and => Operation::And,
        Rule::not => Operation::Not,
        Rule::equal => Operation::Equal,
        Rule::not_equal => Operation::NotEqual,
        Rule::less => Operation::Less,
        Rule::less_equal => Operation::LessEqual,
        Rule::greater => Operation::Greater,
        Rule::greater_equal => Operation::GreaterEqual,
        Rule::add => Operation::Add,
        Rule::subtract => Operation::Subtract,
        Rule::multiply => Operation::Multiply,
        Rule::divide => Operation::Divide,
        Rule::remainder => Operation::Remainder,
        Rule::minus => Operation::Minus,
        Rule::power => Operation::Power,
        _ => return None,
    })
}
