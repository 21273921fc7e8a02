//! What operators stand between: numbers, names, calls, classes, regions.

use pest::iterators::Pair;

use super::operation::{FUNCTIONS, Operation, Type};
use super::parse::{Operand, Reader};
use super::problem::{Kind, suggestion};
use super::region::Region;
use super::syntax::Rule;
use super::tree::{Classes, Node, NodeId, PairVariable, Side, arity};
use crate::error::Result;

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

impl Reader<'_> {
    pub(super) fn operand(&mut self, pair: Pair<Rule>) -> Result<Operand> {
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
