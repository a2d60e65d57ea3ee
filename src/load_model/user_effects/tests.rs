//! Effect files as a user meets them: what a fault looks like.

use super::{EffectFile, Problem};
use crate::load_model::{Drive, TerminalInput};

/// A sound file of one parameter, a time and a state, in which parts are replaced.
pub(super) const SOUND: &str = r#"
name = "recovery"
title = "Recovery"
source = "an invention for a test"
[[parameters]]
name = "gain"
symbol = "k"
unit = "1"
role = "two_sided"
meaningful = 0.1
lower = -2.0
typical = 0.8
upper = 2.0
[[parameters]]
name = "time_s"
symbol = "T"
unit = "s"
role = "shape"
lower = 0.1
typical = 4.0
upper = 300.0
prior = { deviation = 1.5, scale = "logarithmic" }
[[states]]
name = "z"
unit = "1"
initial = "1"
derivative = "(v - z)/T"
[power]
active = "k*(v - z)"
"#;

fn problems(text: &str) -> Vec<Problem> {
    EffectFile::parse(text).err().unwrap_or_default()
}

/// The problems of the sound file with one replacement, as text.
fn with(from: &str, to: &str) -> Vec<String> {
    assert!(SOUND.contains(from), "{from}");
    let found = problems(&SOUND.replacen(from, to, 1));
    found.iter().map(ToString::to_string).collect()
}

#[test]
fn the_sound_file_is_sound() {
    assert_eq!(problems(SOUND), vec![]);
}

/// What is replaced, by what, and what is told.
const EXPRESSIONS: &[(&str, &str, &str)] = &[
    (
        "k*(v - z)",
        "k*(V - z)",
        "29:14: unknown variable `V`; did you mean `v`?",
    ),
    (
        "k*(v - z)",
        "gain*(v - z)",
        "29:11: unknown variable `gain`; its symbol is `k`",
    ),
    (
        "k*(v - z)",
        "k*(v - z",
        "29:19: unexpected end of the expression; the bracket at",
    ),
    (
        "k*(v - z)",
        "k*(v - T)",
        "29:16: units differ: 1 and s; powers",
    ),
    (
        "k*(v - z)",
        "k*lags(v, T)",
        "29:13: unknown function `lags`; did you mean `lag`?",
    ),
    (
        "k*(v - z)",
        "k*lag(v)",
        "29:13: `lag` takes 2 arguments, 1 given; write lag(x, time",
    ),
    (
        "k*(v - z)",
        "k*(v - lag(v, z))",
        "29:18: the second argument has the unit 1, not s",
    ),
    (
        "k*(v - z)",
        "k*exp(T)",
        "29:17: the argument has the unit s",
    ),
    (
        "k*(v - z)",
        "k*(v - z)*T",
        "29:11: the expression has the unit s, and 1 is needed",
    ),
    (
        "k*(v - z)",
        "k v",
        "29:13: unexpected name `v`; an operator",
    ),
    (
        "k*(v - z)",
        "k*(v - z)*(1/0)",
        "29:23: this constant is not finite",
    ),
    (
        "(v - z)/T",
        "(v - z)/T + p_m/1s",
        "27:27: `p_m` is not known to states",
    ),
    (
        "(v - z)/T",
        "v - z",
        "27:15: the expression has the unit 1, and 1/s is needed",
    ),
    (
        "initial = \"1\"",
        "initial = \"z\"",
        "26:12: the initial value refers to the state",
    ),
    (
        "initial = \"1\"",
        "initial = \"lag(v, T)\"",
        "26:12: `lag` keeps a state",
    ),
];

#[test]
fn expressions_are_told_where_and_how() {
    for (from, to, expected) in EXPRESSIONS {
        let found = with(from, to);
        let message = found.first().map_or("", String::as_str);
        assert!(message.starts_with(expected), "{to}: {found:?}");
    }
}

