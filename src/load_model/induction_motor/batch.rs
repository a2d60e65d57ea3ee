//! Many motors over one input, side by side in vector registers.
//!
//! A motor's result does not depend on its companions and has the bits of
//! [`MotorCoordinates::simulate`]: lanes take the same steps that the motor would take alone. Motors are
//! grouped by the number of steps their rates ask for. What a lane cannot do in step with the others (an
//! error estimate above the tolerance, a rotor near standstill) is done for that lane alone, and very stiff
//! motors run alone altogether.

use super::{
    Infeasible, MotorCoordinates, MotorOutput,
    advance::{Mover, SERIES_REACH, State},
    input_pieces::{Piece, for_each_piece},
    lanes::{Lanes, Mask, REGISTER_LANES_MAX},
    power,
    taylor::{Ending, Series, StepConstants, input_beyond},
};
use crate::load_model::{TerminalInput, terminal::DENSE_POINTS};
use pulp::{Arch, Simd, WithSimd};

/// Steps per sample from which lanes side by side are no longer worth it.
const PARTS_MAX: usize = 64;
/// Registers side by side where the error is estimated, and where it is not: measured by
/// `benches/simulation.rs`.
const REGISTERS_EXACT: usize = 1;
const REGISTERS_FIXED: usize = 2;
/// Halvings of a step that lanes take side by side; what is still refused then, such as the instant of
/// standstill, each lane finishes alone.
const HALVINGS_MAX: usize = 5;
const LANES_MAX: usize = REGISTER_LANES_MAX * 3;

/// How much work a batch puts into each motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// As [`MotorCoordinates::simulate`], bit by bit.
    Exact,
    /// Steps of order four, so many per sample whatever the motor (a power of two, at least 1; more where
    /// the input jumps), and no error estimate: as accurate and as dear as so many steps of the classical
    /// Runge-Kutta method. For scans. Motors too fast for the steps give numbers without meaning or none.
    Fixed {
        /// Steps per sample.
        steps_per_sample: usize,
    },
}

/// Receives what the motors of a batch draw.
pub trait BatchSink {
    /// Power at one output instant of the input, for some motors: `motors` are indices into the
    /// batch, `active` and `reactive` what each of them draws (as in [`MotorOutput`]). For one motor, the
    /// instants come in order. Mark the implementation `#[inline(always)]` so that it is compiled
    /// for the same instruction set as the simulation.
    fn output(&mut self, instant: usize, motors: &[usize], active: &[f64], reactive: &[f64]);
}

impl<F: FnMut(usize, &[usize], &[f64], &[f64])> BatchSink for F {
    #[inline(always)]
    fn output(&mut self, instant: usize, motors: &[usize], active: &[f64], reactive: &[f64]) {
        self(instant, motors, active, reactive);
    }
}

/// Simulates `motors` over one input and hands every output to `sink`.
///
/// Returns per motor whether it has a steady state; one that has none reaches the sink never, and a motor
/// whose numbers overflow disturbs no other.
pub fn simulate_batch(
    motors: &[MotorCoordinates<f64>],
    input: &TerminalInput,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    simulate_batch_on(Arch::new(), motors, input, effort, sink)
}

/// As [`simulate_batch`] on a given instruction set.
fn simulate_batch_on(
    arch: Arch,
    motors: &[MotorCoordinates<f64>],
    input: &TerminalInput,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    let verdicts: Vec<_> = motors
        .iter()
        .map(|m| m.steady_state().map(|_| ()))
        .collect();
    let parts: Vec<Option<usize>> = motors
        .iter()
        .zip(&verdicts)
        .map(|(motor, verdict)| {
            verdict
                .is_ok()
                .then(|| parts_per_sample(motor, input, effort))
        })
        .collect();
    let mut step_counts: Vec<usize> = parts.iter().copied().flatten().collect();
    step_counts.sort_unstable();
    step_counts.dedup();
    for count in step_counts {
        let members: Vec<usize> = (0..motors.len())
            .filter(|&i| parts[i] == Some(count))
            .collect();
        if count > PARTS_MAX {
            for member in members {
                alone(motors, member, input, sink);
            }
            continue;
        }
        let steps = steps(input, count);
        match effort {
            Effort::Exact => arch.dispatch(Group::<_, REGISTERS_EXACT> {
                motors,
                members: &members,
                input,
                steps: &steps,
                exact: true,
                sink,
            }),
            Effort::Fixed { .. } => arch.dispatch(Group::<_, REGISTERS_FIXED> {
                motors,
                members: &members,
                input,
                steps: &steps,
                exact: false,
                sink,
            }),
        }
    }
    verdicts
}

