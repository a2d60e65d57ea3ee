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
    lanes::{InLanes, LANES_MAX, LaneScalar, Lanes, Mask, Slopes},
    power,
    taylor::{Ending, LONG, SHORT, Series, StepConstants, input_beyond},
};
use crate::{
    load_model::{TerminalInput, terminal::DENSE_POINTS},
    numerics::Scalar,
};
use pulp::{Arch, Simd, WithSimd};
use std::{marker::PhantomData, sync::OnceLock};

/// Steps per sample from which lanes side by side are no longer worth it.
const PARTS_MAX: usize = 64;
/// Registers side by side where the error is estimated, and where it is not: measured by
/// `benches/simulation.rs`.
const REGISTERS_EXACT: usize = 1;
const REGISTERS_FIXED: usize = 2;
/// Halvings of a step that lanes take side by side; what is still refused then, such as the instant of
/// standstill, each lane finishes alone.
const HALVINGS_MAX: usize = 5;
/// Steps after which a lane of a rough simulation tries longer parts again.
const LONGER_AFTER: usize = 3;
/// Numbers of steps per sample that can occur.
const STEP_COUNTS: usize = PARTS_MAX.ilog2() as usize + 1;

/// How much work a batch puts into each motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// As [`MotorCoordinates::simulate`], bit by bit.
    Exact,
    /// With so many times the exact tolerance per step, a few 1e-9 of the motor's power. For a search that
    /// makes what it finds exact in the end.
    Rough {
        /// Factor on the tolerance, at least 1.
        looseness: u32,
    },
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

    /// The same for derivative number `index` of the power, where the motors carry derivatives.
    #[inline(always)]
    fn slope(
        &mut self,
        instant: usize,
        motors: &[usize],
        index: usize,
        active: &[f64],
        reactive: &[f64],
    ) {
        let _ = (instant, motors, index, active, reactive);
    }
}

impl<F: FnMut(usize, &[usize], &[f64], &[f64])> BatchSink for F {
    #[inline(always)]
    fn output(&mut self, instant: usize, motors: &[usize], active: &[f64], reactive: &[f64]) {
        self(instant, motors, active, reactive);
    }
}

/// An input made ready for batches: its pieces, cut to the steps that motors ask for, are kept from the first
/// batch that needs them.
#[derive(Debug)]
pub struct BatchInput<'a> {
    input: &'a TerminalInput,
    /// By the binary logarithm of the number of steps per sample.
    steps: [OnceLock<Vec<Step>>; STEP_COUNTS],
}

impl<'a> BatchInput<'a> {
    /// Nothing is computed yet.
    #[must_use]
    pub fn new(input: &'a TerminalInput) -> Self {
        Self {
            input,
            steps: [const { OnceLock::new() }; STEP_COUNTS],
        }
    }

    /// `parts` is a power of two of at most [`PARTS_MAX`].
    fn steps(&self, parts: usize) -> &[Step] {
        self.steps[parts.ilog2() as usize].get_or_init(|| steps(self.input, parts))
    }
}

/// Simulates `motors` over one input and hands every output to `sink`.
///
/// Returns per motor whether it has a steady state; one that has none reaches the sink never, and a motor
/// whose numbers overflow disturbs no other.
pub fn simulate_batch(
    motors: &[MotorCoordinates<f64>],
    input: &BatchInput<'_>,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    simulate_batch_on(Arch::new(), motors, input, effort, sink)
}

/// The same with the derivatives that the motors carry. Side by side where the effort is
/// [`Effort::Rough`]; otherwise each by itself, as [`MotorCoordinates::simulate`].
pub fn simulate_batch_with_slopes(
    motors: &[MotorCoordinates<Slopes>],
    input: &BatchInput<'_>,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    simulate_batch_with_slopes_on(Arch::new(), motors, input, effort, sink)
}

