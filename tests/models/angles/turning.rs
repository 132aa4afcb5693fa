//! Laws whose origin moves along: L1, its limit, its sampled form, and the observer.
#![allow(non_snake_case)] // matrices have the names of the thesis

use std::f64::consts::{FRAC_PI_4, PI};

use common::description;
use common::models::Run;
use common::random::Random;

use super::{head, made, refusal, wrapped};

const DEGREE: f64 = PI / 180.0;

/// Form in which the controller gets measurement and reference.
type Read = [fn(f64) -> f64; 2];

const READS: [Read; 4] =
    [[wrapped, wrapped], [|y| y - 8.0 * PI, |r| r], [wrapped, |r| r + 2.0 * PI], [|y| y + 4.0 * PI, wrapped]];

/// Motion of a quadrotor's yaw.
#[derive(Debug, Clone)]
struct Turned {
    /// Net way, degrees.
    travelled: f64,
    /// Largest error after 3 s, degrees.
    error: f64,
    /// Largest torque, N m.
    torque: f64,
    psi: Vec<f64>,
}

/// A quadrotor that hovers and turns about its vertical axis: I ψ'' = τ, with a zero-order hold of 1 ms, solved
/// exactly.
fn turned(seconds: f64, r: impl Fn(f64) -> f64, read: Read) -> Turned {
    let mut run = made(&format!("{}u_ad_start = 'bumpless'\n", description("L1Quadrotor")));
    let (start, h, inertia) = (170.0 * DEGREE, 1e-3, 8.81e-3);
    let (mut psi, mut rate) = (start, 0.0);
    let mut found = Turned { travelled: 0.0, error: 0.0, torque: 0.0, psi: Vec::new() };
    for k in 0..(seconds / h).round() as i32 {
        let t = f64::from(k) * h;
        run.set("x[9]", read[0](psi));
        run.set("x[12]", rate);
        run.set("r[4]", read[1](r(t)));
        if k == 0 {
            run.set("u_manual[1]", 0.5 * 9.81);
            run.0.initialise().unwrap();
        }
        run.step(h);
        let torque = run.get("u[4]");
        psi += h * (rate + 0.5 * h * torque / inertia);
        rate += h * torque / inertia;
        found.torque = found.torque.max(torque.abs());
        if t > 3.0 {
            found.error = found.error.max((r(t + h) - psi).abs() / DEGREE);
        }
        found.psi.push(psi);
    }
    found.travelled = (psi - start) / DEGREE;
    found
}

/// The same as a single FMU, without sampling in between, from this yaw in degrees and with a steadily moving
/// reference; without figures of the path.
fn turned_as_one(start: f64, [r, speed]: [f64; 2], seconds: f64) -> (Turned, f64) {
    let law: toml::Table = description("L1Quadrotor").parse().unwrap();
    let mut of_law = law["start"].as_table().unwrap().clone();
    of_law.insert("u_ad_start".to_owned(), "bumpless".into());
    let connections: Vec<String> = (1..=12)
        .map(|i| format!("['plant.x[{i}]', 'law.x[{i}]']"))
        .chain((1..=4).map(|i| format!("['law.u[{i}]', 'plant.u[{i}]']")))
        .collect();
    let psi = start * DEGREE;
    let mut run = made(&format!(
        "{}[structure]\nconnections = [{}]\n[[structure.parts]]\nname = 'plant'\nmodel = 'quadrotor'\n[structure.parts.start]\n\
         x0 = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, {psi:?}, 0.0, 0.0, 0.0]\n[[structure.parts]]\nname = 'law'\nmodel = 'l1-quadrotor'\n\
         structure = {}\nstart = {}\n[start]\ninput_handling = 'interpolate'\n",
        head("composite"),
        connections.join(", "),
        law["structure"],
        toml::Value::Table(of_law)
    ));
    let (h, mut found) = (1e-3, Turned { travelled: 0.0, error: 0.0, torque: 0.0, psi: Vec::new() });
    let of_time = |t: f64| (r + speed * t) * DEGREE;
    run.set("law.u_manual[1]", 0.5 * 9.81);
    run.set("law.r[4]", of_time(0.0));
    run.0.initialise().unwrap();
    for k in 0..(seconds / h).round() as i32 {
        let t = f64::from(k) * h;
        // Interpolated from the last one on.
        run.set("law.r[4]", of_time(if k == 0 { 0.0 } else { t + h }));
        run.step(h);
        found.torque = found.torque.max(run.get("law.u[4]").abs());
        if t > 3.0 {
            found.error = found.error.max((of_time(t + h) - run.get("plant.x[9]")).abs() / DEGREE);
        }
    }
    found.travelled = run.get("plant.x[9]") / DEGREE - start;
    (found, run.get("law.origin[1]") / DEGREE)
}

