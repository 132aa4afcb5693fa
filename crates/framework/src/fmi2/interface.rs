//! The C side of every function, under the names of the standard.
//!
//! Each function is what the exported one of the same name does; see [`export_fmi2`](crate::export_fmi2).

use std::ffi::{CStr, CString, c_char, c_int};

use super::access::Type;
use super::boundary::{array, array_mut, call, null, ok, string};
use super::build::Library;
use super::calls::{Answer, Function, Interface, Refused, Standard};
use super::describe;
use super::instance::Instance;
pub use super::kernel_interface::{do_steps, has_kernel, kernel_functions, take_kernel};
use super::logger::{Callback, ERROR, Logger};
pub use super::model_exchange_interface::{
    completed_integrator_step, enter_continuous_time_mode, enter_event_mode, get_continuous_states, get_derivatives,
    get_event_indicators, get_nominals_of_continuous_states, new_discrete_states, set_continuous_states, set_time,
};
use super::panics;
use super::resources;
use super::shared::Shared;
pub use super::status::{get_boolean_status, get_integer_status, get_real_status, get_status, get_string_status};
pub use super::types::Reply;
use super::types::{
    Boolean, CO_SIMULATION, CallbackFunctions, Component, FmuState, MODEL_EXCHANGE, Status, StringPointer, TRUE,
    ValueReference,
};

/// fmi2Instantiate
///
/// # Safety
/// The pointers conform to the standard: terminated strings, and callbacks with the right signatures.
#[allow(clippy::too_many_arguments)] // the standard's
pub unsafe fn instantiate(
    library: Library,
    instance_name: StringPointer,
    fmu_type: c_int,
    guid: StringPointer,
    resource_location: StringPointer,
    functions: *const CallbackFunctions,
    _visible: Boolean,
    logging_on: Boolean,
) -> Component {
    if functions.is_null() {
        return std::ptr::null_mut();
    }
    // SAFETY: not NULL, and by the standard a valid structure; strings as this function asks of its caller.
    let (callbacks, name, guid, location) =
        unsafe { (*functions, string(instance_name), string(guid), string(resource_location)) };
    let logger =
        || Logger::new(callbacks.logger.map(Callback::Fmi2), callbacks.component_environment, name.unwrap_or_default());
    made("fmi2Instantiate", &logger, || -> Answer<Instance> {
        if name.is_none_or(CStr::is_empty) {
            return Err("instanceName is NULL or empty".into());
        }
        let interface = match fmu_type {
            MODEL_EXCHANGE => Interface::ModelExchange,
            CO_SIMULATION => Interface::CoSimulation,
            _ => {
                let kinds = "0 (fmi2ModelExchange) or 1 (fmi2CoSimulation)";
                return Err(format!("fmuType = {fmu_type} must be {kinds}").into());
            }
        };
        let guid = guid.ok_or("fmuGUID is NULL")?.to_string_lossy();
        let location = location.map(CStr::to_bytes);
        let unit = Shared::of(resources::description(location)?, library)?;
        let mut instance = Instance::new(unit, (Standard::Fmi2, interface), &guid, logger())?;
        instance.set_debug_logging(logging_on != 0, &[])?;
        Ok(instance)
    })
}

/// An instance, or NULL and a message why there is none.
pub(crate) fn made(function: &str, logger: &dyn Fn() -> Logger, make: impl FnOnce() -> Answer<Instance>) -> Component {
    let reason = match panics::contain(make) {
        Ok(Ok(instance)) => return Box::into_raw(Box::new(instance)).cast(),
        Ok(Err(Refused(reason))) => reason,
        Err(fault) => format!("internal fault, please report it: {fault}"),
    };
    let mut logger = logger();
    logger.log(Status::Error, ERROR, &format!("{function}: {reason}"));
    if let Some(outbox) = logger.outbox() {
        outbox.send();
    }
    std::ptr::null_mut()
}

