//! Load and network together, from switching to switching.

use super::{
    IntegratorOptions, Phasor, TruthError,
    integrator::Integrator,
    load::Load,
    network::{Action, Grid, MACHINE_STATES},
};

/// Distance of the nodes, which is also the raster on which relays look at the voltage, seconds.
/// Between nodes phasors are taken as straight lines: with swings of 10 rad/s and transients of
/// 10 ms that is wrong by less than 1e-5 pu.
pub(super) const NODE_STEP_S: f64 = 1e-3;

/// Terminal voltage and load current at an instant. A switching leaves two nodes at one instant.
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
    /// Last voltage solved, from which the next solution starts.
    voltage: Phasor,
    options: IntegratorOptions,
}

impl Simulation {
    /// A grid and a load that fit each other at `voltage`, at rest.
    pub(super) fn new(grid: Grid, load: Load, voltage: Phasor, options: IntegratorOptions) -> Self {
        let mut state = grid.initial_state().to_vec();
        state.extend(load.initial_state());
        Self {
            grid,
            load,
            state,
            voltage,
            options,
        }
    }

    /// Runs from 0 to `end_s` through `switchings`, which are in order of time.
    ///
    /// # Errors
    ///
    /// [`TruthError::NoNetworkSolution`] and [`TruthError::StepTooSmall`].
    pub(super) fn run(
        &mut self,
        end_s: f64,
        switchings: &[Switching],
    ) -> Result<Vec<Node>, TruthError> {
        let mut integrator = Integrator::new(self.options, self.state.len());
        let mut pending = switchings.iter().peekable();
        let mut nodes = vec![self.node(0.0)?];
        let mut time_s = 0.0;
        while time_s < end_s {
            let raster = raster_after(time_s).min(end_s);
            let next_s = pending.peek().map_or(raster, |s| s.time_s.min(raster));
            self.advance(&mut integrator, time_s, next_s)?;
            time_s = next_s;
            let node = self.node(time_s)?;
            nodes.push(node);
            let mut switched = self.load.scan(time_s, node.voltage.norm());
            while let Some(switching) = pending.next_if(|s| s.time_s <= time_s) {
                let (machines, _) = self.state.split_at_mut(MACHINE_STATES);
                self.grid.switch(switching.action, machines);
                switched = true;
            }
            if switched {
                nodes.push(self.node(time_s)?);
            }
        }
        Ok(nodes)
    }

    fn advance(
        &mut self,
        integrator: &mut Integrator,
        from_s: f64,
        to_s: f64,
    ) -> Result<(), TruthError> {
        let Self {
            grid,
            load,
            state,
            voltage,
            ..
        } = self;
        integrator.advance((from_s, to_s), state, &mut |time_s, state, slope| {
            let (machines, parts) = state.split_at(MACHINE_STATES);
            let (terminal, current) = solve(grid, load, state, *voltage, time_s)?;
            *voltage = terminal;
            let (machine_slope, part_slope) = slope.split_at_mut(MACHINE_STATES);
            grid.derivatives(machines, terminal, current, machine_slope);
            load.derivatives(terminal, parts, part_slope);
            Ok(())
        })
    }

    fn node(&mut self, time_s: f64) -> Result<Node, TruthError> {
        let (voltage, current) = solve(&self.grid, &self.load, &self.state, self.voltage, time_s)?;
        self.voltage = voltage;
        Ok(Node {
            time_s,
            voltage,
            current,
        })
    }
}

/// The first instant of the raster after `time_s`; never one so close that it is the same.
fn raster_after(time_s: f64) -> f64 {
    let number = (time_s / NODE_STEP_S + 1e-6).floor() + 1.0;
    number * NODE_STEP_S
}

/// Terminal voltage and load current that fit grid and load: Newton's method on
/// `V - V_open + Z I(V) = 0` with a Jacobian from differences.
fn solve(
    grid: &Grid,
    load: &Load,
    state: &[f64],
    start: Phasor,
    time_s: f64,
) -> Result<(Phasor, Phasor), TruthError> {
    const MISMATCH_MAX_PU: f64 = 1e-12;
    const ITERATIONS_MAX: usize = 60;
    const DIFFERENCE_PU: f64 = 1e-7;
    let (machines, parts) = state.split_at(MACHINE_STATES);
    let (open, behind) = grid.seen_from_load(machines);
    let mismatch = |voltage: Phasor| voltage - open + behind * load.current(voltage, parts);
    let mut voltage = start;
    let mut left = mismatch(voltage);
    for _ in 0..ITERATIONS_MAX {
        if left.norm() <= MISMATCH_MAX_PU {
            return Ok((voltage, load.current(voltage, parts)));
        }
        let along_re = (mismatch(voltage + DIFFERENCE_PU) - left) / DIFFERENCE_PU;
        let along_im = (mismatch(voltage + Phasor::new(0.0, DIFFERENCE_PU)) - left) / DIFFERENCE_PU;
        let determinant = along_re.re * along_im.im - along_im.re * along_re.im;
        let step = Phasor::new(
            (left.re * along_im.im - along_im.re * left.im) / determinant,
            (along_re.re * left.im - left.re * along_re.im) / determinant,
        );
        (voltage, left) = damped(voltage, step, left.norm(), &mismatch);
    }
    Err(TruthError::NoNetworkSolution {
        time_s,
        mismatch_pu: left.norm(),
    })
}

/// The point along Newton's step, halved until the mismatch falls, and its mismatch.
fn damped(
    voltage: Phasor,
    step: Phasor,
    mismatch_before: f64,
    mismatch: &impl Fn(Phasor) -> Phasor,
) -> (Phasor, Phasor) {
    let mut factor = 1.0;
    loop {
        let next = voltage - step * factor;
        let left = mismatch(next);
        if left.norm() < mismatch_before || factor < 1e-3 {
            return (next, left);
        }
        factor *= 0.5;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::{
        MotorCircuit, Network, Zip, load::Part, motor::Motor, static_load::StaticLoad,
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
            let current = motor.current(voltage, &state);
            voltage * current.conj()
        };
        let total = Phasor::new(0.9, 0.3);
        let zip = StaticLoad {
            zip: Zip {
                active_impedance: 0.4,
                active_current: 0.4,
                reactive_impedance: 0.8,
                reactive_current: 0.1,
            },
            initial_voltage_pu: voltage.norm(),
            initial: total - motor_power,
        };
        let load = Load {
            parts: vec![Box::new(zip), Box::new(motor)],
        };
        let current = (total / voltage).conj();
        let grid = Grid::at_operating_point(Network::default(), voltage, current, W0);
        Simulation::new(grid, load, voltage, options)
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
            (node.voltage * load.current(node.voltage, &[]).conj()).re
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
        let constant_power = StaticLoad {
            zip: Zip {
                active_impedance: 0.0,
                active_current: 0.0,
                reactive_impedance: 0.0,
                reactive_current: 0.0,
            },
            initial_voltage_pu: 1.0,
            initial,
        };
        let load = Load {
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
