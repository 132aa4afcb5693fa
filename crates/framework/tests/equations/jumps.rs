//! Changes between communication steps: what jumps there may be an event too, and takes effect in the next step.

use adaptive_fmu::execution::Execution;
use common::models::Run;
use common::systems::*;

fn switch() -> Run {
    Run::of::<Switch>("", 0.0)
}

#[test]
fn declared_start_values_of_states_and_discrete_variables_are_where_they_start() {
    let mut run = switch();
    assert_eq!((run.get("x"), run.get("side")), (2.0, -1.0));
    run.step(0.5);
    assert_eq!((run.get("x"), run.get("side")), (1.5, -1.0), "at the first step too");
}

#[test]
fn an_input_that_jumps_across_a_threshold_between_steps_is_an_event_of_the_next_step() {
    let mut run = switch();
    run.step(0.5);
    run.set("u", 1.0);
    run.step(0.5);
    assert_eq!((run.get("side"), run.get("x")), (1.0, 2.0), "switched at the step's start");
    run.step(0.5);
    assert_eq!((run.get("side"), run.get("x")), (1.0, 2.5), "once");
    run.set("u", 0.0);
    run.step(0.5);
    assert_eq!((run.get("side"), run.get("x")), (-1.0, 2.0), "and back");
}

#[test]
fn a_threshold_that_is_tuned_across_its_input_is_an_event_of_the_next_step() {
    let mut run = switch();
    run.step(0.5);
    run.set("threshold", -0.5);
    run.step(0.5);
    assert_eq!(run.get("side"), 1.0);
}

#[test]
fn a_restored_instance_finds_the_same_jump() {
    let mut run = switch();
    run.step(0.5);
    let saved = run.0.block().clone();
    run.set("u", 1.0);
    run.step(0.5);
    let expected = run.0.block().clone();
    run.run(3, 0.5);
    run.0.block_mut().copy_from(&saved);
    run.set("u", 1.0);
    run.step(0.5);
    assert_eq!(run.0.block(), &expected);
}

#[test]
fn a_switch_that_was_set_since_the_last_step_is_not_in_the_output_derivatives_yet() {
    let mut run = switch();
    run.step(0.5);
    let derivative = |execution: &mut Execution| {
        let variables = execution.model().variables();
        let y = variables.index(variables.find("y").unwrap());
        execution.time_derivatives()[y]
    };
    assert_eq!(derivative(&mut run.0), -1.0);
    let enabled = run.0.model().variables().find("enabled").unwrap();
    let place = run.0.model().variables().index(enabled);
    run.0.block_mut().integers[place] = 0;
    assert_eq!(derivative(&mut run.0), -1.0, "not in force yet");
    run.step(0.5);
    assert_eq!(derivative(&mut run.0), 1.0);
}

#[test]
fn a_time_event_is_never_handled_before_its_time() {
    // Within the rounding that a step's end is allowed, and a little beyond it.
    for (due, fired) in [(0.3, 1.0), (0.300_000_05, 1.0), (0.300_001, 0.0)] {
        let mut run = Run::of::<Timer>(&format!("due = {due}"), 0.0);
        run.run(3, 0.1);
        assert_eq!(run.get("y"), fired, "due at {due}");
        run.step(0.1);
        assert_eq!(run.get("y"), 1.0, "due at {due}");
    }
}

#[test]
fn a_tolerance_that_no_computer_reaches_is_taken_as_the_tightest_possible() {
    let mut run = switch();
    run.0.set_tolerance(1e-300);
    run.step(0.5);
    assert_eq!(run.get("x"), 1.5);
}
