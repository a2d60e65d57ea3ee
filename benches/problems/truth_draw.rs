//! Loads drawn over the reference paper's box (14) and around the rows of its Table 1.

use loadmodeld::{
    identification::joint_problem::{ProblemOptions, outer_bounds},
    truth::{MotorCircuit, MotorGroup, Random, Zip},
};

use super::NOMINAL_HZ;

/// Where a truth comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// The box (14), logarithmically, as far as the search box of the program reaches.
    Box,
    /// Around a row of Table 1: 15 % of each motor parameter.
    NearTable1,
    /// The box (14) where its best model lies outside the program's search box.
    Beyond,
}

impl Family {
    /// Of ten problems five are of the box, four near Table 1, one beyond.
    pub fn of_index(index: usize) -> Self {
        match index % 10 {
            9 => Self::Beyond,
            even if even % 2 == 0 => Self::Box,
            _ => Self::NearTable1,
        }
    }

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::NearTable1 => "table_1",
            Self::Beyond => "beyond",
        }
    }
}

/// The nine parameters (11) per unit on the load base; `P_I = 1 - P_Z - P_P` and so for Q.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperParameters {
    pub m: f64,
    pub t0_prime_s: f64,
    pub x: f64,
    pub x_prime: f64,
    pub kpm: f64,
    pub p_z: f64,
    pub p_p: f64,
    pub q_z: f64,
    pub q_p: f64,
}

const fn row(values: [f64; 9]) -> PaperParameters {
    let [m, t0_prime_s, x, x_prime, kpm, p_z, p_p, q_z, q_p] = values;
    PaperParameters {
        m,
        t0_prime_s,
        x,
        x_prime,
        kpm,
        p_z,
        p_p,
        q_z,
        q_p,
    }
}

/// Table 1 of the reference paper.
#[rustfmt::skip]
const TABLE_1: [PaperParameters; 9] = [
    row([0.0015, 0.1963, 1.2901, 0.1228, 0.5024, 0.5365, 0.1008, 0.1000, 2.3497]),
    row([0.0024, 1.0852, 1.9606, 0.3837, 0.2102, 0.6153, 0.6177, 0.1000, 1.2660]),
    row([4.7646, 1.2844, 3.9603, 0.1022, 0.1000, 0.1000, 0.3840, 0.9000, 1.2975]),
    row([0.0016, 0.0402, 0.1434, 0.0700, 0.4998, 0.5312, 0.1000, 0.5913, 0.1000]),
    row([0.0015, 0.2524, 1.6960, 0.1256, 0.5024, 0.5352, 0.1000, 0.1000, 3.0032]),
    row([0.0010, 0.1294, 1.3634, 0.1243, 0.5449, 0.7485, 0.2297, 0.1204, 2.9980]),
    row([0.0015, 0.2702, 1.8553, 0.1261, 0.5049, 0.6471, 0.1915, 0.1000, 3.2525]),
    row([0.0015, 0.2331, 2.9249, 0.0990, 0.6469, 0.6161, 0.1040, 0.1000, 3.3122]),
    row([0.0018, 0.4246, 2.5739, 0.1261, 0.4907, 0.5273, 0.1273, 0.1000, 3.8614]),
];

impl PaperParameters {
    /// `ln alpha`, `ln nu`, `kappa` at V0 = P0 = 1 (9), (13).
    pub fn coordinates(&self) -> [f64; 3] {
        let strength = 1.0 / self.x_prime - 1.0 / self.x;
        [
            (self.x / (self.x_prime * self.t0_prime_s)).ln(),
            (strength / self.m).ln(),
            2.0 * self.kpm / strength,
        ]
    }

    /// `Q_ZIP0` over P0 by (12).
    pub fn q_zip0(&self, q0_over_p0: f64) -> f64 {
        let kappa = self.coordinates()[2];
        let square = 0.5 * (1.0 + (1.0 - kappa * kappa).max(0.0).sqrt()); // cos^2 delta_0
        let motor = (1.0 - (self.x - self.x_prime) / self.x * square) / self.x_prime;
        q0_over_p0 - motor
    }

    /// Linear coefficients of (10) relative to P0, in the order of `LinearCoefficients`.
    pub fn linear(&self, q0_over_p0: f64) -> [f64; 5] {
        let (p_zip0, q_zip0) = (1.0 - self.kpm, self.q_zip0(q0_over_p0));
        [
            self.kpm,
            self.p_z * p_zip0,
            (1.0 - self.p_z - self.p_p) * p_zip0,
            self.q_z * q_zip0 + 1.0 / self.x,
            (1.0 - self.q_z - self.q_p) * q_zip0,
        ]
    }

    /// The static part.
    pub fn zip(&self) -> Zip {
        Zip {
            active_impedance: self.p_z,
            active_current: 1.0 - self.p_z - self.p_p,
            reactive_impedance: self.q_z,
            reactive_current: 1.0 - self.q_z - self.q_p,
        }
    }

    /// In the order of (11).
    pub fn values(&self) -> [f64; 9] {
        let Self {
            m,
            t0_prime_s,
            x,
            x_prime,
            kpm,
            p_z,
            p_p,
            q_z,
            q_p,
        } = *self;
        [m, t0_prime_s, x, x_prime, kpm, p_z, p_p, q_z, q_p]
    }

