//! Contacts: a motion that an event turns back. It bounces at its exact times, and where bounces accumulate or the contact
//! doesn't hold, the step ends in an error; nothing falls through the floor with OK.

use adaptive_fmu::error::StepError;
use common::contacts::*;
use common::models::Run;
use common::{ERROR, OK, Unit};

const METHODS: [&str; 3] = ["explicit", "stiff", "automatic"];

fn ball(way: Bounce, lines: &str) -> Run {
    Run::of::<NaiveBall>(&format!("way = {}\n{lines}", way as i32), 0.0)
}

/// Steps until an error, or until `end`; each end of a step is handed on.
fn run(run: &mut Run, step: f64, end: f64, mut look: impl FnMut(&Run)) -> Option<StepError> {
    while run.0.time() < end {
        if let Err(error) = run.0.step(run.0.time(), step) {
            return Some(error);
        }
        look(run);
    }
    None
}

#[test]
fn a_ball_that_never_rests_bounces_right_until_its_bounces_accumulate_and_then_ends_in_an_error() {
    for way in BOUNCES {
        for (restitution, steps) in
            [(0.7, &[1e-4, 1e-3, 0.0137, 0.1, 1.0, 10.0][..]), (0.2, &[0.01, 10.0]), (0.9, &[0.1])]
        {
            for &step in steps {
                for (method, tolerance) in METHODS.iter().zip([1e-3, 1e-6, 1e-9]) {
                    let case = format!("{way:?}, restitution {restitution}, step {step}, {method} at {tolerance}");
                    let lines = format!(
                        "restitution = {restitution}\nrelative_tolerance = {tolerance}\nintegration_method = \"{method}\""
                    );
                    let end = end_of_bounces(restitution);
                    let error = run(&mut ball(way, &lines), step, 2.0 * end, |run| {
                        let (bounces, last, height) = exact_naive_ball(run.0.time(), restitution);
                        let off = (run.get("height") - height).abs();
                        assert!(off < 1e-8, "{case}, t = {}: height off by {off}", run.0.time());
                        // The last bounces are shorter than the resolution of time.
                        if end - run.0.time() > 1e-6 {
                            assert_eq!(run.get("bounces"), bounces, "{case}, t = {}", run.0.time());
                            assert!((run.get("last") - last).abs() < 1e-8, "{case}");
                        }
                    });
                    let error = error.unwrap_or_else(|| panic!("{case}: the ball has fallen through the floor"));
                    let StepError::Accumulation { indicator, events, time, .. } = &error else {
                        panic!("{case}: {error}")
                    };
                    assert_eq!(indicator, "event indicator 1", "{case}");
                    assert!((time - end).abs() < 1e-8 && *events > 14, "{case}: {error}");
                }
            }
        }
    }
}

#[test]
fn a_floor_far_from_zero_holds_as_well_or_the_step_ends_in_an_error() {
    for way in BOUNCES {
        for step in [1e-3, 0.1, 10.0] {
            let mut ball = ball(way, "floor = 1000.0");
            run(&mut ball, step, 2.6, |run| {
                let (_, _, height) = exact_naive_ball(run.0.time(), 0.7);
                let expected = if run.0.time() > end_of_bounces(0.7) { 0.0 } else { height };
                let off = (run.get("height") - 1000.0 - expected).abs();
                assert!(off < 1e-5, "{way:?}, step {step}, t = {}: off by {off}", run.0.time());
            });
        }
    }
}

#[test]
fn a_cart_does_not_pass_its_end_stop() {
    for (restitution, expected) in [(0.0, "goes on through"), (1e-9, "end stop"), (0.5, "accumulate")] {
        for step in [1e-3, 0.1, 10.0] {
            for method in METHODS {
                let lines = format!("restitution = {restitution}\nintegration_method = \"{method}\"");
                let mut cart = Run::of::<Cart>(&lines, 0.0);
                let error = run(&mut cart, step, 20.0, |run| assert!(run.get("position") < 1.0 + 1e-8));
                let message = error.expect("the cart must not pass its end stop").to_string();
                assert!(message.contains(expected) && message.contains("event indicator 1 (end stop)"), "{message}");
                assert!(message.contains("discrete variable"), "{message}");
            }
        }
    }
}