/// What is replaced, by what, and what is told.
const DECLARATIONS: &[(&str, &str, &str)] = &[
    (
        "lower = -2.0",
        "lower = 3.0",
        "`lower` 3 is not below `upper` 2",
    ),
    (
        "typical = 0.8",
        "typical = 8",
        "`typical` 8 is outside the bounds",
    ),
    (
        "meaningful = 0.1\n",
        "",
        "entry 1 of [[parameters]] has no `meaningful`",
    ),
    (
        "role = \"two_sided\"",
        "role = \"shpae\"",
        "unknown role `shpae`",
    ),
    (
        "two_sided",
        "one_sided",
        "11:9: the effect is not absent at the lower bound -2 of the one-sided amplitude `k`; that bound",
    ),
    (
        "title = ",
        "version = \"a\"\ntitle = ",
        "`version` is a text; write a number, without quotes",
    ),
    ("unit = \"s\"", "unit = \"ms\"", "unknown unit `ms`"),
    (
        "symbol = \"T\"",
        "symbol = \"t\"",
        "`t` is a variable or function already",
    ),
    (
        "symbol = \"T\"",
        "symbol = \"k\"",
        "`k` stands for two things",
    ),
    (
        "title = ",
        "titel = ",
        "unknown key `titel` in the file; did you mean `title`?",
    ),
    (
        "title = ",
        "summary = ",
        "unknown key `summary` in the file; known: name, title, kind, source, version, resembles, excludes, needs, parameters, states, power",
    ),
    (
        "name = \"recovery\"",
        "name = \"My Effect\"",
        "`My Effect` is no effect name",
    ),
    (
        "lower = 0.1",
        "lower = 0.0",
        "a logarithmic prior on a range that reaches 0",
    ),
    (
        "prior = { deviation = 1.5, scale = \"logarithmic\" }",
        "",
        "a shape needs a prior",
    ),
    (
        "upper = 2.0",
        "upper = inf",
        "`upper` is not a finite decimal number",
    ),
    (
        "[power]",
        "[powers]",
        "unknown key `powers` in the file; did you mean `power`?",
    ),
    ("an invention for a test", "me", "`source` has 2 characters"),
    (
        "typical = 4.0",
        "typical = 4.0\ngrid = [0.01]",
        "grid point 0.01 is outside",
    ),
    (
        "[power]",
        "[power]\nreactive = 3",
        "`reactive` is a whole number; write a text",
    ),
    (
        "name = \"recovery\"",
        "name = \"recovery\"\nkind = \"instrument\"",
        "kind `instrument`",
    ),
];

#[test]
fn declarations_are_told_where_and_how() {
    for (from, to, expected) in DECLARATIONS {
        let found = with(from, to);
        let told = found.iter().any(|p| p.contains(expected));
        assert!(told, "{to}: {found:?}");
    }
}

#[test]
fn physics_is_checked_when_the_rest_is_sound() {
    let cases = [
        // 0.8 * 1 at v = 1.
        (
            "k*(v - z)",
            "k*v*z",
            "at rest the active power added is 8e-1 with k = 0.8",
        ),
        (
            "k*(v - z)",
            "k*(v - z) + df",
            "with neutral amplitudes the active power is",
        ),
        (
            "initial = \"1\"",
            "initial = \"0.5\"",
            "at rest state `z` changes by",
        ),
        ("k*(v - z)", "k*(v - z)/(v - 1.08)", "the active power is"),
        (
            "lower = 0.1",
            "lower = 1e-9",
            "state `z` moves at 1.000e9 /s",
        ),
        (
            "k*(v - z)",
            "k*(v - z)*latch(above(v, 0.9), T)",
            "at rest the condition of a timer",
        ),
        ("k*(v - z)", "k*(v - 1)", "no power depends on the state"),
    ];
    for (from, to, expected) in cases {
        let found = with(from, to);
        assert!(
            found.iter().any(|p| p.contains(expected)),
            "{to}: {found:?}"
        );
    }
}

