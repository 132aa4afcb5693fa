//! Wrong arguments are refused without any effect, with a message that names the error, its place and reason.

use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi2_functions::*;
use common::*;

fn controller() -> Unit {
    let unit = Unit::started("L1NonlinearSiso");
    unit.put("r[1]", 1.0);
    unit.run(0.0, 3, 1e-3);
    unit
}

/// The first value reference behind all of the unit's.
fn beyond(unit: &Unit) -> u32 {
    unit.reference("on_step_failure") + 10_000
}

#[test]
fn an_unknown_value_reference_is_refused_by_every_function_that_takes_one() {
    let unit = controller();
    for reference in [beyond(&unit), u32::MAX] {
        let number = reference.to_string();
        let c = unit.component;
        unsafe {
            unit.refuses(&["fmi2GetReal", &number], |_| fmi2GetReal(c, &reference, 1, &mut 0.0));
            unit.refuses(&["fmi2SetReal", &number], |_| fmi2SetReal(c, &reference, 1, &0.0));
            unit.refuses(&["fmi2GetInteger", &number], |_| fmi2GetInteger(c, &reference, 1, &mut 0));
            unit.refuses(&["fmi2SetInteger", &number], |_| fmi2SetInteger(c, &reference, 1, &0));
            unit.refuses(&["fmi2GetBoolean", &number], |_| fmi2GetBoolean(c, &reference, 1, &mut 0));
            unit.refuses(&["fmi2SetBoolean", &number], |_| fmi2SetBoolean(c, &reference, 1, &0));
            unit.refuses(&["fmi2SetRealInputDerivatives", &number], |_| {
                fmi2SetRealInputDerivatives(c, &reference, 1, &1, &0.0)
            });
            unit.refuses(&["fmi2GetRealOutputDerivatives", &number], |_| {
                fmi2GetRealOutputDerivatives(c, &reference, 1, &1, &mut 0.0)
            });
        }
    }
}

#[test]
fn the_simulations_own_memory_has_no_value_reference() {
    let unit = controller();
    let shown: Vec<u32> = unit.model.variables().visible().map(|e| unit.reference(&e.name())).collect();
    let hidden = (0..*shown.iter().max().unwrap()).filter(|reference| !shown.contains(reference));
    for reference in hidden {
        let name = reference.to_string();
        unit.refuses(&["fmi2GetReal", &name], |unit| unit.get_reals(&[reference], &mut [0.0]));
        unit.refuses(&["fmi2SetReal", &name], |unit| unit.set_reals(&[reference], &[0.0]));
    }
}

#[test]
fn a_value_is_not_read_or_set_as_another_type() {
    let unit = controller();
    let (real, choice) = (unit.reference("r[1]"), unit.reference("input_handling"));
    let c = unit.component;
    unsafe {
        unit.refuses(&["fmi2GetInteger", "`r[1]`", "Real"], |_| fmi2GetInteger(c, &real, 1, &mut 0));
        unit.refuses(&["fmi2SetInteger", "`r[1]`", "Real"], |_| fmi2SetInteger(c, &real, 1, &1));
        unit.refuses(&["fmi2GetBoolean", "`r[1]`", "Real"], |_| fmi2GetBoolean(c, &real, 1, &mut 0));
        unit.refuses(&["fmi2GetReal", "`input_handling`", "Integer"], |_| fmi2GetReal(c, &choice, 1, &mut 0.0));
        unit.refuses(&["fmi2SetReal", "`input_handling`", "Integer"], |_| fmi2SetReal(c, &choice, 1, &1.0));
        unit.refuses(&["fmi2SetBoolean", "`input_handling`", "Integer"], |_| fmi2SetBoolean(c, &choice, 1, &1));
        unit.refuses(&["fmi2GetString", "String"], |_| fmi2GetString(c, &real, 1, &mut null()));
        unit.refuses(&["fmi2SetString", "String"], |_| fmi2SetString(c, &real, 1, &c"1".as_ptr()));
    }
}

