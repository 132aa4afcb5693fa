//! The macro that makes a shared library an FMU's: it defines the C functions of both versions of the standard.

/// Exports the functions of FMI 2.0 and of FMI 3.0 for the models of a crate.
///
/// ```ignore
/// adaptive_fmu::export_fmi2![VanDerPol];
/// ```
///
/// The crate has `crate-type = ["cdylib"]`. The macro refuses to compile where two models have the same name.
#[macro_export]
macro_rules! export_fmi2 {
    ($($system:ty),+ $(,)?) => {
        #[cfg(panic = "abort")]
        compile_error!("remove `panic = \"abort\"` from the profile: a panic must become fmi2Error, not end the host");
        $crate::define_fmi2_functions!(
            const { &[$($crate::system::Kind::of::<$system>(),)+ $crate::system::Kind::COMPOSITE] },
            $crate::fmi2::build::SOURCE,
            concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"))
        );
        $crate::define_describing_functions!();
    };
}

/// The functions by which the program describes and exports models that it doesn't have itself.
#[doc(hidden)]
#[macro_export]
macro_rules! define_describing_functions {
    () => {
        #[allow(non_snake_case, clippy::missing_safety_doc, unsafe_code)]
        mod describing_functions {
            use super::fmi2_functions::library;
            use std::ffi::c_void;
            use $crate::fmi2::describe;
            use $crate::fmi2::interface as fmi2;
            use $crate::fmi2::types::*;

            // SAFETY of every call: the program gives NULL or a C string, and a function that may be called with its context.
            $crate::define_fmi2_functions! { @function
                fn adaptive_fmu_describe(description: StringPointer, reply: Option<fmi2::Reply>, context: *mut c_void) -> Boolean
                { fmi2::describe(library(), describe::reply, description, reply, context) }
                fn adaptive_fmu_source(description: StringPointer, reply: Option<fmi2::Reply>, context: *mut c_void) -> Boolean
                { fmi2::describe(library(), describe::source, description, reply, context) }
                fn adaptive_fmu_firmware(request: StringPointer, reply: Option<fmi2::Reply>, context: *mut c_void) -> Boolean
                { fmi2::describe(library(), describe::firmware, request, reply, context) }
                fn adaptive_fmu_reference(description: StringPointer, reply: Option<fmi2::Reply>, context: *mut c_void) -> Boolean
                { fmi2::describe(library(), describe::reference, description, reply, context) }
            }
        }
    };
}

/// Other systems have no C library that the functions of a library would be bound to by versions.
#[cfg(not(old_glibc))]
#[doc(hidden)]
#[macro_export]
macro_rules! bind_old_glibc {
    () => {};
}

