//! The sampled L1 controller: its equations written out, on loops of the thesis, as a single FMU and as separate ones.
#![allow(non_snake_case)] // matrices have the names of the thesis

mod by_hand;
mod examples;
mod general;
mod general_design;

use adaptive_fmu::report::Value;
use adaptive_fmu::system::{DesignReport, Verdict};
use common::closed::{Closed, near};
use common::described::{model, refused};
use common::models::Run;
use common::{OK, Unit, description};

const ROBOT: &str = "L1SampledTwoLinkRobot";
const SISO: &str = "L1SampledNonlinearSiso";
/// The robot's inertia at q = 0, which is the inverse of the nominal input gain.
const M_0: [[f64; 2]; 2] = [[2.981, 1.121], [1.121, 0.921]];

type Pair = [f64; 2];

/// M v
fn times(M: [Pair; 2], v: Pair) -> Pair {
    M.map(|row| row[0] * v[0] + row[1] * v[1])
}

fn inverse([[a, b], [c, d]]: [Pair; 2]) -> [Pair; 2] {
    let determinant = a * d - b * c;
    [[d / determinant, -b / determinant], [-c / determinant, a / determinant]]
}

/// The robot of SPEC: q'' of q, q' and the torques.
fn robot(x: [f64; 4], u: Pair) -> [f64; 4] {
    let [q1, q2, w1, w2] = x;
    let (m1, l1, I1, k1, m2, l2, I2, k2, g) = (3.2, 0.5, 0.96, 1.0, 2.0, 0.4, 0.841, 1.0, 9.81);
    let M11 = I1 + I2 + m1 * l1 * l1 / 4.0 + m2 * (l1 * l1 + l2 * l2 / 4.0 + l1 * l2 * q2.cos());
    let (M12, M22) = (I2 + m2 * (l2 * l2 / 4.0 + l1 * l2 * q2.cos() / 2.0), I2 + m2 * l2 * l2 / 4.0);
    let c = m2 * l1 * l2 * q2.sin() / 2.0;
    let G1 = m1 * g * l1 * q1.cos() / 2.0 + m2 * g * (l1 * q1.cos() + l2 * (q1 + q2).cos() / 2.0);
    let G2 = m2 * g * l2 * (q1 + q2).cos() / 2.0;
    let torque = [u[0] - ((-c * w2 + k1) * w1 - c * (w1 + w2) * w2) - G1, u[1] - (c * w1 * w1 + k2 * w2) - G2];
    let [a1, a2] = times(inverse([[M11, M12], [M12, M22]]), torque);
    [w1, w2, a1, a2]
}

/// The robot's law, each joint a double integrator, with d samples of dead time; equations written out.
struct Hand {
    T: f64,
    /// Gains of the angle and of the rate, a joint each.
    gains: [Pair; 2],
    limit: f64,
    zeta: Pair,
    x_before: Option<[f64; 4]>,
    /// The control that acted last, and those that are under way.
    acted: Pair,
    queue: Vec<Pair>,
    d: usize,
}

impl Hand {
    fn new(T: f64, d: usize, limit: f64) -> Self {
        // z² − s z + p with the poles e^(p T): a double integrator with a zero-order hold has A = [1 T; 0 1], B =
        // [T²/2; T].
        let gains = [-30.0_f64, -40.0].map(|re| {
            let (size, angle) = ((re * T).exp(), 0.5 * T);
            let (s, p) = (2.0 * size * angle.cos(), size * size);
            [(1.0 - s + p) / (T * T), (3.0 - s - p) / (2.0 * T)]
        });
        Hand { T, gains, limit, zeta: [0.0; 2], x_before: None, acted: [0.0; 2], queue: vec![[0.0; 2]; d], d }
    }

    /// A double integrator of each joint over a sample time.
    fn nominal(&self, x: [f64; 4], u: Pair) -> [f64; 4] {
        let (T, v) = (self.T, times(inverse(M_0), u));
        [x[0] + T * x[2] + 0.5 * T * T * v[0], x[1] + T * x[3] + 0.5 * T * T * v[1], x[2] + T * v[0], x[3] + T * v[1]]
    }

