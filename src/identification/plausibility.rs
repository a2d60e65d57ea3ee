//! Values in a study engineer's units that an ordinary load does not have.
//!
//! A fit may describe P and Q well with a motor that nobody has. Such a value is published as it is,
//! with a note that names the range and where it comes from; it is never changed and never silent.
//! The ranges are on the base of the motor's own initial power, as the estimates are: a value on the
//! rating times the loading for reactances, over it for the inertia.

use super::{ParameterEstimate, precision::Precision};

/// A range outside of which a value needs an explanation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plausible {
    /// Name of the quantity in the parameter set.
    pub name: &'static str,
    /// Least ordinary value.
    pub least: f64,
    /// Largest ordinary value.
    pub largest: f64,
    /// Where the range comes from.
    pub source: &'static str,
}

/// Typical aggregated motor of the Common Information Model (`LoadMotor` of the dynamics profile,
/// IEC 61970-302): H 0.4 s, X 3.2, X' 0.15, T0' 1 s on the rating, loading 0.8; verified in public
/// copies of the class. Motors A to C of the WECC composite load model: H 0.1 to 1.0 s; read in
/// secondary sources only. Bounds are these values over loadings 0.5 to 0.9, with a factor of two to
/// spare where one value only is published.
pub const PLAUSIBLE: [Plausible; 7] = [
    Plausible {
        name: "inertia_h",
        least: 0.1,
        largest: 3.0,
        source: "H 0.1 to 1.5 s on the rating (CIM LoadMotor: 0.4 s; WECC motors A to C: 0.1 to 1.0 s)",
    },
    Plausible {
        name: "x_prime_motor_base",
        least: 0.04,
        largest: 0.35,
        source: "X' 0.08 to 0.35 on the rating (CIM LoadMotor: 0.15)",
    },
    Plausible {
        name: "slip",
        least: 0.002,
        largest: 0.08,
        source: "rated slip 0.5 to 5 % of ordinary motors, not verified in a standard",
    },
    Plausible {
        name: "critical_voltage",
        least: 0.3,
        largest: 0.85,
        source: "breakdown torque 1.4 to 11 times the load's; not verified in a standard",
    },
    Plausible {
        name: "T0_prime",
        least: 0.04,
        largest: 2.0,
        source: "T0' 0.1 to 2 s (CIM LoadMotor: 1 s)",
    },
    Plausible {
        name: "Kpm",
        least: 0.05,
        largest: 0.9,
        source: "chosen: a motor share beyond it says that the static part found no use",
    },
    Plausible {
        name: "x_motor_base",
        least: 1.0,
        largest: 6.0,
        source: "X 1.8 to 4 on the rating (CIM LoadMotor: 3.2)",
    },
];

/// A note for each value outside its ordinary range, in the order of [`PLAUSIBLE`]. A quantity that
/// the data leave open is noted only where its whole interval lies outside.
#[must_use]
pub fn notes(parameters: &[ParameterEstimate], derived: &[ParameterEstimate]) -> Vec<String> {
    let all = || parameters.iter().chain(derived);
    PLAUSIBLE
        .iter()
        .filter_map(|range| {
            let estimate = all().find(|p| p.name == range.name)?;
            let (low, high) = estimate
                .interval
                .unwrap_or((estimate.value, estimate.value));
            // Written so that NaN is noted.
            let ordinary = low <= range.largest && high >= range.least;
            (!ordinary).then(|| note(estimate, range))
        })
        .collect()
}

fn note(estimate: &ParameterEstimate, range: &Plausible) -> String {
    let unit = match estimate.unit.as_str() {
        "1" => String::new(),
        unit => format!(" {unit}"),
    };
    format!(
        "{} {:.3}{unit} is outside the ordinary range {} to {}: {}",
        estimate.name, estimate.value, range.least, range.largest, range.source
    )
}

/// Notes on how well the coordinates are determined: rank below full, a condition number that makes
/// standard errors doubtful.
#[must_use]
pub fn precision_notes(precision: &Precision, free: usize) -> Vec<String> {
    /// Beyond it a change of the data in the fourth digit moves the estimates by their own size.
    const CONDITION_MAX: f64 = 1e4;
    let mut notes = Vec::new();
    if precision.rank < free {
        notes.push(format!(
            "rank {} of {free}: the data leave a direction of the coordinates open",
            precision.rank
        ));
    }
    if precision.condition > CONDITION_MAX {
        notes.push(format!(
            "condition {:.0}: some combination of coordinates is hardly determined",
            precision.condition
        ));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(name: &str, value: f64, interval: Option<(f64, f64)>) -> ParameterEstimate {
        ParameterEstimate {
            name: name.to_owned(),
            meaning: String::new(),
            value,
            unit: "s".to_owned(),
            lower: 0.0,
            upper: 10.0,
            standard_error: None,
            at_bound: false,
            identifiable: true,
            interval,
        }
    }

    #[test]
    fn a_value_outside_is_named_with_range_and_source() {
        let list = notes(&[], &[estimate("inertia_h", 7.5, None)]);
        assert_eq!(list.len(), 1);
        assert!(list[0].starts_with("inertia_h 7.500 s is outside the ordinary range 0.1 to 3"));
        assert!(list[0].contains("CIM"));
        assert_eq!(notes(&[], &[estimate("slip", f64::NAN, None)]).len(), 1);
    }

    #[test]
    fn an_ordinary_motor_and_an_open_interval_that_reaches_the_range_need_no_note() {
        assert!(notes(&[], &[estimate("inertia_h", 0.7, None)]).is_empty());
        let open = estimate("T0_prime", 3.0, Some((1.0, 4.0)));
        assert!(notes(&[open], &[]).is_empty());
        let beyond = estimate("T0_prime", 3.0, Some((2.5, 4.0)));
        assert_eq!(notes(&[beyond], &[]).len(), 1);
    }
}