/// The functions themselves, for a registry of kinds, the checksum of their sources, and the package that
/// they are of.
#[doc(hidden)]
#[macro_export]
macro_rules! define_fmi2_functions {
    ($registry:expr, $source:expr, $package:expr) => {
        /// The functions of FMI 2.0, as the standard names them.
        #[allow(non_snake_case, missing_docs, clippy::missing_safety_doc, clippy::too_many_arguments, unsafe_code)]
        pub mod fmi2_functions {
            // The systems of the registry, by the names that they have where the macro stands.
            #[allow(unused_imports)]
            use super::*;
            use std::ffi::{c_char, c_int, c_void};
            use $crate::fmi2::calls::Function;
            use $crate::fmi2::interface as fmi2;
            use $crate::fmi2::types::*;

            $crate::bind_old_glibc!();

            /// The package that this library is built from.
            const PACKAGE: &str = $package;
            static BUILD: [u8; $crate::fmi2::build::length(PACKAGE, $source)] =
                $crate::fmi2::build::text(PACKAGE, $source);
            // No static: a crate that reads a registry of another one in a constant compiles all its models once more.
            pub(super) fn library() -> $crate::fmi2::build::Library {
                $crate::fmi2::build::Library { registry: $registry, source: $source, build: &BUILD }
            }
            const _: () = assert!(
                $crate::system::Kind::have_different_names($registry),
                "two models have the same NAME (`composite` is taken): a description could not tell them apart"
            );

            $crate::define_fmi2_functions! { @function
                // SAFETY of every call below: the master keeps to the standard's rules about pointers, which are
                // those that the called function states.
                fn fmi2Instantiate(name: StringPointer, kind: c_int, guid: StringPointer, resources: StringPointer,
                    functions: *const CallbackFunctions, visible: Boolean, logging: Boolean) -> Component
                { fmi2::instantiate(library(), name, kind, guid, resources, functions, visible, logging) }
                fn fmi2FreeInstance(c: Component) -> () { fmi2::free_instance(c) }
                fn fmi2GetTypesPlatform() -> StringPointer { c"default".as_ptr() }
                fn fmi2GetVersion() -> StringPointer { c"2.0".as_ptr() }
                fn fmi2SetDebugLogging(c: Component, on: Boolean, n: usize, categories: *const StringPointer) -> Status
                { fmi2::set_debug_logging(c, on, n, categories) }
                fn fmi2SetupExperiment(c: Component, tolerance_defined: Boolean, tolerance: f64, start: f64,
                    stop_defined: Boolean, stop: f64) -> Status
                { fmi2::setup_experiment(c, tolerance_defined, tolerance, start, stop_defined, stop) }
                fn fmi2EnterInitializationMode(c: Component) -> Status { fmi2::enter_initialization_mode(c) }
                fn fmi2ExitInitializationMode(c: Component) -> Status { fmi2::exit_initialization_mode(c) }
                fn fmi2Terminate(c: Component) -> Status { fmi2::terminate(c) }
                fn fmi2Reset(c: Component) -> Status { fmi2::reset(c) }
                fn fmi2GetReal(c: Component, vr: *const ValueReference, n: usize, v: *mut f64) -> Status
                { fmi2::get_real(c, vr, n, v) }
                fn fmi2GetInteger(c: Component, vr: *const ValueReference, n: usize, v: *mut Integer) -> Status
                { fmi2::get_discrete(c, Function::GetInteger, vr, n, v) }
                fn fmi2GetBoolean(c: Component, vr: *const ValueReference, n: usize, v: *mut Boolean) -> Status
                { fmi2::get_discrete(c, Function::GetBoolean, vr, n, v) }
                fn fmi2GetString(c: Component, _vr: *const ValueReference, n: usize, _v: *mut StringPointer) -> Status
                { fmi2::string_values(c, Function::GetString, n) }
                fn fmi2SetReal(c: Component, vr: *const ValueReference, n: usize, v: *const f64) -> Status
                { fmi2::set_real(c, vr, n, v) }
                fn fmi2SetInteger(c: Component, vr: *const ValueReference, n: usize, v: *const Integer) -> Status
                { fmi2::set_discrete(c, Function::SetInteger, vr, n, v) }
                fn fmi2SetBoolean(c: Component, vr: *const ValueReference, n: usize, v: *const Boolean) -> Status
                { fmi2::set_discrete(c, Function::SetBoolean, vr, n, v) }
                fn fmi2SetString(c: Component, _vr: *const ValueReference, n: usize, _v: *const StringPointer) -> Status
                { fmi2::string_values(c, Function::SetString, n) }
                fn fmi2GetFMUstate(c: Component, state: *mut FmuState) -> Status { fmi2::get_fmu_state(c, state) }
                fn fmi2SetFMUstate(c: Component, state: FmuState) -> Status { fmi2::set_fmu_state(c, state) }
                fn fmi2FreeFMUstate(c: Component, state: *mut FmuState) -> Status { fmi2::free_fmu_state(c, state) }
                fn fmi2SerializedFMUstateSize(c: Component, state: FmuState, size: *mut usize) -> Status
                { fmi2::serialized_fmu_state_size(c, state, size) }
                fn fmi2SerializeFMUstate(c: Component, state: FmuState, bytes: *mut c_char, size: usize) -> Status
                { fmi2::serialize_fmu_state(c, state, bytes, size) }
                fn fmi2DeSerializeFMUstate(c: Component, bytes: *const c_char, size: usize, state: *mut FmuState) -> Status
                { fmi2::deserialize_fmu_state(c, bytes, size, state) }
                fn fmi2GetDirectionalDerivative(c: Component, unknowns: *const ValueReference, n: usize,
                    knowns: *const ValueReference, m: usize, seed: *const f64, result: *mut f64) -> Status
                { fmi2::get_directional_derivative(c, (unknowns, n), (knowns, m), seed, result) }
                fn fmi2SetRealInputDerivatives(c: Component, vr: *const ValueReference, n: usize,
                    order: *const Integer, v: *const f64) -> Status
                { fmi2::set_real_input_derivatives(c, vr, n, order, v) }
                fn fmi2GetRealOutputDerivatives(c: Component, vr: *const ValueReference, n: usize,
                    order: *const Integer, v: *mut f64) -> Status
                { fmi2::get_real_output_derivatives(c, vr, n, order, v) }
                fn fmi2DoStep(c: Component, point: f64, step: f64, _no_set_prior: Boolean) -> Status
                { fmi2::do_step(c, point, step) }
                fn fmi2CancelStep(c: Component) -> Status { fmi2::cancel_step(c) }
                fn fmi2GetStatus(c: Component, _kind: c_int, _v: *mut c_int) -> Status { fmi2::get_status(c) }
                fn fmi2GetRealStatus(c: Component, kind: c_int, v: *mut f64) -> Status { fmi2::get_real_status(c, kind, v) }
                fn fmi2GetIntegerStatus(c: Component, _kind: c_int, _v: *mut Integer) -> Status
                { fmi2::get_integer_status(c) }
                fn fmi2GetBooleanStatus(c: Component, kind: c_int, v: *mut Boolean) -> Status
                { fmi2::get_boolean_status(c, kind, v) }
                fn fmi2GetStringStatus(c: Component, _kind: c_int, _v: *mut StringPointer) -> Status
                { fmi2::get_string_status(c) }
                fn fmi2EnterEventMode(c: Component) -> Status { fmi2::enter_event_mode(c) }
                fn fmi2NewDiscreteStates(c: Component, info: *mut EventInfo) -> Status { fmi2::new_discrete_states(c, info) }
                fn fmi2EnterContinuousTimeMode(c: Component) -> Status { fmi2::enter_continuous_time_mode(c) }
                fn fmi2CompletedIntegratorStep(c: Component, _no_set_prior: Boolean, enter_event_mode: *mut Boolean,
                    terminate: *mut Boolean) -> Status
                { fmi2::completed_integrator_step(c, enter_event_mode, terminate) }
                fn fmi2SetTime(c: Component, time: f64) -> Status { fmi2::set_time(c, time) }
                fn fmi2SetContinuousStates(c: Component, x: *const f64, n: usize) -> Status
                { fmi2::set_continuous_states(c, x, n) }
                fn fmi2GetDerivatives(c: Component, dx: *mut f64, n: usize) -> Status { fmi2::get_derivatives(c, dx, n) }
                fn fmi2GetEventIndicators(c: Component, z: *mut f64, n: usize) -> Status
                { fmi2::get_event_indicators(c, z, n) }
                fn fmi2GetContinuousStates(c: Component, x: *mut f64, n: usize) -> Status
                { fmi2::get_continuous_states(c, x, n) }
                fn fmi2GetNominalsOfContinuousStates(c: Component, x: *mut f64, n: usize) -> Status
                { fmi2::get_nominals_of_continuous_states(c, x, n) }
                fn adaptive_fmu_kernel_functions(c: Component, other: Component, reply: Option<fmi2::Reply>,
                    context: *mut c_void) -> Boolean
                { fmi2::kernel_functions(c, other, reply, context) }
                fn adaptive_fmu_take_kernel(c: Component, kernel: *const $crate::kernel::Kernel) -> Boolean
                { fmi2::take_kernel(c, kernel) }
                fn adaptive_fmu_has_kernel(c: Component) -> Boolean { fmi2::has_kernel(c) }
                fn adaptive_fmu_do_steps(c: Component, times: *const f64, count: usize, vr: *const ValueReference, width: usize,
                    rows: *mut f64) -> usize
                { fmi2::do_steps(c, times, count, vr, width, rows) }
            }
        }
        $crate::define_fmi3_functions!();
    };
    (@function $(fn $name:ident($($argument:ident: $type:ty),* $(,)?) -> $answer:ty { $body:expr })*) => {$(
        #[unsafe(no_mangle)]
        #[allow(unused_unsafe)]
        pub unsafe extern "C-unwind" fn $name($($argument: $type),*) -> $answer {
            $crate::fmi2::floating_point::in_default(|| unsafe { $body })
        }
    )*};
}
