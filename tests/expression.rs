//! The language by examples: a text and its value, a text and its error, a criterion and its symmetry.
#![cfg(not(loom))]
#![allow(clippy::unwrap_used)]

use streamseg::expression::{Calculator, Criterion, Filter, Pair, Symmetry};

/// Attributes of two points; NaN is invalid.
const ATTRIBUTES: [(&str, [f64; 2]); 10] = [
    ("X", [1.0, 4.0]),
    ("Y", [2.0, 6.0]),
    ("Z", [3.0, 3.5]),
    ("Classification", [2.0, 6.0]),
    ("Intensity", [0.0, 7.0]),
    ("NormalX", [0.0, 1.0]),
    ("NormalY", [0.0, 0.0]),
    ("NormalZ", [1.0, -1.0]),
    ("SigmaZ", [f64::NAN, 0.5]),
    ("Some Name", [8.0, 9.0]),
];
const PAIR: Pair = Pair { dist: 5.025, dist2d: 5.0, dz: 0.5 };

fn column(name: &str) -> Option<&'static [f64]> {
    ATTRIBUTES.iter().find(|known| known.0.eq_ignore_ascii_case(name)).map(|known| &known.1[..])
}

/// Of the first point.
fn number(text: &str) -> f64 {
    Calculator::parse(text).unwrap_or_else(|error| panic!("{error}")).bind(column).unwrap().value(0)
}

/// Of the first point and the second as its neighbor.
fn truth(text: &str) -> bool {
    Criterion::parse(text).unwrap_or_else(|error| panic!("{error}")).bind(column).unwrap().holds(0, 1, &PAIR)
}

