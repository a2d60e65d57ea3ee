//! Which ordinary disturbance would show an effect on which the events are silent.

use super::plain::Plain;
use crate::{
    identification::{
        composed::{self, ComposedFit, Foretold, Open, Scatter},
        intake::PreparedEvent,
    },
    load_model::{
        Structure,
        composed::ComposedModel,
        effect::{Declaration, Parameter},
    },
};

/// What is said where none of the ordinary disturbances does.
const NONE: &str = "none of twenty ordinary disturbances would by itself show more of it";

/// An effect, and the amplitudes that would have to show.
#[derive(Clone, Copy)]
pub(in crate::diagnosis) struct Silent<'a> {
    pub(in crate::diagnosis) declaration: &'static Declaration,
    pub(in crate::diagnosis) amplitude: &'a Parameter,
    /// The smallest worth reporting.
    pub(in crate::diagnosis) size: f64,
    /// The smallest that would have shown, or the largest there can be.
    pub(in crate::diagnosis) shown: f64,
}

/// Of each effect the first of `events` in which so much of it as is worth reporting, its shapes typical, would be told from
/// what the structure foretells, by weighted squares of at least `needed`: in words. Where there is none, the one in which
/// least of it would, if that is less than has shown.
pub(in crate::diagnosis) fn would_show(
    events: &[(Plain, PreparedEvent)],
    (structure, fit): (&Structure, &ComposedFit),
    silent: &[Silent<'_>],
    needed: f64,
    scatter: &Scatter,
) -> Vec<String> {
    let open = Open::default();
    let foretold: Vec<Option<Foretold<'_>>> = (events.iter())
        .map(|(_, event)| Foretold::new(event, fit, &open, scatter))
        .collect();
    let of = |one: &Silent<'_>| {
        let (model, parameters) = with_it(structure, fit, one)?;
        let mut best: Option<(f64, Plain)> = None;
        for ((plain, event), foretold) in events.iter().zip(&foretold) {
            let answer = composed::answer(event, &model, &parameters);
            let distance = answer.and_then(|answer| foretold.as_ref()?.distance(&answer));
            let Some(distance) = distance.filter(|distance| *distance > 0.0) else {
                continue;
            };
            // What an effect does is in proportion to its size, more or less.
            let shows = one.size * (needed / distance).sqrt().max(1.0);
            if best.is_none_or(|(least, _)| shows < least) {
                best = Some((shows, *plain));
            }
            if shows <= one.size {
                break;
            }
        }
        let (shows, plain) = best.filter(|(shows, _)| *shows < one.shown)?;
        let unit = match one.amplitude.unit {
            "1" => String::new(),
            unit => format!(" {unit}"),
        };
        let (words, name) = (plain.words(), one.amplitude.name);
        Some(format!(
            "{words} would show {name} from {shows:.3}{unit} on"
        ))
    };
    (silent.iter())
        .map(|one| of(one).unwrap_or_else(|| NONE.to_owned()))
        .collect()
}

/// The structure with the effect, and its parameters where it has the fit's, and the effect's typical shapes.
fn with_it(
    structure: &Structure,
    fit: &ComposedFit,
    one: &Silent<'_>,
) -> Option<(ComposedModel, Vec<f64>)> {
    let effect = one.declaration.name;
    let model = ComposedModel::new(&structure.with(effect).ok()?);
    let mut parameters = model.typical();
    for (value, parameter) in parameters.iter_mut().zip(model.parameters()) {
        if let Some(index) = fit.model.index(&parameter.name) {
            *value = fit.parameters[index];
        } else if parameter.declaration.is_amplitude() {
            *value = parameter.declaration.neutral;
        }
    }
    let index = model.index(&format!("{effect}.{}", one.amplitude.name))?;
    parameters[index] = one.amplitude.neutral + one.size;
    Some((model, parameters))
}

#[cfg(test)]
mod tests {
    use super::{
        super::plain::{ALL, Seen},
        *,
    };
    use crate::{
        identification::composed::{ComposedFitOptions, fit},
        load_model::{effect::Role, effects},
    };

    const SEEN: Seen = Seen {
        v0_pu: 1.0,
        p0_pu: 0.8,
        q0_pu: 0.2,
        rate_fps: 60.0,
        nominal_hz: 60.0,
        noise: [2e-3; 2],
        operating_point_deviation: 1e-4,
    };

    /// Dips to 80 and 60 % of the voltage as ZIP and motor foretell them, and the fit to them.
    fn fitted(structure: &Structure) -> ComposedFit {
        let model = ComposedModel::new(structure);
        let typical = model.typical();
        let [_, _, _, _, _, _, _, mild, _, deep, ..] = ALL;
        let events: Vec<PreparedEvent> = [mild, deep]
            .into_iter()
            .map(|plain| {
                let mut event = plain.event(&SEEN);
                let answer = composed::answer(&event, &model, &typical).unwrap();
                (event.active, event.reactive) = (answer.active, answer.reactive);
                event
            })
            .collect();
        let free: Vec<usize> = (0..typical.len()).collect();
        let options = ComposedFitOptions::default();
        fit(&events, &model, &typical, &free, &options, &|| false).unwrap()
    }

    #[test]
    fn what_dips_do_not_show_shows_where_the_frequency_or_the_voltage_stays_away() {
        let structure = Structure::zip_im();
        let fit = fitted(&structure);
        let events: Vec<(Plain, PreparedEvent)> = (ALL.into_iter())
            .map(|plain| (plain, plain.event(&SEEN)))
            .collect();
        let scatter = Scatter::default();
        let shown = |effect: &str| {
            let declaration = effects::find(effect).unwrap().declaration();
            let amplitude = declaration
                .parameters
                .iter()
                .find(|p| p.is_amplitude())
                .unwrap();
            let (Role::OneSidedAmplitude { meaningful: size }
            | Role::TwoSidedAmplitude { meaningful: size }) = amplitude.role
            else {
                panic!("no amplitude");
            };
            let silent = Silent {
                declaration,
                amplitude,
                size,
                shown: amplitude.upper,
            };
            let all = would_show(&events, (&structure, &fit), &[silent], 16.0, &scatter);
            all[0].clone()
        };
        let frequency = shown("static_frequency_dependence");
        assert!(frequency.starts_with("a frequency that"), "{frequency}");
        let recovery = shown("exponential_recovery");
        assert!(recovery.contains("that lasts"), "{recovery}");
        let trip = shown("self_disconnection");
        assert!(
            trip.starts_with("a dip to 70 %") || trip.starts_with("a dip to 60 %"),
            "{trip}"
        );
        assert!(trip.ends_with("would show share from 0.020 on"), "{trip}");
    }
}
