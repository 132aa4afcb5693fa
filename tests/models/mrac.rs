//! Plain model reference adaptive control: against equations written anew, its loops, its samples, manual control, its bounds.
#![allow(non_snake_case)] // matrices have the names of the field

mod by_hand;

use adaptive_fmu::library::begin;
use adaptive_fmu::report::Value;
use adaptive_fmu::system::{DesignReport, Verdict};
use adaptive_fmu::template::{Plant, Request, Sizes};
use common::closed::{Closed, metrics, near};
use common::described::{model, refused};
use common::random::Random;
use common::{OK, Unit, description};

const NAME: &str = "MracNonlinearSiso";

fn text(start: &str) -> String {
    let own = start.lines().filter_map(|line| line.split('=').next()).map(str::trim).collect::<Vec<_>>();
    let whole = description(NAME);
    let whole = whole.lines().filter(|line| own.iter().all(|key| !line.starts_with(&format!("{key} ="))));
    format!("{}\n{start}", whole.collect::<Vec<_>>().join("\n"))
}

/// Example 3.2.1 with its cosine, by the method of Runge and Kutta: x, x_m, κ̂, θ̂, σ̂.
struct Example {
    gain: f64,
}

impl Example {
    fn rates(&self, t: f64, s: &[f64; 8]) -> ([f64; 8], f64) {
        let r = 2.0 * (0.2 * t).cos();
        // Bᵀ P of A_m' P + P A_m = −I.
        let driven = 0.5 * (s[0] - s[2]) + 5.0 / 7.0 * (s[1] - s[3]);
        let u = r - s[4] * r - s[5] * s[0] - s[6] * s[1] - s[7];
        let proj = |v: f64, y: f64, lo: f64, hi: f64| {
            let d = (v - 0.5 * (lo + hi)) / (0.5 * (hi - lo));
            let f = (1.1 * d * d - 1.0) / 0.1;
            self.gain * if f > 0.0 && d * y > 0.0 { y * (1.0 - f) } else { y }
        };
        let plant = (2.0 + 0.2 * t.sin()) * u + u.sin() * s[0].sin() + s[0] * s[0] + s[1] * s[1] + (0.5 * t).sin();
        let rates = [
            s[1],
            plant,
            s[3],
            -s[2] - 1.4 * s[3] + r,
            proj(s[4], driven * r, -1.0, 2.0 / 3.0),
            proj(s[5], driven * s[0], -10.0, 10.0),
            proj(s[6], driven * s[1], -10.0, 10.0),
            proj(s[7], driven, -10.0, 10.0),
        ];
        (rates, u)
    }