#[test]
fn numbers() {
    for (text, expected) in [
        ("1", 1.0),
        (".5 + 5. + 1e1 + 2E-1", 15.7),
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("7 - 2 - 1", 4.0),
        ("12 / 2 / 3", 2.0),
        ("7 % 4", 3.0),
        ("-7 % 4", -3.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ -1", 0.5),
        ("(-8) ^ 3", -512.0),
        ("2 * -3", -6.0),
        ("- - 3", 3.0),
        ("+3 - +2", 1.0),
        ("Z", 3.0),
        ("z + x * y", 5.0),
        ("[Some Name] + [ some name ] + [Z]", 19.0),
        ("Z > 1 ? 10 : 20", 10.0),
        ("Z > 5 ? 1 : Z > 2 ? 2 : 3", 2.0),
        ("(Z > 1 ? 1 : 0) + 1", 2.0),
        ("Z > 1 ? Z < 2 ? 1 : 2 : 3", 2.0),
        ("Z > 1 ? 1 : 2 + 5", 1.0),
        ("abs(-2) + fabs(-3)", 5.0),
        ("ABS(floor(-1.5) + ceil(1.2) + round(2.5))", 3.0),
        ("sqrt(16) + exp(0) + exp2(3) + log(exp(1)) + log2(8) + log10(100)", 19.0),
        ("sin(pi / 2) + cos(0) + tan(0) + asin(0) + acos(1) + atan(0)", 2.0),
        ("sinh(0) + cosh(0) + tanh(0) + asinh(0) + acosh(1) + atanh(0)", 1.0),
        ("deg(pi) + rad(180) / pi", 181.0),
        ("atan2(1, 1) * 4 / pi + hypot(3, 4) + pow(2, 10)", 1030.0),
        ("min(3, 1, 2) + max(3, 1, 2)", 4.0),
        ("lowest() + highest()", 0.0),
        ("Generic[Z > 1] ? 1 : 0", 1.0),
    ] {
        assert!((number(text) - expected).abs() < 1e-12, "{text} is {}, expected {expected}", number(text));
    }
}

#[test]
fn a_number_that_is_missing_or_not_finite_is_invalid() {
    for text in [
        "invalid",
        "INVALID",
        "nan()",
        "SigmaZ",
        "SigmaZ + 1",
        "0 * SigmaZ",
        "SigmaZ ^ 0",
        "pow(1, SigmaZ)",
        "min(1, SigmaZ)",
        "max(SigmaZ, 1)",
        "hypot(1.7e308, 1.7e308)",
        "hypot(highest(), SigmaZ)",
        "1 / Intensity",
        "Intensity / Intensity",
        "Z % Intensity",
        "sqrt(-1)",
        "log(Intensity)",
        "log(-1)",
        "acos(2)",
        "atanh(1)",
        "1e308 * 10",
        "exp(1000)",
        "(-8) ^ 0.5",
        "Intensity ^ -1",
        "SigmaZ > 0 ? 1 : invalid",
        "-SigmaZ",
        "deg(1.7e308)",
    ] {
        assert!(number(text).is_nan(), "{text} is {}", number(text));
    }
}

#[test]
fn truths() {
    for (text, expected) in [
        ("true", true),
        ("FALSE", false),
        ("Z < 4 and Z <= 3 && Z >= 3 AND Z > 2", true),
        ("Z == 3 and Z = 3 and Z != 4 and Z <> 4", true),
        ("Z > 5 or Z > 4 || Z > 2", true),
        ("not Z > 5", true),
        ("!Z > 5", true),
        ("not not true", true),
        ("not false and false", false),
        ("not (true and false)", true),
        ("true or false and false", true),
        ("true == false == false", true),
        ("Z > 1 == true", true),
        ("true != false", true),
        ("Z > 1 ? Z > 2 : Z > 3", true),
        ("1 + 1 < 3 == 2 < 3", true),
        // A comparison with an invalid value is false, whichever.
        ("SigmaZ < 1 or SigmaZ > 1 or SigmaZ == 1 or SigmaZ != 1 or SigmaZ == SigmaZ or SigmaZ <= 1", false),
        ("not SigmaZ < 1", true),
        ("valid(Z) and invalid(SigmaZ) and not valid(SigmaZ) and not invalid(Z)", true),
        ("valid(1 / Intensity)", false),
        ("Generic[Z] and not Generic[SigmaZ]", true),
        ("n[0].Z == 3.5 and N[0].z - Z == 0.5 and n [ 0 ] . Z > 3", true),
        ("n[0].[Some Name] == 9 and n[0].SigmaZ == 0.5", true),
        ("dist > 5 and dist2d == 5 and dz == 0.5 and DZ == 0.5", true),
        ("abs(angle - 90) < 1e-9", false),
        ("angle == 45", true),
        ("Class[2] and Class[Ground] and Class[1, 2 3] and not Class[3 4]", true),
        ("n[0].Class[building 7] and not n[0].Class[Ground]", true),
        ("Region[0 0 2 0 2 3 0 3]", true),
        ("Region[0 0, 2 0, 2 3, 0 3]", true),
        ("Region[0 0 1 0 1 3 0 3]", true),
        ("Region[0 0 .9 0 .9 3 0 3]", false),
        ("n[0].Region[0 0 2 0 2 3 0 3]", false),
        ("Region[-1e1 -1e1 +3 -1e1 3 20]", true),
        // Whatever follows or, and, ? is looked at only if it matters.
        ("true or SigmaZ > 1", true),
        ("false and SigmaZ > 1", false),
    ] {
        assert_eq!(truth(text), expected, "{text}");
    }
}

#[test]
fn a_filter_that_is_an_attribute_alone_asks_for_its_presence() {
    for (text, expected) in [
        ("Z", [true, true]),
        ("(SigmaZ)", [false, true]),
        ("Generic[SigmaZ]", [false, true]),
        ("Intensity", [true, true]),
        ("Class[6] or Generic[[Some Name] < 9]", [true, true]),
        ("Region[0 0 3 0 3 3 0 3] AND (Generic[Z > 1 AND Z < 9] AND Generic[Classification == 2])", [true, false]),
    ] {
        let filter = Filter::parse(text).unwrap();
        let bound = filter.bind(column).unwrap();
        assert_eq!([bound.holds(0), bound.holds(1)], expected, "{text}");
    }
}

#[test]
fn the_border_and_the_corners_belong_to_a_region() {
    let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]];
    for shift in 0..corners.len() {
        for backwards in [false, true] {
            let mut turned = corners;
            turned.rotate_left(shift);
            if backwards {
                turned.reverse();
            }
            let text: Vec<String> = turned.iter().map(|[x, y]| format!("{x} {y}")).collect();
            let filter = Filter::parse(&format!("Region[{}]", text.join(" "))).unwrap();
            for (x, y, expected) in [
                (0.0, 0.0, true),
                (4.0, 4.0, true),
                (2.0, 1.0, true),
                (2.0, 0.0, true),
                (3.0, 2.5, true),
                (1.0, 2.5, true),
                (1.0, 1.0, true),
                (3.0, 1.0, true),
                (2.0, 1.01, false),
                (2.0, 4.0, false),
                (-1.0, 0.0, false),
                (5.0, 0.0, false),
                (-1.0, 4.0, false),
                (5.0, 4.0, false),
                (-1.0, 1.0, false),
                (f64::NAN, 1.0, false),
                (1.0, f64::NAN, false),
            ] {
                let (x, y) = ([x], [y]);
                let bound = filter.bind(|name| Some(if name == "X" { &x[..] } else { &y[..] })).unwrap();
                assert_eq!(bound.holds(0), expected, "{x:?} {y:?} in {}", filter.text());
            }
        }
    }
}