    /// The control that begins to act now, from what is measured and asked for now.
    fn sample(&mut self, x: [f64; 4], r: Pair, dr: Pair) -> Pair {
        let lacked: [f64; 4] = self.x_before.map_or([0.0; 4], |before| {
            let moved = self.nominal(before, self.acted);
            std::array::from_fn(|i| x[i] - moved[i])
        });
        self.x_before = Some(x);
        let left = (-30.0 * self.T).exp();
        let ahead = self.d as f64 * self.T;
        for i in 0..2 {
            // W_0 σ̂_1 is what moved the rate; the rest of what lacked no control reaches.
            let wanted = self.gains[i][0] * (r[i] + ahead * dr[i]) - lacked[2 + i] / self.T;
            self.zeta[i] = left * self.zeta[i] + (1.0 - left) * wanted;
        }
        let x_p = self.queue.iter().fold(x, |x, &u| {
            let moved = self.nominal(x, u);
            std::array::from_fn(|i| moved[i] + lacked[i])
        });
        let v: Pair = std::array::from_fn(|i| self.zeta[i] - self.gains[i][0] * x_p[i] - self.gains[i][1] * x_p[2 + i]);
        self.queue.push(times(M_0, v).map(|u| u.clamp(-self.limit, self.limit)));
        self.acted = self.queue.remove(0);
        self.acted
    }
}

fn reference(t: f64) -> (Pair, Pair) {
    ([0.5 * (0.7 * t).cos(), -0.6 * (0.65 * t).cos()], [-0.35 * (0.7 * t).sin(), 0.39 * (0.65 * t).sin()])
}

/// Results of a loop of the robot: the states at the samples, the controls from then on.
struct Ran {
    states: Vec<[f64; 4]>,
    controls: Vec<Pair>,
    rms: Pair,
    largest: Pair,
}

/// The robot with the controller, by the classical Runge–Kutta method in steps of 0.5 ms; rms from 5 s on.
fn by_hand(T: f64, d: usize, limit: f64, until: f64) -> Ran {
    let mut law = Hand::new(T, d, limit);
    let (mut x, mut ran) =
        ([0.0; 4], Ran { states: Vec::new(), controls: Vec::new(), rms: [0.0; 2], largest: [0.0; 2] });
    let (steps, mut count) = ((T / 5e-4).round() as usize, 0.0);
    let h = T / steps as f64;
    let along = |x: [f64; 4], k: [f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * k[i]);
    for k in 0..(until / T).round() as usize {
        let (r, dr) = reference(k as f64 * T);
        let u = law.sample(x, r, dr);
        ran.states.push(x);
        ran.controls.push(u);
        (0..2).for_each(|i| ran.largest[i] = ran.largest[i].max(u[i].abs()));
        for s in 0..steps {
            let k1 = robot(x, u);
            let k2 = robot(along(x, k1, 0.5 * h), u);
            let k3 = robot(along(x, k2, 0.5 * h), u);
            let k4 = robot(along(x, k3, h), u);
            x = std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
            let t = k as f64 * T + (s + 1) as f64 * h;
            if t >= 5.0 {
                let (r, _) = reference(t);
                (0..2).for_each(|i| ran.rms[i] += (r[i] - x[i]).powi(2));
                count += 1.0;
            }
        }
    }
    ran.rms = ran.rms.map(|sum| (sum / f64::max(count, 1.0)).sqrt());
    ran
}

fn at(T: f64, d: usize) -> String {
    format!("sample_time = {T:?}\ndelay_steps = {d}")
}

/// The robot's loop as a single FMU.
fn whole(start: &str) -> Run {
    let closed = Closed::new().part("reference", "ReferenceTwoLinkRobot", "").part("plant", "TwoLinkRobot", "");
    let closed = closed.part("controller", ROBOT, start);
    let closed = closed.connected("reference.r", "controller.r", 2).connected("reference.dr", "controller.dr", 2);
    closed.connected("plant.x", "controller.x", 4).connected("controller.u", "plant.u", 2).started(1e-9)
}

