//! Looks for a pair of points that a criterion judges differently from either end, by trying.

use super::Pair;
use super::program::{Program, holds_class};
use super::tree::{Node, PairVariable, Tree};

/// So many pairs are tried out.
const TRIALS: usize = 2000;

/// The best of so many examples is shown.
const EXAMPLES: usize = 50;

/// Numbers that look random and are always the same (Steele, Lea and Flood, 2014: `SplitMix64`).
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

    /// Few digits, so that sums and products of some are exact, and small numbers more often than large ones.
    fn number(&mut self) -> f64 {
        let range = [8, 64, 512, 8000][self.below(4)];
        (self.below(2 * range + 1) as f64 - range as f64) / 8.0
    }
}

/// Looks for a pair for which the criterion holds one way and not the other.
pub(super) fn counterexample(tree: &Tree) -> Option<String> {
    let mut random = Random(0);
    let hints = hints(tree);
    let position = ["X", "Y", "Z"].map(|name| tree.find(name));
    let mut columns: Vec<Vec<f64>> = (0..tree.attributes.len())
        .map(|attribute| values(&mut random, &hints, !position.contains(&Some(attribute))))
        .collect();
    let position = position.map(|attribute| {
        attribute.unwrap_or_else(|| {
            columns.push(values(&mut random, &hints, false));
            columns.len() - 1
        })
    });
    let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let program = Program::new(tree, &slices);
    let differing = |trial: &usize| {
        let (p, n) = (2 * trial, 2 * trial + 1);
        let offset = position.map(|axis| columns[axis][n] - columns[axis][p]);
        let forth = program.value(p, n, &Pair::of_offset(offset)) != 0.0;
        let back = program.value(n, p, &Pair::of_offset(offset.map(|d| -d))) != 0.0;
        forth != back
    };
    let example = |trial: usize| {
        let offset = position.map(|axis| columns[axis][2 * trial + 1] - columns[axis][2 * trial]);
        let pair = Pair::of_offset(offset);
        let holds = program.value(2 * trial, 2 * trial + 1, &pair) != 0.0;
        describe(tree, &columns, trial, &pair, holds)
    };
    // People understand short numbers more easily, and examples without invalid values.
    let examples = (0..TRIALS).filter(differing).take(EXAMPLES).map(example);
    examples.min_by_key(|example| (example.contains("invalid"), example.len()))
}

/// Constants of the text: near them a criterion changes its mind.
fn hints(tree: &Tree) -> Vec<f64> {
    let mut hints = vec![0.0, 1.0];
    for node in &tree.nodes {
        match node {
            Node::Number(value) if value.is_finite() => hints.push(*value),
            Node::Class(_, classes) => {
                hints.extend((0..=255).map(f64::from).filter(|&class| holds_class(classes, class)));
            }
            _ => {}
        }
    }
    hints.extend(tree.regions.iter().flat_map(super::region::Region::coordinates));
    hints
}

/// Values for the points and neighbors of all trials, in turns.
fn values(random: &mut Random, hints: &[f64], may_be_invalid: bool) -> Vec<f64> {
    let mut values = Vec::with_capacity(2 * TRIALS);
    for _ in 0..TRIALS {
        let hint = hints[random.below(hints.len())];
        let p = [random.number(), hint, hint + random.number() / 64.0][random.below(3)];
        let hint = hints[random.below(hints.len())];
        let factor = [0.0, 0.5, 1.0, 2.0, -0.5, -1.0, -2.0][random.below(7)];
        let n = [random.number(), hint, p + factor * hint, p + random.number() / 64.0][random.below(4)];
        values.extend([p, n].map(|value| if may_be_invalid && random.below(16) == 0 { f64::NAN } else { value }));
    }
    values
}

/// Tells an example to people.
fn describe(tree: &Tree, columns: &[Vec<f64>], trial: usize, pair: &Pair, holds: bool) -> String {
    let shown = |value: f64| if value.is_nan() { "invalid".to_owned() } else { value.to_string() };
    let mut parts: Vec<String> = Vec::new();
    for (attribute, column) in tree.attributes.iter().zip(columns) {
        let (p, n) = (shown(column[2 * trial]), shown(column[2 * trial + 1]));
        parts.push(format!("{0} = {p} and n[0].{0} = {n}", attribute.name));
    }
    for (variable, name, value) in [
        (PairVariable::Dist, "dist", pair.dist),
        (PairVariable::Dist2d, "dist2d", pair.dist2d),
        (PairVariable::Dz, "dz", pair.dz),
    ] {
        if tree.nodes.iter().any(|node| matches!(node, Node::Pair(used) if *used == variable)) {
            parts.push(format!("{name} = {value}"));
        }
    }
    let verdict = if holds {
        "it holds, from the neighbor's side it does not"
    } else {
        "it does not hold, from the neighbor's side it does"
    };
    format!("with {} {verdict}", parts.join(", "))
}
