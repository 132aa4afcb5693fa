//! The C side of every function of FMI 3.0, under the names of the standard.
//!
//! Each function is what the exported one of the same name does; see [`export_fmi2`](crate::export_fmi2), which exports both.

use std::ffi::{CStr, c_int, c_void};

use super::modes::Stepped;
use crate::fmi2::boundary::{array, array_mut, call, null, ok, string};
use crate::fmi2::build::Library;
use crate::fmi2::calls::{Answer, Function, Interface, Refused, Standard};
use crate::fmi2::instance::Instance;
pub use crate::fmi2::interface::free_instance;
use crate::fmi2::interface::made;
use crate::fmi2::logger::{Callback, Logger};
use crate::fmi2::resources;
use crate::fmi2::shared::Shared;
use crate::fmi2::types::{Component, LogMessage, Status, StringPointer, ValueReference};

/// Arguments that fmi3InstantiateModelExchange and fmi3InstantiateCoSimulation share.
#[derive(Debug, Clone, Copy)]
pub struct Asked {
    /// instanceName
    pub name: StringPointer,
    /// instantiationToken
    pub token: StringPointer,
    /// resourcePath
    pub resources: StringPointer,
    /// loggingOn
    pub logging: bool,
    /// instanceEnvironment
    pub environment: *mut c_void,
    /// logMessage
    pub log: Option<LogMessage>,
}

/// fmi3InstantiateModelExchange and fmi3InstantiateCoSimulation, these with eventModeUsed and earlyReturnAllowed.
///
/// # Safety
/// Pointers as in the standard: strings with their ends, a callback of the right signature.
pub unsafe fn instantiate(
    library: Library,
    interface: Interface,
    asked: Asked,
    (event_mode, early_return): (bool, bool),
) -> Component {
    let function = match interface {
        Interface::ModelExchange => "fmi3InstantiateModelExchange",
        Interface::CoSimulation => "fmi3InstantiateCoSimulation",
    };
    // SAFETY: as this function asks of its caller.
    let (name, token, location) = unsafe { (string(asked.name), string(asked.token), string(asked.resources)) };
    let logger = || Logger::new(asked.log.map(Callback::Fmi3), asked.environment, name.unwrap_or_default());
    made(function, &logger, || -> Answer<Instance> {
        if name.is_none_or(CStr::is_empty) {
            return Err("instanceName is NULL or empty".into());
        }
        let token = token.ok_or("instantiationToken is NULL")?.to_string_lossy();
        let described = resources::description(location.map(CStr::to_bytes))?;
        let unit = Shared::of(described, library)?;
        let mut instance = Instance::new(unit, (Standard::Fmi3, interface), &token, logger())?;
        instance.set_debug_logging(asked.logging, &[])?;
        if event_mode {
            instance.use_event_mode(early_return);
        }
        Ok(instance)
    })
}

/// fmi3InstantiateScheduledExecution: no FMU supports it.
///
/// # Safety
/// As [`instantiate`].
pub unsafe fn refuse_scheduled_execution(asked: Asked) -> Component {
    // SAFETY: as this function asks of its caller.
    let name = unsafe { string(asked.name) };
    let logger = || Logger::new(asked.log.map(Callback::Fmi3), asked.environment, name.unwrap_or_default());
    made("fmi3InstantiateScheduledExecution", &logger, || {
        Err("there is no scheduled execution: use co-simulation or model exchange".into())
    })
}

/// fmi3EnterInitializationMode
pub fn enter_initialization_mode(c: Component, tolerance: Option<f64>, start: f64, stop: Option<f64>) -> Status {
    call(c, Function::EnterInitializationMode, |instance| {
        instance.setup_experiment(tolerance, start, stop)?;
        instance.enter_initialization_mode();
        Ok(Status::Ok)
    })
}

/// fmi3EnterConfigurationMode
pub fn enter_configuration_mode(c: Component) -> Status {
    call(c, Function::EnterConfigurationMode, |instance| ok(instance.enter_configuration_mode()))
}

