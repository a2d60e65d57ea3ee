//! Some motors in the lanes of registers, and how they move from step to step.

use pulp::Simd;

use super::super::{
    MotorCoordinates,
    advance::{Mover, SERIES_REACH, State},
    input_pieces::{DEGREE, Piece},
    lanes::{InLanes, LANES_MAX, Lanes, Mask},
    power,
    taylor::{Ending, LONG, Series, StepConstants},
};
use super::{
    BatchSink, HALVINGS_MAX, LONGER_AFTER, Method, parts_for_rate,
    standing::Standstill,
    steps::{Part, Step},
};
use crate::{load_model::TerminalInput, numerics::Scalar};

/// The lanes of some motors and, for what a lane does alone, their scalar movers.
pub(super) struct SideBySide<'a, S: Simd, N: InLanes<S, W>, const W: usize> {
    simd: S,
    members: &'a [usize],
    movers: [Mover<N::Alone>; LANES_MAX],
    alpha: N,
    nu: N,
    load: N,
    tolerance: Lanes<S, W>,
    /// Real part of the flux at rest.
    rest_real: Lanes<S, W>,
    strength: N,
    standstill: Lanes<S, W>,
    state: [N; 3],
    pub(super) standing: Mask<S, W>,
    at_standstill: Standstill<S, N, W>,
    /// Speed of the field over a standing rotor, rad/s.
    sweep: f64,
    /// How often each lane halves a step before it tries it, and how often at least.
    halvings: Lanes<S, W>,
    fewest_halvings: Lanes<S, W>,
    steps_taken: usize,
}

/// A part of a step that some lanes have yet to take.
#[derive(Clone, Copy)]
pub(super) struct Pending<S: Simd, const W: usize> {
    pub(super) part: Part,
    pub(super) lanes: Mask<S, W>,
    pub(super) halvings: usize,
}

/// One entry per level of halving, and the part in hand. Filled once, as it is as large as many registers.
pub(super) type Stack<S, const W: usize> = [Pending<S, W>; HALVINGS_MAX + 2];

