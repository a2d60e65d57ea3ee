use super::*;
use crate::numerics::test_functions::{bounds, point};

/// A fixed sequence of numbers in [-1, 1] (Marsaglia's xorshift).
struct Sequence(u64);

impl Sequence {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn matrix(&mut self, rows: usize, columns: usize) -> DMatrix<f64> {
        DMatrix::from_fn(rows, columns, |_, _| self.next())
    }

    fn vector(&mut self, length: usize) -> DVector<f64> {
        DVector::from_fn(length, |_, _| self.next())
    }

    /// A program whose `H` has the given rank.
    fn program(
        &mut self,
        n: usize,
        rank: usize,
        equalities: usize,
        rows: usize,
    ) -> QuadraticProgram {
        let half = self.matrix(rank, n);
        let centre = self.vector(n);
        let width = self.vector(n).map(|a| a.abs() + 0.05);
        QuadraticProgram {
            hessian: half.transpose() * half,
            gradient: self.vector(n) * 2.0,
            bounds: Bounds {
                lower: &centre - &width,
                upper: &centre + &width,
            },
            equalities: LinearConstraints {
                matrix: self.matrix(equalities, n),
                right: self.vector(equalities) * 0.3,
            },
            inequalities: LinearConstraints {
                matrix: self.matrix(rows, n),
                right: self.vector(rows),
            },
        }
    }
}

/// Lowest value over all points that satisfy the optimality conditions for some set of active
/// constraints; none when no vertex or face is feasible. Shares nothing with the method.
fn brute_force(program: &QuadraticProgram) -> Option<f64> {
    let n = program.gradient.len();
    let mut rows: Vec<(DVector<f64>, f64)> = Vec::new();
    for i in 0..program.inequalities.right.len() {
        let row = program.inequalities.matrix.row(i).transpose();
        rows.push((row, program.inequalities.right[i]));
    }
    for i in 0..n {
        let unit = DVector::from_fn(n, |row, _| f64::from(u8::from(row == i)));
        rows.push((-&unit, -program.bounds.lower[i]));
        rows.push((unit, program.bounds.upper[i]));
    }
    let mut best: Option<f64> = None;
    let fixed = program.equalities.right.len();
    for set in 0_u32..1 << rows.len() {
        if set.count_ones() as usize + fixed > n {
            continue;
        }
        let held: Vec<usize> = (0..rows.len()).filter(|i| set >> i & 1 == 1).collect();
        let q = held.len() + fixed;
        let mut matrix = DMatrix::zeros(n + q, n + q);
        let mut right = DVector::zeros(n + q);
        matrix.view_mut((0, 0), (n, n)).copy_from(&program.hessian);
        right.rows_mut(0, n).copy_from(&-&program.gradient);
        for k in 0..q {
            let (row, limit) = if k < fixed {
                let row = program.equalities.matrix.row(k).transpose();
                (row, program.equalities.right[k])
            } else {
                rows[held[k - fixed]].clone()
            };
            matrix.view_mut((0, n + k), (n, 1)).copy_from(&row);
            matrix
                .view_mut((n + k, 0), (1, n))
                .copy_from(&row.transpose());
            right[n + k] = limit;
        }
        // A singular system has the same minimum with another set.
        let Some(solved) = matrix.full_piv_lu().solve(&right) else {
            continue;
        };
        let x = solved.rows(0, n).into_owned();
        let feasible = rows.iter().all(|(row, limit)| row.dot(&x) <= limit + 1e-9);
        let optimal = (fixed..q).all(|k| solved[n + k] >= -1e-9);
        if feasible && optimal && x.amax() < 1e3 {
            let value = 0.5 * (&program.hessian * &x).dot(&x) + program.gradient.dot(&x);
            best = Some(best.map_or(value, |known| known.min(value)));
        }
    }
    best
}

/// Fails unless `solution` is feasible and satisfies the optimality conditions.
fn assert_optimal(program: &QuadraticProgram, solution: &Solution, tolerance: f64) {
    let mut residual = &program.hessian * &solution.x + &program.gradient;
    for held in &solution.active {
        let mu = held.multiplier;
        match held.constraint {
            Constraint::Lower(i) => residual[i] -= mu,
            Constraint::Upper(i) => residual[i] += mu,
            Constraint::Equality(i) => {
                residual += program.equalities.matrix.row(i).transpose() * mu;
            }
            Constraint::Inequality(i) => {
                residual += program.inequalities.matrix.row(i).transpose() * mu;
            }
        }
        let sign_is_free = matches!(held.constraint, Constraint::Equality(_));
        assert!(mu >= -tolerance || sign_is_free, "{held:?}");
    }
    assert!(
        residual.amax() < tolerance,
        "not stationary by {residual}: {solution:?}"
    );
    assert!(program.bounds.contains(&solution.x));
    let above = &program.inequalities.matrix * &solution.x - &program.inequalities.right;
    assert!(above.iter().all(|a| *a < tolerance), "violated by {above}");
    let off = &program.equalities.matrix * &solution.x - &program.equalities.right;
    assert!(off.iter().all(|a| a.abs() < tolerance), "off by {off}");
}

