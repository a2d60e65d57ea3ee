//! A state with a clock, and things to feed it with.

use super::*;

pub(super) const SECOND_NS: i64 = 1_000_000_000;
const RATE_FPS: u16 = 50;
/// 2026-01-01: any time will do.
const START_NS: i64 = 1_767_225_600 * SECOND_NS;

/// A state, its clock and its metrics.
pub(super) struct Bench {
    pub(super) state: State,
    pub(super) now_ns: i64,
    metrics: Metrics,
}

impl Bench {
    pub(super) fn new() -> Self {
        Self::with(ServiceOptions {
            joint_events_min: 2,
            spool_windows_max: 3,
            workers: 2,
            ..ServiceOptions::default()
        })
    }

    pub(super) fn with(options: ServiceOptions) -> Self {
        let site = SiteOptions {
            site: Site {
                name: "north".to_owned(),
                s_base_mva: 40.0,
                v_base_kv: 110.0,
                nominal_hz: 50.0,
            },
            concentrator: ConcentratorOptions::default(),
            detector: DetectorOptions::default(),
            screening: ScreeningOptions::default(),
            structure: vec!["zip".to_owned(), "induction_motor".to_owned()],
        };
        Self {
            state: State::new(options, vec![site]),
            now_ns: START_NS,
            metrics: Metrics::new().unwrap(),
        }
    }

    /// Applies an event, moves the metrics, and returns the other commands.
    pub(super) fn apply(&mut self, event: Event) -> Vec<Command> {
        let commands = self.state.apply(self.now_ns, event);
        let (reports, others): (Vec<_>, Vec<_>) = commands
            .into_iter()
            .partition(|c| matches!(c, Command::Report(_)));
        for report in reports {
            if let Command::Report(occurrence) = report {
                occurrence.emit(&self.metrics);
            }
        }
        others
    }

    pub(super) fn pass(&mut self, duration_ns: i64) {
        self.now_ns += duration_ns;
    }

    pub(super) fn metric(&self, metric: &catalogue::Declaration, labels: &[&str]) -> f64 {
        self.metrics.value(metric, labels)
    }

    /// A dip to 0.8 pu for 0.2 s, 5 s into 10 s of steady voltage, as one batch that starts
    /// `shift_s` seconds later than the others.
    pub(super) fn dip(shift_s: i64) -> SampleBatch {
        let count = 10 * usize::from(RATE_FPS);
        let voltage = |k: usize| if (250..260).contains(&k) { 0.8 } else { 1.0 };
        let channel = |value: &dyn Fn(usize) -> f64| (0..count).map(value).collect::<Vec<_>>();
        SampleBatch {
            site: "north".to_owned(),
            stream: "pmu".to_owned(),
            sequence: None,
            start_ns: START_NS + shift_s * SECOND_NS,
            rate_fps: f64::from(RATE_FPS),
            channels: vec![
                (Channel::VoltagePu, channel(&voltage)),
                (Channel::FrequencyHz, channel(&|_| 50.0)),
                (Channel::ActivePu, channel(&|k| 0.8 * voltage(k).powi(2))),
                (Channel::ReactivePu, channel(&|k| 0.2 * voltage(k).powi(2))),
            ],
            quality: vec![Quality::GOOD; count],
        }
    }

    /// Feeds a dip and lets the stream fall silent; returns the commands of the end.
    pub(super) fn feed_dip(&mut self, shift_s: i64) -> Vec<Command> {
        let _ = self.apply(Event::BatchDecoded(Self::dip(shift_s)));
        self.pass(10 * SECOND_NS);
        self.apply(Event::Tick)
    }

    /// A window as the state cuts it out.
    pub(super) fn window(&self) -> Window {
        let mut other = Self::new();
        other.now_ns = self.now_ns;
        stored_windows(&other.feed_dip(0)).remove(0)
    }

    /// Brings a joint fit to the point at which it has been claimed.
    pub(super) fn claim(&mut self, job: i64, kind: WorkKind) -> Vec<Command> {
        self.apply(Event::WorkClaimed(claimed(job, kind)))
    }
}

pub(super) fn stored_windows(commands: &[Command]) -> Vec<Window> {
    let windows = commands.iter().filter_map(|c| match c {
        Command::StoreWindow(window) => Some(window.as_ref().clone()),
        _ => None,
    });
    windows.collect()
}

pub(super) fn failure() -> Failure {
    Failure {
        reason: "busy",
        error: "the store was busy".to_owned(),
        passing: true,
    }
}

pub(super) fn claimed(job: i64, kind: WorkKind) -> Claimed {
    Claimed {
        lease: Lease { job, claim: 1 },
        work: match kind {
            WorkKind::Event => Work::event("north", &format!("north-{job}")),
            WorkKind::Site => Work::site("north"),
            WorkKind::Diagnosis => Work::diagnosis("north"),
        },
    }
}

pub(super) fn verdict(status: VerdictStatus) -> Verdict {
    Verdict {
        status,
        reasons: Vec::new(),
        channels: Vec::new(),
    }
}

/// A fit that passed validation.
pub(super) fn fitted() -> Arc<Fitted> {
    let set = ParameterSet {
        site: "north".to_owned(),
        version: 0,
        structure: vec!["zip".to_owned()],
        structure_versions: vec![1],
        parameters: Vec::new(),
        derived: Vec::new(),
        bases: Bases {
            s_base_mva: 40.0,
            v_base_kv: 110.0,
            nominal_hz: 50.0,
        },
        operating_point: OperatingPoint {
            v0_pu: 1.0,
            p0_pu: 0.8,
            q0_pu: 0.2,
        },
        fitted_events: vec!["a".to_owned()],
        held_out_events: vec!["b".to_owned()],
        fit: ErrorSummary::default(),
        held_out: Some(ErrorSummary::default()),
        verdict: verdict(VerdictStatus::Pass),
        rank: 1,
        condition: 1.0,
        inflation: Vec::new(),
        notes: Vec::new(),
        software_version: "0".to_owned(),
    };
    Arc::new(Fitted {
        identification: Identification {
            set,
            solutions: Vec::new(),
            directions: Vec::new(),
            ended: crate::identification::solution::Ended::NothingNew { tier: 1 },
            scan: None,
            cost: Cost::default(),
            refused: Vec::new(),
        },
        inputs_hash: "hash".to_owned(),
        in_force: None,
    })
}