#[test]
fn all_faults_are_told_at_once_in_order() {
    let text = SOUND
        .replace("title = ", "titel = ")
        .replace("(v - z)/T", "(v - x)/T")
        .replace("k*(v - z)", "k*(v - y)");
    let found = problems(&text);
    assert_eq!(found.len(), 3, "{found:?}");
    assert!(found.is_sorted());
}

/// What is replaced, by what, and all that is told.
const ALONE: &[(&str, &str, &str)] = &[
    ("unit = \"s\"", "unit = \"ms\"", "16:9: unknown unit `ms`"),
    (
        "unit = \"s\"\n",
        "",
        "14:1: entry 2 of [[parameters]] has no `unit`",
    ),
    (
        "symbol = \"T\"\n",
        "",
        "14:1: entry 2 of [[parameters]] has no `symbol`",
    ),
    (
        "symbol = \"T\"",
        "symbol = \"v\"",
        "16:11: `v` is a variable",
    ),
    (
        "meaningful = 0.1\n",
        "",
        "5:1: entry 1 of [[parameters]] has no `meaningful`",
    ),
    (
        "meaningful = 0.1",
        "meaningfull = 0.1",
        "10:1: unknown key `meaningfull`",
    ),
    (
        "role = \"two_sided\"",
        "role = \"shpae\"",
        "9:9: unknown role",
    ),
    (
        "name = \"z\"\nunit = \"1\"",
        "name = \"z\"\nunit = \"%\"",
        "26:9: unknown unit `%`",
    ),
    (
        "active = ",
        "activ = ",
        "30:1: unknown key `activ` in [power]; did you mean `active`?",
    ),
    ("title = ", "titel = ", "3:1: unknown key `titel`"),
];

#[test]
fn a_fault_is_told_without_its_consequences() {
    for (from, to, expected) in ALONE {
        let found = with(from, to);
        assert_eq!(found.len(), 1, "{to}: {found:?}");
        let message = expected.split_once(": ").map_or("", |(_, message)| message);
        assert!(found[0].contains(message), "{to}: {found:?}");
    }
    let none: String = SOUND.split("[[parameters]]").take(1).collect();
    let found = problems(&format!("{none}[power]\nactive = \"k*v\"\n"));
    assert_eq!(found.len(), 1, "{found:?}");
    let shapes = SOUND.replace(
        "role = \"two_sided\"\nmeaningful = 0.1",
        "role = \"shape\"\nprior = { deviation = 1 }",
    );
    let found = problems(&shapes);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].to_string().starts_with("5:1: no amplitude"),
        "{found:?}"
    );
}

#[test]
fn physics_is_told_at_the_expression_with_its_cure() {
    let reactive = "active = \"k*(v - z)\"\nreactive = \"k*v\"";
    let cases = [
        (
            "active = \"k*(v - z)\"",
            reactive,
            "30:13: at rest the reactive power",
        ),
        (
            "initial = \"1\"",
            "initial = \"0.5\"",
            "27:15: at rest state `z`",
        ),
        ("lower = 0.1", "lower = 1e-9", "27:15: state `z` moves"),
        (
            "k*(v - z)",
            "k*(v - z)/(1 - v)",
            "29:11: at rest the active power added is NaN",
        ),
        (
            "k*(v - z)",
            "k*(v - z) + df",
            "29:11: with neutral amplitudes",
        ),
        (
            "k*(v - z)",
            "k*(v - z)*lag(v, 1e-9*T)",
            "29:11: a state kept by a function in `active`",
        ),
    ];
    for (from, to, expected) in cases {
        let found = with(from, to);
        assert!(
            found.iter().any(|p| p.starts_with(expected)),
            "{to}: {found:?}"
        );
        let divided = found.iter().filter(|p| p.contains("NaN"));
        assert!(
            divided.into_iter().all(|p| p.contains("guard")),
            "{found:?}"
        );
    }
}