/// 2.9 and -2.9 rad are both within 3 rad, but the way from one to the other over the seam ends beyond: the origin starts there, and the
/// torque is that of the short way.
#[test]
fn an_origin_starts_at_a_reference_that_is_within_its_range_only_on_the_other_side_of_the_seam() {
    let mut run = made(&description("L1Quadrotor"));
    run.set("origin_range", 3.0);
    run.set("x[9]", 2.9);
    run.set("r[4]", -2.9);
    run.0.initialise().unwrap();
    assert!((run.get("origin[1]") - (2.0 * PI - 2.9)).abs() < 1e-12);
    run.step(1e-3);
    assert!(run.get("u[4]").abs() < 10.0, "{}", run.get("u[4]"));
}

/// Figures of an independent simulation of the continuous loop (Runge and Kutta's method at 2e-5, 1e-5 and 5e-6 s).
#[test]
fn a_quadrotor_turns_as_the_continuous_loop_does() {
    for (start, r, seconds, [travelled, error, torque], digits, origin) in [
        (170.0, [170.0, 10.0], 6.0, [59.2, 0.833, 0.0150], [0.05, 0.0006, 0.00006], 215.0),
        (170.0, [190.0, 0.0], 6.0, [20.0, 0.0, 0.930], [0.05, 1e-3, 0.0006], 170.0),
        (0.0, [0.0, 60.0], 20.0, [1195.0, 5.00, 0.0899], [0.6, 0.006, 0.0004], 1170.0),
    ] {
        let (found, ends_at) = turned_as_one(start, r, seconds);
        let values = [found.travelled, found.error, found.torque];
        for ((found, expected), digit) in values.into_iter().zip([travelled, error, torque]).zip(digits) {
            assert!((found - expected).abs() <= digit, "from {start} with {r:?}: {values:?}");
        }
        assert!((ends_at - origin).abs() < 50.0, "the origin has moved along: {ends_at}");
    }
}

/// Figures of the continuous loop, from which sampling every millisecond deviates by 1 %.
fn near(found: f64, expected: f64) -> bool {
    (found - expected).abs() <= 0.012 * expected
}

#[test]
fn a_quadrotor_follows_a_ramp_over_the_seam() {
    let ramp = |t: f64| (170.0 + 10.0 * t) * DEGREE;
    let found = turned(6.0, ramp, [wrapped, wrapped]);
    let Turned { travelled, error, torque, psi } = &found;
    assert!(near(*travelled, 59.17) && near(*error, 0.833) && near(*torque, 0.0150), "{travelled} {error} {torque}");
    for read in READS {
        let other = turned(6.0, ramp, read);
        let apart = psi.iter().zip(&other.psi).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-9, "{apart}");
    }
}

#[test]
fn a_quadrotor_goes_the_short_way_over_the_seam() {
    let step = |t: f64| if t < 1e-9 { 170.0 } else { 190.0 } * DEGREE;
    let Turned { travelled, torque, error, .. } = turned(6.0, step, [wrapped, wrapped]);
    assert!(near(travelled, 20.0) && error < 0.05 && near(torque, 0.930), "{travelled} {error} {torque}");
}

