//! Descriptions of L1 controllers as people write them: each mistake is answered by one line that names it.

use common::described::{model, refused};
use common::description;

/// The robot's controller with one text in it replaced.
fn robot(old: &str, new: &str) -> String {
    let text = description("L1TwoLinkRobot");
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

/// A controller of three states, each with an input of its own.
fn three(structure: &str, start: &str) -> String {
    format!(
        "name = 'Three'\nmodel = 'l1'\ndescription = ''\n[structure]\nB = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n\
         C = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nregressor = 'state'\ninput_gain = 'full'\n{structure}\n[start]\n{start}"
    )
}

#[test]
fn a_baseline_needs_the_nominal_dynamics_and_only_a_baseline_does() {
    let a = description("L1TwoLinkRobot").lines().find(|line| line.starts_with("A = ")).unwrap().to_owned();
    refused(&robot(&a, ""), &["A is missing", "baseline"]);
    // Without one, A is where A_m starts.
    let without = robot("baseline = \"inside\"", "").replace("pole_imag = [5.0, -5.0, 5.0, -5.0]", "");
    refused(&without, &["[start] pole_real", "no such parameter", "A_m"]);
    refused(&robot("baseline = \"inside\"", "baseline = \"within\""), &["baseline", "within", "inside"]);
    refused(&robot(&a, "A = [[0.0, 1.0], [0.0, 0.0]]"), &["A = 2 x 2", "4 x 4"]);
    refused(&robot(&a, "A = [[0.0, 1.0], [0.0]]"), &["row 2 of A = 1 numbers", "the first has 2"]);
}

#[test]
fn desired_dynamics_are_given_or_placed_not_both() {
    refused(&robot("pole_real", "A_m = [[-1.0]]\npole_real"), &["[start] A_m", "no such parameter", "pole_real"]);
    refused(&three("", "pole_real = [-1, -1, -1]"), &["[start] pole_real", "no such parameter", "A_m"]);
}

#[test]
fn there_are_as_many_poles_as_states() {
    refused(
        &robot("[-300.0, -300.0, -400.0, -400.0]", "[-300.0, -300.0]"),
        &["[start] pole_real", "list of 4 numbers"],
    );
    refused(&robot("[5.0, -5.0, 5.0, -5.0]", "[5.0]"), &["[start] pole_imag", "list of 4 numbers"]);
}

#[test]
fn a_complex_pole_comes_with_its_conjugate_in_the_same_chain() {
    refused(&robot("[5.0, -5.0, 5.0, -5.0]", "[5.0, 5.0, 5.0, -5.0]"), &["pole 1 = -300 + 5j", "conjugate"]);
    refused(&robot("[5.0, -5.0, 5.0, -5.0]", "[0.0, 5.0, -5.0, 0.0]"), &["pole 2 = -300 + 5j", "conjugate"]);
    refused(&robot("[-300.0, -300.0,", "[-300.0, -301.0,"), &["pole 1 = -300 + 5j", "conjugate"]);
}

#[test]
fn a_pole_that_does_not_decay_is_refused() {
    refused(&robot("-400.0, -400.0]", "0.0, 0.0]"), &["pole 3 = 0 + 5j", "negative real part"]);
}

#[test]
fn units_of_other_signals_or_of_another_number_are_refused() {
    refused(&robot("r = [\"rad\", \"rad\"]", "r = [\"rad\"]"), &["units of r = 1", "must be 2"]);
    refused(&robot("r = [\"rad\", \"rad\"]", "y = [\"rad\", \"rad\"]"), &["[structure]", "`y`", "r, x, u"]);
}

#[test]
fn inputs_that_do_the_same_and_states_out_of_reach_are_refused() {
    let b = "B = [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]";
    refused(&robot(b, "B = [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [1.0, 1.0]]"), &["rank", "controllable"]);
    refused(&robot(b, "B = [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]"), &["rank", "= 0: must be 4"]);
}

#[test]
fn more_inputs_than_states_and_huge_sizes_are_refused() {
    let siso = |b: &str, c: &str| {
        let text = description("L1NonlinearSiso");
        text.replace("[[0.0], [1.0]]", b).replace("[[1.0, 0.0]]", c)
    };
    refused(&siso("[[0.0, 1.0]]", "[[1.0], [0.0]]"), &["B = 1 x 2", "no more columns than rows"]);
    let many = format!("[{}]", vec!["[1.0]"; 201].join(", "));
    refused(&siso(&many, "[[1.0, 0.0]]"), &["B = 201 x 1", "1 … 200 rows"]);
}

#[test]
fn outputs_that_settle_alike_are_refused() {
    let c = "C = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]";
    refused(&robot(c, "C = [[1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]]"), &["C A_m^-1 B", "singular"]);
    refused(&robot(c, "C = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]"), &["C A_m^-1 B", "singular"]);
}

#[test]
fn numbers_too_large_to_design_with_are_refused_at_once() {
    // Where an iteration would never end, or end at no number.
    refused(&robot("-400.0, -400.0]", "-1e80, -1e80]"), &["badly scaled", "double precision"]);
    for size in ["1e150", "1e200", "1e308"] {
        let rows = format!("A_m = [[-{size}, {size}, 1], [-{size}, -{size}, {size}], [3, -{size}, -{size}]]");
        assert!(model(&three("", &rows)).is_err(), "A_m of {size}");
        let q = format!("Q = [[{size}, 0, 0], [0, {size}, 0], [0, 0, {size}]]\n");
        let a_m = "A_m = [[-1, 0, 0], [0, -1, 1], [0, -1, -1]]";
        assert!(size == "1e150" || model(&three("", &format!("{q}{a_m}"))).is_err(), "Q of {size}");
    }
}

#[test]
fn a_feedback_gain_of_zero_is_a_controller_that_does_not_adapt() {
    assert!(model(&robot("[[30.0, 0.0], [0.0, 30.0]]", "[[0.0, 0.0], [0.0, 0.0]]")).is_ok());
}

#[test]
fn a_filter_that_is_none_is_refused_with_its_factor() {
    let with = |filter: &str| robot("baseline = \"inside\"", &format!("baseline = \"inside\"\nfilter = {filter}"));
    refused(&with("{ denominator = [[1.0, 1.0]] }"), &["D(s)", "exactly one"]);
    refused(&with("{ denominator = [[1.0, 0.0]], numerator = [[1.0, 1.0]] }"), &["D(s)", "degree", "below"]);
    refused(&with("{ denominator = [[1.0, 0.0], [1.0, -1.0]] }"), &["D(s)", "[1.0, -1.0]", "left half plane"]);
    refused(&with("{ poles = [1.0] }"), &["[structure]", "poles", "denominator"]);
    refused(&with("{ gain = 0.0 }"), &["D(s): gain = 0"]);
}

/// A description with one text in it replaced.
fn changed(name: &str, old: &str, new: &str) -> String {
    let text = description(name);
    assert!(text.contains(old), "`{old}` is in the description");
    text.replace(old, new)
}

#[test]
fn desired_dynamics_that_no_feedback_gives_are_refused() {
    let coupled = |old, new| changed("L1CoupledMimo", old, new);
    refused(&coupled("baseline = \"outside\"", ""), &["desired_dynamics", "matrix", "requires a baseline"]);
    let two = coupled("B = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "B = [[1.0], [0.0], [0.0]]");
    let two = two.replace("C = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "C = [[1.0, 0.0, 0.0]]");
    let start = two.find("feedback_gain").unwrap();
    let end =
        "feedback_gain = [[30.0]]\nomega_min = [0.3]\nomega_max = [10.0]\ntheta_bound = [5.0]\nsigma_bound = [20.0]";
    let one_input = format!("{}{end}", &two[..start]);
    refused(&one_input, &["A_m", "A - A_m = 8.000e1", "range of B"]);
}

#[test]
fn unmatched_uncertainty_needs_directions_that_the_control_does_not_reach() {
    let unmatched = |new: &str| changed("L1UnmatchedMimo", "unmatched = true", new);
    let given = |rows: &str| unmatched(&format!("B_um = {rows}"));
    assert!(model(&given("[[0.0], [2.0], [0.0]]")).is_ok());
    refused(&given("[[0.0], [1.0], [0.5]]"), &["B' B_um", "largest entry = 5.000e-1", "matched"]);
    refused(&given("[[0.0], [1.0]]"), &["B_um = 2 x 1", "3 rows", "1 … 1 columns"]);
    refused(&given("[[0.0, 0.0], [1.0, 2.0], [0.0, 0.0]]"), &["B_um = 3 x 2"]);
    refused(&given("[[0.0], [1.0], [0.0]]\nunmatched = false"), &["B_um = given", "unmatched"]);
    let matched = unmatched("").replace("sigma_bound_unmatched = [5.0]", "");
    refused(&matched, &["[start] theta_bound_unmatched", "no such parameter"]);
    let a = description("L1UnmatchedMimo").lines().find(|line| line.starts_with("A = ")).unwrap().to_owned();
    refused(&changed("L1UnmatchedMimo", &a, ""), &["A is missing", "unmatched"]);
    refused(&changed("L1CoupledMimo", "baseline", "unmatched = true\nbaseline"), &["unmatched = true", "every state"]);
}

#[test]
fn unmatched_uncertainty_that_no_stable_or_proper_law_cancels_is_refused() {
    // y_2 = x_2 − x_3 has a zero at 1/s in the right half plane.
    let c = "C = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]";
    let other = changed("L1UnmatchedMimo", c, "C = [[1.0, 0.0, 0.0], [0.0, 1.0, -1.0]]");
    refused(&other, &["zero of C (sI - A)^-1 B = 1", "negative real part", "choose other outputs"]);
    // The twin rotor's torques enter one integration behind its rotors: with two, a filter 1/s isn't enough.
    let rotor = |old, new| changed("L1TwinRotor", old, new);
    let behind = rotor(
        "B_um = [\n    [0.0, 0.0],\n    [1.0, 0.0],\n    [0.0, 0.0],\n    [0.0, 1.0],",
        "B_um = [\n    [1.0, 0.0],\n    [0.0, 0.0],\n    [0.0, 0.0],\n    [0.0, 1.0],",
    );
    refused(&behind, &["D(s): relative degree = 1", "at least 2", "more poles"]);
}

#[test]
fn desired_dynamics_with_other_zeros_than_the_nominal_ones_are_refused() {
    // With x_3 in the first row, too, the second output sees the control sooner or later by another chain.
    let other = changed("L1UnmatchedMimo", "[start]", "[start]\nA_m = [[-1, 0, 0], [0, -1, 0], [0, -1, -1.8]]");
    refused(&other, &["A_m", "singular"]);
}