/// As [`simulate_batch_with_slopes`] on a given instruction set.
fn simulate_batch_with_slopes_on(
    arch: Arch,
    motors: &[MotorCoordinates<Slopes>],
    input: &BatchInput<'_>,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    let rough = matches!(effort, Effort::Rough { .. });
    let mut side_by_side: Vec<(usize, usize)> = Vec::new();
    let verdicts: Vec<_> = (motors.iter().enumerate())
        .map(|(member, motor)| {
            motor.steady_state()?;
            let parts = parts_per_sample(motor, input.input, effort);
            if rough && parts <= PARTS_MAX {
                side_by_side.push((parts, member));
            } else {
                alone(motors, member, input.input, effort, sink);
            }
            Ok(())
        })
        .collect();
    // All in one group, as there are seldom more than registers hold; those of like needs together.
    side_by_side.sort_unstable();
    let members: Vec<usize> = side_by_side.iter().map(|(_, member)| *member).collect();
    let group = Members {
        motors,
        members: &members,
        input: input.input,
        steps: input.steps(1),
    };
    group.on_registers::<Rough, _>(arch, effort, sink);
    verdicts
}

/// As [`simulate_batch`] on a given instruction set.
fn simulate_batch_on(
    arch: Arch,
    motors: &[MotorCoordinates<f64>],
    input: &BatchInput<'_>,
    effort: Effort,
    sink: &mut impl BatchSink,
) -> Vec<Result<(), Infeasible>> {
    in_groups(motors, input, effort, sink, |group, sink| match effort {
        Effort::Fixed { .. } => {
            arch.dispatch(group.with::<Fixed, _, REGISTERS_FIXED>(effort, sink));
        }
        Effort::Exact => group.on_registers::<Exact, _>(arch, effort, sink),
        Effort::Rough { .. } => group.on_registers::<Rough, _>(arch, effort, sink),
    })
}

/// Calls `simulate` for the motors that take the same steps, group by group; very stiff ones run alone.
fn in_groups<A: LaneScalar, K: BatchSink>(
    motors: &[MotorCoordinates<A>],
    input: &BatchInput<'_>,
    effort: Effort,
    sink: &mut K,
    mut simulate: impl FnMut(&Members<'_, A>, &mut K),
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
                .then(|| parts_per_sample(motor, input.input, effort))
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
                alone(motors, member, input.input, effort, sink);
            }
            continue;
        }
        let group = Members {
            motors,
            members: &members,
            input: input.input,
            steps: input.steps(count),
        };
        simulate(&group, sink);
    }
    verdicts
}

/// Motors with the same steps.
#[derive(Clone, Copy)]
struct Members<'a, A> {
    motors: &'a [MotorCoordinates<A>],
    members: &'a [usize],
    input: &'a TerminalInput,
    steps: &'a [Step],
}

impl<'a, A: LaneScalar> Members<'a, A> {
    const fn with<'k, M, K, const W: usize>(
        self,
        effort: Effort,
        sink: &'k mut K,
    ) -> Group<'a, 'k, A, K, M, W> {
        Group {
            of: self,
            effort,
            sink,
            method: PhantomData,
        }
    }

    /// With one register of the fitting size per number: a rest that would leave half of one empty takes
    /// registers of half the size, which take half the time.
    fn on_registers<M: Method, K: BatchSink>(self, arch: Arch, effort: Effort, sink: &mut K) {
        let (wide, narrow) = split(arch, self.members);
        for (arch, members) in [(arch, wide), (narrower(arch), narrow)] {
            if !members.is_empty() {
                let some = Self { members, ..self };
                arch.dispatch(some.with::<M, K, REGISTERS_EXACT>(effort, sink));
            }
        }
    }
}

/// The members that fill registers, and the rest.
fn split(arch: Arch, members: &[usize]) -> (&[usize], &[usize]) {
    let (whole, half) = match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V4(_) => (8, 4),
        _ => (1, 0),
    };
    let rest = members.len() % whole;
    members.split_at(if rest <= half {
        members.len() - rest
    } else {
        members.len()
    })
}

fn narrower(arch: Arch) -> Arch {
    #[cfg(target_arch = "x86_64")]
    if let Arch::V4(_) = arch
        && let Some(v3) = pulp::x86::V3::try_new()
    {
        return Arch::V3(v3);
    }
    arch
}

