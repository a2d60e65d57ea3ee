//! Rotors at standstill, moved over a whole step at once.
//!
//! While the rotor stands, (9) is the linear equation `dw/dt = lambda w + alpha u` with the constant
//! `lambda = -alpha + j s`. Where the phasor is a polynomial of time one of its solutions is a polynomial too,
//! and all others differ from that one by a multiple of `e^(lambda t)`: exact, however often the field sweeps
//! over the rotor within the step, where a series needs several steps. The flux at an instant of the step is thus
//! a linear form of the flux at its beginning and of the polynomial's coefficients, the same for all steps of a length.

use pulp::Simd;

use super::super::{
    advance::Mover,
    input_pieces::DEGREE,
    lanes::{InLanes, LANES_MAX, Lanes, Mask},
};
use super::steps::Part;
use crate::numerics::{Arithmetic, Scalar};

/// Parts of a step at whose ends the torque is held against the load's: a series would take as many
/// steps over a sample of 60 per second.
const CHECKS: usize = 4;
/// Terms of the phasor from order four on, together, that a rough simulation may leave out.
const CUBIC: f64 = 1e-9;
const TERMS: usize = DEGREE + 1;

/// The flux at some instants of a step as a linear form: `e^(lambda t)` times the flux at its beginning and a
/// complex factor per coefficient of the phasor.
#[derive(Clone, Copy, Debug)]
struct Form<N> {
    flux: [N; 2],
    phasor: [[N; 2]; TERMS],
}

/// The forms for steps of one length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standstill<S: Simd, N: InLanes<S, W>, const W: usize> {
    /// Length of the steps, seconds; not a number before the first.
    duration_s: f64,
    end: Form<N>,
    /// At the checks before the end; without derivatives.
    inside: [Form<Lanes<S, W>>; CHECKS - 1],
}

impl<S: Simd, N: InLanes<S, W>, const W: usize> Standstill<S, N, W> {
    /// For no step yet.
    #[inline(always)]
    pub(super) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Self {
            duration_s: f64::NAN,
            end: Form::filled(N::constant(zero)),
            inside: [Form::filled(zero); CHECKS - 1],
        }
    }

    /// Makes the forms those of steps of `duration_s`.
    #[inline(always)]
    pub(super) fn prepare(
        &mut self,
        simd: S,
        movers: &[Mover<N::Alone>; LANES_MAX],
        duration_s: f64,
    ) {
        if self.duration_s.to_bits() != duration_s.to_bits() {
            self.remake(simd, movers, duration_s);
        }
    }

    #[cold]
    #[inline(never)]
    fn remake(&mut self, simd: S, movers: &[Mover<N::Alone>; LANES_MAX], duration_s: f64) {
        self.duration_s = duration_s;
        let lanes = Lanes::<S, W>::COUNT;
        let mut forms = [Form::filled(N::Alone::constant(0.0)); LANES_MAX];
        for (form, mover) in forms.iter_mut().zip(movers).take(lanes) {
            *form = Form::after(1.0, mover.alpha(), mover.standstill(), duration_s);
        }
        let gathered = |of: &dyn Fn(usize) -> N::Alone| N::gather(simd, of);
        self.end = Form {
            flux: [0, 1].map(|c: usize| gathered(&|lane| forms[lane].flux[c])),
            phasor: std::array::from_fn(|k| {
                [0, 1].map(|c: usize| gathered(&|lane| forms[lane].phasor[k][c]))
            }),
        };
        let mut forms = [Form::filled(0.0); LANES_MAX];
        for (i, inside) in self.inside.iter_mut().enumerate() {
            let share = (i + 1) as f64 / CHECKS as f64;
            for (form, mover) in forms.iter_mut().zip(movers).take(lanes) {
                let alpha = mover.alpha().value();
                *form = Form::after(share, alpha, mover.standstill(), duration_s);
            }
            let gathered = |of: &dyn Fn(usize) -> f64| Lanes::gather(simd, of);
            *inside = Form {
                flux: [0, 1].map(|c: usize| gathered(&|lane| forms[lane].flux[c])),
                phasor: std::array::from_fn(|k| {
                    [0, 1].map(|c: usize| gathered(&|lane| forms[lane].phasor[k][c]))
                }),
            };
        }
    }

    /// The flux at the end of a step from `flux`, and the lanes whose motor's torque exceeds the load's at
    /// one of the checks: those start.
    #[inline(always)]
    pub(super) fn moved(
        &self,
        flux: [N; 2],
        load: Lanes<S, W>,
        part: &Part,
    ) -> ([N; 2], Mask<S, W>) {
        let u = &part.piece.phasor;
        let terms = if part.beyond[0] <= CUBIC { 4 } else { TERMS };
        let end = self.end.at(flux, u, terms);
        let values = [flux[0].part(0), flux[1].part(0)];
        let at_end = [end[0].part(0), end[1].part(0)];
        let mut starts = torque(at_end, part.piece.at(1.0)).less_than(load);
        let mut i = 0;
        while i < CHECKS - 1 {
            let here = self.inside[i].at(values, u, terms);
            let share = (i + 1) as f64 / CHECKS as f64;
            starts = starts.or(torque(here, part.piece.at(share)).less_than(load));
            i += 1;
        }
        (end, starts)
    }
}

// No closures and no iterators over lanes from here on: they would not be inlined by force.

#[inline(always)]
fn torque<N: Arithmetic>([a, b]: [N; 2], [re, im]: [f64; 2]) -> N {
    b * re - a * im
}