/// fmi3ExitConfigurationMode
pub fn exit_configuration_mode(c: Component) -> Status {
    call(c, Function::ExitConfigurationMode, |instance| ok(instance.exit_configuration_mode()))
}

/// fmi3GetUInt64
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn get_uint64(
    c: Component,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*mut u64, usize),
) -> Status {
    call(c, Function::GetUInt64, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array_mut(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::GetUInt64))?;
        ok(instance.get_uint64(references, values))
    })
}

/// fmi3SetUInt64, in Configuration Mode only.
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn set_uint64(
    c: Component,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*const u64, usize),
) -> Status {
    // Allowed in all phases: the instance reports which one it needs if it has such variables.
    call(c, Function::GetUInt64, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::SetUInt64))?;
        ok(instance.set_uint64(references, values))
    })
}

/// fmi3GetFloat64
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn get_float64(
    c: Component,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*mut f64, usize),
) -> Status {
    call(c, Function::GetReal, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array_mut(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::GetReal))?;
        instance.get_float64(references, values)
    })
}

/// fmi3SetFloat64
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn set_float64(
    c: Component,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*const f64, usize),
) -> Status {
    call(c, Function::SetReal, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, Function::SetReal))?;
        ok(instance.set_float64(references, values))
    })
}

/// Whole numbers of C: Int32, Int64 (enumerations) and Boolean.
pub trait Whole: Copy {
    /// Converts from an instance's value.
    fn of(value: i32) -> Self;
    /// Converts to a number that an instance takes.
    fn number(self) -> i64;
}

impl Whole for i32 {
    fn of(value: i32) -> Self {
        value
    }
    fn number(self) -> i64 {
        i64::from(self)
    }
}

impl Whole for i64 {
    fn of(value: i32) -> Self {
        i64::from(value)
    }
    fn number(self) -> i64 {
        self
    }
}

/// `fmi3Boolean`: a byte, since a master's may be any.
impl Whole for u8 {
    fn of(value: i32) -> Self {
        u8::from(value != 0)
    }
    fn number(self) -> i64 {
        i64::from(self)
    }
}

/// fmi3GetInt32, fmi3GetInt64 and fmi3GetBoolean
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn get_whole<T: Whole>(
    c: Component,
    function: Function,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*mut T, usize),
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array_mut(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, function))?;
        ok(instance.get_whole(function, references, values.len(), |k, value| values[k] = T::of(value)))
    })
}

/// fmi3SetInt32, fmi3SetInt64 and fmi3SetBoolean
///
/// # Safety
/// Both pointers point to the given number of elements.
pub unsafe fn set_whole<T: Whole>(
    c: Component,
    function: Function,
    (references, count): (*const ValueReference, usize),
    (values, values_count): (*const T, usize),
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(values, values_count)) };
        let (references, values) = arrays.ok_or_else(|| null(instance, function))?;
        ok(instance.set_whole(function, references, values.iter().map(|value| value.number())))
    })
}

/// Getters and setters of types that no unit has, which set and give nothing; functions of clocks.
pub fn no_such_type(c: Component, name: &str, kind: &str, count: usize) -> Status {
    // Allowed in the same phases: in all of them.
    call(c, Function::SetDebugLogging, |_| match count {
        0 => Ok(Status::Ok),
        _ => Err(Refused(format!("{name}: this FMU has no variable of type {kind}"))),
    })
}

/// fmi3GetFMUState, fmi3SetFMUState, fmi3FreeFMUState and their bytes are those of FMI 2.0.
pub use crate::fmi2::interface::{
    deserialize_fmu_state, free_fmu_state, get_fmu_state, serialize_fmu_state, serialized_fmu_state_size, set_fmu_state,
};

