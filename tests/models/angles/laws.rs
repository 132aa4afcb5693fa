//! Laws that know an output: PID, disturbance rejection, funnels.
#![allow(non_snake_case)] // gains have the names of the field

use std::f64::consts::PI;

use common::models::Run;
use common::random::Random;

use super::{head, made, refusal, wrapped};

const DEGREE: f64 = PI / 180.0;

/// Form in which the controller gets measurement and reference.
type Read = fn(f64) -> f64;

/// A double integrator under a controller, stepped exactly: ψ and u at each communication point.
fn closed(
    mut run: Run,
    [psi, h]: [f64; 2],
    steps: i32,
    of_time: impl Fn(f64) -> [f64; 2],
    read: [Read; 2],
) -> Vec<[f64; 2]> {
    let (mut psi, mut rate, mut found) = (psi, 0.0, Vec::new());
    for k in 0..steps {
        let [r, noise] = of_time(f64::from(k) * h);
        run.set("y[1]", read[0](psi + noise));
        run.set("r[1]", read[1](r));
        if k == 0 {
            run.0.initialise().unwrap();
        }
        run.step(h);
        let u = run.get("u[1]");
        psi += h * (rate + 0.5 * h * u);
        rate += h * u;
        found.push([psi, u]);
    }
    found
}

fn pid(c: f64, angles: &str) -> String {
    format!(
        "{}[structure]\nchannels = 1\n{angles}\nunits = {{ y = ['rad'], u = ['rad/s2'] }}\n[start]\nK_p = [64.0]\nK_i = [1.0]\nK_d = [15.0]\n\
         N = [100.0]\nc = [{c:.1}]\nintegration_method = 'fixed'\nfixed_steps = 20\n",
        head("pid")
    )
}

fn ladrc(angles: &str) -> String {
    format!(
        "{}[structure]\nchannels = 1\norder = 2\n{angles}\nunits = {{ y = ['rad'], u = ['rad/s2'] }}\n[start]\nomega_c = [8.0]\n\
         omega_o = [80.0]\nB_0 = [[1.0]]\nintegration_method = 'fixed'\nfixed_steps = 20\n",
        head("ladrc")
    )
}

fn funnel(angles: &str, start: &str) -> String {
    format!(
        "{}[structure]\nchannels = 1\nrelative_degree = 2\n{angles}\nunits = {{ y = ['rad'], u = ['rad/s2'] }}\n[start]\n{start}",
        head("funnel")
    )
}

const KEY: &str = "angles = [1]";

/// A named reference with noise of the measurement, by time.
type Experiment = (&'static str, fn(f64) -> [f64; 2]);

const EXPERIMENTS: [Experiment; 4] = [
    ("ramp", |t| [(179.0 + 30.0 * t) * DEGREE, 0.0]),
    ("step over the seam", |t| [if t < 0.5 { 179.0 } else { 199.0 } * DEGREE, 0.0]),
    ("turning", |t| [(179.0 + 360.0 * t) * DEGREE, 0.0]),
    // Not random, but as rough, and the same in each run.
    ("held at the seam", |t| [PI, DEGREE * ((t * 1000.0).round() * 12.9898).sin() * 1.4]),
];

const READS: [[Read; 2]; 3] = [[wrapped, wrapped], [wrapped, |r| r], [|y| y + 6.0 * PI, wrapped]];

fn most(a: &[[f64; 2]], b: &[[f64; 2]], element: usize) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a[element] - b[element]).abs()).fold(0.0, f64::max)
}

#[test]
fn wrapped_angles_are_the_same_to_pid_and_disturbance_rejection_as_unwrapped_ones() {
    for (name, of_time) in EXPERIMENTS {
        for text in [pid(0.0, KEY), pid(1.0, KEY), ladrc(KEY)] {
            let run = |read| closed(made(&text), [179.0 * DEGREE, 1e-3], 3000, of_time, read);
            let unwrapped = run([|y| y, |r| r]);
            for read in READS {
                let found = run(read);
                let [of_psi, of_u] = [0, 1].map(|element| most(&found, &unwrapped, element));
                assert!(of_psi < 1e-12 && of_u < 1e-9, "{name}: {of_psi} {of_u}: {text}");
            }
        }
    }
}

#[test]
fn without_the_key_a_wrapped_angle_goes_the_long_way() {
    for text in [pid(0.0, ""), pid(1.0, ""), ladrc("")] {
        let found = closed(made(&text), [179.0 * DEGREE, 1e-3], 3000, EXPERIMENTS[1].1, [wrapped, wrapped]);
        let travelled: f64 = found.windows(2).map(|pair| (pair[1][0] - pair[0][0]).abs()).sum();
        assert!(travelled > 300.0 * DEGREE, "{travelled}");
    }
}

