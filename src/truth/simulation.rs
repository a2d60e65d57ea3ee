//! Load and network together, from switching to switching and from one relay's instant to the next.

use super::{
    IntegratorOptions, Phasor, TruthError,
    integrator::Integrator,
    load::{Load, Operation, Terminal},
    network::{Action, Grid, MACHINE_STATES},
    solution::{Solution, Solver},
};

/// Least distance of the nodes, seconds. Between nodes phasors are taken as straight lines: with swings of
/// 10 rad/s and transients of 10 ms that is wrong by about 1e-5 pu.
pub(super) const NODE_STEP_S: f64 = 1e-3;
/// Nodes closer than this are the same, seconds.
const SAME_RASTER_S: f64 = 1e-9;
/// An instant is located to this width, seconds.
const LOCATED_S: f64 = 1e-9;
/// Instants closer than this are the same, seconds.
const SAME_INSTANT_S: f64 = 1e-12;
/// Most relays that may follow each other at one instant.
const CASCADE_MAX: usize = 500;

/// Measured voltage and current at an instant. A switching leaves two nodes at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    pub(super) time_s: f64,
    pub(super) voltage: Phasor,
    pub(super) current: Phasor,
}

/// A switching.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Switching {
    pub(super) time_s: f64,
    pub(super) action: Action,
}

/// A load on a grid, at some instant.
pub(super) struct Simulation {
    pub(super) grid: Grid,
    pub(super) load: Load,
    /// Machines first, then the load's parts.
    pub(super) state: Vec<f64>,
    /// What relays and controllers did.
    pub(super) log: Vec<Operation>,
    solver: Solver,
    options: IntegratorOptions,
}

impl Simulation {
    /// A grid and a load that fit each other, at rest; `terminal` is the voltage at the load itself.
    pub(super) fn new(
        grid: Grid,
        load: Load,
        terminal: Phasor,
        options: IntegratorOptions,
    ) -> Self {
        let mut state = grid.initial_state().to_vec();
        state.extend(load.initial_state());
        Self {
            grid,
            load,
            state,
            log: Vec::new(),
            solver: Solver::starting_from(terminal),
            options,
        }
    }

    /// Runs from 0 to `end_s` through `switchings`, which are in order of time.
    ///
    /// # Errors
    ///
    /// [`TruthError::NoNetworkSolution`], [`TruthError::StepTooSmall`] and
    /// [`TruthError::EndlessCascade`].
    pub(super) fn run(
        &mut self,
        end_s: f64,
        switchings: &[Switching],
    ) -> Result<Vec<Node>, TruthError> {
        let mut integrator = Integrator::new(self.options, self.state.len());
        let mut pending = switchings.iter().peekable();
        let mut time_s = 0.0;
        let (node, mut watch) = self.observe(time_s)?;
        let mut nodes = vec![node];
        while time_s < end_s {
            let switching_s = pending.peek().map_or(end_s, |s| s.time_s);
            let limit_s = switching_s.min(self.load.timer_s()).min(end_s);
            let mut called = true;
            if limit_s > time_s + SAME_INSTANT_S {
                let reached_s = self.step(&mut integrator, (time_s, limit_s))?;
                (time_s, called) =
                    self.follow(&integrator, (time_s, reached_s), &mut watch, &mut nodes)?;
                called |= time_s >= limit_s;
                if called && nodes.last().is_none_or(|node| node.time_s < time_s) {
                    nodes.push(self.observe(time_s)?.0);
                }
            }
            if called {
                let mut jumped = false;
                while let Some(switching) = pending.next_if(|s| s.time_s <= time_s + SAME_INSTANT_S)
                {
                    let (machines, _) = self.state.split_at_mut(MACHINE_STATES);
                    self.grid.switch(switching.action, machines);
                    jumped = true;
                }
                jumped |= self.let_relays_react(time_s)?;
                if jumped {
                    integrator.restart();
                    nodes.push(self.observe(time_s)?.0);
                }
                watch = self.observe(time_s)?.1;
            }
        }
        Ok(nodes)
    }

