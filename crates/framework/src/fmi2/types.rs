//! The C types of the standard (FMI 2.0.4, section 2.1.2).

use std::ffi::{c_char, c_int, c_uint, c_void};

/// `fmi2Component`: an instance as the master sees it.
pub type Component = *mut c_void;
/// `fmi2FMUstate`: a saved state as the master sees it.
pub type FmuState = *mut c_void;
/// `fmi2ValueReference`
pub type ValueReference = c_uint;
/// `fmi2Boolean`
pub type Boolean = c_int;
/// `fmi2Integer`
pub type Integer = c_int;
/// `fmi2String`
pub type StringPointer = *const c_char;

/// `fmi2True`
pub const TRUE: Boolean = 1;
/// `fmi2False`
pub const FALSE: Boolean = 0;

/// `fmi2Status` and `fmi3Status`. `fmi2Fatal`, `fmi2Pending` and `fmi3Fatal` are never returned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    /// `fmi2OK`
    Ok = 0,
    /// `fmi2Warning`: for log messages only.
    Warning = 1,
    /// `fmi2Discard`
    Discard = 2,
    /// `fmi2Error`
    Error = 3,
}

/// `fmi2Type`
pub const MODEL_EXCHANGE: c_int = 0;
/// `fmi2Type`
pub const CO_SIMULATION: c_int = 1;

/// `fmi2StatusKind`
pub mod status_kind {
    use super::c_int;

    /// `fmi2DoStepStatus`
    pub const DO_STEP: c_int = 0;
    /// `fmi2PendingStatus`
    pub const PENDING: c_int = 1;
    /// `fmi2LastSuccessfulTime`
    pub const LAST_SUCCESSFUL_TIME: c_int = 2;
    /// `fmi2Terminated`
    pub const TERMINATED: c_int = 3;
}

/// `fmi2CallbackLogger`, which may throw an exception.
pub type LoggerFunction =
    unsafe extern "C-unwind" fn(*mut c_void, StringPointer, Status, StringPointer, StringPointer, ...);

/// `fmi3LogMessageCallback`, which may throw an exception.
pub type LogMessage = unsafe extern "C-unwind" fn(*mut c_void, Status, StringPointer, StringPointer);

/// `fmi2CallbackFunctions`. The memory callbacks are never called (`canNotUseMemoryManagementFunctions`).
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct CallbackFunctions {
    /// Destination of messages.
    pub logger: Option<LoggerFunction>,
    /// Never called.
    pub allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    /// Never called.
    pub free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    /// Never called: no step is asynchronous.
    pub step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    /// Passed back to the logger.
    pub component_environment: *mut c_void,
}

/// `fmi2EventInfo`
#[derive(Debug, Clone, Copy)]
#[repr(C)]
pub struct EventInfo {
    /// `newDiscreteStatesNeeded`
    pub new_discrete_states_needed: Boolean,
    /// `terminateSimulation`
    pub terminate_simulation: Boolean,
    /// `nominalsOfContinuousStatesChanged`
    pub nominals_changed: Boolean,
    /// `valuesOfContinuousStatesChanged`
    pub values_changed: Boolean,
    /// `nextEventTimeDefined`
    pub next_event_time_defined: Boolean,
    /// `nextEventTime`
    pub next_event_time: f64,
}

/// Receiver of the reply of a function in addition to the standard's.
pub type Reply = unsafe extern "C-unwind" fn(context: *mut std::ffi::c_void, text: StringPointer);
