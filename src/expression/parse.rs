//! From a text to a tree: order of operators, types, names.

use pest::iterators::{Pair, Pairs};

use super::operation::{FUNCTIONS, Operation, Type};
use super::problem::{Kind, mistake, suggestion};
use super::program;
use super::region::Region;
use super::syntax::{self, DEEPEST, Rule};
use super::tree::{Classes, Node, NodeId, PairVariable, Side, Tree, arity};
use crate::error::{Error, Result};

/// The classes of LAS 1.4.
const CLASSES: &[(&str, u8)] = &[
    ("Created", 0),
    ("Unclassified", 1),
    ("Ground", 2),
    ("LowVegetation", 3),
    ("MediumVegetation", 4),
    ("HighVegetation", 5),
    ("Building", 6),
    ("LowNoise", 7),
    ("Water", 9),
    ("Rail", 10),
    ("RoadSurface", 11),
    ("WireGuard", 13),
    ("WireConductor", 14),
    ("TransmissionTower", 15),
    ("WireConnector", 16),
    ("BridgeDeck", 17),
    ("HighNoise", 18),
];

/// Words that stand for themselves and not for an attribute.
const WORDS: &[&str] = &["true", "false", "invalid", "pi"];

const PAIR_VARIABLES: &[(&str, PairVariable)] = &[
    ("dist", PairVariable::Dist),
    ("dist2d", PairVariable::Dist2d),
    ("dz", PairVariable::Dz),
    ("angle", PairVariable::Angle),
];

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

struct Reader<'t> {
    kind: Kind,
    text: &'t str,
    tree: Tree,
}

/// A value and where it is written.
#[derive(Debug, Clone, Copy)]
struct Operand {
    node: NodeId,
    start: usize,
    end: usize,
}

/// An operator that waits for what is on its right.
struct Waiting {
    operation: Option<Operation>,
    precedence: u8,
    /// The middle of a choice.
    middle: Option<Operand>,
    start: usize,
}

