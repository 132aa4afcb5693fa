//! Design reports of descriptions before an export, and their advice.

use std::f64::consts::PI;
use std::time::{Duration, Instant};

use adaptive_fmu::catalogue::Role;
use adaptive_fmu::library::find;
use adaptive_fmu::model::Model;
use adaptive_fmu::report::{Finding, Value};
use adaptive_fmu::system::*;
use common::described::model;
use common::loops::whole;
use common::{OK, Unit, description, description_names};

fn report(text: &str) -> DesignReport {
    model(text).unwrap().report()
}

fn finding<'a>(report: &'a DesignReport, name: &str) -> &'a Finding {
    let found = report.findings.iter().find(|finding| finding.name == name);
    found.unwrap_or_else(|| panic!("`{name}` among {:?}", report.findings))
}

fn number(report: &DesignReport, name: &str) -> f64 {
    match finding(report, name).value {
        Value::Number(value) => value,
        Value::Between { upper, .. } => upper,
        ref other => panic!("{name}: {other:?}"),
    }
}

/// True if λ < 1 proves the design for all of its bounds.
fn is_proved(report: &DesignReport) -> bool {
    report.is_sound() && finding(report, "lambda").verdict == Verdict::Ok
}

/// The number after these words of an advice.
fn advised(note: &str, words: &str) -> f64 {
    let after = note.split_once(words).unwrap_or_else(|| panic!("`{words}` in `{note}`")).1;
    let end = after.find([' ', ',', ';', ']', ')']).unwrap_or(after.len());
    after[..end].parse().unwrap_or_else(|_| panic!("a number in `{note}`"))
}

