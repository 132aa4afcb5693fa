//! Allowed calls: every function in every phase (see common::standard).

use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu_library::fmi2_functions::*;
use common::*;

/// A plant that runs to infinity within the first milliseconds.
const EXPLODING: &str = "[start]\nx0 = [1000.0, 1000.0]\n";

/// A co-simulation instance in the phase of this letter: Instantiated, initialization Mode, Step complete, step Failed,
/// Terminated, Error.
fn unit_in(phase: char) -> Unit {
    let unit = Unit::from_text(&(description("NonlinearSiso") + EXPLODING));
    if phase == 'F' {
        assert_eq!(unit.set_integer("on_step_failure", 2), OK);
    }
    if phase != 'I' {
        unit.enter(0.0);
    }
    if !"IM".contains(phase) {
        assert_eq!(unit.exit(), OK);
    }
    match phase {
        'F' => assert_eq!(unit.step(0.0, 1.0), DISCARD),
        'E' => assert_eq!(unit.step(0.0, 1.0), ERROR),
        'T' => assert_eq!(unit.terminate(), OK),
        _ => {}
    }
    unit
}

/// A model exchange instance in the phase of this letter: Instantiated, initialization Mode, eVent mode, Continuous-time
/// mode, Terminated, Error.
fn exchange_in(phase: char) -> Unit {
    let unit = Unit::exchange("NonlinearSiso");
    if phase != 'I' {
        unit.enter(0.0);
    }
    if !"IM".contains(phase) {
        assert_eq!(unit.exit(), OK);
    }
    if "CTE".contains(phase) {
        unit.settle();
    }
    match phase {
        'T' => assert_eq!(unit.terminate(), OK),
        'E' => {
            assert_eq!(unit.set_states(&[1e13, 0.0]), OK);
            assert_eq!(unit.try_completed_step(&mut 0), ERROR);
        }
        _ => {}
    }
    unit
}

