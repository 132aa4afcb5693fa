//! Reports on a loop with the plant that a controller was designed for.
#![allow(non_snake_case)] // matrices have the names of the field

use adaptive_fmu::report::{Finding, Value};
use adaptive_fmu::system::{DesignReport, Verdict};
use common::described::model;

fn report(text: &str) -> DesignReport {
    model(&format!("name = 'C'\ndescription = ''\n{text}")).unwrap().report()
}

fn finding<'a>(report: &'a DesignReport, section: &str, name: &str) -> &'a Finding {
    let found = report.findings.iter().find(|finding| finding.section == section && finding.name == name);
    found.unwrap_or_else(|| panic!("{section}, {name}: {:?}", report.findings))
}

fn number(report: &DesignReport, section: &str, name: &str) -> f64 {
    match finding(report, section, name).value {
        Value::Number(value) => value,
        ref other => panic!("{name}: {other:?}"),
    }
}

fn range(report: &DesignReport, name: &str) -> Vec<f64> {
    match &finding(report, "Nominal loop", name).value {
        Value::Matrix(rows) => rows[0].clone(),
        other => panic!("{name}: {other:?}"),
    }
}

/// Control of x' = −x + u by gains, with further settings.
fn pid(gains: &str, nominal: &str) -> DesignReport {
    let plant = "[nominal]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]";
    report(&format!("model = 'pid'\n[structure]\nchannels = 1\n[start]\n{gains}\n{plant}\n{nominal}\n"))
}

/// y = (1 − e^(−2 t))/2 of a step, with u from 1 to 1/2.
#[test]
fn a_loop_without_an_integral_part_is_not_called_good() {
    let report = pid("K_p = [1.0]\nK_i = [0.0]", "reference = 4.0");
    assert_eq!(number(&report, "Nominal loop", "at rest"), 50.0);
    assert_eq!(finding(&report, "Nominal loop", "at rest").verdict, Verdict::Warning);
    assert!(report.summary.as_ref().unwrap().contains("ends 50 % from the reference"), "{:?}", report.summary);
    assert_eq!(range(&report, "range of u[1]"), [0.0, 4.0]);
    // ln(0.5/0.02)/2
    assert!((number(&report, "Nominal loop", "settling time") - 1.609).abs() < 0.05);
    let nothing = pid("K_p = [0.0]\nK_i = [0.0]", "");
    assert_eq!(number(&nothing, "Nominal loop", "at rest"), 100.0);
    assert_eq!(nothing.verdict(), Verdict::Warning);
}

/// With K_p = K_i the zero cancels the pole: y = 1 − e^(−K_p t), and u falls from K_p to 1.
#[test]
fn figures_are_those_of_the_closed_form() {
    let report = pid("K_p = [3.0]\nK_i = [3.0]\nb = [1.0]", "uncertainty = 0.2");
    let expected = [("rise time", 9.0_f64.ln() / 3.0), ("settling time", 50.0_f64.ln() / 3.0), ("overshoot", 0.0)];
    for (name, expected) in expected {
        let found = number(&report, "Nominal loop", name);
        assert!((found - expected).abs() <= 0.03 * expected + 1e-9, "{name}: {found} for {expected}");
    }
    assert_eq!(range(&report, "range of u[1]"), [0.0, 3.0]);
    assert_eq!(number(&report, "Margins", "maximum sensitivity M_s"), 1.0);
    assert!((number(&report, "Margins", "phase margin") - 90.0).abs() < 0.5);
    // π/2 at 3 rad/s.
    assert!((number(&report, "Margins", "delay margin") - std::f64::consts::FRAC_PI_6).abs() < 0.01);
    assert!((number(&report, "Margins", "bandwidth") - 3.0).abs() < 0.2);
    assert!(number(&report, "Uncertain plants", "settling time") > 50.0_f64.ln() / 3.0);
    assert!(report.summary.as_ref().unwrap().contains("worst of"), "{:?}", report.summary);
}

#[test]
fn a_loop_that_is_not_stable_is_not_sound() {
    let report = pid("K_p = [3.0]\nK_i = [1.0]\nS = [[-1.0]]", "uncertainty = 0.2");
    assert_eq!((report.verdict(), report.summary.as_deref()), (Verdict::NotSound, Some("the loop isn't stable")));
}