/// Steps per sample that the motor's rates at rest ask for; above [`PARTS_MAX`] where it runs alone.
fn parts_per_sample(motor: &MotorCoordinates<f64>, input: &TerminalInput, effort: Effort) -> usize {
    match effort {
        Effort::Fixed { steps_per_sample } => {
            steps_per_sample.clamp(1, PARTS_MAX).next_power_of_two()
        }
        Effort::Exact => {
            let rate = motor.alpha_per_s.max(motor.nu_per_s2.max(0.0).sqrt());
            let (mut parts, mut step_s) = (1, input.sample_interval_s);
            while parts <= PARTS_MAX && (step_s * rate > SERIES_REACH || rate.is_nan()) {
                parts *= 2;
                step_s *= 0.5;
            }
            parts
        }
    }
}

fn alone(
    motors: &[MotorCoordinates<f64>],
    member: usize,
    input: &TerminalInput,
    sink: &mut impl BatchSink,
) {
    let mut out = MotorOutput::default();
    if motors[member].simulate(input, &mut out).is_ok() {
        for (instant, (p, q)) in out.active.iter().zip(&out.reactive).enumerate() {
            sink.output(instant, &[member], &[*p], &[*q]);
        }
    }
}

/// One step that all lanes take together.
struct Step {
    piece: Piece,
    duration_s: f64,
    /// The phasor at the output instant at the end of this step, if there is one.
    output: Option<[f64; 2]>,
}

/// The steps of the whole input for motors that take `parts` per sample.
fn steps(input: &TerminalInput, parts: usize) -> Vec<Step> {
    let samples = input.sample_count();
    let mut steps = Vec::with_capacity(samples * parts);
    let fine_s = input.sample_interval_s / input.points_per_sample as f64;
    let longest_s = input.sample_interval_s / parts as f64;
    let apart = input.points_per_sample / DENSE_POINTS;
    for sample in 0..samples.saturating_sub(1) {
        let origin = sample * input.points_per_sample;
        let dense = input.dense[sample];
        for_each_piece(input, sample, |piece, start, length| {
            let shares = if dense { (length / apart).max(1) } else { 1 };
            let mut share = if shares == 1 {
                *piece
            } else {
                piece.shortened(shares)
            };
            for i in 0..shares {
                halve(
                    &share,
                    fine_s * (length / shares) as f64,
                    longest_s,
                    &mut steps,
                );
                let end = start + (i + 1) * (length / shares) - origin;
                let at_sample = end == input.points_per_sample;
                if let Some(last) = steps.last_mut()
                    && (at_sample || dense && end.is_multiple_of(apart))
                {
                    last.output = Some(input.point(origin + end));
                }
                if i + 1 < shares {
                    share = share.next();
                }
            }
        });
    }
    steps
}

fn halve(piece: &Piece, duration_s: f64, longest_s: f64, steps: &mut Vec<Step>) {
    if duration_s <= longest_s * (1.0 + 1e-12) {
        steps.push(Step {
            piece: *piece,
            duration_s,
            output: None,
        });
        return;
    }
    let left = piece.shortened(2);
    halve(&left, 0.5 * duration_s, longest_s, steps);
    halve(&left.next(), 0.5 * duration_s, longest_s, steps);
}

/// Motors with the same steps.
struct Group<'a, K, const W: usize> {
    motors: &'a [MotorCoordinates<f64>],
    members: &'a [usize],
    input: &'a TerminalInput,
    steps: &'a [Step],
    exact: bool,
    sink: &'a mut K,
}

impl<K: BatchSink, const W: usize> WithSimd for Group<'_, K, W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for members in self.members.chunks(Lanes::<S, W>::COUNT) {
            let mut side = SideBySide::<S, W>::new(simd, self.motors, members, self.input);
            side.put(0, self.input.point(0), self.sink);
            let mut instant = 1;
            for step in self.steps {
                if self.exact {
                    side.exact_step(step);
                } else {
                    side.fixed_step(step);
                }
                if let Some(u) = step.output {
                    side.put(instant, u, self.sink);
                    instant += 1;
                }
            }
        }
    }
}

