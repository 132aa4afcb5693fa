use super::*;
use crate::mathematics::filter::FilterDescription;
use crate::mathematics::pole_placement::place;

const MATCHED: Lipschitz = Lipschitz { matched: 1.0, unmatched: 0.0 };

struct Example {
    A_m: DMatrix<f64>,
    B: DMatrix<f64>,
    K: DMatrix<f64>,
    filter: Filter,
    omega_min: DMatrix<f64>,
    omega_max: DMatrix<f64>,
}

impl Example {
    fn design(&self) -> L1Design {
        let Example { A_m, B, K, filter, omega_min, omega_max } = self;
        let [A_m, B, K, omega_min, omega_max] = [A_m, B, K, omega_min, omega_max].map(Clone::clone);
        L1Design { A_m, B, K, filter: filter.clone(), omega_min, omega_max, known: None, unmatched: None }
    }
}

fn filter(factors: &[&[f64]]) -> Filter {
    let denominator = factors.iter().map(|factor| factor.to_vec()).collect();
    Filter::new(&FilterDescription { denominator, ..FilterDescription::default() }).unwrap()
}

fn fifth_order() -> Filter {
    filter(&[&[1.0, 0.0], &[0.04, 1.0], &[1.0 / 70.0, 1.0], &[6.25e-4, 0.045, 1.0]])
}

fn scalar(x: f64) -> DMatrix<f64> {
    DMatrix::from_element(1, 1, x)
}

/// One input, D = 1/s.
fn siso() -> Example {
    Example {
        A_m: DMatrix::from_row_slice(2, 2, &[0.0, 1.0, -1.0, -1.4]),
        B: DMatrix::from_row_slice(2, 1, &[0.0, 1.0]),
        K: scalar(20.0),
        filter: filter(&[&[1.0, 0.0]]),
        omega_min: scalar(0.5),
        omega_max: scalar(3.0),
    }
}

/// Three coupled states, two inputs.
fn mimo(filter: Filter) -> Example {
    let omega = DMatrix::from_row_slice(2, 2, &[1.2, 0.3, -0.2, 0.8]);
    Example {
        A_m: DMatrix::from_row_slice(3, 3, &[-3.0, 1.0, 0.0, 0.0, -4.0, 2.0, -1.0, 0.0, -5.0]),
        B: DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.3, 1.0, 0.0, 0.5]),
        K: DMatrix::from_row_slice(2, 2, &[8.0, 1.0, 0.0, 6.0]),
        filter,
        omega_min: omega.clone(),
        omega_max: omega,
    }
}

#[track_caller]
fn assert_is(Norms { matched: found, .. }: Norms, expected: f64) {
    let close = |bound: f64| (bound - expected).abs() < 2e-7 * expected;
    assert!(close(found.lower) && close(found.upper), "{found:?}, expected {expected}");
}

#[test]
fn the_norm_is_that_of_the_impulse_responses() {
    // By numpy: modes of the impulse responses, their zeros by scipy.optimize.brentq, exact antiderivatives.
    let one = siso();
    assert_is(one.design().norms(&scalar(0.5)).unwrap(), 0.18711177630525086);
    assert_is(one.design().norms(&scalar(1.0)).unwrap(), 0.10340149026047432);
    assert_is(one.design().norms(&scalar(3.0)).unwrap(), 0.03777799631596649);
    let two = mimo(filter(&[&[1.0, 0.0]]));
    assert_is(two.design().norms(&two.omega_min).unwrap(), 0.22349492422692355);
    let two = mimo(filter(&[&[1.0, 0.0], &[0.04, 1.0]]));
    assert_is(two.design().norms(&two.omega_min).unwrap(), 0.25123878793363624);
}