    /// rms of x1 − x_m1 from 5 s on, its largest magnitude, and that of u.
    fn metrics(&self, until: f64, h: f64) -> [f64; 3] {
        let (mut s, mut sum, mut count, mut most, mut control) = ([0.0; 8], 0.0, 0.0, 0.0_f64, 0.0_f64);
        for k in 0..=(until / h).round() as usize {
            let t = k as f64 * h;
            let (k1, u) = self.rates(t, &s);
            let e = s[0] - s[2];
            (most, control) = (most.max(e.abs()), control.max(u.abs()));
            if t >= 5.0 - 1e-9 {
                (sum, count) = (sum + e * e, count + 1.0);
            }
            let by = |k: &[f64; 8], h: f64| std::array::from_fn(|i| s[i] + h * k[i]);
            let k2 = self.rates(t + 0.5 * h, &by(&k1, 0.5 * h)).0;
            let k3 = self.rates(t + 0.5 * h, &by(&k2, 0.5 * h)).0;
            let k4 = self.rates(t + h, &by(&k3, h)).0;
            s = std::array::from_fn(|i| s[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        [f64::sqrt(sum / count), most, control]
    }
}

const COSINE: &str = "cosine_amplitude = [2.0]\ncosine_frequency = [0.2]";

#[test]
fn the_loop_of_example_3_2_1_is_that_of_its_equations() {
    // rms from 5 s on, largest error, largest control, and in parts of these.
    for (gain, known) in
        [(10.0, [0.02648, 0.1011, 2.784]), (100.0, [0.00275, 0.0082, 2.787]), (1000.0, [2.8e-4, 8e-4, 2.787])]
    {
        let closed =
            Closed::new().part("reference", "ReferenceNonlinearSiso", COSINE).part("plant", "NonlinearSiso", "");
        let closed = closed.part("controller", NAME, &format!("adaptation_gain = {gain:?}"));
        let closed = closed.connected("reference.r", "controller.r", 1).connected("plant.x", "controller.x", 2);
        let mut run = closed.connected("controller.u", "plant.u", 1).started(1e-9);
        let found = metrics(&mut run, &["controller.e[1]", "controller.u[1]"], [60.0, 5.0, 0.005]);
        let exact = Example { gain }.metrics(60.0, 1e-3);
        for (k, found) in [found[0].rms, found[0].max, found[1].max].into_iter().enumerate() {
            // The grid of 5 ms misses a little of a peak.
            near(&format!("gain {gain}, metric {k}"), found, exact[k], 2e-3);
            near(&format!("gain {gain}, known metric {k}"), found, known[k], 0.03);
        }
    }
}

/// Example 3.2.1 through separate units at 1 ms, the plant first; rms of e_1 from 5 s on, and the largest control.
fn separate(controller: &Unit, until: f64, step: f64, mut look: impl FnMut(&Unit)) -> [f64; 2] {
    let (reference, plant) = (Unit::new("ReferenceNonlinearSiso"), Unit::new("NonlinearSiso"));
    reference.put("cosine_amplitude[1]", 2.0);
    reference.put("cosine_frequency[1]", 0.2);
    let units = [&reference, &plant, controller];
    units.iter().for_each(|unit| unit.enter(0.0));
    let hand_over = || {
        controller.put("r[1]", reference.get("r[1]"));
        [1, 2].map(|i| format!("x[{i}]")).iter().for_each(|x| controller.put(x, plant.get(x)));
    };
    hand_over();
    plant.put("u[1]", controller.get("u[1]"));
    units.iter().for_each(|unit| assert_eq!(unit.exit(), OK, "{:?}", unit.messages()));
    let (mut sum, mut count, mut largest) = (0.0, 0.0, 0.0_f64);
    for k in 0..(until / step).round() as usize {
        let t = k as f64 * step;
        assert_eq!((reference.step(t, step), plant.step(t, step)), (OK, OK), "{:?}", plant.messages());
        hand_over();
        assert_eq!(controller.step(t, step), OK, "{:?}", controller.messages());
        plant.put("u[1]", controller.get("u[1]"));
        look(controller);
        largest = largest.max(controller.get("u[1]").abs());
        if t >= 5.0 {
            let e = controller.get("e[1]");
            (sum, count) = (sum + e * e, count + 1.0);
        }
    }
    [f64::sqrt(sum / count), largest]
}

#[test]
fn sampled_it_follows_the_same_model_and_warns_of_steps_that_are_too_long() {
    let warnings =
        |unit: &Unit| unit.messages().into_iter().filter(|(_, category, _)| category == "logStepTooLong").count();
    for (gain, flagged) in [(10.0, false), (100.0, false), (1000.0, true)] {
        let unit = Unit::from_text(&text(&format!("adaptation_gain = {gain:?}")));
        let mut ever = false;
        let [rms, largest] = separate(&unit, 20.0, 1e-3, |unit| ever |= unit.get_boolean("step_too_long"));
        let exact = Example { gain }.metrics(20.0, 1e-3);
        // The sampled law takes x as constant for a sample: half of what x_m moves in it.
        assert!((rms - exact[0]).abs() < 2e-4, "{gain}: {rms}, {}", exact[0]);
        near("largest control", largest, exact[2], 0.01);
        // Half of the tolerated dead time is 1.1 ms at 25 rad/s, and 0.11 ms at 80 rad/s.
        assert_eq!((ever, warnings(&unit)), (flagged, usize::from(flagged)), "{gain}");
    }
}

#[test]
fn the_estimates_stay_within_their_bounds_at_any_step() {
    let bounds = "theta_bound = [[0.3, 0.2]]\nsigma_bound = [0.1]\nomega_max = [1.2]\nadaptation_gain = 1e6";
    for step in [1e-4, 0.05, 10.0] {
        let unit = Unit::from_text(&text(bounds));
        let mut random = Random::new(4);
        unit.start(0.0);
        let within = |name: &str, lo: f64, hi: f64| {
            let value = unit.get(name);
            assert!((lo..=hi).contains(&value), "{name} = {value} at steps of {step}");
        };
        let mut most = 0;
        for k in 0..100 {
            for name in ["x[1]", "x[2]", "r[1]"] {
                unit.put(name, 3.0 * random.next());
            }
            assert_eq!(unit.step(f64::from(k) * step, step), OK, "{:?}", unit.messages());
            within("kappa_hat[1,1]", -1.0, 1.0 - 1.0 / 1.2);
            within("theta_hat[1,1]", -0.3, 0.3);
            within("theta_hat[1,2]", -0.2, 0.2);
            within("sigma_hat[1]", -0.1, 0.1);
            most = most.max(unit.get_integer("projection_active"));
        }
        let messages = unit.messages().into_iter().filter(|(_, category, text)| {
            category == "logProjection" && text.contains("theta_bound") && text.contains("omega_max")
        });
        assert!(most >= 3 && messages.count() == 1, "{most} at steps of {step}");
    }
}

#[test]
fn the_robot_follows_as_simulated_and_asks_for_large_torques_at_the_start() {
    let closed = Closed::new().part("reference", "ReferenceTwoLinkRobot", "").part("plant", "TwoLinkRobot", "");
    let closed = closed.part("controller", "MracTwoLinkRobot", "").connected("reference.r", "controller.r", 2);
    let closed = closed.connected("plant.x", "controller.x", 4).connected("controller.u", "plant.u", 2);
    let signals = [
        "reference.r[1] -plant.y[1]",
        "reference.r[2] -plant.y[2]",
        "controller.e[1]",
        "controller.e[2]",
        "controller.u[1]",
        "controller.u[2]",
    ];
    let found = metrics(&mut closed.started(1e-8), &signals, [20.0, 5.0, 1e-3]);
    for (found, known) in found.iter().zip([0.02382, 0.01598, 0.01428, 0.00458]) {
        near("rms", found.rms, known, 5e-3);
    }
    near("torque 1", found[4].max, 489.0, 0.01);
    near("torque 2", found[5].max, 960.0, 0.01);
}

#[test]
fn enabling_makes_no_jump_and_manual_control_leaves_the_estimates_alone() {
    for law in ["automatic", "continuous"] {
        let unit = Unit::from_text(&text(&format!("law = '{law}'\nu_max = [8.0]")));
        unit.enter(0.0);
        assert_eq!(unit.set_boolean("enabled", false), OK);
        for (name, value) in [("x[1]", 0.4), ("x[2]", -0.3), ("r[1]", 1.0), ("u_manual[1]", 2.5)] {
            unit.put(name, value);
        }
        assert_eq!(unit.exit(), OK, "{:?}", unit.messages());
        assert_eq!(unit.get("u[1]"), 2.5);
        for k in 0..20 {
            unit.put("u_manual[1]", 2.5 + 0.1 * f64::from(k));
            assert_eq!(unit.step(f64::from(k) * 1e-3, 1e-3), OK, "{:?}", unit.messages());
            assert_eq!(unit.get("u[1]"), 2.5 + 0.1 * f64::from(k));
        }
        assert_eq!([unit.get("theta_hat[1,1]"), unit.get("kappa_hat[1,1]"), unit.get("sigma_hat[1]")], [0.0; 3]);
        assert!(
            (unit.get("x_m[1]") - 0.4).abs() < 1e-3 && (unit.get("x_m[2]") + 0.3).abs() < 1e-3,
            "it follows the state"
        );
        unit.put("x[1]", 0.6);
        assert_eq!(unit.set_boolean("enabled", true), OK);
        assert_eq!(unit.step(0.02, 1e-7), OK, "{:?}", unit.messages());
        assert!((unit.get("u[1]") - 4.4).abs() < 1e-3, "{law}: {}", unit.get("u[1]"));
        // K_g r − u_manual.
        assert!((unit.get("sigma_hat[1]") + 3.4).abs() < 1e-3 && (unit.get("x_m[1]") - 0.6).abs() < 1e-5, "{law}");
        // Beyond what its bound allows, the rest is a jump.
        assert_eq!((unit.set_boolean("enabled", false), unit.step(0.02 + 1e-7, 1e-4)), (OK, OK));
        unit.put("sigma_bound[1]", 1.0);
        assert_eq!((unit.set_boolean("enabled", true), unit.step(0.02 + 1.001e-4, 1e-7)), (OK, OK));
        assert!((unit.get("u[1]") - 2.0).abs() < 1e-2, "{law}: {}", unit.get("u[1]"));
    }
}

#[test]
fn what_contradicts_itself_is_refused_with_the_numbers() {
    refused(&text("omega_min = [1.5]"), &["omega_min[1] = 1.5", "at most 1"]);
    refused(&text("omega_max = [0.8]"), &["omega_max[1] = 0.8", "at least 1"]);
    refused(&text("A_m = [[0.0, 1.0], [1.0, -1.4]]"), &["A_m"]);
    refused(&text("leakage = -0.1"), &["leakage = -0.1"]);
    refused(&text("").replace("regressor = \"state\"", "unmatched = true"), &["unmatched", "L1"]);
    let unit = Unit::exchange_from_text(&text("law = 'sampled'"));
    unit.enter(0.0);
    assert_ne!(unit.exit(), OK);
    // By themselves, theta multiplies the state, and the input gain is estimated channel by channel.
    let usual = text("").replace("regressor = \"state\"\n", "").replace("input_gain = \"diagonal\"\n", "");
    assert!(model(&usual).unwrap().variables().find("theta_hat[1,2]").is_some());
}

/// A new controller for a plant of two channels: it is exported as it stands, its adaptation turns ten times as fast as the loop
/// is to be with usual signals, and its bounds hold the assumed uncertainty where projection doesn't act.
#[test]
fn a_new_controller_turns_ten_times_as_fast_as_asked_for_and_covers_the_uncertainty() {
    let plant = r#"{"A": [[0.0, 1.0, 0.0], [-2.0, -0.5, 0.3], [0.0, 0.2, -1.0]], "B": [[0.0, 0.0], [1.5, 0.1], [0.0, 2.0]], "C": [[1.0,
                   0.0, 0.0], [0.0, 0.0, 1.0]]}"#;
    let request = Request {
        kind: "mrac",
        name: "Mine",
        sizes: Sizes::NONE,
        plant: Some(Plant::parse(plant).unwrap()),
        bandwidth: Some(4.0),
        reference: &[2.0],
        uncertainty: Some(0.2),
        experiment: None,
    };
    let text = begin(&request).unwrap().text;
    let report = model(&text).unwrap().report();
    assert!(report.is_sound(), "{:?}", report.findings);
    let (frequency, verdict, _) = finding(&report, "frequency with references of 2, 2");
    assert!(verdict == Verdict::Ok && (8.0..=41.0).contains(&frequency), "{frequency}");
    let table: toml::Table = text.parse().unwrap();
    let list = |name: &str| {
        let list = table["start"][name].as_array().unwrap();
        list.iter().map(|value| value.as_float().unwrap()).collect::<Vec<_>>()
    };
    for (low, high) in list("omega_min").into_iter().zip(list("omega_max")) {
        let [low, high] = [low, high].map(|omega| 1.0 - 1.0 / omega);
        let (middle, inner) = (0.5 * (low + high), 0.5 * (high - low) / 1.1_f64.sqrt());
        // Of input gains of 0.8 and 1.2.
        assert!(middle - inner <= 1.0 - 1.0 / 0.8 + 2e-3 && middle + inner >= 1.0 - 1.0 / 1.2 - 2e-3, "{low}, {high}");
    }
    let step = table["experiment"]["step"].as_float().unwrap();
    assert!(step <= finding(&report, "longest step, plant stepped first").0, "{step}");
}

