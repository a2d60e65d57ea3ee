//! The grid that feeds the load: two equivalent machines, a line, a bus where faults strike, a
//! transformer. What the load draws moves the voltage, and what the faults do moves the frequency.
//!
//! ```text
//!   local machine --jX_l--+-- bus --jX_t-- load
//!   grid          --Z_g---+    |
//!                            fault, capacitor
//! ```
//!
//! Machines: constant voltage behind a reactance, swing equation with damping, governor with droop:
//!
//! ```text
//! (1)  d angle/dt = w0 n
//! (2)  2 H dn/dt  = P_m - P_e - D n
//! (3)  T dP_m/dt  = P_set - n/R - P_m
//! ```
//!
//! Source: Kundur (1994), sections 3.9 and 11.1; the values are chosen to give an electromechanical
//! mode near 1 Hz and frequency declines of 0.1 to 0.5 Hz.

use super::Phasor;

/// Constants of the grid, per unit of the load base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Network {
    /// Reactance between the local machine and the bus.
    pub local_reactance: f64,
    /// Resistance of the grid's line.
    pub grid_resistance: f64,
    /// Reactance of the grid's line.
    pub grid_reactance: f64,
    /// Reactance between bus and load.
    pub transformer_reactance: f64,
    /// Share of the load's current that the local machine carries before the event.
    pub local_share: f64,
    /// Inertia constants of local machine and grid, s.
    pub inertia_s: [f64; 2],
    /// Damping of local machine and grid, pu power per pu speed.
    pub damping: [f64; 2],
    /// Droop of local machine and grid, pu speed per pu power.
    pub droop: [f64; 2],
    /// Time constant of the governors, s.
    pub governor_s: f64,
}

impl Default for Network {
    fn default() -> Self {
        Self {
            local_reactance: 0.25,
            grid_resistance: 0.015,
            grid_reactance: 0.12,
            transformer_reactance: 0.06,
            local_share: 0.4,
            inertia_s: [5.0, 45.0],
            damping: [8.0, 20.0],
            droop: [0.04, 0.006],
            governor_s: 2.5,
        }
    }
}

/// States of the two machines: angle, speed deviation and mechanical power of each.
pub(super) const MACHINE_STATES: usize = 6;

/// What switching does to the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Action {
    /// A fault of this admittance at the bus.
    Fault(Phasor),
    /// The fault is cleared.
    Clear,
    /// The grid's line has this many times its initial impedance.
    GridImpedance(f64),
    /// A susceptance is added at the bus (negative: removed).
    Capacitor(f64),
    /// The grid's power setting changes by this much, and its present power with it.
    GridPower(f64),
}

/// The network as switched at the moment, with its machines' voltages.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    constants: Network,
    nominal_rad_s: f64,
    magnitude: [f64; 2],
    angle: [f64; 2],
    power_setting: [f64; 2],
    line_impedance_factor: f64,
    fault: Phasor,
    capacitor: Phasor,
    /// Of the sources; kept because every step of a simulation needs them many times.
    admittances: [Phasor; 2],
    /// Inverse of everything connected to the bus.
    behind_bus: Phasor,
}

impl Grid {
    /// The network that gives `voltage` at a load that draws `current`, at rest.
    pub(super) fn at_operating_point(
        constants: Network,
        voltage: Phasor,
        current: Phasor,
        nominal_rad_s: f64,
    ) -> Self {
        let nothing = Phasor::new(0.0, 0.0);
        let mut grid = Self {
            constants,
            nominal_rad_s,
            magnitude: [1.0; 2],
            angle: [0.0; 2],
            power_setting: [0.0; 2],
            line_impedance_factor: 1.0,
            fault: nothing,
            capacitor: nothing,
            admittances: [nothing; 2],
            behind_bus: nothing,
        };
        grid.invert();
        let bus = voltage + Phasor::new(0.0, constants.transformer_reactance) * current;
        let shares = [constants.local_share, 1.0 - constants.local_share];
        for (machine, share) in shares.into_iter().enumerate() {
            let own = current * share;
            let behind = bus + grid.source_impedances()[machine] * own;
            grid.magnitude[machine] = behind.norm();
            grid.angle[machine] = behind.arg();
            grid.power_setting[machine] = (behind * own.conj()).re;
        }
        grid
    }

