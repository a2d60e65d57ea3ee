//! Values for the tests of the wire and of the store.

use crate::{
    diagnosis::{
        self, Candidate, CrossCorrelation, Dependence, Diagnosis, DiagnosisCost, EffectWorth,
        EventFailure, EventSets, GeneralForm, Improvement, ImprovementStep, Quantity, Segment,
        SegmentResidual, SeparatingEvent, Status, StructureErrors, Unexplained, UnexplainedTerm,
        Untestable,
    },
    disturbance::{Closing, Screening, ScreeningReason, Trigger, Window},
    identification::{
        Bases, ChannelVerdict, Comparison, Cost, DirectionOutcome, DirectionRecord, ErrorSummary,
        EventErrors, FittedStructure, Identification, Judgement, OperatingPoint, ParameterEstimate,
        ParameterSet, Solution, Verdict, VerdictStatus,
        scan_comparison::{ScanComparison, ScanMinimum},
        solution::Ended,
    },
    load_model::effect::Kind,
    measurement::{Channel, Quality, Record, Sample, SampleBatch, Site},
};

pub(in crate::adapters) fn site() -> Site {
    Site {
        name: "site-01".to_owned(),
        s_base_mva: 200.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    }
}

pub(in crate::adapters) fn batch() -> SampleBatch {
    SampleBatch {
        site: "site-01".to_owned(),
        stream: "pmu-1".to_owned(),
        sequence: Some(17),
        start_ns: 1_770_873_060_016_667_000,
        rate_fps: 60.0,
        channels: vec![
            (Channel::VoltagePu, vec![0.983_144, 1.0, 0.1 + 0.2]),
            (Channel::AngleRad, vec![0.1, -3.0, 3.1]),
            (Channel::FrequencyHz, vec![60.0, 59.98, 60.01]),
            (Channel::ActivePu, vec![0.95, 0.9, 1e-300]),
            (Channel::ReactivePu, vec![-0.4, 0.0, 0.39]),
            (Channel::NegativeSequenceRatio, vec![0.01, 0.02, 0.0]),
        ],
        quality: vec![Quality::GOOD, Quality::NOT_SYNCHRONISED, Quality(0x8010)],
    }
}

/// One second at 60 samples per second, a dip to 0.75 pu after half of it, one missing sample.
pub(in crate::adapters) fn window(id: &str) -> Window {
    let mut record = Record {
        start_ns: 1_770_873_060_000_000_000,
        rate_fps: 60.0,
        nominal_hz: 60.0,
        samples: Vec::new(),
    };
    for at in 0..60 {
        let mut sample = Sample::missing(record.time_ns(at));
        if at != 40 {
            sample.voltage_pu = if at < 30 { 1.0 } else { 0.75 };
            sample.frequency_hz = 60.0;
            sample.active_pu = 0.9;
            sample.reactive_pu = 0.3;
            sample.quality = Quality::GOOD;
        }
        record.samples.push(sample);
    }
    Window {
        id: id.to_owned(),
        site: "site-01".to_owned(),
        record,
        onset: 30,
        triggers: vec![Trigger::VoltageDip, Trigger::VoltageStep],
        closing: Closing::Recovered,
    }
}

pub(in crate::adapters) fn screening() -> Screening {
    Screening {
        refusals: vec![ScreeningReason::NotALoad {
            lowest_active_pu: -0.5,
            highest_active_pu: 0.5,
        }],
        marks: vec![ScreeningReason::Unbalanced {
            ratio: 0.03,
            limit: 0.02,
        }],
    }
}

fn estimate(name: &str, value: f64) -> ParameterEstimate {
    ParameterEstimate {
        name: name.to_owned(),
        meaning: "inertia, twice the constant over omega_s".to_owned(),
        value,
        unit: "s^2".to_owned(),
        lower: 0.0,
        upper: 1.0,
        standard_error: Some(0.1),
        at_bound: false,
        identifiable: true,
        interval: Some((0.25, 0.5)),
    }
}

fn errors(event: &str) -> ErrorSummary {
    ErrorSummary {
        eps_p_percent: 0.123_456_789_012_345_67,
        eps_q_percent: 1.0 / 3.0,
        error_to_noise: 1.25,
        error_to_noise_away_from_edges: 1.125,
        events: vec![EventErrors {
            event: event.to_owned(),
            eps_p_percent: 0.1,
            eps_q_percent: 0.2,
            event_eps_p_percent: 0.3,
            event_eps_q_percent: 0.4,
            event_q_to_s0_percent: 0.5,
            skill_p: 0.6,
            skill_q: 0.7,
            skill_over_constant_p: 0.8,
            skill_over_constant_q: 0.9,
            error_to_noise: 1.25,
            error_to_noise_away_from_edges: 1.125,
            lowest_voltage: 0.75,
        }],
    }
}