/// Rounding puts no control at the limit it moves away from. A message names the step that fits within limits.
#[test]
fn limits_on_one_side_are_limits() {
    let gains = "K_p = [3.0]\nK_i = [3.0]\nu_min = [0.0]";
    let report = pid(&format!("{gains}\nu_max = [3.5]"), "");
    assert_eq!(finding(&report, "Nominal loop", "range of u[1]").verdict, Verdict::Ok);
    let report = pid(&format!("{gains}\nu_max = [1.5]"), "");
    let beyond = finding(&report, "Nominal loop", "range of u[1]");
    assert!(
        beyond.verdict == Verdict::Warning && beyond.note.contains("A step of 0.497 stays within"),
        "{}",
        beyond.note
    );
}

/// Two channels that don't act on each other, whose references are of different sizes.
#[test]
fn each_control_is_that_of_its_reference() {
    let found = report(
        "model = 'pid'\n[structure]\nchannels = 2\n[start]\nK_p = [1.0, 1.0]\nK_i = [1.0, 1.0]\n[nominal]\nA = [[-1.0, 0.0], \
         [0.0, -1.0]]\nB = [[1.0, 0.0], [0.0, 1.0]]\nC = [[1.0, 0.0], [0.0, 1.0]]\nreference = [1.0, 100.0]\n",
    );
    let [one, other] = ["range of u[1]", "range of u[2]"].map(|name| range(&found, name)[1]);
    assert!((one - 1.0).abs() < 1e-9 && (other - 100.0).abs() < 1e-6, "{one}, {other}");
}

/// A change of a controller's plant in one place gives a message on the other.
#[test]
fn a_structure_with_another_plant_is_reported() {
    let law = |A: &str| {
        report(&format!(
            "model = 'l1-limit'\n[structure]\nA = {A}\nB = [[1.0]]\nC = [[1.0]]\nbaseline = 'outside'\n[start]\npole_real = \
             [-3.0]\npole_imag = [0.0]\nfeedback_gain = [[6.0]]\n[nominal]\nA = [[-1.0]]\nB = [[1.0]]\nC = [[1.0]]\n"
        ))
    };
    let differs = |found: &DesignReport| found.findings.iter().any(|finding| finding.name == "plant");
    assert!(!differs(&law("[[-1.0]]")));
    let found = law("[[-2.0]]");
    let note = &finding(&found, "Nominal loop", "plant").note;
    assert!(found.verdict() == Verdict::Warning && note.contains("[nominal]"), "{note}");
}

/// Numbers of any size end in a report, and in no panic.
#[test]
fn any_numbers_of_a_nominal_plant_are_reported_on() {
    let sizes = [0.0_f64, 1.0, -1.0, 1e-300, 1e300, -1e150, 1e12, -1e-9, 3.0];
    let mut state = 1_u64;
    let mut drawn = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        sizes[(state >> 33) as usize % sizes.len()]
    };
    for _ in 0..200 {
        let [a, b, c, d, e, f, g, h] = [(); 8].map(|()| drawn());
        let bandwidth = [1e-300, 1.0, 1e300][(a.abs() > 1.0) as usize + (b.abs() > 1.0) as usize];
        let nominal = format!(
            "[nominal]\nA = [[{a:e}, {b:e}], [{c:e}, {d:e}]]\nB = [[{e:e}], [{f:e}]]\nC = [[{g:e}, {h:e}]]\nuncertainty = 0.2\n\
             bandwidth = {bandwidth:e}\nreference = {:e}\n",
            if g.abs() > 1.0 { 1e-300 } else { 1.0 }
        );
        for law in [
            "model = 'pid'\n[structure]\nchannels = 1\n[start]\nK_p = [1.0]\nK_i = [2.0]\n",
            "model = 'ladrc'\n[structure]\nchannels = 1\norder = 2\n[start]\nomega_c = [2.0]\n",
            "model = 'l1-limit'\n[structure]\nA = [[0.0, 1.0], [-2.0, -3.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\n[start]\n\
             feedback_gain = [[6.0]]\n",
            "model = 'l1'\n[structure]\nA = [[0.0, 1.0], [-2.0, -3.0]]\nB = [[0.0], [1.0]]\nC = [[1.0, 0.0]]\nregressor = \
             'state'\ninput_gain = 'diagonal'\n[start]\nfeedback_gain = [[6.0]]\nomega_min = [0.8]\nomega_max = [1.2]\n",
        ] {
            let found = report(&format!("{law}{nominal}"));
            assert!(!found.findings.is_empty());
        }
    }
}