#[test]
fn precedence_is_that_of_mathematics() {
    // At rest: -1^2 + 1 = 0, 2^3^2 = 512, 6/3*2 = 4, 1 - 1 - 1 = -1.
    for zero in [
        "-v^2 + 1",
        "2^3^2 - 512",
        "6/3*2 - 4",
        "1 - 1 - 1 + v",
        "+v - -v - 2",
        "2^-1 - 0.5",
    ] {
        let found = with("k*(v - z)", &format!("k*(({zero}) + v - z)"));
        let rest: Vec<&String> = found.iter().filter(|p| p.contains("at rest")).collect();
        assert!(rest.is_empty(), "{zero}: {found:?}");
    }
}

#[test]
fn equal_calls_keep_one_state() {
    let power = "active = \"k*(v - lag(v, T))\"\nreactive = \"k*(v - lag(v, T)) + k*(v - z)\"";
    let text = SOUND.replace("active = \"k*(v - z)\"", power);
    let file = EffectFile::parse(&text).unwrap();
    let declaration = file.into_effect().declaration();
    assert_eq!(declaration.states.len(), 2);
    assert_eq!(declaration.states[1].unit, "1");
}

/// [`SOUND`] with a root that ends at 0.44 of V0, below the dip of the checks.
fn with_a_root() -> EffectFile {
    let root = "k*(v - z) + k*(sqrt(v - 0.44) - sqrt(0.56))";
    EffectFile::parse(&SOUND.replace("k*(v - z)", root)).unwrap()
}

#[test]
fn what_ends_in_a_deep_dip_is_a_warning_at_its_expression() {
    assert_eq!(EffectFile::parse(SOUND).unwrap().warnings(), []);
    let file = with_a_root();
    let [warning] = file.warnings() else {
        panic!("{:?}", file.warnings());
    };
    let told = warning.to_string();
    assert!(
        told.starts_with("29:11: active = \"k*(v - z) + k*(sqrt"),
        "{told}"
    );
    assert!(
        told.contains("at v = 0.43") && told.contains("max(v - 0.44, 0)"),
        "{told}"
    );
    let guarded = "k*(v - z) + k*(sqrt(max(v - 0.44, 0)) - sqrt(0.56))";
    let guarded = EffectFile::parse(&SOUND.replace("k*(v - z)", guarded)).unwrap();
    assert_eq!(guarded.warnings(), []);
}

#[test]
fn an_event_says_which_expression_ends_where() {
    let effect = with_a_root().into_effect();
    let samples = 60;
    let voltage = |k: usize| if (20..30).contains(&k) { 0.42 } else { 1.0 };
    let terminal = TerminalInput {
        real: (0..=samples * 8).map(|i| voltage(i / 8)).collect(),
        imaginary: vec![0.0; samples * 8 + 1],
        points_per_sample: 8,
        sample_interval_s: 0.02,
        jumps: vec![false; samples],
        dense: vec![false; samples],
        synchronous_speed_rad_s: 314.0,
    };
    let p = [0.8, 4.0];
    let found = effect
        .no_value(&p, &Drive::new(&terminal, &[], 0.3))
        .unwrap();
    assert!(found.what.starts_with("active = \"k*(v - z)"), "{found:?}");
    assert!(
        (found.voltage - 0.42).abs() < 1e-12 && (found.time_s - 0.4).abs() < 1e-9,
        "{found:?}"
    );
    let of_sound = EffectFile::parse(SOUND).unwrap().into_effect();
    assert_eq!(
        of_sound.no_value(&p, &Drive::new(&terminal, &[], 0.3)),
        None
    );
    // A state would be lost for good.
    let lagged = "k*(v - z + lag(sqrt(v - 0.44), T) - sqrt(0.56))";
    let refused = with("k*(v - z)", lagged);
    let told = "29:11: the rate of a state kept by a function in `active` is NaN";
    assert!(refused[0].starts_with(told), "{refused:?}");
}
