//! An event whose terminal voltage is known exactly, so that no intake stands between the data and
//! the fit: for studies of the fit alone, and for callers with a model of their own measurement.

use std::sync::Arc;

use super::PreparedEvent;
use crate::{
    identification::{
        measurement_chain::{ChainParts, MeasurementChain},
        phasor_filter::PhasorFilter,
    },
    load_model::TerminalInput,
};

/// Terminal voltage, power over P0 and the noise of each channel.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownTerminal {
    /// Event identifier.
    pub id: String,
    /// Terminal phasor, 1 at rest.
    pub input: TerminalInput,
    /// Reactive over active power before the event.
    pub q0_over_p0: f64,
    /// P over P0 at the samples of `input`.
    pub active: Vec<f64>,
    /// Q over P0 at the samples of `input`.
    pub reactive: Vec<f64>,
    /// Frequency deviation from its value before the event at the samples of `input`, relative to nominal.
    pub frequency_deviation: Vec<f64>,
    /// Standard deviation of the samples of P over P0 and of Q over P0, positive.
    pub noise: [f64; 2],
    /// How well P0 and Q0 are known, relative to P0; 0 when exactly.
    pub operating_point_deviation: f64,
    /// First sample of the event part.
    pub event_start: usize,
}

impl From<KnownTerminal> for PreparedEvent {
    /// Every sample may be used and has the noise of its channel; V0 = P0 = 1 pu.
    fn from(known: KnownTerminal) -> Self {
        let KnownTerminal {
            input,
            frequency_deviation,
            ..
        } = known;
        let samples = input.sample_count();
        let phasor = |k: usize| {
            let at = k * input.points_per_sample;
            [input.real[at], input.imaginary[at]]
        };
        let voltage: Vec<f64> = (0..samples)
            .map(|k| phasor(k)[0].hypot(phasor(k)[1]))
            .collect();
        let chain = MeasurementChain::new(&ChainParts {
            input: &input,
            filter: PhasorFilter::None,
            half_width: 0.0,
            jumps: &[],
            filtered: &vec![false; samples],
            frequency_deviation: &frequency_deviation,
        });
        let jumps = &input.jumps;
        let near_edge = (0..samples)
            .map(|k| (k.saturating_sub(2)..k + 2).any(|i| jumps.get(i) == Some(&true)))
            .collect();
        Self {
            id: known.id,
            rate_fps: 1.0 / input.sample_interval_s,
            v0_pu: 1.0,
            p0_pu: 1.0,
            q0_pu: known.q0_over_p0,
            reactive_offset: [0.0; 2],
            site: None,
            steady_start: true,
            event_start: known.event_start,
            lowest_voltage: voltage.iter().copied().fold(f64::INFINITY, f64::min),
            highest_voltage: voltage.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            frequency_deviation,
            active: known.active,
            reactive: known.reactive,
            active_deviation: vec![known.noise[0]; samples],
            reactive_deviation: vec![known.noise[1]; samples],
            active_noise: known.noise[0],
            reactive_noise: known.noise[1],
            used: vec![true; samples],
            near_edge,
            operating_point_deviation: known.operating_point_deviation,
            edges: Vec::new(),
            filter: None,
            chain,
            origin: None,
            elsewhere: Arc::new([]),
            spikes: 0,
            voltage,
            input,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_from_the_fine_grid() {
        // Four samples, eight points each; the phasor halves and turns by 0.3 between 1 and 2.
        let fine = |k: usize| {
            if k < 12 {
                [1.0, 0.0]
            } else {
                [0.5 * 0.3_f64.cos(), 0.5 * 0.3_f64.sin()]
            }
        };
        let input = TerminalInput {
            real: (0..=24).map(|k| fine(k)[0]).collect(),
            imaginary: (0..=24).map(|k| fine(k)[1]).collect(),
            points_per_sample: 8,
            sample_interval_s: 0.02,
            jumps: vec![false, true, false],
            dense: vec![false; 3],
            synchronous_speed_rad_s: 314.159,
        };
        let event = PreparedEvent::from(KnownTerminal {
            id: "a".to_owned(),
            input,
            q0_over_p0: 0.2,
            active: vec![1.0; 4],
            reactive: vec![0.2; 4],
            frequency_deviation: vec![0.0, 0.0, -1e-3, -1e-3],
            noise: [1e-3, 2e-3],
            operating_point_deviation: 0.0,
            event_start: 2,
        });
        assert_eq!(event.len(), 4);
        assert!((event.voltage[1] - 1.0).abs() < 1e-15 && (event.voltage[2] - 0.5).abs() < 1e-15);
        assert!((event.lowest_voltage - 0.5).abs() < 1e-15);
        assert!((event.rate_fps - 50.0).abs() < 1e-9);
        assert!((event.reactive_deviation[3] - 2e-3).abs() < 1e-18);
        assert!(event.chain.output_frequency_deviation()[2] < 0.0);
        assert!(event.near_edge[1] && event.near_edge[2] && event.edges.is_empty());
    }
}