/// Steps per sample that the motor's rates at rest ask for; above [`PARTS_MAX`] where it runs alone.
fn parts_per_sample<A: LaneScalar>(
    motor: &MotorCoordinates<A>,
    input: &TerminalInput,
    effort: Effort,
) -> usize {
    match effort {
        Effort::Fixed { steps_per_sample } => {
            steps_per_sample.clamp(1, PARTS_MAX).next_power_of_two()
        }
        Effort::Exact | Effort::Rough { .. } => {
            let (alpha, nu) = (motor.alpha_per_s.value(), motor.nu_per_s2.value());
            parts_for_rate(alpha.max(nu.max(0.0).sqrt()), input)
        }
    }
}

fn parts_for_rate(rate: f64, input: &TerminalInput) -> usize {
    let (mut parts, mut step_s) = (1, input.sample_interval_s);
    while parts <= PARTS_MAX && (step_s * rate > SERIES_REACH || rate.is_nan()) {
        parts *= 2;
        step_s *= 0.5;
    }
    parts
}

impl Effort {
    /// Tolerance relative to the exact one's.
    fn accuracy(self) -> f64 {
        match self {
            Self::Rough { looseness } => f64::from(looseness.max(1)),
            Self::Exact | Self::Fixed { .. } => 1.0,
        }
    }
}

fn alone<A: LaneScalar>(
    motors: &[MotorCoordinates<A>],
    member: usize,
    input: &TerminalInput,
    effort: Effort,
    sink: &mut impl BatchSink,
) {
    let mut out = MotorOutput::default();
    let accuracy = effort.accuracy();
    if motors[member]
        .simulate_to(accuracy, input, &mut out)
        .is_ok()
    {
        for (instant, (p, q)) in out.active.iter().zip(&out.reactive).enumerate() {
            let members = [member];
            sink.output(instant, &members, &[p.value()], &[q.value()]);
            for i in 0..A::DERIVATIVES {
                sink.slope(instant, &members, i, &[p.slope(i)], &[q.slope(i)]);
            }
        }
    }
}

/// One step that all lanes take together.
#[derive(Debug)]
struct Step {
    part: Part,
    /// The phasor at the output instant at the end of this step, if there is one.
    output: Option<[f64; 2]>,
}

/// What a step needs to know of the input.
#[derive(Clone, Copy, Debug)]
struct Part {
    piece: Piece,
    duration_s: f64,
    /// What the input still adds beyond orders 4, 6 and 8.
    beyond: [f64; 3],
}

impl Part {
    #[inline(always)]
    fn new(piece: Piece, duration_s: f64) -> Self {
        Self {
            beyond: [4, 6, 8].map(|order: usize| input_beyond(&piece, order)),
            piece,
            duration_s,
        }
    }

    #[inline(always)]
    fn left_half(&self) -> Self {
        Self::new(self.piece.shortened(2), 0.5 * self.duration_s)
    }

    /// The part of the same length that follows.
    #[inline(always)]
    fn following(&self) -> Self {
        Self::new(self.piece.next(), self.duration_s)
    }
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
            part: Part::new(*piece, duration_s),
            output: None,
        });
        return;
    }
    let left = piece.shortened(2);
    halve(&left, 0.5 * duration_s, longest_s, steps);
    halve(&left.next(), 0.5 * duration_s, longest_s, steps);
}

/// How lanes take a step.
trait Method {
    /// Whether the steps are the scalar run's.
    const EXACT: bool;

    /// Moves all lanes over a step.
    fn step<S: Simd, A: LaneScalar, const W: usize>(
        side: &mut SideBySide<'_, S, A, W>,
        step: &Step,
        stack: &mut Stack<S, W>,
    );

    /// Extends the series until `tails` are content; returns the rotation's slope at the start.
    fn run<S: Simd, N: InLanes<S, W>, const W: usize>(
        state: [N; 3],
        motor: &StepConstants<N>,
        piece: &Piece,
        tails: &mut Tails<S, N, W>,
    ) -> N;
}