#[test]
fn the_examples_of_opals_can_be_read() {
    let seeds = Calculator::parse("NormalSigma0<0.02 AND Z > 275 ? NormalSigma0 : invalid").unwrap();
    assert_eq!(seeds.attributes().collect::<Vec<_>>(), ["NormalSigma0", "Z"]);
    let (sigma, z) = ([0.01, 0.03, 0.01, f64::NAN], [280.0, 280.0, 270.0, 280.0]);
    let bound = seeds.bind(|name| Some(if name == "Z" { &z[..] } else { &sigma[..] })).unwrap();
    assert_eq!(bound.value(0), 0.01);
    assert!((1..4).all(|point| bound.value(point).is_nan()));

    assert!(truth("abs(Z-n[0].Z)<0.6") && !truth("abs(Z-n[0].Z)<0.15"));
    assert!(!truth("normalX*n[0].normalX+normalY*n[0].normalY+normalZ*n[0].normalZ>0.996"));
    Calculator::parse("NormalSigma0 < 0.02 ? NormalSigma0 : invalid").unwrap();
    let region = "Region[529568.8 5338773.5 529863 5338773.9 529862.6 5338642.4 529706 5338685.4 529569.1 5338753.8]";
    let (x, y) = ([529_700.0, 529_706.0, 529_700.0], [5_338_700.0, 5_338_685.4, 5_338_680.0]);
    let region = Filter::parse(region).unwrap();
    let bound = region.bind(|name| Some(if name == "X" { &x[..] } else { &y[..] })).unwrap();
    assert_eq!([bound.holds(0), bound.holds(1), bound.holds(2)], [true, true, false]);
}

#[test]
fn the_examples_of_the_page_are_what_it_says() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/expressions.md")).unwrap();
    let examples: Vec<&str> = page.split("```").nth(1).unwrap().trim().lines().collect();
    for criterion in &examples[..3] {
        assert_eq!(is_symmetric(criterion), Symmetry::Proven, "{criterion}");
    }
    Calculator::parse(examples[3]).unwrap();
    Filter::parse(examples[4]).unwrap();
    let error = Criterion::parse("abs(Z - n[0].Intensty) < 0.15").unwrap().check(&["X", "Y", "Z", "Intensity"]);
    assert!(page.contains(&error.unwrap_err().to_string()));
}

#[test]
fn attributes_come_once_as_first_written() {
    let criterion = Criterion::parse("Z > 1 and n[0].z < 2 and angle < 5 and n[0].Region[0 0 1 1 1 0]").unwrap();
    assert_eq!(criterion.attributes().collect::<Vec<_>>(), ["Z", "NormalX", "NormalY", "NormalZ", "X", "Y"]);
    assert_eq!(Filter::parse("class[2]").unwrap().attributes().collect::<Vec<_>>(), ["Classification"]);
    assert_eq!(criterion.text(), "Z > 1 and n[0].z < 2 and angle < 5 and n[0].Region[0 0 1 1 1 0]");
    assert_eq!(Criterion::parse("dist < 2 and dz > 1").unwrap().attributes().count(), 0);
}

