//! Communication points and steps as masters really give them.

use adaptive_fmu::fmi2::types::Status;
use common::*;

/// A unit whose output is its own time.
fn clock() -> Unit {
    Unit::from_text(
        "name = \"Clock\"\nmodel = \"reference\"\ndescription = \"\"\n\
         [structure]\nchannels = 1\n[start]\nslope = [1.0]\n",
    )
}

fn started_clock() -> Unit {
    let unit = clock();
    unit.start(0.0);
    unit.run(0.0, 1, 1.0);
    unit
}

#[test]
fn a_step_that_is_not_above_zero_is_refused() {
    let unit = started_clock();
    for (step, text) in [(0.0, "0"), (-1.0, "-1"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")] {
        unit.refuses(&["fmi2DoStep", "communicationStepSize", text], |unit| unit.step(1.0, step));
    }
    // 1 + 1e-17 is 1: time would stand still.
    unit.refuses(&["fmi2DoStep", "communicationStepSize"], |unit| unit.step(1.0, 1e-17));
    assert_eq!(unit.step(1.0, 1.0), OK, "a refused step leaves the unit ready for the right one");
}

#[test]
fn a_communication_point_other_than_the_time_of_the_fmu_is_refused() {
    let unit = started_clock();
    for point in [0.0, 0.5, 1.0 + 3e-3, 1.0 - 3e-3, 2.0, -1.0, f64::NAN, f64::INFINITY] {
        unit.refuses(&["fmi2DoStep", "currentCommunicationPoint", "t = 1 s"], |unit| unit.step(point, 1.0));
    }
}

#[test]
fn a_communication_point_within_a_thousandth_of_the_step_is_accepted_and_adopted() {
    for shift in [0.9e-6, -0.9e-6, 0.9e-3, -0.9e-3] {
        let unit = started_clock();
        assert_eq!(unit.step(1.0 + shift, 1.0), OK, "{:?}", unit.messages());
        // The output is the time at which the unit believes to be.
        assert!((unit.get("r[1]") - (2.0 + shift)).abs() < 1e-15, "{:e}", unit.get("r[1]") - 2.0);
        assert_eq!(unit.last_successful_time().to_bits(), (1.0 + shift + 1.0_f64).to_bits());
    }
}

/// Log messages on communication points that aren't the sums of the steps.
fn messages_about_points(unit: &Unit) -> Vec<String> {
    let adopted = |(status, category, text): (i32, String, String)| {
        (status == Status::Warning as i32 && category == "logStatusWarning").then_some(text)
    };
    unit.messages().into_iter().filter_map(adopted).collect()
}

#[test]
fn clocks_of_single_precision_and_of_whole_microseconds_are_followed_and_logged_once() {
    let single = |t: f64| f64::from(t as f32);
    let microseconds = |t: f64| (t * 1e6).round() / 1e6;
    let clocks: [(&dyn Fn(f64) -> f64, f64); 3] =
        [(&single, 1e-3), (&single, 1.0 / 30.0), (&microseconds, 1.0 / 700.0)];
    for (read, step) in clocks {
        // With a start that such a clock can't represent exactly, and resets, an instance logs it once.
        let (unit, start) = (clock(), 0.7);
        for _ in 0..2 {
            unit.start(start);
            for k in 0..5000 {
                let t = read(start + f64::from(k) * step);
                assert_eq!(unit.step(t, step), OK, "{t}: {:?}", unit.messages());
                assert!((unit.get("r[1]") - (t + step)).abs() < 1e-12, "{t}");
            }
            assert_eq!(unit.reset(), OK);
        }
        let messages = messages_about_points(&unit);
        assert!(messages.len() == 1 && messages[0].contains("currentCommunicationPoint"), "{messages:?}");
    }
}

#[test]
fn a_master_that_adds_up_its_steps_needs_no_message() {
    let unit = clock();
    unit.start(0.0);
    for k in 0..100 {
        assert_eq!(unit.step(f64::from(k) * 0.1, 0.1), OK);
    }
    assert!(messages_about_points(&unit).is_empty(), "{:?}", unit.messages());
}

#[test]
fn a_communication_point_before_that_of_the_last_step_is_refused_however_long_the_step() {
    let unit = started_clock();
    assert_eq!(unit.step(1.0, 1e-4), OK);
    unit.refuses(&["fmi2DoStep", "0.9998 s is before that of the last step, 1 s", "t = 1.0001 s"], |unit| {
        unit.step(0.9998, 1.0)
    });
    assert_eq!(unit.step(1.00005, 1.0), OK, "between the last point and where the unit stands: {:?}", unit.messages());
    assert_eq!(unit.get("r[1]"), 2.00005);
    // Where a saved state is restored its last step is the last one.
    let state = unit.save();
    assert_eq!(unit.step(2.00005, 1e-5), OK);
    unit.refuses(&["before that of the last step"], |unit| unit.step(2.0, 0.1));
    assert_eq!(unit.restore(state), OK);
    assert_eq!(unit.step(2.0, 0.1), OK, "{:?}", unit.messages());
}

#[test]
fn no_message_on_a_communication_point_advises_to_go_back() {
    let unit = started_clock();
    for point in [0.0, 0.5, 2.0] {
        assert_eq!(unit.step(point, 1.0), ERROR);
        let message = unit.last_message();
        assert!(!message.contains("back") && !message.contains("restore"), "{message}");
        assert!(message.contains("within 0.001 of communicationStepSize = 1 s"), "{message}");
    }
}

#[test]
fn a_master_that_adds_up_its_times_and_one_that_multiplies_are_both_followed() {
    let (adding, multiplying) = (clock(), clock());
    adding.start(0.0);
    multiplying.start(0.0);
    let (step, mut t) = (0.1, 0.0);
    for k in 0..100_000 {
        assert_eq!(adding.step(t, step), OK, "{:?}", adding.messages());
        t += step;
        assert_eq!(multiplying.step(f64::from(k) * step, step), OK, "{:?}", multiplying.messages());
    }
    assert!((multiplying.get("r[1]") - 1e4).abs() < 4e-12, "{:e}", multiplying.get("r[1]") - 1e4);
}

#[test]
fn a_step_beyond_the_stop_time_is_refused() {
    let unit = clock();
    assert_eq!(unit.setup(0.0, Some(2.0)), OK);
    assert_eq!(unsafe { adaptive_fmu_library::fmi2_functions::fmi2EnterInitializationMode(unit.component) }, OK);
    assert_eq!(unit.exit(), OK);
    unit.run(0.0, 1, 1.0);
    for step in [1.0 + 3e-3, 1.5, 1e9] {
        unit.refuses(&["fmi2DoStep", "stopTime = 2"], |unit| unit.step(1.0, step));
    }
    assert_eq!(unit.step(1.0, 1.0 + 0.9e-3), OK, "the slack of communication points: {:?}", unit.messages());
}

#[test]
fn without_a_stop_time_there_is_no_end() {
    let unit = started_clock();
    assert_eq!(unit.step(1.0, 1e6), OK);
    assert_eq!(unit.get("r[1]"), 1e6 + 1.0);
}

#[test]
fn steps_may_have_any_lengths_one_after_the_other() {
    let unit = clock();
    unit.start(-3.0);
    let mut t = -3.0;
    for step in [1e-6, 2.0, 0.3, 1e-3, 100.0, 1e-9, 0.5] {
        assert_eq!(unit.step(t, step), OK, "{:?}", unit.messages());
        t += step;
        assert_eq!(unit.get("r[1]"), t);
        assert_eq!(unit.last_successful_time(), t);
    }
}
