//! Designs whose gains and margins are known: found a second time by another program from the same rules, poles and margins
//! checked with python-control.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::Complex;

use super::nominal::Nominal;
use super::response::logarithmic;
use super::search::{Found, Law, search};
use super::{funnel, ladrc, pid, zeros};
use crate::mathematics::balanced;
use crate::template::Plant;

fn plant(text: &str) -> Plant {
    Plant::parse(text).unwrap()
}

fn dc_motor() -> Plant {
    plant(r#"{"A": [[-0.5, 250], [-25, -500]], "B": [0, 500], "C": [1, 0]}"#)
}

fn two_mass_drive() -> Plant {
    plant(r#"{"A": [[-20, -20000, 20], [1, 0, -1], [10, 10000, -10]], "B": [1000, 0, 0], "C": [0, 0, 1]}"#)
}

fn nominal(plant: &Plant, bandwidth: f64) -> Nominal {
    Nominal::new(plant, bandwidth).unwrap()
}

fn assert_near(found: &[f64], expected: &[f64], relative: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= relative * expected.abs(), "{found} for {expected}");
    }
}

/// Speed, slowest pole, damping ratio, M_s.
fn assert_has<G>(found: &Found<G>, bandwidth: f64, expected: [f64; 4]) {
    let merit = found.has.merit;
    let had = [found.speed * bandwidth, merit.slowest * bandwidth, merit.damping, found.has.modulus];
    assert_near(&had, &expected, 3e-3);
}

#[test]
fn pid_control_of_a_motor_and_of_a_drive_has_the_known_gains_and_margins() {
    for (plant, bandwidth, [K_p, K_i, N], has) in [
        (dc_motor(), 5.0, [0.0, 0.6501, 100.0], [5.0, 6.50, 0.503, 1.479]),
        (dc_motor(), 20.0, [0.1707, 10.24, 600.0], [20.0, 28.1, 0.523, 1.244]),
        (two_mass_drive(), 5.0, [0.02674, 0.1337, 100.0], [5.0, 4.46, 0.401, 1.423]),
        (two_mass_drive(), 20.0, [0.02669, 0.3376, 126.5], [6.325, 4.47, 0.401, 1.428]),
    ] {
        let found = search::<pid::Pid>(&nominal(&plant, bandwidth)).unwrap();
        let gains = found.gains[0];
        assert_near(&[gains.K_p, gains.K_i, gains.N], &[K_p, K_i, N], 1e-3);
        assert_eq!((gains.K_d, found.S[(0, 0)]), (0.0, 1.0));
        assert_has(&found, bandwidth, has);
    }
}

#[test]
fn disturbance_rejection_takes_the_order_that_the_plant_has_at_its_speed() {
    for (plant, bandwidth, order, [omega_c, omega_o, b_0], has) in [
        (dc_motor(), 5.0, 1, [5.0, 50.0, 72.66], [5.0, 3.82, 0.426, 1.633]),
        (dc_motor(), 20.0, 1, [20.0, 200.0, 153.8], [20.0, 17.0, 0.448, 1.704]),
        (two_mass_drive(), 5.0, 1, [5.0, 50.0, 333.4], [5.0, 5.0, 0.404, 1.839]),
        (two_mass_drive(), 20.0, 3, [100.0, 1000.0, 1.285e7], [20.0, 29.1, 0.481, 1.323]),
    ] {
        let found = search::<ladrc::Ladrc>(&nominal(&plant, bandwidth)).unwrap();
        let gains = found.gains[0];
        assert_eq!(gains.order, order);
        assert_near(&[gains.omega_c, gains.omega_o, gains.b_0], &[omega_c, omega_o, b_0], 1e-3);
        assert_has(&found, bandwidth, has);
    }
}