#[test]
fn a_criterion_that_is_always_true_is_known() {
    for (text, expected) in
        [("true", true), ("not false", true), ("1 < 2 or Z > 1", true), ("Z == Z", false), ("false", false)]
    {
        assert_eq!(Criterion::parse(text).unwrap().is_always_true(), expected, "{text}");
    }
}

#[test]
fn errors_tell_the_column_what_is_there_and_what_is_allowed() {
    for (text, column, part) in [
        ("", 1, "the text is empty, allowed here: a value"),
        ("Z >", 4, "the text ends here, allowed here: a value"),
        ("Z Z", 3, "found 'Z', allowed here: an operator such as + < and, the end"),
        ("(Z > 1", 7, "the text ends here, allowed here: an operator such as + < and, ')'"),
        ("Z > 1)", 6, "found ')', allowed here: an operator such as + < and, the end"),
        ("Class[2", 8, "allowed here: a class, ']'"),
        ("Z > 1 ? 2", 10, "allowed here: an operator such as + < and, ':'"),
        ("n[0]>1", 5, "found '>', allowed here: '.'"),
        ("n[i].Z>1", 3, "found 'i', allowed here: 0"),
        ("n[0].", 6, "allowed here: the name of an attribute"),
        ("n[1].Z>1", 1, "one neighbor at a time, n[0]; n[1] is not known"),
        ("Z > 0,15", 6, "the decimal sign is a point"),
        ("Z => 1", 4, "comparisons are written"),
        ("Z > 1 & Z < 2", 7, "'and' is written and or &&"),
        ("Z > 1 | Z < 2", 7, "'or' is written or or ||"),
        ("Echo[First]", 5, "square brackets follow n, Generic, Region and Class"),
        ("Z = \u{1}1", 5, "found '\\u{1}'"),
        ("ü > 1 and ü", 11, "'and' needs true or false, but 'ü' is a number; write ü != 0"),
        (
            "(Intensity>0) && Classification",
            18,
            "'&&' needs true or false, but 'Classification' is a number; write Classification != 0",
        ),
        ("not Z", 5, "'not' needs true or false"),
        ("-(Z > 1) > 0", 2, "'-' needs a number, but '(Z > 1)' is true or false"),
        ("+(Z > 1) > 0", 2, "'+' needs a number"),
        ("1 < Z < 2", 1, "'<' needs a number, but '1 < Z' is true or false; join comparisons with 'and'"),
        ("Z ? true : false", 1, "'?' needs true or false"),
        ("Z > 1 ? 1 : true", 13, "both have to be the same"),
        ("Generic[Z + 1]", 9, "'Generic[…]' needs true or false"),
        ("Z / 0 > 1", 5, "a division by 0 has no result"),
        ("Z % (1 - 1) > 1", 5, "a division by 0 has no result"),
        ("Z > 1e999", 5, "the number is too large"),
        ("abs() > 1", 5, "abs() takes one number, 0 given"),
        ("min(1) > 1", 6, "min() takes two or more numbers, 1 given"),
        ("pow(1, 2, 3) > 1", 12, "pow() takes two numbers, 3 given"),
        ("nan(1) > 1", 6, "nan() takes nothing, 1 given"),
        ("abs(true) > 1", 5, "'abs()' needs a number"),
        ("sqr(Z) > 1", 1, "there is no function 'sqr', did you mean 'sqrt'?; there are: abs, fabs, floor"),
        ("Region[1 2 3 4]", 15, "a region has at least 3 corners, 2 given"),
        ("Region[1 2 3 4 5 6 7]", 21, "an x and a y for each corner, 7 numbers given"),
        ("Class[Groun]", 7, "there is no class 'Groun', did you mean 'Ground'?"),
        ("Class[256]", 7, "a number from 0 to 255"),
        ("Z", 1, "a criterion has to be true or false, but this is a number; compare it, as in (Z) > 0"),
    ] {
        let error = Criterion::parse(text).unwrap_err().to_string();
        assert!(error.starts_with(&format!("criterion, column {column}: ")) && error.contains(part), "{text}\n{error}");
    }
    let error = Filter::parse("dist < 1").unwrap_err().to_string();
    assert!(error.starts_with("filter, column 1: 'dist' is between two points"), "{error}");
    let error = Calculator::parse("1 + n[0].Z").unwrap_err().to_string();
    assert!(error.starts_with("calculator, column 5: a calculator looks at one point alone"), "{error}");
    let error = Calculator::parse("Z > 1").unwrap_err().to_string();
    assert!(error.contains("a calculator has to give a number") && error.contains("(Z > 1) ? 1 : invalid"), "{error}");
}