/// Function, and a call of it with right arguments.
type Row = (&'static str, fn(&Unit) -> Status);

const VALUES: &[Row] = &[
    ("fmi2GetReal", |u| u.try_get("y[1]", &mut 0.0)),
    ("fmi2GetInteger", |u| unsafe { fmi2GetInteger(u.component, &u.reference("on_step_failure"), 1, &mut 0) }),
    ("fmi2GetBoolean", |u| unsafe { fmi2GetBoolean(u.component, null(), 0, null_mut()) }),
    ("fmi2GetString", |u| unsafe { fmi2GetString(u.component, null(), 0, null_mut()) }),
    ("fmi2SetReal", |u| u.set("u[1]", 0.5)),
    ("fmi2SetInteger", |u| unsafe { fmi2SetInteger(u.component, null(), 0, null()) }),
    ("fmi2SetBoolean", |u| unsafe { fmi2SetBoolean(u.component, null(), 0, null()) }),
    ("fmi2SetString", |u| unsafe { fmi2SetString(u.component, null(), 0, null()) }),
    ("fmi2SetRealInputDerivatives", |u| u.set_slope("u[1]", 0.5)),
    ("fmi2GetRealOutputDerivatives", |u| unsafe {
        fmi2GetRealOutputDerivatives(u.component, &u.reference("y[1]"), 1, &1, &mut 0.0)
    }),
];

const DERIVATIVES: &[Row] = &[("fmi2GetDirectionalDerivative", |u| unsafe {
    let (y, x) = (u.reference("y[1]"), u.reference("u[1]"));
    fmi2GetDirectionalDerivative(u.component, &y, 1, &x, 1, &1.0, &mut 0.0)
})];

const PROGRESS: &[Row] = &[
    ("fmi2SetDebugLogging", |u| unsafe { fmi2SetDebugLogging(u.component, TRUE, 0, null()) }),
    ("fmi2SetupExperiment", |u| u.setup(0.0, Some(1.0))),
    ("fmi2EnterInitializationMode", |u| unsafe { fmi2EnterInitializationMode(u.component) }),
    ("fmi2ExitInitializationMode", |u| u.exit()),
    ("fmi2DoStep", |u| u.step(0.0, 1e-6)),
    ("fmi2Terminate", |u| u.terminate()),
    ("fmi2Reset", |u| u.reset()),
    ("fmi2CancelStep", |u| unsafe { fmi2CancelStep(u.component) }),
];

const STATES: &[Row] = &[
    ("fmi2GetFMUstate", |u| unsafe { fmi2GetFMUstate(u.component, &mut null_mut()) }),
    ("fmi2SetFMUstate", |u| u.restore(u.save())),
    ("fmi2FreeFMUstate", |u| u.free(u.save())),
    ("fmi2SerializedFMUstateSize", |u| unsafe { fmi2SerializedFMUstateSize(u.component, u.save(), &mut 0) }),
    ("fmi2SerializeFMUstate", |u| {
        u.bytes(u.save());
        OK
    }),
    ("fmi2DeSerializeFMUstate", |u| u.deserialise(&u.fingerprint()).0),
];

const STATUS: &[Row] = &[
    ("fmi2GetStatus", |u| unsafe { fmi2GetStatus(u.component, status_kind::DO_STEP, &mut 0) }),
    ("fmi2GetRealStatus", |u| unsafe { fmi2GetRealStatus(u.component, status_kind::LAST_SUCCESSFUL_TIME, &mut 0.0) }),
    ("fmi2GetIntegerStatus", |u| unsafe { fmi2GetIntegerStatus(u.component, status_kind::DO_STEP, &mut 0) }),
    ("fmi2GetBooleanStatus", |u| unsafe { fmi2GetBooleanStatus(u.component, status_kind::TERMINATED, &mut 0) }),
    ("fmi2GetStringStatus", |u| unsafe { fmi2GetStringStatus(u.component, status_kind::PENDING, &mut null()) }),
];

const MODEL_EXCHANGE_ONLY: &[Row] = &[
    ("fmi2EnterEventMode", |u| unsafe { fmi2EnterEventMode(u.component) }),
    ("fmi2NewDiscreteStates", |u| u.try_new_discrete_states().map_or_else(|status| status, |_| OK)),
    ("fmi2EnterContinuousTimeMode", |u| unsafe { fmi2EnterContinuousTimeMode(u.component) }),
    ("fmi2CompletedIntegratorStep", |u| unsafe { fmi2CompletedIntegratorStep(u.component, TRUE, &mut 0, &mut 0) }),
    ("fmi2SetTime", |u| unsafe { fmi2SetTime(u.component, 0.0) }),
    ("fmi2SetContinuousStates", |u| unsafe { fmi2SetContinuousStates(u.component, [0.0; 2].as_ptr(), 2) }),
    ("fmi2GetDerivatives", |u| unsafe { fmi2GetDerivatives(u.component, [0.0; 2].as_mut_ptr(), 2) }),
    ("fmi2GetEventIndicators", |u| unsafe { fmi2GetEventIndicators(u.component, null_mut(), 0) }),
    ("fmi2GetContinuousStates", |u| unsafe { fmi2GetContinuousStates(u.component, [0.0; 2].as_mut_ptr(), 2) }),
    ("fmi2GetNominalsOfContinuousStates", |u| unsafe {
        fmi2GetNominalsOfContinuousStates(u.component, [0.0; 2].as_mut_ptr(), 2)
    }),
];

/// Every function of these rows in every phase: taken where it is allowed, refused without any effect elsewhere.
fn check(rows: &[Row]) {
    for (function, call) in rows {
        let allowed = |kind, phase| standard::phases(function, kind).contains(phase);
        let exchange = |phase| check_one(function, exchange_in(phase), allowed(MODEL_EXCHANGE, phase), call);
        "IMVCTE".chars().for_each(exchange);
        let slave = |phase| check_one(function, unit_in(phase), allowed(CO_SIMULATION, phase), call);
        "IMSFTE".chars().for_each(slave);
    }
}

fn check_one(function: &str, unit: Unit, allowed: bool, call: &fn(&Unit) -> Status) {
    if allowed {
        let message = |unit: &Unit| format!("{function}: {:?}", unit.messages());
        assert_ne!(call(&unit), ERROR, "{}", message(&unit));
    } else {
        unit.refuses(&[function], call);
    }
}

#[test]
fn no_function_is_left_out() {
    let groups = [VALUES, DERIVATIVES, PROGRESS, STATES, STATUS, MODEL_EXCHANGE_ONLY];
    let mut called: Vec<_> = groups.into_iter().flatten().map(|(function, _)| *function).collect();
    let mut known = standard::FUNCTIONS.map(|(function, ..)| function);
    called.sort_unstable();
    known.sort_unstable();
    assert_eq!(called, known);
}

#[test]
fn values_are_read_and_set_only_where_the_standard_allows_it() {
    check(VALUES);
}

#[test]
fn an_instance_goes_through_its_phases_only_in_the_order_of_the_standard() {
    check(PROGRESS);
}

#[test]
fn states_are_saved_and_restored_in_every_phase() {
    check(STATES);
}

#[test]
fn the_status_of_steps_is_given_once_there_can_be_steps() {
    check(STATUS);
}

#[test]
fn directional_derivatives_are_given_once_everything_is_initialised() {
    check(DERIVATIVES);
}

#[test]
fn functions_of_model_exchange_are_allowed_in_their_modes_and_refused_in_co_simulation() {
    check(MODEL_EXCHANGE_ONLY);
}

#[test]
fn a_function_of_the_other_interface_is_refused_with_both_interfaces() {
    let both = ["co-simulation", "model exchange"];
    exchange_in('C').refuses(&both, |unit| unit.step(0.0, 0.1));
    exchange_in('I').refuses(&both, |unit| unit.set_slope("u[1]", 0.5));
    unit_in('S').refuses(&both, |unit| unit.set_time(0.0));
}

#[test]
fn a_call_in_the_wrong_mode_is_refused_with_the_right_ones() {
    exchange_in('V').refuses(&["fmi2CompletedIntegratorStep", "Event Mode", "Continuous-Time Mode"], |unit| {
        unit.try_completed_step(&mut 0)
    });
    exchange_in('C').refuses(&["fmi2SetReal", "`omega`", "Event Mode"], |unit| unit.set("omega", 3.0));
    exchange_in('E').refuses(&["fmi2SetTime", "restore a state or reset"], |unit| unit.set_time(0.1));
}

#[test]
fn every_function_answers_a_null_instance_with_an_error() {
    let c = null_mut();
    for answer in unsafe {
        [
            fmi2DoStep(c, 0.0, 1.0, TRUE),
            fmi2GetReal(c, null(), 0, null_mut()),
            fmi2SetReal(c, null(), 0, null()),
            fmi2Reset(c),
            fmi2Terminate(c),
            fmi2GetFMUstate(c, &mut null_mut()),
            fmi2SetTime(c, 0.0),
            fmi2GetDirectionalDerivative(c, null(), 0, null(), 0, null(), null_mut()),
            fmi2GetStatus(c, 0, &mut 0),
        ]
    } {
        assert_eq!(answer, ERROR);
    }
    unsafe { fmi2FreeInstance(c) };
}

#[test]
fn a_step_after_an_error_is_refused_until_the_unit_is_reset() {
    let unit = unit_in('E');
    unit.refuses(&["fmi2DoStep", "restore a state or reset"], |unit| unit.step(0.0, 1e-6));
    assert_eq!(unit.reset(), OK);
    unit.put("x0[1]", 0.0);
    unit.put("x0[2]", 0.0);
    unit.start(0.0);
    assert_eq!(unit.step(0.0, 1.0), OK, "{:?}", unit.messages());
}

#[test]
fn a_terminated_unit_can_be_reset_and_run_again() {
    let unit = Unit::started("ReferenceNonlinearSiso");
    unit.run(0.0, 3, 0.5);
    assert_eq!(unit.terminate(), OK);
    unit.refuses(&["fmi2DoStep", "terminated"], |unit| unit.step(1.5, 0.5));
    assert_eq!(unit.reset(), OK);
    unit.start(0.0);
    unit.run(0.0, 3, 0.5);
    assert!((unit.get("r[1]") - 2.0 * (0.2_f64 * 1.5).cos()).abs() < 1e-15);
}

#[test]
fn a_unit_whose_step_has_failed_can_be_terminated_and_read() {
    for unit in [unit_in('E'), exchange_in('E')] {
        assert_eq!(unit.terminate(), OK, "{:?}", unit.messages());
        assert!(unit.get("y[1]").is_finite());
        unit.refuses(&["fmi2Terminate", "terminated"], |unit| unit.terminate());
    }
}
