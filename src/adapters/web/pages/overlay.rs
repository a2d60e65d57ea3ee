//! Measurement and two models on one event: before and after an effect.

use std::sync::Arc;

use super::{
    super::{
        desk::Judged,
        plot::{Chart, Ink, Mark, span_of},
    },
    event_charts::{Power, Told, backdrop, powers, residual_panel},
};

/// Two models on one event.
pub(super) struct Overlay {
    pub(super) before: Arc<Judged>,
    pub(super) after: Arc<Judged>,
}

/// What a chart of an overlay is called, and its two models.
pub(super) struct Captions<'a> {
    pub(super) title: &'a str,
    pub(super) description: String,
    pub(super) before: &'a str,
    pub(super) after: &'a str,
}

/// P and Q, measured and by both models, and what both leave within the band of the noise.
pub(super) fn chart(overlay: &Overlay, captions: &Captions<'_>) -> Chart {
    let (before, after) = (&overlay.before.comparison, &overlay.after.comparison);
    let line = |name: &str, ink, y: &[f64], dashed| Mark::Line {
        name: name.to_owned(),
        ink,
        x: None,
        y: y.to_vec(),
        dashed,
    };
    let backdrop = backdrop(Some(after));
    let sets = powers(after);
    let told = Told {
        time_s: &after.time_s,
        sets: &sets,
        least: 0.004,
    };
    let curves = |power: Power| {
        let measured = |y: Vec<f64>| line("measured", Ink::Measured, &y, false);
        let without = |y: Vec<f64>| line(captions.before, Ink::Rival, &y, true);
        let with = |y: Vec<f64>| line(captions.after, Ink::Model, &y, false);
        told.panel(
            (power.title().to_owned(), 200),
            (backdrop.clone(), &[]),
            &[
                (power.measured(after), &measured),
                (power.model(before), &without),
                (power.model(after), &with),
            ],
        )
    };
    let left = |power| {
        let rival = Some((captions.before, before));
        residual_panel((captions.after, after), rival, power, &backdrop)
    };
    let panels = Power::BOTH.map(|power| [curves(power), left(power)]);
    let x = after.time_s.clone();
    Chart {
        id: "before-after".to_owned(),
        title: captions.title.to_owned(),
        description: captions.description.clone(),
        horizontal_title: "time from onset, s".to_owned(),
        horizontal: span_of(&x)
            .filter(|(low, high)| low < high)
            .unwrap_or((0.0, 1.0)),
        names: Vec::new(),
        x,
        linked: Some("time"),
        panels: panels.into_iter().flatten().collect(),
    }
}