/// Random gains, starts and references that jump, in loops that are stable.
#[test]
fn random_loops_take_wrapped_angles_for_unwrapped_ones() {
    let mut random = Random::new(11);
    for _ in 0..30 {
        let (w, N, start) = (2.0 + 6.0 * random.next().abs(), 60.0 + 40.0 * random.next(), 20.0 * random.next());
        let (size, K_i) = (2.8 * random.next(), random.next().abs());
        let gains = format!("K_p = [{:?}]\nK_i = [{K_i:?}]\nK_d = [{:?}]\nN = [{N:?}]\n", w * w, 1.8 * w);
        let c = f64::from(random.next() > 0.0);
        let pid = format!(
            "{}[structure]\nchannels = 1\n{KEY}\nunits = {{ y = ['rad'] }}\n[start]\n{gains}c = [{c:.1}]\nintegration_method = 'fixed'\nfixed_steps = 20",
            head("pid")
        );
        let ladrc = ladrc(KEY).replace("[8.0]", &format!("[{w:?}]")).replace("[80.0]", &format!("[{N:?}]"));
        for text in [pid, ladrc] {
            let of_time = |t: f64| [start + if t < 0.3 { 0.0 } else { size } + 0.7 * t, 0.0];
            let run = |read| closed(made(&text), [start, 1e-3], 1500, of_time, read);
            let unwrapped = run([|y| y, |r| r]);
            for read in READS {
                let found = run(read);
                let [of_psi, of_u] = [0, 1].map(|element| most(&found, &unwrapped, element));
                assert!(of_psi < 1e-11 && of_u < 1e-8, "{of_psi} {of_u}: {text}");
            }
        }
    }
}

#[test]
fn an_integral_of_an_angle_that_stays_at_the_seam_is_right() {
    let found = closed(made(&pid(1.0, KEY)), [PI, 1e-3], 3000, EXPERIMENTS[3].1, [wrapped, wrapped]);
    assert!(found.iter().all(|[psi, _]| (psi - PI).abs() < 2.0 * DEGREE));
}

#[test]
fn weights_of_an_angles_reference_are_refused() {
    let with = |lines: &str| refusal(&format!("{}{lines}", pid(1.0, KEY).replace("c = [1.0]\n", "")));
    let of_b = with("b = [0.5]");
    assert!(of_b.contains("b[1] = 0.5") && of_b.contains("must be 1"), "{of_b}");
    let of_c = with("c = [0.3]");
    assert!(of_c.contains("c[1] = 0.3") && of_c.contains("must be 0 or 1"), "{of_c}");
    for text in [pid(1.0, "angles = [2]"), ladrc("angles = [0]"), funnel("angles = [2]", "")] {
        let reason = refusal(&text);
        assert!(reason.contains("angles") && reason.contains("must be within 1 … 1"), "{reason}");
    }
    let metres = pid(1.0, KEY).replace("['rad']", "['m']");
    let reason = refusal(&metres);
    assert!(reason.contains("angles = 1") && reason.contains("rad") && reason.contains("`m`"), "{reason}");
}

#[test]
fn a_funnel_of_an_angle_is_the_same_for_angles_that_differ_by_turns_and_narrower_than_half_a_turn() {
    let start =
        "psi_0 = [1.5]\npsi_inf = [0.2]\ntau = [0.1]\ng = [8.0]\nintegration_method = 'fixed'\nfixed_steps = 20\n";
    let values = |psi: f64, rate: f64, r: f64| {
        let mut run = made(&funnel(KEY, start));
        for (name, value) in [("y[1]", psi), ("dy[1]", rate), ("r[1]", r), ("dr[1]", 0.1)] {
            run.set(name, value);
        }
        run.0.initialise().unwrap();
        run.step(0.05);
        [run.get("e[1]"), run.get("u[1]")]
    };
    let mut random = Random::new(5);
    for _ in 0..100 {
        let (psi, rate, e) = (30.0 * random.next(), 0.5 * random.next(), 0.6 * random.next());
        let expected = values(psi, rate, psi - e);
        assert!((expected[0] - e).abs() < 1e-12);
        for found in [values(wrapped(psi), rate, psi - e), values(wrapped(psi), rate, wrapped(psi - e))] {
            assert!((found[0] - expected[0]).abs() < 1e-12 && (found[1] - expected[1]).abs() < 1e-8, "{found:?}");
        }
    }
    let reason = refusal(&funnel(KEY, "psi_0 = [3.2]"));
    assert!(reason.contains("psi_0[1] = 3.2") && reason.contains("must be below 3.14"), "{reason}");
    assert!(made(&funnel("", "psi_0 = [3.2]")).0.initialise().is_ok());
}

#[test]
fn a_funnel_of_an_angle_re_opens_below_half_a_turn_only() {
    let start = "psi_0 = [1.0]\npsi_inf = [0.2]\ntau = [0.1]\non_funnel_exit = 'reopen'\n";
    for (error, reopens) in [(1.5, true), (2.0, false)] {
        let mut run = made(&funnel(KEY, start));
        run.0.initialise().unwrap();
        run.step(0.01);
        run.set("y[1]", error);
        if reopens {
            run.step(0.01);
            assert!(run.get("psi[1]") >= 1.25 * error * 0.99 && run.get("psi[1]") < PI);
        } else {
            let message = run.failure(0.01).to_string();
            assert!(message.contains("psi[1] = 3.90625") && message.contains("must be below 3.14"), "{message}");
        }
    }
}
