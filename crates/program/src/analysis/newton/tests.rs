//! Equations whose solutions are known: linear ones, a pendulum on a cart, a bound.

use std::convert::Infallible;
use std::f64::consts::PI;

use super::*;

/// Residuals of a function, with its Jacobian by differences.
struct Function<F> {
    of: F,
    at: DVector<f64>,
}

impl<F: Fn(&[f64]) -> Vec<f64>> Equations for Function<F> {
    type Error = Infallible;

    fn residuals(&mut self, unknowns: &mut DVector<f64>) -> Result<DVector<f64>, Infallible> {
        self.at = unknowns.clone();
        Ok(DVector::from_vec((self.of)(unknowns.as_slice())))
    }

    fn jacobian(&mut self) -> Result<DMatrix<f64>, Infallible> {
        let column = |k: usize| {
            let moved = |by: f64| {
                let mut at = self.at.clone();
                at[k] += by;
                DVector::from_vec((self.of)(at.as_slice()))
            };
            (moved(1e-6) - moved(-1e-6)) / 2e-6
        };
        let columns: Vec<_> = (0..self.at.len()).map(column).collect();
        let rows = (self.of)(self.at.as_slice()).len();
        Ok(DMatrix::from_fn(rows, columns.len(), |row, column| columns[column][row]))
    }

    fn may_go_on(&self, _: &Infallible) -> bool {
        true
    }
}

const FREE: Unknown =
    Unknown { usual: 1.0, longest: f64::INFINITY, bounds: (f64::NEG_INFINITY, f64::INFINITY), starts_anew: true };
const ANGLE: Unknown = Unknown { longest: 0.5, ..FREE };
const INPUT: Unknown = Unknown { starts_anew: false, ..FREE };

fn solved(of: impl Fn(&[f64]) -> Vec<f64>, unknowns: &[Unknown], start: &[f64]) -> End {
    let mut equations = Function { of, at: DVector::zeros(0) };
    let Ok(end) = solve(&mut equations, unknowns, &DVector::from_column_slice(start));
    end
}

/// Position, angle, their rates and the force: the derivatives of a cart of 1 kg with a pendulum of 0.2 kg, 0.5 m long,
/// at an angle from upright.
fn cart([_, angle, speed, rate, force]: [f64; 5]) -> Vec<f64> {
    let (sin, cos) = angle.sin_cos();
    let (cart, mass, length, g) = (1.0, 0.2, 0.5, 9.81);
    let pushed = force + mass * length * rate * rate * sin;
    let turned = (g * sin * (cart + mass) - cos * pushed) / (length * (cart + mass * sin * sin));
    let sped = (pushed - mass * g * sin * cos) / (cart + mass * sin * sin);
    vec![speed, rate, sped, turned]
}

const CART: [Unknown; 5] = [FREE, ANGLE, FREE, FREE, INPUT];

fn standing(start: [f64; 5]) -> End {
    solved(|z| cart(z.try_into().unwrap()), &CART, &start)
}

#[test]
fn a_pendulum_on_a_cart_is_upright_or_hangs_at_the_angle_that_is_nearest() {
    let mut random = Rng::with_seed(7);
    let mut most = 0;
    for _ in 0..300 {
        let mut within = |size: f64| size * (2.0 * random.f64() - 1.0);
        let start = [within(2.0), within(3.0), within(2.0), within(3.0), within(1.0)];
        let end = standing(start);
        assert!(end.is_solution, "{start:?}: {end:?}");
        let angle = end.unknowns[1];
        let turns = (angle / PI).round();
        assert!((angle - turns * PI).abs() < 1e-9 && end.unknowns[4].abs() < 1e-8, "{start:?}: {end:?}");
        // Near the middle between two of them, either is right.
        if (start[1] / PI - (start[1] / PI).round()).abs() < 0.4 {
            assert_eq!(turns, (start[1] / PI).round(), "{start:?}: {end:?}");
        }
        assert_eq!((end.rank, &*end.can_move), (4, &[true, false, false, false, false][..]));
        // The position is in no equation, so it stays.
        assert!((end.unknowns[0] - start[0]).abs() < 1e-12);
        most = most.max(end.steps);
    }
    assert!(most <= 12, "{most} steps");
}

#[test]
fn where_the_start_is_singular_another_one_near_it_is_tried() {
    let end = standing([0.0, PI / 2.0, 0.0, 0.0, 0.0]);
    assert!(end.is_solution && end.new_starts > 0, "{end:?}");
    assert!(end.unknowns[1].sin().abs() < 1e-9 && (-0.1..=PI + 0.1).contains(&end.unknowns[1]), "{end:?}");
}