pub(in crate::adapters) fn parameter_set() -> ParameterSet {
    ParameterSet {
        site: "site-01".to_owned(),
        version: 0,
        structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        structure_versions: vec![1, 1],
        parameters: vec![estimate("X", 2.0 / 3.0), estimate("M", 0.1 + 0.2)],
        derived: vec![estimate("H", 0.75)],
        bases: Bases {
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        },
        operating_point: OperatingPoint {
            v0_pu: 0.98,
            p0_pu: 0.95,
            q0_pu: -0.1,
        },
        fitted_events: vec!["a".to_owned(), "b".to_owned()],
        held_out_events: vec!["c".to_owned()],
        fit: errors("a"),
        held_out: Some(errors("c")),
        verdict: Verdict {
            status: VerdictStatus::Pass,
            reasons: vec!["skill over static ZIP 0.6".to_owned()],
            channels: vec![ChannelVerdict {
                event: "c".to_owned(),
                channel: "P",
                segment: "during",
                mxe_pu: 0.01,
                me_pu: 0.002,
                mae_pu: 0.004,
                within_limits: true,
            }],
        },
        rank: 5,
        condition: 1234.5,
        inflation: Vec::new(),
        notes: Vec::new(),
        software_version: "0.1.0".to_owned(),
    }
}

pub(in crate::adapters) fn identification() -> Identification {
    let direction = |direction, outcome| DirectionRecord {
        from: 1,
        direction,
        label: "eigenvector 1 +".to_owned(),
        exit_distance: Some(0.5),
        exit_point: Some(nalgebra::DVector::from_vec(vec![3.5, 7.0, 0.4])),
        outcome,
        profile: vec![(0.0, 12.5), (0.4, 40.0), (0.5, 38.0)],
    };
    Identification {
        set: parameter_set(),
        solutions: vec![Solution {
            id: 2,
            tier: 1,
            found_from: Some(1),
            direction: Some(1),
            objective: 12.5,
            parameters: vec![("X".to_owned(), 2.0 / 3.0), ("M".to_owned(), 0.3)],
            coordinates: vec![("ln X_prime".to_owned(), -1.0)],
            at_bound: vec!["X".to_owned()],
        }],
        directions: vec![
            direction(1, DirectionOutcome::NewSolution(2)),
            direction(2, DirectionOutcome::KnownSolution(1)),
            direction(
                3,
                DirectionOutcome::NoExitPoint {
                    at_distance: f64::INFINITY,
                    diverged: true,
                },
            ),
            direction(4, DirectionOutcome::LocalSolverInfeasible),
        ],
        ended: Ended::NothingNew { tier: 2 },
        scan: Some(ScanComparison {
            cells: [12, 16, 8],
            within: 1.5,
            minima: vec![ScanMinimum {
                objective: 12.5,
                coordinates: [3.5, 7.0, 0.4],
                solution: Some(2),
            }],
            only_search: Vec::new(),
            evaluations: 1600,
        }),
        cost: Cost {
            simulations: 100,
            sensitivity_simulations: 50,
            seconds: 1.5,
        },
        refused: vec![("event_09".to_owned(), "no power".to_owned())],
    }
}

/// What [`parameter_set`] shows where only what was held out is at hand.
pub(in crate::adapters) fn judgement() -> Judgement {
    let set = parameter_set();
    Judgement {
        site: set.site,
        fitted: None,
        held_out: set.held_out,
        others: None,
        verdict: set.verdict,
        warnings: Vec::new(),
    }
}

pub(in crate::adapters) fn comparison() -> Comparison {
    Comparison {
        event: "a".to_owned(),
        onset_ns: 0,
        time_s: vec![0.0, 0.1],
        voltage_pu: vec![1.0, f64::NAN],
        frequency_hz: vec![60.0, f64::NAN],
        active_measured_pu: vec![0.9, f64::NAN],
        active_model_pu: vec![0.9, 0.5],
        reactive_measured_pu: vec![0.3, f64::NAN],
        reactive_model_pu: vec![0.3, 0.25],
        active_noise_pu: vec![0.01, 0.01],
        reactive_noise_pu: vec![0.01, 0.01],
        used: vec![true, false],
        near_edge: vec![false, true],
        errors: errors("a").events.remove(0),
    }
}

