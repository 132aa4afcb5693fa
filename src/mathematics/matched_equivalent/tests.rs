use super::*;
use crate::mathematics::filter::FilterDescription;

fn matrix<const M: usize, const N: usize>(rows: [[f64; N]; M]) -> DMatrix<f64> {
    DMatrix::from_row_slice(M, N, rows.as_flattened())
}

fn at(re: f64, im: f64) -> Complex<f64> {
    Complex::new(re, im)
}

fn filter(denominator: &[&[f64]]) -> Filter {
    let denominator = denominator.iter().map(|factor| factor.to_vec()).collect();
    Filter::new(&FilterDescription { denominator, ..Default::default() }).unwrap()
}

#[derive(Clone)]
struct Example {
    A_m: DMatrix<f64>,
    B: DMatrix<f64>,
    C: DMatrix<f64>,
    B_um: DMatrix<f64>,
}

impl Example {
    fn equivalent(&self) -> MatchedEquivalent {
        MatchedEquivalent::new(("A_m", &self.A_m), &self.B, &self.C, &self.B_um).unwrap()
    }

    fn refusal(&self) -> String {
        MatchedEquivalent::new(("A_m", &self.A_m), &self.B, &self.C, &self.B_um).unwrap_err().to_string()
    }

    /// H_m(s)⁻¹ H_um(s) as it is written.
    fn quotient(&self, s: Complex<f64>) -> DMatrix<Complex<f64>> {
        let n = self.A_m.nrows();
        let states = (DMatrix::identity(n, n) * s - complex(&self.A_m)).try_inverse().unwrap();
        let through = |B: &DMatrix<f64>| complex(&self.C) * &states * complex(B);
        through(&self.B).lu().solve(&through(&self.B_um)).unwrap()
    }

    /// With states, inputs and outputs in units this much larger.
    fn in_units(&self, x: &[f64], u: &[f64], y: &[f64]) -> Example {
        let diagonal = |units: &[f64]| DMatrix::from_diagonal(&DVector::from_column_slice(units));
        let inverse = |units: &[f64]| diagonal(&units.iter().map(|unit| 1.0 / unit).collect::<Vec<_>>());
        Example {
            A_m: inverse(x) * &self.A_m * diagonal(x),
            B: inverse(x) * &self.B * diagonal(u),
            C: inverse(y) * &self.C * diagonal(x),
            B_um: inverse(x) * &self.B_um,
        }
    }
}

