//! The terminal phasor between fine grid points: polynomials on pieces of each sample interval.
//!
//! The definition, for the interval from one sample to the next:
//!
//! 1. The polynomial of degree eight through the nine equidistant grid points of the interval, if its
//!    eighth difference is at most [`RESOLVED`] (the input is then smooth there and the
//!    polynomial's error of the order of the ninth difference, a fraction of that).
//! 2. Otherwise the same for each half, and for each quarter; halving stops where the nine points are
//!    neighbours on the grid.
//! 3. In what is left, between two neighbouring grid points: the cubic through four points around
//!    them if their third difference is at most [`STEP`], else the straight line. A
//!    jump is therefore a ramp over one fine interval, which keeps its time integral.

use super::super::TerminalInput;

/// Degree of the polynomials.
pub(super) const DEGREE: usize = 8;
/// Eighth difference up to which nine points resolve the phasor. At this value the polynomial's error
/// between the points is below 1e-7; halving the distance divides it by about 500.
const RESOLVED: f64 = 2e-8;
/// Third difference of four neighbouring grid points from which the phasor counts as jumping.
/// Insensitive: kinks of the slope lie below 1e-3, jumps that matter above.
const STEP: f64 = 1e-3;

/// A phasor as a polynomial of time over a piece, with the piece as unit of time: coefficients of
/// real and imaginary part, constant first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Piece {
    /// Coefficients.
    pub(super) phasor: [[f64; 2]; DEGREE + 1],
}

impl Piece {
    /// The phasor at `x` of the piece, 0 to 1.
    #[inline(always)]
    pub(super) fn at(&self, x: f64) -> [f64; 2] {
        let mut sum = self.phasor[DEGREE];
        for c in self.phasor[..DEGREE].iter().rev() {
            sum = [sum[0] * x + c[0], sum[1] * x + c[1]];
        }
        sum
    }

    /// The first `1/parts` of the piece, on its own unit of time. `parts` is a power of two.
    #[inline(always)]
    pub(super) fn shortened(mut self, parts: usize) -> Self {
        let share = 1.0 / parts as f64;
        let mut factor = share;
        for c in &mut self.phasor[1..] {
            *c = [c[0] * factor, c[1] * factor];
            factor *= share;
        }
        self
    }

    /// The piece of the same length that follows: the polynomial continued by one unit of time.
    #[inline(always)]
    pub(super) fn next(mut self) -> Self {
        let c = &mut self.phasor;
        for i in 0..DEGREE {
            for j in (i..DEGREE).rev() {
                c[j] = [c[j][0] + c[j + 1][0], c[j][1] + c[j + 1][1]];
            }
        }
        self
    }
}

/// Calls `visit` for the pieces of the interval after sample `sample` in order, with the fine grid
/// point each begins at and the number of fine intervals it covers.
#[inline(always)]
pub(super) fn for_each_piece(
    input: &TerminalInput,
    sample: usize,
    mut visit: impl FnMut(&Piece, usize, usize),
) {
    let fine = input.points_per_sample;
    let origin = sample * fine;
    if let Some(piece) = smooth(input, origin, fine) {
        visit(&piece, origin, fine);
        return;
    }
    for_each_finer_piece(input, origin, fine, &mut visit);
}

#[cold]
#[inline(never)]
fn for_each_finer_piece(
    input: &TerminalInput,
    origin: usize,
    length: usize,
    visit: &mut dyn FnMut(&Piece, usize, usize),
) {
    if length > DEGREE {
        for start in [origin, origin + length / 2] {
            match smooth(input, start, length / 2) {
                Some(piece) => visit(&piece, start, length / 2),
                None => for_each_finer_piece(input, start, length / 2, visit),
            }
        }
    } else {
        for start in origin..origin + length {
            visit(&finest(input, start), start, 1);
        }
    }
}

/// The polynomial through nine equidistant points, if they resolve the phasor.
#[inline(always)]
fn smooth(input: &TerminalInput, origin: usize, length: usize) -> Option<Piece> {
    let apart = length / DEGREE;
    let mut d = [[0.0; 2]; DEGREE + 1];
    let end = origin + length;
    let (real, imaginary) = (&input.real[origin..=end], &input.imaginary[origin..=end]);
    for (i, d) in d.iter_mut().enumerate() {
        *d = [real[i * apart], imaginary[i * apart]];
    }
    for order in 1..=DEGREE {
        for i in (order..=DEGREE).rev() {
            d[i] = [d[i][0] - d[i - 1][0], d[i][1] - d[i - 1][1]];
        }
    }
    // Written so that NaN is not resolved; it then stays where it is.
    let resolved = d[DEGREE][0].abs() <= RESOLVED && d[DEGREE][1].abs() <= RESOLVED;
    resolved.then(|| from_differences(d))
}

/// Newton's forward differences of nine points to coefficients on the unit interval.
#[inline(always)]
fn from_differences(mut d: [[f64; 2]; DEGREE + 1]) -> Piece {
    let mut factorial = 1.0;
    for (k, d) in d.iter_mut().enumerate().skip(1) {
        factorial *= k as f64;
        *d = [d[0] / factorial, d[1] / factorial];
    }
    // sum d_k y (y - 1) ... (y - k + 1) -> powers of y, innermost factor first.
    for node in (1..DEGREE).rev() {
        for j in node..DEGREE {
            let y = node as f64;
            d[j] = [d[j][0] - y * d[j + 1][0], d[j][1] - y * d[j + 1][1]];
        }
    }
    let mut scale = 1.0;
    for d in &mut d[1..] {
        scale *= DEGREE as f64;
        *d = [d[0] * scale, d[1] * scale];
    }
    Piece { phasor: d }
}

