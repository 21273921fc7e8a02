//! No text makes the language panic, hang, or point outside the text: random bytes, tokens in random order, mutated
//! criteria, and nesting. What can be read is bound and evaluated too.
//!
//! `STREAMSEG_CRITERIA` is the number of texts; 40 000 is the normal amount.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::panic::catch_unwind;
use std::time::{Duration, Instant};

use streamseg::error::Error;
use streamseg::expression::{Calculator, Criterion, Filter, Pair};

const VALID: &[&str] = &[
    "abs(Z-n[0].Z)<0.15",
    "normalX*n[0].normalX+normalY*n[0].normalY+normalZ*n[0].normalZ>0.996",
    "NormalSigma0 < 0.02 ? NormalSigma0 : invalid",
    "NormalSigma0<0.02 AND Z > 275 ? NormalSigma0 : invalid",
    "Region[529568.8 5338773.5 529863 5338773.9 529862.6 5338642.4 529706 5338685.4 529569.1 5338753.8]",
    "Region[0 0 9 0 9 9] AND (Generic[Z > 1 AND Z < 9] AND Generic[Classification == 2])",
    "Class[2 Ground] or not n[0].Class[6, 7] && dist2d <= 2 || angle < 5 and dz != 0",
    "max(Z, n[0].Z, 3) % 2 ^ -hypot(Intensity, [Some Name]) >= deg(atan2(1, pi))",
    "valid(_EchoRatio) and !invalid(n[0]._EchoRatio) = (dist <> highest())",
];

const TOKENS: &[&str] = &[
    "0",
    "1",
    "2.5",
    ".5",
    "1e3",
    "1e-300",
    "1e308",
    "9e999",
    "255",
    "Z",
    "n[0].Z",
    "n[1].Z",
    "n[0].",
    "X",
    "Intensity",
    "Classification",
    "_a",
    "[b c]",
    "[",
    "]",
    "(",
    ")",
    "(",
    ")",
    "+",
    "-",
    "*",
    "/",
    "%",
    "^",
    "<",
    "<=",
    ">",
    ">=",
    "==",
    "=",
    "!=",
    "<>",
    "and",
    "AND",
    "&&",
    "or",
    "||",
    "not",
    "!",
    "?",
    ":",
    ",",
    "true",
    "false",
    "invalid",
    "pi",
    "dist",
    "dist2d",
    "dz",
    "angle",
    "abs(",
    "min(",
    "pow(",
    "atan2(",
    "valid(",
    "nan()",
    "lowest()",
    "Region[",
    "Class[",
    "Generic[",
    "Ground",
    " ",
    "\t",
    "\n",
    "ü",
    "𝄞",
    "\u{0}",
    "\u{301}",
    "&",
    "|",
    "'",
    "\"",
    "`",
    ".",
    "e5",
    "foo(",
];

/// `SplitMix64`, as in the scenes: the same numbers on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }

    fn pick<'a>(&mut self, from: &[&'a str]) -> &'a str {
        from[self.below(from.len())]
    }
}