/// The lanes of some motors and, for what a lane does alone, their scalar movers.
struct SideBySide<'a, S: Simd, const W: usize> {
    simd: S,
    members: &'a [usize],
    movers: [Mover<f64>; LANES_MAX],
    alpha: Lanes<S, W>,
    nu: Lanes<S, W>,
    load: Lanes<S, W>,
    tolerance: Lanes<S, W>,
    strength: Lanes<S, W>,
    standstill: Lanes<S, W>,
    state: [Lanes<S, W>; 3],
    standing: Mask<S, W>,
}

/// A piece that some lanes have yet to take.
#[derive(Clone, Copy)]
struct Pending<S: Simd, const W: usize> {
    piece: Piece,
    duration_s: f64,
    lanes: Mask<S, W>,
    halvings: usize,
}

impl<'a, S: Simd, const W: usize> SideBySide<'a, S, W> {
    #[inline(always)]
    fn new(
        simd: S,
        motors: &[MotorCoordinates<f64>],
        members: &'a [usize],
        input: &TerminalInput,
    ) -> Self {
        // Lanes without a motor repeat the first.
        let motor = |lane: usize| motors[members[if lane < members.len() { lane } else { 0 }]];
        let movers = std::array::from_fn(|lane| mover(&motor(lane), input));
        let gather = |of: &dyn Fn(usize) -> f64| {
            Lanes::load(simd, &std::array::from_fn::<f64, LANES_MAX, _>(of))
        };
        let movers_of = &movers;
        let rest = |i: usize| gather(&|lane| movers_of[lane].rest()[i]);
        Self {
            simd,
            members,
            alpha: gather(&|lane| motor(lane).alpha_per_s),
            nu: gather(&|lane| motor(lane).nu_per_s2),
            load: rest(1),
            tolerance: gather(&|lane| movers_of[lane].tolerance()),
            strength: gather(&|lane| 2.0 / motor(lane).kappa),
            standstill: gather(&|lane| movers_of[lane].standstill()),
            state: [rest(0), rest(1), rest(2)],
            standing: Lanes::splat(simd, 1.0).less_than(Lanes::splat(simd, 0.0)),
            movers,
        }
    }