/// How tightly an operator binds.
fn precedence(rule: Rule) -> u8 {
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
fn is_done_from_the_right(rule: Rule) -> bool {
    matches!(rule, Rule::choose | Rule::power)
}

fn operation(rule: Rule) -> Option<Operation> {
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

impl Reader<'_> {
    fn mistake(&self, at: usize, problem: impl std::fmt::Display) -> Error {
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
    fn expression(&mut self, pairs: Pairs<Rule>) -> Result<Operand> {
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

    fn expression_in(&mut self, pair: Pair<Rule>) -> Result<Operand> {
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

    fn expect(&self, wanted: Type, operand: Operand, by: &str) -> Result<()> {
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

    fn operand(&mut self, pair: Pair<Rule>) -> Result<Operand> {
        let span = pair.as_span();
        let (start, end) = (span.start(), span.end());
        let node = match pair.as_rule() {
            Rule::number => {
                let value = self.number(&pair)?;
                self.tree.push(Node::Number(value))
            }
            Rule::group => self.expression_in(pair)?.node,
            Rule::generic => self.generic(pair)?,
            Rule::call => self.call(pair)?,
            Rule::region => self.region(pair)?,
            Rule::class => self.class(pair)?,
            _ => self.attribute(pair)?,
        };
        Ok(Operand { node, start, end })
    }

    fn number(&self, pair: &Pair<Rule>) -> Result<f64> {
        match pair.as_str().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            _ => Err(self.mistake(pair.as_span().start(), "the number is too large, allowed: up to 1.7e308")),
        }
    }

    /// `Generic[…]` is a bracket; of an attribute alone it asks for its presence.
    fn generic(&mut self, pair: Pair<Rule>) -> Result<NodeId> {
        let inner = self.expression_in(pair)?;
        if matches!(self.tree.nodes[inner.node], Node::Attribute(..)) {
            return Ok(self.tree.apply(Operation::Valid, vec![inner.node]));
        }
        self.expect(Type::Truth, inner, "Generic[…]")?;
        Ok(inner.node)
    }

    fn call(&mut self, pair: Pair<Rule>) -> Result<NodeId> {
        let (start, end) = (pair.as_span().start(), pair.as_span().end());
        let mut inner = pair.into_inner();
        let name = inner.next().map_or("", |name| name.as_str());
        let operands: Vec<Operand> =
            inner.map(|operand| self.expression(operand.into_inner())).collect::<Result<_>>()?;
        let lower = name.to_ascii_lowercase();
        let function = FUNCTIONS.iter().find(|function| function.name == lower);
        let constant = match lower.as_str() {
            "nan" => Some(f64::NAN),
            "lowest" => Some(f64::MIN),
            "highest" => Some(f64::MAX),
            _ => None,
        };
        let (least, most, takes) = match (lower.as_str(), function) {
            ("valid" | "invalid", _) => (1, Some(1), "one number"),
            (_, Some(function)) => arity(function.compute),
            _ if constant.is_some() => (0, Some(0), "nothing"),
            _ => {
                let own = ["valid", "invalid", "nan", "lowest", "highest"];
                let known = FUNCTIONS.iter().map(|function| function.name).chain(own);
                return Err(self.mistake(start, format!("there is no function '{name}'{}", suggestion(name, known))));
            }
        };
        if operands.len() < least || most.is_some_and(|most| operands.len() > most) {
            let at = end - 1;
            return Err(self.mistake(at, format!("{name}() takes {takes}, {} given", operands.len())));
        }
        for &operand in &operands {
            self.expect(Type::Number, operand, &format!("{name}()"))?;
        }
        let nodes: Vec<NodeId> = operands.iter().map(|operand| operand.node).collect();
        Ok(match (constant, function) {
            (Some(value), _) => self.tree.push(Node::Number(value)),
            (None, Some(function)) => self.tree.apply(Operation::Function(function), nodes),
            (None, None) => {
                let valid = self.tree.apply(Operation::Valid, nodes);
                if lower == "valid" { valid } else { self.tree.apply(Operation::Not, vec![valid]) }
            }
        })
    }

    fn region(&mut self, pair: Pair<Rule>) -> Result<NodeId> {
        let (start, end) = (pair.as_span().start(), pair.as_span().end());
        let mut side = Side::Point;
        let mut coordinates = Vec::new();
        for part in pair.into_inner() {
            match part.as_rule() {
                Rule::neighbor => side = self.neighbor(&part)?,
                _ => coordinates.push(self.number(&part)?),
            }
        }
        if coordinates.len() % 2 == 1 {
            let count = coordinates.len();
            return Err(
                self.mistake(end - 1, format!("a region has an x and a y for each corner, {count} numbers given"))
            );
        }
        if coordinates.len() < 6 {
            let corners = coordinates.len() / 2;
            return Err(self.mistake(end - 1, format!("a region has at least 3 corners, {corners} given")));
        }
        for name in ["X", "Y"] {
            self.tree.attribute(name, start);
        }
        let region = self.tree.region(Region::new(&coordinates));
        Ok(self.tree.push(Node::Inside(side, region)))
    }

    fn class(&mut self, pair: Pair<Rule>) -> Result<NodeId> {
        let start = pair.as_span().start();
        let mut side = Side::Point;
        let mut classes: Classes = [0; 4];
        for part in pair.into_inner() {
            if part.as_rule() == Rule::neighbor {
                side = self.neighbor(&part)?;
                continue;
            }
            let name = part.as_str();
            let known = CLASSES.iter().find(|known| known.0.eq_ignore_ascii_case(name)).map(|known| known.1);
            let Some(class) = known.or_else(|| name.parse().ok()) else {
                let names = CLASSES.iter().map(|known| known.0);
                let problem =
                    format!("there is no class '{name}'{}, or a number from 0 to 255", suggestion(name, names));
                return Err(self.mistake(part.as_span().start(), problem));
            };
            classes[usize::from(class / 64)] |= 1 << (class % 64);
        }
        self.tree.attribute("Classification", start);
        Ok(self.tree.push(Node::Class(side, classes)))
    }

    /// `n[0].`, which only a criterion knows.
    fn neighbor(&self, pair: &Pair<Rule>) -> Result<Side> {
        let at = pair.as_span().start();
        let index = pair.clone().into_inner().next();
        if let Some(index) = index.filter(|index| index.as_str() != "0") {
            let problem =
                format!("a point is compared with one neighbor at a time, n[0]; n[{}] is not known", index.as_str());
            return Err(self.mistake(at, problem));
        }
        match self.kind {
            Kind::Criterion => Ok(Side::Neighbor),
            kind => Err(self.mistake(
                at,
                format!("a {kind} looks at one point alone, so there is no neighbor n[0]; only a criterion has one"),
            )),
        }
    }

    fn attribute(&mut self, pair: Pair<Rule>) -> Result<NodeId> {
        let mut parts = pair.into_inner();
        let first = parts.next();
        let (side, name) = match first {
            Some(part) if part.as_rule() == Rule::neighbor => (self.neighbor(&part)?, parts.next()),
            other => (Side::Point, other),
        };
        let Some(name) = name else { return Err(self.mistake(0, "an attribute is missing")) };
        let at = name.as_span().start();
        if name.as_rule() == Rule::quoted {
            let unquoted = name.into_inner().next().map_or("", |inner| inner.as_str().trim());
            let position = self.tree.attribute(unquoted, at);
            return Ok(self.tree.push(Node::Attribute(side, position)));
        }
        let name = name.as_str();
        if side == Side::Point
            && let Some(node) = self.word(name, at)?
        {
            return Ok(self.tree.push(node));
        }
        let position = self.tree.attribute(name, at);
        Ok(self.tree.push(Node::Attribute(side, position)))
    }

    /// A name that stands for a constant or for something that two points have in common.
    fn word(&mut self, name: &str, at: usize) -> Result<Option<Node>> {
        if let Some(&(known, variable)) = PAIR_VARIABLES.iter().find(|known| known.0.eq_ignore_ascii_case(name)) {
            if self.kind != Kind::Criterion {
                let problem = format!(
                    "'{known}' is between two points, which only a criterion has; write [{name}] for an attribute of this name"
                );
                return Err(self.mistake(at, problem));
            }
            if variable == PairVariable::Angle {
                for normal in ["NormalX", "NormalY", "NormalZ"] {
                    self.tree.attribute(normal, at);
                }
            }
            return Ok(Some(Node::Pair(variable)));
        }
        let word = WORDS.iter().find(|word| word.eq_ignore_ascii_case(name));
        Ok(word.map(|&word| match word {
            "true" => Node::Truth(true),
            "false" => Node::Truth(false),
            "pi" => Node::Number(std::f64::consts::PI),
            _ => Node::Number(f64::NAN),
        }))
    }
}