    fn drawn_from_box(random: &mut Random) -> Self {
        let mut logarithmic = |low: f64, high: f64| random.between(low.ln(), high.ln()).exp();
        let (m, t0_prime_s) = (logarithmic(1e-3, 10.0), logarithmic(1e-3, 4.0));
        let (x, x_prime) = (logarithmic(1e-3, 4.0), logarithmic(1e-3, 4.0));
        let kpm = random.between(0.1, 0.95);
        let (p_z, p_p) = (random.between(0.1, 0.9), random.between(0.1, 0.9));
        let (q_z, q_p) = (random.between(0.1, 0.9), random.between(0.1, 4.0));
        row([m, t0_prime_s, x, x_prime, kpm, p_z, p_p, q_z, q_p])
    }

    fn drawn_near_table_1(random: &mut Random) -> Self {
        let about = TABLE_1[random.below(TABLE_1.len())].values();
        let bounds: [(f64, f64); 9] = [
            (0.001, 10.0),
            (0.001, 4.0),
            (0.001, 4.0),
            (0.001, 4.0),
            (0.1, 0.95),
            (0.1, 0.9),
            (0.1, 0.9),
            (0.1, 0.9),
            (0.1, 4.0),
        ];
        let mut values = about;
        for (value, (low, high)) in values.iter_mut().zip(bounds) {
            *value = (*value * (0.15 * random.normal()).exp()).clamp(low, high);
        }
        row(values)
    }

    /// The circuit with these constants: half of X' before the magnetising branch, rating = load
    /// base, so that the loading is the share `active_pu` itself.
    fn circuit(&self, active_pu: f64) -> MotorCircuit {
        let nominal = std::f64::consts::TAU * NOMINAL_HZ;
        let stator = 0.5 * self.x_prime;
        let (magnetising, behind) = (self.x - stator, self.x_prime - stator);
        let rotor = behind * magnetising / (magnetising - behind);
        MotorCircuit {
            stator_resistance: 0.0,
            stator_reactance: stator,
            magnetising_reactance: magnetising,
            rotor_resistance: (rotor + magnetising) / (nominal * self.t0_prime_s),
            rotor_reactance: rotor,
            inertia_s: 0.5 * self.m * nominal,
            load_factor: active_pu,
        }
    }

    /// The same motors at another share of the load: constants on their own power unchanged.
    fn with_share(&self, kpm: f64) -> Self {
        let factor = kpm / self.kpm;
        Self {
            m: self.m * factor,
            x: self.x / factor,
            x_prime: self.x_prime / factor,
            kpm,
            ..*self
        }
    }
}

/// A load.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    pub family: Family,
    /// All motors as one, where there is no second group.
    pub parameters: PaperParameters,
    /// A group of other motors that takes part of `Kpm`: the model cannot follow exactly.
    pub second_motor: Option<PaperParameters>,
    pub q0_over_p0: f64,
}

impl Truth {
    /// A load that exists and suits its family, or none.
    pub fn draw(family: Family, second_motor: bool, random: &mut Random) -> Option<Self> {
        let parameters = match family {
            Family::NearTable1 => PaperParameters::drawn_near_table_1(random),
            Family::Box | Family::Beyond => PaperParameters::drawn_from_box(random),
        };
        let q0_over_p0 = random.between(0.0, 0.5);
        let other = second_motor.then(|| {
            let share = parameters.kpm * random.between(0.25, 0.5);
            PaperParameters::drawn_near_table_1(random).with_share(share)
        });
        let truth = Self {
            family,
            parameters,
            second_motor: other,
            q0_over_p0,
        };
        truth.suits().then_some(truth)
    }

    /// The motors of the simulation.
    pub fn motors(&self) -> Vec<MotorGroup> {
        let group = |parameters: PaperParameters| MotorGroup {
            circuit: parameters.circuit(parameters.kpm),
            active_pu: parameters.kpm,
        };
        match self.second_motor {
            None => vec![group(self.parameters)],
            Some(second) => {
                let rest = self.parameters.kpm - second.kpm;
                vec![group(self.parameters.with_share(rest)), group(second)]
            }
        }
    }

    fn suits(&self) -> bool {
        let carries = |p: &PaperParameters| p.x_prime < p.x && p.coordinates()[2] < 0.98; // (13)
        if !(carries(&self.parameters) && self.second_motor.as_ref().is_none_or(carries)) {
            return false;
        }
        let bounds = outer_bounds();
        let outer = self.parameters.coordinates();
        let inside = (0..3).all(|i| bounds.lower[i] <= outer[i] && outer[i] <= bounds.upper[i]);
        let options = ProblemOptions::default();
        let linear = self.parameters.linear(self.q0_over_p0);
        let represented = (0..5)
            .all(|i| options.linear_lower[i] <= linear[i] && linear[i] <= options.linear_upper[i]);
        match self.family {
            Family::Beyond => !(inside && represented),
            Family::Box | Family::NearTable1 => inside && represented,
        }
    }
}