    /// The scalar run's steps, in all lanes that need them: where some lanes need half the step, those
    /// and no others take both halves.
    #[inline(always)]
    fn exact_step(&mut self, step: &Step) {
        let simd = self.simd;
        let whole = Pending {
            piece: step.piece,
            duration_s: step.duration_s,
            lanes: Lanes::splat(simd, 0.0).less_than(Lanes::splat(simd, 1.0)),
            halvings: 0,
        };
        // One entry per level of halving, and the piece in hand.
        let mut stack = [whole; HALVINGS_MAX + 2];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let now = stack[height];
            let refused = self.try_step(&now);
            if refused.none() {
                continue;
            }
            if now.halvings == HALVINGS_MAX {
                self.finish_alone(&now.piece, now.duration_s, refused);
                continue;
            }
            let left = Pending {
                piece: now.piece.shortened(2),
                duration_s: 0.5 * now.duration_s,
                lanes: refused,
                halvings: now.halvings + 1,
            };
            stack[height] = left;
            stack[height].piece = left.piece.next();
            stack[height + 1] = left;
            height += 2;
        }
    }

    /// Moves the wanted lanes whose step is good and returns those whose step must be shorter.
    #[inline(always)]
    fn try_step(&mut self, now: &Pending<S, W>) -> Mask<S, W> {
        let h = now.duration_s;
        let [a, b, s] = self.state;
        let reach = Lanes::splat(self.simd, SERIES_REACH);
        let start = [a, b, s * h];
        let too_long = now.lanes.and(reach.less_than(start[2].abs()));
        let tried = now.lanes.and_not(too_long);
        if tried.none() {
            return too_long;
        }
        let none = Lanes::splat(self.simd, 0.0);
        let constants = StepConstants {
            decay: self.alpha * h,
            acceleration: self.standing.select(none, self.nu * (h * h)),
            load: self.load,
        };
        let mut tails = Tails {
            tolerance: self.tolerance,
            decay: constants.decay,
            piece: &now.piece,
            running: tried,
            end: start,
        };
        let (series, _) = Series::run(start, &constants, &now.piece, &mut tails);
        let [end_a, end_b, end_r] = tails.end;
        let speed = end_r * (1.0 / h);
        let falling = s + series.first_rotation() * (1.0 / h);
        let stops = (falling.less_than(self.standstill)).or(speed.less_than(self.standstill));
        let mut refused = tails.running.or(tried.and(stops.and_not(self.standing)));
        let mut speed = speed;
        if !self.standing.none() {
            let [re, im] = now.piece.at(1.0);
            let starts = (end_b * re - end_a * im).less_than(self.load);
            refused = refused.or(tried.and(starts.and(self.standing)));
            speed = self.standing.select(s, speed);
        }
        let good = tried.and_not(refused);
        self.state = [
            good.select(end_a, a),
            good.select(end_b, b),
            good.select(speed, s),
        ];
        refused.or(too_long)
    }

    /// Moves the marked lanes over a piece one by one.
    #[cold]
    #[inline(never)]
    fn finish_alone(&mut self, piece: &Piece, duration_s: f64, marked: Mask<S, W>) {
        let mut columns = [[0.0; LANES_MAX]; 5];
        let [one, zero] = [1.0, 0.0].map(|x| Lanes::splat(self.simd, x));
        let [standing, marked] = [self.standing, marked].map(|m| m.select(one, zero));
        let [a, b, s] = self.state;
        for (column, lanes) in columns.iter_mut().zip([a, b, s, standing, marked]) {
            lanes.store(column);
        }
        #[allow(
            clippy::needless_range_loop,
            reason = "a lane is an index into five columns"
        )]
        for lane in 0..Lanes::<S, W>::COUNT {
            if columns[4][lane] < 0.5 {
                continue;
            }
            let mut state = State {
                flux: [columns[0][lane], columns[1][lane]],
                speed: columns[2][lane],
                standing: columns[3][lane] > 0.5,
            };
            self.movers[lane].advance(&mut state, piece, duration_s);
            columns[0][lane] = state.flux[0];
            columns[1][lane] = state.flux[1];
            columns[2][lane] = state.speed;
            columns[3][lane] = if state.standing { 1.0 } else { 0.0 };
        }
        self.state = [0, 1, 2].map(|c| Lanes::load(self.simd, &columns[c]));
        self.standing = zero.less_than(Lanes::load(self.simd, &columns[3]));
    }

    #[inline(always)]
    fn fixed_step(&mut self, step: &Step) {
        let h = step.duration_s;
        let [a, b, s] = self.state;
        let constants = StepConstants {
            decay: self.alpha * h,
            acceleration: self.nu * (h * h),
            load: self.load,
        };
        let [a, b, r] = Series::of_order_four([a, b, s * h], &constants, &step.piece);
        let speed = r * (1.0 / h);
        let speed = speed
            .less_than(self.standstill)
            .select(self.standstill, speed);
        self.state = [a, b, speed];
    }

    #[inline(always)]
    fn put(&self, instant: usize, u: [f64; 2], sink: &mut impl BatchSink) {
        let [active, reactive] = power(self.strength, [self.state[0], self.state[1]], u);
        let (mut p, mut q) = ([0.0; LANES_MAX], [0.0; LANES_MAX]);
        active.store(&mut p);
        reactive.store(&mut q);
        let count = self.members.len();
        sink.output(instant, self.members, &p[..count], &q[..count]);
    }
}

fn mover(motor: &MotorCoordinates<f64>, input: &TerminalInput) -> Mover<f64> {
    // Only motors with a steady state are in a group.
    let rest = motor.steady_state().unwrap_or([f64::NAN; 3]);
    Mover::new(motor, rest, input, 1.0)
}

/// The criterion of the scalar run in every lane; `end` takes each lane's sum at its own order.
struct Tails<'a, S: Simd, const W: usize> {
    tolerance: Lanes<S, W>,
    decay: Lanes<S, W>,
    piece: &'a Piece,
    running: Mask<S, W>,
    end: [Lanes<S, W>; 3],
}

impl<S: Simd, const W: usize> Ending<Lanes<S, W>> for Tails<'_, S, W> {
    #[inline(always)]
    fn ends(&mut self, series: &Series<Lanes<S, W>>, order: usize) -> bool {
        let [a0, b0, r0, a1, b1, r1] = series.last_two(order);
        let terms = a0.abs() + b0.abs() + r0.abs() + a1.abs() + b1.abs() + r1.abs();
        // NaN ends a lane.
        let mut further = self.tolerance.less_than(terms);
        if order <= super::input_pieces::DEGREE {
            let input = self.decay * input_beyond(self.piece, order);
            further = further.or(self.tolerance.less_than(input));
        }
        let still = self.running.and(further);
        let [a, b, r] = series.sum(order);
        self.end = [
            self.running.select(a, self.end[0]),
            self.running.select(b, self.end[1]),
            self.running.select(r, self.end[2]),
        ];
        self.running = still;
        still.none()
    }
}

#[cfg(test)]
mod tests;