#[test]
fn a_cart_at_its_end_stop_is_not_pushed_through_later() {
    for step in [0.01, 0.5, 5.0] {
        let mut cart = Run::of::<Cart>("force = 0.0\nspeed_0 = 1.0", 0.0);
        assert_eq!(run(&mut cart, step, 5.0, |_| ()), None);
        assert_eq!((cart.get("hits"), cart.get("speed")), (1.0, 0.0), "it stands at its end stop");
        // Away from it and back is allowed, through it isn't.
        for (force, error) in [(-1.0, false), (4.0, true)] {
            cart.set("force", force);
            let end = cart.0.time() + 5.0;
            let found = run(&mut cart, step, end, |run| assert!(run.get("position") < 1.0 + 1e-8));
            assert_eq!(found.is_some(), error, "{found:?}");
        }
        let mut cart = Run::of::<Cart>("force = 0.0\nspeed_0 = 1.0", 0.0);
        run(&mut cart, step, 5.0, |_| ());
        cart.set("force", 1e-3);
        let message = run(&mut cart, step, 10.0, |_| ()).expect("pushed through").to_string();
        assert!(message.contains("event 2 of event indicator 1 (end stop)"), "{message}");
    }
}

#[test]
fn a_level_is_passed_a_wall_breaks_and_a_mass_is_taken_up_without_an_error() {
    // Events that change the speed, or other states, and let the motion through.
    for (part, taken_up) in [(1.0, 0.0), (0.5, 0.0), (1e-3, 0.0), (1.0, 2.0)] {
        for step in [0.01_f64, 10.0] {
            let mut run = Run::of::<Level>(&format!("kept = {part}\ntaken_up = {taken_up}"), 0.0);
            run.run((10.0 / step) as usize, step);
            assert!((run.get("x") - (1.0 + 9.0 * part)).abs() < 1e-6, "{part}, {step}: {}", run.get("x"));
            assert_eq!((run.get("passed"), run.get("mass")), (1.0, 1.0 + taken_up));
        }
    }
}

#[test]
fn a_crossing_and_a_return_within_one_substep_are_both_found() {
    // Thrown so high that it is above 1 m between two times, in steps whose ends are all below.
    for apex in [1.5_f64, 1.1, 1.001, 1.000_01] {
        for step in [10.0_f64, 1.0, 0.5, 0.33, 0.1, 0.01] {
            for method in METHODS {
                let speed = (2.0 * GRAVITY * apex).sqrt();
                let lines = format!("speed_0 = {speed}\nintegration_method = \"{method}\"");
                let mut thrown = Run::of::<Thrown>(&lines, 0.0);
                thrown.run((1.5 / step).ceil() as usize, step);
                let half = (2.0 * (apex - 1.0) / GRAVITY).sqrt();
                let [above, below] = [speed / GRAVITY - half, speed / GRAVITY + half];
                let found = [thrown.get("above_at"), thrown.get("below_at")];
                let off = (found[0] - above).abs().max((found[1] - below).abs());
                assert!(off < 1e-6, "apex {apex}, step {step}, {method}: {found:?}, not {above} and {below}");
            }
        }
    }
}

#[test]
fn a_ball_that_never_rests_ends_in_an_error_in_model_exchange_too() {
    for way in BOUNCES {
        let unit = Unit::exchange_of::<NaiveBall>(&format!("way = {}", way as i32));
        let next = unit.begin();
        unit.integrate(0.0, 2.5, 1e-3, next);
        let (bounces, last, height) = exact_naive_ball(2.5, 0.7);
        assert_eq!(unit.get("bounces"), bounces, "{way:?}");
        assert!((unit.get("last") - last).abs() < 1e-9 && (unit.get("height") - height).abs() < 1e-8, "{way:?}");
        // From then on the master only looks where its steps end.
        let mut refused = None;
        for k in 0..2000 {
            unit.runge_kutta(2.5 + 1e-3 * f64::from(k), 1e-3);
            if unit.completed_step() {
                assert_eq!(unit.enter_event_mode(), OK);
                while let answer = unit.try_new_discrete_states()
                    && refused.is_none()
                {
                    match answer {
                        Err(status) => refused = Some(status),
                        Ok(event) if event.again => {}
                        Ok(_) => break,
                    }
                }
                if refused.is_some() {
                    break;
                }
                assert_eq!(unit.enter_continuous_time_mode(), OK);
            }
            assert!(unit.get("height").abs() < 0.05, "{way:?}: {}", unit.get("height"));
        }
        // A ball that is put onto the floor only bounces on, as high as it falls in a step.
        assert!(refused == Some(ERROR) || way == Bounce::Placed, "{way:?}");
    }
}

#[test]
fn a_contact_that_does_not_hold_is_an_error_in_model_exchange_too() {
    let unit = Unit::exchange_of::<Cart>("");
    unit.begin();
    unit.runge_kutta(0.0, 1.5);
    assert!(unit.get("position") > 1.0 && unit.completed_step());
    unit.enter_event_mode();
    assert_eq!(unit.try_new_discrete_states(), Err(ERROR));
    assert!(unit.last_message().contains("goes on through"), "{}", unit.last_message());
}