/// fmi2FreeInstance
///
/// # Safety
/// NULL, or what [`instantiate`] returned, which is not used again.
pub unsafe fn free_instance(component: Component) {
    if !component.is_null() {
        // SAFETY: made by Box::into_raw in `instantiate`, and by the standard freed once.
        let instance = unsafe { Box::from_raw(component.cast::<Instance>()) };
        let _ = panics::contain(move || drop(instance));
    }
}

/// fmi2SetDebugLogging
///
/// # Safety
/// `categories` is that of `count` strings.
pub unsafe fn set_debug_logging(c: Component, on: Boolean, count: usize, categories: *const StringPointer) -> Status {
    call(c, Function::SetDebugLogging, |instance| {
        // SAFETY: as this function asks of its caller.
        let categories =
            unsafe { array(categories, count) }.ok_or_else(|| null(instance, Function::SetDebugLogging))?;
        // SAFETY: likewise.
        let names: Option<Vec<&CStr>> = categories.iter().map(|&category| unsafe { string(category) }).collect();
        let names = names.ok_or_else(|| null(instance, Function::SetDebugLogging))?;
        // A name that isn't UTF-8 is that of no category; the message shows what can be shown of it.
        let names: Vec<_> = names.into_iter().map(CStr::to_string_lossy).collect();
        ok(instance.set_debug_logging(on != 0, &names.iter().map(AsRef::as_ref).collect::<Vec<_>>()))
    })
}

/// fmi2SetupExperiment
pub fn setup_experiment(
    c: Component,
    tolerance_defined: Boolean,
    tolerance: f64,
    start_time: f64,
    stop_time_defined: Boolean,
    stop_time: f64,
) -> Status {
    call(c, Function::SetupExperiment, |instance| {
        let tolerance = (tolerance_defined != 0).then_some(tolerance);
        ok(instance.setup_experiment(tolerance, start_time, (stop_time_defined != 0).then_some(stop_time)))
    })
}

/// fmi2EnterInitializationMode
pub fn enter_initialization_mode(c: Component) -> Status {
    call(c, Function::EnterInitializationMode, |instance| {
        instance.enter_initialization_mode();
        Ok(Status::Ok)
    })
}

/// fmi2ExitInitializationMode
pub fn exit_initialization_mode(c: Component) -> Status {
    call(c, Function::ExitInitializationMode, |instance| ok(instance.exit_initialization_mode()))
}

/// fmi2Terminate
pub fn terminate(c: Component) -> Status {
    call(c, Function::Terminate, |instance| {
        instance.terminate();
        Ok(Status::Ok)
    })
}

/// fmi2Reset
pub fn reset(c: Component) -> Status {
    call(c, Function::Reset, |instance| {
        instance.reset();
        Ok(Status::Ok)
    })
}

/// fmi2GetReal
///
/// # Safety
/// Both pointers are those of `count` elements.
pub unsafe fn get_real(c: Component, references: *const ValueReference, count: usize, values: *mut f64) -> Status {
    call(c, Function::GetReal, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array_mut(values, count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::GetReal))?;
        instance.get_real(references.iter().copied(), values)
    })
}

/// fmi2SetReal
///
/// # Safety
/// Both pointers are those of `count` elements.
pub unsafe fn set_real(c: Component, references: *const ValueReference, count: usize, values: *const f64) -> Status {
    call(c, Function::SetReal, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(values, count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::SetReal))?;
        ok(instance.set_real(references.iter().copied(), values))
    })
}

/// fmi2GetInteger and fmi2GetBoolean
///
/// # Safety
/// Both pointers are those of `count` elements.
pub unsafe fn get_discrete(
    c: Component,
    function: Function,
    references: *const ValueReference,
    count: usize,
    values: *mut c_int,
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array_mut(values, count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, function))?;
        let references = references.iter().copied();
        ok(instance.get_integer(function, type_of(function), references, |k, value| values[k] = value))
    })
}

