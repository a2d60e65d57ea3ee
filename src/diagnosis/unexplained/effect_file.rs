//! The description as an effect file: coefficients as amplitudes, thresholds and times as shapes that a
//! fit may move.

use std::fmt::Write;

use super::{
    selection::{Chosen, Description},
    term::{Class, Shape, ShapeKind, Term},
};

/// Parameters of an effect file.
const PARAMETERS_MAX: usize = 12;
/// Smallest power worth reporting, pu of P0.
const MEANINGFUL_PU: f64 = 0.005;
/// Bounds of a coefficient, of its value.
const COEFFICIENT_ROOM: f64 = 4.0;
/// How far a threshold may move, pu, and a time, as a factor.
const THRESHOLD_ROOM: f64 = 0.12;
const TIME_ROOM: f64 = 6.0;
/// Thresholds of relays and hinges stay within these, so that they are silent at rest.
const THRESHOLD_RANGE: [f64; 2] = [0.3, 0.985];

/// The file; `None` when there is no term.
pub(super) fn text(terms: &[Term], found: &Description) -> Option<String> {
    let first = found.chosen.first()?;
    let mut file = Parts::default();
    for chosen in &found.chosen {
        let term = &terms[chosen.term];
        let count = term.shapes().len() + chosen.coefficients.iter().filter(|c| **c != 0.0).count();
        if file.count + count <= PARAMETERS_MAX {
            file.add(term, chosen);
        }
    }
    let mut text = String::new();
    let head = &terms[first.term];
    // Writing to a string does not fail.
    let _ = write!(
        text,
        "# A sparse description of what a fitted model left of the measurement: a hypothesis to be\n\
         # fitted, not a law. The format is explained in docs/adding-an-effect.md.\n\
         name = \"unexplained_{}\"\n\
         title = \"{}\"\n\
         source = \"orthogonal least squares on the residual of a fitted model; no published model\"\n",
        word(head.class()),
        title(head.class()),
    );
    text.push_str(&needs(head));
    text.push_str(&file.parameters);
    text.push_str("\n[power]\n");
    for (key, sum) in ["active", "reactive"].into_iter().zip(&file.power) {
        if !sum.is_empty() {
            let _ = writeln!(text, "{key} = \"{}\"", sum.join(" + "));
        }
    }
    Some(text)
}

#[derive(Default)]
struct Parts {
    parameters: String,
    count: usize,
    power: [Vec<String>; 2],
    terms: usize,
}

impl Parts {
    fn add(&mut self, term: &Term, chosen: &Chosen) {
        self.terms += 1;
        let number = self.terms;
        let shapes = term.shapes();
        let symbols: Vec<String> = shapes
            .iter()
            .map(|s| format!("{}_{number}", letter(s.kind)))
            .collect();
        let formula = term.formula_with(&symbols);
        let per_unit = largest_per_unit(chosen);
        for (c, channel) in ["active", "reactive"].into_iter().enumerate() {
            let value = chosen.coefficients[c];
            if value == 0.0 {
                continue;
            }
            let symbol = format!("{}_{number}", ["a", "b"][c]);
            let name = format!("{channel}_{number}");
            self.amplitude(&name, &symbol, term.coefficient_unit(), value, per_unit);
            self.power[c].push(format!("{symbol}*{formula}"));
        }
        for (shape, symbol) in shapes.iter().zip(&symbols) {
            // A grid over more than one term would be a product of grids.
            self.shape(number, shape, symbol, number == 1);
        }
    }

    fn amplitude(&mut self, name: &str, symbol: &str, unit: &str, value: f64, per_unit: f64) {
        self.count += 1;
        let meaningful = MEANINGFUL_PU / per_unit;
        let room = (COEFFICIENT_ROOM * value.abs()).max(4.0 * meaningful);
        let _ = write!(
            self.parameters,
            "\n[[parameters]]\nname = \"{name}\"\nsymbol = \"{symbol}\"\nunit = \"{unit}\"\n\
             role = \"two_sided\"\nmeaningful = {}\nlower = {}\ntypical = {}\nupper = {}\n",
            rounded(meaningful),
            rounded(-room),
            rounded(value),
            rounded(room),
        );
    }

