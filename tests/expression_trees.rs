//! Random expressions: printed, read and evaluated against a direct evaluation of what was printed; and symmetry.
//!
//! `PROPTEST_CASES` scales the number of expressions; 256 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use streamseg::expression::{Criterion, Pair, Symmetry};

/// An expression that gives a number.
#[derive(Debug, Clone)]
enum Number {
    Constant(i32),
    Invalid,
    Attribute(bool, usize),
    Variable(usize),
    Minus(Box<Number>),
    Binary(usize, Box<[Number; 2]>),
    One(usize, Box<Number>),
    Several(bool, Vec<Number>),
    Choose(Box<Truth>, Box<[Number; 2]>),
}

/// An expression that is true or false.
#[derive(Debug, Clone)]
enum Truth {
    Constant(bool),
    Compare(usize, Box<[Number; 2]>),
    Valid(Box<Number>),
    Class(bool, u8),
    Not(Box<Truth>),
    And(Box<[Truth; 2]>),
    Or(Box<[Truth; 2]>),
    Same(Box<[Truth; 2]>),
    Choose(Box<Truth>, Box<[Truth; 2]>),
}

const NAMES: [&str; 3] = ["Z", "Intensity", "Some Name"];
const VARIABLES: [&str; 3] = ["dist", "dist2d", "dz"];
const BINARY: [(&str, u8); 6] = [("+", 7), ("-", 7), ("*", 8), ("/", 8), ("%", 8), ("^", 10)];
const ONE: [&str; 7] = ["abs", "floor", "sqrt", "sin", "cos", "round", "log"];
const COMPARE: [(&str, u8); 6] = [("<", 6), ("<=", 6), (">", 6), (">=", 6), ("==", 5), ("!=", 5)];

/// What an expression is evaluated for: point and neighbor, three attributes each, and what is between them.
#[derive(Debug, Clone, Copy)]
struct Case {
    values: [[f64; 2]; 3],
    class: [f64; 2],
    variables: [f64; 3],
}