/// Double integrators with one pair of poles each, and K.
fn chains(pairs: &[(f64, f64)], k: f64) -> Example {
    let m = pairs.len();
    let mut A = DMatrix::zeros(2 * m, 2 * m);
    A.view_mut((0, m), (m, m)).fill_with_identity();
    let mut B = DMatrix::zeros(2 * m, m);
    B.view_mut((m, 0), (m, m)).fill_with_identity();
    let pair = |&(re, im): &(f64, f64)| [Complex::new(re, im), Complex::new(re, -im)];
    let poles: Vec<_> = pairs.iter().flat_map(pair).collect();
    let A_m = &A - &B * place(&A, &B, &poles).unwrap();
    Example { A_m, B, K: DMatrix::from_diagonal_element(m, m, k), ..siso() }
}

#[test]
fn the_norms_of_a_quadrotor_a_robot_and_a_filter_of_fifth_order_are_right() {
    // By numpy as above; the last with the modes in mpmath to 40 digits.
    let quadrotor = chains(&[(-30.0, 0.5), (-35.0, 0.5), (-40.0, 0.5)], 30.0);
    let uniform = |omega| DMatrix::from_diagonal_element(3, 3, omega);
    assert_is(quadrotor.design().norms(&uniform(0.5)).unwrap(), 0.02454826205067584);
    assert_is(quadrotor.design().norms(&uniform(10.0)).unwrap(), 0.005310001824164684);
    let robot = chains(&[(-300.0, 5.0), (-400.0, 5.0)], 30.0);
    let omega = DMatrix::from_row_slice(2, 2, &[0.5, -0.3, -0.3, 0.5]);
    assert_is(robot.design().norms(&omega).unwrap(), 0.0027395491790482237);
    let unmatched = Example {
        A_m: DMatrix::from_row_slice(3, 3, &[-1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, -1.8]),
        B: DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 0.0, 0.0, 1.0, 1.0]),
        K: DMatrix::from_diagonal_element(2, 2, 4.0),
        filter: fifth_order(),
        ..siso()
    };
    let omega = DMatrix::from_row_slice(2, 2, &[0.8, -0.2, 0.2, 1.2]);
    assert_is(unmatched.design().norms(&omega).unwrap(), 0.790884781598942);
}

#[test]
fn bounds_that_let_the_input_gain_lose_its_sign_leave_no_guarantee() {
    let mut robot = chains(&[(-30.0, 0.5), (-40.0, 0.5)], 30.0);
    robot.omega_min = DMatrix::from_row_slice(2, 2, &[0.5, -2.0, -2.0, 0.5]);
    robot.omega_max = DMatrix::from_row_slice(2, 2, &[10.0, 2.0, 2.0, 10.0]);
    let worst = robot.design().worst(MATCHED).unwrap();
    assert_eq!(worst.norms.matched, Bounds::INFINITE);
    assert!(worst.omega.determinant() < 0.0 && worst.every_corner, "{}", worst.omega);
}

#[test]
fn without_a_fast_filter_little_is_gained() {
    // (1/(s + 2)) (1 − 1/(s + 1)): ∫|2e^−2t − e^−t| = 1/2 by hand, which is the norm of only 1/(s + 2).
    let mut example = siso();
    (example.A_m, example.B) = (scalar(-2.0), scalar(1.0));
    example.K = scalar(1.0);
    assert_is(example.design().norms(&scalar(1.0)).unwrap(), 0.5);
}

#[test]
fn the_worst_input_gain_is_found_on_its_bounds() {
    let example = siso();
    let worst = example.design().worst(MATCHED).unwrap();
    assert_is(worst.norms, 0.18711177630525086);
    assert_eq!((worst.omega[0], worst.points, worst.every_corner), (0.5, 9, true));
}