/// One fine interval where nothing longer resolves the phasor.
fn finest(input: &TerminalInput, start: usize) -> Piece {
    let last = input.real.len() - 1;
    let first = start.saturating_sub(1).min(last.saturating_sub(3));
    let mut piece = Piece {
        phasor: [[0.0; 2]; DEGREE + 1],
    };
    let parts = [&input.real, &input.imaginary];
    let third = |x: &[f64]| (x[first + 3] - x[first]) - 3.0 * (x[first + 2] - x[first + 1]);
    let smooth = last >= 3 && parts.iter().all(|x| third(x).abs() <= STEP);
    for (part, x) in parts.into_iter().enumerate() {
        let coefficients = if smooth {
            cubic(
                [x[first], x[first + 1], x[first + 2], x[first + 3]],
                start - first,
            )
        } else {
            [x[start], x[start + 1] - x[start], 0.0, 0.0]
        };
        for (c, value) in piece.phasor.iter_mut().zip(coefficients) {
            c[part] = value;
        }
    }
    piece
}

/// The cubic through four equidistant values, as a polynomial of the time after value `shift`.
fn cubic(x: [f64; 4], shift: usize) -> [f64; 4] {
    let (d1, d2) = (x[1] - x[0], x[2] - 2.0 * x[1] + x[0]);
    let d3 = (x[3] - x[0]) - 3.0 * (x[2] - x[1]);
    let mut c = [
        x[0],
        d1 - d2 / 2.0 + d3 / 3.0,
        d2 / 2.0 - d3 / 2.0,
        d3 / 6.0,
    ];
    for _ in 0..shift {
        for i in 0..3 {
            for j in (i..3).rev() {
                c[j] += c[j + 1];
            }
        }
    }
    // The interval begins at a grid point: its value exactly, not to rounding.
    c[0] = x[shift];
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    fn input(phasor: impl Fn(f64) -> [f64; 2]) -> TerminalInput {
        let (points, samples) = (32, 4);
        let grid: Vec<_> = (0..=(samples - 1) * points)
            .map(|i| phasor(i as f64 / points as f64))
            .collect();
        TerminalInput {
            real: grid.iter().map(|u| u[0]).collect(),
            imaginary: grid.iter().map(|u| u[1]).collect(),
            points_per_sample: points,
            sample_interval_s: 1.0 / 60.0,
            jumps: vec![false; samples - 1],
            dense: vec![false; samples - 1],
            synchronous_speed_rad_s: 376.99,
        }
    }

    fn pieces(input: &TerminalInput) -> Vec<(Piece, usize, usize)> {
        let mut all = Vec::new();
        for sample in 0..input.sample_count() - 1 {
            for_each_piece(input, sample, |p, start, length| {
                all.push((*p, start, length));
            });
        }
        all
    }

    fn largest_error(input: &TerminalInput, phasor: impl Fn(f64) -> [f64; 2]) -> f64 {
        let mut worst = 0.0_f64;
        for (piece, start, length) in pieces(input) {
            for i in 0..=40 {
                let x = f64::from(i) / 40.0;
                let exact = phasor((start as f64 + x * length as f64) / 32.0);
                let got = piece.at(x);
                worst = worst
                    .max((got[0] - exact[0]).abs())
                    .max((got[1] - exact[1]).abs());
            }
        }
        worst
    }

    #[test]
    fn a_smooth_phasor_is_one_piece_per_sample_good_to_1e_7() {
        // A dip of 70 % within three samples, and a swing of the angle.
        let phasor = |t: f64| {
            let v = 1.0 - 0.7 * (std::f64::consts::PI * t / 3.0).sin().powi(2);
            [v * (0.3 * t).cos(), v * (0.3 * t).sin()]
        };
        let input = input(phasor);
        let error = largest_error(&input, phasor);
        assert!(error < 1e-7, "{error:e}");
    }

    #[test]
    fn a_step_is_a_ramp_over_one_fine_interval_and_the_rest_is_long_pieces() {
        let phasor = |t: f64| [if t < 1.4 { 1.0 } else { 0.5 }, 0.0];
        let input = input(phasor);
        let all = pieces(&input);
        let ramp: Vec<_> = all
            .iter()
            .filter(|(p, ..)| p.phasor[1][0].abs() > 1e-9)
            .collect();
        assert_eq!(ramp.len(), 1);
        assert_eq!((ramp[0].1, ramp[0].2), (44, 1));
        assert!((ramp[0].0.phasor[1][0] + 0.5).abs() < 1e-15);
        assert!(all.len() < 16);
        assert_eq!(all.iter().map(|p| p.2).sum::<usize>(), 96);
    }

    #[test]
    fn shortened_and_continued_pieces_lie_on_the_same_polynomial() {
        let input = input(|t| [(0.4 * t).cos(), (0.4 * t).sin()]);
        let (whole, ..) = pieces(&input)[1];
        let mut part = whole.shortened(4);
        for quarter in 0..4 {
            for x in [0.0, 0.3, 1.0] {
                let [got, exact] = [part.at(x), whole.at((f64::from(quarter) + x) / 4.0)];
                assert!((got[0] - exact[0]).abs() < 1e-14 && (got[1] - exact[1]).abs() < 1e-14);
            }
            part = part.next();
        }
    }

    #[test]
    fn a_kink_inside_an_interval_stays_local() {
        let kink = |t: f64| [1.0 - 0.02 * (t - 1.3).max(0.0), 0.0];
        let error = largest_error(&input(kink), kink);
        // A fifth of the change of slope per fine interval, 6e-4, on the fine intervals at the kink.
        assert!(error < 1.3e-4, "{error:e}");
    }
}