    pub(super) fn initial_state(&self) -> [f64; MACHINE_STATES] {
        let ([a, b], [p, q]) = (self.angle, self.power_setting);
        [a, 0.0, p, b, 0.0, q]
    }

    pub(super) fn switch(&mut self, action: Action, machines: &mut [f64]) {
        match action {
            Action::Fault(admittance) => self.fault = admittance,
            Action::Clear => self.fault = Phasor::new(0.0, 0.0),
            Action::GridImpedance(factor) => self.line_impedance_factor = factor,
            Action::Capacitor(susceptance) => self.capacitor += Phasor::new(0.0, susceptance),
            Action::GridPower(change) => {
                self.power_setting[1] += change;
                machines[5] += change;
            }
        }
        self.invert();
    }

    fn invert(&mut self) {
        self.admittances = self.source_impedances().map(|z| z.inv());
        let total = self.admittances[0] + self.admittances[1] + self.fault + self.capacitor;
        self.behind_bus = total.inv();
    }

    /// The voltage the load terminals have without load current, and the impedance behind it.
    pub(super) fn seen_from_load(&self, machines: &[f64]) -> (Phasor, Phasor) {
        let (admittances, sources) = (&self.admittances, self.sources(machines));
        let short = admittances[0] * sources[0] + admittances[1] * sources[1];
        let reactance = Phasor::new(0.0, self.constants.transformer_reactance);
        (short * self.behind_bus, self.behind_bus + reactance)
    }

    /// Rates of change of the machines' states, per second.
    pub(super) fn derivatives(
        &self,
        machines: &[f64],
        voltage: Phasor,
        current: Phasor,
        slope: &mut [f64],
    ) {
        let powers = self.machine_powers(machines, voltage, current);
        for (machine, electrical) in powers.into_iter().enumerate() {
            let at = 3 * machine;
            let (speed, mechanical) = (machines[at + 1], machines[at + 2]);
            let constants = &self.constants;
            let surplus = mechanical - electrical - constants.damping[machine] * speed;
            let wanted = self.power_setting[machine] - speed / constants.droop[machine];
            slope[at] = self.nominal_rad_s * speed; // (1)
            slope[at + 1] = surplus / (2.0 * constants.inertia_s[machine]); // (2)
            slope[at + 2] = (wanted - mechanical) / constants.governor_s; // (3)
        }
    }

    /// Active power that each machine gives.
    pub(super) fn machine_powers(
        &self,
        machines: &[f64],
        voltage: Phasor,
        current: Phasor,
    ) -> [f64; 2] {
        let bus = self.bus_voltage(voltage, current);
        let (sources, admittances) = (self.sources(machines), &self.admittances);
        [0, 1].map(|k| (sources[k] * ((sources[k] - bus) * admittances[k]).conj()).re)
    }

    pub(super) fn bus_voltage(&self, voltage: Phasor, current: Phasor) -> Phasor {
        voltage + Phasor::new(0.0, self.constants.transformer_reactance) * current
    }

