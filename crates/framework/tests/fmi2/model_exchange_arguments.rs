//! Model exchange with tunable parameters, wrong arguments, values that are no numbers, and saved states.

use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu_library::fmi2_functions::*;
use common::systems::*;
use common::*;

/// A controller at 0.1 s, in Event Mode.
fn controller() -> Unit {
    let unit = Unit::exchange("L1NonlinearSiso");
    let next = unit.begin();
    unit.put("r[1]", 1.0);
    unit.put("x[1]", 0.2);
    unit.integrate(0.0, 0.1, 1e-4, next);
    assert_eq!(unit.enter_event_mode(), OK);
    unit
}

fn update(unit: &Unit) -> Status {
    unit.try_new_discrete_states().map_or_else(|status| status, |_| OK)
}

#[test]
fn parameters_tuned_at_an_event_are_taken_over_together() {
    let unit = controller();
    let (p, derivatives) = (unit.get("P[2,2]"), unit.derivatives());
    unit.put("Q[1,1]", 8.0);
    unit.put("omega_min[1,1]", 8.0);
    assert_eq!((unit.get("Q[1,1]"), unit.get("P[2,2]")), (8.0, p), "set, but not in force");
    assert_eq!(unit.derivatives(), derivatives, "not in force");
    unit.put("Q[1,1]", 2.0);
    unit.put("Q[2,2]", 2.0);
    unit.put("omega_min[1,1]", 0.5);
    unit.put("x[1]", 0.3);
    let others = derivatives.iter().zip(unit.derivatives()).filter(|(a, b)| **a != *b).count();
    assert!(others > 0, "inputs are in force at once");
    assert!(unit.new_discrete_states().again);
    assert!((unit.get("P[2,2]") - 2.0 * p).abs() < 1e-12);
    let event = unit.new_discrete_states();
    assert!(!event.again && !event.states_changed);
}

#[test]
fn estimates_outside_tightened_bounds_are_brought_to_them_and_the_master_is_informed() {
    let unit = controller();
    let states = unit.states();
    assert!(unit.get("theta_hat[1,1]") != 0.0);
    unit.put("theta_bound[1]", 0.0);
    assert!(unit.new_discrete_states().states_changed);
    assert_eq!(unit.get("theta_hat[1,1]"), 0.0);
    assert_ne!(unit.states(), states);
    assert!(unit.messages().iter().any(|(_, category, _)| category == "logProjection"));
}

#[test]
fn a_set_that_is_invalid_is_refused_with_every_reason_and_the_last_one_stays() {
    let (unit, twin) = (controller(), controller());
    unit.put("omega_min[1,1]", 8.0);
    unit.put("A_m[2,1]", 1.0);
    assert_eq!(update(&unit), ERROR);
    let message = unit.last_message();
    ["fmi2NewDiscreteStates", "omega_min[1,1]", "Hurwitz"]
        .iter()
        .for_each(|part| assert!(message.contains(part), "`{message}` names {part}"));
    for unit in [&unit, &twin] {
        let next = unit.settle();
        unit.integrate(0.1, 0.15, 1e-4, next);
    }
    assert_eq!(unit.values(), twin.values());
    assert_eq!(unit.fingerprint(), twin.fingerprint(), "it goes on as if nothing had been tried");
}

#[test]
fn continuous_time_goes_on_only_with_parameters_that_are_in_force() {
    let unit = controller();
    unit.put("adaptation_gain", 2e5);
    unit.refuses(&["fmi2EnterContinuousTimeMode", "fmi2NewDiscreteStates"], Unit::enter_continuous_time_mode);
    unit.settle();
    unit.refuses(&["fmi2SetReal", "`adaptation_gain`", "tunable", "Event Mode"], |u| u.set("adaptation_gain", 1e5));
    unit.refuses(&["fmi2SetReal", "`relative_tolerance`", "fixed"], |u| u.set("relative_tolerance", 1e-7));
}

