//! The sampled controller with any filter, and with unmatched uncertainty: its equations written out, on the loops of
//! the thesis, as a single FMU and as separate ones.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::by_hand::{Filter, Law, Matrix, Published, flow, of_columns, placed, run};
use super::examples::{START, position_loop, quadrotor, quadrotor_reference, twin, unmatched};
use common::closed::{Closed, metrics};
use common::models::Run;
use common::{OK, Unit, description};
use toml::Table;

const UNMATCHED: &str = "L1SampledUnmatchedMimo";
const FREE: f64 = f64::INFINITY;

/// The description of an L1 unit of this package as that of a sampled law, with what its start keeps and these lines.
fn sampled(name: &str, own_keys: &[&str], start: &str) -> String {
    let mut table: Table = description(name).parse().unwrap();
    table.insert("model".to_owned(), "l1-sampled".into());
    let old = table.remove("start").unwrap();
    let mut all: Table = start.parse().unwrap();
    own_keys.iter().for_each(|key| drop(all.insert((*key).to_owned(), old[*key].clone())));
    table.insert("start".to_owned(), all.into());
    table.to_string()
}

pub fn twin_text(T: f64, d: usize) -> String {
    sampled("L1TwinRotor", &["feedback_gain", "pole_real"], &at(T, d))
}

fn at(T: f64, d: usize) -> String {
    format!("sample_time = {T:?}\ndelay_steps = {d}")
}

/// Largest deviations of 3.4.1 from the desired model, with its sample times and dead times.
#[test]
fn the_equations_written_out_deviate_from_the_desired_model_of_3_4_1_as_they_are_known_to() {
    for (T, d, largest, largest_u) in [
        (1e-3, 0, [0.1928, 0.0441], [1.26, 2.18]),
        (2e-3, 0, [0.1921, 0.0440], [1.26, 2.18]),
        (5e-3, 0, [0.1902, 0.0436], [1.26, 2.19]),
        (1e-2, 0, [0.1869, 0.0437], [1.26, 2.21]),
        (2e-2, 0, [0.1803, 0.0450], [1.26, 2.24]),
        (1e-3, 1, [0.1939, 0.0445], [1.26, 2.18]),
        (2e-3, 1, [0.1943, 0.0448], [1.26, 2.19]),
        (5e-3, 1, [0.1957, 0.0457], [1.26, 2.22]),
        (1e-2, 1, [0.1981, 0.0473], [1.25, 2.28]),
    ] {
        let ran = unmatched(T, d, 30.0);
        for i in 0..2 {
            assert!((ran.largest[i] - largest[i]).abs() < 5.1e-5, "T = {T}, d = {d}: {:?}", ran.largest);
            assert!((ran.largest_u[i] - largest_u[i]).abs() < 5.1e-3, "T = {T}, d = {d}: {:?}", ran.largest_u);
        }
    }
}

#[test]
fn the_equations_written_out_hold_the_twin_rotor_as_the_continuous_law_does() {
    for (T, d, rms, largest) in [
        (1e-3, 0, [0.00719, 0.01548], [0.833, 0.503]),
        (2e-3, 0, [0.00719, 0.01548], [0.833, 0.503]),
        (5e-3, 0, [0.00720, 0.01549], [0.833, 0.504]),
        (1e-2, 0, [0.00720, 0.01550], [0.833, 0.505]),
        (1e-3, 1, [0.00719, 0.01548], [0.833, 0.503]),
        (2e-3, 1, [0.00719, 0.01548], [0.833, 0.503]),
        (5e-3, 1, [0.00719, 0.01549], [0.833, 0.505]),
        (1e-2, 1, [0.00720, 0.01551], [0.833, 0.508]),
    ] {
        let ran = twin(T, d, FREE, 30.0);
        for i in 0..2 {
            assert!((ran.rms[i] - rms[i]).abs() < 5.1e-6, "T = {T}, d = {d}: {:?}", ran.rms);
            assert!((ran.largest_u[i] - largest[i]).abs() < 5.1e-4, "T = {T}, d = {d}: {:?}", ran.largest_u);
        }
    }
}