#[test]
fn a_quadrotor_turns_without_end() {
    let turn = |t: f64| (170.0 + 60.0 * t) * DEGREE;
    let Turned { travelled, error, torque, .. } = turned(20.0, turn, [wrapped, wrapped]);
    assert!(near(travelled, 1195.0) && near(error, 5.00) && near(torque, 0.0899), "{travelled} {error} {torque}");
}

/// A double integrator with an angle, in each kind of law; lines of its structure and its start.
fn law(kind: &str, structure: &str, start: &str) -> String {
    let of_estimates = "regressor = 'infinity_norm'\ninput_gain = 'diagonal'\n";
    format!(
        "{}[structure]\nA = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n{of_estimates}{structure}\n[structure.units]\n\
         r = ['rad']\nx = ['rad', 'rad/s']\nu = ['rad/s2']\n[start]\n{start}",
        head(kind)
    )
}

const L1: &str = "pole_real = [-4.0, -4.0]\npole_imag = [0.5, -0.5]\nadaptation_gain = 1e4\nfeedback_gain = [[15.0]]\nomega_min = [0.5]\n\
                  omega_max = [2.0]\ntheta_bound = [10.0]\nsigma_bound = [10.0]\n";

/// Every law that has origins, with filters of either sort.
fn laws() -> Vec<String> {
    let filter = "filter = { gain = 1.0, numerator = [[0.1, 1.0]], denominator = [[1.0, 0.0], [0.02, 1.0]] }";
    let mut laws = Vec::new();
    for baseline in ["baseline = 'outside'\nangles = [1]", "baseline = 'inside'\nangles = [1]"] {
        for filter in ["", filter] {
            let structure = format!("{baseline}\n{filter}");
            laws.push(law("l1", &structure, L1));
            laws.push(law("l1-limit", &structure, L1));
            let gain = if filter.is_empty() { "[15.0]" } else { "[[15.0]]" };
            let sampled = format!("sample_time = 0.002\npole_real = [-4.0, -4.0]\nfeedback_gain = {gain}\n");
            laws.push(law("l1-sampled", &structure, &sampled));
            laws.push(law("l1-sampled", &format!("{structure}\nestimate = 'published'"), &sampled));
        }
        laws.push(law("fuzzy-l1", baseline, L1));
    }
    laws
}

/// ψ'' = 1.2 u + 0.3 sin t under a law, in steps of 2 ms.
fn closed(text: &str, start: f64, seconds: f64, r: impl Fn(f64) -> f64, read: Read) -> Vec<[f64; 2]> {
    let (mut run, h) = (made(text), 2e-3);
    let (mut psi, mut rate, mut found) = (start, 0.0, Vec::new());
    for k in 0..(seconds / h).round() as i32 {
        let t = f64::from(k) * h;
        run.set("x[1]", read[0](psi));
        run.set("x[2]", rate);
        run.set("r[1]", read[1](r(t)));
        if k == 0 {
            run.0.initialise().unwrap();
        }
        run.step(h);
        let u = run.get("u[1]");
        let acceleration = 1.2 * u + 0.3 * t.sin();
        psi += h * (rate + 0.5 * h * acceleration);
        rate += h * acceleration;
        found.push([psi, u]);
    }
    found
}

#[test]
fn each_law_takes_wrapped_angles_for_unwrapped_ones_and_follows_them() {
    let turn = |t: f64| 3.0 + 1.5 * t + if t < 2.0 { 0.0 } else { 1.0 };
    for text in laws() {
        let unwrapped = closed(&text, 3.0, 6.0, turn, [|y| y, |r| r]);
        let end = unwrapped[unwrapped.len() - 1][0];
        assert!((end - turn(6.0)).abs() < 2.5, "{end}: {text}");
        for read in READS {
            let found = closed(&text, 3.0, 6.0, turn, read);
            let apart = found.iter().zip(&unwrapped).map(|(a, b)| (a[0] - b[0]).abs()).fold(0.0, f64::max);
            let first = found.iter().zip(&unwrapped).position(|(a, b)| (a[0] - b[0]).abs() > 1e-8);
            assert!(apart < 1e-8, "{apart}, from step {first:?} on: {text}");
        }
    }
}