/// fmi3GetDirectionalDerivative and, with unknowns and knowns in other roles, fmi3GetAdjointDerivative
///
/// # Safety
/// All pointers point to the given numbers of elements.
pub unsafe fn get_derivative(
    c: Component,
    function: Function,
    (unknowns, unknown_count): (*const ValueReference, usize),
    (knowns, known_count): (*const ValueReference, usize),
    (seed, seed_count): (*const f64, usize),
    (result, result_count): (*mut f64, usize),
) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let (references, values) = unsafe {
            let references = array(unknowns, unknown_count).zip(array(knowns, known_count));
            (references, array(seed, seed_count).zip(array_mut(result, result_count)))
        };
        let ((unknowns, knowns), (seed, result)) = references.zip(values).ok_or_else(|| null(instance, function))?;
        match function {
            Function::GetAdjointDerivative => instance.get_adjoint((unknowns, seed), (knowns, result)),
            _ => instance.get_directional((unknowns, result), (knowns, seed)),
        }
    })
}

/// fmi3GetOutputDerivatives
///
/// # Safety
/// All pointers point to the given numbers of elements.
pub unsafe fn get_output_derivatives(
    c: Component,
    (references, count): (*const ValueReference, usize),
    orders: *const i32,
    (values, values_count): (*mut f64, usize),
) -> Status {
    call(c, Function::GetRealOutputDerivatives, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe { array(references, count).zip(array(orders, count)).zip(array_mut(values, values_count)) };
        let ((references, orders), values) =
            arrays.ok_or_else(|| null(instance, Function::GetRealOutputDerivatives))?;
        instance.get_derivatives_of_outputs(references, orders, values)
    })
}

/// fmi3EnterEventMode
pub fn enter_event_mode(c: Component) -> Status {
    call(c, Function::EnterEventMode, |instance| ok(instance.enter_event_mode_of_step()))
}

/// fmi3EnterStepMode
pub fn enter_step_mode(c: Component) -> Status {
    call(c, Function::EnterStepMode, |instance| ok(instance.enter_step_mode()))
}

/// fmi3EvaluateDiscreteStates
pub fn evaluate_discrete_states(c: Component) -> Status {
    call(c, Function::EvaluateDiscreteStates, |instance| {
        instance.evaluate_discrete_states();
        Ok(Status::Ok)
    })
}

/// The pointers of fmi3UpdateDiscreteStates.
#[derive(Debug, Clone, Copy)]
pub struct Updated {
    /// discreteStatesNeedUpdate
    pub needed: *mut bool,
    /// terminateSimulation
    pub terminate: *mut bool,
    /// nominalsOfContinuousStatesChanged
    pub nominals: *mut bool,
    /// valuesOfContinuousStatesChanged
    pub values: *mut bool,
    /// nextEventTimeDefined
    pub defined: *mut bool,
    /// nextEventTime
    pub time: *mut f64,
}

/// fmi3UpdateDiscreteStates
///
/// # Safety
/// Each pointer is NULL or that of its value.
pub unsafe fn update_discrete_states(c: Component, to: Updated) -> Status {
    call(c, Function::NewDiscreteStates, |instance| {
        let flags = [to.needed, to.terminate, to.nominals, to.values, to.defined];
        if flags.iter().any(|flag| flag.is_null()) || to.time.is_null() {
            return Err(null(instance, Function::NewDiscreteStates));
        }
        let info = instance.new_discrete_states()?;
        let (needed, values) = (info.new_discrete_states_needed != 0, info.values_changed != 0);
        let found = [needed, false, false, values, info.next_event_time_defined != 0];
        // SAFETY: not NULL, and as this function asks of its caller; what was there may be no Boolean.
        unsafe {
            flags.into_iter().zip(found).for_each(|(flag, value)| flag.write(value));
            to.time.write(info.next_event_time);
        }
        Ok(Status::Ok)
    })
}

/// fmi3CompletedIntegratorStep
///
/// # Safety
/// Both pointers are NULL or those of a Boolean.
pub unsafe fn completed_integrator_step(c: Component, enter_event_mode: *mut bool, terminate: *mut bool) -> Status {
    call(c, Function::CompletedIntegratorStep, |instance| {
        if enter_event_mode.is_null() || terminate.is_null() {
            return Err(null(instance, Function::CompletedIntegratorStep));
        }
        let enter = instance.completed_integrator_step()?;
        // SAFETY: not NULL, and as this function asks of its caller; what was there may be no Boolean.
        unsafe {
            enter_event_mode.write(enter);
            terminate.write(false);
        }
        Ok(Status::Ok)
    })
}