/// The equations written out give the figures that they were derived with.
#[test]
fn the_equations_written_out_follow_the_reference_as_they_are_known_to() {
    for (T, d, rms, largest) in [
        (1e-3, 0, [0.02486, 0.02263], [149.0, 55.0]),
        (5e-3, 0, [0.02491, 0.02269], [149.0, 55.0]),
        (2e-2, 0, [0.02560, 0.02360], [146.0, 60.0]),
        (5e-3, 1, [0.02491, 0.02269], [151.0, 54.0]),
        (2e-2, 1, [0.02561, 0.02360], [167.0, 60.0]),
        (2e-2, 2, [0.02561, 0.02360], [191.0, 60.0]),
    ] {
        let ran = by_hand(T, d, f64::INFINITY, 20.0);
        for i in 0..2 {
            assert!((ran.rms[i] - rms[i]).abs() < 2.5e-5, "T = {T}, d = {d}: {:?}", ran.rms);
            assert!((ran.largest[i] - largest[i]).abs() < 0.6, "T = {T}, d = {d}: {:?}", ran.largest);
        }
    }
}

#[test]
fn the_loop_as_a_composite_is_that_of_the_equations_written_out() {
    for (T, limit) in [(5e-3, f64::INFINITY), (2e-2, f64::INFINITY), (5e-3, 60.0)] {
        let (hand, mut start) = (by_hand(T, 0, limit, 3.0), at(T, 0));
        if limit.is_finite() {
            start += &format!("\nu_min = [-{limit:?}, -{limit:?}]\nu_max = [{limit:?}, {limit:?}]");
        }
        let mut run = whole(&start);
        for (k, u) in hand.controls.iter().enumerate() {
            // In the middle of the intervals, where nothing jumps.
            run.step(if k == 0 { 0.5 * T } else { T });
            for i in 0..2 {
                let found = run.get(&format!("controller.u[{}]", i + 1));
                assert!((found - u[i]).abs() < 2e-4 * (1.0 + u[i].abs()), "T = {T}, {k}: {found}, {u:?}");
            }
        }
    }
}

/// Steps separate FMUs simultaneously, each with the others' previous outputs; returns the robot's states and controls.
fn jacobi(T: f64, d: usize, until: f64) -> Ran {
    let text = format!("{}\n", description(ROBOT)).replace("sample_time = 0.005", &at(T, d));
    let [reference, plant] = ["ReferenceTwoLinkRobot", "TwoLinkRobot"].map(Unit::new);
    let controller = Unit::from_text(&text);
    let units = [&reference, &plant, &controller];
    units.iter().for_each(|unit| unit.start(0.0));
    let mut ran = Ran { states: Vec::new(), controls: Vec::new(), rms: [0.0; 2], largest: [0.0; 2] };
    let pair = |unit: &Unit, name: &str| [1, 2].map(|i| unit.get(&format!("{name}[{i}]")));
    for k in 0..(until / T).round() as usize {
        for i in 1..=2 {
            for name in ["r", "dr"] {
                controller.put(&format!("{name}[{i}]"), reference.get(&format!("{name}[{i}]")));
            }
            plant.put(&format!("u[{i}]"), controller.get(&format!("u[{i}]")));
        }
        (1..=4).for_each(|i| controller.put(&format!("x[{i}]"), plant.get(&format!("x[{i}]"))));
        ran.states.push([1, 2, 3, 4].map(|i| plant.get(&format!("x[{i}]"))));
        ran.controls.push(pair(&controller, "u"));
        for unit in units {
            assert_eq!(unit.step(k as f64 * T, T), OK, "{:?}", unit.messages());
        }
    }
    assert!(controller.messages().is_empty(), "{:?}", controller.messages());
    ran
}

