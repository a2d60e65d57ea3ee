//! Many motors over one input, side by side in vector registers.
//!
//! A motor's result does not depend on its companions and has the bits of
//! [`MotorCoordinates::simulate`]: lanes take the same steps that the motor would take alone. Motors are
//! grouped by the number of steps their rates ask for. What a lane cannot do in step with the others (an
//! error estimate above the tolerance, a rotor near standstill) is done for that lane alone, and very stiff
//! motors run alone altogether.

mod registers;
mod side_by_side;
mod standing;
mod steps;

use super::{
    Infeasible, MotorCoordinates, MotorOutput,
    advance::SERIES_REACH,
    input_pieces::Piece,
    lanes::{InLanes, LaneScalar, Lanes, Slopes},
    taylor::{LONG, SHORT, Series, StepConstants},
};
use crate::load_model::TerminalInput;
use pulp::{Arch, Simd, WithSimd};
use registers::{Abreast, Layout, has_spread};
use side_by_side::{Pending, SideBySide, Stack, Tails};
use std::{marker::PhantomData, sync::OnceLock};
use steps::{Step, steps};

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
    let rough = match effort {
        Effort::Rough { .. } => true,
        Effort::Exact if has_spread(arch) => {
            return in_groups(motors, input, effort, sink, |group, sink| {
                group.spread::<Exact, _>(arch, effort, sink);
            });
        }
        Effort::Exact | Effort::Fixed { .. } => false,
    };
    let mut members: Vec<usize> = Vec::new();
    let verdicts: Vec<_> = (motors.iter().enumerate())
        .map(|(member, motor)| {
            motor.steady_state()?;
            let parts = parts_per_sample(motor, input.input, effort);
            if rough && parts <= PARTS_MAX {
                members.push(member);
            } else {
                alone(motors, member, input.input, effort, sink);
            }
            Ok(())
        })
        .collect();
    // All in one group, as there are seldom more than registers hold; those of like needs together.
    members.sort_by(|&i, &j| {
        let needs = |i: usize| parts_per_sample(&motors[i], input.input, effort);
        (needs(i).cmp(&needs(j))).then(swing(&motors[i]).total_cmp(&swing(&motors[j])))
    });
    let group = Members {
        motors,
        indices: &members,
        input: input.input,
        steps: input.steps(1),
    };
    group.with_slopes(arch, effort, sink);
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
            arch.dispatch(group.with::<Fixed, Abreast, _, REGISTERS_FIXED>(effort, sink));
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
        let mut members: Vec<usize> = (0..motors.len())
            .filter(|&i| parts[i] == Some(count))
            .collect();
        // Those that swing fast are those that need parts of a step: in the same registers.
        members.sort_by(|&i, &j| swing(&motors[i]).total_cmp(&swing(&motors[j])));
        if count > PARTS_MAX {
            for member in members {
                alone(motors, member, input.input, effort, sink);
            }
            continue;
        }
        let group = Members {
            motors,
            indices: &members,
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
    indices: &'a [usize],
    input: &'a TerminalInput,
    steps: &'a [Step],
}

impl<'a, A: LaneScalar> Members<'a, A> {
    const fn with<'k, M, L, K, const W: usize>(
        self,
        effort: Effort,
        sink: &'k mut K,
    ) -> Group<'a, 'k, A, K, M, L, W> {
        Group {
            of: self,
            effort,
            sink,
            how: PhantomData,
        }
    }

    const fn only(self, indices: &'a [usize]) -> Self {
        Self { indices, ..self }
    }
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

/// What orders motors that take the same steps by how fast they swing.
fn swing<A: LaneScalar>(motor: &MotorCoordinates<A>) -> f64 {
    motor.nu_per_s2.value()
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

/// How lanes take a step.
trait Method {
    /// Whether the steps are the scalar run's.
    const EXACT: bool;

    /// Moves all lanes over a step.
    fn step<S: Simd, N: InLanes<S, W>, const W: usize>(
        side: &mut SideBySide<'_, S, N, W>,
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
    fn step<S: Simd, N: InLanes<S, W>, const W: usize>(
        side: &mut SideBySide<'_, S, N, W>,
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
    fn step<S: Simd, N: InLanes<S, W>, const W: usize>(
        side: &mut SideBySide<'_, S, N, W>,
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
    fn step<S: Simd, N: InLanes<S, W>, const W: usize>(
        side: &mut SideBySide<'_, S, N, W>,
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
struct Group<'a, 'k, A, K, M, L, const W: usize> {
    of: Members<'a, A>,
    effort: Effort,
    sink: &'k mut K,
    how: PhantomData<(M, L)>,
}

impl<A: LaneScalar, K: BatchSink, M: Method, L: Layout<A>, const W: usize> WithSimd
    for Group<'_, '_, A, K, M, L, W>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Members {
            motors,
            indices,
            input,
            steps,
        } = self.of;
        for members in indices.chunks(Lanes::<S, W>::COUNT) {
            let accuracy = self.effort.accuracy();
            let mut side =
                SideBySide::<S, L::Numbers<S, W>, W>::new(simd, motors, members, (input, accuracy));
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

#[cfg(test)]
mod tests;