#[test]
fn a_threshold_that_is_tuned_across_its_input_is_an_event() {
    let unit = Unit::exchange_of::<Switch>("");
    unit.begin();
    assert_eq!(unit.enter_event_mode(), OK);
    unit.put("threshold", -0.5);
    assert!(unit.indicators()[0] < 0.0, "not in force");
    assert!(unit.new_discrete_states().again);
    assert_eq!((unit.get("side"), unit.indicators()), (1.0, vec![0.5]));
}

#[test]
fn wrong_arguments_are_refused_by_name_and_change_nothing() {
    let unit = Unit::exchange("NonlinearSiso");
    unit.begin();
    let c = unit.component;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let text = bad.to_string();
        unit.refuses(&["fmi2SetTime", &text], |unit| unit.set_time(bad));
        unit.refuses(&["fmi2SetContinuousStates", "`x[2]`", &text], |unit| unit.set_states(&[1.0, bad]));
        unit.refuses(&["fmi2SetReal", "`u[1]`", &text], |unit| unit.set("u[1]", bad));
    }
    for count in [0, 1, 3, 1000] {
        let (number, mut values) = (count.to_string(), vec![1.0; count]);
        unit.refuses(&["fmi2SetContinuousStates", &number, "has 2"], |unit| unit.set_states(&values));
        unit.refuses(&["fmi2GetDerivatives", &number, "has 2"], |unit| unit.try_derivatives(&mut values));
        let mut get = |name, function: unsafe extern "C-unwind" fn(Component, *mut f64, usize) -> Status| {
            unit.refuses(&[name, &number], |_| unsafe { function(c, values.as_mut_ptr(), count) });
        };
        get("fmi2GetContinuousStates", fmi2GetContinuousStates);
        get("fmi2GetNominalsOfContinuousStates", fmi2GetNominalsOfContinuousStates);
        if count > 0 {
            get("fmi2GetEventIndicators", fmi2GetEventIndicators);
        }
    }
    unsafe {
        unit.refuses(&["fmi2SetContinuousStates", "NULL"], |_| fmi2SetContinuousStates(c, null(), 2));
        unit.refuses(&["fmi2GetDerivatives", "NULL"], |_| fmi2GetDerivatives(c, null_mut(), 2));
        unit.refuses(&["fmi2CompletedIntegratorStep", "NULL"], |_| {
            fmi2CompletedIntegratorStep(c, TRUE, null_mut(), &mut 0)
        });
        unit.refuses(&["fmi2CompletedIntegratorStep", "NULL"], |_| {
            fmi2CompletedIntegratorStep(c, TRUE, &mut 0, null_mut())
        });
        assert_eq!(unit.enter_event_mode(), OK);
        unit.refuses(&["fmi2NewDiscreteStates", "NULL"], |_| fmi2NewDiscreteStates(c, null_mut()));
    }
}

#[test]
fn a_derivative_that_is_no_number_is_discarded_so_that_a_solver_can_come_back() {
    let unit = Unit::exchange_of::<Root>("");
    unit.begin();
    let mut derivative = [0.0];
    // A solver probes where the root is no number, and comes back with a smaller step.
    assert_eq!((unit.set_time(0.5), unit.set_states(&[-1e-3])), (OK, OK));
    assert_eq!(unit.try_derivatives(&mut derivative), DISCARD);
    let message = unit.last_message();
    ["fmi2GetDerivatives", "`der(level)`", "t = 0.5"]
        .iter()
        .for_each(|part| assert!(message.contains(part), "{message}"));
    assert_eq!(unit.try_get("rate", &mut 0.0), DISCARD);
    assert!(unit.last_message().contains("`rate`"));
    assert_eq!(unit.get("level"), -1e-3, "what is a number is given");
    assert_eq!(unit.set_states(&[4.0]), OK);
    assert_eq!((unit.derivatives(), unit.get("rate")), (vec![-2.0], -2.0));
    assert!(!unit.completed_step());
}

#[test]
fn a_step_that_ends_where_a_value_is_no_number_is_an_error() {
    let unit = Unit::exchange_of::<Root>("");
    unit.begin();
    assert_eq!((unit.set_time(0.5), unit.set_states(&[-1e-3])), (OK, OK));
    assert_eq!(unit.try_completed_step(&mut 0), ERROR);
    let message = unit.last_message();
    ["fmi2CompletedIntegratorStep", "rate", "t = 0.5"]
        .iter()
        .for_each(|part| assert!(message.contains(part), "{message}"));
    unit.refuses(&["restore a state or reset"], |unit| unit.set_time(0.4));
}