impl<'a, S: Simd, N: InLanes<S, W>, const W: usize> SideBySide<'a, S, N, W> {
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        motors: &[MotorCoordinates<N::Alone>],
        members: &'a [usize],
        (input, accuracy): (&TerminalInput, f64),
    ) -> Self {
        // Lanes without a motor repeat the first.
        let motor = |lane: usize| motors[members[if lane < members.len() { lane } else { 0 }]];
        let movers = std::array::from_fn(|lane| mover(&motor(lane), input, accuracy));
        let gather = |of: &dyn Fn(usize) -> N::Alone| N::gather(simd, of);
        let numbers = |of: &dyn Fn(usize) -> f64| Lanes::<S, W>::gather(simd, of);
        let movers_of: &[Mover<N::Alone>; LANES_MAX] = &movers;
        let rest = |i: usize| gather(&|lane| movers_of[lane].rest()[i]);
        Self {
            simd,
            members,
            alpha: gather(&|lane| motor(lane).alpha_per_s),
            nu: gather(&|lane| motor(lane).nu_per_s2),
            load: rest(1),
            tolerance: numbers(&|lane| movers_of[lane].tolerance()),
            rest_real: rest(0).part(0),
            strength: gather(&|lane| N::Alone::constant(2.0) / motor(lane).kappa),
            standstill: numbers(&|lane| movers_of[lane].standstill()),
            state: [rest(0), rest(1), rest(2)],
            standing: Lanes::splat(simd, 1.0).less_than(Lanes::splat(simd, 0.0)),
            at_standstill: Standstill::new(simd),
            sweep: input.synchronous_speed_rad_s.abs(),
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
    pub(super) fn adaptive_step<M: Method>(&mut self, step: &Step, stack: &mut Stack<S, W>) {
        let simd = self.simd;
        let mut lanes = Lanes::splat(simd, 0.0).less_than(Lanes::splat(simd, 1.0));
        let (mut part, mut halvings, mut height) = (&step.part, 0, 0);
        let mut taken;
        // Over shorter steps the series is as good.
        let sweeps = part.duration_s * self.sweep > SERIES_REACH;
        if !M::EXACT && sweeps && !self.standing.none() {
            lanes = self.stand(part, lanes);
        }
        while !lanes.none() {
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

    /// Moves those of the lanes that stand, and keep standing, over a step; returns the others.
    #[inline(always)]
    fn stand(&mut self, part: &Part, lanes: Mask<S, W>) -> Mask<S, W> {
        (self.at_standstill).prepare(self.simd, &self.movers, part.duration_s);
        let [a, b, _] = self.state;
        let (end, starts) = (self.at_standstill).moved([a, b], self.load.part(0), part);
        let moved = lanes.and(self.standing).and_not(starts);
        self.state[0] = InLanes::select(moved, end[0], a);
        self.state[1] = InLanes::select(moved, end[1], b);
        lanes.and_not(moved)
    }

    /// Sets how often at least each lane halves its steps, by its motor's rates at rest.
    #[inline(always)]
    pub(super) fn halve_as_rates_ask(&mut self, input: &TerminalInput, step_s: f64) {
        let halvings = |lane: usize| {
            let motor: &Mover<N::Alone> = &self.movers[lane];
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
            tolerance: if M::EXACT {
                self.tolerance
            } else {
                self.tolerance_as_it_swings()
            },
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

    /// The tolerance relative to the power that a motor draws at the moment, where that is more than at rest: a weakly
    /// loaded rotor that swings far draws a hundred times as much.
    #[inline(always)]
    fn tolerance_as_it_swings(&self) -> Lanes<S, W> {
        let [a, b, _] = self.state;
        let (rest_a, rest_b) = (self.rest_real, self.load.part(0));
        let apart = (a.part(0) - rest_a).abs() + (b.part(0) - rest_b).abs();
        // Power is flux times the strength; at rest it is one.
        self.tolerance * (apart * self.strength.part(0) + 1.0)
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
        let mut columns = [[N::Alone::constant(0.0); LANES_MAX]; 3];
        for (column, lanes) in columns.iter_mut().zip(self.state) {
            lanes.scatter(column);
        }
        // Lanes without a motor repeat the first.
        let members = self.members.len();
        for lane in 0..Lanes::<S, W>::COUNT {
            if lane >= members {
                for column in &mut columns {
                    column[lane] = column[0];
                }
                standing[lane] = standing[0];
                continue;
            }
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
    pub(super) fn fixed_step(&mut self, step: &Step) {
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
    pub(super) fn put(&self, instant: usize, u: [f64; 2], sink: &mut impl BatchSink) {
        let [active, reactive] = power(self.strength, [self.state[0], self.state[1]], u);
        let (mut p, mut q) = ([0.0; LANES_MAX], [0.0; LANES_MAX]);
        let count = self.members.len();
        active.part(0).store(&mut p);
        reactive.part(0).store(&mut q);
        sink.output(instant, self.members, &p[..count], &q[..count]);
        for i in 1..N::PARTS {
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
pub(super) struct Tails<S: Simd, N, const W: usize> {
    tolerance: Lanes<S, W>,
    decay: Lanes<S, W>,
    beyond: [f64; 3],
    running: Mask<S, W>,
    /// Of lanes whose series has ended; of the others the start.
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
        if order <= DEGREE {
            let input = self.decay * self.beyond[order / 2 - 2];
            further = further.or(self.tolerance.less_than(input));
        }
        let still = self.running.and(further);
        let ended = self.running.and_not(still);
        if !ended.none() {
            let [a, b, r] = series.sum(order);
            self.end = [
                InLanes::select(ended, a, self.end[0]),
                InLanes::select(ended, b, self.end[1]),
                InLanes::select(ended, r, self.end[2]),
            ];
        }
        self.running = still;
        still.none()
    }
}