/// Case 1, and case 2 with its wrong input gains.
#[test]
fn the_equations_written_out_hold_the_attitude_of_a_quadrotor() {
    for (T, d, is_uncertain, rms) in [
        (1e-3, 0, false, [4.9e-4, 4.5e-4, 5.08e-3, 1.10e-3, 1.14e-3]),
        (2e-3, 0, false, [4.9e-4, 4.5e-4, 5.08e-3, 1.10e-3, 1.14e-3]),
        (5e-3, 0, false, [5.0e-4, 4.5e-4, 5.09e-3, 1.10e-3, 1.15e-3]),
        (1e-2, 0, false, [5.0e-4, 4.5e-4, 5.14e-3, 1.11e-3, 1.15e-3]),
        (1e-3, 1, false, [5.0e-4, 4.6e-4, 5.08e-3, 1.11e-3, 1.16e-3]),
        (2e-3, 1, false, [5.0e-4, 4.6e-4, 5.08e-3, 1.12e-3, 1.17e-3]),
        (5e-3, 1, false, [5.2e-4, 4.8e-4, 5.09e-3, 1.16e-3, 1.20e-3]),
        (1e-2, 1, false, [5.5e-4, 5.0e-4, 5.14e-3, 1.23e-3, 1.27e-3]),
        (1e-3, 0, true, [4.9e-4, 4.5e-4, 5.08e-3, 1.10e-3, 1.14e-3]),
        (5e-3, 1, true, [5.2e-4, 4.8e-4, 5.09e-3, 1.16e-3, 1.20e-3]),
        (1e-2, 1, true, [5.5e-4, 5.0e-4, 5.14e-3, 1.23e-3, 1.27e-3]),
    ] {
        let ran = quadrotor(T, d, is_uncertain, 20.0);
        for (found, known) in ran.rms.iter().zip(rms) {
            assert!((found - known).abs() < 1.1e-5, "T = {T}, d = {d}: {:?}", ran.rms);
        }
    }
    // Where the true gain is 1.6 times the nominal one, 20 ms and a sample of dead time are too much.
    assert!(quadrotor(2e-2, 1, true, 20.0).rms.iter().any(|rms| !rms.is_finite()));
}

/// A loop of FMUs of this package as a single FMU.
fn whole([reference, plant]: [&str; 2], controller: &str, start: &str, [m, n]: [usize; 2]) -> Closed {
    let closed = Closed::new().part("reference", reference, "").part("plant", plant, "");
    let closed = closed.described("controller", controller, start);
    let closed = closed.connected("reference.r", "controller.r", m).connected("reference.dr", "controller.dr", m);
    closed.connected("plant.x", "controller.x", n).connected("controller.u", "plant.u", m)
}

/// Compares the controls in the middle of the intervals, where nothing jumps.
fn same_controls(run: &mut Run, T: f64, controls: &[Vec<f64>], within: f64) {
    for (k, u) in controls.iter().enumerate() {
        run.step(if k == 0 { 0.5 * T } else { T });
        for (i, u) in u.iter().enumerate() {
            let found = run.get(&format!("controller.u[{}]", i + 1));
            assert!((found - u).abs() < within * (1.0 + u.abs()), "T = {T}, {k}: {found}, {u:?}");
        }
    }
}

#[test]
fn the_loop_of_3_4_1_as_a_composite_is_that_of_the_equations_written_out() {
    for T in [5e-3, 2e-2] {
        let hand = unmatched(T, 0, 3.0);
        let text = description(UNMATCHED);
        let closed = whole(["ReferenceUnmatchedMimo", "UnmatchedMimo"], &text, &at(T, 0), [2, 3]);
        same_controls(&mut closed.started(1e-9), T, &hand.controls, 1e-6);
    }
}

/// Plant and reference are stepped first, so a step of the reference at a sample counts in this sample. In the single
/// FMU the sample takes the reference before its step.
#[test]
fn the_fmus_of_3_4_1_deviate_from_the_desired_model_as_documented() {
    let T = 1e-2;
    let [reference, plant, controller] = ["ReferenceUnmatchedMimo", "UnmatchedMimo", UNMATCHED].map(Unit::new);
    [&reference, &plant, &controller].iter().for_each(|unit| unit.start(0.0));
    let (mut ideal, mut largest) = (vec![0.0; 3], [0.0_f64; 2]);
    for k in 0..3000 {
        let r = [1, 2].map(|i| reference.get(&format!("r[{i}]")));
        (1..=2).for_each(|i| plant.put(&format!("u[{i}]"), controller.get(&format!("u[{i}]"))));
        for unit in [&reference, &plant] {
            assert_eq!(unit.step(k as f64 * T, T), OK, "{:?}", unit.messages());
        }
        (1..=2).for_each(|i| controller.put(&format!("r[{i}]"), reference.get(&format!("r[{i}]"))));
        (1..=3).for_each(|i| controller.put(&format!("x[{i}]"), plant.get(&format!("x[{i}]"))));
        assert_eq!(controller.step(k as f64 * T, T), OK, "{:?}", controller.messages());
        ideal = flow(&ideal, 0.0, T, 20, &|_, x| vec![-x[0] + r[0], x[2], -x[1] - 1.8 * x[2] + r[1]]);
        for i in 0..2 {
            largest[i] = largest[i].max((plant.get(&format!("y[{}]", i + 1)) - ideal[i]).abs());
        }
    }
    assert!((largest[0] - 0.1869).abs() < 1e-4 && (largest[1] - 0.0437).abs() < 1e-4, "{largest:?}");
}

