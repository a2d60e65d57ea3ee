//! The concentrator: puts the samples of one site's streams in place on one time grid.
//!
//! Rules, in the order in which they are applied to a batch:
//! 1. A batch of another site, without data or with an inadmissible rate or time is refused.
//! 2. A batch that lies further than `gap_restart_s` after or before all data, or comes at another
//!    rate, starts a new grid at once when no other stream is active; else it is refused until
//!    nothing else has arrived for `off_grid_restart_s`. A configured rate is never changed.
//! 3. A sample goes to the nearest grid point when that is within `grid_tolerance_share` of a
//!    period; nothing is interpolated. Off the grid for `off_grid_restart_s`: a new grid.
//! 4. A sample older than what was released is late. Of two values for one channel and instant the
//!    first usable one stays.
//! 5. An instant is released when it and all before it are complete, or when data newer by more
//!    than the lag time have arrived. In the first lag time of a grid nothing is released, because
//!    it is not known yet which optional channels and streams there are.
//!
//! Within the lag time the order of arrival therefore changes no released byte.

mod grid;
mod options;
mod pending;
mod report;
mod stream;

pub use options::ConcentratorOptions;
pub use report::{BatchRefusal, PushReport, Restart, Run};

use self::{
    grid::Grid,
    options::rate_is_admissible,
    pending::{Pending, Placement},
    stream::Streams,
};
use super::{Channel, SampleBatch, Site};

/// Released samples that may wait to be fetched. Chosen: 1000 s at 100 samples per second.
const OUTBOX_SAMPLES_MAX: usize = 100_000;

/// 2200-01-01T00:00:00Z.
const LATEST_NS: i64 = 7_258_118_400_000_000_000;

/// Puts the samples of one site in place, within a lag time.
#[derive(Clone, Debug)]
pub struct Concentrator {
    site: String,
    options: ConcentratorOptions,
    streams: Streams,
    timeline: Option<Timeline>,
    astray: Option<Astray>,
    outbox: Vec<Run>,
}

/// The grid in force and what waits on it.
#[derive(Clone, Debug)]
struct Timeline {
    grid: Grid,
    pending: Pending,
    /// Whether no run of this grid has been opened yet.
    fresh: bool,
}

/// Times covered by samples off the grid since the last one on it, UTC nanoseconds.
#[derive(Clone, Copy, Debug)]
struct Astray {
    from_ns: i64,
    until_ns: i64,
}

/// How a batch lies to the grid in force.
enum Fit {
    Continues,
    Starts(Restart),
    Elsewhere,
}

impl Concentrator {
    /// A concentrator without data. Settings outside their ranges are taken as the nearest end.
    #[must_use]
    pub fn new(site: &Site, options: ConcentratorOptions) -> Self {
        Self {
            site: site.name.clone(),
            options: options.within_ranges(),
            streams: Streams::default(),
            timeline: None,
            astray: None,
            outbox: Vec::new(),
        }
    }

    /// Puts a batch in place and says what became of it.
    pub fn push(&mut self, batch: &SampleBatch) -> PushReport {
        let mut report = PushReport {
            received: batch.len() as u64,
            ..PushReport::default()
        };
        if let Some(refusal) = self.refusal(batch) {
            report.refused_batches = 1;
            report.refusal = Some(refusal);
            return report;
        }
        let news = self.streams.number(&batch.stream, batch.sequence);
        report.lost_batches = news.lost;
        report.found_batches = news.found;
        match self.fit(batch) {
            // Its running number says that it was waited for, so it begins no other recording.
            Fit::Starts(Restart::Backward { .. }) if news.found > 0 => {
                report.late = report.received;
                return report;
            }
            Fit::Elsewhere => {
                report.off_grid = report.received;
                self.note_astray(batch, &report);
                return report;
            }
            Fit::Starts(restart) => {
                self.restart(batch);
                report.restarts = u64::from(restart != Restart::First);
                report.restart = Some(restart);
            }
            Fit::Continues => {}
        }
        self.place(batch, &mut report);
        self.note_astray(batch, &report);
        self.release(false);
        report
    }

