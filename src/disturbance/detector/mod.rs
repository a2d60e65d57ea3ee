//! The detector: watches the samples of one site and cuts disturbances out of them.
//!
//! It is given every grid point once and in order, and decides from the data alone: the same
//! samples give the same windows, however fast and in whatever batches they come. A bad or missing
//! sample never meets a trigger; it is kept in the window as it is.
//!
//! A window opens at the first trigger. Its onset is the first sample of the departure from level
//! and trend that led to the trigger. Triggers met while it is open extend it. It closes when none
//! has been met for the post-trigger time, or at its longest; a trigger that is still met then must
//! end before it can open another. Two windows may share samples: what followed one disturbance is
//! what preceded the next.

mod history;
mod options;
mod triggers;

pub use self::options::{DetectorOptions, VoltageReference};
use self::{
    history::{Base, History, trigger_frequency, trigger_voltage},
    options::Counts,
    triggers::{
        Settings, SlidingReference, Triggers, frequency_tolerance_hz, voltage_tolerance_pu,
    },
};
use super::{Closing, Trigger, Window, window::window_id};
use crate::measurement::{Record, Run, Sample, Site};

/// Finds disturbances in the samples of one site.
#[derive(Clone, Debug)]
pub struct Detector {
    site: Site,
    options: DetectorOptions,
    grid: Option<OnGrid>,
}

/// What a detector is doing.
#[derive(Clone, Debug, PartialEq)]
pub enum DetectorState {
    /// No sample has arrived yet.
    NoData,
    /// Nothing disturbs the load.
    Idle {
        /// What dips and swells are measured against at present, pu; none in the first samples.
        voltage_reference_pu: Option<f64>,
    },
    /// A window is open.
    Open {
        /// Time of its onset, UTC nanoseconds.
        onset_ns: i64,
        /// Triggers met so far.
        triggers: Vec<Trigger>,
    },
}

/// Everything that belongs to one time grid.
#[derive(Clone, Debug)]
struct OnGrid {
    rate_fps: f64,
    counts: Counts,
    history: History,
    reference: SlidingReference,
    triggers: Triggers,
    open: Option<Open>,
}

/// A window that is not closed yet.
#[derive(Clone, Debug)]
struct Open {
    samples: Vec<Sample>,
    onset: usize,
    triggers: Vec<Trigger>,
    quiet: usize,
}

impl Detector {
    /// A detector without data.
    #[must_use]
    pub fn new(site: &Site, options: DetectorOptions) -> Self {
        Self {
            site: site.clone(),
            options,
            grid: None,
        }
    }

    /// Starts a new grid; an open window is closed as [`Closing::StreamGap`].
    pub fn begin(&mut self, rate_fps: f64) -> Option<Window> {
        let window = self.flush(Closing::StreamGap);
        let counts = Counts::new(&self.options, rate_fps);
        self.grid = Some(OnGrid {
            rate_fps,
            counts,
            history: History::new(counts.memory),
            reference: SlidingReference::default(),
            triggers: Triggers::default(),
            open: None,
        });
        window
    }

    /// Takes what a concentrator released.
    pub fn push_run(&mut self, run: &Run) -> Vec<Window> {
        let mut windows = Vec::new();
        if run.restarted || self.grid.is_none() {
            windows.extend(self.begin(run.rate_fps));
        }
        windows.extend(run.samples.iter().filter_map(|sample| self.push(*sample)));
        windows
    }

    /// Takes the next grid point; returns the window that it closed. Before [`Detector::begin`] the
    /// rate is not known and the sample is ignored.
    pub fn push(&mut self, sample: Sample) -> Option<Window> {
        let grid = self.grid.as_mut()?;
        let closing = grid.take(sample, &self.site, &self.options)?;
        self.flush(closing)
    }

    /// Closes the open window, if there is one.
    pub fn flush(&mut self, closing: Closing) -> Option<Window> {
        let grid = self.grid.as_mut()?;
        let open = grid.open.take()?;
        grid.settle(closing);
        let record = Record {
            start_ns: open.samples.first()?.time_ns,
            rate_fps: grid.rate_fps,
            nominal_hz: self.site.nominal_hz,
            samples: open.samples,
        };
        Some(Window {
            id: window_id(&self.site.name, record.samples[open.onset].time_ns),
            site: self.site.name.clone(),
            record,
            onset: open.onset,
            triggers: open.triggers,
            closing,
        })
    }