/// Two outputs, one of which a disturbance reaches before the inputs do.
fn third_order() -> Example {
    Example {
        A_m: matrix([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]),
        B: matrix([[1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]),
        C: matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        B_um: matrix([[0.0], [1.0], [0.0]]),
    }
}

/// Coupled, with a zero at −2.594 and a pair at −5.082 ± 0.823j.
fn with_zeros() -> Example {
    Example {
        A_m: matrix([
            [-2.0, 1.0, 0.0, 0.5, 0.0],
            [0.3, -3.0, 1.0, 0.0, -0.4],
            [-1.0, 0.2, -4.0, 0.7, 1.0],
            [0.6, 0.0, -0.5, -2.5, 0.8],
            [0.0, 1.1, -0.3, 0.4, -5.0],
        ]),
        B: matrix([[1.0, 0.0], [0.5, 0.0], [0.0, 1.0], [0.0, 0.3], [0.2, -0.6]]),
        C: matrix([[1.0, 0.0, 0.5, 0.0, 0.0], [0.0, 0.4, 1.0, 0.0, 0.7]]),
        B_um: matrix([[0.0, 1.0], [1.0, 0.0], [0.3, 0.0], [0.0, 2.0], [0.5, -1.0]]),
    }
}

/// The first output shows the inputs in its third derivative, the second in its first, and a zero at −6.
fn uneven() -> Example {
    Example {
        A_m: matrix([
            [-1.0, 1.0, 0.0, 0.0, 0.0],
            [0.0, -3.0, 1.0, 0.0, 1.0],
            [-1.0, 0.0, -2.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, -4.0, 0.0],
            [1.0, 0.0, 0.0, 1.0, -6.0],
        ]),
        B: matrix([[0.0, 0.0], [0.0, 0.0], [1.0, 0.5], [1.0, 3.0], [0.0, 0.0]]),
        C: matrix([[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0]]),
        B_um: matrix([[2.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]),
    }
}

fn assert_same(found: &DMatrix<Complex<f64>>, expected: &DMatrix<Complex<f64>>, tolerance: f64, of: &str) {
    for (found, expected) in found.column_iter().zip(expected.column_iter()) {
        let error = (found - expected).norm() / expected.norm();
        assert!(error <= tolerance, "{of}: {error:e}, {found}, {expected}");
    }
}

fn assert_zeros(equivalent: &MatchedEquivalent, expected: &[Complex<f64>], tolerance: f64) {
    let found = equivalent.zeros().unwrap();
    assert_eq!(found.len(), expected.len(), "{found:?}");
    for zero in expected {
        let nearest = found.iter().map(|z| (z - zero).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest <= tolerance * zero.norm(), "{zero} in {found:?}");
    }
}

#[test]
fn nominal_dynamics_need_not_be_stable() {
    // x1'' = a x1' + u, d on x1': T = s - a by hand, whatever a.
    for a in [0.0, 3.0, -2.0] {
        let chain = Example {
            A_m: matrix([[0.0, 1.0], [0.0, a]]),
            B: matrix([[0.0], [1.0]]),
            C: matrix([[1.0, 0.0]]),
            B_um: matrix([[1.0], [0.0]]),
        };
        let found = chain.equivalent();
        assert_eq!(found.polynomial.len(), 2);
        assert!((found.polynomial[0][0] + a).abs() < 1e-15 && (found.polynomial[1][0] - 1.0).abs() < 1e-15);
    }
}

#[test]
fn a_disturbance_one_integrator_before_the_input_is_met_by_its_derivative() {
    let equivalent = third_order().equivalent();
    // By hand: x2' = x3 + d, so x3 = −d keeps y2 at zero, and u2 = x3' + 1.8 x3.
    assert_eq!(equivalent.polynomial, [matrix([[0.0], [1.8]]), matrix([[0.0], [1.0]])]);
    assert_eq!((equivalent.degree(), equivalent.zeros()), (1, Some(vec![])));
    let value = equivalent.at(at(0.5, -3.0));
    assert!(value[0] == at(0.0, 0.0) && (value[1] - at(2.3, -3.0)).norm() < 1e-15, "{value}");
}

#[test]
fn behind_a_filter_of_enough_poles_nothing_is_differentiated() {
    let equivalent = third_order().equivalent();
    let D = filter(&[&[1.0, 0.0], &[0.04, 1.0], &[1.0 / 70.0, 1.0], &[6.25e-4, 0.045, 1.0]]);
    let FilteredPolynomial { inputs, direct } = equivalent.behind(&D).unwrap();
    // i' = w + 1.8 d, p' = 25 (i − p) + 25 d.
    let expected = [[1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 25.0, 0.0, 0.0, 0.0]];
    assert_eq!(direct, 0.0);
    for (input, expected) in inputs.iter().zip(expected) {
        assert!((input - DVector::from_row_slice(&expected)).norm() < 1e-13, "{input}");
    }
}

#[test]
fn the_polynomial_part_behind_a_filter_is_the_product() {
    let numerator = vec![vec![0.3, 1.0]];
    let denominator = [&[1.0, 0.0][..], &[0.04, 1.0], &[1.0 / 70.0, 1.0], &[6.25e-4, 0.045, 1.0], &[1e-6, 1.0]];
    let with_zero = Filter::new(&FilterDescription {
        gain: -3.0,
        numerator,
        denominator: denominator[..3].iter().map(|factor| factor.to_vec()).collect(),
    });
    for (D, relative_degree) in [(filter(&denominator), 6), (filter(&denominator[..2]), 2), (with_zero.unwrap(), 2)] {
        assert_eq!(D.relative_degree(), relative_degree);
        let equivalent = uneven().equivalent();
        let FilteredPolynomial { inputs, direct } = equivalent.behind(&D).unwrap();
        for s in [at(0.1, 0.0), at(-0.4, 7.0), at(3.0, -200.0)] {
            let resolvent = (DMatrix::identity(D.order(), D.order()) * s - complex(&D.A_f)).try_inverse().unwrap();
            for (j, input) in inputs.iter().enumerate() {
                let through = direct * f64::from(u8::from(j == relative_degree));
                let found = (D.C_f.map(Complex::from) * &resolvent * input.map(Complex::from))[0] + through;
                let expected = D.at(s) * s.powu(j as u32);
                assert!((found - expected).norm() < 1e-11 * expected.norm(), "s^{j} at {s}: {found}, {expected}");
            }
        }
    }
}

#[test]
fn a_disturbance_of_each_axis_of_a_twin_rotor_is_met_on_that_axis() {
    // State (psi, psi', phi, phi', tau1, tau2); every state is fed back to the rotor of its axis.
    let (a, b, p) = ([1.3588, 4.5], [1.0, 0.8], [51.9, 57.3]);
    let mut A_m = DMatrix::zeros(6, 6);
    for i in 0..2 {
        let (angle, rate, torque) = (2 * i, 2 * i + 1, 4 + i);
        A_m[(angle, rate)] = 1.0;
        (A_m[(rate, angle)], A_m[(rate, rate)], A_m[(rate, torque)]) = (-4.7, -0.09, a[i]);
        (A_m[(torque, angle)], A_m[(torque, rate)], A_m[(torque, torque)]) = (-3573.0, -652.0, -p[i]);
    }
    let (mut B, mut C, mut B_um) = (DMatrix::zeros(6, 2), DMatrix::zeros(2, 6), DMatrix::zeros(6, 2));
    (B[(4, 0)], B[(5, 1)], C[(0, 0)], C[(1, 2)], B_um[(1, 0)], B_um[(3, 1)]) = (b[0], b[1], 1.0, 1.0, 1.0, 1.0);
    let equivalent = Example { A_m, B, C, B_um }.equivalent();
    assert_eq!((equivalent.degree(), equivalent.A_z.nrows()), (1, 0));
    // psi'' + … = a tau + d wants tau = −d/a, and u = (tau' + p tau)/b.
    for (j, of_axis) in [p, [1.0, 1.0]].iter().enumerate() {
        let expected = matrix([[of_axis[0] / (a[0] * b[0]), 0.0], [0.0, of_axis[1] / (a[1] * b[1])]]);
        assert!((&equivalent.polynomial[j] - &expected).amax() < 1e-15 * expected.amax(), "{equivalent:?}");
    }
    let behind = equivalent.behind(&filter(&[&[1.0, 0.0]])).unwrap();
    assert_eq!((behind.inputs[0][0], behind.inputs[1][0], behind.direct), (1.0, 0.0, 1.0));
}

#[test]
fn with_zeros_it_is_the_quotient_of_both_transfer_functions() {
    let equivalent = with_zeros().equivalent();
    assert_eq!(equivalent.degree(), 0);
    // scipy.linalg.eigvals of the Rosenbrock pencil.
    let pair = [-5.081999687004502, 0.8232204479845251];
    let zeros = [at(-2.5940494064788067, 0.0), at(pair[0], pair[1]), at(pair[0], -pair[1])];
    assert_zeros(&equivalent, &zeros, 1e-13);
    // mpmath with 40 digits.
    let real = matrix([[-0.2485104672902634, 1.5586343004140687], [2.1024961182793987, -1.1254531614380407]]);
    assert_same(&equivalent.at(at(0.5, 0.0)), &complex(&real), 1e-14, "at 0.5");
    let fast = DMatrix::from_row_slice(
        2,
        2,
        &[
            at(-1.036373619236023, 0.04923633051521037),
            at(2.2280517617011755, -0.06002735299809078),
            at(2.421717487474944, -0.02285767422037536),
            at(-2.4872095652407188, 0.07661661142420145),
        ],
    );
    assert_same(&equivalent.at(at(40.0, -70.0)), &fast, 1e-14, "at 40 - 70j");
}

#[test]
fn derivatives_of_a_disturbance_appear_as_often_as_it_leads_the_input() {
    let equivalent = uneven().equivalent();
    // sympy: [[12 s²/5 + 12 s + 66/5 + 24/(5 (s + 6)), −1/5], [−4 s²/5 − 4 s − 22/5 − 8/(5 (s + 6)), 2/5]].
    let expected =
        [matrix([[13.2, -0.2], [-4.4, 0.4]]), matrix([[12.0, 0.0], [-4.0, 0.0]]), matrix([[2.4, 0.0], [-0.8, 0.0]])];
    assert_eq!(equivalent.degree(), 2);
    for (h, expected) in equivalent.polynomial.iter().zip(expected) {
        assert!((h - expected).amax() < 1e-14, "{h}");
    }
    assert_zeros(&equivalent, &[at(-6.0, 0.0)], 1e-14);
    let residue = &equivalent.C_z * &equivalent.B_z;
    assert!((residue - matrix([[4.8, 0.0], [-1.6, 0.0]])).amax() < 1e-13);
}

#[test]
fn an_actuator_a_million_times_faster_than_its_load_keeps_its_terms() {
    let example = Example {
        A_m: matrix([[0.0, 1.0, 0.0], [-90025.0, -600.0, 1.0], [0.0, 0.0, -6e8]]),
        B: matrix([[0.0], [0.0], [6e8]]),
        C: matrix([[1.0, 0.0, 0.0]]),
        B_um: matrix([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
    };
    let equivalent = example.equivalent();
    // By hand: (s/6e8 + 1) (s + 600) and s/6e8 + 1.
    let expected = [matrix([[600.0, 1.0]]), matrix([[1.0 + 1e-6, 1.0 / 6e8]]), matrix([[1.0 / 6e8, 0.0]])];
    assert_eq!(equivalent.degree(), 2);
    for (h, expected) in equivalent.polynomial.iter().zip(expected) {
        assert!((h - &expected).amax() < 1e-14 * expected.amax(), "{h}");
    }
}

#[test]
fn outputs_that_show_the_same_input_first_are_distinguished_by_their_difference() {
    let example = Example {
        A_m: matrix([[-1.0, 0.0, 1.0, 0.0], [0.0, -2.0, 0.0, 0.0], [0.0, 0.0, -3.0, 1.0], [0.0, 1.0, 0.0, -5.0]]),
        B: matrix([[1.0, 0.0], [2.0, 0.0], [0.0, 0.0], [0.0, 1.0]]),
        C: matrix([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]),
        B_um: matrix([[1.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
    };
    let equivalent = example.equivalent();
    // sympy: [[0, 1/2], [s² + 9 s + 20, −s²/2 − 4 s − 15/2]].
    let expected =
        [matrix([[0.0, 0.5], [20.0, -7.5]]), matrix([[0.0, 0.0], [9.0, -4.0]]), matrix([[0.0, 0.0], [1.0, -0.5]])];
    assert_eq!((equivalent.degree(), equivalent.A_z.nrows()), (2, 0));
    for (h, expected) in equivalent.polynomial.iter().zip(expected) {
        assert!((h - expected).amax() < 1e-14, "{h}");
    }
}

#[test]
fn units_of_states_inputs_and_outputs_do_not_matter() {
    let units = [1e6, 1e-6, 1.0, 1e3, 1e-5];
    let (u, y) = ([1e-6, 1e4], [1e6, 1e-6]);
    for example in [with_zeros(), uneven()] {
        let other = example.in_units(&units, &u, &y);
        let (equivalent, rescaled) = (example.equivalent(), other.equivalent());
        assert_eq!(rescaled.degree(), equivalent.degree());
        assert_zeros(&rescaled, &equivalent.zeros().unwrap(), 1e-11);
        for s in [at(0.5, 0.0), at(0.0, 2.0), at(-0.3, 1.0), at(40.0, -70.0)] {
            let mut found = rescaled.at(s);
            (0..2).for_each(|i| found.row_mut(i).scale_mut(u[i]));
            assert_same(&found, &equivalent.at(s), 1e-12, "in other units");
            assert_same(&found, &example.quotient(s), 1e-12, "as written");
        }
    }
}

/// Numbers between −1 and 1.
fn random_numbers(mut state: u64) -> impl FnMut() -> f64 {
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
    }
}

/// A chain of integrators from each input to a signal, stable by feedback, and stable dynamics driven by these signals;
/// outputs, inputs and states are mixed. Its zeros are the eigenvalues of the driven dynamics.
fn random_example(lengths: &[usize], n_z: usize, k: usize, random: &mut impl FnMut() -> f64) -> (Example, Vec<f64>) {
    let (m, n) = (lengths.len(), lengths.iter().sum::<usize>() + n_z);
    let mixing = |size: usize, random: &mut dyn FnMut() -> f64| {
        DMatrix::from_fn(size, size, |i, j| f64::from(u8::from(i == j)) * 2.0 + 0.7 * random())
    };
    let zeros: Vec<_> = (0..n_z).map(|i| -0.5 - i as f64 - 0.3 * random()).collect();
    let (mut A_m, mut B, mut C) = (DMatrix::zeros(n, n), DMatrix::zeros(n, m), DMatrix::zeros(m, n));
    for (i, zero) in zeros.iter().enumerate() {
        A_m[(i, i)] = *zero;
        (i + 1..n_z).for_each(|j| A_m[(i, j)] = random());
    }
    let mut first = n_z;
    for (i, &length) in lengths.iter().enumerate() {
        let last = first + length - 1;
        (0..n_z).for_each(|z| A_m[(z, first)] = random());
        (first..last).for_each(|x| A_m[(x, x + 1)] = 1.0);
        // (s + 2)^length.
        let mut coefficient = 1.0;
        for j in 0..length {
            coefficient *= 2.0 * (length - j) as f64 / (j + 1) as f64;
            A_m[(last, last - j)] = -coefficient;
        }
        (B[(last, i)], C[(i, first)]) = (1.0, 1.0);
        first = last + 1;
    }
    let states = mixing(n, random);
    let inverse = states.clone().try_inverse().unwrap();
    let B = &states * B * mixing(m, random);
    let C = mixing(m, random) * C * &inverse;
    (Example { A_m: &states * A_m * inverse, B, C, B_um: DMatrix::from_fn(n, k, |_, _| random()) }, zeros)
}

#[test]
fn random_systems_are_inverted() {
    let mut random = random_numbers(11);
    for lengths in [&[1][..], &[2], &[4], &[1, 1], &[2, 1], &[3, 1], &[2, 3], &[1, 1, 1], &[1, 2, 3], &[2, 2, 2]] {
        let order: usize = lengths.iter().sum();
        for n_z in 0..=8 - order {
            let (example, zeros) = random_example(lengths, n_z, 1 + n_z % 3, &mut random);
            let equivalent = example.equivalent();
            assert_eq!(equivalent.degree(), lengths.iter().max().unwrap() - 1, "{lengths:?}, {n_z}");
            let zeros: Vec<_> = zeros.into_iter().map(Complex::from).collect();
            assert_zeros(&equivalent, &zeros, 1e-8);
            for s in [at(0.1, 0.0), at(0.0, 1.0), at(0.7, -3.0), at(2.0, 20.0)] {
                assert_same(&equivalent.at(s), &example.quotient(s), 1e-9, &format!("{lengths:?}, {n_z}"));
            }
        }
    }
}

#[test]
fn state_feedback_does_not_move_the_zeros() {
    let example = with_zeros();
    let K = matrix([[3.0, -1.0, 0.5, 0.2, 1.0], [-0.7, 2.0, 5.0, 1.0, -0.4]]);
    let closed = Example { A_m: &example.A_m - &example.B * K, ..example.clone() };
    assert_zeros(&closed.equivalent(), &example.equivalent().zeros().unwrap(), 1e-12);
}

#[test]
fn unstable_and_missing_inverses_are_refused() {
    let single = |c: [f64; 3]| Example {
        A_m: matrix([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-6.0, -11.0, -6.0]]),
        B: matrix([[0.0], [0.0], [1.0]]),
        C: matrix([c]),
        B_um: matrix([[0.0], [1.0], [0.0]]),
    };
    // Controllable form: the numerator is c1 + c2 s + c3 s².
    let message = single([-2.0, 1.0, 0.0]).refusal();
    assert!(message.contains("zero of C (sI - A_m)^-1 B = 2.000000") && message.contains("must have"), "{message}");
    for on_the_axis in [[0.0, 1.0, 0.0], [4.0, 0.0, 1.0], [0.0, 0.0, 1.0]] {
        assert!(single(on_the_axis).refusal().contains("unstable: choose other outputs C"));
    }
    assert!(single([0.0, 0.0, 0.0]).refusal().contains("singular"));
    // Two outputs that are the same signal, and two inputs that are.
    let mut example = with_zeros();
    example.C.set_row(1, &(example.C.row(0) * 0.3));
    assert!(example.refusal().contains("C (sI - A_m)^-1 B is singular"), "{}", example.refusal());
    let mut example = with_zeros();
    example.B.set_column(1, &(example.B.column(0) * 0.3));
    assert!(example.refusal().contains("choose other outputs C"), "{}", example.refusal());
    let mut example = with_zeros();
    example.A_m[(0, 0)] = f64::NAN;
    assert!(example.refusal().contains("too badly scaled"));
}

#[test]
fn numbers_of_any_size_end_in_an_answer() {
    let mut random = random_numbers(5);
    let (mut inverted, mut refused) = (0, 0);
    for _ in 0..3000 {
        let mut example = if random() > 0.0 { third_order() } else { with_zeros() };
        let largest = 160.0 * random().abs();
        for entry in example.A_m.iter_mut() {
            *entry = (*entry + random().powi(5)) * 10.0_f64.powf(largest * random());
        }
        match MatchedEquivalent::new(("A_m", &example.A_m), &example.B, &example.C, &example.B_um) {
            Ok(_) => inverted += 1,
            Err(_) => refused += 1,
        }
    }
    assert!(inverted > 100 && refused > 100, "{inverted} inverted, {refused} refused");
}

#[test]
fn a_filter_with_too_few_poles_is_refused() {
    let message = uneven().equivalent().behind(&filter(&[&[1.0, 0.0]])).unwrap_err().to_string();
    let expected = "D(s): relative degree = 1: must be at least 2, the highest power of s in H_m(s)^-1 H_um(s)";
    assert!(message.contains(expected) && message.contains("more poles"), "{message}");
}
