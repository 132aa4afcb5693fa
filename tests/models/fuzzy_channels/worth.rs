//! Benefits of a fuzzy gain with several channels: the numbers on its page.
#![allow(non_snake_case)] // the objective has the name of the page

use common::closed::{Closed, near};
use common::description;

/// Communication points of the sums, s.
const STEP: f64 = 1e-3;
/// Bounds of the input gain that no estimate reaches.
const FREE: &str = "omega_min = [[0.0, -2.0], [-2.0, 0.0]]";
const NEVER_FUZZY: &str = "k_e = [1e6, 1e6]";
const AS_IN_THE_THESIS: &str = "k_p = [0.1, 0.1]\nk_d = [0.05, 0.05]";
const TUNED_CONSTANT: &str = "k_e = [1e6, 1e6]\nfeedback_gain = [[9.10, 0.0], [0.0, 12.48]]";
const TWO_LEVELS: &str = "fuzzy_output = 'constant'\nconstant_gain = [8.33, 11.43]";

/// Results of `tune` after 1,800 runs.
const TUNED_SETS: &str = "VL_c = [9.615403, 11.705008]\nVL_l = [8.0, 8.0]\nL_l = [3.0, 1.5]\nL_c = [6.0, 3.0]\nL_h = [10.0, \
                          6.0]\nS_l = [1.5, 1.5]\nS_c = [4.0, 4.0]\nVS_l = [0.5, 0.5]\nVS_c = [1.5, 1.5]";

/// Result of a run: Σ (e² + 1e-4 u²) of all channels, times the step, and the largest controls.
struct Worth {
    J: f64,
    largest: Vec<f64>,
}

fn run(closed: Closed, m: usize, until: f64) -> Worth {
    let mut run = closed.started(1e-8);
    let mut worth = Worth { J: 0.0, largest: vec![0.0; m] };
    for _ in 0..(until / STEP).round() as usize {
        for i in 0..m {
            let value = |name: &str| run.get(&format!("{name}[{}]", i + 1));
            let (e, u) = (value("reference.r") - value("plant.y"), value("controller.u"));
            worth.J += STEP * (e * e + 1e-4 * u * u);
            worth.largest[i] = worth.largest[i].max(u.abs());
        }
        run.step(STEP);
    }
    println!("{} {:?}", worth.J, worth.largest);
    worth
}

fn robot_with(controller: &str, [reference, plant]: [&str; 2], until: f64) -> Worth {
    let closed =
        Closed::new().part("reference", "ReferenceTwoLinkRobot", reference).part("plant", "TwoLinkRobot", plant);
    let closed = closed.part("controller", super::ROBOT, controller);
    let closed = closed.connected("reference.r", "controller.r", 2).connected("reference.dr", "controller.dr", 2);
    run(closed.connected("plant.x", "controller.x", 4).connected("controller.u", "plant.u", 2), 2, until)
}

fn robot(controller: &str) -> Worth {
    robot_with(&format!("{FREE}\n{controller}"), ["", ""], 4.0)
}

/// Results from another start, with 0.8 times the negated reference at 1.3 times its frequency.
fn held_out(controller: &str) -> f64 {
    let reference = "cosine_amplitude = [-0.4, 0.48]\ncosine_frequency = [0.91, 0.845]";
    robot_with(&format!("{FREE}\n{controller}"), [reference, "x0 = [0.3, 0.4, 0.0, 0.0]"], 6.0).J
}

fn coupled(controller: &str) -> Worth {
    let closed = Closed::new().part("reference", "ReferenceCoupledMimo", "");
    let closed =
        closed.part("plant", "CoupledMimo", "x0 = [0.6, -0.8, 0.4]").part("controller", super::COUPLED, controller);
    let closed = closed.connected("reference.r", "controller.r", 3).connected("plant.x", "controller.x", 3);
    run(closed.connected("controller.u", "plant.u", 3), 3, 4.0)
}