#[test]
fn as_a_composite_a_sample_takes_the_reference_before_its_step() {
    let ideal = "model = 'state-space'\n[structure]\nA = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]\n\
                 B = [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]";
    let closed = whole(["ReferenceUnmatchedMimo", "UnmatchedMimo"], &description(UNMATCHED), "", [2, 3]);
    let mut run = closed.described("ideal", ideal, "").connected("reference.r", "ideal.u", 2).started(1e-8);
    let found = metrics(&mut run, &["plant.y[1] -ideal.y[1]", "plant.y[2] -ideal.y[2]"], [30.0, 0.0, 5e-3]);
    assert!((found[0].max - 0.1990).abs() < 5.1e-5 && (found[1].max - 0.0464).abs() < 5.1e-5, "{found:?}");
}

#[test]
fn separate_units_of_3_4_1_that_are_stepped_at_once_are_the_law_with_a_sample_of_dead_time() {
    let T = 1e-2;
    let hand = unmatched(T, 1, 3.0);
    let text = description(UNMATCHED).replace("sample_time = 0.01", &at(T, 1));
    let [reference, plant] = ["ReferenceUnmatchedMimo", "UnmatchedMimo"].map(Unit::new);
    let controller = Unit::from_text(&text);
    let units = [&reference, &plant, &controller];
    units.iter().for_each(|unit| unit.start(0.0));
    for (k, u) in hand.controls.iter().enumerate() {
        for i in 1..=2 {
            controller.put(&format!("r[{i}]"), reference.get(&format!("r[{i}]")));
            let found = controller.get(&format!("u[{i}]"));
            assert!((found - u[i - 1]).abs() < 1e-5, "{k}: {found}, {u:?}");
            plant.put(&format!("u[{i}]"), found);
        }
        (1..=3).for_each(|i| controller.put(&format!("x[{i}]"), plant.get(&format!("x[{i}]"))));
        units.iter().for_each(|unit| assert_eq!(unit.step(k as f64 * T, T), OK, "{:?}", unit.messages()));
    }
}

/// Uncertainty in psi'' and phi'' enters the control immediately there; the kinematic rows are found and not cancelled.
/// Within limits that it sometimes exceeds, nothing winds up.
#[test]
fn the_twin_rotor_as_a_composite_is_that_of_the_equations_written_out() {
    for (T, limit) in [(5e-3, FREE), (1e-2, FREE), (1e-2, 0.6)] {
        let hand = twin(T, 0, limit, 4.0);
        let limits = format!("\nu_min = [-{limit:?}, -{limit:?}]\nu_max = [{limit:?}, {limit:?}]");
        let start = if limit.is_finite() { limits } else { String::new() };
        let closed = whole(["ReferenceTwinRotor", "TwinRotor"], &twin_text(T, 0), &start, [2, 6]);
        same_controls(&mut closed.started(1e-9), T, &hand.controls, 1e-5);
    }
}

