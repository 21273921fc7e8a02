//! Everything that can be done with values: what each operation takes, gives and computes.
//!
//! All numbers are `f64`. A number that is not finite is *invalid* and is kept as NaN: every operation on numbers goes
//! through [`finite`], and a comparison with NaN is false. Truth is 1 or 0.

/// What a value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Type {
    Number,
    Truth,
}

/// How a function of one number answers to a change of sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Parity {
    Even,
    Odd,
    Neither,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Compute {
    One(fn(f64) -> f64, Parity),
    Two(fn(f64, f64) -> f64),
    /// Two or more, from left to right.
    Several(fn(f64, f64) -> f64),
}

/// A function of numbers that gives a number.
#[derive(Debug)]
pub(super) struct Function {
    pub name: &'static str,
    pub compute: Compute,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Operation {
    Minus,
    Add,
    Subtract,
    Multiply,
    Divide,
    Remainder,
    Power,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    NotEqual,
    /// Of two truths.
    Same,
    /// Of two truths.
    Different,
    Not,
    And,
    Or,
    Choose,
    Valid,
    Function(&'static Function),
}

const fn one(name: &'static str, compute: fn(f64) -> f64, parity: Parity) -> Function {
    Function { name, compute: Compute::One(compute, parity) }
}

const fn two(name: &'static str, compute: fn(f64, f64) -> f64) -> Function {
    Function { name, compute: Compute::Two(compute) }
}

const fn several(name: &'static str, compute: fn(f64, f64) -> f64) -> Function {
    Function { name, compute: Compute::Several(compute) }
}

/// Angles are in radians, as in OPALS and PDAL; `log` is the natural logarithm, as in PDAL.
pub(super) static FUNCTIONS: &[Function] = &[
    one("abs", f64::abs, Parity::Even),
    one("fabs", f64::abs, Parity::Even),
    one("floor", f64::floor, Parity::Neither),
    one("ceil", f64::ceil, Parity::Neither),
    one("round", f64::round, Parity::Odd),
    one("sqrt", |x| finite(x.sqrt()), Parity::Neither),
    one("exp", |x| finite(x.exp()), Parity::Neither),
    one("exp2", |x| finite(x.exp2()), Parity::Neither),
    one("log", |x| finite(x.ln()), Parity::Neither),
    one("log2", |x| finite(x.log2()), Parity::Neither),
    one("log10", |x| finite(x.log10()), Parity::Neither),
    one("sin", f64::sin, Parity::Odd),
    one("cos", f64::cos, Parity::Even),
    one("tan", f64::tan, Parity::Odd),
    one("asin", f64::asin, Parity::Odd),
    one("acos", f64::acos, Parity::Neither),
    one("atan", f64::atan, Parity::Odd),
    one("sinh", |x| finite(x.sinh()), Parity::Odd),
    one("cosh", |x| finite(x.cosh()), Parity::Even),
    one("tanh", f64::tanh, Parity::Odd),
    one("asinh", |x| finite(x.asinh()), Parity::Odd),
    one("acosh", |x| finite(x.acosh()), Parity::Neither),
    one("atanh", |x| finite(x.atanh()), Parity::Odd),
    one("deg", |x| finite(x.to_degrees()), Parity::Odd),
    one("rad", |x| finite(x.to_radians()), Parity::Odd),
    two("pow", power),
    // Nothing else tells 0 from −0, which compare as equal.
    two("atan2", |y, x| (y + 0.0).atan2(x + 0.0)),
    two("hypot", |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { finite(a.hypot(b)) }),
    several("min", |a, b| if b < a || b.is_nan() { b } else { a }),
    several("max", |a, b| if b > a || b.is_nan() { b } else { a }),
];

/// A result that is not a finite number is invalid.
pub(super) fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}

/// IEEE would say that NaN to the power of 0 and 1 to the power of NaN are 1.
fn power(base: f64, exponent: f64) -> f64 {
    if exponent == 2.0 {
        finite(base * base)
    } else if base.is_nan() || exponent.is_nan() {
        f64::NAN
    } else {
        finite(base.powf(exponent))
    }
}

/// How a step of a program computes the operation.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kernel {
    One(fn(f64) -> f64),
    /// Of the value so far and the next one, as often as there is a next one.
    Two(fn(f64, f64) -> f64),
    /// Not every operand is evaluated.
    Lazy,
}

fn truth(holds: bool) -> f64 {
    f64::from(u8::from(holds))
}

impl Operation {
    pub(super) fn operands(self) -> Type {
        use Operation::{And, Choose, Different, Not, Or, Same};
        if matches!(self, Not | And | Or | Choose | Same | Different) { Type::Truth } else { Type::Number }
    }

    pub(super) fn kernel(self) -> Kernel {
        use Operation as O;
        match self {
            O::Minus => Kernel::One(|x| -x),
            O::Not => Kernel::One(|x| 1.0 - x),
            O::Valid => Kernel::One(|x| truth(!x.is_nan())),
            O::Add => Kernel::Two(|a, b| finite(a + b)),
            O::Subtract => Kernel::Two(|a, b| finite(a - b)),
            O::Multiply => Kernel::Two(|a, b| finite(a * b)),
            O::Divide => Kernel::Two(|a, b| finite(a / b)),
            O::Remainder => Kernel::Two(|a, b| a % b),
            O::Power => Kernel::Two(power),
            O::Less => Kernel::Two(|a, b| truth(a < b)),
            O::LessEqual => Kernel::Two(|a, b| truth(a <= b)),
            O::Greater => Kernel::Two(|a, b| truth(a > b)),
            O::GreaterEqual => Kernel::Two(|a, b| truth(a >= b)),
            O::Same => Kernel::Two(|a, b| truth(a == b)),
            O::Different => Kernel::Two(|a, b| truth(a != b)),
            O::Equal => Kernel::Two(|a, b| truth(a == b)),
            O::NotEqual => Kernel::Two(|a, b| truth(a != b && !a.is_nan() && !b.is_nan())),
            O::And | O::Or | O::Choose => Kernel::Lazy,
            O::Function(function) => match function.compute {
                Compute::One(compute, _) => Kernel::One(compute),
                Compute::Two(compute) | Compute::Several(compute) => Kernel::Two(compute),
            },
        }
    }
}
