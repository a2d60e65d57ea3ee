//! What a fit leaves while nothing happens: beside it a misfit is to be read, not beside the assumed noise alone.

use super::case::Case;
use crate::identification::{
    composed::{ComposedFit, with_own_composition},
    intake::PreparedEvent,
};

/// Samples before an event that say something of its noise.
const SAMPLES_MIN: usize = 10;

/// Weighted squares per sample of all judged events before they begin, the mean of each event and channel taken out;
/// `None` where no event has so many samples.
pub(super) fn left_before_events(case: &Case<'_>, fit: &ComposedFit) -> Option<f64> {
    let scatter = &case.composed.scatter;
    let of_event = |event: &PreparedEvent| -> Vec<(f64, usize)> {
        let Some(curves) = with_own_composition(event, fit, scatter) else {
            return Vec::new();
        };
        let channels = [
            (&event.active, &curves.active, &event.active_deviation),
            (&event.reactive, &curves.reactive, &event.reactive_deviation),
        ];
        let before = (0..event.event_start).filter(|&k| event.used[k]);
        let before: Vec<usize> = before.collect();
        let rows = |(measured, modelled, deviation): (&Vec<f64>, &Vec<f64>, &Vec<f64>)| {
            let row = |&k: &usize| (measured[k] - modelled[k]) / deviation[k];
            about_mean(&before.iter().map(row).collect::<Vec<f64>>())
        };
        channels.into_iter().filter_map(rows).collect()
    };
    let all = case.judged.iter().flat_map(of_event);
    let (squares, count) = all.fold((0.0, 0), |(squares, count), (more, freedom)| {
        (squares + more, count + freedom)
    });
    (count > 0).then(|| squares / count as f64)
}

/// Squares about the mean and their degrees of freedom.
fn about_mean(rows: &[f64]) -> Option<(f64, usize)> {
    if rows.len() < SAMPLES_MIN {
        return None;
    }
    let mean = rows.iter().sum::<f64>() / rows.len() as f64;
    let squares = rows.iter().map(|row| (row - mean).powi(2)).sum();
    Some((squares, rows.len() - 1))
}

#[cfg(test)]
mod tests {
    use super::about_mean;

    #[test]
    fn a_constant_offset_is_no_noise() {
        assert!(about_mean(&[1.0; 9]).is_none());
        assert_eq!(about_mean(&[3.0; 12]), Some((0.0, 11)));
        let rows: Vec<f64> = (0..10).map(|k| 5.0 + f64::from(k % 2)).collect();
        let (squares, freedom) = about_mean(&rows).unwrap();
        assert!((squares - 2.5).abs() < 1e-12 && freedom == 9);
    }
}