    /// What the detector is doing.
    #[must_use]
    pub fn state(&self) -> DetectorState {
        let Some(grid) = &self.grid else {
            return DetectorState::NoData;
        };
        grid.open.as_ref().map_or_else(
            || DetectorState::Idle {
                voltage_reference_pu: grid.reference.voltage_pu(),
            },
            |open| DetectorState::Open {
                onset_ns: open.samples[open.onset].time_ns,
                triggers: open.triggers.clone(),
            },
        )
    }
}

impl OnGrid {
    /// Takes a sample; says why the open window is to be closed, if it is.
    fn take(&mut self, sample: Sample, site: &Site, options: &DetectorOptions) -> Option<Closing> {
        self.history.push(sample);
        let base = self.history.base(&self.counts);
        let settings = Settings {
            options,
            counts: &self.counts,
            rate_fps: self.rate_fps,
            nominal_hz: site.nominal_hz,
            window_open: self.open.is_some(),
        };
        self.triggers
            .judge(&self.history, base.as_ref(), &mut self.reference, &settings);
        let met: Vec<Trigger> = self.triggers.met().collect();

        let Some(open) = &mut self.open else {
            if !met.is_empty() {
                self.open = Some(self.opened(met, base.as_ref()));
            }
            return None;
        };
        open.samples.push(sample);
        open.quiet = if met.is_empty() { open.quiet + 1 } else { 0 };
        let new = met.into_iter().filter(|t| !open.triggers.contains(t));
        let new: Vec<Trigger> = new.collect();
        open.triggers.extend(new);
        if open.quiet >= self.counts.post {
            Some(Closing::Recovered)
        } else if open.samples.len() >= self.counts.longest {
            Some(Closing::LongestReached)
        } else {
            None
        }
    }

    fn opened(&self, triggers: Vec<Trigger>, base: Option<&Base>) -> Open {
        let back = self.onset_back(base);
        let samples: Vec<Sample> = self
            .history
            .newest(self.counts.pre + back + 1)
            .copied()
            .collect();
        Open {
            onset: samples.len() - 1 - back.min(samples.len() - 1),
            samples,
            triggers,
            quiet: 0,
        }
    }

    /// How many samples before the newest the disturbance began: the start of the last unbroken
    /// run of samples that differ from level or trend by more than noise. One quiet or bad sample
    /// does not break the run.
    fn onset_back(&self, base: Option<&Base>) -> usize {
        let reach = self.counts.lookback.min(self.history.len());
        let departing = |back: usize| {
            base.is_some_and(|base| self.departs(base, back))
                || base.is_none() && self.outside_band(back)
        };
        let Some(mut onset) = (0..reach).find(|back| departing(*back)) else {
            return 0;
        };
        let mut back = onset + 1;
        while back < reach && back <= onset + 2 {
            if departing(back) {
                onset = back;
            }
            back += 1;
        }
        onset
    }

    fn departs(&self, base: &Base, back: usize) -> bool {
        let Some(sample) = self.history.back(back) else {
            return false;
        };
        let voltage = trigger_voltage(sample)
            .is_some_and(|v| (v - base.voltage_pu).abs() > voltage_tolerance_pu(base));
        let frequency = base.frequency.is_some_and(|base| {
            trigger_frequency(sample)
                .is_some_and(|f| (f - base.at(back)).abs() > frequency_tolerance_hz(&base))
        });
        voltage || frequency
    }

    /// Whether the voltage is off the sliding reference by more than two percent, the hysteresis of
    /// IEC 61000-4-30: all that can be said without a base time.
    fn outside_band(&self, back: usize) -> bool {
        let voltage_pu = self.history.back(back).and_then(trigger_voltage);
        match (voltage_pu, self.reference.voltage_pu()) {
            (Some(v), Some(reference)) => (v / reference - 1.0).abs() > 0.02,
            _ => false,
        }
    }

    /// After a window: what is still met must end first, and after a lasting change the new level
    /// is the reference.
    fn settle(&mut self, closing: Closing) {
        self.triggers.hold();
        if closing == Closing::LongestReached
            && let Some(base) = self.history.base(&self.counts)
        {
            self.reference = SlidingReference::starting_at(base.voltage_pu, base.voltages);
        }
    }
}

#[cfg(test)]
mod tests;