    fn shape(&mut self, number: usize, shape: &Shape, symbol: &str, with_grid: bool) {
        self.count += 1;
        let x = shape.value;
        let [low, high] = THRESHOLD_RANGE;
        let (name, unit, lower, upper, prior, grid) = match shape.kind {
            ShapeKind::Threshold if x > 1.0 => (
                "voltage#",
                "1",
                1.0,
                x + THRESHOLD_ROOM,
                "{ deviation = 0.04 }",
                vec![x],
            ),
            ShapeKind::Threshold => (
                "voltage#",
                "1",
                (x - THRESHOLD_ROOM).max(low),
                (x + THRESHOLD_ROOM).min(high),
                "{ deviation = 0.06 }",
                vec![(x - 0.03).max(low), x, (x + 0.03).min(high)],
            ),
            ShapeKind::Delay => ("delay#_s", "s", 0.0, 0.5, "{ deviation = 0.06 }", vec![x]),
            ShapeKind::Time => (
                "time#_s",
                "s",
                (x / TIME_ROOM).max(0.004),
                x * TIME_ROOM,
                "{ deviation = 0.8, scale = \"logarithmic\" }",
                vec![0.6 * x, x, 1.7 * x],
            ),
            ShapeKind::Exponent => ("exponent#", "1", 0.3, 12.0, "{ deviation = 2.0 }", vec![x]),
        };
        // The unit stays last.
        let name = name.replace('#', &format!("_{number}"));
        let _ = write!(
            self.parameters,
            "\n[[parameters]]\nname = \"{name}\"\nsymbol = \"{symbol}\"\nunit = \"{unit}\"\n\
             role = \"shape\"\nlower = {}\ntypical = {}\nupper = {}\nprior = {prior}\n",
            rounded(lower),
            rounded(x),
            rounded(upper),
        );
        if with_grid {
            let grid: Vec<String> = grid.into_iter().map(rounded).collect();
            let _ = writeln!(self.parameters, "grid = [{}]", grid.join(", "));
        }
    }
}

/// Largest power per unit of the coefficient.
fn largest_per_unit(chosen: &Chosen) -> f64 {
    let [p, q] = chosen.coefficients;
    let larger = p.abs().max(q.abs());
    if larger > 0.0 && chosen.largest_pu > 0.0 {
        chosen.largest_pu / larger
    } else {
        1.0
    }
}

fn letter(kind: ShapeKind) -> &'static str {
    match kind {
        ShapeKind::Threshold => "V",
        ShapeKind::Delay => "D",
        ShapeKind::Time => "T",
        ShapeKind::Exponent => "n",
    }
}

fn needs(term: &Term) -> String {
    match (term.class(), term.threshold()) {
        (Class::Frequency, _) => "\n[needs]\nfrequency = true\n".to_owned(),
        (_, Some(threshold)) if threshold < 1.0 => {
            format!("\n[needs]\nvoltage_below = {}\n", rounded(threshold))
        }
        _ => String::new(),
    }
}

fn word(class: Class) -> &'static str {
    match class {
        Class::Static => "static",
        Class::Quick => "rate",
        Class::Dynamic => "lag",
        Class::Recovering => "recovery",
        Class::Frequency => "frequency",
        Class::Lasting => "latched",
        Class::Returning => "returning",
        Class::WhileLow => "while_low",
        Class::Drift => "drift",
    }
}

fn title(class: Class) -> &'static str {
    match class {
        Class::Static => "Unexplained: bent function of the voltage",
        Class::Quick => "Unexplained: follows the rate of change of the voltage",
        Class::Dynamic => "Unexplained: lags behind the voltage",
        Class::Recovering => "Unexplained: recovers after a change of the voltage",
        Class::Frequency => "Unexplained: follows the frequency",
        Class::Lasting => "Unexplained: switches in deep dips and stays",
        Class::Returning => "Unexplained: switches in deep dips and returns",
        Class::WhileLow => "Unexplained: switches while the voltage is low",
        Class::Drift => "Unexplained: drifts",
    }
}

/// Four significant digits, as TOML reads a float.
fn rounded(x: f64) -> String {
    let text = format!("{x:.3e}");
    let value: f64 = text.parse().unwrap_or(x);
    let plain = format!("{value}");
    if plain.contains(['.', 'e']) {
        plain
    } else {
        format!("{plain}.0")
    }
}