#[test]
fn a_funnel_has_the_gain_that_keeps_the_errors_inside() {
    for (plant, bandwidth, reference, [g, tau, largest]) in [
        (dc_motor(), 5.0, 100.0, [790569.0, 0.1, 0.549]),
        (dc_motor(), 20.0, 100.0, [1.2649e6, 0.025, 0.423]),
        (two_mass_drive(), 5.0, 10.0, [790.6, 0.1, 0.524]),
    ] {
        // Gains as they were found by another program, which left no room for noise.
        let nominal = nominal(&plant, bandwidth);
        let design = funnel::design_within(&nominal, &[reference], &[0.45; 3]).unwrap();
        assert_near(&[design.g[0], design.tau, design.largest_part], &[g, tau, largest], 1e-3);
        let with_room = funnel::design(&nominal, &[reference]).unwrap();
        assert!(with_room.g[0] >= design.g[0] && with_room.left <= 0.025, "{} {}", with_room.g[0], with_room.left);
    }
}

/// A plant in other units of measurement is the same plant.
#[test]
fn units_of_states_change_nothing() {
    let pascals = plant(
        r#"{"A": [[0, 1, 0], [0, -6, 4e-6], [0, -4e9, -1]], "B": [0, 0, 4e8], "C": [1, 0, 0], "u_min": [-1], "u_max": [1]}"#,
    );
    let mut bars = pascals.clone();
    // p/1e5 in place of p.
    bars.A.row_mut(2).scale_mut(1e-5);
    bars.A.column_mut(2).scale_mut(1e5);
    bars.B.row_mut(2).scale_mut(1e-5);
    let [one, other] = [&pascals, &bars].map(|plant| search::<pid::Pid>(&nominal(plant, 3.0)).unwrap().gains);
    assert_near(&[one[0].K_p, one[0].K_i], &[other[0].K_p, other[0].K_i], 1e-3);
    let [one, other] = [&pascals, &bars].map(|plant| search::<ladrc::Ladrc>(&nominal(plant, 3.0)).unwrap().gains);
    assert_near(&[one[0].omega_c, one[0].b_0], &[other[0].omega_c, other[0].b_0], 1e-3);
}

/// A time unit of milliseconds gives a thousandth of the rates.
#[test]
fn units_of_time_change_nothing() {
    let slow = dc_motor();
    let mut fast = slow.clone();
    fast.A *= 1000.0;
    fast.B *= 1000.0;
    let [one, other] =
        [(&slow, 20.0), (&fast, 2e4)].map(|(plant, w)| search::<pid::Pid>(&nominal(plant, w)).unwrap().gains[0]);
    assert_near(&[other.K_p, other.K_i, other.N], &[one.K_p, 1000.0 * one.K_i, 1000.0 * one.N], 1e-3);
}

