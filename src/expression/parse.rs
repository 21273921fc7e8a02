//! From a text to a tree: the order of operators, and types. What operators stand between is read by [operands](super::operands).

use pest::iterators::{Pair, Pairs};

use super::operation::{Operation, Type};
use super::precedence::{is_done_from_the_right, operation, precedence};
use super::problem::{Kind, mistake};
use super::program;
use super::syntax::{self, DEEPEST, Rule};
use super::tree::{Node, NodeId, Tree};
use crate::error::{Error, Result};

/// Reads a text: syntax, types, and whether it may be used as this kind of expression.
pub(super) fn parse(kind: Kind, text: &str) -> Result<Tree> {
    let whole = syntax::read(kind, text)?;
    let mut reader = Reader { kind, text, tree: Tree::default() };
    let root = reader.expression(whole.into_inner())?;
    reader.tree.root = reader.rooted(root)?;
    if program::depth(&reader.tree) > DEEPEST {
        let problem = format!("too many values wait for each other, allowed: {DEEPEST}; put what is nested most first");
        return Err(reader.mistake(root.start, problem));
    }
    Ok(reader.tree)
}

/// Reads one text.
pub(super) struct Reader<'t> {
    pub kind: Kind,
    text: &'t str,
    pub tree: Tree,
}

/// A value and where it is written.
#[derive(Debug, Clone, Copy)]
pub(super) struct Operand {
    pub node: NodeId,
    pub start: usize,
    pub end: usize,
}

/// An operator that waits for what is on its right.
struct Waiting {
    operation: Option<Operation>,
    precedence: u8,
    /// The middle of a choice.
    middle: Option<Operand>,
    start: usize,
}