/// As the scalar run, whatever order it takes.
struct Exact;
/// Up to order 6: straight code short enough for numbers with derivatives.
struct Rough;
/// One step of order four.
struct Fixed;

impl Method for Exact {
    const EXACT: bool = true;

    #[inline(always)]
    fn step<S: Simd, A: LaneScalar, const W: usize>(
        side: &mut SideBySide<'_, S, A, W>,
        step: &Step,
        stack: &mut Stack<S, W>,
    ) {
        side.adaptive_step::<Self>(step, stack);
    }

    #[inline(always)]
    fn run<S: Simd, N: InLanes<S, W>, const W: usize>(
        state: [N; 3],
        motor: &StepConstants<N>,
        piece: &Piece,
        tails: &mut Tails<S, N, W>,
    ) -> N {
        Series::<N, LONG>::run(state, motor, piece, tails)
            .0
            .first_rotation()
    }
}

impl Method for Rough {
    const EXACT: bool = false;

    #[inline(always)]
    fn step<S: Simd, A: LaneScalar, const W: usize>(
        side: &mut SideBySide<'_, S, A, W>,
        step: &Step,
        stack: &mut Stack<S, W>,
    ) {
        side.adaptive_step::<Self>(step, stack);
    }

    #[inline(always)]
    fn run<S: Simd, N: InLanes<S, W>, const W: usize>(
        state: [N; 3],
        motor: &StepConstants<N>,
        piece: &Piece,
        tails: &mut Tails<S, N, W>,
    ) -> N {
        Series::<N, SHORT>::run_short(state, motor, piece, tails)
    }
}

impl Method for Fixed {
    const EXACT: bool = false;

    #[inline(always)]
    fn step<S: Simd, A: LaneScalar, const W: usize>(
        side: &mut SideBySide<'_, S, A, W>,
        step: &Step,
        _: &mut Stack<S, W>,
    ) {
        side.fixed_step(step);
    }

    #[inline(always)]
    fn run<S: Simd, N: InLanes<S, W>, const W: usize>(
        state: [N; 3],
        _: &StepConstants<N>,
        _: &Piece,
        _: &mut Tails<S, N, W>,
    ) -> N {
        state[2]
    }
}

/// Motors with the same steps, and how they are simulated.
struct Group<'a, 'k, A, K, M, const W: usize> {
    of: Members<'a, A>,
    effort: Effort,
    sink: &'k mut K,
    method: PhantomData<M>,
}

impl<A: LaneScalar, K: BatchSink, M: Method, const W: usize> WithSimd
    for Group<'_, '_, A, K, M, W>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Members {
            motors,
            members,
            input,
            steps,
        } = self.of;
        for members in members.chunks(Lanes::<S, W>::COUNT) {
            let accuracy = self.effort.accuracy();
            let mut side = SideBySide::<S, A, W>::new(simd, motors, members, (input, accuracy));
            side.put(0, input.point(0), self.sink);
            let mut instant = 1;
            let Some(first) = steps.first() else {
                continue;
            };
            if !M::EXACT {
                side.halve_as_rates_ask(input, first.part.duration_s);
            }
            let mut stack = [Pending {
                part: first.part,
                lanes: side.standing,
                halvings: 0,
            }; HALVINGS_MAX + 2];
            for step in steps {
                M::step(&mut side, step, &mut stack);
                if let Some(u) = step.output {
                    side.put(instant, u, self.sink);
                    instant += 1;
                }
            }
        }
    }
}

/// The lanes of some motors and, for what a lane does alone, their scalar movers.
struct SideBySide<'a, S: Simd, A: LaneScalar, const W: usize> {
    simd: S,
    members: &'a [usize],
    movers: [Mover<A>; LANES_MAX],
    alpha: A::InLanes<S, W>,
    nu: A::InLanes<S, W>,
    load: A::InLanes<S, W>,
    tolerance: Lanes<S, W>,
    strength: A::InLanes<S, W>,
    standstill: Lanes<S, W>,
    state: [A::InLanes<S, W>; 3],
    standing: Mask<S, W>,
    /// How often each lane halves a step before it tries it, and how often at least.
    halvings: Lanes<S, W>,
    fewest_halvings: Lanes<S, W>,
    steps_taken: usize,
}

