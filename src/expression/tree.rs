//! What a text means: a tree of operations, checked for types, constants computed.
//!
//! The nodes lie in one list, operands before operations, so that everything that is done with a tree is a loop over
//! the list and no text can exhaust the stack.

use super::operation::{Compute, Kernel, Operation, Type};
use super::region::Region;

/// Whose attribute: the point's, or its neighbor's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Side {
    Point,
    Neighbor,
}

/// What two points have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum PairVariable {
    Dist,
    Dist2d,
    Dz,
    Angle,
}

/// Classes 0 to 255, one bit each.
pub(super) type Classes = [u64; 4];

/// Position of a node in the list.
pub(super) type NodeId = usize;

#[derive(Debug, Clone)]
pub(super) enum Node {
    Number(f64),
    Truth(bool),
    /// An attribute, by its position in `Tree::attributes`.
    Attribute(Side, usize),
    Pair(PairVariable),
    /// Whether the point lies in this region.
    Inside(Side, usize),
    /// Whether the point's class is one of these.
    Class(Side, Classes),
    Apply(Operation, Vec<NodeId>),
}

/// An attribute that the text names.
#[derive(Debug, Clone)]
pub(super) struct Attribute {
    /// As it is written where it comes first.
    pub name: String,
    /// The byte of the text where that is.
    pub at: usize,
    /// Another spelling that the text has of it, in other case, and where that is.
    pub respelled: Option<(String, usize)>,
}

#[derive(Debug, Clone, Default)]
pub(super) struct Tree {
    pub nodes: Vec<Node>,
    pub attributes: Vec<Attribute>,
    pub regions: Vec<Region>,
    pub root: NodeId,
}

impl Tree {
    /// The position of an attribute, which is noted if it is new. The case of letters does not matter.
    pub(super) fn attribute(&mut self, name: &str, at: usize) -> usize {
        let Some(position) = self.find(name) else {
            self.attributes.push(Attribute { name: name.to_owned(), at, respelled: None });
            return self.attributes.len() - 1;
        };
        let known = &mut self.attributes[position];
        if known.name != name && known.respelled.is_none() {
            known.respelled = Some((name.to_owned(), at));
        }
        position
    }

    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.attributes.iter().position(|known| known.name.eq_ignore_ascii_case(name))
    }

    /// The position of a region, which is noted if it is new.
    pub(super) fn region(&mut self, region: Region) -> usize {
        self.regions.iter().position(|known| *known == region).unwrap_or_else(|| {
            self.regions.push(region);
            self.regions.len() - 1
        })
    }

    pub(super) fn push(&mut self, node: Node) -> NodeId {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    pub(super) fn type_of(&self, id: NodeId) -> Type {
        match &self.nodes[id] {
            Node::Number(_) | Node::Attribute(..) | Node::Pair(_) => Type::Number,
            Node::Truth(_) | Node::Inside(..) | Node::Class(..) => Type::Truth,
            Node::Apply(operation, operands) => self.result(*operation, operands),
        }
    }

    fn result(&self, operation: Operation, operands: &[NodeId]) -> Type {
        use Operation as O;
        match operation {
            O::Minus | O::Add | O::Subtract | O::Multiply | O::Divide | O::Remainder | O::Power | O::Function(_) => {
                Type::Number
            }
            // A chain of choices is as deep as it is long, but its first branch is not.
            O::Choose => self.type_of(operands[1]),
            _ => Type::Truth,
        }
    }

    /// Applies an operation to operands of the right types, as far as possible now.
    pub(super) fn apply(&mut self, operation: Operation, operands: Vec<NodeId>) -> NodeId {
        if let Some(known) = self.shortened(operation, &operands) {
            return known;
        }
        match self.computed(operation, &operands) {
            Some(value) if self.result(operation, &operands) == Type::Truth => self.push(Node::Truth(value != 0.0)),
            Some(value) => self.push(Node::Number(value)),
            None => self.push(Node::Apply(operation, operands)),
        }
    }

    /// The operand that is the result whatever the others are, if one is.
    fn shortened(&self, operation: Operation, operands: &[NodeId]) -> Option<NodeId> {
        let known = |id: NodeId| if let Node::Truth(truth) = self.nodes[id] { Some(truth) } else { None };
        match (operation, operands) {
            (Operation::And, &[a, b]) => match (known(a), known(b)) {
                (Some(true), _) | (_, Some(false)) => Some(b),
                (_, Some(true)) | (Some(false), _) => Some(a),
                _ => None,
            },
            (Operation::Or, &[a, b]) => match (known(a), known(b)) {
                (Some(false), _) | (_, Some(true)) => Some(b),
                (_, Some(false)) | (Some(true), _) => Some(a),
                _ => None,
            },
            (Operation::Choose, &[condition, a, b]) => known(condition).map(|holds| if holds { a } else { b }),
            _ => None,
        }
    }

    /// The value, if all operands are constants.
    fn computed(&self, operation: Operation, operands: &[NodeId]) -> Option<f64> {
        let mut values = operands.iter().map(|&id| match self.nodes[id] {
            Node::Number(value) => Some(value),
            Node::Truth(truth) => Some(f64::from(u8::from(truth))),
            _ => None,
        });
        let first = values.next()??;
        match operation.kernel() {
            Kernel::One(compute) => Some(compute(first)),
            Kernel::Two(compute) => values.try_fold(first, |so_far, value| Some(compute(so_far, value?))),
            Kernel::Lazy => None,
        }
    }
}

/// How many operands a function takes, for the messages.
pub(super) fn arity(compute: Compute) -> (usize, Option<usize>, &'static str) {
    match compute {
        Compute::One(..) => (1, Some(1), "one number"),
        Compute::Two(_) => (2, Some(2), "two numbers"),
        Compute::Several(_) => (2, None, "two or more numbers"),
    }
}