#[test]
fn separate_units_that_are_stepped_at_once_are_the_law_with_a_sample_of_dead_time() {
    for T in [5e-3, 1e-2, 2e-2] {
        let (hand, found) = (by_hand(T, 1, f64::INFINITY, 2.0), jacobi(T, 1, 2.0));
        for (k, (one, other)) in hand.states.iter().zip(&found.states).enumerate() {
            let off = (0..4).map(|i| (one[i] - other[i]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-4, "T = {T}, sample {k}: {one:?}, {other:?}");
        }
        for (k, (one, other)) in hand.controls.iter().zip(&found.controls).enumerate() {
            let off = (0..2).map(|i| (one[i] - other[i]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-2, "T = {T}, sample {k}: {one:?}, {other:?}");
        }
    }
}

/// Example 3.2.1: rms of r − y from 5 s on.
#[test]
fn the_published_estimate_follows_the_reference_of_example_3_2_1() {
    for (T, rms, estimate) in [(5e-3, 0.42190, "published"), (1e-2, 0.42173, "published"), (1e-2, 0.42128, "exact")] {
        let text = description(SISO).replace("\"published\"", &format!("{estimate:?}"));
        let closed = Closed::new().part("reference", "ReferenceNonlinearSiso", "").part("plant", "NonlinearSiso", "");
        let closed = closed.described("controller", &text, &at(T, 0)).connected("plant.x", "controller.x", 2);
        let closed = closed.connected("reference.r", "controller.r", 1).connected("controller.u", "plant.u", 1);
        let mut run = closed.started(1e-8);
        let (mut sum, mut count, mut largest) = (0.0, 0.0, 0.0_f64);
        for k in 1..=6000 {
            run.step(0.01);
            largest = largest.max(run.get("controller.u[1]").abs());
            if k >= 500 {
                sum += (run.get("reference.r[1]") - run.get("plant.y[1]")).powi(2);
                count += 1.0;
            }
        }
        near("rms", f64::sqrt(sum / count), rms, 2e-4);
        near("max |u|", largest, 2.76, 3e-3);
    }
}

#[test]
fn a_take_over_makes_no_jump_and_a_hand_over_takes_effect_at_once() {
    let unit = Unit::new(ROBOT);
    unit.enter(0.0);
    unit.put("u_manual[1]", 12.0);
    unit.put("u_manual[2]", -3.0);
    assert_eq!(unit.set_boolean("enabled", false), OK);
    unit.put("r[1]", 0.4);
    assert_eq!(unit.exit(), OK);
    let controls = |unit: &Unit| [unit.get("u[1]"), unit.get("u[2]")];
    assert_eq!(controls(&unit), [12.0, -3.0]);
    let mut t = 0.0;
    let mut step = |length: f64| {
        assert_eq!(unit.step(t, length), OK, "{:?}", unit.messages());
        t += length;
    };
    for k in 0..10 {
        unit.put("u_manual[1]", 12.0 + f64::from(k));
        unit.put("x[1]", 0.01 * f64::from(k));
        step(0.005);
        assert_eq!(controls(&unit)[0], 12.0 + f64::from(k));
    }
    // Between two samples the control stays; at the next one the controller starts from it.
    assert_eq!(unit.set_boolean("enabled", true), OK);
    step(0.002);
    assert_eq!(controls(&unit), [21.0, -3.0]);
    step(0.003);
    assert!((unit.get("u[1]") - 21.0).abs() < 1e-9 && (unit.get("u[2]") + 3.0).abs() < 1e-9, "{:?}", controls(&unit));
    step(0.005);
    assert!((unit.get("u[1]") - 21.0).abs() > 0.1, "and then it acts");
    assert_eq!(unit.set_boolean("enabled", false), OK);
    step(1e-6);
    assert_eq!(controls(&unit), [21.0, -3.0]);
}

/// The robot's nominal plant, a double integrator of each joint behind the nominal input gain, with the unit stepped after it
/// in fifths of a sample; `between` acts in between, with the count of such steps. Returns u, and the largest |σ̂|, after each.
fn nominally(enabled: bool, steps: usize, between: &dyn Fn(&Unit, usize)) -> Vec<(Pair, f64)> {
    let (unit, h) = (Unit::new(ROBOT), 1e-3);
    unit.enter(0.0);
    assert_eq!(unit.set_boolean("enabled", enabled), OK);
    [("r[1]", 0.4), ("r[2]", -0.3)].into_iter().for_each(|(name, r)| unit.put(name, r));
    assert_eq!(unit.exit(), OK);
    let (mut x, mut found) = ([0.0_f64; 4], Vec::new());
    for k in 0..steps {
        between(&unit, k);
        let u = [unit.get("u[1]"), unit.get("u[2]")];
        let v = times(inverse(M_0), u);
        (0..2).for_each(|i| x[i] += h * x[2 + i] + 0.5 * h * h * v[i]);
        (0..2).for_each(|i| x[2 + i] += h * v[i]);
        // What is set before the first step would be of the start.
        (0..4).filter(|_| k > 0).for_each(|i| unit.put(&format!("x[{}]", i + 1), x[i]));
        assert_eq!(unit.step(k as f64 * h, h), OK, "{:?}", unit.messages());
        let sigma = ["sigma_hat[1]", "sigma_hat[2]", "sigma_hat_unmatched[1]", "sigma_hat_unmatched[2]"];
        let largest = sigma.iter().map(|name| unit.get(name).abs()).fold(0.0, f64::max);
        found.push(([unit.get("u[1]"), unit.get("u[2]")], largest));
    }
    found
}

#[test]
fn a_limit_that_is_changed_between_two_samples_counts_from_the_next_one_on_and_makes_no_wrong_estimate() {
    let limit =
        |unit: &Unit, size: f64| [("u_min[1]", -size), ("u_max[1]", size)].iter().for_each(|(n, u)| unit.put(n, *u));
    let found = nominally(true, 60, &|unit, k| match k {
        12 => limit(unit, 20.0),
        33 => limit(unit, 5.0),
        46 => limit(unit, 1e3),
        _ => (),
    });
    for (k, (u, sigma)) in found.iter().enumerate() {
        assert!(*sigma < 1e-6, "nothing is unknown: {sigma} after {k} ms");
        assert!((k + 1) % 5 == 0 || k == 0 || *u == found[k - 1].0, "u is constant in an interval: {u:?} after {k} ms");
    }
    assert!(found[13].0[0].abs() > 20.0 && found[14].0[0].abs() == 20.0, "{:?}", &found[12..16]);
    assert!(found[33].0[0].abs() > 5.0 && found[34].0[0].abs() == 5.0, "{:?}", &found[32..36]);
    assert!(found[48].0[0].abs() == 5.0 && found[49].0[0].abs() > 5.0, "{:?}", &found[46..51]);
}

#[test]
fn a_limit_that_is_tightened_while_the_law_waits_to_take_over_counts_at_its_sample() {
    let found = nominally(false, 20, &|unit, k| match k {
        0 => unit.put("u_manual[1]", 12.0),
        6 => assert_eq!(unit.set_boolean("enabled", true), OK),
        7 => unit.put("u_max[1]", 4.0),
        _ => (),
    });
    assert_eq!(
        [found[5].0[0], found[6].0[0], found[7].0[0], found[8].0[0], found[9].0[0]],
        [12.0, 12.0, 12.0, 12.0, 4.0]
    );
    assert!(found[10..].iter().all(|(u, sigma)| u[0] <= 4.0 && *sigma < 1e-6), "{found:?}");
}

#[test]
fn the_start_is_a_sample_that_takes_the_reference_where_nothing_is_late() {
    for (d, share) in [(0, 1.0 - (-30.0_f64 * 0.005).exp()), (1, 0.0)] {
        let unit = Unit::from_text(&description(ROBOT).replace("sample_time = 0.005", &at(0.005, d)));
        unit.enter(0.0);
        unit.put("r[1]", 0.4);
        assert_eq!(unit.exit(), OK);
        let asked = times(M_0, [share * Hand::new(0.005, d, f64::INFINITY).gains[0][0] * 0.4, 0.0]);
        for (i, asked) in asked.into_iter().enumerate() {
            near(&format!("u_ad[{}], d = {d}", i + 1), unit.get(&format!("u_ad[{}]", i + 1)), asked, 1e-9);
        }
    }
}

#[test]
fn a_bumpless_start_begins_with_the_manual_control() {
    for d in [0, 1] {
        let start = format!("{}\nu_ad_start = \"bumpless\"", at(0.005, d));
        let text = description(ROBOT).replace("sample_time = 0.005", &start);
        let unit = Unit::from_text(&text);
        unit.enter(0.0);
        unit.put("u_manual[1]", 7.0);
        unit.put("x[1]", 0.5);
        assert_eq!(unit.exit(), OK);
        assert_eq!([unit.get("u[1]"), unit.get("u[2]")], [7.0, 0.0]);
    }
}

#[test]
fn a_step_that_is_longer_than_the_sample_time_is_reported() {
    let unit = Unit::new(ROBOT);
    unit.start(0.0);
    assert_eq!(unit.step(0.0, 0.005), OK);
    assert!(unit.messages().is_empty());
    assert_eq!(unit.step(0.005, 0.02), OK);
    let messages = unit.messages().iter().map(|(_, _, text)| text.as_str()).collect::<String>();
    assert!(messages.contains("longer than the sample time") && messages.contains("sample_time"), "{messages}");
}

fn report(text: &str) -> DesignReport {
    model(text).unwrap().report()
}

fn number(report: &DesignReport, name: &str) -> f64 {
    let found = report.findings.iter().find(|finding| finding.name.starts_with(name));
    match found.unwrap_or_else(|| panic!("{name}: {:?}", report.findings)).value {
        Value::Number(value) => value,
        ref other => panic!("{name}: {other:?}"),
    }
}

/// The loop at 10 ms with a sample of dead time tolerates nominal input gains 0.7 to 2 times the right one, not 0.5 or
/// 3.
#[test]
fn the_report_has_the_input_gains_and_dead_times_that_the_loop_tolerates() {
    let text = description(ROBOT).replace("sample_time = 0.005", &at(0.01, 1)).replace("step = 0.005", "step = 0.01");
    let found = report(&text);
    assert!(found.findings.iter().all(|finding| finding.verdict != Verdict::NotSound), "{:?}", found.findings);
    let (least, largest) = (number(&found, "least input gain"), number(&found, "largest input gain"));
    assert!(1.0 / 3.0 < least && least < 0.5 && 1.0 / 0.7 < largest && largest < 2.0, "{least} … {largest}");
    assert!((number(&found, "dead time") - 0.01).abs() < 1e-12);
    let margin = number(&found, "delay margin");
    assert!(margin > 0.0 && margin < 0.02, "{margin}");
    // The poles of the nominal loop are those that were placed, and that of the filter.
    let slowest = (-30.0_f64 * 0.01).exp();
    assert!((number(&found, "largest magnitude of the poles") - slowest).abs() < 1e-4);
    // A longer step than the sample time.
    let long = report(&text.replace("step = 0.01", "step = 0.02"));
    assert!(long.findings.iter().any(|finding| finding.verdict == Verdict::NotSound && finding.name == "default step"));
}

#[test]
fn what_this_law_has_no_use_for_is_refused_with_the_reason() {
    let text = description(ROBOT);
    let with = |line: &str| text.replace("baseline = \"inside\"", &format!("baseline = \"inside\"\n{line}"));
    refused(&with("commands = \"acceleration\""), &["commands", "nominal_input_gain"]);
    refused(&text.replace("sample_time = 0.005", "sample_time = 10.0"), &["sample_time", "at most"]);
    let singular = "nominal_input_gain = [[1.0, 1.0], [1.0, 1.0]]\nu_min = [-1.0, -1.0]";
    let start = text.find("nominal_input_gain").unwrap();
    let end = start + text[start..].find('\n').unwrap();
    refused(&text.replace(&text[start..end], singular), &["nominal_input_gain", "direction of its own"]);
    // Start values of what belongs to adaptation may stay.
    assert!(model(&format!("{text}adaptation_gain = 1e5\nomega_min = [0.5, 0.5]\n")).is_ok());
}

/// The gain of the sampled plant gives a state the decay of the desired dynamics within a sample, as far as it can.
#[test]
fn desired_dynamics_may_be_given_as_a_matrix() {
    let text = "name = 'S'\nmodel = 'l1-sampled'\ndescription = ''\n[structure]\nA = [[0.0, 1.0], [-2.0, -0.3]]\nB = [[0.0], [1.0]]\n\
                C = [[1.0, 0.0]]\nbaseline = 'outside'\n";
    let start = "sample_time = 0.01\nfeedback_gain = [10.0]\ndelay_steps = 0\n";
    let poles = format!("{text}[start]\n{start}pole_real = [-3.0, -3.0]\npole_imag = [4.0, -4.0]\n");
    let matrix = format!("{text}desired_dynamics = 'matrix'\n[start]\n{start}A_m = [[0.0, 1.0], [-25.0, -6.0]]\n");
    let largest = |text: &str| {
        let report = model(text).unwrap().report();
        let found = report.findings.iter().find(|finding| finding.name == "largest magnitude of the poles").unwrap();
        match found.value {
            Value::Number(value) => value,
            ref other => panic!("{other:?}"),
        }
    };
    let (poles, matrix) = (largest(&poles), largest(&matrix));
    assert!(matrix < 1.0 && (poles - matrix).abs() < 1e-3, "{poles}, {matrix}");
}
