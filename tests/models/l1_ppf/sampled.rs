//! The sampled barrier in loops of separate units, when it looks at the error, and what it refuses.

use common::described::refused;
use common::models::Run;
use common::{OK, Unit, description};

use super::{COUPLED, DIGITS, FIRST, SECOND, Split, all_near, unit};

const SAMPLED: &str = "law = 'sampled'\n";
const STIFF: &str = "barrier_gain = [0.3, 0.3, 0.3]\n";

/// The loop, sampled.
fn sampled(of_plant: &str, is_jacobi: bool, step: f64) -> Split<'_> {
    Split { of_controller: SAMPLED, ..Split::new(of_plant, is_jacobi, step) }
}

#[test]
fn units_of_their_own_stay_in_their_funnels() {
    for (plant, is_jacobi, step, part, max_2) in [
        (FIRST, false, 1e-3, [0.3293, 0.4101, 0.2642], 62.08),
        (FIRST, true, 1e-3, [0.3131, 0.4046, 0.2522], 66.17),
        (SECOND, false, 1e-3, [0.6102, 0.6069, 0.2654], 96.26),
        (SECOND, true, 1e-3, [0.6125, 0.6550, 0.2614], 103.2),
        (FIRST, false, 5e-3, [0.3609, 0.3983, 0.3110], 51.67),
        (FIRST, true, 5e-3, [0.3003, 0.3983, 0.2594], 73.02),
        (SECOND, false, 5e-3, [0.7236, 0.7975, 0.3124], 117.6),
    ] {
        let found = sampled(plant, is_jacobi, step).found().expect("it stays inside");
        all_near("e/rho", &found.part, &part, DIGITS);
        all_near("max u[2]", &found.max[1..2], &[max_2], DIGITS);
    }
    assert!(sampled(SECOND, true, 5e-3).found().is_none(), "it leaves, and the step is refused");
}

#[test]
fn a_barrier_that_is_too_stiff_for_the_step_holds_where_it_is_sampled() {
    for (is_jacobi, step, part) in [(true, 5e-3, [0.2605, 0.3983, 0.2251]), (false, 1e-2, [0.3740, 0.3985, 0.3346])] {
        let continuous = Split { of_controller: STIFF, ..Split::new(FIRST, is_jacobi, step) };
        assert!(continuous.found().is_none(), "at {step} s the barrier throws the error out");
        let of_controller = format!("{SAMPLED}{STIFF}");
        let found = Split { of_controller: &of_controller, ..continuous }.found().expect("it stays inside");
        all_near("e/rho", &found.part, &part, DIGITS);
    }
}

#[test]
fn noise_of_the_measurement_takes_a_part_of_the_funnel() {
    for (plant, worst) in [(FIRST, 0.4047), (SECOND, 0.7770)] {
        let noisy = Split { noise: (0.003, 1), ..sampled(plant, true, 1e-3) };
        let part = noisy.found().expect("it stays inside").part;
        all_near("e/rho", &[part.into_iter().fold(0.0, f64::max)], &[worst], DIGITS);
        let noisier = Split { noise: (0.01, 1), ..noisy };
        assert!(noisier.found().is_none(), "five deviations are the whole bound");
    }
}

/// A controller that is started with its inputs at 0.
fn started(start: &str) -> Run {
    let mut run = unit(COUPLED[2], &format!("{SAMPLED}{start}"));
    run.0.initialise().unwrap();
    run
}

#[test]
fn between_samples_the_barrier_is_constant_and_at_one_it_answers() {
    let mut run = started("sample_time = 0.004");
    run.run(2, 0.004);
    run.set("x[1]", 0.5);
    for k in 1..=8 {
        run.step(0.001);
        let added = run.get("u_barrier[1]");
        assert_eq!(added != 0.0, k >= 4, "{k}: {added}");
        let (u, u_ad) = (run.get("u[1]"), run.get("u_ad[1]"));
        assert!((u - (u_ad - 34.0 * 0.5 + added)).abs() < 1e-12, "the control has what is held: {u}");
    }
    assert_eq!(run.get("sample_period"), 0.004);
}

