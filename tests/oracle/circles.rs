//! The canonical Delaunay graph by its definition: two places are neighbors if a circle through both has no place inside.
//!
//! Unless all places lie on one line, such a circle can be blown up away from one side until it meets a third place, and
//! stays empty. So it is enough to look at the circle of every three places; all places on the rim of an empty one are
//! neighbors of each other. On one line every circle holds what lies between its ends and nothing else.

use std::collections::BTreeSet;

/// Coordinates on the map, on a lattice.
pub type Spot = [i64; 2];

/// Two neighboring places, the lesser one first.
pub type Pair = [Spot; 2];

/// All pairs of distinct places with an empty circle, in exact arithmetic; in steps of the fourth power of their number.
pub fn canonical_graph(places: &BTreeSet<Spot>) -> BTreeSet<Pair> {
    let places: Vec<Spot> = places.iter().copied().collect();
    let mut pairs = BTreeSet::new();
    let mut are_on_one_line = true;
    for (k, &a) in places.iter().enumerate() {
        for (l, &b) in places.iter().enumerate().skip(k + 1) {
            for &c in &places[l + 1..] {
                let turn = turn(a, b, c);
                if turn == 0 {
                    continue;
                }
                are_on_one_line = false;
                let sides: Vec<i128> = places.iter().map(|&d| turn.signum() * incircle(a, b, c, d)).collect();
                if sides.iter().all(|&side| side <= 0) {
                    let rim: Vec<Spot> = (0..places.len()).filter(|&d| sides[d] == 0).map(|d| places[d]).collect();
                    pairs.extend(rim.iter().enumerate().flat_map(|(i, &p)| rim[..i].iter().map(move |&q| [q, p])));
                }
            }
        }
    }
    if are_on_one_line {
        // In lexical order places of one line are in order along it.
        pairs.extend(places.windows(2).map(|pair| [pair[0], pair[1]]));
    }
    pairs
}

/// Above 0 if a, b, c turn to the left.
fn turn(a: Spot, b: Spot, c: Spot) -> i128 {
    let ([bx, by], [cx, cy]) = (from(a, b), from(a, c));
    bx * cy - by * cx
}

/// Above 0 if d lies inside the circle through a, b, c, which turn to the left; 0 if it lies on its rim.
fn incircle(a: Spot, b: Spot, c: Spot, d: Spot) -> i128 {
    let [[ax, ay], [bx, by], [cx, cy]] = [a, b, c].map(|corner| from(d, corner));
    let [a2, b2, c2] = [ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy];
    a2 * (bx * cy - by * cx) - b2 * (ax * cy - ay * cx) + c2 * (ax * by - ay * bx)
}

fn from(origin: Spot, place: Spot) -> [i128; 2] {
    [i128::from(place[0]) - i128::from(origin[0]), i128::from(place[1]) - i128::from(origin[1])]
}
