//! Normal forms: equal for criteria that are the same but for the order in which they are written.
//!
//! A number is a sum of multiples of forms; a form is an attribute, a product, a function of forms and so on. Operands
//! of what commutes are in order, signs are taken out of products and of even and odd functions, comparisons are of a
//! difference with 0.

use std::collections::BTreeMap;
use std::mem;

use rustc_hash::FxHashMap;

use super::operation::{Compute, Operation, Parity};
use super::tree::{Classes, Node, PairVariable, Side, Tree};

/// Forms are numbered as they come up; equal forms have equal numbers.
pub(super) type Id = usize;

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Form {
    Attribute(Side, usize),
    Pair(PairVariable),
    /// A constant and multiples of other forms; the numbers as bits.
    Sum(u64, Vec<(Id, u64)>),
    /// Two or more, in order.
    Product(Vec<Id>),
    Inverse(Id),
    Function(&'static str, Vec<Id>),
    Positive(Id),
    NotNegative(Id),
    Zero(Id),
    NotZero(Id),
    Valid(Id),
    Truth(bool),
    Inside(Side, usize),
    Class(Side, Classes),
    Not(Id),
    /// Two or more, in order.
    All(Vec<Id>),
    /// Two or more, in order.
    Any(Vec<Id>),
    Same([Id; 2]),
    Choose([Id; 3]),
}

/// A number: a constant and multiples of forms. Multiples of zero stay, since what they multiply may be invalid.
#[derive(Debug, Clone, Default)]
struct Sum {
    constant: f64,
    terms: BTreeMap<Id, f64>,
}

#[derive(Debug, Clone)]
enum Value {
    Number(Sum),
    Truth(Id),
}

/// Longer products are given up.
const MOST_FACTORS: usize = 64;

/// A factor or summand that overflows or vanishes would make different forms equal.
fn sound(value: f64, may_vanish: bool) -> Option<f64> {
    // Adding 0 makes −0 to 0.
    (value.is_finite() && (may_vanish || value != 0.0)).then_some(value + 0.0)
}

impl Sum {
    fn atom(id: Id) -> Sum {
        Sum { constant: 0.0, terms: BTreeMap::from([(id, 1.0)]) }
    }

    fn constant(constant: f64) -> Sum {
        Sum { constant, terms: BTreeMap::new() }
    }

    fn is_constant(&self) -> bool {
        self.terms.is_empty()
    }

    fn is_invalid(&self) -> bool {
        self.constant.is_nan()
    }

    fn plus(mut self, mut other: Sum) -> Option<Sum> {
        if self.is_invalid() || other.is_invalid() {
            return Some(Sum::constant(f64::NAN));
        }
        if other.terms.len() > self.terms.len() {
            mem::swap(&mut self, &mut other);
        }
        self.constant = sound(self.constant + other.constant, true)?;
        for (id, factor) in other.terms {
            let sum = self.terms.entry(id).or_insert(0.0);
            *sum = sound(*sum + factor, true)?;
        }
        Some(self)
    }

    fn times(mut self, factor: f64) -> Option<Sum> {
        if self.is_invalid() || factor.is_nan() {
            return Some(Sum::constant(f64::NAN));
        }
        self.constant = sound(self.constant * factor, factor == 0.0 || self.constant == 0.0)?;
        for value in self.terms.values_mut() {
            *value = sound(*value * factor, factor == 0.0 || *value == 0.0)?;
        }
        Some(self)
    }

    /// Whether the first factor that is not zero is below zero.
    fn is_negative(&self) -> bool {
        self.terms.values().chain([&self.constant]).find(|&&value| value != 0.0).is_some_and(|&value| value < 0.0)
    }
}

#[derive(Default)]
pub(super) struct Forms {
    forms: Vec<Form>,
    ids: FxHashMap<Form, Id>,
}

impl Forms {
    /// The form of a tree's root, or of the same with point and neighbor exchanged.
    pub(super) fn of_tree(&mut self, tree: &Tree, is_exchanged: bool) -> Option<Id> {
        let mut values: Vec<Option<Value>> = Vec::with_capacity(tree.nodes.len());
        for node in &tree.nodes {
            let value = match node {
                Node::Apply(operation, operands) => {
                    // Each node is the operand of one operation at most.
                    let operands: Option<Vec<Value>> = operands.iter().map(|&id| values[id].take()).collect();
                    operands.and_then(|operands| self.apply(*operation, operands))
                }
                leaf => self.leaf(leaf, is_exchanged),
            };
            values.push(value);
        }
        match values.swap_remove(tree.root)? {
            Value::Truth(id) => Some(id),
            Value::Number(_) => None,
        }
    }

    fn id(&mut self, form: Form) -> Id {
        *self.ids.entry(form).or_insert_with_key(|form| {
            self.forms.push(form.clone());
            self.forms.len() - 1
        })
    }

    fn leaf(&mut self, leaf: &Node, is_exchanged: bool) -> Option<Value> {
        let side = |side: Side| match (side, is_exchanged) {
            (Side::Point, false) | (Side::Neighbor, true) => Side::Point,
            _ => Side::Neighbor,
        };
        Some(match *leaf {
            Node::Number(value) => Value::Number(Sum::constant(value)),
            Node::Truth(truth) => Value::Truth(self.id(Form::Truth(truth))),
            Node::Attribute(whose, attribute) => self.atom(Form::Attribute(side(whose), attribute)),
            Node::Pair(variable) => {
                let sign = if is_exchanged && variable == PairVariable::Dz { -1.0 } else { 1.0 };
                Value::Number(Sum::atom(self.id(Form::Pair(variable))).times(sign)?)
            }
            Node::Inside(whose, region) => Value::Truth(self.id(Form::Inside(side(whose), region))),
            Node::Class(whose, classes) => Value::Truth(self.id(Form::Class(side(whose), classes))),
            Node::Apply(..) => return None,
        })
    }

    fn atom(&mut self, form: Form) -> Value {
        Value::Number(Sum::atom(self.id(form)))
    }

    /// A number as a form of its own.
    fn number(&mut self, sum: &Sum) -> Id {
        match sum.terms.iter().next() {
            Some((&id, &1.0)) if sum.terms.len() == 1 && sum.constant == 0.0 => id,
            _ => {
                let terms = sum.terms.iter().map(|(&id, factor)| (id, factor.to_bits())).collect();
                self.id(Form::Sum(sum.constant.to_bits(), terms))
            }
        }
    }

    /// A number without its sign, and the sign.
    fn unsigned(&mut self, sum: Sum) -> Option<(Id, f64)> {
        let sign = if sum.is_negative() { -1.0 } else { 1.0 };
        let sum = sum.times(sign)?;
        Some((self.number(&sum), sign))
    }

    fn apply(&mut self, operation: Operation, operands: Vec<Value>) -> Option<Value> {
        let mut numbers = Vec::new();
        let mut truths = Vec::new();
        for operand in operands {
            match operand {
                Value::Number(sum) => numbers.push(sum),
                Value::Truth(id) => truths.push(id),
            }
        }
        match (operation, truths.as_slice()) {
            (Operation::Choose, &[condition]) => {
                let branches = [self.number(numbers.first()?), self.number(numbers.get(1)?)];
                let choice = self.choose(condition, branches);
                Some(self.atom(choice))
            }
            (Operation::Choose, &[condition, yes, no]) => {
                let choice = self.choose(condition, [yes, no]);
                Some(Value::Truth(self.id(choice)))
            }
            (_, []) => self.of_numbers(operation, numbers),
            _ => Some(Value::Truth(self.of_truths(operation, &truths)?)),
        }
    }

    fn choose(&self, condition: Id, [yes, no]: [Id; 2]) -> Form {
        match self.forms[condition] {
            Form::Not(inverse) => Form::Choose([inverse, no, yes]),
            _ => Form::Choose([condition, yes, no]),
        }
    }

    fn of_truths(&mut self, operation: Operation, operands: &[Id]) -> Option<Id> {
        Some(match (operation, operands) {
            (Operation::Not, &[a]) => self.not(a),
            (Operation::And, _) => self.all(operands),
            (Operation::Or, _) => self.any(operands),
            (Operation::Same, &[a, b]) => self.id(Form::Same([a.min(b), a.max(b)])),
            (Operation::Different, &[a, b]) => {
                let same = self.id(Form::Same([a.min(b), a.max(b)]));
                self.not(same)
            }
            _ => return None,
        })
    }

    fn not(&mut self, id: Id) -> Id {
        match self.forms[id].clone() {
            Form::Not(inner) => inner,
            Form::All(parts) => {
                let parts: Vec<Id> = parts.into_iter().map(|part| self.not(part)).collect();
                self.any(&parts)
            }
            Form::Any(parts) => {
                let parts: Vec<Id> = parts.into_iter().map(|part| self.not(part)).collect();
                self.all(&parts)
            }
            Form::Truth(truth) => self.id(Form::Truth(!truth)),
            _ => self.id(Form::Not(id)),
        }
    }

    fn all(&mut self, parts: &[Id]) -> Id {
        let parts = self.flat(parts, |form| if let Form::All(inner) = form { Some(inner) } else { None });
        if let [only] = parts[..] { only } else { self.id(Form::All(parts)) }
    }

    fn any(&mut self, parts: &[Id]) -> Id {
        let parts = self.flat(parts, |form| if let Form::Any(inner) = form { Some(inner) } else { None });
        if let [only] = parts[..] { only } else { self.id(Form::Any(parts)) }
    }

    /// Parts in order, each once, those of the same kind taken apart.
    fn flat(&self, parts: &[Id], inner: impl Fn(&Form) -> Option<&Vec<Id>>) -> Vec<Id> {
        let mut flat: Vec<Id> = parts
            .iter()
            .flat_map(|part| inner(&self.forms[*part]).map_or(std::slice::from_ref(part), |v| v))
            .copied()
            .collect();
        flat.sort_unstable();
        flat.dedup();
        flat
    }

    fn of_numbers(&mut self, operation: Operation, numbers: Vec<Sum>) -> Option<Value> {
        use Operation as O;
        let mut numbers = numbers.into_iter();
        let first = numbers.next()?;
        let sum = match operation {
            O::Minus => first.times(-1.0)?,
            O::Add => first.plus(numbers.next()?)?,
            O::Subtract => first.plus(numbers.next()?.times(-1.0)?)?,
            O::Multiply => self.product(first, numbers.next()?)?,
            O::Divide => {
                let divisor = numbers.next()?;
                self.quotient(first, divisor)?
            }
            O::Power => self.power(&first, &numbers.next()?)?,
            O::Remainder => {
                let (a, sign) = self.unsigned(first)?;
                let (b, _) = self.unsigned(numbers.next()?)?;
                Sum::atom(self.id(Form::Function("%", vec![a, b]))).times(sign)?
            }
            O::Function(function) => match function.compute {
                Compute::One(_, parity) => self.of_one(function.name, parity, first)?,
                Compute::Two(_) => self.of_two(function.name, first, numbers.next()?)?,
                Compute::Several(_) => self.of_several(function.name, first, numbers),
            },
            _ => return self.comparison(operation, first, numbers.next()).map(Value::Truth),
        };
        Some(Value::Number(sum))
    }

    fn comparison(&mut self, operation: Operation, first: Sum, second: Option<Sum>) -> Option<Id> {
        use Operation as O;
        let Some(second) = second else {
            let (id, _) = self.unsigned(first)?;
            return Some(self.id(Form::Valid(id)));
        };
        let (more, less) = if matches!(operation, O::Less | O::LessEqual) { (second, first) } else { (first, second) };
        let difference = more.plus(less.times(-1.0)?)?;
        let form = match operation {
            _ if difference.is_invalid() => Form::Truth(false),
            O::Less | O::Greater => Form::Positive(self.number(&difference)),
            O::LessEqual | O::GreaterEqual => Form::NotNegative(self.number(&difference)),
            O::Equal => Form::Zero(self.unsigned(difference)?.0),
            O::NotEqual => Form::NotZero(self.unsigned(difference)?.0),
            _ => return None,
        };
        Some(self.id(form))
    }

    fn product(&mut self, a: Sum, b: Sum) -> Option<Sum> {
        if a.is_constant() {
            return b.times(a.constant);
        }
        if b.is_constant() {
            return a.times(b.constant);
        }
        let (mut factors, factor) = self.factors(a)?;
        let (others, other) = self.factors(b)?;
        factors.extend(others);
        if factors.len() > MOST_FACTORS {
            return None;
        }
        factors.sort_unstable();
        let factor = sound(factor * other, factor == 0.0 || other == 0.0)?;
        Sum::atom(self.id(Form::Product(factors))).times(factor)
    }

    /// What a number is the product of: forms, and a constant.
    fn factors(&mut self, sum: Sum) -> Option<(Vec<Id>, f64)> {
        match sum.terms.iter().next() {
            Some((&id, &factor)) if sum.terms.len() == 1 && sum.constant == 0.0 => match &self.forms[id] {
                Form::Product(factors) => Some((factors.clone(), factor)),
                _ => Some((vec![id], factor)),
            },
            _ => self.unsigned(sum).map(|(id, sign)| (vec![id], sign)),
        }
    }

    fn quotient(&mut self, a: Sum, b: Sum) -> Option<Sum> {
        if b.is_constant() {
            return if b.constant == 0.0 || b.is_invalid() {
                Some(Sum::constant(f64::NAN))
            } else {
                a.times(sound(1.0 / b.constant, false)?)
            };
        }
        let (id, sign) = self.unsigned(b)?;
        let inverse = Sum::atom(self.id(Form::Inverse(id))).times(sign)?;
        self.product(a, inverse)
    }

    fn power(&mut self, base: &Sum, exponent: &Sum) -> Option<Sum> {
        let times = exponent.constant;
        if exponent.is_constant() && times.fract() == 0.0 && (1.0..=MOST_FACTORS as f64).contains(&times) {
            let mut result = base.clone();
            for _ in 1..times as usize {
                result = self.product(result, base.clone())?;
            }
            return Some(result);
        }
        let operands = vec![self.number(base), self.number(exponent)];
        Some(Sum::atom(self.id(Form::Function("pow", operands))))
    }

    fn of_one(&mut self, name: &'static str, parity: Parity, operand: Sum) -> Option<Sum> {
        let name = if name == "fabs" { "abs" } else { name };
        match parity {
            Parity::Neither => {
                let id = self.number(&operand);
                Some(Sum::atom(self.id(Form::Function(name, vec![id]))))
            }
            Parity::Even => {
                let (id, _) = self.unsigned(operand)?;
                Some(Sum::atom(self.id(Form::Function(name, vec![id]))))
            }
            Parity::Odd => {
                let (id, sign) = self.unsigned(operand)?;
                Sum::atom(self.id(Form::Function(name, vec![id]))).times(sign)
            }
        }
    }

    fn of_two(&mut self, name: &'static str, a: Sum, b: Sum) -> Option<Sum> {
        let operands = match name {
            "pow" => return self.power(&a, &b),
            "hypot" => {
                let mut operands = vec![self.unsigned(a)?.0, self.unsigned(b)?.0];
                operands.sort_unstable();
                operands
            }
            _ => vec![self.number(&a), self.number(&b)],
        };
        Some(Sum::atom(self.id(Form::Function(name, operands))))
    }

    /// The least or the largest of several.
    fn of_several(&mut self, name: &'static str, first: Sum, others: impl Iterator<Item = Sum>) -> Sum {
        let operands: Vec<Id> = std::iter::once(first).chain(others).map(|operand| self.number(&operand)).collect();
        let operands = self.flat(&operands, |form| match form {
            Form::Function(inner, operands) if *inner == name => Some(operands),
            _ => None,
        });
        Sum::atom(if let [only] = operands[..] { only } else { self.id(Form::Function(name, operands)) })
    }
}