    /// One step of the integrator; `state` stays at its beginning.
    fn step(&mut self, integrator: &mut Integrator, span_s: (f64, f64)) -> Result<f64, TruthError> {
        let Self {
            grid,
            load,
            state,
            solver,
            ..
        } = self;
        integrator.step(span_s, state, &mut |time_s, state, slope| {
            let (machines, parts) = state.split_at(MACHINE_STATES);
            let found = solver.solve(grid, load, state, time_s)?;
            let (machine_slope, part_slope) = slope.split_at_mut(MACHINE_STATES);
            grid.derivatives(machines, found.voltage, found.current, machine_slope);
            let terminal = Terminal {
                time_s,
                voltage: found.terminal,
            };
            load.derivatives(terminal, parts, part_slope);
            Ok(())
        })
    }

    /// Goes through the step just taken, leaving nodes on the raster, up to its end or to the first instant at
    /// which a guard changed its sign; that instant, and whether it was a guard.
    fn follow(
        &mut self,
        integrator: &Integrator,
        (from_s, to_s): (f64, f64),
        watch: &mut Vec<f64>,
        nodes: &mut Vec<Node>,
    ) -> Result<(f64, bool), TruthError> {
        let spacing = self.options.nodes_every(to_s - from_s);
        let mut time_s = from_s;
        while time_s < to_s {
            let raster_s = raster_after(time_s, spacing);
            let next_s = raster_s.min(to_s);
            self.place(integrator, from_s, next_s, to_s);
            let (node, guards) = self.observe(next_s)?;
            if changed(watch, &guards) {
                let found_s = self.locate(integrator, (from_s, to_s), (time_s, next_s), watch)?;
                return Ok((found_s, true));
            }
            *watch = guards;
            if raster_s - next_s < SAME_RASTER_S {
                nodes.push(node);
            }
            time_s = next_s;
        }
        Ok((to_s, false))
    }

    /// Sets the state to that of the last step at `time_s`.
    fn place(&mut self, integrator: &Integrator, from_s: f64, time_s: f64, to_s: f64) {
        if time_s >= to_s {
            self.state.copy_from_slice(integrator.reached());
        } else {
            integrator.inside(time_s - from_s, &mut self.state);
        }
    }

    /// The first instant after a guard's change of sign between `left_s` and `right_s`, by
    /// bisection; leaves the state there.
    fn locate(
        &mut self,
        integrator: &Integrator,
        (from_s, to_s): (f64, f64),
        (mut left_s, mut right_s): (f64, f64),
        watch: &[f64],
    ) -> Result<f64, TruthError> {
        while right_s - left_s > LOCATED_S {
            let middle_s = 0.5 * (left_s + right_s);
            self.place(integrator, from_s, middle_s, to_s);
            if changed(watch, &self.observe(middle_s)?.1) {
                right_s = middle_s;
            } else {
                left_s = middle_s;
            }
        }
        self.place(integrator, from_s, right_s, to_s);
        Ok(right_s)
    }

    /// Lets relays look until none of them moves the voltage any more; whether one did.
    fn let_relays_react(&mut self, time_s: f64) -> Result<bool, TruthError> {
        let before = self.log.len();
        for _ in 0..CASCADE_MAX {
            let found = self.solve(time_s)?;
            let known = self.log.len();
            let terminal = Terminal {
                time_s,
                voltage: found.terminal,
            };
            let (_, parts) = self.state.split_at(MACHINE_STATES);
            self.load.react(terminal, parts, &mut self.log);
            if self.log.len() == known {
                // A timer that stays due would hold the clock for ever.
                if self.load.timer_s() <= time_s + SAME_INSTANT_S {
                    break;
                }
                return Ok(known > before);
            }
        }
        Err(TruthError::EndlessCascade { time_s })
    }