    /// The samples released since the last call, in order; a new run at each restart of the grid.
    #[must_use]
    pub fn drain(&mut self) -> Vec<Run> {
        std::mem::take(&mut self.outbox)
    }

    /// All samples, complete or not: for silence and for shutdown. What arrives for these instants
    /// afterwards is late.
    #[must_use]
    pub fn flush(&mut self) -> Vec<Run> {
        self.release(true);
        self.drain()
    }

    /// Time of the newest sample on the grid in force, UTC nanoseconds.
    #[must_use]
    pub fn newest_ns(&self) -> Option<i64> {
        let timeline = self.timeline.as_ref()?;
        Some(timeline.grid.time_ns(timeline.pending.newest()))
    }

    /// Samples per second of the grid in force.
    #[must_use]
    pub fn rate_fps(&self) -> Option<f64> {
        Some(self.timeline.as_ref()?.grid.rate_fps())
    }

    /// Instants that wait for more data.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.timeline.as_ref().map_or(0, |t| t.pending.len())
    }

    fn refusal(&self, batch: &SampleBatch) -> Option<BatchRefusal> {
        if batch.site != self.site {
            return Some(BatchRefusal::OtherSite);
        }
        if batch.is_empty() || batch.channels.is_empty() {
            return Some(BatchRefusal::Empty);
        }
        if batch
            .channels
            .iter()
            .any(|(_, values)| values.len() != batch.len())
        {
            return Some(BatchRefusal::LengthMismatch);
        }
        let rate_fps = batch.rate_fps;
        if !rate_is_admissible(rate_fps) {
            return Some(BatchRefusal::BadRate { rate_fps });
        }
        let admissible = 0..LATEST_NS;
        let last_ns = sample_time_ns(batch, batch.len() - 1);
        if !admissible.contains(&batch.start_ns) || !admissible.contains(&last_ns) {
            return Some(BatchRefusal::BadTime);
        }
        None
    }

    /// Rule 2.
    fn fit(&self, batch: &SampleBatch) -> Fit {
        let same_as_configured = self.options.rate_fps.is_none_or(|rate_fps| {
            Grid::through(batch.start_ns, rate_fps).has_rate(batch.rate_fps)
        });
        if !same_as_configured {
            return Fit::Elsewhere;
        }
        let Some(timeline) = &self.timeline else {
            return Fit::Starts(Restart::First);
        };
        let Some(restart) = self.misfit(timeline, batch) else {
            return Fit::Continues;
        };
        let recent =
            timeline.pending.newest() - timeline.grid.periods_in(self.options.gap_restart_s);
        if !self.streams.others_active(&batch.stream, recent) || self.astray_long_enough(batch) {
            return Fit::Starts(restart);
        }
        Fit::Elsewhere
    }

    fn misfit(&self, timeline: &Timeline, batch: &SampleBatch) -> Option<Restart> {
        if !timeline.grid.has_rate(batch.rate_fps) {
            return Some(Restart::OffGrid {
                rate_fps: batch.rate_fps,
            });
        }
        let newest_ns = timeline.grid.time_ns(timeline.pending.newest());
        let last_ns = sample_time_ns(batch, batch.len() - 1);
        let ahead_s = (batch.start_ns - newest_ns) as f64 / 1e9;
        let behind_s = (newest_ns - last_ns) as f64 / 1e9;
        if ahead_s > self.options.gap_restart_s {
            return Some(Restart::Forward { gap_s: ahead_s });
        }
        if behind_s > self.options.gap_restart_s {
            let gap_s = (newest_ns - batch.start_ns) as f64 / 1e9;
            return Some(Restart::Backward { gap_s });
        }
        let off_grid = (0..batch.len()).all(|k| {
            let time_ns = sample_time_ns(batch, k);
            timeline
                .grid
                .index_of(time_ns, self.options.grid_tolerance_share)
                .is_none()
        });
        (off_grid && self.astray_long_enough(batch)).then_some(Restart::OffGrid {
            rate_fps: batch.rate_fps,
        })
    }

    fn astray_long_enough(&self, batch: &SampleBatch) -> bool {
        self.astray.is_some_and(|astray| {
            let from_ns = astray.from_ns.min(batch.start_ns);
            let until_ns = astray.until_ns.max(sample_time_ns(batch, batch.len()));
            (until_ns - from_ns) as f64 / 1e9 >= self.options.off_grid_restart_s
        })
    }

    fn restart(&mut self, batch: &SampleBatch) {
        self.release(true);
        self.streams.restart();
        let grid = Grid::through(
            batch.start_ns,
            self.options.rate_fps.unwrap_or(batch.rate_fps),
        );
        let pending = Pending::starting_at(
            grid.nearest(batch.start_ns),
            grid.periods_in(self.options.lag_s),
            grid.periods_in(self.options.gap_restart_s),
            &self.options.expected,
        );
        self.timeline = Some(Timeline {
            grid,
            pending,
            fresh: true,
        });
    }

    fn place(&mut self, batch: &SampleBatch, report: &mut PushReport) {
        let Some(timeline) = &mut self.timeline else {
            return;
        };
        let waiting: usize = self.outbox.iter().map(|run| run.samples.len()).sum();
        for k in 0..batch.len() {
            let time_ns = sample_time_ns(batch, k);
            let tolerance = self.options.grid_tolerance_share;
            let Some(index) = timeline.grid.index_of(time_ns, tolerance) else {
                report.off_grid += 1;
                continue;
            };
            if waiting + timeline.pending.len_reaching(index) > OUTBOX_SAMPLES_MAX {
                report.overflow += 1;
                continue;
            }
            match timeline.pending.place(index, batch, k) {
                Placement::Late => report.late += 1,
                Placement::Duplicate => report.duplicate += 1,
                Placement::Accepted { usable } => {
                    report.accepted += 1;
                    report.bad_quality += u64::from(!usable);
                    let behind = self.streams.advance(&batch.stream, index);
                    report.out_of_order += u64::from(behind);
                }
            }
        }
    }

    /// Keeps the account of rule 3: how long samples have been off the grid with none on it.
    fn note_astray(&mut self, batch: &SampleBatch, report: &PushReport) {
        if report.off_grid == report.received {
            let until_ns = sample_time_ns(batch, batch.len());
            let astray = self.astray.get_or_insert(Astray {
                from_ns: batch.start_ns,
                until_ns,
            });
            astray.from_ns = astray.from_ns.min(batch.start_ns);
            astray.until_ns = astray.until_ns.max(until_ns);
        } else if report.accepted > 0 {
            self.astray = None;
        }
    }

    /// Moves what may go from the timeline to the outbox.
    fn release(&mut self, everything: bool) {
        let Some(timeline) = &mut self.timeline else {
            return;
        };
        let grid = timeline.grid;
        while let Some((index, slot)) = timeline.pending.release(everything) {
            if timeline.fresh || self.outbox.is_empty() {
                self.outbox.push(Run {
                    restarted: timeline.fresh,
                    rate_fps: grid.rate_fps(),
                    samples: Vec::new(),
                    missing: 0,
                    incomplete: 0,
                });
                timeline.fresh = false;
            }
            if let Some(run) = self.outbox.last_mut() {
                run.missing += usize::from(slot.is_empty());
                run.incomplete += usize::from(!slot.is_empty() && !slot.holds_required());
                run.samples.push(slot.into_sample(grid.time_ns(index)));
            }
        }
    }
}

/// Time of sample `k` of a batch, UTC nanoseconds.
fn sample_time_ns(batch: &SampleBatch, k: usize) -> i64 {
    batch
        .start_ns
        .saturating_add(super::record::grid_offset_ns(k as f64, batch.rate_fps))
}

/// Bit of a channel in a mask of channels.
const fn bit(channel: Channel) -> u8 {
    1 << channel as u8
}

#[cfg(test)]
mod tests;
