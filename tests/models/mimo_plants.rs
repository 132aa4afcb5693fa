//! Known properties of the plants with several inputs: rest, linear parts, small swings, limit cycles.

use common::random::Random;
use common::{ERROR, OK, Unit};
use nalgebra::{DMatrix, dmatrix};

/// An FMU for model exchange, with these parameters.
fn begun(name: &str, parameters: &[(&str, f64)]) -> Unit {
    let unit = Unit::exchange(name);
    parameters.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.begin();
    unit
}

/// An FMU for co-simulation, with these parameters and a small tolerance.
fn simulated(name: &str, parameters: &[(&str, f64)]) -> Unit {
    let unit = Unit::new(name);
    unit.put("relative_tolerance", 1e-10);
    parameters.iter().for_each(|&(name, value)| unit.put(name, value));
    unit.start(0.0);
    unit
}

fn rates(unit: &Unit, states: &[f64], inputs: &[f64]) -> Vec<f64> {
    inputs.iter().enumerate().for_each(|(i, value)| unit.put(&format!("u[{}]", i + 1), *value));
    assert_eq!(unit.set_states(states), OK);
    unit.derivatives()
}

/// Slopes of the first rates by the first states, and by the inputs: central differences at rest.
fn linearised(unit: &Unit, states: usize, inputs: usize) -> (DMatrix<f64>, DMatrix<f64>) {
    let (h, rest) = (1e-6, unit.states());
    let column = |state: usize, input: usize| {
        let moved = |h: f64| {
            let (mut x, mut u) = (rest.clone(), vec![0.0; inputs]);
            x.iter_mut().take(states).for_each(|x| *x = 0.0);
            x.get_mut(state).into_iter().chain(u.get_mut(input)).for_each(|value| *value += h);
            rates(unit, &x, &u)
        };
        let (after, before) = (moved(h), moved(-h));
        (0..states).map(|i| (after[i] - before[i]) / (2.0 * h)).collect::<Vec<_>>()
    };
    let none = usize::MAX;
    let a: Vec<f64> = (0..states).flat_map(|k| column(k, none)).collect();
    let b: Vec<f64> = (0..inputs).flat_map(|k| column(none, k)).collect();
    (DMatrix::from_vec(states, states, a), DMatrix::from_vec(states, inputs, b))
}

fn assert_close(found: &DMatrix<f64>, expected: &DMatrix<f64>) {
    assert!((found - expected).amax() < 1e-7, "{found}, not {expected}");
}

#[test]
fn the_coupled_system_starts_from_the_printed_linear_part() {
    let plant = begun("CoupledMimo", &[]);
    assert_eq!(rates(&plant, &[0.0; 3], &[0.0; 3]), [1.0, 2.2, 0.0], "the disturbance at t = 0");
    let (a, b) = linearised(&plant, 3, 3);
    // A; 0.3, 0.6 and 1.5 from θ(0), transposed; 0.2 and −0.2 from Δf.
    assert_close(&a, &dmatrix![-36.0 + 0.2, 36.0, 0.0; -0.2, 20.0 + 0.3, 0.6; 0.0, 0.0, -3.0 + 1.5]);
    assert_close(&b, &DMatrix::identity(3, 3));
}

#[test]
fn the_control_of_the_coupled_system_acts_nonlinearly_when_chosen() {
    let (affine, nonaffine) = (begun("CoupledMimo", &[]), Unit::exchange("CoupledMimo"));
    assert_eq!(nonaffine.set_boolean("nonaffine", true), OK);
    nonaffine.begin();
    let mut random = Random::new(1);
    for _ in 0..20 {
        let [x, u] = [(); 2].map(|()| random.vector::<3>());
        let (without, with) = (rates(&affine, &x, &u), rates(&nonaffine, &x, &u));
        let expected = [-2.5 * u[2] * u[0].cos(), 0.7 * u[2] * u[2], 0.0];
        (0..3).for_each(|i| assert!((with[i] - without[i] - expected[i]).abs() < 1e-13, "{with:?}, {without:?}"));
    }
}

#[test]
fn the_system_with_unmatched_uncertainty_is_linear_without_it() {
    let names: Vec<String> = (1..=9).map(|i| format!("k[{i}]")).collect();
    let none: Vec<_> = names.iter().map(|name| (name.as_str(), 0.0)).collect();
    let (a, b) = linearised(&begun("UnmatchedMimo", &none), 3, 2);
    assert_close(&a, &dmatrix![-0.8, -0.2, -0.3; -0.2, -0.2, 1.6; -0.1, -1.0, -2.7]);
    assert_close(&b, &dmatrix![0.6, -0.2; 0.0, 0.0; 0.8, 1.0]);
}

#[test]
fn the_oscillator_in_the_unmodeled_dynamics_goes_its_own_way() {
    let [still, driven] = [0.0, 0.8].map(|u| {
        let plant = simulated("UnmatchedMimo", &[]);
        plant.put("u[1]", u);
        assert_eq!((plant.get("x_z[1]"), plant.get("x_z[2]")), (1.0, 1.0));
        (0..3000).map(|k| (plant.run(f64::from(k) * 0.01, 1, 0.01), plant.get("x_z[1]")).1).collect::<Vec<_>>()
    });
    let largest = still[1500..].iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    assert!((largest - 2.0).abs() < 0.02, "the limit cycle of Van der Pol's oscillator reaches 2, not {largest}");
    assert!(still.iter().zip(&driven).all(|(still, driven)| (still - driven).abs() < 1e-6));
}

