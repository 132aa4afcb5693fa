//! The macro that defines the C functions of FMI 3.0 in a library that has those of FMI 2.0.

/// The functions of FMI 3.0, for a library.
#[doc(hidden)]
#[macro_export]
macro_rules! define_fmi3_functions {
    () => {
        /// The functions of FMI 3.0, as the standard names them.
        #[allow(non_snake_case, missing_docs, clippy::missing_safety_doc, clippy::too_many_arguments, unsafe_code)]
        pub mod fmi3_functions {
            use std::ffi::{c_int, c_void};
            use super::fmi2_functions::library;
            use $crate::fmi2::calls::{Function, Interface};
            use $crate::fmi2::fmi3::interface::{self as fmi3, Asked, Updated};
            use $crate::fmi2::types::{Component, FmuState, LogMessage, Status, StringPointer, ValueReference};

            // Their references, number of these, values and number of these.
            type R = *const ValueReference;

            $crate::define_fmi2_functions! { @function
                // SAFETY of every call below: the master keeps to the standard's rules about pointers, which are
                // those that the called function states. A Boolean of C is a byte, 0 or 1.
                fn fmi3GetVersion() -> StringPointer { c"3.0".as_ptr() }
                fn fmi3SetDebugLogging(c: Component, on: bool, n: usize, categories: *const StringPointer) -> Status
                { fmi3::set_debug_logging(c, on.into(), n, categories) }
                fn fmi3InstantiateModelExchange(name: StringPointer, token: StringPointer, resources: StringPointer,
                    _visible: bool, logging: bool, environment: *mut c_void, log: Option<LogMessage>) -> Component
                { fmi3::instantiate(library(), Interface::ModelExchange,
                    Asked { name, token, resources, logging, environment, log }, (false, false)) }
                fn fmi3InstantiateCoSimulation(name: StringPointer, token: StringPointer, resources: StringPointer,
                    _visible: bool, logging: bool, event_mode: bool, early_return: bool, _intermediate: R, _n: usize,
                    environment: *mut c_void, log: Option<LogMessage>, _update: *const c_void) -> Component
                { fmi3::instantiate(library(), Interface::CoSimulation,
                    Asked { name, token, resources, logging, environment, log }, (event_mode, early_return)) }
                fn fmi3InstantiateScheduledExecution(name: StringPointer, token: StringPointer, resources: StringPointer,
                    _visible: bool, logging: bool, environment: *mut c_void, log: Option<LogMessage>,
                    _update: *const c_void, _lock: *const c_void, _unlock: *const c_void) -> Component
                { fmi3::refuse_scheduled_execution(Asked { name, token, resources, logging, environment, log }) }
                fn fmi3FreeInstance(c: Component) -> () { fmi3::free_instance(c) }
                fn fmi3EnterInitializationMode(c: Component, tolerance_defined: bool, tolerance: f64, start: f64,
                    stop_defined: bool, stop: f64) -> Status
                { fmi3::enter_initialization_mode(c, tolerance_defined.then_some(tolerance), start, stop_defined.then_some(stop)) }
                fn fmi3ExitInitializationMode(c: Component) -> Status { fmi3::exit_initialization_mode(c) }
                fn fmi3EnterEventMode(c: Component) -> Status { fmi3::enter_event_mode(c) }
                fn fmi3Terminate(c: Component) -> Status { fmi3::terminate(c) }
                fn fmi3Reset(c: Component) -> Status { fmi3::reset(c) }
                fn fmi3GetFloat64(c: Component, vr: R, n: usize, v: *mut f64, m: usize) -> Status
                { fmi3::get_float64(c, (vr, n), (v, m)) }
                fn fmi3SetFloat64(c: Component, vr: R, n: usize, v: *const f64, m: usize) -> Status
                { fmi3::set_float64(c, (vr, n), (v, m)) }
                fn fmi3GetInt32(c: Component, vr: R, n: usize, v: *mut i32, m: usize) -> Status
                { fmi3::get_whole(c, Function::GetInteger, (vr, n), (v, m)) }
                fn fmi3SetInt32(c: Component, vr: R, n: usize, v: *const i32, m: usize) -> Status
                { fmi3::set_whole(c, Function::SetInteger, (vr, n), (v, m)) }
                fn fmi3GetInt64(c: Component, vr: R, n: usize, v: *mut i64, m: usize) -> Status
                { fmi3::get_whole(c, Function::GetEnumeration, (vr, n), (v, m)) }
                fn fmi3SetInt64(c: Component, vr: R, n: usize, v: *const i64, m: usize) -> Status
                { fmi3::set_whole(c, Function::SetEnumeration, (vr, n), (v, m)) }
                fn fmi3GetBoolean(c: Component, vr: R, n: usize, v: *mut u8, m: usize) -> Status
                { fmi3::get_whole(c, Function::GetBoolean, (vr, n), (v, m)) }
                fn fmi3SetBoolean(c: Component, vr: R, n: usize, v: *const u8, m: usize) -> Status
                { fmi3::set_whole(c, Function::SetBoolean, (vr, n), (v, m)) }
                fn fmi3GetBinary(c: Component, _vr: R, n: usize, _sizes: *mut usize, _v: *mut c_void, _m: usize) -> Status
                { fmi3::no_such_type(c, "fmi3GetBinary", "Binary", n) }
                fn fmi3SetBinary(c: Component, _vr: R, n: usize, _sizes: *const usize, _v: *const c_void, _m: usize) -> Status
                { fmi3::no_such_type(c, "fmi3SetBinary", "Binary", n) }
                fn fmi3GetClock(c: Component, _vr: R, n: usize, _v: *mut c_void) -> Status
                { fmi3::no_such_type(c, "fmi3GetClock", "Clock", n) }
                fn fmi3SetClock(c: Component, _vr: R, n: usize, _v: *const c_void) -> Status
                { fmi3::no_such_type(c, "fmi3SetClock", "Clock", n) }
                fn fmi3GetIntervalDecimal(c: Component, _vr: R, n: usize, _v: *mut f64, _q: *mut c_int) -> Status
                { fmi3::no_such_type(c, "fmi3GetIntervalDecimal", "Clock", n) }
                fn fmi3GetIntervalFraction(c: Component, _vr: R, n: usize, _v: *mut u64, _r: *mut u64, _q: *mut c_int) -> Status
                { fmi3::no_such_type(c, "fmi3GetIntervalFraction", "Clock", n) }
                fn fmi3GetShiftDecimal(c: Component, _vr: R, n: usize, _v: *mut f64) -> Status
                { fmi3::no_such_type(c, "fmi3GetShiftDecimal", "Clock", n) }
                fn fmi3GetShiftFraction(c: Component, _vr: R, n: usize, _v: *mut u64, _r: *mut u64) -> Status
                { fmi3::no_such_type(c, "fmi3GetShiftFraction", "Clock", n) }
                fn fmi3SetIntervalDecimal(c: Component, _vr: R, n: usize, _v: *const f64) -> Status
                { fmi3::no_such_type(c, "fmi3SetIntervalDecimal", "Clock", n) }
                fn fmi3SetIntervalFraction(c: Component, _vr: R, n: usize, _v: *const u64, _r: *const u64) -> Status
                { fmi3::no_such_type(c, "fmi3SetIntervalFraction", "Clock", n) }
                fn fmi3SetShiftDecimal(c: Component, _vr: R, n: usize, _v: *const f64) -> Status
                { fmi3::no_such_type(c, "fmi3SetShiftDecimal", "Clock", n) }
                fn fmi3SetShiftFraction(c: Component, _vr: R, n: usize, _v: *const u64, _r: *const u64) -> Status
                { fmi3::no_such_type(c, "fmi3SetShiftFraction", "Clock", n) }
                fn fmi3ActivateModelPartition(c: Component, _clock: ValueReference, _time: f64) -> Status
                { fmi3::no_such_type(c, "fmi3ActivateModelPartition", "Clock", 1) }
                fn fmi3GetNumberOfVariableDependencies(c: Component, vr: ValueReference, n: *mut usize) -> Status
                { fmi3::get_number_of_dependencies(c, vr, n) }
                fn fmi3GetVariableDependencies(c: Component, vr: ValueReference, elements: *mut usize,
                    on: *mut ValueReference, of: *mut usize, kinds: *mut c_int, n: usize) -> Status
                { fmi3::get_dependencies(c, vr, (elements, on), (of, kinds), n) }
                fn fmi3GetFMUState(c: Component, state: *mut FmuState) -> Status { fmi3::get_fmu_state(c, state) }
                fn fmi3SetFMUState(c: Component, state: FmuState) -> Status { fmi3::set_fmu_state(c, state) }
                fn fmi3FreeFMUState(c: Component, state: *mut FmuState) -> Status { fmi3::free_fmu_state(c, state) }
                fn fmi3SerializedFMUStateSize(c: Component, state: FmuState, size: *mut usize) -> Status
                { fmi3::serialized_fmu_state_size(c, state, size) }
                fn fmi3SerializeFMUState(c: Component, state: FmuState, bytes: *mut u8, size: usize) -> Status
                { fmi3::serialize_fmu_state(c, state, bytes.cast(), size) }
                fn fmi3DeserializeFMUState(c: Component, bytes: *const u8, size: usize, state: *mut FmuState) -> Status
                { fmi3::deserialize_fmu_state(c, bytes.cast(), size, state) }
                fn fmi3GetDirectionalDerivative(c: Component, unknowns: R, n: usize, knowns: R, m: usize, seed: *const f64,
                    seeds: usize, result: *mut f64, results: usize) -> Status
                { fmi3::get_derivative(c, Function::GetDirectionalDerivative, (unknowns, n), (knowns, m), (seed, seeds), (result, results)) }
                fn fmi3GetAdjointDerivative(c: Component, unknowns: R, n: usize, knowns: R, m: usize, seed: *const f64,
                    seeds: usize, result: *mut f64, results: usize) -> Status
                { fmi3::get_derivative(c, Function::GetAdjointDerivative, (unknowns, n), (knowns, m), (seed, seeds), (result, results)) }
                fn fmi3GetUInt64(c: Component, vr: R, n: usize, v: *mut u64, m: usize) -> Status
                { fmi3::get_uint64(c, (vr, n), (v, m)) }
                fn fmi3SetUInt64(c: Component, vr: R, n: usize, v: *const u64, m: usize) -> Status
                { fmi3::set_uint64(c, (vr, n), (v, m)) }
                fn fmi3EnterConfigurationMode(c: Component) -> Status { fmi3::enter_configuration_mode(c) }
                fn fmi3ExitConfigurationMode(c: Component) -> Status { fmi3::exit_configuration_mode(c) }
                fn fmi3EvaluateDiscreteStates(c: Component) -> Status { fmi3::evaluate_discrete_states(c) }
                fn fmi3UpdateDiscreteStates(c: Component, needed: *mut bool, terminate: *mut bool, nominals: *mut bool,
                    values: *mut bool, defined: *mut bool, time: *mut f64) -> Status
                { fmi3::update_discrete_states(c, Updated { needed, terminate, nominals, values, defined, time }) }
                fn fmi3EnterContinuousTimeMode(c: Component) -> Status { fmi3::enter_continuous_time_mode(c) }
                fn fmi3CompletedIntegratorStep(c: Component, _no_set_prior: bool, event_mode: *mut bool,
                    terminate: *mut bool) -> Status
                { fmi3::completed_integrator_step(c, event_mode, terminate) }
                fn fmi3SetTime(c: Component, time: f64) -> Status { fmi3::set_time(c, time) }
                fn fmi3SetContinuousStates(c: Component, x: *const f64, n: usize) -> Status
                { fmi3::set_continuous_states(c, x, n) }
                fn fmi3GetContinuousStateDerivatives(c: Component, dx: *mut f64, n: usize) -> Status
                { fmi3::get_derivatives(c, dx, n) }
                fn fmi3GetEventIndicators(c: Component, z: *mut f64, n: usize) -> Status
                { fmi3::get_event_indicators(c, z, n) }
                fn fmi3GetContinuousStates(c: Component, x: *mut f64, n: usize) -> Status
                { fmi3::get_continuous_states(c, x, n) }
                fn fmi3GetNominalsOfContinuousStates(c: Component, x: *mut f64, n: usize) -> Status
                { fmi3::get_nominals_of_continuous_states(c, x, n) }
                fn fmi3GetNumberOfEventIndicators(c: Component, n: *mut usize) -> Status
                { fmi3::get_number(c, Function::GetNumberOfEventIndicators, n) }
                fn fmi3GetNumberOfContinuousStates(c: Component, n: *mut usize) -> Status
                { fmi3::get_number(c, Function::GetNumberOfContinuousStates, n) }
                fn fmi3EnterStepMode(c: Component) -> Status { fmi3::enter_step_mode(c) }
                fn fmi3GetOutputDerivatives(c: Component, vr: R, n: usize, orders: *const i32, v: *mut f64, m: usize) -> Status
                { fmi3::get_output_derivatives(c, (vr, n), orders, (v, m)) }
                fn fmi3DoStep(c: Component, point: f64, step: f64, _no_set_prior: bool, event_needed: *mut bool,
                    terminate: *mut bool, early_return: *mut bool, last_time: *mut f64) -> Status
                { fmi3::do_step(c, (point, step), (event_needed, terminate, early_return), last_time) }
            }
            $crate::define_fmi3_functions! { @no_type
                fmi3GetFloat32 fmi3SetFloat32 Float32, fmi3GetInt8 fmi3SetInt8 Int8, fmi3GetUInt8 fmi3SetUInt8 UInt8,
                fmi3GetInt16 fmi3SetInt16 Int16, fmi3GetUInt16 fmi3SetUInt16 UInt16, fmi3GetUInt32 fmi3SetUInt32 UInt32,
                fmi3GetString fmi3SetString String,
            }
        }
    };
    (@no_type $($get:ident $set:ident $kind:ident,)*) => {$(
        $crate::define_fmi2_functions! { @function
            fn $get(c: Component, _vr: R, n: usize, _v: *mut c_void, _m: usize) -> Status
            { fmi3::no_such_type(c, stringify!($get), stringify!($kind), n) }
            fn $set(c: Component, _vr: R, n: usize, _v: *const c_void, _m: usize) -> Status
            { fmi3::no_such_type(c, stringify!($set), stringify!($kind), n) }
        }
    )*};
}