/// Without uncertainty, a controller about a moving origin equals one about 0, and the control doesn't jump.
#[test]
fn an_origin_that_moves_makes_no_jump() {
    let ramp = |t: f64| 0.7 + 0.2 * t;
    for text in laws() {
        let found = closed(&text, 0.7, 1.2, ramp, [|y| y, |r| r]);
        let stays = closed(&format!("{text}origin_range = 3.0\n"), 0.7, 1.2, ramp, [|y| y, |r| r]);
        let jumps = |found: &[[f64; 2]]| {
            found.windows(2).skip(100).map(|pair| (pair[1][1] - pair[0][1]).abs()).fold(0.0, f64::max)
        };
        let [moved, stayed] = [jumps(&found), jumps(&stays)];
        assert!(moved < 2.0 * stayed + 0.01, "{moved}, {stayed}: {text}");
    }
}

#[test]
fn the_origin_is_where_the_reference_was_when_it_was_far() {
    let mut run = made(&description("L1Quadrotor"));
    for (psi, r, origin) in [(0.3, 0.3, 0.0), (0.3, 1.0, 1.0), (3.0, -3.0, 2.0 * PI - 3.0)] {
        run.0.reset();
        run.set("x[9]", psi);
        run.set("r[4]", r);
        run.0.initialise().unwrap();
        assert!((run.get("origin[1]") - origin).abs() < 1e-12, "{}", run.get("origin[1]"));
        assert!((run.get("x_hat[3]") + run.get("origin[1]") - psi).abs() < 1e-12);
    }
    assert_eq!(run.get("origin_range"), FRAC_PI_4);
}

#[test]
fn saved_states_hold_the_origin() {
    let mut run = made(&law("l1", "baseline = 'outside'\nangles = [1]", L1));
    run.set("x[1]", 0.1);
    run.0.initialise().unwrap();
    run.step(0.01);
    let saved = run.0.block().clone();
    let mut ahead = |r: f64| {
        run.0.block_mut().copy_from(&saved);
        run.set("r[1]", r);
        run.step(0.01);
        (run.get("origin[1]"), run.get("u[1]").to_bits())
    };
    let (far, near) = (ahead(1.2), ahead(0.2));
    assert_eq!([far.0, near.0], [1.2, 0.0]);
    assert_eq!(ahead(1.2), far);
}

#[test]
fn angles_that_laws_can_not_have_are_refused() {
    for (text, parts) in [
        (law("l1", "baseline = 'outside'\nangles = [2]", L1), ["angles = 2", "unit rad"]),
        (law("l1", "baseline = 'outside'\nangles = [3]", L1), ["angles = 3", "must be within 1 … 2"]),
        (
            law("l1", "baseline = 'outside'\nangles = [1]", L1).replace("[[1.0, 0.0]]", "[[2.0, 0.0]]"),
            ["angles = 1", "one of the outputs"],
        ),
        (
            law("l1-limit", "baseline = 'outside'\nangles = [1]", "")
                .replace("[[0.0, 1.0], [0.0, 0.0]]", "[[0.0, 1.0], [-1.0, 0.0]]"),
            ["angles = 1", "column of zeros"],
        ),
        (
            description("L1Quadrotor").replace("[structure]\n", "[structure]\nangles = [1]\n"),
            ["angles = 1", "must be [3]"],
        ),
    ] {
        let reason = match std::panic::catch_unwind(|| refusal(&text)) {
            Ok(reason) => reason,
            Err(_) => panic!("accepted: {text}"),
        };
        assert!(parts.iter().all(|part| reason.contains(part)), "{reason}");
    }
}