fn replaced(text: &str, old: &str, new: &str) -> String {
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

#[test]
fn more_gain_or_less_uncertainty_makes_example_3_2_1_sound_as_it_is_advised() {
    let text = description("L1NonlinearSiso");
    let first = report(&text);
    // It isn't proved, which is no reason against it.
    let lambda = finding(&first, "lambda");
    assert!(first.is_sound() && lambda.verdict == Verdict::Warning);
    let gain = 20.0 * advised(&lambda.note, "feedback_gain times ");
    let stronger = |gain: f64| report(&replaced(&text, "[[20.0]]", &format!("[[{gain}]]")));
    assert!(is_proved(&stronger(gain)) && number(&stronger(gain), "lambda") < 1.0);
    let margin = advised(&lambda.note, "delay margin ");
    assert!((number(&stronger(gain), "delay margin") / margin - 1.0).abs() < 1e-5, "{margin}");
    // No more than is needed.
    assert!(!is_proved(&stronger(0.95 * gain)));
    let bound = 10.0 * advised(&lambda.note, "theta_bound times ");
    let surer = |bound: f64| report(&replaced(&text, "theta_bound = [10.0]", &format!("theta_bound = [{bound}]")));
    assert!(is_proved(&surer(bound)) && !is_proved(&surer(1.05 * bound)));
}

#[test]
fn the_advice_for_several_channels_makes_them_sound() {
    for (name, gain) in [("L1Quadrotor", 30.0), ("L1MaresAuv", 30.0)] {
        let text = description(name);
        let note = finding(&report(&text), "lambda").note.clone();
        let stronger = gain * advised(&note, "feedback_gain times ");
        assert!(
            is_proved(&report(
                &text
                    .replace("30.0, ", &format!("{stronger}, "))
                    .replace(" 30.0]", &format!(" {stronger}]"))
                    .replace("[[30.0", &format!("[[{stronger}"))
                    .replace("[30.0", &format!("[{stronger}"))
            )),
            "{name}"
        );
        let bound = 100.0 * advised(&note, "theta_bound times ");
        let bounds: String =
            text.lines()
                .map(|line| {
                    if line.starts_with("theta_bound") {
                        line.replace("100.0", &bound.to_string())
                    } else {
                        line.into()
                    }
                })
                .collect::<Vec<_>>()
                .join("\n");
        assert!(is_proved(&report(&bounds)), "{name}");
    }
}

#[test]
fn an_input_gain_that_may_be_zero_needs_a_lower_bound() {
    // omega_min = 0 takes the control all effect.
    let text = description("L1ActuatedSisoObserved");
    let first = report(&text);
    assert_eq!(finding(&first, "largest real part of a pole of C(s)").verdict, Verdict::Warning);
    let lambda = finding(&first, "lambda");
    assert_eq!(lambda.value, Value::Text("infinite".into()));
    assert!(lambda.note.contains("No feedback_gain makes the loop stable"), "{}", lambda.note);
    let omega = advised(&lambda.note, "omega_min = [");
    let bound = 10.0 * advised(&lambda.note, "theta_bound times ");
    let narrower = replaced(&text, "omega_min = [0.0]", &format!("omega_min = [{omega}]"));
    assert!(!is_proved(&report(&narrower)));
    let narrower = replaced(&narrower, "theta_bound = [10.0]", &format!("theta_bound = [{bound}]"));
    assert!(is_proved(&report(&narrower)));
}

#[test]
fn a_filter_too_slow_for_its_gain_needs_a_smaller_one_first() {
    // The lags of example 3.4.1 let K omega = 8 · 3 rad/s oscillate.
    let text = description("L1UnmatchedMimo");
    let lambda = finding(&report(&text), "lambda").clone();
    assert!(lambda.note.contains("makes it stable"), "{}", lambda.note);
    let gain = 8.0 * advised(&lambda.note, "feedback_gain times ");
    let calmer = replaced(&text, "[[8.0, 0.0], [0.0, 8.0]]", &format!("[[{gain}, 0.0], [0.0, {gain}]]"));
    assert_eq!(finding(&report(&calmer), "largest real part of a pole of C(s)").verdict, Verdict::Ok);
    let factor = advised(&lambda.note, "theta_bound_unmatched times ");
    let sure =
        calmer.replace("[40.0", &format!("[{}", 40.0 * factor)).replace(" 40.0]", &format!(" {}]", 40.0 * factor));
    assert!(report(&sure).is_sound(), "{:?}", finding(&report(&sure), "lambda"));
}

#[test]
fn a_finer_prediction_costs_the_advised_adaptation_gain() {
    let text = description("L1NonlinearSiso");
    let first = report(&text);
    let bound = finding(&first, "bound on |x_hat - x|");
    let gain = advised(&bound.note, "adaptation_gain = ");
    let finer = report(&replaced(&text, "adaptation_gain = 1e5", &format!("adaptation_gain = {gain:?}")));
    let ratio = number(&first, "bound on |x_hat - x|") / number(&finer, "bound on |x_hat - x|");
    assert!((ratio - 10.0).abs() < 1e-9, "{ratio}");
    // At the price of an adaptation that is as many times faster.
    assert!((number(&finer, "omega_a at rest") / number(&first, "omega_a at rest") - 10.0).abs() < 1e-9);
}

#[test]
fn a_step_that_is_too_long_at_rest_and_the_one_that_is_advised() {
    let text = replaced(&description("L1NonlinearSiso"), "step = 0.001", "step = 0.05");
    let advice = finding(&report(&text), "longest step at rest").clone();
    assert_eq!(advice.verdict, Verdict::Warning);
    // As it is printed it passes, at gains where the nearest number of as many digits is above or below.
    for gain in ["1e5", "1.1e5", "1.2e5", "1.3e5", "1.4e5", "1.5e5", "1.6e5", "1.7e5"] {
        let text = replaced(&text, "adaptation_gain = 1e5", &format!("adaptation_gain = {gain}"));
        let advice = finding(&report(&text), "longest step at rest").clone();
        let shorter = replaced(&text, "step = 0.05", &format!("step = {}", advice.value.lines()[0]));
        assert_eq!(finding(&report(&shorter), "longest step at rest").verdict, Verdict::Ok, "{advice:?}");
    }
    let gain = advised(&advice.note, "adaptation_gain = ");
    let slower = replaced(&text, "adaptation_gain = 1e5", &format!("adaptation_gain = {gain}"));
    assert!((number(&report(&slower), "longest step at rest") / 0.05 - 1.0).abs() < 1e-5);
}

/// Swing of the control of example 3.2.1 in the seconds 2 to 4 and 8 to 10, with the nominal plant x' = A_m x + B u and
/// a delay at its input.
fn swings(delay: usize, step: f64) -> [f64; 2] {
    let controller = Unit::new("L1NonlinearSiso");
    controller.start(0.0);
    // Far from all bounds.
    controller.put("r[1]", 2e-3);
    let (mut x, mut sent) = ([0.0_f64; 2], vec![0.0; delay]);
    let rate = |[x1, x2]: [f64; 2], u: f64| [x2, -x1 - 1.4 * x2 + u];
    let mut found = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for k in 0..(10.0 / step) as usize {
        let t = k as f64 * step;
        let u = sent[sent.len() - delay];
        // The midpoint rule is exact enough for modes of 1 rad/s.
        let middle = rate(x, u).map(|dx| 0.5 * step * dx);
        let moved = rate([x[0] + middle[0], x[1] + middle[1]], u);
        x = [x[0] + step * moved[0], x[1] + step * moved[1]];
        controller.put("x[1]", x[0]);
        controller.put("x[2]", x[1]);
        assert_eq!(controller.step(t, step), OK, "{:?}", controller.messages());
        let u = controller.get("u[1]");
        sent.push(u);
        for (found, from) in found.iter_mut().zip([2.0, 8.0]) {
            if (from..from + 2.0).contains(&t) {
                *found = [found[0].min(u), found[1].max(u)];
            }
        }
    }
    found.map(|[low, high]| high - low)
}

#[test]
fn the_loop_is_stable_just_below_the_delay_margin_and_not_just_above() {
    let margin = number(&report(&description("L1NonlinearSiso")), "delay margin");
    assert!((margin - PI / 40.0).abs() < 1e-9, "{margin}");
    let step = 1e-3;
    let delay = |part: f64| (part * margin / step).round() as usize;
    let [early, late] = swings(delay(0.94), step);
    assert!(late < 0.2 * early, "below the margin swings die away: {early}, {late}");
    let [early, late] = swings(delay(1.06), step);
    assert!(late > 5.0 * early, "above it they grow: {early}, {late}");
}

#[test]
fn more_delay_than_sampling_leaves_is_warned_of() {
    let text = replaced(&description("L1NonlinearSiso"), "step = 0.001", "step = 0.06");
    assert_eq!(finding(&report(&text), "delay margin").verdict, Verdict::Warning);
}

#[test]
fn a_fuzzy_gain_is_judged_over_its_range() {
    let text = replaced(&description("FuzzyL1ActuatedSiso"), "omega_min = [0.0]", "omega_min = [0.5]");
    let all = report(&text);
    let lambdas: Vec<_> = all.findings.iter().filter(|finding| finding.name == "lambda").collect();
    let sections: Vec<_> = lambdas.iter().map(|finding| finding.section.as_str()).collect();
    let expected = ["constant K", "least fuzzy K", "largest fuzzy K"].map(|k| format!("L1-norm condition, {k}"));
    assert_eq!(sections, expected);
    let gains = all.findings.iter().filter(|finding| finding.name == "K").map(|finding| match &finding.value {
        Value::Matrix(rows) => rows[0][0],
        other => panic!("{other:?}"),
    });
    let [constant, least, largest] = gains.collect::<Vec<_>>().try_into().unwrap();
    // The centre of only `zero`, (VS_l + VS_l + S_l)/3, and of only `very large`, (VL_l + 2 VL_c)/3.
    assert_eq!(constant, 20.0);
    assert!((least - (0.25 + 0.25 + 0.9) / 3.0).abs() < 1e-12, "{least}");
    assert!((largest - (6.0 + 2.0 * 10.0) / 3.0).abs() < 1e-12, "{largest}");
}

#[test]
fn plants_and_references_have_nothing_to_report_and_controllers_have() {
    for name in description_names() {
        let unit = model(&description(&name)).unwrap();
        let role = find(&unit.description().model).unwrap().role;
        let (findings, is_controller) =
            (unit.report().findings.len(), matches!(role, Role::Controller | Role::Observer));
        assert_eq!(findings > 0, is_controller, "{name}");
    }
}

#[test]
fn a_composite_reports_on_its_parts_and_on_no_communication_step() {
    let [alone, inside] = [description("L1NonlinearSiso"), whole("3.2.1-cosine")].map(|text| report(&text));
    assert_eq!(inside.step, 0.0);
    assert!(inside.findings.iter().all(|finding| finding.section.starts_with("controller: ")));
    assert_eq!(number(&inside, "lambda"), number(&alone, "lambda"));
    assert!(inside.findings.iter().all(|finding| !finding.section.contains("Communication step")));
}

#[test]
fn an_observer_reports_its_poles() {
    let report = report(&description("ObserverActuatedSiso"));
    let Value::Eigenvalues(poles) = &finding(&report, "eigenvalues of A - k_l C").value else { panic!("{report:?}") };
    // s² + (8 + 64) s + 64
    for pole in poles {
        assert!((pole.real * pole.real + 72.0 * pole.real + 64.0).abs() < 1e-9 && pole.imaginary == 0.0, "{pole:?}");
    }
}

#[test]
fn explicit_mrac_reports_its_longest_step() {
    let text = description("MracPpfCoupledMimo");
    // psi'psi beta gamma_2 + alpha_bar/phi + K_epsilon = 12 · 1e5 + 1e3 + 0.1, over rho_inf.
    let rate = (12.0 * 1e5 + 1e3 + 0.1) / 0.05;
    let sampled = report(&text);
    assert!((number(&sampled, "s") / rate - 1.0).abs() < 1e-12);
    assert_eq!(sampled.verdict(), Verdict::Ok);
    let continuous = report(&replaced(&text, "rho_0 =", "law = \"continuous\"\nrho_0 ="));
    assert_eq!(finding(&continuous, "longest step of the continuous law").verdict, Verdict::Warning);
}

#[test]
fn a_reference_model_that_does_not_decay_is_no_sound_design() {
    let text = description("NeuroPpfCoupledMimo");
    assert!(report(&text).is_sound());
    let line = text.lines().find(|line| line.starts_with("A_m")).unwrap().to_owned();
    let diverging = replaced(&text, &line, "A_m = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]");
    assert_eq!(finding(&report(&diverging), "eigenvalues of A_m").verdict, Verdict::NotSound);
}

/// x' = −k x, which is to decay.
struct Decay(ScalarOf<Parameter>);

impl System for Decay {
    type Structure = NoStructure;
    const NAME: &'static str = "decay";
    const DOCUMENTATION: &'static str = "";
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Decay(d.parameter(scalar("k", "rate").start(1.0))))
    }
    fn outputs<S: Scalar>(&self, _: S, _: &Values<S>, _: &mut Signals<S>) {}
    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        let k = v[self.0];
        let verdict = if k > 0.0 { Verdict::Ok } else { Verdict::NotSound };
        report.judge("k", k, "1/s", verdict, "k above 0 would do");
    }
}