#[test]
fn an_unstable_loop_has_an_infinite_norm_at_the_gain_that_makes_it_so() {
    // k/(s (s + 1)(s + 2)) is stable below k = 6 (Routh).
    let mut example = siso();
    example.filter = filter(&[&[1.0, 0.0], &[1.0, 1.0], &[1.0, 2.0]]);
    example.K = scalar(1.0);
    (example.omega_min, example.omega_max) = (scalar(1.0), scalar(5.99));
    assert!(example.design().worst(MATCHED).unwrap().norms.matched.upper.is_finite());
    example.omega_max = scalar(6.01);
    let worst = example.design().worst(MATCHED).unwrap();
    assert_eq!((worst.norms.matched, worst.omega[0]), (Bounds::INFINITE, 6.01));
    assert!(example.design().bandwidth(&scalar(6.01)).is_none());
}

#[test]
fn a_model_that_is_not_stable_is_refused() {
    let mut example = siso();
    example.A_m[(1, 0)] = 1.0;
    assert!(example.design().worst(MATCHED).unwrap_err().to_string().contains("eigenvalues of the desired dynamics"));
}

#[test]
fn every_corner_is_tried_up_to_seven_entries() {
    let corners = |m: usize, free: usize| {
        let K = DMatrix::identity(m, m);
        let (low, mut high) = (DMatrix::from_element(m, m, 1.0), DMatrix::from_element(m, m, 1.0));
        (0..free).for_each(|k| high[k] = 2.0);
        let example = Example { K, omega_min: low, omega_max: high, ..siso() };
        let gains = example.design().gains();
        let mut corners: Vec<Vec<u8>> = gains
            .iter()
            .filter(|omega| omega.iter().all(|&entry| entry == 1.0 || entry == 2.0))
            .map(|omega| omega.iter().map(|&entry| entry as u8).collect())
            .collect();
        corners.sort();
        corners.dedup();
        let centred = gains.iter().any(|omega| (0..free).all(|k| omega[k] == 1.5));
        assert!(centred && gains.len() <= (1 << ENTRIES) + 1);
        corners.len()
    };
    for free in 0..=7 {
        assert_eq!(corners(4, free), 1 << free, "{free} entries");
    }
    // Beyond, many different ones.
    assert!(corners(4, 16) > 115, "{}", corners(4, 16));
    assert!(corners(6, 36) > 115, "{}", corners(6, 36));
}

#[test]
fn the_control_follows_up_to_its_bandwidth() {
    let one = siso();
    // ωK/(s + ωK).
    let bandwidth = one.design().bandwidth(&scalar(1.5)).unwrap();
    assert!((bandwidth.slowest - 30.0).abs() < 1e-9 && (bandwidth.fastest - 30.0).abs() < 1e-9, "{bandwidth:?}");
    // Two channels apart: 8 and 40 rad/s.
    let two = Example { K: DMatrix::from_diagonal_element(2, 2, 8.0), ..siso() };
    let omega = DMatrix::from_row_slice(2, 2, &[5.0, 0.0, 0.0, 1.0]);
    let bandwidth = two.design().bandwidth(&omega).unwrap();
    assert!((bandwidth.slowest - 8.0).abs() < 1e-9 && (bandwidth.fastest - 40.0).abs() < 1e-9, "{bandwidth:?}");
    // A filter of fifth order, by python-control's frequency response and scipy.optimize.brentq.
    let high = Example { filter: fifth_order(), ..siso() };
    for (gain, expected) in [(0.1, 2.5377694793235825), (0.25, 9.228656562051807)] {
        let found = high.design().bandwidth(&scalar(gain)).unwrap().slowest;
        assert!((found - expected).abs() < 1e-8 * expected, "{found}, expected {expected}");
    }
}

#[test]
fn constant_uncertainty_is_cancelled_fully() {
    let two = mimo(filter(&[&[1.0, 0.0], &[0.04, 1.0]]));
    let gain = two.design().dc_gain(&two.omega_min).unwrap();
    assert!((gain - DMatrix::<f64>::identity(2, 2)).amax() < 1e-14);
    assert!(two.design().dc_gain(&DMatrix::from_element(2, 2, 1.0)).is_none(), "singular");
}