#[test]
fn a_null_pointer_is_refused_and_never_followed() {
    let unit = controller();
    let (vr, c) = (unit.reference("r[1]"), unit.component);
    let state = unit.save();
    unsafe {
        unit.refuses(&["fmi2GetReal", "NULL"], |_| fmi2GetReal(c, null(), 1, &mut 0.0));
        unit.refuses(&["fmi2GetReal", "NULL"], |_| fmi2GetReal(c, &vr, 1, null_mut()));
        unit.refuses(&["fmi2SetReal", "NULL"], |_| fmi2SetReal(c, null(), 1, &0.0));
        unit.refuses(&["fmi2SetReal", "NULL"], |_| fmi2SetReal(c, &vr, 1, null()));
        unit.refuses(&["fmi2GetInteger", "NULL"], |_| fmi2GetInteger(c, &vr, 1, null_mut()));
        unit.refuses(&["fmi2SetBoolean", "NULL"], |_| fmi2SetBoolean(c, null(), 1, &1));
        unit.refuses(&["fmi2GetFMUstate", "NULL"], |_| fmi2GetFMUstate(c, null_mut()));
        unit.refuses(&["fmi2SetFMUstate"], |_| fmi2SetFMUstate(c, null_mut()));
        unit.refuses(&["fmi2SerializedFMUstateSize", "NULL"], |_| fmi2SerializedFMUstateSize(c, state, null_mut()));
        unit.refuses(&["fmi2SerializeFMUstate", "NULL"], |_| fmi2SerializeFMUstate(c, state, null_mut(), 99_999));
        unit.refuses(&["fmi2DeSerializeFMUstate", "NULL"], |_| fmi2DeSerializeFMUstate(c, null(), 9, &mut null_mut()));
        unit.refuses(&["fmi2DeSerializeFMUstate", "NULL"], |_| {
            fmi2DeSerializeFMUstate(c, [0; 9].as_ptr(), 9, null_mut())
        });
        unit.refuses(&["fmi2SetRealInputDerivatives", "NULL"], |_| {
            fmi2SetRealInputDerivatives(c, &vr, 1, null(), &0.0)
        });
        unit.refuses(&["fmi2GetRealOutputDerivatives", "NULL"], |_| {
            fmi2GetRealOutputDerivatives(c, &vr, 1, &1, null_mut())
        });
        unit.refuses(&["fmi2GetRealStatus", "NULL"], |_| {
            fmi2GetRealStatus(c, status_kind::LAST_SUCCESSFUL_TIME, null_mut())
        });
        unit.refuses(&["fmi2SetDebugLogging", "NULL"], |_| fmi2SetDebugLogging(c, TRUE, 2, null()));
        unit.refuses(&["fmi2SetDebugLogging", "NULL"], |_| fmi2SetDebugLogging(c, TRUE, 1, &null()));
    }
}

#[test]
fn no_values_at_all_are_always_right_even_from_null_pointers() {
    let unit = controller();
    let c = unit.component;
    let before = unit.fingerprint();
    for status in unsafe {
        [
            fmi2GetReal(c, null(), 0, null_mut()),
            fmi2SetReal(c, null(), 0, null()),
            fmi2GetInteger(c, null(), 0, null_mut()),
            fmi2SetInteger(c, null(), 0, null()),
            fmi2SetString(c, null(), 0, null()),
            fmi2SetRealInputDerivatives(c, null(), 0, null(), null()),
            fmi2GetRealOutputDerivatives(c, null(), 0, null(), null_mut()),
            fmi2FreeFMUstate(c, null_mut()),
            fmi2FreeFMUstate(c, &mut null_mut()),
        ]
    } {
        assert_eq!(status, OK, "{:?}", unit.messages());
    }
    assert_eq!(unit.fingerprint(), before);
}

#[test]
fn a_number_that_is_not_finite_is_refused_with_its_name_and_value() {
    let unit = controller();
    for (value, text) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf")] {
        for name in ["r[1]", "x[2]", "adaptation_gain", "A_m[2,1]"] {
            unit.refuses(&["fmi2SetReal", &format!("`{name}`"), text], |unit| unit.set(name, value));
        }
        unit.refuses(&["fmi2SetRealInputDerivatives", "`r[1]`", text], |unit| unit.set_slope("r[1]", value));
    }
}