#[test]
fn on_the_robot_a_fuzzy_gain_lowers_the_peak_and_the_objective() {
    for (what, start, J, largest) in [
        ("constant", NEVER_FUZZY, 0.346175, [113.5, 89.5]),
        ("as in the thesis", AS_IN_THE_THESIS, 0.617825, [58.6, 18.5]),
        ("normalised", "", 0.290801, [49.9, 27.1]),
    ] {
        let found = robot(start);
        near(&format!("{what}: J"), found.J, J, 5e-5);
        (0..2).for_each(|i| near(&format!("{what}: max |u|"), found.largest[i], largest[i], 3e-3));
    }
}

/// A constant gain of its own for each joint, and two levels, do the same without any inference.
#[test]
fn on_the_robot_tuned_constants_do_as_much() {
    for (what, start, J, largest) in [
        ("tuned sets", TUNED_SETS, 0.276435, [46.9, 26.0]),
        ("constant", TUNED_CONSTANT, 0.279927, [60.2, 48.4]),
        ("two levels", TWO_LEVELS, 0.269754, [57.8, 45.2]),
    ] {
        let found = robot(start);
        near(&format!("{what}: J"), found.J, J, 5e-5);
        (0..2).for_each(|i| near(&format!("{what}: max |u|"), found.largest[i], largest[i], 2e-3));
    }
}

#[test]
fn on_another_trajectory_of_the_robot_it_is_as_documented() {
    for (what, start, J) in [
        ("constant", NEVER_FUZZY, 1.958),
        ("as in the thesis", AS_IN_THE_THESIS, 0.991),
        ("normalised", "", 1.093),
        ("tuned sets", TUNED_SETS, 1.129),
        ("tuned constant", TUNED_CONSTANT, 1.236),
        ("two levels", TWO_LEVELS, 1.098),
    ] {
        near(&format!("{what}: J held out"), held_out(start), J, 6e-4);
    }
}

/// With the controller's own bounds of omega, an estimate reaches its bound, and the numbers differ a little.
#[test]
fn with_the_units_own_bounds_the_robot_does_alike() {
    let own = robot_with("", ["", ""], 4.0);
    near("J", own.J, 0.290537, 5e-5);
    near("max |u_1|", own.largest[0], 49.77, 5e-4);
}

#[test]
fn on_example_6_5_1_lowering_the_gain_only_costs() {
    let never = "k_e = [1e6, 1e6, 1e6]";
    for (what, start, J) in [
        ("constant", never, 0.218550),
        ("as in the thesis", "k_p = [0.1, 0.1, 0.1]", 1.616901),
        ("normalised", "", 0.655149),
    ] {
        let found = coupled(start);
        near(&format!("{what}: J"), found.J, J, 1e-5);
        // The baseline's, at the start.
        near(&format!("{what}: max |u_2|"), found.largest[1], 64.4, 1e-6);
    }
}

#[test]
fn the_page_has_these_numbers() {
    let page = include_str!("../../../docs/controllers/fuzzy_l1.md");
    for row in [
        "| constant 30 | 0.34618 | 113.5, 89.5 | 1.958 | 0.21855 |",
        "| fuzzy, $k_p$ = 0.1, $k_d$ = 0.05 s | 0.61784 | 58.6, 18.5 | 0.991 | 1.61690 |",
        "| fuzzy, normalised | 0.29080 | 49.9, 27.1 | 1.093 | 0.65515 |",
        "| fuzzy, corners tuned | 0.27644 | 46.9, 26.0 | 1.129 | – |",
        "| constant, tuned: 9.10, 12.48 | 0.27993 | 60.2, 48.4 | 1.236 | – |",
        "| two levels, tuned: 8.33, 11.43 | 0.26975 | 57.8, 45.2 | 1.098 | – |",
    ] {
        assert!(page.contains(row), "{row}");
    }
    for message in ["the normalised row has 0.29054 and 49.8 N·m", "from 113 to 50 N·m", "take it to 58", "64.4"] {
        assert!(page.contains(message), "{message}");
    }
    assert!(description(super::ROBOT).contains("omega_min = [[0.5, -2.0], [-2.0, 0.5]]"));
}