impl Reader<'_> {
    pub fn mistake(&self, at: usize, problem: impl std::fmt::Display) -> Error {
        mistake(self.kind, self.text, at, problem)
    }

    fn written(&self, operand: Operand) -> &str {
        &self.text[operand.start..operand.end]
    }

    /// The whole has to be true or false, or a number, as its kind demands.
    fn rooted(&mut self, root: Operand) -> Result<NodeId> {
        let text = self.text.trim();
        match (self.kind, self.tree.type_of(root.node)) {
            (Kind::Calculator, Type::Truth) => Err(self.mistake(
                root.start,
                format!("a calculator has to give a number, but this is true or false; write ({text}) ? 1 : invalid"),
            )),
            (Kind::Filter, Type::Number) if matches!(self.tree.nodes[root.node], Node::Attribute(..)) => {
                Ok(self.tree.apply(Operation::Valid, vec![root.node]))
            }
            (Kind::Criterion | Kind::Filter, Type::Number) => Err(self.mistake(
                root.start,
                format!(
                    "a {} has to be true or false, but this is a number; compare it, as in ({text}) > 0",
                    self.kind
                ),
            )),
            _ => Ok(root.node),
        }
    }

    /// Puts a flat list of operands and operators in order: an operator waits until one comes that binds less tightly.
    pub fn expression(&mut self, pairs: Pairs<Rule>) -> Result<Operand> {
        let mut operands = Vec::new();
        let mut waiting: Vec<Waiting> = Vec::new();
        for pair in pairs {
            let (rule, start) = (pair.as_rule(), pair.as_span().start());
            let precedence = precedence(rule);
            match rule {
                Rule::not | Rule::minus | Rule::plus => {
                    waiting.push(Waiting { operation: operation(rule), precedence, middle: None, start });
                }
                _ if operation(rule).is_some() => {
                    let least = precedence + u8::from(is_done_from_the_right(rule));
                    while let Some(operator) = waiting.pop_if(|operator| operator.precedence >= least) {
                        self.operate(&operator, &mut operands)?;
                    }
                    let middle = if rule == Rule::choose { Some(self.expression_in(pair)?) } else { None };
                    waiting.push(Waiting { operation: operation(rule), precedence, middle, start });
                }
                _ => operands.push(self.operand(pair)?),
            }
        }
        while let Some(operator) = waiting.pop() {
            self.operate(&operator, &mut operands)?;
        }
        operands.pop().ok_or_else(|| self.mistake(0, "a value is missing"))
    }

    pub fn expression_in(&mut self, pair: Pair<Rule>) -> Result<Operand> {
        let end = pair.as_span().end();
        match pair.into_inner().find(|inner| inner.as_rule() == Rule::expression) {
            Some(inner) => self.expression(inner.into_inner()),
            None => Err(self.mistake(end, "a value is missing")),
        }
    }

    /// Takes an operator's operands off the list and puts the result there.
    fn operate(&mut self, operator: &Waiting, operands: &mut Vec<Operand>) -> Result<()> {
        let missing = || self.mistake(operator.start, "a value is missing");
        let right = operands.pop().ok_or_else(missing)?;
        let Some(operation) = operator.operation else {
            self.expect(Type::Number, right, "+")?;
            operands.push(Operand { start: operator.start, ..right });
            return Ok(());
        };
        if matches!(operation, Operation::Minus | Operation::Not) {
            self.expect(operation.operands(), right, self.symbol(operator))?;
            let node = self.tree.apply(operation, vec![right.node]);
            operands.push(Operand { node, start: operator.start, end: right.end });
            return Ok(());
        }
        let left = operands.pop().ok_or_else(missing)?;
        let node = match operator.middle {
            Some(middle) => self.choose(left, middle, right)?,
            None => self.binary(operation, left, right, operator)?,
        };
        operands.push(Operand { node, start: left.start, end: right.end });
        Ok(())
    }

    fn choose(&mut self, condition: Operand, yes: Operand, no: Operand) -> Result<NodeId> {
        self.expect(Type::Truth, condition, "?")?;
        if self.tree.type_of(yes.node) != self.tree.type_of(no.node) {
            let problem = "of the two values of ? : one is a number and one is true or false; both have to be the same";
            return Err(self.mistake(no.start, problem));
        }
        Ok(self.tree.apply(Operation::Choose, vec![condition.node, yes.node, no.node]))
    }

    fn binary(&mut self, operation: Operation, left: Operand, right: Operand, at: &Waiting) -> Result<NodeId> {
        let operands = vec![left.node, right.node];
        let are_truths = [left, right].map(|operand| self.tree.type_of(operand.node) == Type::Truth);
        let operation = match operation {
            Operation::Equal if are_truths == [true; 2] => Operation::Same,
            Operation::NotEqual if are_truths == [true; 2] => Operation::Different,
            _ => operation,
        };
        let symbol = self.symbol(at);
        self.expect(operation.operands(), left, symbol)?;
        self.expect(operation.operands(), right, symbol)?;
        if matches!(operation, Operation::Divide | Operation::Remainder)
            && matches!(self.tree.nodes[right.node], Node::Number(0.0))
        {
            return Err(self.mistake(right.start, "a division by 0 has no result, allowed: any other number"));
        }
        Ok(self.tree.apply(operation, operands))
    }

    /// The operator as it is written.
    fn symbol(&self, operator: &Waiting) -> &str {
        let rest = &self.text[operator.start..];
        let is_word = rest.starts_with(char::is_alphabetic);
        let end = rest.find(|c: char| if is_word { !c.is_alphabetic() } else { !"<>=!&|+-*/%^?".contains(c) });
        let symbol = &rest[..end.unwrap_or(rest.len())];
        if is_word { symbol } else { &symbol[..symbol.len().min(2)] }
    }

    pub fn expect(&self, wanted: Type, operand: Operand, by: &str) -> Result<()> {
        let given = self.tree.type_of(operand.node);
        if given == wanted {
            return Ok(());
        }
        let written = self.written(operand);
        let problem = match given {
            Type::Truth if by.starts_with(['<', '>', '=', '!']) => {
                format!("'{by}' needs a number, but '{written}' is true or false; join comparisons with 'and'")
            }
            Type::Number => format!("'{by}' needs true or false, but '{written}' is a number; write {written} != 0"),
            Type::Truth => {
                format!("'{by}' needs a number, but '{written}' is true or false; write ({written} ? 1 : 0)")
            }
        };
        Err(self.mistake(operand.start, problem))
    }
}