fn structure_errors() -> StructureErrors {
    StructureErrors {
        fit: errors("a"),
        gate: Some(errors("c")),
        untouched: None,
    }
}

fn segment_residual() -> SegmentResidual {
    SegmentResidual {
        segment: Segment::EarlyRecovery,
        channel: diagnosis::Channel::Active,
        begin_s: 0.4,
        end_s: 0.9,
        samples: 25,
        mean_pu: 0.041,
        rms_pu: 0.043,
        to_noise: 8.0,
    }
}

fn event_failure() -> EventFailure {
    EventFailure {
        event: "a".to_owned(),
        sentence: "0.4-0.9 s after the onset P is 4.1 % too high, 8 times the noise".to_owned(),
        lowest_voltage: 0.75,
        frequency_deviation: -0.002,
        error_to_noise: 6.5,
        clearing_s: Some(0.15),
        segments: vec![segment_residual()],
        dependences: vec![Dependence {
            channel: diagnosis::Channel::Active,
            quantity: Quantity::Voltage,
            explained: 0.7,
            bins: vec![(0.75, -0.02, 0.001, 12), (1.0, 0.04, 0.001, 48)],
        }],
        cross_correlations: vec![CrossCorrelation {
            channel: diagnosis::Channel::Active,
            lags_s: vec![0.0, 0.02],
            correlation: vec![0.5, 0.4],
            band: 0.2,
        }],
        series: diagnosis::EventSeries::default(),
    }
}

pub(in crate::adapters) fn diagnosis() -> Diagnosis {
    Diagnosis {
        site: "site-01".to_owned(),
        structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        status: Status::MissingEffect,
        summary: "stator_resistance is missing; feeder_impedance is not told from it".to_owned(),
        reasons: vec!["held-out error to noise falls from 6.5 to 1.1".to_owned()],
        events: EventSets {
            fit: vec!["a".to_owned(), "b".to_owned()],
            gate: vec!["c".to_owned()],
            untouched: Vec::new(),
            refused: vec![("d".to_owned(), "no power".to_owned())],
        },
        baseline: structure_errors(),
        noise_floor: 0.85,
        segments: vec![segment_residual()],
        failures: vec![event_failure()],
        effects: vec![EffectWorth {
            effect: "second_motor".to_owned(),
            delta_bic_without: -4.5,
            untouched_without: Some(6.4),
            is_superfluous: true,
        }],
        candidates: vec![Candidate {
            effect: "stator_resistance".to_owned(),
            kind: Kind::Physics,
            score_share: 0.9,
            visibility: 0.4,
            delta_bic: Some(-812.0),
            held_out_error_before: Some(6.5),
            held_out_error_after: Some(1.1),
            share_of_best_gain: Some(1.0),
            group: ["stator_resistance", "feeder_impedance"]
                .map(str::to_owned)
                .to_vec(),
            would_separate: separating().words("stator_resistance"),
            separating_events: vec![separating()],
            parameters: vec![estimate("stator_resistance.r_s", 0.02)],
            model: Some(fitted_structure("stator_resistance.r_s")),
            declared: true,
            refused: Vec::new(),
        }],
        answer_set: ["stator_resistance", "feeder_impedance"]
            .map(str::to_owned)
            .to_vec(),
        untestable: vec![Untestable {
            effect: "tap_changer".to_owned(),
            smallest_detectable_amplitude: 0.5,
            meaningful_amplitude: 0.05,
            amplitude: "n_lower".to_owned(),
            unit: "1".to_owned(),
            needs: "records of 60 s".to_owned(),
        }],
        unexplained: Some(Unexplained {
            signature: "P recovers over 0.4 s after the clearing".to_owned(),
            terms: vec![UnexplainedTerm {
                formula: "v - lag(v, 0.4)".to_owned(),
                channel: "P",
                coefficient: 0.2,
                share: 0.6,
            }],
            effect_file: None,
            general_form: Some(general_form()),
        }),
        model: Some(fitted_structure("T0_prime")),
        cost: DiagnosisCost {
            simulations: 900,
            refits: 6,
            seconds: 2.5,
        },
    }
}

fn separating() -> SeparatingEvent {
    SeparatingEvent {
        from: "feeder_impedance".to_owned(),
        disturbance: "a dip to 60 % of the voltage for 0.1 s".to_owned(),
        squares: 118.0,
        needed: 66.0,
        events: 1,
        channel: diagnosis::Channel::Reactive,
        time_s: 0.2,
        difference: -0.012,
        since: "its end",
        follows: None,
    }
}