impl<N: Arithmetic> Form<N> {
    #[inline(always)]
    const fn filled(number: N) -> Self {
        Self {
            flux: [number; 2],
            phasor: [[number; 2]; TERMS],
        }
    }

    /// The flux there, given the flux at the beginning and the first `terms` coefficients of the phasor.
    #[inline(always)]
    fn at(&self, flux: [N; 2], phasor: &[[f64; 2]; TERMS], terms: usize) -> [N; 2] {
        let [x, y] = self.flux;
        let mut re = x * flux[0] - y * flux[1];
        let mut im = x * flux[1] + y * flux[0];
        let mut k = 0;
        while k < terms {
            let ([x, y], u) = (self.phasor[k], phasor[k]);
            re = re + (x * u[0] - y * u[1]);
            im = im + (x * u[1] + y * u[0]);
            k += 1;
        }
        [re, im]
    }
}

impl<A: Scalar> Form<A> {
    /// At the instant `share` of a step of `duration_s`. With `p` the polynomial that solves the equation
    /// for the phasor `t^k`, the factor of that coefficient is `p(t) - e^(lambda t) p(0)`; its own
    /// coefficients follow from the highest one down: `lambda h p_j = (j + 1) p_(j + 1)`,
    /// `lambda p_k = -alpha`.
    fn after(share: f64, alpha: A, speed: f64, duration_s: f64) -> Self {
        let (sine, cosine) = (speed * duration_s * share).sin_cos();
        let decay = (alpha * (-duration_s * share)).exp();
        let turned = [decay * cosine, decay * sine];
        let square = alpha * alpha + speed * speed;
        let inverse = [-alpha / square, A::constant(-speed) / square];
        let pace = inverse.map(|part| part * (1.0 / duration_s));
        let gain = inverse.map(|part| -(alpha * part));
        let phasor = std::array::from_fn(|k| {
            let (mut p, mut there) = (gain, gain);
            for j in (0..k).rev() {
                p = product(pace, p).map(|part| part * (j + 1) as f64);
                there = [there[0] * share + p[0], there[1] * share + p[1]];
            }
            let back = product(turned, p);
            [there[0] - back[0], there[1] - back[1]]
        });
        Self {
            flux: turned,
            phasor,
        }
    }
}

/// Product of two complex numbers.
fn product<N: Arithmetic>(x: [N; 2], y: [N; 2]) -> [N; 2] {
    [x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::Sensitivities;

    const PHASOR: [[f64; 2]; TERMS] = [
        [0.7, 0.1],
        [0.2, -0.3],
        [-0.1, 0.05],
        [0.03, 0.02],
        [0.01, -0.02],
        [-0.02, 0.01],
        [0.01, 0.01],
        [0.005, -0.01],
        [-0.01, 0.01],
    ];

    /// The same by many steps of the classical Runge-Kutta method, time in parts of the step.
    fn integrated(share: f64, alpha: f64, speed: f64, duration_s: f64, flux: [f64; 2]) -> [f64; 2] {
        let slope = |t: f64, [a, b]: [f64; 2]| {
            let u = (PHASOR.iter().rev()).fold([0.0; 2], |s, c| [s[0] * t + c[0], s[1] * t + c[1]]);
            [
                duration_s * (alpha * (u[0] - a) - speed * b),
                duration_s * (alpha * (u[1] - b) + speed * a),
            ]
        };
        let (steps, mut x) = (4000, flux);
        let h = share / f64::from(steps);
        let moved = |x: [f64; 2], k: [f64; 2], by: f64| [x[0] + by * k[0], x[1] + by * k[1]];
        for i in 0..steps {
            let t = h * f64::from(i);
            let k1 = slope(t, x);
            let k2 = slope(t + 0.5 * h, moved(x, k1, 0.5 * h));
            let k3 = slope(t + 0.5 * h, moved(x, k2, 0.5 * h));
            let k4 = slope(t + h, moved(x, k3, h));
            for c in 0..2 {
                x[c] += h / 6.0 * (k1[c] + 2.0 * (k2[c] + k3[c]) + k4[c]);
            }
        }
        x
    }

    #[test]
    fn the_form_is_the_solution_of_the_equation_at_standstill() {
        let (speed, flux) = (-377.0, [0.4, -0.2]);
        for (alpha, duration_s) in [(0.5, 1.0 / 60.0), (40.0, 1.0 / 30.0), (300.0, 0.01)] {
            for share in [0.25, 1.0] {
                let form = Form::after(share, alpha, speed, duration_s);
                let here = form.at(flux, &PHASOR, TERMS);
                let expected = integrated(share, alpha, speed, duration_s, flux);
                for c in 0..2 {
                    let error = (here[c] - expected[c]).abs();
                    assert!(error < 1e-9, "{alpha} {duration_s} {share}: {error:e}");
                }
            }
        }
    }

    #[test]
    fn its_derivative_is_that_of_its_value() {
        type Number = Sensitivities<1>;
        let at =
            |alpha: f64| Form::after(1.0, alpha, -377.0, 1.0 / 60.0).at([0.4, -0.2], &PHASOR, 4);
        let form = Form::after(1.0, Number::variable(20.0, 0), -377.0, 1.0 / 60.0);
        let here = form.at([0.4, -0.2].map(Number::constant), &PHASOR, 4);
        let (more, less) = (at(20.001), at(19.999));
        for c in 0..2 {
            let difference = (more[c] - less[c]) / 0.002;
            let error = (here[c].derivative(0) - difference).abs();
            assert!(error < 1e-9, "{difference:e}: {error:e}");
        }
    }
}