#[test]
fn an_own_model_reports_what_it_finds_in_its_start_values() {
    let sound = |k: f64| {
        let start = format!("k = {k:?}").parse().unwrap();
        Model::new::<Decay>("Decay", &start).unwrap().report().is_sound()
    };
    assert!(sound(0.5) && !sound(-0.5));
}

/// A controller of n states in pairs, each pair with an input.
#[allow(non_snake_case)] // matrices have the names of the field
fn large(n: usize) -> String {
    let matrix = |rows: usize, columns: usize, entry: &dyn Fn(usize, usize) -> f64| {
        let row = |i| format!("[{}]", (0..columns).map(|j| format!("{:?}", entry(i, j))).collect::<Vec<_>>().join(","));
        format!("[{}]", (0..rows).map(row).collect::<Vec<_>>().join(","))
    };
    let is = |condition: bool| f64::from(u8::from(condition));
    let m = n / 2;
    let oscillator = |i: usize, j: usize| is(i + m == j) - is(i >= m && j + m == i) - 2.0 * is(i >= m && j == i);
    let [A, B, C] = [matrix(n, n, &oscillator), matrix(n, m, &|i, j| is(i == j + m)), matrix(m, n, &|i, j| is(i == j))];
    let [min, max] = ["0.5", "2.0"].map(|bound| vec![bound; m].join(","));
    format!(
        "name = 'Large'\nmodel = 'l1'\ndescription = ''\n[structure]\nA = {A}\nB = {B}\nC = {C}\n\
         regressor = 'infinity_norm'\ninput_gain = 'diagonal'\n[start]\nomega_min = [{min}]\nomega_max = [{max}]\n",
    )
}

#[test]
fn a_large_design_is_reported_in_time_with_what_the_report_leaves_out() {
    let model = model(&large(200)).unwrap();
    let begun = Instant::now();
    let report = model.report();
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    let condition = finding(&report, "L1-norm condition");
    assert!(condition.verdict == Verdict::NotSound && condition.note.contains("300"), "{condition:?}");
    assert!(number(&report, "bound on |x_hat - x|") >= 0.0);
}