fn general_form() -> GeneralForm {
    GeneralForm {
        name: "general_second_order".to_owned(),
        title: "Follows the voltage with an oscillation or a delay of its own".to_owned(),
        misfit_before: 9.36,
        misfit_after: 0.45,
        delta_bic: -95_900.0,
        held_out_error_before: Some(2.55),
        held_out_error_after: Some(0.66),
        parameters: Vec::new(),
        model: fitted_structure("T0_prime"),
        effect_file: "name = \"fitted_second_order\"\n".to_owned(),
    }
}

fn fitted_structure(name: &str) -> FittedStructure {
    FittedStructure {
        structure: ["zip", "induction_motor"].map(str::to_owned).to_vec(),
        values: vec![(name.to_owned(), 0.02)],
    }
}

pub(in crate::adapters) fn improvement() -> Improvement {
    let first = diagnosis();
    let step = |structure: &[&str], added: Option<&str>| ImprovementStep {
        structure: structure.iter().map(|&name| name.to_owned()).collect(),
        added: added.map(str::to_owned),
        dropped: Vec::new(),
        reason: "first in the answer set".to_owned(),
        errors: structure_errors(),
        failures: vec![event_failure()],
        parameter_count: 8,
        delta_bic: -812.0,
        set: parameter_set(),
    };
    let last = ["zip", "induction_motor", "stator_resistance"];
    Improvement {
        site: "site-01".to_owned(),
        steps: vec![
            step(&last[..2], None),
            step(&last, Some("stator_resistance")),
        ],
        last: Diagnosis {
            structure: last.map(str::to_owned).to_vec(),
            status: Status::Adequate,
            summary: "nothing is missing".to_owned(),
            candidates: Vec::new(),
            answer_set: Vec::new(),
            unexplained: None,
            ..first.clone()
        },
        diagnoses: vec![first],
    }
}

mod documents {
    use std::{env, fs, path::Path};

    use super::{
        batch, comparison, diagnosis, identification, improvement, judgement, parameter_set,
        screening, window,
    };
    use crate::{
        adapters::wire::v1::{
            ComparisonsV1, DiagnosisV1, EventSummaryV1, IdentificationV1, ImprovementV1,
            ParameterSetV1, RecordingFiles, encode_batch_cbor, encode_batch_json, encode_recording,
        },
        identification::ParameterSet,
    };

    /// What `docs/schema/examples` shows, by file name.
    fn documents() -> Vec<(&'static str, Vec<u8>)> {
        fn pretty(document: &impl serde::Serialize) -> Vec<u8> {
            let mut text = serde_json::to_vec_pretty(document).unwrap();
            text.push(b'\n');
            text
        }
        let set = ParameterSet {
            version: 3,
            ..parameter_set()
        };
        let recording = RecordingFiles::CfgDat {
            name: "fault 12".to_owned(),
            cfg: b"station,recorder,1999\r\n".to_vec(),
            dat: vec![1, 0, 0, 0],
        };
        let window = window("site-01-1770873060500000000");
        let event = EventSummaryV1::new(&window, Some(&screening()));
        let comparisons = ComparisonsV1::new(&set, &[comparison()], &judgement()).unwrap();
        vec![
            ("batch.json", encode_batch_json(&batch(), 60.0).unwrap()),
            ("batch.cbor", encode_batch_cbor(&batch(), 60.0).unwrap()),
            ("recording.cbor", encode_recording(&recording).unwrap()),
            (
                "parameter-set.json",
                pretty(&ParameterSetV1::new(&set).unwrap()),
            ),
            ("event.json", pretty(&event)),
            (
                "identification.json",
                pretty(&IdentificationV1::new(&identification()).unwrap()),
            ),
            ("comparison.json", pretty(&comparisons)),
            ("diagnosis.json", pretty(&DiagnosisV1::new(&diagnosis(), 2))),
            (
                "improvement.json",
                pretty(&ImprovementV1::new(&improvement()).unwrap()),
            ),
        ]
    }

    #[test]
    fn the_documented_examples_are_what_is_written() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/schema/examples");
        for (name, bytes) in documents() {
            let path = folder.join(name);
            if env::var_os("UPDATE_DOCS").is_some() {
                fs::write(&path, &bytes).unwrap();
            }
            let documented = fs::read(&path).unwrap_or_default();
            assert!(documented == bytes, "{name} differs: UPDATE_DOCS=1");
        }
    }
}