fn finding(report: &DesignReport, name: &str) -> (f64, Verdict, String) {
    let found = report.findings.iter().find(|finding| finding.name == name);
    let found = found.unwrap_or_else(|| panic!("`{name}` among {:?}", report.findings));
    let Value::Number(value) = found.value else { panic!("{found:?}") };
    (value, found.verdict, found.note.clone())
}

#[test]
fn check_reports_how_fast_the_adaptation_turns_and_what_that_tolerates() {
    let report = |start: &str| model(&text(start)).unwrap().report();
    let name = "frequency with references of 1";
    let usual = report("");
    // λ = 5/7; |u_b| = |x| = 1.
    near("at rest", finding(&usual, "frequency at rest").0, (500.0_f64 / 7.0).sqrt(), 1e-9);
    let (frequency, verdict, _) = finding(&usual, name);
    near("frequency", frequency, (1500.0_f64 / 7.0).sqrt(), 1e-9);
    assert_eq!(verdict, Verdict::Ok);
    near("dead time", finding(&usual, "tolerated dead time").0, 1.4 * 7.0 / 1500.0, 1e-9);
    near("step", finding(&usual, "longest step, plant stepped first").0, 0.2 / frequency, 1e-6);
    near("step", finding(&usual, "longest step").0, 0.7 * 7.0 / 1500.0, 1e-6);
    let fast = report("adaptation_gain = 1e4");
    let (_, verdict, note) = finding(&fast, name);
    assert_eq!(verdict, Verdict::Warning);
    let advised: f64 = note.split("adaptation_gain = ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    let at = |gain: f64| finding(&report(&format!("adaptation_gain = {gain:?}")), name).1;
    assert_eq!((at(advised), at(1.01 * advised)), (Verdict::Ok, Verdict::Warning), "{advised}");
    assert_eq!(finding(&report("adaptation_gain = 1e7"), "longest step").1, Verdict::Warning);
}