fn observer(angles: &str) -> String {
    format!(
        "{}[structure]\nA = [[0.0, 1.0], [0.0, 0.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n{angles}\n[structure.units]\nx = ['rad', 'rad/s']\n\
         y = ['rad']\nu = ['rad/s2']\n[start]\nobserver_pole_real = [-20.0, -30.0]\nGamma_l = 10.0\nrelative_tolerance = 1e-9\n",
        head("observer")
    )
}

/// Three turns: β_l stays what it is near 0, and the estimate is that of unwrapped angles.
#[test]
fn an_observer_follows_an_angle_over_many_turns() {
    let follow = |read: fn(f64) -> f64, start: f64| {
        let mut run = made(&format!("{}x_obs0 = [{start:?}, 2.0]\n", observer("angles = [1]")));
        let (mut most, mut estimates) = (0.0, Vec::new());
        for k in 0..5000 {
            let t = f64::from(k) * 2e-3;
            run.set("y[1]", read(start + 2.0 * t + 0.2 * t.sin()));
            if k == 0 {
                run.0.initialise().unwrap();
            }
            run.step(2e-3);
            most = f64::max(most, run.get("beta_l"));
            estimates.push(run.get("x_obs[1]") - start);
        }
        (most, estimates)
    };
    let (most, estimates) = follow(|y| y, 0.0);
    assert!(most < 10.0, "{most}");
    let end = 2.0 * 10.0 + 0.2 * 10_f64.sin();
    assert!((estimates[estimates.len() - 1] - end).abs() < 0.05);
    for (read, start) in [(wrapped as fn(f64) -> f64, 0.0), (|y| y + 6.0 * PI, 0.0)] {
        let (also, found) = follow(read, start);
        let apart = found.iter().zip(&estimates).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(apart < 1e-6 && (also - most).abs() < 1e-6, "{apart} {also}");
    }
}

/// ỹ and β_l at random points, from their formulas.
#[test]
fn an_observers_error_is_the_short_way() {
    let mut random = Random::new(9);
    for _ in 0..100 {
        let (start, away) = (0.7 * random.next(), 3.0 * random.next());
        let mut run = made(&format!("{}x_obs0 = [{start:?}, 0.5]\n", observer("angles = [1]")));
        run.set("y[1]", wrapped(start - away) + 4.0 * PI);
        run.0.initialise().unwrap();
        run.0.hand_over_integration();
        run.0.initialise().unwrap();
        assert!((run.get("y_tilde[1]") - away).abs() < 1e-12);
        let y = start - away;
        let expected = 1.0 + y.powi(4) * (1.0 + start * start + 0.25) + 2.0;
        assert!((run.get("beta_l") - expected).abs() < 1e-9 * expected, "{} {expected}", run.get("beta_l"));
    }
}

/// An origin moves in model exchange as an event, which the master is asked for.
#[test]
fn in_model_exchange_the_origin_moves_in_event_mode() {
    let mut run: Run = made(&law("l1", "baseline = 'outside'\nangles = [1]", L1));
    run.0.initialise().unwrap();
    run.0.hand_over_integration();
    run.0.initialise().unwrap();
    run.0.begin_model_exchange().unwrap();
    run.0.end_event();
    run.0.set_time(0.01);
    run.set("r[1]", 1.0);
    let before = run.get("origin[1]");
    assert!(run.0.complete_step().unwrap(), "an event is asked for");
    run.0.evaluate();
    let u = run.get("u[1]");
    assert_eq!([before, run.get("origin[1]")], [0.0, 0.0]);
    run.0.begin_event();
    let update = run.0.update_discrete().unwrap();
    assert!(update.changed && update.states_changed);
    run.0.end_event();
    assert_eq!(run.get("origin[1]"), 1.0);
    assert!((run.get("u[1]") - u).abs() < 1e-9 * (1.0 + u.abs()));
}
