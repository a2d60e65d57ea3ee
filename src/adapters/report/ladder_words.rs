//! What the severity ladder shows, in a sentence.

/// Rank correlation of error and lowest voltage from which the error is said to grow with depth.
const GROWS: f64 = -0.5;
/// Largest error over noise of events that are all followed.
const FOLLOWED: f64 = 1.5;

/// One event: its name, lowest voltage and error over noise.
pub(super) type Rung<'a> = (&'a str, f64, f64);

/// Whether the error grows with the depth, and which events say so.
pub(super) fn ladder_in_words(rungs: &[Rung<'_>]) -> String {
    let finite = |rung: &&Rung<'_>| rung.1.is_finite() && rung.2.is_finite();
    let rungs: Vec<Rung<'_>> = rungs.iter().filter(finite).copied().collect();
    let deepest = rungs.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    let worst = rungs.iter().max_by(|a, b| a.2.total_cmp(&b.2));
    let (Some(deepest), Some(worst), true) = (deepest, worst, rungs.len() > 2) else {
        return "Residual over noise of each event against its lowest voltage.".to_owned();
    };
    if worst.2 <= FOLLOWED {
        return format!(
            "Events of every depth are followed: the largest residual is {:.2} times the noise ({}).",
            worst.2, worst.0
        );
    }
    if rank_correlation(&rungs) <= GROWS {
        return format!(
            "The model fails first where the voltage falls furthest: the residual grows with the depth, to {:.2} \
             times the noise ({} at {:.3} of the voltage before).",
            worst.2, worst.0, worst.1
        );
    }
    format!(
        "The residual does not grow with the depth: it is largest in {} ({:.3} of the voltage before, {:.2} times \
         the noise); the deepest is {} ({:.3}, {:.2} times).",
        worst.0, worst.1, worst.2, deepest.0, deepest.1, deepest.2
    )
}

/// Spearman's, of lowest voltage and error.
fn rank_correlation(rungs: &[Rung<'_>]) -> f64 {
    // How many are below less how many are above: twice the rank about its mean, equal values alike.
    let ranks = |of: fn(&Rung<'_>) -> f64| -> Vec<f64> {
        let rank = |rung: &Rung<'_>| {
            let below = rungs.iter().filter(|other| of(other) < of(rung)).count();
            let above = rungs.iter().filter(|other| of(other) > of(rung)).count();
            below as f64 - above as f64
        };
        rungs.iter().map(rank).collect()
    };
    let (voltage, error) = (ranks(|rung| rung.1), ranks(|rung| rung.2));
    let product = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let scale = (product(&voltage, &voltage) * product(&error, &error)).sqrt();
    if scale > 0.0 {
        product(&voltage, &error) / scale
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ladder_says_that_deep_events_fail_only_where_they_do() {
        let deep = [
            ("a", 0.5, 8.0),
            ("b", 0.7, 4.0),
            ("c", 0.9, 1.1),
            ("d", 0.97, 1.2),
        ];
        let said = ladder_in_words(&deep);
        assert!(
            said.contains("fails first") && said.contains("8.00 times the noise (a at"),
            "{said}"
        );
        let shallow = [
            ("a", 0.5, 1.1),
            ("b", 0.7, 1.0),
            ("c", 0.97, 4.1),
            ("d", 0.99, 2.0),
        ];
        let said = ladder_in_words(&shallow);
        assert!(
            said.contains("does not grow") && said.contains("largest in c"),
            "{said}"
        );
        let followed = [("a", 0.5, 1.1), ("b", 0.7, 1.0), ("c", 0.97, 0.9)];
        assert!(ladder_in_words(&followed).contains("every depth are followed"));
        assert!(
            ladder_in_words(&[("a", 0.5, f64::NAN)]).starts_with("Residual over noise of each")
        );
    }
}