#[test]
fn a_missing_attribute_is_named_with_those_there_are() {
    let criterion = Criterion::parse("abs(Z - n[0].Intensty) < 0.15").unwrap();
    let error = criterion.check(&["X", "Y", "Z", "Intensity"]).unwrap_err().to_string();
    assert_eq!(
        error,
        "criterion, column 14: there is no attribute 'Intensty', did you mean 'Intensity'?; there are: X, Y, Z, Intensity
  abs(Z - n[0].Intensty) < 0.15
               ^"
    );
    let error = criterion.check(&["z"]).unwrap_err().to_string();
    assert!(error.contains("there is no attribute 'Intensty'; there are: z"), "{error}");
    criterion.check(&["z".to_owned(), "INTENSTY".to_owned()]).unwrap();
    assert!(criterion.bind(|_| None).unwrap_err().to_string().contains("there is no attribute 'Z'"));
}

#[test]
fn long_texts_are_shown_in_part() {
    let text = format!("{}Z Z{}", "Z + ".repeat(100), " + Z".repeat(100));
    let error = Criterion::parse(&text).unwrap_err().to_string();
    let lines: Vec<&str> = error.lines().collect();
    assert!(lines[0].contains("column 403") && lines[1].chars().count() < 110, "{error}");
    let caret = lines[2].chars().count() - 1;
    assert_eq!(lines[1].chars().skip(caret - 2).take(3).collect::<String>(), "Z Z", "{error}");
}

#[test]
fn length_and_nesting_are_bounded() {
    let deep = |levels: usize| format!("{}Z{} > 1", "(".repeat(levels), ")".repeat(levels));
    assert!(Criterion::parse(&deep(64)).is_ok());
    assert!(Criterion::parse(&deep(65)).unwrap_err().to_string().contains("column 65: brackets are nested too deeply"));
    // A bracket in a name cannot hide one outside.
    let hidden = format!("{}Z{} > 1", "([)]+".repeat(500), ")".repeat(500));
    assert!(Criterion::parse(&hidden).unwrap_err().to_string().contains("nested too deeply"));
    assert!(Criterion::parse(&format!("Z > {}1", " ".repeat(5000))).unwrap_err().to_string().contains("too long"));
    assert!(Criterion::parse(&format!("{}true", "!".repeat(4000))).unwrap().is_always_true());
    let minus = format!("{}Z", "-".repeat(4000));
    assert_eq!(number(&minus), 3.0);
    let sum = format!("Z{}", "+Z".repeat(2000));
    assert_eq!(number(&sum), 6003.0);
    let any = format!("Z>9{}", " or Z==3".repeat(500));
    assert!(truth(&any));
    let power = format!("Z{}", "^Z".repeat(100));
    let error = Calculator::parse(&power).unwrap_err().to_string();
    assert!(error.contains("too many values wait for each other"), "{error}");
    let choices = format!("{}5", "Z>4?1:".repeat(600));
    assert!(Calculator::parse(&choices).is_ok_and(|c| c.bind(column).unwrap().value(0) == 5.0));
}

fn is_symmetric(text: &str) -> Symmetry {
    Criterion::parse(text).unwrap_or_else(|error| panic!("{error}")).symmetry()
}