/// A part of a step that some lanes have yet to take.
#[derive(Clone, Copy)]
struct Pending<S: Simd, const W: usize> {
    part: Part,
    lanes: Mask<S, W>,
    halvings: usize,
}

/// One entry per level of halving, and the part in hand. Filled once, as it is as large as many registers.
type Stack<S, const W: usize> = [Pending<S, W>; HALVINGS_MAX + 2];

impl<'a, S: Simd, A: LaneScalar, const W: usize> SideBySide<'a, S, A, W> {
    #[inline(always)]
    fn new(
        simd: S,
        motors: &[MotorCoordinates<A>],
        members: &'a [usize],
        (input, accuracy): (&TerminalInput, f64),
    ) -> Self {
        // Lanes without a motor repeat the first.
        let motor = |lane: usize| motors[members[if lane < members.len() { lane } else { 0 }]];
        let movers = std::array::from_fn(|lane| mover(&motor(lane), input, accuracy));
        let gather =
            |of: &dyn Fn(usize) -> A| <A::InLanes<S, W> as InLanes<S, W>>::gather(simd, of);
        let numbers = |of: &dyn Fn(usize) -> f64| Lanes::<S, W>::gather(simd, of);
        let movers_of: &[Mover<A>; LANES_MAX] = &movers;
        let rest = |i: usize| gather(&|lane| movers_of[lane].rest()[i]);
        Self {
            simd,
            members,
            alpha: gather(&|lane| motor(lane).alpha_per_s),
            nu: gather(&|lane| motor(lane).nu_per_s2),
            load: rest(1),
            tolerance: numbers(&|lane| movers_of[lane].tolerance()),
            strength: gather(&|lane| A::constant(2.0) / motor(lane).kappa),
            standstill: numbers(&|lane| movers_of[lane].standstill()),
            state: [rest(0), rest(1), rest(2)],
            standing: Lanes::splat(simd, 1.0).less_than(Lanes::splat(simd, 0.0)),
            movers,
            halvings: Lanes::splat(simd, 0.0),
            fewest_halvings: Lanes::splat(simd, 0.0),
            steps_taken: 0,
        }
    }

    /// Steps in all lanes that need them: where some lanes need half the step, those and no others take
    /// both halves. With [`Exact`] these are the scalar run's steps; otherwise a lane that needed parts of
    /// a step does not try longer ones in vain all the time.
    #[inline(always)]
    fn adaptive_step<M: Method>(&mut self, step: &Step, stack: &mut Stack<S, W>) {
        let simd = self.simd;
        let mut lanes = Lanes::splat(simd, 0.0).less_than(Lanes::splat(simd, 1.0));
        let (mut part, mut halvings, mut height) = (&step.part, 0, 0);
        let mut taken;
        loop {
            let level = Lanes::splat(simd, halvings as f64);
            let mut refused = lanes;
            let waits = level.less_than(self.halvings);
            if M::EXACT || !lanes.and_not(waits).none() {
                let tried = if M::EXACT {
                    lanes
                } else {
                    lanes.and_not(waits)
                };
                let longer = self.try_step::<M>(part, tried);
                refused = longer.or(lanes.and_not(tried));
                if !M::EXACT {
                    let next = (level + 1.0).least(HALVINGS_MAX as f64);
                    self.halvings = longer.select(next, self.halvings);
                }
            }
            if !refused.none() {
                if halvings == HALVINGS_MAX {
                    self.finish_alone(&part.piece, part.duration_s, refused);
                } else {
                    let left = part.left_half();
                    for half in [left.following(), left] {
                        stack[height] = Pending {
                            part: half,
                            lanes: refused,
                            halvings: halvings + 1,
                        };
                        height += 1;
                    }
                }
            }
            if height == 0 {
                break;
            }
            height -= 1;
            taken = stack[height];
            (part, lanes, halvings) = (&taken.part, taken.lanes, taken.halvings);
        }
        if !M::EXACT {
            self.steps_taken += 1;
            if self.steps_taken.is_multiple_of(LONGER_AFTER) {
                let (longer, fewest) = (self.halvings + -1.0, self.fewest_halvings);
                self.halvings = fewest.less_than(longer).select(longer, fewest);
            }
        }
    }