#[test]
fn the_secant_of_the_print_is_a_choice() {
    let [sech, secant] = [false, true].map(|secant| {
        let slope = |k4: f64| {
            let plant = Unit::exchange("UnmatchedMimo");
            plant.put("k[4]", k4);
            assert_eq!(plant.set_boolean("use_secant", secant), OK);
            plant.begin();
            rates(&plant, &[0.3, 1.2, -0.4, 1.0, 1.0, 0.0, 0.0], &[0.0; 2])[1]
        };
        slope(1.0) - slope(0.0)
    });
    assert!((sech - 0.6 / 1.2_f64.cosh()).abs() < 1e-14 && (secant - 0.6 / 1.2_f64.cos()).abs() < 1e-14);
}

#[test]
fn no_motion_passes_the_pole_of_the_secant() {
    let plant = |x2: f64| {
        let plant = Unit::new("UnmatchedMimo");
        plant.put("x0[2]", x2);
        assert_eq!(plant.set_boolean("use_secant", true), OK);
        plant.enter(0.0);
        plant
    };
    let beyond = plant(-1.6);
    assert_eq!(beyond.exit(), ERROR);
    let message = beyond.last_message();
    assert!(message.contains("x0[2] = -1.6") && message.contains("use_secant"), "{message}");
    let near = plant(1.5);
    assert_eq!(near.exit(), OK);
    let before = near.values();
    assert_eq!(near.step(0.0, 0.1), ERROR, "it reaches pi/2 within 0.01 s");
    assert_eq!(near.values(), before);
}

const FRICTIONLESS: &[(&str, f64)] = &[("B1_psi", 0.0), ("B2_psi", 0.0), ("B1_phi", 0.0), ("B2_phi", 0.0)];

#[test]
fn the_twin_rotor_rests_where_it_hangs() {
    let plant = begun("TwinRotor", &[]);
    assert!(rates(&plant, &[0.0, 0.0, 0.7, 0.0, 0.0, 0.0, 0.0], &[0.0; 2]).iter().all(|rate| *rate == 0.0));
}

#[test]
fn small_motions_of_the_twin_rotor_follow_a_chain_for_each_axis() {
    for (coulomb, slope) in [(0.0, 0.0), (1.0, 1.0 / 0.01)] {
        let plant = begun("TwinRotor", &[("B2_psi", 0.001 * coulomb), ("B2_phi", 0.01 * coulomb)]);
        let (a, b) = linearised(&plant, 6, 2);
        let (i1, i2, lead) = (0.068, 0.02, -0.2 * 3.5 / 2.0);
        let (pitch, yaw) = (0.006 + 0.001 * slope, 0.1 + 0.01 * slope);
        let expected = dmatrix![
            0.0, 1.0, 0.0, 0.0, 0.0, 0.0;
            -0.32 / i1, -pitch / i1, 0.0, 0.0, 0.0924 / i1, 0.0;
            0.0, 0.0, 0.0, 1.0, 0.0, 0.0;
            0.0, 0.0, 0.0, -yaw / i2, -lead * 0.0924 / i2, 0.09 / i2;
            0.0, 0.0, 0.0, 0.0, -1.0 / 1.1, 0.0;
            0.0, 0.0, 0.0, 0.0, 0.0, -1.0
        ];
        // Smoothed friction bends over 0.01 rad/s: a difference over 1e-6 rad/s is 3e-9 of its slope too small.
        assert!((&a - &expected).amax() < 3e-7, "{a}, not {expected}");
        assert_close(&b, &dmatrix![0.0, 0.0; 0.0, 0.0; 0.0, 0.0; 0.0, 0.0; 1.0, 0.0; 0.0, 0.8]);
    }
}

#[test]
fn without_friction_the_twin_rotor_is_a_pendulum_in_pitch() {
    let omega = (0.32_f64 / 0.068).sqrt();
    let small = simulated("TwinRotor", &[FRICTIONLESS, &[("x0[1]", 1e-3)]].concat());
    let wide = simulated("TwinRotor", &[FRICTIONLESS, &[("x0[1]", 2.0)]].concat());
    let energy = || 0.5 * 0.068 * wide.get("x[2]").powi(2) - 0.32 * wide.get("x[1]").cos();
    let before = energy();
    for k in 0..1000 {
        [&small, &wide].iter().for_each(|unit| unit.run(f64::from(k) * 0.01, 1, 0.01));
        let t = f64::from(k + 1) * 0.01;
        let error = small.get("x[1]") - 1e-3 * (omega * t).cos();
        // A swing of 1e-3 rad is longer by 6e-8 of its period.
        assert!(error.abs() < 1e-8, "{error:e} rad at t = {t} s");
        assert!((energy() - before).abs() < 1e-8, "{:e} J at t = {t} s", energy() - before);
        assert_eq!(wide.get("y[2]"), 0.0, "nothing turns it in yaw");
    }
}