/// fmi2SetInteger and fmi2SetBoolean
///
/// # Safety
/// Both pointers are those of `count` elements.
pub unsafe fn set_discrete(
    c: Component,
    function: Function,
    references: *const ValueReference,
    count: usize,
    values: *const c_int,
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(values, count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, function))?;
        let values = values.iter().map(|&value| i64::from(value));
        ok(instance.set_integer(function, type_of(function), references.iter().copied(), values))
    })
}

fn type_of(function: Function) -> Type {
    if matches!(function, Function::GetBoolean | Function::SetBoolean) { Type::Boolean } else { Type::Integer }
}

/// fmi2GetString and fmi2SetString: no unit has a String.
pub fn string_values(c: Component, function: Function, count: usize) -> Status {
    call(c, function, |_| match count {
        0 => Ok(Status::Ok),
        _ => Err(Refused(format!("{}: this FMU has no variable of type String", function.name()))),
    })
}

/// fmi2GetFMUstate
///
/// # Safety
/// `state` is that of a state that is NULL or was given by this function.
pub unsafe fn get_fmu_state(c: Component, state: *mut FmuState) -> Status {
    call(c, Function::GetFMUstate, |instance| {
        // SAFETY: as this function asks of its caller.
        let state = unsafe { state.as_mut() }.ok_or_else(|| null(instance, Function::GetFMUstate))?;
        *state = instance.get_state(*state as usize)? as FmuState;
        Ok(Status::Ok)
    })
}

/// fmi2SetFMUstate
pub fn set_fmu_state(c: Component, state: FmuState) -> Status {
    call(c, Function::SetFMUstate, |instance| ok(instance.set_state(state as usize)))
}

/// fmi2FreeFMUstate
///
/// # Safety
/// `state` is NULL or that of a state.
pub unsafe fn free_fmu_state(c: Component, state: *mut FmuState) -> Status {
    call(c, Function::FreeFMUstate, |instance| {
        // SAFETY: as this function asks of its caller.
        let Some(state) = (unsafe { state.as_mut() }) else { return Ok(Status::Ok) };
        if !state.is_null() {
            instance.free_state(*state as usize)?;
            *state = std::ptr::null_mut();
        }
        Ok(Status::Ok)
    })
}

/// fmi2SerializedFMUstateSize
///
/// # Safety
/// `size` is NULL or that of a size.
pub unsafe fn serialized_fmu_state_size(c: Component, state: FmuState, size: *mut usize) -> Status {
    call(c, Function::SerializedFMUstateSize, |instance| {
        // SAFETY: as this function asks of its caller.
        let size = unsafe { size.as_mut() }.ok_or_else(|| null(instance, Function::SerializedFMUstateSize))?;
        *size = instance.serialised_size(state as usize)?;
        Ok(Status::Ok)
    })
}

/// fmi2SerializeFMUstate
///
/// # Safety
/// `bytes` is that of `size` bytes.
pub unsafe fn serialize_fmu_state(c: Component, state: FmuState, bytes: *mut c_char, size: usize) -> Status {
    call(c, Function::SerializeFMUstate, |instance| {
        // SAFETY: as this function asks of its caller; c_char and u8 have the same layout.
        let bytes = unsafe { array_mut(bytes.cast::<u8>(), size) }
            .ok_or_else(|| null(instance, Function::SerializeFMUstate))?;
        let serialised = instance.serialise(state as usize)?;
        if bytes.len() < serialised.len() {
            let name = instance.called(Function::SerializeFMUstate);
            return Err(Refused(format!("{name}: {size} bytes are given, {} needed", serialised.len())));
        }
        bytes[..serialised.len()].copy_from_slice(&serialised);
        Ok(Status::Ok)
    })
}