#[test]
fn a_step_that_ends_beyond_all_use_is_an_error_and_a_saved_state_brings_the_unit_back() {
    let unit = Unit::exchange("NonlinearSiso");
    unit.begin();
    let good = unit.save();
    assert_eq!((unit.set_time(0.5), unit.set_states(&[2e12, 0.0])), (OK, OK));
    assert_eq!(unit.try_completed_step(&mut 0), ERROR);
    let message = unit.last_message();
    ["x[1] = 2e12", "t = 0.5", "diverges"].iter().for_each(|part| assert!(message.contains(part), "{message}"));
    assert_eq!(unit.restore(good), OK);
    assert_eq!(unit.states(), [0.0, 0.0]);
    assert!(!unit.completed_step());
}

/// Goes on from wherever a unit stands; everything that can be seen of it.
fn go_on(unit: &Unit, t: f64, next: Option<f64>) -> (Vec<u64>, Vec<u8>) {
    unit.integrate(t, t + 0.7, 0.02, next);
    (unit.values(), unit.fingerprint())
}

#[test]
fn a_restored_unit_continues_bit_for_bit_in_continuous_time_mode() {
    for made in [|| Unit::exchange_of::<Ball>(""), || Unit::exchange("NonlinearSiso")] {
        let (unit, other) = (made(), made());
        let next = unit.integrate(0.0, 0.9, 0.02, unit.begin());
        let (state, bytes) = (unit.save(), unit.fingerprint());
        let expected = go_on(&unit, 0.9, next);
        assert_eq!(unit.restore(state), OK);
        assert_eq!(go_on(&unit, 0.9, next), expected);
        // From bytes, in a unit that was never initialised.
        let (status, state) = other.deserialise(&bytes);
        assert_eq!((status, other.restore(state)), (OK, OK));
        assert_eq!(go_on(&other, 0.9, next), expected);
    }
}

#[test]
fn a_unit_restored_within_an_event_finishes_it_alike() {
    let unit = controller();
    unit.put("adaptation_gain", 2e5);
    unit.put("theta_bound[1]", 0.0);
    let before = unit.save();
    let finish = |unit: &Unit| {
        let event = unit.new_discrete_states();
        (event, unit.settle(), unit.fingerprint())
    };
    let expected = finish(&unit);
    assert_eq!(unit.restore(before), OK);
    assert_eq!(unit.get("adaptation_gain"), 2e5, "still waiting");
    assert_eq!(finish(&unit), expected);
    // Between two updates of one event it is still known that states have jumped.
    assert_eq!(unit.restore(before), OK);
    assert!(unit.new_discrete_states().states_changed);
    let between = unit.save();
    unit.settle();
    assert_eq!(unit.restore(between), OK);
    assert!(unit.new_discrete_states().states_changed);
    assert!(unit.enter_continuous_time_mode() == OK && unit.enter_event_mode() == OK);
    assert!(!unit.new_discrete_states().states_changed, "another event");
}

#[test]
fn an_indicator_that_crossed_before_a_state_was_saved_is_an_event_after_it_was_restored() {
    let unit = Unit::exchange_of::<Switch>("");
    unit.begin();
    unit.put("u", 1.0);
    let state = unit.save();
    unit.put("u", 0.0);
    assert!(!unit.completed_step());
    assert_eq!(unit.restore(state), OK);
    assert!(unit.completed_step());
}

#[test]
fn a_state_of_the_other_interface_is_refused() {
    let exchange = Unit::exchange("NonlinearSiso");
    exchange.begin();
    let slave = Unit::started("NonlinearSiso");
    let of = |unit: &Unit| unit.fingerprint();
    exchange.refuses(&["fmi2DeSerializeFMUstate", "interface"], |unit| unit.deserialise(&of(&slave)).0);
    slave.refuses(&["fmi2DeSerializeFMUstate", "interface"], |unit| unit.deserialise(&of(&exchange)).0);
}