    /// Admittance of a reactive fault with which a load that behaves like a constant impedance
    /// keeps `retained` of its voltage; found by bisection on its logarithm.
    pub(super) fn fault_for(
        &self,
        retained: f64,
        machines: &[f64],
        voltage: Phasor,
        current: Phasor,
    ) -> Phasor {
        let load = voltage / current;
        let kept = |susceptance: f64| {
            let mut faulted = *self;
            faulted.fault = Phasor::new(0.0, -susceptance);
            faulted.invert();
            let (open, behind) = faulted.seen_from_load(machines);
            (open * load / (load + behind)).norm() / voltage.norm()
        };
        let (mut low, mut high) = (-6.0, 12.0);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if kept(f64::exp(middle)) > retained {
                low = middle;
            } else {
                high = middle;
            }
        }
        Phasor::new(0.0, -f64::exp(0.5 * (low + high)))
    }

    /// Power that fault and capacitor take at `bus`, and what the lines lose.
    #[cfg(test)]
    pub(super) fn shunt_and_line_losses(
        &self,
        machines: &[f64],
        voltage: Phasor,
        current: Phasor,
    ) -> f64 {
        let bus = self.bus_voltage(voltage, current);
        let (sources, impedances) = (self.sources(machines), self.source_impedances());
        let shunt = (self.fault + self.capacitor).re * bus.norm_sqr();
        let lines: f64 = (0..2)
            .map(|k| ((sources[k] - bus) / impedances[k]).norm_sqr() * impedances[k].re)
            .sum();
        shunt + lines
    }

    fn sources(&self, machines: &[f64]) -> [Phasor; 2] {
        [
            Phasor::from_polar(self.magnitude[0], machines[0]),
            Phasor::from_polar(self.magnitude[1], machines[3]),
        ]
    }

    fn source_impedances(&self) -> [Phasor; 2] {
        let constants = &self.constants;
        let line = Phasor::new(constants.grid_resistance, constants.grid_reactance);
        [
            Phasor::new(0.0, constants.local_reactance),
            line * self.line_impedance_factor,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const W0: f64 = 376.991_118_430_775_2;

    fn grid() -> (Grid, Phasor, Phasor) {
        let voltage = Phasor::from_polar(0.99, -0.3);
        let current = (Phasor::new(0.9, 0.3) / voltage).conj();
        let grid = Grid::at_operating_point(Network::default(), voltage, current, W0);
        (grid, voltage, current)
    }

    #[test]
    fn the_operating_point_is_at_rest_and_gives_the_voltage_asked_for() {
        let (grid, voltage, current) = grid();
        let machines = grid.initial_state();
        let (open, behind) = grid.seen_from_load(&machines);
        assert!((open - behind * current - voltage).norm() < 1e-14);
        let mut slope = [1.0; MACHINE_STATES];
        grid.derivatives(&machines, voltage, current, &mut slope);
        assert!(slope.iter().all(|rate| rate.abs() < 1e-13), "{slope:?}");
    }

    #[test]
    fn machines_give_what_load_shunts_and_lines_take() {
        let (mut grid, voltage, current) = grid();
        let mut machines = grid.initial_state();
        grid.switch(Action::Fault(Phasor::new(0.4, -3.0)), &mut machines);
        let (open, behind) = grid.seen_from_load(&machines);
        let load = voltage / current;
        let now = open * load / (load + behind);
        let drawn = now / load;
        let given: f64 = grid.machine_powers(&machines, now, drawn).iter().sum();
        let taken = (now * drawn.conj()).re + grid.shunt_and_line_losses(&machines, now, drawn);
        assert!((given - taken).abs() < 1e-13, "{given} {taken}");
    }

    #[test]
    fn a_fault_is_sized_to_leave_the_voltage_asked_for() {
        let (mut grid, voltage, current) = grid();
        let mut machines = grid.initial_state();
        let fault = grid.fault_for(0.6, &machines, voltage, current);
        grid.switch(Action::Fault(fault), &mut machines);
        let (open, behind) = grid.seen_from_load(&machines);
        let load = voltage / current;
        let kept = (open * load / (load + behind)).norm() / voltage.norm();
        assert!((kept - 0.6).abs() < 1e-12, "{kept}");
    }

    #[test]
    fn a_capacitor_raises_the_voltage_by_its_share_of_the_short_circuit_power() {
        let (mut grid, ..) = grid();
        let mut machines = grid.initial_state();
        let (before, _) = grid.seen_from_load(&machines);
        grid.switch(Action::Capacitor(0.1), &mut machines);
        let (after, _) = grid.seen_from_load(&machines);
        // Y = 1/(j 0.25) + 1/(0.015 + j 0.12) = 1.0256 - j 12.2051; V'/V = Y/(Y + j 0.1):
        // |Y| = 12.2481, |Y + j 0.1| = sqrt(1.0256^2 + 12.1051^2) = 12.1485, ratio 1.00820.
        assert!((after.norm() / before.norm() - 1.008_20).abs() < 1e-5);
    }
}
