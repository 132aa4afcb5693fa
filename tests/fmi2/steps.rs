//! Communication points and steps as masters really give them.

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
fn a_communication_point_where_the_unit_does_not_stand_is_refused() {
    let unit = started_clock();
    for point in [0.0, 0.5, 1.0 + 3e-6, 1.0 - 3e-6, 2.0, -1.0, f64::NAN, f64::INFINITY] {
        unit.refuses(&["fmi2DoStep", "currentCommunicationPoint", "t = 1 s"], |unit| unit.step(point, 1.0));
    }
}

#[test]
fn a_communication_point_within_a_millionth_of_the_step_is_accepted_and_adopted() {
    for shift in [0.9e-6, -0.9e-6] {
        let unit = started_clock();
        assert_eq!(unit.step(1.0 + shift, 1.0), OK, "{:?}", unit.messages());
        // The output is the time at which the unit believes to be.
        assert!((unit.get("r[1]") - (2.0 + shift)).abs() < 4e-16, "{:e}", unit.get("r[1]") - 2.0);
        assert_eq!(unit.last_successful_time().to_bits(), (1.0 + shift + 1.0_f64).to_bits());
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
    for step in [1.0 + 3e-6, 1.5, 1e9] {
        unit.refuses(&["fmi2DoStep", "stopTime = 2"], |unit| unit.step(1.0, step));
    }
    assert_eq!(unit.step(1.0, 1.0 + 0.9e-6), OK, "the slack of communication points: {:?}", unit.messages());
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