    fn solve(&mut self, time_s: f64) -> Result<Solution, TruthError> {
        self.solver
            .solve(&self.grid, &self.load, &self.state, time_s)
    }

    /// What is measured, and the guards of all relays.
    fn observe(&mut self, time_s: f64) -> Result<(Node, Vec<f64>), TruthError> {
        let found = self.solve(time_s)?;
        let (_, parts) = self.state.split_at(MACHINE_STATES);
        let mut guards = Vec::new();
        let terminal = Terminal {
            time_s,
            voltage: found.terminal,
        };
        self.load.guards(terminal, parts, &mut guards);
        let node = Node {
            time_s,
            voltage: found.voltage,
            current: found.current,
        };
        Ok((node, guards))
    }
}

fn changed(before: &[f64], after: &[f64]) -> bool {
    let pairs = before.iter().zip(after);
    pairs.into_iter().any(|(a, b)| (*a < 0.0) != (*b < 0.0))
}

/// The first instant of the raster of `spacing` nodes after `time_s`; never one so close that it is
/// the same.
fn raster_after(time_s: f64, spacing: f64) -> f64 {
    let step_s = NODE_STEP_S * spacing;
    let number = ((time_s + SAME_RASTER_S) / step_s).floor() + 1.0;
    number * step_s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::{
        MotorCircuit, Network, Zip,
        load::{Part, Supply},
        parts::{Motor, StaticLoad},
    };

    const W0: f64 = 376.991_118_430_775_2;
    const FAULT: [Switching; 2] = [
        Switching {
            time_s: 0.100_37,
            action: Action::Fault(Phasor::new(0.0, -8.0)),
        },
        Switching {
            time_s: 0.220_11,
            action: Action::Clear,
        },
    ];

    fn simulation(options: IntegratorOptions) -> Simulation {
        let voltage = Phasor::from_polar(0.99, -0.3);
        let motor = Motor::at_operating_point(MotorCircuit::default(), 0.4, voltage, W0).unwrap();
        let state = motor.initial_state();
        let motor_power = {
            let current = motor.current(rest(voltage), &state);
            voltage * current.conj()
        };
        let total = Phasor::new(0.9, 0.3);
        let shares = Zip {
            active_impedance: 0.4,
            active_current: 0.4,
            reactive_impedance: 0.8,
            reactive_current: 0.1,
        };
        let zip = StaticLoad::plain(shares, voltage, total - motor_power);
        let load = Load {
            supply: Supply::NONE,
            parts: vec![Box::new(zip), Box::new(motor)],
        };
        let current = (total / voltage).conj();
        let grid = Grid::at_operating_point(Network::default(), voltage, current, W0);
        Simulation::new(grid, load, voltage, options)
    }

    fn rest(voltage: Phasor) -> Terminal {
        Terminal {
            time_s: 0.0,
            voltage,
        }
    }

    fn tolerance(tolerance: f64) -> IntegratorOptions {
        IntegratorOptions {
            tolerance,
            ..IntegratorOptions::default()
        }
    }

    #[test]
    fn without_switching_nothing_moves() {
        let nodes = simulation(tolerance(1e-10)).run(2.0, &[]).unwrap();
        assert_eq!(nodes.len(), 2001);
        let drift = (nodes[2000].voltage - nodes[0].voltage).norm();
        assert!(drift < 1e-9, "{drift:e}");
        let power = nodes[0].voltage * nodes[0].current.conj();
        assert!((power - Phasor::new(0.9, 0.3)).norm() < 1e-12, "{power}");
    }

    #[test]
    fn a_tighter_tolerance_changes_the_result_by_less_than_the_looser_one_promised() {
        let end = |t: f64| {
            let nodes = simulation(tolerance(t)).run(1.0, &FAULT).unwrap();
            let last = nodes[nodes.len() - 1];
            last.voltage * last.current.conj()
        };
        let reference = end(1e-12);
        let errors = [1e-6, 1e-8, 1e-10].map(|t| (end(t) - reference).norm());
        assert!(errors[2] < 1e-8, "{errors:?}");
        assert!(
            errors[0] >= errors[1] && errors[1] >= errors[2],
            "{errors:?}"
        );
    }

    #[test]
    fn power_balances_at_every_node_and_a_switching_leaves_two() {
        let mut simulation = simulation(tolerance(1e-10));
        let nodes = simulation.run(0.5, &FAULT).unwrap();
        let doubled = nodes.windows(2).filter(|p| p[0].time_s >= p[1].time_s);
        assert_eq!(doubled.count(), 2);
        let last = nodes[nodes.len() - 1];
        let (machines, _) = simulation.state.split_at(MACHINE_STATES);
        let given: f64 = simulation
            .grid
            .machine_powers(machines, last.voltage, last.current)
            .iter()
            .sum();
        let taken = (last.voltage * last.current.conj()).re
            + simulation
                .grid
                .shunt_and_line_losses(machines, last.voltage, last.current);
        assert!((given - taken).abs() < 1e-11, "{given} {taken}");
    }

    #[test]
    fn torque_surplus_integrates_to_the_change_of_speed() {
        // Without stator resistance P of the motor is its torque on the load base, so that
        // M (w_end - w_start) = integral of (P - P_0): the trapezoidal sum over the nodes.
        let mut simulation = simulation(tolerance(1e-11));
        let speed_before = simulation.state[MACHINE_STATES + 2];
        let nodes = simulation.run(0.8, &FAULT).unwrap();
        let speed_after = simulation.state[MACHINE_STATES + 2];
        let zip_share = |node: &Node| {
            let load = &simulation.load.parts[0];
            (node.voltage * load.current(rest(node.voltage), &[]).conj()).re
        };
        let surplus = |node: &Node| (node.voltage * node.current.conj()).re - zip_share(node) - 0.4;
        let integral: f64 = nodes
            .windows(2)
            .map(|p| 0.5 * (surplus(&p[0]) + surplus(&p[1])) * (p[1].time_s - p[0].time_s))
            .sum();
        let inertia = MotorCircuit::default().on_load_base(0.4, W0).inertia;
        let momentum = inertia * (speed_after - speed_before);
        // The sum's own error: 1 ms nodes, transients of 10 ms.
        assert!((integral - momentum).abs() < 1e-5, "{integral} {momentum}");
        assert!(
            momentum.abs() > 1e-4,
            "the test must move something: {momentum}"
        );
    }

    #[test]
    fn a_load_beyond_the_grid_is_an_error_with_its_time() {
        // Constant power 0.9 + j 0.3 behind a near short circuit: the grid left can give 0.2.
        let voltage = Phasor::new(1.0, 0.0);
        let initial = Phasor::new(0.9, 0.3);
        let shares = Zip {
            active_impedance: 0.0,
            active_current: 0.0,
            reactive_impedance: 0.0,
            reactive_current: 0.0,
        };
        let constant_power = StaticLoad::plain(shares, voltage, initial);
        let load = Load {
            supply: Supply::NONE,
            parts: vec![Box::new(constant_power)],
        };
        let grid = Grid::at_operating_point(Network::default(), voltage, initial.conj(), W0);
        let short = [Switching {
            time_s: 0.05,
            action: Action::Fault(Phasor::new(0.0, -40.0)),
        }];
        let error = Simulation::new(grid, load, voltage, IntegratorOptions::default())
            .run(0.2, &short)
            .map(|nodes| nodes.len())
            .unwrap_err();
        let TruthError::NoNetworkSolution { time_s, .. } = error else {
            panic!("{error}");
        };
        assert!((time_s - 0.05).abs() < 1e-12, "{time_s}");
    }
}
