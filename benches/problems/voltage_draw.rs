//! Voltages of a bus near a fault: dips with and without recovery tails and swings.

use loadmodeld::truth::{Phasor, Random};

use super::{POINTS_PER_SAMPLE, RATE_FPS, SAMPLES};

/// When the dip begins, s; up to a sample later.
pub const EVENT_START_S: f64 = 1.0;

/// What the voltage does. Edges are as steep as the fine grid, 1/1920 s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// Depth of the dip, pu.
    pub depth: f64,
    /// Its duration, s.
    pub duration_s: f64,
    /// Its beginning, s.
    pub start_s: f64,
    /// Phase jump while it lasts, rad.
    pub phase_jump: f64,
    /// Level at which the voltage settles, below 1, pu.
    pub settles_below: f64,
    /// Part of the dip that remains at its end and dies away, pu, and its time constant, s.
    pub tail: f64,
    pub tail_s: f64,
    /// Swing after the dip: amplitude of the magnitude, pu, of the angle, rad, frequency, damping.
    pub swing: f64,
    pub angle_swing: f64,
    pub swing_hz: f64,
    pub swing_s: f64,
}

impl Disturbance {
    /// Depth 5 to 60 %, duration 0.05 to 0.6 s; half with a tail, half with a swing.
    pub fn draw(random: &mut Random) -> Self {
        let depth = random.between(0.05, 0.6);
        let (with_tail, with_swing) = (random.uniform() < 0.5, random.uniform() < 0.5);
        let zero_unless = |is: bool, value: f64| if is { value } else { 0.0 };
        Self {
            depth,
            duration_s: random.between(0.05, 0.6),
            start_s: EVENT_START_S + random.uniform() / RATE_FPS,
            phase_jump: 0.15 * random.normal(),
            settles_below: random.between(-0.01, 0.03),
            tail: zero_unless(with_tail, depth * random.between(0.1, 0.5)),
            tail_s: random.between(0.1, 1.5),
            swing: zero_unless(with_swing, random.between(0.005, 0.05)),
            angle_swing: zero_unless(with_swing, random.between(0.02, 0.2)),
            swing_hz: random.between(0.3, 2.0),
            swing_s: random.between(0.5, 4.0),
        }
    }

    /// The phasor on the fine grid, and the intervals between samples in which it jumps.
    pub fn grid(&self) -> (Vec<Phasor>, Vec<bool>) {
        let per_second = RATE_FPS * POINTS_PER_SAMPLE as f64;
        let count = (SAMPLES - 1) * POINTS_PER_SAMPLE + 1;
        let end_s = self.start_s + self.duration_s;
        let phasors = (0..count)
            .map(|k| self.phasor(k as f64 / per_second, end_s))
            .collect();
        let mut jumps = vec![false; SAMPLES - 1];
        for edge_s in [self.start_s, end_s] {
            // The last grid point before the edge.
            let before = (edge_s * per_second).ceil() as usize - 1;
            jumps[before / POINTS_PER_SAMPLE] = true;
        }
        (phasors, jumps)
    }

    fn phasor(&self, time_s: f64, end_s: f64) -> Phasor {
        if time_s < self.start_s {
            return Phasor::new(1.0, 0.0);
        }
        if time_s < end_s {
            return Phasor::from_polar(1.0 - self.depth, self.phase_jump);
        }
        let since = time_s - end_s;
        let wave =
            (std::f64::consts::TAU * self.swing_hz * since).sin() * (-since / self.swing_s).exp();
        let magnitude =
            1.0 - self.settles_below - self.tail * (-since / self.tail_s).exp() - self.swing * wave;
        Phasor::from_polar(magnitude, self.angle_swing * wave)
    }
}