/// The attitude by this controller, with a position loop of the user, all stepped simultaneously.
#[test]
fn a_quadrotors_attitude_behind_a_position_loop_of_ones_own_is_that_of_the_equations_written_out() {
    let T = 5e-3;
    let hand = quadrotor(T, 1, false, 1.0);
    let mut table: Table = sampled("L1Quadrotor", &["pole_real", "pole_imag"], &at(T, 1)).parse().unwrap();
    table["structure"].as_table_mut().unwrap().remove("commands");
    let gains = "feedback_gain = [30.0, 30.0, 30.0]\nnominal_input_gain = [[206.18556701030928, 0.0, 0.0], \
                 [0.0, 206.18556701030928, 0.0], [0.0, 0.0, 113.50737797956867]]";
    table["start"].as_table_mut().unwrap().extend(gains.parse::<Table>().unwrap());
    let (controller, plant) = (Unit::from_text(&table.to_string()), Unit::new("Quadrotor"));
    let state = |plant: &Unit| (1..=12).map(|i| plant.get(&format!("x[{i}]"))).collect::<Vec<_>>();
    // Thrust, and what the controller is given, of a point.
    let give = |t: f64, s: &[f64]| {
        let ([thrust, phi, theta], [r, dr, _]) = (position_loop(t, s), quadrotor_reference(t));
        [phi, theta, r[3]].iter().enumerate().for_each(|(i, r)| controller.put(&format!("r[{}]", i + 1), *r));
        controller.put("dr[3]", dr[3]);
        s[6..12].iter().enumerate().for_each(|(i, x)| controller.put(&format!("x[{}]", i + 1), *x));
        thrust
    };
    plant.start(0.0);
    let start = state(&plant);
    assert!((0..3).all(|i| start[6 + i] == START[i]));
    controller.enter(0.0);
    let mut late = give(0.0, &start);
    assert_eq!(controller.exit(), OK);
    for (k, u) in hand.controls.iter().enumerate() {
        let t = k as f64 * T;
        let thrust = give(t, &state(&plant));
        plant.put("u[1]", late);
        late = thrust;
        for i in 1..=3 {
            let found = controller.get(&format!("u[{i}]"));
            assert!((found - u[i]).abs() < 1e-6, "{k}: {found}, {u:?}");
            plant.put(&format!("u[{}]", i + 1), found);
        }
        for unit in [&plant, &controller] {
            assert_eq!(unit.step(t, T), OK, "{:?}", unit.messages());
        }
    }
}

/// Two channels a' = b + σ, b' = −a − 1.4 b + v with y = a + b/2, which has a zero; σ enters only the first of them.
mod zeros {
    use super::*;

    pub const T: f64 = 0.02;
    pub const W_0: [[f64; 2]; 2] = [[2.0, 0.3], [-0.2, 1.5]];
    pub const K: [[f64; 2]; 2] = [[10.0, 2.0], [-1.0, 12.0]];
    pub const STRUCTURE: &str = "A = [[0.0, 1.0, 0.0, 0.0], [-1.0, -1.4, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -1.0, -1.4]]\n\
        B = [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.5]]\n\
        B_um = [[1.0], [0.0], [0.0], [0.0]]\nunmatched = true\nbaseline = 'outside'\n\
        filter = { gain = 1.3, numerator = [[0.02, 1.0]], denominator = [[1.0, 0.0], [0.05, 1.0]] }";

    pub fn rows(matrix: [[f64; 2]; 2]) -> Matrix {
        matrix.iter().map(|row| row.to_vec()).collect()
    }

    /// D(s) = 1.3 (0.02 s + 1)/(s (0.05 s + 1)), states integral and lag; behind it H_m⁻¹ H_um = 2 (s + β)/(s + 2).
    fn filter(K_d: &Matrix) -> Filter {
        let beta = 0.9 + K_d[0][1] - 0.5 * K_d[0][0];
        let output = |q: &[f64]| -> Vec<f64> {
            (0..2).map(|i| 1.3 * (q[2 * i + 1] + 0.02 / 0.05 * (q[2 * i] - q[2 * i + 1]))).collect()
        };
        Filter {
            order: 5,
            output: Box::new(move |q, _| output(q)),
            rates: Box::new(move |q, w, sigma_2| {
                let zeta = output(q);
                let equivalent = [2.0 * sigma_2[0] + 2.0 * (beta - 2.0) * q[4], 0.0];
                let asked: Vec<f64> = (0..2).map(|j| zeta[j] + w[j] + equivalent[j]).collect();
                let into = |i: usize| -(K[i][0] * asked[0] + K[i][1] * asked[1]);
                let lag = |i: usize| (q[2 * i] - q[2 * i + 1]) / 0.05;
                vec![into(0), lag(0), into(1), lag(1), -2.0 * q[4] + sigma_2[0]]
            }),
        }
    }

