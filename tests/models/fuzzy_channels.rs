//! The fuzzy feedback gain of an L1 controller with several channels: its equations, refusals, and benefits on the
//! robot and on example 6.5.1.

mod by_hand;
mod worth;

use adaptive_fmu::execution::Execution;
use adaptive_fmu::report::Value;
use common::described::{model, refused};
use common::description;
use common::models::Run;

const ROBOT: &str = "FuzzyL1TwoLinkRobot";
const COUPLED: &str = "FuzzyL1CoupledMimo";

fn started(text: &str, inputs: &[(&str, f64)]) -> Run {
    let mut run = Run(Execution::new(model(text).unwrap()));
    inputs.iter().for_each(|(name, value)| run.set(name, *value));
    run.0.initialise().unwrap();
    run
}

fn has(text: &str, name: &str) -> bool {
    model(text).unwrap().variables().find(name).is_some()
}

/// A description with one text in it replaced.
fn with(name: &str, old: &str, new: &str) -> String {
    let text = description(name);
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

#[test]
fn each_channel_has_its_weights_its_sets_and_its_scale() {
    let begin = [("r[1]", 0.3), ("r[2]", 0.3), ("dr[1]", 1.0), ("dr[2]", 1.0)];
    let k = |start: &str| {
        let run = started(&format!("{}\n{start}", description(ROBOT)), &begin);
        [1, 2].map(|i| [run.get(&format!("k_f[{i}]")), run.get(&format!("gain_in_force[{i},{i}]"))])
    };
    let as_it_is = k("");
    // The same error, the same rate, the same numbers.
    assert!(as_it_is[0] == as_it_is[1] && as_it_is[0][0] == as_it_is[0][1]);
    for (start, of_k_f) in
        [("VS_c = [1.4, 1.0]", true), ("S_c = [2.9, 2.75]", true), ("fuzzy_scale = [1.5, 1.0]", false)]
    {
        let own = k(start);
        assert_eq!(own[1], as_it_is[1], "{start}");
        assert_eq!((own[0][0] != as_it_is[0][0], own[0][1] != as_it_is[0][1]), (of_k_f, true), "{start}");
    }
    assert_eq!(k("fuzzy_scale = [1.5, 1.0]")[0][1], 1.5 * as_it_is[0][0]);
    let inverse = k("fuzzy_scale = [1.5, 1.0]\nfuzzy_output = 'inverse_gain'");
    assert_eq!(inverse[0][1], 1.5 * (1.0 / as_it_is[0][0]));
    let constant = k("fuzzy_output = 'constant'\nconstant_gain = [8.33, 11.43]\nfuzzy_scale = [2.0, 1.0]");
    assert_eq!(constant, [[8.33, 2.0 * 8.33], [11.43, 11.43]]);
    let text = format!(
        "{}\n",
        description(ROBOT).replace("k_p = [1.6666666666666667, 1.6666666666666667]", "k_p = [0.1, 3.0]")
    );
    let run = started(&text, &begin);
    assert!(run.get("k_f[1]") < run.get("k_f[2]"));
    let run = started(&with(ROBOT, "k_e = [0.1, 0.1]", "k_e = [0.5, 0.1]"), &begin);
    assert!(run.get("gain_in_force[1,1]") == 30.0 && run.get("gain_in_force[2,2]") == run.get("k_f[2]"));
}

/// With `fuzzy_sets` = shared the nine corners have the same names as with one channel.
#[test]
fn what_channels_share_has_the_names_of_one_channel() {
    let shared = with(ROBOT, "fuzzy_sets = \"own\"", "fuzzy_sets = \"shared\"");
    for corner in ["VL_c", "VL_l", "L_l", "L_c", "L_h", "S_l", "S_c", "VS_l", "VS_c"] {
        assert!(has(&shared, corner) && !has(&shared, &format!("{corner}[1]")), "{corner}");
        assert!(has(&description(ROBOT), &format!("{corner}[2]")) && !has(&description(ROBOT), corner), "{corner}");
    }
    let one = with("FuzzyL1ActuatedSiso", "baseline", "fuzzy_weights = \"own\"\nfuzzy_sets = \"own\"\nbaseline");
    for name in ["k_p", "k_d", "k_e", "fuzzy_scale", "constant_gain", "VL_c", "VS_l", "k_f"] {
        assert!(has(&one, name), "{name}, of the only channel");
    }
    assert!(!has(&description("FuzzyL1ActuatedSiso"), "fuzzy_scale"));
    let old = description("L1TwoLinkRobot").replace("\"l1\"", "\"fuzzy-l1\"");
    assert!(has(&old, "k_p") && has(&old, "VL_c") && !has(&old, "k_p[1]") && !has(&old, "fuzzy_scale"));
}

/// With the same numbers in each channel, shared and own sets give the same control, bit for bit.
#[test]
fn sharing_is_having_the_same_numbers() {
    let (weights, each) = ("k_e = 0.1\nk_p = 1.6\nk_d = 0.3", "k_e = [0.1, 0.1]\nk_p = [1.6, 1.6]\nk_d = [0.3, 0.3]");
    let text = description(ROBOT);
    let (body, _) = text.split_once("k_e =").unwrap();
    let own = format!("{body}{each}");
    let shared = format!("{body}{weights}").replace("fuzzy_weights = \"own\"\nfuzzy_sets = \"own\"", "");
    let mut runs = [own, shared].map(|text| started(&text, &[("r[1]", 0.5), ("r[2]", -0.6)]));
    for k in 0..200 {
        let t = 1e-3 * f64::from(k);
        for run in &mut runs {
            run.set("r[1]", 0.5 * (0.7 * t).cos());
            run.set("x[1]", 0.5 - 0.5 * (-10.0 * t).exp());
            run.set("x[3]", 5.0 * (-10.0 * t).exp());
            run.step(1e-3);
        }
        let [own, shared] = runs.each_ref().map(|run| [run.get("u[1]"), run.get("u[2]")].map(f64::to_bits));
        assert_eq!(own, shared, "step {k}");
    }
}

/// K_eff = diag(k_i/K_ii) K.
#[test]
fn a_full_gain_is_scaled_row_by_row() {
    for kind in [description(ROBOT), description("L1TwoLinkRobot").replace("\"l1\"", "\"fuzzy-l1\"")] {
        let text = kind.replace("[[30.0, 0.0], [0.0, 30.0]]", "[[30.0, 6.0], [-9.0, 20.0]]");
        let run = started(&text, &[("r[1]", 0.05), ("r[2]", 0.5)]);
        let gain = |i: usize, j: usize| run.get(&format!("gain_in_force[{i},{j}]"));
        let k = run.get("k_f[2]");
        assert_eq!([gain(1, 1), gain(1, 2), gain(2, 2), gain(2, 1)], [30.0, 6.0, k, -9.0 * (k / 20.0)]);
        let none = text.replace("[30.0, 6.0]", "[0.0, 6.0]");
        refused(&none, &["feedback_gain[1,1] = 0", "must be above 0 where feedback_gain[1,2] isn't 0", "row 1"]);
        // A channel without a gain, and without others in it, is one.
        model(&text.replace("[30.0, 6.0]", "[0.0, 0.0]")).unwrap();
    }
}

#[test]
fn where_the_control_enters_a_rate_there_is_no_weight_of_it() {
    let text = description(COUPLED);
    for missing in ["dr[1]", "k_d", "k_d[1]"] {
        assert!(!has(&text, missing), "{missing}");
    }
    let shared =
        text.replace("fuzzy_weights = \"own\"", "").replace("k_e = [0.1, 0.1, 0.1]\nk_p = [1.0, 1.0, 1.0]", "");
    refused(&shared, &["C B: largest entry = 1.000e0", "must be 0", "fuzzy_weights = \"own\""]);
    // One channel of each kind: y_1 is x_1 + 0.1 x_3, and the control enters its rate.
    let mixed = with(ROBOT, "C = [[1.0, 0.0, 0.0, 0.0]", "C = [[1.0, 0.0, 0.1, 0.0]");
    refused(&mixed, &["k_d[1] = 0.3333", "must be 0", "the control has feedthrough to the rate", "C B"]);
    let one = mixed.replace("k_d = [0.3333333333333333,", "k_d = [0.0,");
    let k_f = |dr: f64| started(&one, &[("r[1]", 0.5), ("r[2]", 0.5), ("dr[1]", dr), ("dr[2]", dr)]);
    let [still, fast] = [k_f(0.0), k_f(2.0)];
    assert_eq!(still.get("k_f[1]"), fast.get("k_f[1]"));
    assert!(still.get("k_f[2]") < fast.get("k_f[2]"));
    // What isn't given is 0 there, and the default elsewhere.
    let (without, _) = one.split_once("k_d =").unwrap();
    let run = started(without, &[]);
    assert_eq!([run.get("k_d[1]"), run.get("k_d[2]")], [0.0, 0.05]);
}

#[test]
fn what_does_not_go_together_is_refused_with_what_helps() {
    let unmatched = with(
        ROBOT,
        "input_gain =",
        "unmatched = true\nB_um = [[1.0], [0.0], [0.0], [0.0]]\nfilter = { denominator = [[1.0, 0.0], [0.01, 1.0]] }\ninput_gain =",
    );
    refused(&unmatched, &["unmatched = true", "must be false", "jump", "`l1`", "leave out unmatched and B_um"]);
    refused(&with(ROBOT, "\"own\"\nfuzzy_sets", "\"each\"\nfuzzy_sets"), &["fuzzy_weights", "each", "shared", "own"]);
    refused(&with(ROBOT, "fuzzy_sets = \"own\"", "fuzzy_sets = 2"), &["fuzzy_sets"]);
    refused(&format!("{}\nfuzzy_scale = [0.0, 1.0]", description(ROBOT)), &["fuzzy_scale[1] = 0", "must be above 0"]);
    // As a search of the corners keeps them.
    let narrow = |start: &str| format!("{}\n{start}", description(ROBOT));
    refused(&narrow("VS_l = [0.0, 0.4]\nS_l = [0.5, 0.405]"), &["VS_l[2] = 0.4", "at most 0.395", "S_l[2] = 0.405"]);
    model(&narrow("VS_l = [0.0, 0.4]\nS_l = [0.5, 0.4101]")).unwrap();
    refused(&narrow("VL_l = [8.0, 4.0]\nVL_c = [8.0, 9.0]"), &["VL_l[1] = 8", "must be below VL_c[1] = 8"]);
}

/// Whatever the corners are within their bounds, so that a floor of 1e-3 never acts.
#[test]
fn the_fuzzy_gain_is_at_least_a_tenth() {
    let low = "VS_l = [0.0, 0.0]\nS_l = [0.3, 0.3]\nVS_c = [0.5, 0.5]\nL_l = [1.5, 1.5]";
    let run = started(&format!("{}\n{low}", description(ROBOT)), &[]);
    assert!((run.get("k_f[1]") - 0.1).abs() < 1e-15, "{}", run.get("k_f[1]"));
}

#[test]
fn the_design_report_judges_the_range_of_each_channels_gain() {
    let scaled = format!("{}\nfuzzy_scale = [1.0, 2.0]", description(ROBOT));
    let text = scaled.replace("[[30.0, 0.0], [0.0, 30.0]]", "[[30.0, 6.0], [0.0, 20.0]]");
    let report = model(&text).unwrap().report();
    let gains = report.findings.iter().filter(|finding| finding.name == "K").map(|finding| match &finding.value {
        Value::Matrix(rows) => rows.clone(),
        other => panic!("{other:?}"),
    });
    // The centres of only `zero` and of only `very large`.
    let [least, largest] = [(0.25 + 0.25 + 0.9) / 3.0, (6.0 + 2.0 * 10.0) / 3.0];
    let expected = [[[30.0, 6.0], [0.0, 20.0]]].into_iter();
    let expected = expected.chain([least, largest].map(|k| [[k, 0.2 * k], [0.0, 2.0 * k]]));
    let gains: Vec<_> = gains.collect();
    assert_eq!(gains.len(), 3);
    for (found, expected) in gains.iter().zip(expected) {
        let pairs = found.iter().flatten().zip(expected.iter().flatten());
        pairs.for_each(|(found, expected)| assert!((found - expected).abs() < 1e-12, "{found}, not {expected}"));
    }
    // A channel without a rate has a smaller range: |e| by itself never exceeds `large`.
    let report = model(&description(COUPLED)).unwrap().report();
    let largest = report.findings.iter().rfind(|finding| finding.name == "K").map(|finding| &finding.value);
    let Some(Value::Matrix(rows)) = largest else { panic!("{largest:?}") };
    assert!((rows[0][0] - (2.25 + 4.5 + 8.0) / 3.0).abs() < 1e-12, "{rows:?}");
    // Findings on the report's page for this controller.
    let lambdas =
        report.findings.iter().filter(|finding| finding.name == "lambda").map(|finding| match finding.value {
            Value::Between { upper, .. } => upper,
            ref other => panic!("{other:?}"),
        });
    let lambdas: Vec<_> = lambdas.map(|lambda| format!("{lambda:.2}")).collect();
    assert_eq!(lambdas, ["0.50", "1.65", "1.19"]);
}

/// With another filter K is before it, so a switch of the gain doesn't move the control.
#[test]
fn with_another_filter_no_switch_makes_the_control_jump() {
    let filter = "filter = { denominator = [[1.0, 0.0], [0.02, 1.0]] }\ninput_gain =";
    let mut run = started(&with(ROBOT, "input_gain =", filter), &[("r[1]", 0.5), ("r[2]", 0.5)]);
    run.run(40, 1e-3);
    let before = [run.get("u[1]"), run.get("u[2]")];
    run.set("r[1]", 0.05);
    run.set("r[2]", 0.05);
    run.step(1e-9);
    assert_eq!([run.get("gain_in_force[1,1]"), run.get("gain_in_force[2,2]")], [30.0, 30.0]);
    for (i, before) in before.iter().enumerate() {
        let u = run.get(&format!("u[{}]", i + 1));
        assert!((u - before).abs() < 1e-5 && *before != 0.0, "{u} after {before}");
    }
}