fn assert_agrees_with_brute_force(program: &QuadraticProgram, tolerance: f64) -> bool {
    match (program.minimise(), brute_force(program)) {
        (Ok(solution), Some(value)) => {
            assert_optimal(program, &solution, tolerance);
            let error = solution.value - value;
            assert!(
                error.abs() < tolerance,
                "off by {error:e}: {program:?} {solution:?}"
            );
            true
        }
        (Err(Failure::Infeasible { violation, .. }), None) => {
            assert!(violation > 0.0);
            false
        }
        (found, expected) => panic!("{found:?} instead of {expected:?} for {program:?}"),
    }
}

#[test]
fn definite_programs_agree_with_brute_force_over_active_sets() {
    let mut sequence = Sequence(7);
    let mut feasible = 0;
    for case in 0..400 {
        let n = 1 + case % 4;
        let program = sequence.program(n, n + 2, 0, case % 5);
        feasible += usize::from(assert_agrees_with_brute_force(&program, 1e-9));
    }
    assert!(
        (200..400).contains(&feasible),
        "one-sided sample: {feasible} of 400 feasible"
    );
}

#[test]
fn semidefinite_and_linear_programs_agree_with_brute_force() {
    let mut sequence = Sequence(11);
    for case in 0..300 {
        let n = 2 + case % 3;
        let program = sequence.program(n, case % n, 0, case % 4);
        assert_agrees_with_brute_force(&program, 1e-7);
    }
}

#[test]
fn programs_with_equalities_agree_with_brute_force() {
    let mut sequence = Sequence(13);
    for case in 0..200 {
        let n = 2 + case % 3;
        let program = sequence.program(n, n - case % 2, 1 + case % 2, case % 3);
        assert_agrees_with_brute_force(&program, 1e-7);
    }
}

#[test]
fn a_dozen_unknowns_with_three_dozen_rows_satisfy_the_optimality_conditions() {
    let mut sequence = Sequence(17);
    for _ in 0..50 {
        let mut program = sequence.program(12, 12, 0, 36);
        // A point inside of everything, so that there is a solution.
        let inside = (&program.bounds.lower + &program.bounds.upper) * 0.5;
        program.inequalities.right = (&program.inequalities.matrix * inside).add_scalar(0.01);
        let solution = program.minimise().unwrap();
        assert_optimal(&program, &solution, 1e-8);
    }
}

#[test]
fn units_of_the_unknowns_do_not_matter() {
    let mut sequence = Sequence(19);
    let program = sequence.program(4, 4, 0, 3);
    let units = point(&[1e-6, 1e4, 1.0, 1e8]);
    let diagonal = DMatrix::from_diagonal(&units);
    let rescaled = QuadraticProgram {
        hessian: &diagonal * &program.hessian * &diagonal,
        gradient: &diagonal * &program.gradient,
        bounds: Bounds {
            lower: program.bounds.lower.component_div(&units),
            upper: program.bounds.upper.component_div(&units),
        },
        equalities: program.equalities.clone(),
        inequalities: LinearConstraints {
            matrix: &program.inequalities.matrix * &diagonal,
            right: program.inequalities.right.clone(),
        },
    };
    let (plain, other) = (program.minimise().unwrap(), rescaled.minimise().unwrap());
    assert!((other.x.component_mul(&units) - plain.x).amax() < 1e-9);
}

#[test]
fn a_contradiction_names_a_constraint_that_takes_part_in_it() {
    let program = QuadraticProgram {
        hessian: DMatrix::identity(2, 2),
        gradient: point(&[0.0, 0.0]),
        bounds: bounds(&[0.0, 0.0], &[1.0, 1.0]),
        equalities: LinearConstraints::none(2),
        inequalities: LinearConstraints {
            matrix: DMatrix::from_row_slice(1, 2, &[-2.0, -2.0]),
            right: point(&[-6.0]),
        },
    };
    let Err(Failure::Infeasible {
        constraint,
        violation,
    }) = program.minimise()
    else {
        panic!("{:?}", program.minimise());
    };
    // The row is met first, at (1.5, 1.5); x_0 <= 1 then leaves only (1, 2), and x_1 <= 1 is missed
    // by 1.
    assert_eq!(constraint, Constraint::Upper(1));
    assert!((violation - 1.0).abs() < 1e-12, "{violation}");
}

#[test]
fn indefinite_and_malformed_programs_are_refused() {
    let mut program = Sequence(23).program(2, 2, 0, 1);
    program.hessian = DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 1.0]);
    assert_eq!(program.minimise(), Err(Failure::NotConvex));
    program.gradient[0] = f64::NAN;
    assert_eq!(program.minimise(), Err(Failure::Malformed));
    program.gradient = point(&[1.0]);
    assert_eq!(program.minimise(), Err(Failure::Malformed));
}