    pub fn law(is_published: bool, limit: f64) -> Law {
        let chain = |first: bool, row: [f64; 2]| {
            let (own, other) = (row.to_vec(), vec![0.0; 2]);
            if first { [own, other].concat() } else { [other, own].concat() }
        };
        let dynamics = |a: f64, b: f64| -> Matrix {
            [true, false].iter().flat_map(|&first| [chain(first, [0.0, 1.0]), chain(first, [a, b])]).collect()
        };
        let A = dynamics(-1.0, -1.4);
        let by = |W: [f64; 2]| vec![0.0, W[0], 0.0, W[1]];
        let directions = of_columns(&[
            by([W_0[0][0], W_0[1][0]]),
            by([W_0[0][1], W_0[1][1]]),
            vec![1.0, 0.0, 0.0, 0.0],
            vec![0.0, 0.0, 1.0, 0.0],
        ]);
        let C = vec![chain(true, [1.0, 0.5]), chain(false, [1.0, 0.5])];
        let place = |A_d: &Matrix, B_v: &Matrix| -> Matrix {
            let gain = |i: usize| {
                let own: Matrix = (2 * i..2 * i + 2).map(|k| A_d[k][2 * i..2 * i + 2].to_vec()).collect();
                let gain = placed(&own, &[B_v[2 * i][i], B_v[2 * i + 1][i]], &[-3.0, -4.0], T);
                chain(i == 0, [gain[0], gain[1]])
            };
            vec![gain(0), gain(1)]
        };
        let mut law = Law::new([T, limit], 0, [&A, &directions, &C, &rows(W_0)], &place, &filter);
        // (s + 3)(s + 4) = s² + (1.4 + k_2) s + 1 + k_1
        law.published = is_published.then(|| Published {
            A_m: dynamics(-12.0, -7.0),
            K_m: vec![chain(true, [11.0, 5.6]), chain(false, [11.0, 5.6])],
            directions,
            x_hat: None,
            sigma: vec![0.0; 4],
        });
        law
    }
}

/// Full gains, a filter with a zero, transmission zeros, a part of what is unmatched, limits, both estimates: with a plant that
/// is something else.
#[test]
fn with_any_filter_and_full_gains_it_is_the_law_written_out() {
    use zeros::{K, STRUCTURE, T, W_0};
    let A = [[0.1, 1.0, 0.1, 0.0], [-0.7, -1.6, 0.0, 0.2], [0.0, -0.1, 0.0, 1.1], [0.3, 0.0, -1.4, -1.0]];
    let (B, constant, r) = ([[2.3, 0.2], [-0.1, 1.3]], [0.4, -0.6, 0.2, 0.5], [0.7, -0.4]);
    for (estimate, limit) in [("exact", FREE), ("published", FREE), ("exact", 0.8)] {
        let mut law = zeros::law(estimate == "published", limit);
        let rates = |_: f64, x: &[f64], [u, _]: [&[f64]; 2]| -> Vec<f64> {
            let by = |row: usize| B[row][0] * u[0] + B[row][1] * u[1];
            let input = [0.0, by(0), 0.0, by(1)];
            (0..4).map(|i| (0..4).map(|j| A[i][j] * x[j]).sum::<f64>() + input[i] + constant[i]).collect()
        };
        let asked = |_: f64, _: &[f64]| [r.to_vec(), vec![0.0; 2]];
        let error = |_: f64, x: &[f64]| vec![r[0] - x[0] - 0.5 * x[1], r[1] - x[2] - 0.5 * x[3]];
        let hand = run(&mut law, (&[0.0; 4], 4), [6.0, 5.5, 1e-3], &rates, &asked, &error);
        if estimate == "exact" && limit.is_infinite() {
            assert!(hand.rms[0] < 1e-3 && hand.rms[1] > 1e-2, "one channel's is cancelled: {:?}", hand.rms);
        }
        let plant = format!(
            "model = 'state-space'\n[structure]\nA = {A:?}\nB = [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [2.3, 0.2, 0.0, 1.0, 0.0, \
             0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0], [-0.1, 1.3, 0.0, 0.0, 0.0, 1.0]]\nC = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, \
             0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]"
        );
        let limits = if limit.is_finite() { "u_min = [-0.8, -0.8]\nu_max = [0.8, 0.8]" } else { "" };
        let controller = format!(
            "model = 'l1-sampled'\n[structure]\n{STRUCTURE}\nestimate = '{estimate}'\n[start]\nsample_time = {T:?}\n\
             nominal_input_gain = {W_0:?}\nfeedback_gain = {K:?}\npole_real = [-3.0, -4.0, -3.0, -4.0]\n{limits}"
        );
        let closed = Closed::new().described("plant", &plant, "").described("controller", &controller, "");
        let closed = closed.connected("plant.y", "controller.x", 4).connected("controller.u", "plant.u", 2);
        let mut run = closed.prepared(1e-10);
        (0..2).for_each(|i| run.set(&format!("controller.r[{}]", i + 1), r[i]));
        (0..4).for_each(|i| run.set(&format!("plant.u[{}]", i + 3), constant[i]));
        run.0.initialise().unwrap();
        same_controls(&mut run, T, &hand.controls, 1e-6);
    }
}