fn exact(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

impl Number {
    fn value(&self, case: &Case) -> Option<f64> {
        match self {
            Number::Constant(value) => Some(f64::from(*value) / 4.0),
            Number::Invalid => None,
            Number::Attribute(of_neighbor, name) => exact(case.values[*name][usize::from(*of_neighbor)]),
            Number::Variable(name) => exact(case.variables[*name]),
            Number::Minus(a) => a.value(case).map(|a| -a),
            Number::Binary(operator, operands) => {
                let (a, b) = (operands[0].value(case)?, operands[1].value(case)?);
                exact(match BINARY[*operator].0 {
                    "+" => a + b,
                    "-" => a - b,
                    "*" => a * b,
                    "/" => a / b,
                    "%" => a % b,
                    _ => a.powf(b),
                })
            }
            Number::One(function, a) => {
                let a = a.value(case)?;
                exact(match ONE[*function] {
                    "abs" => a.abs(),
                    "floor" => a.floor(),
                    "sqrt" => a.sqrt(),
                    "sin" => a.sin(),
                    "cos" => a.cos(),
                    "round" => a.round(),
                    _ => a.ln(),
                })
            }
            Number::Several(is_min, operands) => {
                let values: Vec<f64> = operands.iter().map(|a| a.value(case)).collect::<Option<_>>()?;
                values.into_iter().reduce(|a, b| if *is_min { a.min(b) } else { a.max(b) })
            }
            Number::Choose(condition, branches) => branches[usize::from(!condition.value(case))].value(case),
        }
    }

    /// As text with no more brackets than `least`, the precedence around it, asks for.
    fn print(&self, least: u8) -> String {
        let (text, precedence) = match self {
            Number::Constant(value) if *value < 0 => (format!("-{}", -f64::from(*value) / 4.0), 9),
            Number::Constant(value) => ((f64::from(*value) / 4.0).to_string(), 11),
            Number::Invalid => ("invalid".to_owned(), 11),
            Number::Attribute(of_neighbor, name) => {
                let name = if *name == 2 { format!("[{}]", NAMES[2]) } else { NAMES[*name].to_owned() };
                (format!("{}{name}", if *of_neighbor { "n[0]." } else { "" }), 11)
            }
            Number::Variable(name) => (VARIABLES[*name].to_owned(), 11),
            Number::Minus(a) => (format!("-{}", a.print(9)), 9),
            Number::Binary(operator, operands) => {
                let (symbol, precedence) = BINARY[*operator];
                // Of what is on the right, all but a power needs brackets at the same level.
                let (left, right) = if symbol == "^" { (11, 9) } else { (precedence, precedence + 1) };
                (format!("{}{symbol}{}", operands[0].print(left), operands[1].print(right)), precedence)
            }
            Number::One(function, a) => (format!("{}({})", ONE[*function], a.print(0)), 11),
            Number::Several(is_min, operands) => {
                let operands: Vec<String> = operands.iter().map(|a| a.print(0)).collect();
                (format!("{}({})", if *is_min { "min" } else { "MAX" }, operands.join(" , ")), 11)
            }
            Number::Choose(condition, branches) => {
                (format!("{}?{}:{}", condition.print(2), branches[0].print(0), branches[1].print(1)), 1)
            }
        };
        if precedence < least { format!("({text})") } else { text }
    }

    /// The same with point and neighbor exchanged, and what commutes the other way round.
    fn exchanged(&self) -> Number {
        let two = |operands: &[Number; 2]| Box::new([operands[0].exchanged(), operands[1].exchanged()]);
        match self {
            Number::Constant(_) | Number::Invalid | Number::Variable(0 | 1) => self.clone(),
            Number::Attribute(of_neighbor, name) => Number::Attribute(!of_neighbor, *name),
            Number::Variable(_) => Number::Minus(Box::new(self.clone())),
            Number::Minus(a) => Number::Minus(Box::new(a.exchanged())),
            Number::Binary(operator, operands) => {
                let mut operands = two(operands);
                if ["+", "*"].contains(&BINARY[*operator].0) {
                    operands.swap(0, 1);
                }
                Number::Binary(*operator, operands)
            }
            Number::One(function, a) => Number::One(*function, Box::new(a.exchanged())),
            Number::Several(is_min, operands) => {
                Number::Several(*is_min, operands.iter().rev().map(Number::exchanged).collect())
            }
            Number::Choose(condition, branches) => Number::Choose(Box::new(condition.exchanged()), two(branches)),
        }
    }
}

impl Truth {
    fn value(&self, case: &Case) -> bool {
        match self {
            Truth::Constant(truth) => *truth,
            Truth::Compare(operator, operands) => {
                let (Some(a), Some(b)) = (operands[0].value(case), operands[1].value(case)) else { return false };
                match COMPARE[*operator].0 {
                    "<" => a < b,
                    "<=" => a <= b,
                    ">" => a > b,
                    ">=" => a >= b,
                    "==" => a == b,
                    _ => a != b,
                }
            }
            Truth::Valid(a) => a.value(case).is_some(),
            Truth::Class(of_neighbor, class) => case.class[usize::from(*of_neighbor)] == f64::from(*class),
            Truth::Not(a) => !a.value(case),
            Truth::And(operands) => operands[0].value(case) & operands[1].value(case),
            Truth::Or(operands) => operands[0].value(case) | operands[1].value(case),
            Truth::Same(operands) => operands[0].value(case) == operands[1].value(case),
            Truth::Choose(condition, branches) => branches[usize::from(!condition.value(case))].value(case),
        }
    }

    fn print(&self, least: u8) -> String {
        let (text, precedence) = match self {
            Truth::Constant(truth) => (truth.to_string(), 11),
            Truth::Compare(operator, operands) => {
                let (symbol, precedence) = COMPARE[*operator];
                (format!("{}{symbol}{}", operands[0].print(precedence), operands[1].print(precedence + 1)), precedence)
            }
            Truth::Valid(a) => (format!("valid({})", a.print(0)), 11),
            Truth::Class(of_neighbor, class) => {
                (format!("{}Class[{class}]", if *of_neighbor { "n[0]." } else { "" }), 11)
            }
            Truth::Not(a) => (format!("not {}", a.print(4)), 4),
            Truth::And(operands) => (format!("{} AND {}", operands[0].print(3), operands[1].print(4)), 3),
            Truth::Or(operands) => (format!("{}||{}", operands[0].print(2), operands[1].print(3)), 2),
            Truth::Same(operands) => (format!("{}=={}", operands[0].print(5), operands[1].print(6)), 5),
            Truth::Choose(condition, branches) => {
                (format!("{}?{}:{}", condition.print(2), branches[0].print(0), branches[1].print(1)), 1)
            }
        };
        if precedence < least { format!("({text})") } else { text }
    }

    fn exchanged(&self) -> Truth {
        let turned = |operands: &[Truth; 2]| Box::new([operands[1].exchanged(), operands[0].exchanged()]);
        match self {
            Truth::Constant(_) => self.clone(),
            Truth::Compare(operator, operands) => {
                // a < b is b > a.
                let turned = [2, 3, 0, 1, 4, 5][*operator];
                Truth::Compare(turned, Box::new([operands[1].exchanged(), operands[0].exchanged()]))
            }
            Truth::Valid(a) => Truth::Valid(Box::new(a.exchanged())),
            Truth::Class(of_neighbor, class) => Truth::Class(!of_neighbor, *class),
            Truth::Not(a) => Truth::Not(Box::new(a.exchanged())),
            Truth::And(operands) => Truth::And(turned(operands)),
            Truth::Or(operands) => Truth::Or(turned(operands)),
            Truth::Same(operands) => Truth::Same(turned(operands)),
            Truth::Choose(condition, branches) => {
                let branches = Box::new([branches[0].exchanged(), branches[1].exchanged()]);
                Truth::Choose(Box::new(condition.exchanged()), branches)
            }
        }
    }
}

/// Random expressions, with at most this many kinds of binary operators and functions.
fn truths(binary: &'static [usize], one: &'static [usize]) -> impl Strategy<Value = Truth> {
    let leaf = prop_oneof![
        any::<bool>().prop_map(Truth::Constant),
        (any::<bool>(), 0u8..9).prop_map(|(n, c)| Truth::Class(n, c))
    ];
    let numbers = numbers(binary, one).boxed();
    let pair = (numbers.clone(), numbers.clone()).prop_map(|(a, b)| Box::new([a, b]));
    let comparison = (0..COMPARE.len(), pair).prop_map(|(operator, operands)| Truth::Compare(operator, operands));
    let leaf = prop_oneof![1 => leaf, 6 => comparison, 1 => numbers.prop_map(|a| Truth::Valid(Box::new(a)))];
    leaf.prop_recursive(4, 24, 2, |inner| {
        let two = (inner.clone(), inner.clone()).prop_map(|(a, b)| Box::new([a, b])).boxed();
        prop_oneof![
            inner.clone().prop_map(|a| Truth::Not(Box::new(a))),
            two.clone().prop_map(Truth::And),
            two.clone().prop_map(Truth::Or),
            two.clone().prop_map(Truth::Same),
            (inner, two).prop_map(|(condition, branches)| Truth::Choose(Box::new(condition), branches)),
        ]
    })
}

fn numbers(binary: &'static [usize], one: &'static [usize]) -> impl Strategy<Value = Number> {
    let leaf = prop_oneof![
        3 => (-40i32..40).prop_map(Number::Constant),
        6 => (any::<bool>(), 0..3usize).prop_map(|(n, name)| Number::Attribute(n, name)),
        2 => (0..3usize).prop_map(Number::Variable),
        1 => Just(Number::Invalid),
    ];
    leaf.prop_recursive(4, 16, 3, move |inner| {
        let two = (inner.clone(), inner.clone()).prop_map(|(a, b)| Box::new([a, b])).boxed();
        let condition =
            (0..COMPARE.len(), two.clone()).prop_map(|(operator, operands)| Truth::Compare(operator, operands));
        prop_oneof![
            1 => inner.clone().prop_map(|a| Number::Minus(Box::new(a))),
            6 => (prop::sample::select(binary), two.clone()).prop_map(|(o, operands)| Number::Binary(o, operands)),
            2 => (prop::sample::select(one), inner.clone()).prop_map(|(f, a)| Number::One(f, Box::new(a))),
            1 => (any::<bool>(), prop::collection::vec(inner, 2..4)).prop_map(|(is_min, o)| Number::Several(is_min, o)),
            1 => (condition, two).prop_map(|(condition, branches)| Number::Choose(Box::new(condition), branches)),
        ]
    })
}

fn case() -> impl Strategy<Value = Case> {
    let value =
        prop_oneof![8 => (-40i32..40).prop_map(|v| f64::from(v) / 4.0), 1 => Just(f64::NAN), 1 => Just(f64::INFINITY)];
    let values = prop::array::uniform3([value.clone(), value]);
    let class = [0u8..9, 0u8..9].prop_map(|classes| classes.map(f64::from));
    let variables = [0i32..40, 0i32..40, -40i32..40].prop_map(|values| values.map(|v| f64::from(v) / 4.0));
    (values, class, variables).prop_map(|(values, class, variables)| Case { values, class, variables })
}

fn holds(criterion: &Criterion, case: &Case, is_exchanged: bool) -> bool {
    let columns = |name: &str| match NAMES.iter().position(|known| *known == name) {
        Some(name) => Some(&case.values[name][..]),
        None => Some(&case.class[..]),
    };
    let [dist, dist2d, dz] = case.variables;
    let bound = criterion.bind(columns).unwrap();
    if is_exchanged {
        bound.holds(1, 0, &Pair { dist, dist2d, dz: -dz })
    } else {
        bound.holds(0, 1, &Pair { dist, dist2d, dz })
    }
}

/// A constant may come out as 0 and then stand below a fraction bar, which is refused; nothing else is.
fn read(text: &str) -> Result<Option<Criterion>, TestCaseError> {
    match Criterion::parse(text) {
        Ok(criterion) => Ok(Some(criterion)),
        Err(error) if error.to_string().contains("division by 0") => Ok(None),
        Err(error) => Err(TestCaseError::fail(error.to_string())),
    }
}

const ALL: &[usize] = &[0, 1, 2, 3, 4, 5];
/// Those that are exact for numbers of few digits, so that the order of sums and products cannot matter.
const EXACT: &[usize] = &[0, 1, 1, 2];
const EXACT_FUNCTIONS: &[usize] = &[0, 1, 3, 4, 5];

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn a_text_means_what_its_tree_means(tree in truths(ALL, &[0, 1, 2, 3, 4, 5, 6]), cases in prop::collection::vec(case(), 8)) {
        let text = tree.print(0);
        if let Some(criterion) = read(&text)? {
            for case in &cases {
                prop_assert_eq!(holds(&criterion, case, false), tree.value(case), "{} with {:?}", text, case);
            }
        }
    }

    #[test]
    fn what_is_proven_symmetric_is_the_same_from_either_end(
        tree in truths(EXACT, EXACT_FUNCTIONS), cases in prop::collection::vec(case(), 32), mode in 0..3
    ) {
        let other = tree.exchanged();
        let text = match mode {
            0 => tree.print(0),
            1 => format!("({}) and ({})", tree.print(0), other.print(0)),
            _ => format!("({}) or ({})", tree.print(0), other.print(0)),
        };
        if let Some(criterion) = read(&text)? {
            let symmetry = criterion.symmetry();
            if mode > 0 {
                prop_assert_eq!(&symmetry, &Symmetry::Proven, "{}", text);
            }
            if symmetry == Symmetry::Proven {
                for case in &cases {
                    prop_assert_eq!(holds(&criterion, case, false), holds(&criterion, case, true), "{} with {:?}", text, case);
                }
            }
        }
    }
}