#[test]
fn of_many_solutions_the_nearest_in_scaled_unknowns_is_found() {
    // z1 + z2 / 10 = 2 from (0, 0) with scales 1 and 20: the scaled unknowns (a, b) have a + 2 b = 2.
    let far = Unknown { usual: 20.0, ..FREE };
    let end = solved(|z| vec![z[0] + 0.1 * z[1] - 2.0], &[FREE, far], &[0.0, 0.0]);
    assert!(end.is_solution && end.rank == 1 && end.can_move == [true, true]);
    assert!((end.unknowns[0] - 0.4).abs() < 1e-8 && (end.unknowns[1] - 16.0).abs() < 1e-7, "{end:?}");
}

#[test]
fn more_equations_than_unknowns_are_solved_where_they_agree() {
    let of = |z: &[f64]| vec![z[0] - 1.0, z[0] * z[0] - 1.0, z[0].powi(3) - 1.0];
    let end = solved(of, &[FREE], &[2.0]);
    assert!(end.is_solution && end.rank == 1 && (end.unknowns[0] - 1.0).abs() < 1e-9);
    let end = solved(|z: &[f64]| vec![z[0] - 1.0, z[0] - 2.0], &[FREE], &[0.0]);
    assert!(!end.is_solution && (end.unknowns[0] - 1.5).abs() < 1e-6, "{end:?}");
}

#[test]
fn an_unknown_stays_within_its_bounds_and_others_take_its_part() {
    let bounded = |least: f64, most: f64| Unknown { bounds: (least, most), ..INPUT };
    // Without bounds both are 3.
    let sum = |z: &[f64]| vec![z[0] + z[1] - 6.0];
    let end = solved(sum, &[bounded(0.0, 1.0), bounded(0.0, 9.0)], &[0.5, 0.5]);
    assert!(end.is_solution && (end.unknowns[1] - 5.0).abs() < 1e-9, "{end:?}");
    assert_eq!((end.unknowns[0], &*end.at_bound), (1.0, &[Some(Ordering::Greater), None][..]));
    // Neither can: the residual remains, both are at their bounds.
    let end = solved(sum, &[bounded(0.0, 1.0), bounded(0.0, 2.0)], &[0.5, 0.5]);
    assert!(!end.is_solution && end.unknowns.as_slice() == [1.0, 2.0], "{end:?}");
    assert!((end.residuals[0] + 3.0).abs() < 1e-12);
    // A start at or beyond a bound is moved within.
    for start in [1.0, 7.0] {
        let end = solved(|z| vec![z[0] - 0.25], &[bounded(0.0, 1.0)], &[start]);
        assert!(end.is_solution && (end.unknowns[0] - 0.25).abs() < 1e-9 && end.at_bound == [None], "{end:?}");
    }
    // An unknown with a single allowed value takes it.
    let end = solved(sum, &[bounded(2.0, 2.0), INPUT], &[0.0, 0.0]);
    assert!(end.is_solution && end.unknowns[0] == 2.0 && (end.unknowns[1] - 4.0).abs() < 1e-9, "{end:?}");
}

#[test]
fn an_input_leaves_its_bound_when_the_step_turns_inward() {
    // The first step goes to the bound of z2 at 1, the solution is z2 = 0.5 beyond a bend of z1.
    let of = |z: &[f64]| vec![z[0].powi(3) + z[0] - 10.0, z[1] - 0.5 * (z[0] - 1.0)];
    let most = Unknown { bounds: (0.0, 1.0), ..INPUT };
    let end = solved(of, &[FREE, most], &[0.1, 0.5]);
    assert!(end.is_solution && (end.unknowns[0] - 2.0).abs() < 1e-9 && end.at_bound == [None, None], "{end:?}");
    assert!((end.unknowns[1] - 0.5).abs() < 1e-9, "{end:?}");
}

#[test]
fn rounding_is_no_residual_where_an_equation_has_its_largest_value() {
    // At the top, the derivative of the second equation is zero up to rounding.
    let of = |z: &[f64]| vec![z[0], (9.81 * 0.6 / 0.6) * z[0].cos() - 9.81 + 2e-15];
    let end = solved(of, &[ANGLE], &[0.1]);
    assert!(end.is_solution && end.unknowns[0].abs() < 1e-10, "{end:?}");
}

#[test]
fn nothing_to_solve_and_nothing_to_change_are_no_failures_of_the_method() {
    assert!(solved(|_| Vec::new(), &[], &[]).is_solution);
    assert!(solved(|_| Vec::new(), &[FREE], &[3.0]).can_move[0]);
    let end = solved(|_| vec![1.0], &[], &[]);
    assert!(!end.is_solution && end.new_starts == 0 && end.residuals[0] == 1.0);
}
