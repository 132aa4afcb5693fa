//! A controller reports that the communication step is too long for its loop: its control moves too far in one.

use common::{OK, Unit, description};

const PLANT: &str = "CoupledMimo";

fn unit(name: &str, start: &str) -> Unit {
    Unit::from_text(&format!("{}\n{start}", description(name)))
}

fn hand_over(from: &Unit, output: &str, to: &Unit, input: &str) {
    for i in 1..=3 {
        to.put(&format!("{input}[{i}]"), from.get(&format!("{output}[{i}]")));
    }
}

/// Runs example 6.5.1 or 6.5.2 by separate units, the plant before the controller; whether the flag was ever set, and the
/// warnings.
fn flagged(controller: &Unit, nonaffine: bool, step: f64, steps: usize) -> (bool, Vec<String>) {
    let (reference, plant) = (Unit::new("ReferenceCoupledMimo"), Unit::new(PLANT));
    assert_eq!(plant.set_boolean("nonaffine", nonaffine), OK);
    [0.6, -0.8, 0.4].into_iter().enumerate().for_each(|(i, x)| plant.put(&format!("x0[{}]", i + 1), x));
    let units = [&reference, &plant, controller];
    units.iter().for_each(|unit| unit.enter(0.0));
    hand_over(&reference, "r", controller, "r");
    hand_over(&plant, "x", controller, "x");
    hand_over(controller, "u", &plant, "u");
    units.iter().for_each(|unit| assert_eq!(unit.exit(), OK, "{:?}", unit.messages()));
    let mut ever = false;
    for k in 0..steps {
        let t = k as f64 * step;
        assert_eq!((reference.step(t, step), plant.step(t, step)), (OK, OK), "{:?}", plant.messages());
        hand_over(&reference, "r", controller, "r");
        hand_over(&plant, "x", controller, "x");
        assert_eq!(controller.step(t, step), OK, "{:?}", controller.messages());
        hand_over(controller, "u", &plant, "u");
        ever |= controller.get_boolean("step_too_long");
    }
    let messages = controller.messages().into_iter().filter(|(_, category, _)| category == "logStepTooLong");
    (ever, messages.map(|(.., text)| text).collect())
}

#[test]
fn a_loop_whose_control_is_off_by_a_quarter_is_flagged_and_one_that_is_right_is_not() {
    // Deviations from the loops as a single FMU: largest control 23 % and 1 %.
    let (ever, messages) = flagged(&Unit::new("L1CoupledMimo"), true, 1e-3, 100);
    assert!(
        ever && messages.len() == 1 && messages[0].contains("1.000e-3 s") && messages[0].contains("largest magnitude"),
        "{messages:?}"
    );
    assert_eq!(flagged(&Unit::new("L1CoupledMimo"), false, 5e-4, 1000), (false, vec![]));
}

#[test]
fn the_neuro_adaptive_law_warns_of_its_step() {
    let at_the_plant = "x_m0 = [0.6, -0.8, 0.4]";
    let (ever, messages) = flagged(&unit("NeuroPpfCoupledMimo", at_the_plant), true, 1e-4, 200);
    assert!(ever && messages.len() == 1 && messages[0].contains("as a single FMU"), "{messages:?}");
    assert_eq!(flagged(&Unit::new("NeuroPpfCoupledMimo"), false, 1e-4, 500), (false, vec![]));
}

#[test]
fn the_limit_of_a_move_is_a_parameter() {
    let strict = unit("L1CoupledMimo", "step_move_limit = 0.01");
    assert!(flagged(&strict, false, 1e-3, 100).0);
    let lax = unit("L1CoupledMimo", "step_move_limit = 10.0\nstep_phase_limit = 1e6");
    assert_eq!(flagged(&lax, true, 1e-3, 100), (false, vec![]));
}

/// A controller that gives these controls, one after another; after which steps of 1 ms it was flagged, and its warnings.
fn shown(controls: impl IntoIterator<Item = f64>) -> (Vec<usize>, Vec<String>) {
    let text = description("PidNonlinearSiso").replace("K_p = [64.0]\nK_i = [5.0]\nK_d = [20.0]", "K_p = [2.0]");
    let unit = Unit::from_text(&text);
    unit.start(0.0);
    let mut flagged = Vec::new();
    for (k, u) in controls.into_iter().enumerate() {
        unit.put("y[1]", -u);
        assert_eq!(unit.step(k as f64 * 1e-3, 1e-3), OK);
        assert!((unit.get("u[1]") - u).abs() < 1e-12);
        flagged.extend(unit.get_boolean("step_too_long").then_some(k));
    }
    let messages = unit.messages().into_iter().filter(|(_, category, _)| category == "logStepTooLong");
    (flagged, messages.map(|(.., text)| text).collect())
}

#[test]
fn a_control_is_judged_once_it_has_its_size() {
    // A small peak before the control grows, by a fiftieth a step.
    let peak = [0.002, 0.006, 0.01, 0.006, 0.002, 0.0].into_iter().chain([0.0; 8]);
    let growth = (0..200).map(|k| (0.02 * f64::from(k)).min(1.0));
    assert_eq!(shown(peak.chain(growth)), (vec![], vec![]));
    // A start counts, but for its first move, as soon as the control has stood at its size for twenty steps.
    let (flagged, messages) = shown((0..100).map(|k| 0.8_f64.powi(k)));
    assert_eq!(flagged, (20..100).collect::<Vec<_>>());
    assert!(messages.len() == 1 && messages[0].contains("by 0.20 of its largest magnitude"), "{messages:?}");
    // A control that took long to grow waits as long, and not for more than a thousand steps.
    for (rise, wait) in [(100, 101), (3000, 1000)] {
        let (flagged, _) =
            shown((0..rise + 2000).map(|k| if k < rise { 0.1 } else { -1.0 + f64::from(k - rise) * 1e-4 }));
        assert_eq!(flagged.first(), Some(&usize::try_from(rise + wait).unwrap()));
    }
}

#[test]
fn the_step_that_a_warning_names_is_rounded_down() {
    // 0.65 of the limit of 0.13 over a move of 0.188: 4.49e-4 s.
    let (_, messages) = shown((0..100).map(|k| 0.812_f64.powi(k)));
    assert!(messages.len() == 1 && messages[0].contains("Try 4.4e-4 s or less"), "{messages:?}");
}
