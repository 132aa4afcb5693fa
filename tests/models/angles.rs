//! Angles that wrap: laws that know them take wrapped and unwrapped ones for the same, and go the short way.

mod laws;
mod loops;
mod models;
mod turning;

use std::f64::consts::{PI, TAU};

use adaptive_fmu::execution::Execution;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use common::models::Run;
use common::random::Random;

/// Within (−π, π], by a loop of its own.
pub fn wrapped(mut angle: f64) -> f64 {
    while angle > PI {
        angle -= TAU;
    }
    while angle <= -PI {
        angle += TAU;
    }
    angle
}

pub fn model(text: &str) -> Result<Model, String> {
    Model::from_description(Description::read(text).unwrap(), REGISTRY).map_err(|invalid| invalid.to_string())
}

pub fn made(text: &str) -> Run {
    Run(Execution::new(model(text).unwrap_or_else(|reason| panic!("{reason}: {text}"))))
}

pub fn head(model: &str) -> String {
    format!("name = 'Test'\nmodel = '{model}'\ndescription = ''\n")
}

/// Refusal of an FMU at its start.
pub fn refusal(text: &str) -> String {
    match model(text).map(Execution::new) {
        Err(reason) => reason,
        Ok(mut execution) => execution.initialise().expect_err(text).to_string(),
    }
}

fn unwrapping(channels: usize) -> Run {
    made(&format!("{}[structure]\nchannels = {channels}", head("unwrap")))
}

#[test]
fn any_jumps_by_whole_turns_are_removed_in_each_channel() {
    let mut random = Random::new(3);
    let mut run = unwrapping(3);
    let mut angles = [2.9, -40.0, 0.0];
    for (i, angle) in angles.iter().enumerate() {
        run.set(&format!("u[{}]", i + 1), *angle);
    }
    run.0.initialise().unwrap();
    run.step(0.01);
    for step in 0..2000 {
        for (i, angle) in angles.iter_mut().enumerate() {
            *angle += 3.1 * random.next();
            let turns = (4.0 * random.next()).round();
            run.set(&format!("u[{}]", i + 1), *angle + TAU * turns);
        }
        run.step(0.01);
        for (i, angle) in angles.iter().enumerate() {
            let found = run.get(&format!("y[{}]", i + 1));
            assert!((found - angle).abs() < 1e-9, "channel {i} after step {step}: {found}, not {angle}");
        }
    }
    assert!(angles.iter().any(|angle| angle.abs() > 20.0), "{angles:?}");
}

#[test]
fn outputs_may_be_read_at_any_time_and_a_step_repeated() {
    let mut run = unwrapping(1);
    run.set("u[1]", 3.0);
    run.0.initialise().unwrap();
    run.step(0.1);
    let saved = run.0.block().clone();
    // Set and looked at, without a step: nothing is counted.
    for u in [-3.0, 0.5, -2.0, -3.0] {
        run.set("u[1]", u);
        run.0.evaluate();
    }
    assert!((run.get("y[1]") - (TAU - 3.0)).abs() < 1e-15);
    run.step(0.1);
    let once = run.get("y[1]");
    run.0.block_mut().copy_from(&saved);
    run.set("u[1]", -3.0);
    run.step(0.1);
    assert_eq!(run.get("y[1]").to_bits(), once.to_bits());
}

#[test]
fn in_model_exchange_turns_are_counted_at_completed_steps_without_events() {
    let mut run = unwrapping(1);
    run.0.initialise().unwrap();
    run.0.hand_over_integration();
    run.0.initialise().unwrap();
    run.0.begin_model_exchange().unwrap();
    let mut angle = 0.0;
    for k in 1..200 {
        angle += 1.0;
        run.0.set_time(0.01 * f64::from(k));
        run.set("u[1]", wrapped(angle));
        assert!(!run.0.complete_step().unwrap(), "no event is needed");
        run.0.evaluate();
        assert!((run.get("y[1]") - angle).abs() < 1e-12, "{angle}: {}", run.get("y[1]"));
    }
}

#[test]
fn an_angle_that_jumps_and_is_not_declared_is_reported_once() {
    for (angles, warnings) in [("", 1), ("angles = [1]", 0)] {
        for kind in ["pid", "ladrc"] {
            let order = if kind == "ladrc" { "order = 1" } else { "" };
            let mut run = made(&format!(
                "{}[structure]\nchannels = 2\n{order}\n{angles}\nunits = {{ y = ['rad', 'm'], u = ['N', 'N'] }}",
                head(kind)
            ));
            run.set("y[1]", 3.0);
            run.0.initialise().unwrap();
            let mut messages = Vec::new();
            for (angle, length) in [(3.1, 0.0), (3.1, 6.3), (-3.1, 0.0), (3.0, 0.0), (0.0, 0.0)] {
                run.set("y[1]", angle);
                run.set("y[2]", length);
                run.step(0.01);
                messages.extend(run.0.take_messages().filter(|message| message.category == "logAngleJump"));
            }
            assert_eq!(messages.len(), warnings, "{kind}: {messages:?}");
            for message in messages {
                assert!(message.text.contains("y[1]") && message.text.contains("declare it in angles"), "{message:?}");
            }
        }
    }
}