#[test]
fn an_error_is_judged_at_the_first_sample_and_not_before() {
    // As where the plant is stepped first: the unit starts with what is measured at the end of the step.
    let mut run = started("x_m0 = [1.0, 0.0, 0.0]\nrho_0 = [0.6, 2.0, 2.0]");
    run.set("x[1]", 0.3);
    (1..=3).for_each(|i| run.set(&format!("r[{i}]"), 0.0));
    run.step(0.01);
    let (e, rho) = (run.get("e[1]"), run.get("rho[1]"));
    assert!(e.abs() < rho && run.get("epsilon[1]") < 0.0, "{e} of {rho}");
    let mut run = started("");
    run.set("x[2]", 2.5);
    let reason = run.failure(0.001).to_string();
    assert!(reason.contains("e[2] = ") && reason.contains("rho_0[2]"), "{reason}");
    let mut run = started("on_funnel_exit = 'reopen'");
    run.run(3, 0.001);
    run.set("x[2]", 2.5);
    run.step(0.001);
    assert_eq!(run.integer("funnel_reopened"), 1);
    assert!((run.get("rho[2]") - 1.25 * run.get("e[2]")).abs() < 1e-6, "{}", run.get("rho[2]"));
}

#[test]
fn taking_over_makes_no_jump_and_the_barrier_waits_for_its_sample() {
    let mut run = unit(COUPLED[2], SAMPLED);
    run.set_boolean("enabled", false);
    run.set("u_manual[1]", 4.0);
    run.set("x[1]", 9.0);
    run.0.initialise().unwrap();
    run.run(50, 0.01);
    assert_eq!((run.get("u[1]"), run.get("u_barrier[1]")), (4.0, 0.0), "by hand an error may be anywhere");
    run.set("x[1]", 0.3);
    run.set_boolean("enabled", true);
    run.step(1e-9);
    assert!((run.get("u[1]") - 4.0).abs() < 1e-4, "{}", run.get("u[1]"));
    assert_eq!(run.get("u_barrier[1]"), 0.0);
    run.run(2, 0.01);
    assert_ne!(run.get("u_barrier[1]"), 0.0);
}

#[test]
fn steps_that_are_longer_than_the_sample_time_are_reported_and_a_stiff_barrier_is_not() {
    let mut run = started("sample_time = 0.001\nrho_inf = [0.001, 0.05, 0.05]\ndecay_rate = [1e3, 1.5, 1.5]");
    run.run(20, 0.001);
    run.set("x[1]", 2e-4);
    run.step(0.001);
    assert!(run.get("barrier_stiffness") > 9e4);
    assert!(!run.0.take_messages().any(|message| message.text.contains("too long for the barrier")));
    let mut run = started("sample_time = 0.001");
    run.run(3, 0.001);
    assert_eq!(run.integer("step_too_long"), 0);
    run.step(0.003);
    assert_eq!(run.integer("step_too_long"), 1);
    assert!(run.0.take_messages().any(|message| message.text.contains("longer than the sample time")));
}

#[test]
fn automatic_is_sampled_in_co_simulation_and_the_default_is_continuous() {
    let by = |law: &str| {
        let mut run = unit(COUPLED[2], law);
        run.0.initialise().unwrap();
        run.step(0.005);
        run.set("x[1]", 0.2);
        run.run(3, 0.005);
        run.get("u[1]").to_bits()
    };
    assert_eq!(by("law = 'automatic'"), by(SAMPLED));
    assert_eq!(by("law = 'continuous'"), by(""));
    assert_ne!(by(SAMPLED), by(""));
}

#[test]
fn what_cannot_be_sampled_is_refused() {
    let text = |name: &str, start: &str| format!("{}\n{start}", description(name));
    let exchange = Unit::exchange_from_text(&text(COUPLED[2], SAMPLED));
    exchange.enter(0.0);
    assert_ne!(exchange.exit(), OK);
    assert!(exchange.last_message().contains("only an FMU that is stepped"), "{}", exchange.last_message());
    for (name, start, named) in [
        ("L1PpfTwoLinkRobot", SAMPLED, "law = sampled"),
        ("L1PpfTwoLinkRobot", "law = 'automatic'", "law = automatic"),
        (COUPLED[2], "sample_time = 1e-10", "sample_time = 1e-10"),
    ] {
        refused(&text(name, start), &[named]);
    }
}