#[test]
fn scales_are_powers_of_two_and_rows_and_columns_are_alike() {
    let Plant { A, B, C, .. } =
        plant(r#"{"A": [[0, 1e-6, 0], [3e7, -2, 1e9], [0, 1e-3, -4]], "B": [0, 1e5, 0], "C": [1e-4, 0, 7]}"#);
    let (balanced, of_u, of_x, scales) = balanced::balance(&A, &B, &C);
    for i in 0..3 {
        assert_eq!(scales[i].log2().fract(), 0.0);
        let row = balanced.row(i).abs().sum() - balanced[(i, i)].abs() + of_u.row(i).abs().sum();
        let column = balanced.column(i).abs().sum() - balanced[(i, i)].abs() + of_x.column(i).abs().sum();
        assert!((0.4..2.5).contains(&(row / column)), "{i}: {row} and {column}");
        for j in 0..3 {
            assert_eq!(balanced[(i, j)], A[(i, j)] * scales[j] / scales[i]);
        }
    }
}

/// det [A − s I, B; C, 0] is known for these.
#[test]
fn zeros_are_found_whatever_their_size() {
    let found = |text: &str| {
        let Plant { A, B, C, .. } = plant(text);
        let mut zeros = zeros::invariant(&A, &B, &C).unwrap();
        zeros.sort_by(|one, other| one.re.total_cmp(&other.re));
        zeros
    };
    // (s + 3)(s − 200)/((s + 1)(s + 2)(s + 4)) in companion form.
    let zeros = found(r#"{"A": [[0, 1, 0], [0, 0, 1], [-8, -14, -7]], "B": [0, 0, 1], "C": [-600, -197, 1]}"#);
    assert!((zeros[0] + 3.0).norm() < 1e-9 && (zeros[1] - 200.0).norm() < 1e-7, "{zeros:?}");
    assert!(found(r#"{"A": [[0, 1], [0, 0]], "B": [0, 1], "C": [1, 0]}"#).is_empty());
    // Two coupled lags: (s + 3)(s + 5)/… on the diagonal and an input that leaves both outputs at 0 with the mode at −2.
    let zeros = found(
        r#"{"A": [[-1, 0, 1], [0, -4, 1], [0, 0, -2]], "B": [[1, 0], [0, 1], [0, 0]], "C": [[1, 0, 0], [0, 1, 0]]}"#,
    );
    assert!(zeros.len() == 1 && (zeros[0] + 2.0).norm() < 1e-9, "a mode that no input moves: {zeros:?}");
    let dependent = plant(r#"{"A": [[-1, 0], [0, -2]], "B": [[1, 2], [1, 2]], "C": [[1, 0], [0, 1]]}"#);
    assert!(zeros::invariant(&dependent.A, &dependent.B, &dependent.C).is_none());
}

/// K(s) of a controller's gains is that of its matrices.
#[test]
fn responses_of_laws_are_those_of_their_controllers() {
    let of_pid = pid::Gains { K_p: 2.0, K_i: 3.0, K_d: 0.4, N: 50.0 };
    same_responses::<pid::Pid>(&of_pid);
    for order in 1..=3 {
        same_responses::<ladrc::Ladrc>(&ladrc::Gains { order, omega_c: 7.0, omega_o: 30.0, b_0: 0.3 });
    }
}

fn same_responses<L: Law>(gains: &L::Gains) {
    let (controller, response) = (L::controller(gains, 4.0), L::response(gains, 4.0));
    for omega in logarithmic(1e-3, 1e3, 30) {
        let k = controller.A.nrows();
        let shifted = nalgebra::DMatrix::identity(k, k) * Complex::new(0.0, omega) - controller.A.map(Complex::from);
        let states = shifted.lu().solve(&controller.B.map(Complex::from)).unwrap();
        let expected = (controller.C.map(Complex::from) * states)[(0, 0)] + controller.D[(0, 0)];
        assert!(
            (response(omega) - expected).norm() < 1e-8 * expected.norm(),
            "{omega}: {} for {expected}",
            response(omega)
        );
    }
}

#[test]
fn a_plant_without_a_design_has_its_reason() {
    let refused = |text: &str, bandwidth: f64, most: usize| {
        let nominal = nominal(&plant(text), bandwidth);
        super::reasons::at_once(&nominal, 2.0).unwrap_or_else(|| {
            assert!(search::<pid::Pid>(&nominal).is_none());
            super::reasons::of_failure::<pid::Pid>(&nominal, most)
        })
    };
    // (s − 6)/((s − 5)(s + 1))
    let error = refused(r#"{"A": [[0, 1], [5, 4]], "B": [0, 1], "C": [-6, 1]}"#, 10.0, 2);
    assert!(
        error.contains("pole at 5 rad/s")
            && error.contains("zero on the right at 6 rad/s")
            && error.contains("least 11"),
        "{error}"
    );
    let error = refused(r#"{"A": [[0, 1, 0], [0, 0, 1], [0, 0, 0]], "B": [0, 0, 1], "C": [1, 0, 0]}"#, 1.0, 2);
    assert!(error.contains("3 poles at 0"), "{error}");
    let error = refused(r#"{"A": [[0, 1], [-2, -3]], "B": [0, 1], "C": [0, 1]}"#, 1.0, 2);
    assert!(error.contains("zero at 0"), "{error}");
    let error = refused(r#"{"A": [[1, 0], [0, -2]], "B": [0, 1], "C": [1, 1]}"#, 1.0, 2);
    assert!(error.contains("isn't stable, and the inputs don't move it"), "{error}");
    let error = refused(r#"{"A": [[1]], "B": [1], "C": [1], "delay": 0.9}"#, 3.0, 2);
    assert!(error.contains("unstable pole at 1 rad/s and a dead time of 0.9 s"), "{error}");
}