    /// Sets how often at least each lane halves its steps, by its motor's rates at rest.
    #[inline(always)]
    fn halve_as_rates_ask(&mut self, input: &TerminalInput, step_s: f64) {
        let halvings = |lane: usize| {
            let motor: &Mover<A> = &self.movers[lane];
            let parts = parts_for_rate(motor.rate_at_rest(), input);
            let steps = (input.sample_interval_s / step_s).round().max(1.0);
            let halvings = (parts as f64 / steps).log2().ceil();
            halvings.clamp(0.0, HALVINGS_MAX as f64)
        };
        self.fewest_halvings = Lanes::<S, W>::gather(self.simd, &halvings);
        self.halvings = self.fewest_halvings;
    }

    /// Moves the wanted lanes whose step is good and returns those whose step must be shorter.
    #[inline(always)]
    fn try_step<M: Method>(&mut self, now: &Part, wanted: Mask<S, W>) -> Mask<S, W> {
        let h = now.duration_s;
        let [a, b, s] = self.state;
        let reach = Lanes::splat(self.simd, SERIES_REACH);
        let start = [a, b, s * h];
        let too_long = wanted.and(reach.less_than(start[2].part(0).abs()));
        let tried = wanted.and_not(too_long);
        if tried.none() {
            return too_long;
        }
        let none = InLanes::constant(Lanes::splat(self.simd, 0.0));
        let constants = StepConstants {
            decay: self.alpha * h,
            acceleration: InLanes::select(self.standing, none, self.nu * (h * h)),
            load: self.load,
        };
        let mut tails = Tails {
            tolerance: self.tolerance,
            decay: constants.decay.part(0),
            beyond: now.beyond,
            running: tried,
            end: start,
        };
        let slope = M::run(start, &constants, &now.piece, &mut tails);
        let [end_a, end_b, end_r] = tails.end;
        let speed = end_r * (1.0 / h);
        let falling = s.part(0) + slope.part(0) * (1.0 / h);
        let stops =
            (falling.less_than(self.standstill)).or(speed.part(0).less_than(self.standstill));
        let mut refused = tails.running.or(tried.and(stops.and_not(self.standing)));
        let mut speed = speed;
        if !self.standing.none() {
            let [re, im] = now.piece.at(1.0);
            let torque = end_b.part(0) * re - end_a.part(0) * im;
            let starts = torque.less_than(self.load.part(0));
            refused = refused.or(tried.and(starts.and(self.standing)));
            speed = InLanes::select(self.standing, s, speed);
        }
        let good = tried.and_not(refused);
        self.state = [
            InLanes::select(good, end_a, a),
            InLanes::select(good, end_b, b),
            InLanes::select(good, speed, s),
        ];
        refused.or(too_long)
    }