#[test]
fn of_several_values_with_one_wrong_none_is_set() {
    let unit = controller();
    let [r, x, gain, u] = ["r[1]", "x[1]", "adaptation_gain", "u[1]"].map(|name| unit.reference(name));
    unit.refuses(&["`x[1]`"], |unit| unit.set_reals(&[r, gain, x], &[9.0, 9.0, f64::NAN]));
    unit.refuses(&["`u[1]`"], |unit| unit.set_reals(&[r, gain, u], &[9.0, 9.0, 9.0]));
    unit.refuses(&[&u32::MAX.to_string()], |unit| unit.set_reals(&[r, u32::MAX], &[9.0, 9.0]));
    let (orders, slopes) = ([1, 2], [9.0, 9.0]);
    unit.refuses(&["`x[1]`", "order 2"], |unit| unsafe {
        fmi2SetRealInputDerivatives(unit.component, [r, x].as_ptr(), 2, orders.as_ptr(), slopes.as_ptr())
    });
}

#[test]
fn of_several_values_with_one_wrong_none_is_read() {
    let unit = controller();
    let mut values = [7.0, 7.0];
    unit.refuses(&[&u32::MAX.to_string()], |unit| unit.get_reals(&[unit.reference("r[1]"), u32::MAX], &mut values));
    assert_eq!(values, [7.0, 7.0]);
}

#[test]
fn what_the_unit_calculates_is_not_set_in_any_phase() {
    let new = Unit::new("L1NonlinearSiso");
    let initialising = Unit::new("L1NonlinearSiso");
    initialising.enter(0.0);
    for unit in [new, initialising, controller()] {
        let calculated = unit
            .model
            .variables()
            .visible()
            .filter(|element| matches!(element.variable.causality, Causality::Output | Causality::Local))
            .filter(|element| element.variable.is_real());
        let names: Vec<_> = calculated.map(|element| element.name()).collect();
        assert!(["u[1]", "x_hat[1]", "P[1,1]"].iter().all(|name| names.iter().any(|n| n == name)));
        for name in names {
            unit.refuses(&["fmi2SetReal", &format!("`{name}`"), "calculated"], |unit| unit.set(&name, 1.0));
        }
    }
}

#[test]
fn a_choice_outside_its_items_is_refused_with_the_items() {
    let unit = Unit::new("ReferenceNonlinearSiso");
    for value in [0, 3, -1, i32::MAX, i32::MIN] {
        unit.refuses(&["fmi2SetInteger", "`signal`", &value.to_string(), "1 cosine", "2 square"], |unit| {
            unit.set_integer("signal", value)
        });
    }
    assert_eq!(unit.set_integer("signal", 2), OK);
}

#[test]
fn only_first_derivatives_of_inputs_and_outputs_exist() {
    let unit = controller();
    let (c, r, u) = (unit.component, unit.reference("r[1]"), unit.reference("u[1]"));
    for order in [0, 2, -1, i32::MAX] {
        let text = format!("order {order}");
        unit.refuses(&["fmi2SetRealInputDerivatives", "`r[1]`", &text], |_| unsafe {
            fmi2SetRealInputDerivatives(c, &r, 1, &order, &0.0)
        });
        unit.refuses(&["fmi2GetRealOutputDerivatives", "`u[1]`", &text], |_| unsafe {
            fmi2GetRealOutputDerivatives(c, &u, 1, &order, &mut 0.0)
        });
    }
    for name in ["u[1]", "adaptation_gain", "x_hat[1]"] {
        unit.refuses(&["fmi2SetRealInputDerivatives", &format!("`{name}`")], |unit| unit.set_slope(name, 0.0));
    }
    for name in ["r[1]", "adaptation_gain", "x_hat[1]"] {
        unit.refuses(&["fmi2GetRealOutputDerivatives", &format!("`{name}`")], |unit| unsafe {
            fmi2GetRealOutputDerivatives(unit.component, &unit.reference(name), 1, &1, &mut 0.0)
        });
    }
}