#[test]
fn symmetric_criteria_are_proven() {
    for text in [
        "true",
        "normalX*n[0].normalX+normalY*n[0].normalY+normalZ*n[0].normalZ>0.996",
        "abs(Z-n[0].Z)<0.15",
        "abs(n[0].Z-Z)<0.15 and dist < 2 and dist2d < 1 and angle <= 5",
        "(Z-n[0].Z)^2 + (X-n[0].X)^2 < 4",
        "(Z-n[0].Z)*(Z-n[0].Z) < 4",
        "(Z-n[0].Z)*(n[0].Z-Z) > -4",
        "abs(dz) < 0.1 or dz^2 < 3 or cos(dz) > 0.5 or abs(sin(dz)) < 0.5",
        "dz < 0.15 and dz > -0.15",
        "-0.15 < dz and dz < 0.15",
        "Z - n[0].Z < 0.15 and n[0].Z - Z < 0.15",
        "Z < n[0].Z + 0.15 and n[0].Z < Z + 0.15",
        "Classification == n[0].Classification",
        "n[0].Classification - Classification = 0",
        "Classification == 2 and n[0].Classification == 2",
        "not (Classification != 2 or n[0].Classification <> 2)",
        "Class[2] and n[0].Class[2] or Class[6] and n[0].Class[6]",
        "Class[2] == n[0].Class[2]",
        "Class[2] != n[0].Class[2]",
        "Region[0 0 1 1 1 0] and Z > 3 or n[0].Region[0 0 1 1 1 0] and n[0].Z > 3",
        "max(Z, n[0].Z) - min(n[0].Z, Z) < 1",
        "max(Z, max(n[0].Z, 3)) < 1",
        "max(Z - n[0].Z, n[0].Z - Z) < 1",
        "abs(Intensity - n[0].Intensity) / (Intensity + n[0].Intensity) < 0.1",
        "hypot(X - n[0].X, n[0].Y - Y) < 2",
        "abs(NormalX*n[0].NormalX + NormalY*n[0].NormalY) > 0.9 && valid(Z) && valid(n[0].Z)",
        "(Z > n[0].Z ? Z : n[0].Z) > 1 and (n[0].Z > Z ? n[0].Z : Z) > 1",
        "-(Z - n[0].Z) ^ 2 > -1",
        "2 * Z + 2 * n[0].Z - Z - n[0].Z > 3",
        "abs(deg(atan(Z)) - deg(atan(n[0].Z))) < 5",
        "(Z - n[0].Z) % 2 == 0",
    ] {
        assert_eq!(is_symmetric(text), Symmetry::Proven, "{text}");
    }
}

#[test]
fn asymmetric_criteria_come_with_an_example() {
    for text in [
        "Z > n[0].Z",
        "Z >= n[0].Z",
        "Z - n[0].Z < 0.15",
        "dz > 0",
        "Z > 3",
        "n[0].Classification == 2",
        "Class[2]",
        "n[0].Class[2] and Class[6]",
        "Region[0 0 10 0 10 10 0 10]",
        "abs(Z - 2 * n[0].Z) < 1",
        "atan2(Z, n[0].Z) < 0.5",
        "Z ^ n[0].Z < 4",
        "Z / n[0].Z < 1",
        "valid(SigmaZ)",
        "Intensity * 1000 < n[0].Intensity",
        "angle < 3 and Z > n[0].Z + 0.001",
        "abs(Z - n[0].Z) < 0.15 + 0.01 * Intensity",
    ] {
        let Symmetry::Disproven { example } = is_symmetric(text) else { panic!("{text}: {:?}", is_symmetric(text)) };
        assert!(example.starts_with("with ") && example.contains("hold"), "{example}");
    }
    let Symmetry::Disproven { example } = is_symmetric("Z > n[0].Z") else { panic!() };
    assert!(example.contains("Z = ") && example.contains("n[0].Z = ") && !example.contains("invalid"), "{example}");
}

#[test]
fn what_is_neither_proven_nor_disproven_is_unknown() {
    for text in ["(Z > n[0].Z ? Z - n[0].Z : n[0].Z - Z) < 1", "exp(dz) + 1 / exp(dz) < 2.5"] {
        assert_eq!(is_symmetric(text), Symmetry::Unknown, "{text}");
    }
}