    /// Moves the marked lanes over a piece one by one.
    #[cold]
    #[inline(never)]
    fn finish_alone(&mut self, piece: &Piece, duration_s: f64, marked: Mask<S, W>) {
        let [one, zero] = [1.0, 0.0].map(|x| Lanes::splat(self.simd, x));
        let mut masks = [[0.0; LANES_MAX]; 2];
        for (column, mask) in masks.iter_mut().zip([self.standing, marked]) {
            mask.select(one, zero).store(column);
        }
        let [mut standing, marked] = masks;
        let mut columns = [[A::constant(0.0); LANES_MAX]; 3];
        for (column, lanes) in columns.iter_mut().zip(self.state) {
            lanes.scatter(column);
        }
        #[allow(
            clippy::needless_range_loop,
            reason = "a lane is an index into five columns"
        )]
        for lane in 0..Lanes::<S, W>::COUNT {
            if marked[lane] < 0.5 {
                continue;
            }
            let mut state = State {
                flux: [columns[0][lane], columns[1][lane]],
                speed: columns[2][lane],
                standing: standing[lane] > 0.5,
            };
            self.movers[lane].advance(&mut state, piece, duration_s);
            columns[0][lane] = state.flux[0];
            columns[1][lane] = state.flux[1];
            columns[2][lane] = state.speed;
            standing[lane] = if state.standing { 1.0 } else { 0.0 };
        }
        let columns = &columns;
        self.state = [0, 1, 2].map(|c: usize| InLanes::gather(self.simd, &|l| columns[c][l]));
        self.standing = zero.less_than(Lanes::load(self.simd, &standing));
    }

    #[inline(always)]
    fn fixed_step(&mut self, step: &Step) {
        let h = step.part.duration_s;
        let [a, b, s] = self.state;
        let constants = StepConstants {
            decay: self.alpha * h,
            acceleration: self.nu * (h * h),
            load: self.load,
        };
        let [a, b, r] = Series::of_order_four([a, b, s * h], &constants, &step.part.piece);
        let speed = r * (1.0 / h);
        let stops = speed.part(0).less_than(self.standstill);
        let standstill = InLanes::constant(self.standstill);
        self.state = [a, b, InLanes::select(stops, standstill, speed)];
    }

    #[inline(always)]
    fn put(&self, instant: usize, u: [f64; 2], sink: &mut impl BatchSink) {
        let [active, reactive] = power(self.strength, [self.state[0], self.state[1]], u);
        let (mut p, mut q) = ([0.0; LANES_MAX], [0.0; LANES_MAX]);
        let count = self.members.len();
        active.part(0).store(&mut p);
        reactive.part(0).store(&mut q);
        sink.output(instant, self.members, &p[..count], &q[..count]);
        for i in 1..<A::InLanes<S, W> as InLanes<S, W>>::PARTS {
            active.part(i).store(&mut p);
            reactive.part(i).store(&mut q);
            sink.slope(instant, self.members, i - 1, &p[..count], &q[..count]);
        }
    }
}

fn mover<A: Scalar>(motor: &MotorCoordinates<A>, input: &TerminalInput, accuracy: f64) -> Mover<A> {
    // Only motors with a steady state are in a group.
    let none = [A::constant(f64::NAN); 3];
    let rest = motor.steady_state().unwrap_or(none);
    Mover::new(motor, rest, input, accuracy)
}

/// The criterion of the scalar run in every lane; `end` takes each lane's sum at its own order.
struct Tails<S: Simd, N, const W: usize> {
    tolerance: Lanes<S, W>,
    decay: Lanes<S, W>,
    beyond: [f64; 3],
    running: Mask<S, W>,
    end: [N; 3],
}

impl<S: Simd, N: InLanes<S, W>, const W: usize, const TERMS: usize> Ending<N, TERMS>
    for Tails<S, N, W>
{
    #[inline(always)]
    fn ends(&mut self, series: &Series<N, TERMS>, order: usize) -> bool {
        let [a0, b0, r0, a1, b1, r1] = series.last_two(order);
        // A rough simulation is content with the last term: what is left out is smaller still.
        let terms = if TERMS == LONG {
            a0.part(0).abs()
                + b0.part(0).abs()
                + r0.part(0).abs()
                + a1.part(0).abs()
                + b1.part(0).abs()
                + r1.part(0).abs()
        } else {
            a1.part(0).abs() + b1.part(0).abs() + r1.part(0).abs()
        };
        // NaN ends a lane.
        let mut further = self.tolerance.less_than(terms);
        if order <= super::input_pieces::DEGREE {
            let input = self.decay * self.beyond[order / 2 - 2];
            further = further.or(self.tolerance.less_than(input));
        }
        let still = self.running.and(further);
        let [a, b, r] = series.sum(order);
        self.end = [
            InLanes::select(self.running, a, self.end[0]),
            InLanes::select(self.running, b, self.end[1]),
            InLanes::select(self.running, r, self.end[2]),
        ];
        self.running = still;
        still.none()
    }
}

#[cfg(test)]
mod tests;
