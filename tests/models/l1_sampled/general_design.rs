//! The sampled controller with any filter, and with unmatched uncertainty: its report, takeovers, and refusals.
#![allow(non_snake_case)] // matrices have the names of the thesis

use super::by_hand::flow;
use super::examples::unmatched_law;
use super::{number, report};
use adaptive_fmu::system::Verdict;
use common::closed::near;
use common::described::{model, refused};
use common::{OK, Unit, description};

const UNMATCHED: &str = "L1SampledUnmatchedMimo";

/// The description of 3.4.1 with these sample times.
fn unmatched(T: f64, d: usize) -> String {
    description(UNMATCHED).replace("sample_time = 0.01", &format!("sample_time = {T:?}\ndelay_steps = {d}"))
}

/// The nominal plant of 3.4.1 with so many times the input gain, and so many samples more of dead time: its size in the end, in
/// parts of that in the middle.
fn growth(T: f64, d: usize, gain: f64, late: usize) -> f64 {
    let mut law = unmatched_law(T, d);
    let mut under_way = vec![vec![0.0; 2]; late];
    let (mut x, mut middle) = (vec![1.0, -0.5, 0.3], 0.0);
    let samples = (60.0 / T).round() as usize;
    law.begin(&x);
    let mut largest: f64 = 0.0;
    for k in 0..samples {
        // A reference for a second moves what a nominal plant would leave at rest.
        let r = if (k as f64) * T < 1.0 { [1.0, -0.5] } else { [0.0; 2] };
        under_way.push(law.sample(&x, &r, &[0.0; 2]));
        let u = under_way.remove(0);
        let rates = |_: f64, x: &[f64]| vec![-x[0] + gain * u[0], x[2], -x[1] - 1.8 * x[2] + gain * (u[0] + u[1])];
        x = flow(&x, 0.0, T, 4, &rates);
        largest = x.iter().fold(largest, |largest, x| largest.max(x.abs()));
        if k == samples / 2 {
            (middle, largest) = (largest, 0.0);
        }
        // The largest of the last tenth, against that of the tenth before the middle.
        if k + 1 == samples / 2 - samples / 10 || k + 1 == samples - samples / 10 {
            largest = 0.0;
        }
    }
    largest / middle
}

/// Within the margins of the report the loop of the equations written out decays, beyond them it grows.
#[test]
fn the_report_has_the_input_gains_and_dead_times_that_the_general_form_tolerates() {
    for (T, d) in [(0.01, 0), (0.02, 1)] {
        let found = report(&unmatched(T, d).replace("step = 0.01", &format!("step = {T:?}")));
        assert!(found.findings.iter().all(|finding| finding.verdict != Verdict::NotSound), "{:?}", found.findings);
        let largest = number(&found, "largest input gain");
        assert!(growth(T, d, 0.97 * largest, 0) < 1.0 && growth(T, d, 1.03 * largest, 0) > 1.0, "{T}: {largest}");
        let margin = number(&found, "delay margin");
        let samples = (margin / T).floor() as usize;
        assert!(growth(T, d, 1.0, samples) < 1.0 && growth(T, d, 1.0, samples + 1) > 1.0, "{T}: {margin}");
    }
}

/// The nominal loop has the poles of the desired dynamics and of the filter's loop.
#[test]
fn the_poles_in_the_report_are_those_of_the_plant_and_of_the_filter() {
    let found = report(&unmatched(0.01, 0));
    // s = −0.9 ± 0.4359j of the desired dynamics is the slowest, then s = −1.
    near("largest magnitude", number(&found, "largest magnitude of the poles"), (-0.9_f64 * 0.01).exp(), 1e-9);
    let poles = found.findings.iter().find(|finding| finding.name == "poles of C(s)").unwrap();
    let text = format!("{:?}", poles.value);
    // 8 D(s) + 1 = 0: s (s/25 + 1)(s/70 + 1)(s²/1600 + 1.8 s/40 + 1) = −8
    let D = |s: [f64; 2]| {
        let times = |a: [f64; 2], b: [f64; 2]| [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]];
        let square = times(s, s);
        let last = [square[0] / 1600.0 + 0.045 * s[0] + 1.0, square[1] / 1600.0 + 0.045 * s[1]];
        let first = times(s, [s[0] / 25.0 + 1.0, s[1] / 25.0]);
        times(times(first, [s[0] / 70.0 + 1.0, s[1] / 70.0]), last)
    };
    let adaptive_fmu::report::Value::Eigenvalues(values) = &poles.value else { panic!("{text}") };
    for value in values {
        let [re, im] = D([value.real, value.imaginary]);
        assert!((re + 8.0).abs() < 1e-6 && im.abs() < 1e-6, "{value:?}: {re}, {im}");
    }
}