fn bytes(random: &mut Random) -> String {
    let bytes: Vec<u8> = (0..200).map(|_| random.next() as u8).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

fn characters(random: &mut Random) -> String {
    let count = random.below(60);
    (0..count).map(|_| char::from_u32(random.below(0x11_0000) as u32).unwrap_or(' ')).collect()
}

fn soup(random: &mut Random) -> String {
    let count = 1 + random.below(24);
    (0..count).map(|_| random.pick(TOKENS).to_owned() + random.pick(&["", " "])).collect()
}

/// A number, of the right types nearly always.
fn number(random: &mut Random, depth: usize) -> String {
    if depth == 0 || random.below(4) == 0 {
        let leaves = ["Z", "n[0].Z", "1", "0.5", "dz", "dist", "angle", "_a", "[b c]", "invalid", "1e300", "pi"];
        return random.pick(&leaves).to_owned();
    }
    let (a, b) = (number(random, depth - 1), number(random, depth - 1));
    match random.below(8) {
        0 => format!("{}({a})", random.pick(&["abs", "sqrt", "log", "sin", "acosh", "floor", "deg", "exp"])),
        1 => format!("{}({a},{b})", random.pick(&["min", "max", "pow", "atan2", "hypot"])),
        2 => format!("({} ? {a} : {b})", truth(random, depth - 1)),
        3 => format!("-{a}"),
        _ => format!("{a} {} {b}", random.pick(&["+", "-", "*", "/", "%", "^"])),
    }
}

/// True or false, of the right types nearly always.
fn truth(random: &mut Random, depth: usize) -> String {
    if depth == 0 {
        let leaves = ["true", "false", "Class[2]", "n[0].Class[Ground]", "Z<1", "valid(dz)", "Region[0 0 9 0 9 9]"];
        return random.pick(&leaves).to_owned();
    }
    let (a, b) = (truth(random, depth - 1), truth(random, depth - 1));
    match random.below(8) {
        0 => format!("not ({a})"),
        1 | 2 => format!("({a}) {} ({b})", random.pick(&["and", "or", "&&", "||", "==", "!="])),
        3 => format!("Generic[{a}]"),
        _ => {
            let (a, b) = (number(random, depth - 1), number(random, depth - 1));
            format!("{a} {} {b}", random.pick(&["<", "<=", ">", ">=", "==", "=", "!=", "<>"]))
        }
    }
}

fn orderly(random: &mut Random) -> String {
    let depth = random.below(5);
    if random.below(4) == 0 { number(random, depth) } else { truth(random, depth) }
}

fn mutated(random: &mut Random) -> String {
    let mut text: Vec<char> = random.pick(VALID).chars().collect();
    for _ in 0..=random.below(3) {
        let at = random.below(text.len() + 1);
        let to = (at + random.below(8)).min(text.len());
        match random.below(5) {
            0 => drop(text.drain(at..to)),
            1 => {
                let copy: Vec<char> = text[at..to].to_vec();
                let target = random.below(text.len() + 1);
                text.splice(target..target, copy);
            }
            2 => drop(text.splice(at..at, random.pick(TOKENS).chars())),
            3 => drop(text.splice(at..to, random.pick(TOKENS).chars())),
            _ => drop(text.splice(at..to, random.pick(VALID).chars())),
        }
    }
    text.into_iter().collect()
}

/// The same few tokens many times over, with something in the middle.
fn nested(random: &mut Random) -> String {
    let most = if random.below(20) == 0 { 3000 } else { 90 };
    let count = random.below(most);
    let (before, after) = (random.pick(TOKENS), random.pick(TOKENS));
    let other = random.pick(TOKENS);
    let pairs =
        [("(", ")"), ("abs(", ")"), ("Generic[", "]"), ("-", ""), ("!", ""), ("1^", ""), ("true?1:", ""), ("", "+1")];
    let (before, after) = if random.below(2) == 0 { pairs[random.below(pairs.len())] } else { (before, after) };
    let glue = random.pick(&["", " "]);
    format!("{}{other}{}", format!("{before}{glue}").repeat(count), format!("{glue}{after}").repeat(count))
}

fn text(random: &mut Random) -> String {
    match random.below(16) {
        0 => bytes(random),
        1 => characters(random),
        2 => nested(random),
        3..=6 => soup(random),
        7..=10 => orderly(random),
        _ => mutated(random),
    }
}

/// Reads, binds, evaluates; whether it could be read.
fn run(text: &str, random: &mut Random) -> bool {
    let column = [1.0, f64::NAN, 2.0, -7.5, f64::INFINITY, 0.0];
    let columns = |_: &str| Some(&column[..]);
    let (p, n) = (random.below(6), random.below(6));
    let error = match random.below(4) {
        0 => match Filter::parse(text) {
            Ok(filter) => {
                filter.bind(columns).unwrap().holds(p);
                return true;
            }
            Err(error) => error,
        },
        1 => match Calculator::parse(text) {
            Ok(calculator) => {
                let value = calculator.bind(columns).unwrap().value(p);
                assert!(!value.is_infinite());
                return true;
            }
            Err(error) => error,
        },
        _ => match Criterion::parse(text) {
            Ok(criterion) => {
                let bound = criterion.bind(columns).unwrap();
                bound.holds(p, n, &Pair::of_offset([1.0, 2.0, 3.0]));
                assert!(!criterion.is_always_true() || bound.holds(p, n, &Pair::default()));
                let _ = criterion.check(&["Z"]);
                if random.below(64) == 0 {
                    let _ = criterion.symmetry();
                }
                return true;
            }
            Err(error) => error,
        },
    };
    let shown = error.to_string();
    let Error::Expression { column, problem, picture, .. } = error else { panic!("another error: {shown}") };
    assert!((1..=text.chars().count() + 1).contains(&column), "column {column} is outside");
    assert!(!problem.ends_with(": ") && !problem.contains(": ;"), "nothing is allowed: {problem}");
    assert!(!problem.is_empty() && picture.lines().count() == 2, "{picture}");
    false
}

#[test]
fn no_text_makes_the_language_panic_or_hang() {
    let texts: usize = std::env::var("STREAMSEG_CRITERIA").map_or(40_000, |count| count.parse().unwrap());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let start = Instant::now();
    let share = move |first: usize| {
        let (mut read, mut slowest) = (0, (Duration::ZERO, String::new()));
        for case in (first..texts).step_by(threads) {
            let mut random = Random((case as u64).wrapping_mul(0x2545_f491_4f6c_dd1d));
            let text = text(&mut random);
            let began = Instant::now();
            let outcome = catch_unwind(move || {
                let is_read = run(&text, &mut random);
                (is_read, text)
            });
            let (is_read, text) = outcome.unwrap_or_else(|_| panic!("case {case} came to a stop"));
            read += usize::from(is_read);
            if began.elapsed() > slowest.0 {
                slowest = (began.elapsed(), text);
            }
        }
        (read, slowest)
    };
    let results: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|first| scope.spawn(move || share(first))).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    let read: usize = results.iter().map(|result| result.0).sum();
    let slowest = results.into_iter().map(|result| result.1).max().unwrap();
    println!(
        "{texts} texts, {read} of them read, in {:.1} s; slowest {:?}: {:?}",
        start.elapsed().as_secs_f64(),
        slowest.0,
        slowest.1
    );
    assert!(read > texts / 20, "too few of the texts could be read to be worth the search: {read}");
    // Far beyond what a busy machine makes of milliseconds: only a text that hangs takes as long.
    assert!(slowest.0 < Duration::from_secs(60), "{slowest:?}");
}
