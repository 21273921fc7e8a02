//! A tree, bound to columns, as a flat list of steps over a small stack: no look-ups, no allocation, no recursion.

use super::operation::{Kernel, Operation, finite};
use super::region::Region;
use super::syntax::DEEPEST;
use super::tree::{Classes, Node, NodeId, PairVariable, Side, Tree};
use super::{Columns, Pair};

/// What is done next. The value at hand is the top of the stack.
#[derive(Debug, Clone)]
enum Step<'a> {
    Number(f64),
    Point(&'a [f64]),
    Neighbor(&'a [f64]),
    Dist,
    Dist2d,
    Dz,
    Angle(Box<[&'a [f64]; 3]>),
    Inside(Side, Box<(Region, [&'a [f64]; 2])>),
    Class(Side, Box<(Classes, &'a [f64])>),
    One(fn(f64) -> f64),
    /// Of the value below and the value at hand.
    Two(fn(f64, f64) -> f64),
    /// Of the value at hand and this one: in place of two steps where the right operand is that simple.
    TwoNumber(fn(f64, f64) -> f64, f64),
    TwoPoint(fn(f64, f64) -> f64, &'a [f64]),
    TwoNeighbor(fn(f64, f64) -> f64, &'a [f64]),
    /// Skips so many steps if the value at hand is true and stays the result; else drops it.
    OrElse(usize),
    /// Skips so many steps if the value at hand is false and stays the result; else drops it.
    AndThen(usize),
    /// Drops the value at hand and skips so many steps if it was false.
    SkipUnless(usize),
    Skip(usize),
}

/// The steps of a part of the tree, and how many values they keep at most.
struct Code<'a> {
    steps: Vec<Step<'a>>,
    depth: usize,
}

/// Most programs keep few values, and clearing a small stack is quicker.
const FEW: usize = 8;
/// A power of two above the deepest.
const MANY: usize = 2 * DEEPEST;

#[derive(Debug, Clone)]
pub(super) struct Program<'a> {
    steps: Vec<Step<'a>>,
    depth: usize,
}

/// How many values a tree's program keeps at the same time.
pub(super) fn depth(tree: &Tree) -> usize {
    Program::new(tree, &vec![&[][..]; tree.attributes.len()]).depth
}

impl<'a> Program<'a> {
    /// Writes the steps of each node behind those of its operands, which come before it.
    pub(super) fn new(tree: &Tree, columns: &Columns<'a>) -> Self {
        let mut codes: Vec<Code<'a>> = Vec::with_capacity(tree.nodes.len());
        for node in &tree.nodes {
            let code = match node {
                Node::Apply(operation, operands) => apply(*operation, operands, &mut codes),
                leaf => Code { steps: vec![leaf_step(leaf, tree, columns)], depth: 1 },
            };
            codes.push(code);
        }
        let Code { steps, depth } = codes.swap_remove(tree.root);
        Program { steps, depth }
    }

    /// The value for this point, and this neighbor of it; truth is 1 or 0.
    #[inline]
    pub(super) fn value(&self, point: usize, neighbor: usize, pair: &Pair) -> f64 {
        if self.depth <= FEW { self.run::<FEW>(point, neighbor, pair) } else { self.run::<MANY>(point, neighbor, pair) }
    }

    #[inline]
    fn run<const N: usize>(&self, point: usize, neighbor: usize, pair: &Pair) -> f64 {
        // The top of the stack is kept apart; `stack` holds what lies below it.
        let mut stack = [0.0; N];
        let mut below = 0;
        let mut top = 0.0;
        let mut next = 0;
        while let Some(step) = self.steps.get(next) {
            next += 1;
            let value = match step {
                Step::Number(value) => *value,
                Step::Point(column) => finite(column[point]),
                Step::Neighbor(column) => finite(column[neighbor]),
                Step::Dist => finite(pair.dist),
                Step::Dist2d => finite(pair.dist2d),
                Step::Dz => finite(pair.dz),
                Step::Angle(normals) => angle(normals.map(|n| n[point]), normals.map(|n| n[neighbor])),
                Step::Inside(side, inside) => {
                    let (region, xy) = &**inside;
                    let [x, y] = xy.map(|column| column[of(*side, point, neighbor)]);
                    f64::from(u8::from(region.holds(x, y)))
                }
                Step::Class(side, class) => {
                    let (classes, column) = &**class;
                    f64::from(u8::from(holds_class(classes, column[of(*side, point, neighbor)])))
                }
                Step::One(compute) => {
                    top = compute(top);
                    continue;
                }
                Step::Two(compute) => {
                    below -= 1;
                    top = compute(stack[below % N], top);
                    continue;
                }
                Step::TwoNumber(compute, value) => {
                    top = compute(top, *value);
                    continue;
                }
                Step::TwoPoint(compute, column) => {
                    top = compute(top, finite(column[point]));
                    continue;
                }
                Step::TwoNeighbor(compute, column) => {
                    top = compute(top, finite(column[neighbor]));
                    continue;
                }
                Step::Skip(steps) => {
                    next += steps;
                    continue;
                }
                Step::OrElse(steps) if top != 0.0 => {
                    next += steps;
                    continue;
                }
                Step::AndThen(steps) if top == 0.0 => {
                    next += steps;
                    continue;
                }
                Step::SkipUnless(steps) => {
                    next += if top == 0.0 { *steps } else { 0 };
                    below -= 1;
                    top = stack[below % N];
                    continue;
                }
                Step::OrElse(_) | Step::AndThen(_) => {
                    below -= 1;
                    top = stack[below % N];
                    continue;
                }
            };
            stack[below % N] = top;
            below += 1;
            top = value;
        }
        top
    }
}

fn of(side: Side, point: usize, neighbor: usize) -> usize {
    match side {
        Side::Point => point,
        Side::Neighbor => neighbor,
    }
}

pub(super) fn holds_class(classes: &Classes, value: f64) -> bool {
    let class = value as u8;
    f64::from(class) == value && classes[usize::from(class / 64)] >> (class % 64) & 1 == 1
}

/// The angle between two lines along normals of any length, in degrees from 0 to 90.
///
/// By the arc tangent, which unlike the arc cosine is as precise for small angles as for large ones.
fn angle([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> f64 {
    let cross = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    let cross = (cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]).sqrt();
    let dot = (ax * bx + ay * by + az * bz).abs();
    if cross == 0.0 && dot == 0.0 { f64::NAN } else { finite(cross.atan2(dot).to_degrees()) }
}

fn leaf_step<'a>(leaf: &Node, tree: &Tree, columns: &Columns<'a>) -> Step<'a> {
    let column = |name| tree.find(name).map_or(&[][..], |position| columns[position]);
    match leaf {
        Node::Number(value) => Step::Number(*value),
        Node::Truth(truth) => Step::Number(f64::from(u8::from(*truth))),
        Node::Attribute(Side::Point, position) => Step::Point(columns[*position]),
        Node::Attribute(Side::Neighbor, position) => Step::Neighbor(columns[*position]),
        Node::Pair(PairVariable::Dist) => Step::Dist,
        Node::Pair(PairVariable::Dist2d) => Step::Dist2d,
        Node::Pair(PairVariable::Dz) => Step::Dz,
        Node::Pair(PairVariable::Angle) => Step::Angle(Box::new(["NormalX", "NormalY", "NormalZ"].map(column))),
        Node::Inside(side, region) => {
            Step::Inside(*side, Box::new((tree.regions[*region].clone(), ["X", "Y"].map(column))))
        }
        Node::Class(side, classes) => Step::Class(*side, Box::new((*classes, column("Classification")))),
        Node::Apply(..) => Step::Skip(0),
    }
}

fn apply<'a>(operation: Operation, operands: &[NodeId], codes: &mut [Code<'a>]) -> Code<'a> {
    let mut parts = operands.iter().map(|&id| std::mem::replace(&mut codes[id], Code { steps: vec![], depth: 0 }));
    let Some(mut code) = parts.next() else { return Code { steps: vec![], depth: 0 } };
    match operation.kernel() {
        Kernel::One(compute) => code.steps.push(Step::One(compute)),
        Kernel::Two(compute) => {
            for part in parts {
                code.depth = code.depth.max(part.depth + 1);
                match part.steps[..] {
                    [Step::Number(value)] => code.steps.push(Step::TwoNumber(compute, value)),
                    [Step::Point(column)] => code.steps.push(Step::TwoPoint(compute, column)),
                    [Step::Neighbor(column)] => code.steps.push(Step::TwoNeighbor(compute, column)),
                    _ => {
                        code.steps.extend(part.steps);
                        code.steps.push(Step::Two(compute));
                    }
                }
            }
        }
        Kernel::Lazy => match (operation, parts.next(), parts.next()) {
            (_, Some(yes), Some(no)) => {
                code.depth = code.depth.max(yes.depth).max(no.depth);
                code.steps.push(Step::SkipUnless(yes.steps.len() + 1));
                code.steps.extend(yes.steps);
                code.steps.push(Step::Skip(no.steps.len()));
                code.steps.extend(no.steps);
            }
            (operation, Some(second), None) => {
                let steps = second.steps.len();
                let is_or = matches!(operation, Operation::Or);
                code.depth = code.depth.max(second.depth);
                code.steps.push(if is_or { Step::OrElse(steps) } else { Step::AndThen(steps) });
                code.steps.extend(second.steps);
            }
            _ => {}
        },
    }
    code
}