/// A filter that is 1/s but for a factor, which the gain takes back.
#[test]
fn another_filter_of_the_same_law_gives_the_same_control() {
    let text = description("L1SampledTwoLinkRobot");
    let other = text
        .replace("baseline = \"inside\"", "baseline = \"inside\"\nfilter = { gain = 0.5 }")
        .replace("feedback_gain = [30.0, 30.0]", "feedback_gain = [[60.0, 0.0], [0.0, 60.0]]");
    let given = text.replace("baseline = \"inside\"", "baseline = \"inside\"\nfilter = { denominator = [[1.0, 0.0]] }");
    let units = [text, other, given].map(|text| Unit::from_text(&text));
    units.iter().for_each(|unit| unit.start(0.0));
    for k in 0..200 {
        let t = f64::from(k) * 0.005;
        for unit in &units {
            unit.put("r[1]", (3.0 * t).sin());
            unit.put("x[2]", 0.1 * (5.0 * t).cos());
            unit.put("x[4]", -0.5 * (5.0 * t).sin());
            assert_eq!(unit.step(t, 0.005), OK);
        }
        for i in 1..=2 {
            let [known, same, exact] = units.each_ref().map(|unit| unit.get(&format!("u[{i}]")));
            assert!((known - same).abs() < 1e-9 * (1.0 + known.abs()), "{k}: {known}, {same}");
            assert_eq!(known.to_bits(), exact.to_bits(), "1/s that is given is 1/s that isn't");
        }
    }
}

/// Case in which unmatched uncertainty enters the control immediately, as on the twin rotor.
#[test]
fn a_take_over_makes_no_jump_where_the_unmatched_part_shows_at_once() {
    let text = super::general::twin_text(0.01, 1);
    let unit = Unit::from_text(&text);
    unit.enter(0.0);
    unit.put("u_manual[1]", 0.7);
    unit.put("u_manual[2]", -0.2);
    assert_eq!(unit.set_boolean("enabled", false), OK);
    assert_eq!(unit.exit(), OK);
    let controls = |unit: &Unit| [unit.get("u[1]"), unit.get("u[2]")];
    let state = |t: f64| [0.1 * t, 0.1, 0.05 * t * t, 0.1 * t, 0.2, -0.1];
    let step = |t: f64| {
        state(t + 0.01).iter().enumerate().for_each(|(i, x)| unit.put(&format!("x[{}]", i + 1), *x));
        assert_eq!(unit.step(t, 0.01), OK, "{:?}", unit.messages());
    };
    for k in 0..20 {
        step(0.01 * f64::from(k));
        assert_eq!(controls(&unit), [0.7, -0.2]);
    }
    assert!(unit.get("sigma_hat_unmatched[1]").abs() > 0.01, "what is unmatched is found meanwhile");
    assert_eq!(unit.set_boolean("enabled", true), OK);
    step(0.2);
    assert!((unit.get("u[1]") - 0.7).abs() < 1e-12 && (unit.get("u[2]") + 0.2).abs() < 1e-12, "{:?}", controls(&unit));
    step(0.21);
    let [first, second] = controls(&unit);
    assert!((first - 0.7).abs() > 1e-3 && (second + 0.2).abs() > 1e-3, "and then it acts: {first}, {second}");
}

#[test]
fn a_description_that_cant_be_sampled_is_refused_with_the_reason() {
    let text = description(UNMATCHED);
    let filter = "denominator = [[1.0, 0.0], [0.04, 1.0], [0.014285714285714285, 1.0], [6.25e-4, 0.045, 1.0]]";
    let with = |line: &str| text.replace(filter, line);
    // What D(s) doesn't make proper: another chain of two between the direction and the output.
    let chain = text
        .replace(
            "A = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]",
            "A = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]]",
        )
        .replace("B = [[1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]", "B = [[0.0], [0.0], [1.0]]")
        .replace("C = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", "C = [[1.0, 0.0, 0.0]]")
        .replace("feedback_gain = [[8.0, 0.0], [0.0, 8.0]]", "feedback_gain = [[8.0]]");
    assert!(model(&chain).is_ok());
    refused(&chain.replace(filter, ""), &["D(s): relative degree", "at least 2"]);
    refused(&with("denominator = [[0.04, 1.0]]"), &["D(s)", "integrator"]);
    let A = "A = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, -1.8]]\n";
    refused(&text.replace(A, ""), &["A is missing", "unmatched"]);
    refused(&with("denominator = [[1.0, 0.0], [1e-9, 1.0]]"), &["sample_time", "at most", "filter"]);
    let gain = "feedback_gain = [[8.0, 0.0], [0.0, 8.0]]";
    let robot = description("L1SampledTwoLinkRobot")
        .replace("baseline = \"inside\"", "baseline = \"inside\"\nfilter = { gain = 0.5 }")
        .replace("feedback_gain = [30.0, 30.0]", "feedback_gain = [[-1e6, 0.0], [0.0, 30.0]]");
    refused(&robot, &["feedback_gain[1,1] = -1000000: must be smaller", "unstable"]);
    // The report describes a loop with an unstable filter if it has numbers, as for an L1 controller.
    let found = report(&text.replace(gain, "feedback_gain = [[80.0, 0.0], [0.0, 8.0]]"));
    let bad: Vec<_> = found.findings.iter().filter(|finding| finding.verdict == Verdict::NotSound).collect();
    assert!(bad.iter().any(|finding| finding.name == "poles of C(s)"), "{bad:?}");
    // The structure of an L1 controller is that of this law.
    let l1 = description("L1UnmatchedMimo");
    let start = l1.find("[start]").unwrap();
    let carried = l1[..start].replace("model = \"l1\"", "model = \"l1-sampled\"") + &l1[start..];
    assert!(model(&carried).is_ok(), "{:?}", model(&carried).err());
}