/// fmi3GetNumberOfContinuousStates and fmi3GetNumberOfEventIndicators
///
/// # Safety
/// `number` is NULL or that of a number.
pub unsafe fn get_number(c: Component, function: Function, number: *mut usize) -> Status {
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let number = unsafe { number.as_mut() }.ok_or_else(|| null(instance, function))?;
        *number = match function {
            Function::GetNumberOfEventIndicators => instance.event_indicators(),
            _ => instance.continuous_states(),
        };
        Ok(Status::Ok)
    })
}

/// fmi3GetNumberOfVariableDependencies
///
/// # Safety
/// `number` is NULL or that of a number.
pub unsafe fn get_number_of_dependencies(c: Component, reference: ValueReference, number: *mut usize) -> Status {
    let function = Function::GetNumberOfVariableDependencies;
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let number = unsafe { number.as_mut() }.ok_or_else(|| null(instance, function))?;
        *number = instance.dependencies(function, reference)?.len();
        Ok(Status::Ok)
    })
}

/// fmi3GetVariableDependencies
///
/// # Safety
/// All pointers are those of `count` elements.
pub unsafe fn get_dependencies(
    c: Component,
    dependent: ValueReference,
    (dependent_elements, independents): (*mut usize, *mut ValueReference),
    (independent_elements, kinds): (*mut usize, *mut c_int),
    count: usize,
) -> Status {
    let function = Function::GetVariableDependencies;
    call(c, function, |instance| {
        // SAFETY: as this function asks of its caller.
        let arrays = unsafe {
            let first = array_mut(dependent_elements, count).zip(array_mut(independents, count));
            first.zip(array_mut(independent_elements, count)).zip(array_mut(kinds, count))
        };
        let (((of, on), elements), kinds) = arrays.ok_or_else(|| null(instance, function))?;
        let found = instance.dependencies(function, dependent)?;
        if found.len() != count {
            let name = function.name_in(Standard::Fmi3);
            return Err(Refused(format!("{name}: nDependencies = {count}, but there are {}", found.len())));
        }
        for (k, one) in found.into_iter().enumerate() {
            (of[k], on[k]) = (one.dependent_element, one.independent);
            (elements[k], kinds[k]) = (one.independent_element, one.kind);
        }
        Ok(Status::Ok)
    })
}

/// fmi3DoStep
///
/// # Safety
/// Each pointer is NULL or that of its value.
pub unsafe fn do_step(
    c: Component,
    (point, step): (f64, f64),
    (event_needed, terminate, early_return): (*mut bool, *mut bool, *mut bool),
    last_time: *mut f64,
) -> Status {
    call(c, Function::DoStep, |instance| {
        if [event_needed, terminate, early_return].iter().any(|flag| flag.is_null()) || last_time.is_null() {
            return Err(null(instance, Function::DoStep));
        }
        let mut stepped = Stepped::default();
        let answer = instance.do_step_with_events(point, step, &mut stepped);
        // SAFETY: not NULL, and as this function asks of its caller; what was there may be no Boolean.
        unsafe {
            event_needed.write(stepped.event_needed);
            terminate.write(false);
            early_return.write(stepped.early_return);
            last_time.write(stepped.last_time);
        }
        answer
    })
}

/// fmi3SetDebugLogging, fmi3Terminate, fmi3Reset, and functions of model exchange that are those of FMI 2.0.
pub use crate::fmi2::interface::{
    enter_continuous_time_mode, exit_initialization_mode, get_continuous_states, get_derivatives, get_event_indicators,
    get_nominals_of_continuous_states, reset, set_continuous_states, set_debug_logging, set_time, terminate,
};