/// fmi2DeSerializeFMUstate
///
/// # Safety
/// `bytes` is that of `size` bytes, `state` that of a state.
pub unsafe fn deserialize_fmu_state(c: Component, bytes: *const c_char, size: usize, state: *mut FmuState) -> Status {
    call(c, Function::DeSerializeFMUstate, |instance| {
        // SAFETY: as this function asks of its caller; c_char and u8 have the same layout.
        let (bytes, state) = unsafe { array(bytes.cast::<u8>(), size).zip(state.as_mut()) }
            .ok_or_else(|| null(instance, Function::DeSerializeFMUstate))?;
        *state = instance.deserialise(bytes)? as FmuState;
        Ok(Status::Ok)
    })
}

/// fmi2GetDirectionalDerivative
///
/// # Safety
/// `unknowns` and `result` are those of `unknown_count` elements, `knowns` and `seed` of `known_count`.
pub unsafe fn get_directional_derivative(
    c: Component,
    (unknowns, unknown_count): (*const ValueReference, usize),
    (knowns, known_count): (*const ValueReference, usize),
    seed: *const f64,
    result: *mut f64,
) -> Status {
    call(c, Function::GetDirectionalDerivative, |instance| {
        // SAFETY: as this function asks of its caller.
        let (of, by) = unsafe {
            let of = array(unknowns, unknown_count).zip(array_mut(result, unknown_count));
            (of, array(knowns, known_count).zip(array(seed, known_count)))
        };
        let ((unknowns, result), (knowns, seed)) =
            of.zip(by).ok_or_else(|| null(instance, Function::GetDirectionalDerivative))?;
        instance.get_directional_derivative(unknowns, knowns, seed, result)
    })
}

/// fmi2SetRealInputDerivatives
///
/// # Safety
/// All pointers are those of `count` elements.
pub unsafe fn set_real_input_derivatives(
    c: Component,
    references: *const ValueReference,
    count: usize,
    orders: *const c_int,
    values: *const f64,
) -> Status {
    call(c, Function::SetRealInputDerivatives, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(orders, count)).zip(array(values, count)) };
        let ((references, orders), values) = arrays.ok_or_else(|| null(instance, Function::SetRealInputDerivatives))?;
        ok(instance.set_input_derivatives(references, orders, values))
    })
}

/// fmi2GetRealOutputDerivatives
///
/// # Safety
/// All pointers are those of `count` elements.
pub unsafe fn get_real_output_derivatives(
    c: Component,
    references: *const ValueReference,
    count: usize,
    orders: *const c_int,
    values: *mut f64,
) -> Status {
    call(c, Function::GetRealOutputDerivatives, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(orders, count)).zip(array_mut(values, count)) };
        let ((references, orders), values) =
            arrays.ok_or_else(|| null(instance, Function::GetRealOutputDerivatives))?;
        instance.get_output_derivatives(references, orders, values)
    })
}

/// fmi2DoStep
pub fn do_step(c: Component, point: f64, step: f64) -> Status {
    call(c, Function::DoStep, |instance| instance.do_step(point, step))
}

/// fmi2CancelStep: never allowed.
pub fn cancel_step(c: Component) -> Status {
    call(c, Function::CancelStep, |_| Ok(Status::Ok))
}

/// Answers a question about what a description asks for; see [`super::describe`].
///
/// # Safety
/// `description` is NULL or a C string; `reply` may be called with `context`.
pub unsafe fn describe(
    library: Library,
    answer: describe::Answer,
    description: StringPointer,
    reply: Option<Reply>,
    context: *mut std::ffi::c_void,
) -> Boolean {
    let Some(reply) = reply else { return super::types::FALSE };
    // SAFETY: as this function asks of its caller.
    let description = unsafe { string(description) };
    let text = match description.map(CStr::to_str).transpose() {
        Ok(description) => describe::answered(answer, description, library),
        Err(error) => describe::failure(&format!("the description is not UTF-8: {error}")),
    };
    let Ok(text) = CString::new(text) else { return super::types::FALSE };
    // SAFETY: the caller's own function, with its own context; the text lives until it returns.
    super::floating_point::as_the_host(|| unsafe { reply(context, text.as_ptr()) });
    TRUE
}