#[test]
fn an_experiment_needs_finite_times_in_order_and_a_tolerance_above_zero() {
    let unit = Unit::new("L1NonlinearSiso");
    let setup = |tolerance: Option<f64>, start: f64, stop: Option<f64>| {
        let flag = |option: Option<f64>| Boolean::from(option.is_some());
        let (t, s) = (tolerance.unwrap_or(0.0), stop.unwrap_or(0.0));
        move |unit: &Unit| unsafe { fmi2SetupExperiment(unit.component, flag(tolerance), t, start, flag(stop), s) }
    };
    unit.refuses(&["fmi2SetupExperiment", "startTime", "NaN"], setup(None, f64::NAN, None));
    unit.refuses(&["fmi2SetupExperiment", "startTime", "inf"], setup(None, f64::INFINITY, None));
    unit.refuses(&["fmi2SetupExperiment", "stopTime", "1"], setup(None, 2.0, Some(1.0)));
    unit.refuses(&["fmi2SetupExperiment", "stopTime", "NaN"], setup(None, 0.0, Some(f64::NAN)));
    unit.refuses(&["fmi2SetupExperiment", "tolerance", "-1"], setup(Some(-1.0), 0.0, None));
    unit.refuses(&["fmi2SetupExperiment", "tolerance", "0"], setup(Some(0.0), 0.0, None));
    unit.refuses(&["fmi2SetupExperiment", "tolerance", "NaN"], setup(Some(f64::NAN), 0.0, None));
    // What isn't defined is not looked at.
    let status = unsafe { fmi2SetupExperiment(unit.component, FALSE, f64::NAN, 0.0, FALSE, f64::NAN) };
    assert_eq!(status, OK);
}

#[test]
fn an_unknown_log_category_is_refused_with_the_known_ones() {
    let unit = controller();
    let categories = [c"logStatusError".as_ptr(), c"logNothing".as_ptr()];
    unit.refuses(&["fmi2SetDebugLogging", "`logNothing`", "logStatusError"], |unit| unsafe {
        fmi2SetDebugLogging(unit.component, TRUE, 2, categories.as_ptr())
    });
    assert_eq!(unsafe { fmi2SetDebugLogging(unit.component, TRUE, 1, categories.as_ptr()) }, OK);
}

#[test]
fn numbers_in_messages_can_be_read() {
    let unit = controller();
    unit.refuses(&["fmi2DoStep", "= -1e-300 must be"], |unit| unit.step(3e-3, -1e-300));
    unit.refuses(&["fmi2DoStep", "= 1e30 s, but the instance is at t = 0.003 s"], |unit| unit.step(1e30, 1e-3));
    unit.put("adaptation_gain", -1e-300);
    assert_eq!(unit.step(3e-3, 1e-3), ERROR);
    let message = unit.last_message();
    assert!(message.contains("adaptation_gain = -1e-300: must be"), "{message}");
}

#[test]
fn a_text_of_the_masters_with_line_ends_is_reported_in_one_line() {
    let unit = controller();
    let category = c"log\n100%\r\x1b".as_ptr();
    unit.refuses(&["fmi2SetDebugLogging", r"`log\n100%%\r"], |unit| unsafe {
        fmi2SetDebugLogging(unit.component, TRUE, 1, &category)
    });
}

#[test]
fn a_buffer_that_is_too_small_for_a_state_is_refused() {
    let unit = controller();
    let state = unit.save();
    let mut bytes = unit.bytes(state);
    let short = bytes.len() - 1;
    bytes.fill(7);
    unit.refuses(&["fmi2SerializeFMUstate", &short.to_string()], |unit| unsafe {
        fmi2SerializeFMUstate(unit.component, state, bytes.as_mut_ptr().cast(), short)
    });
    assert!(bytes.iter().all(|&byte| byte == 7), "nothing was written");
}
