//! Calls of FMI 2.0.

use std::ffi::{CString, c_char, c_int};

use super::in_process::{Binary, Plan, Symbol};
use super::unit::{Answer, Call};
use crate::fmi2::types::{CallbackFunctions, Component, EventInfo};

type Instantiate = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const CallbackFunctions,
    c_int,
    c_int,
) -> Component;
type Setup = unsafe extern "C" fn(Component, c_int, f64, f64, c_int, f64) -> Answer;
type Plain = unsafe extern "C" fn(Component) -> Answer;
type GetReal = unsafe extern "C" fn(Component, *const u32, usize, *mut f64) -> Answer;
type SetReal = unsafe extern "C" fn(Component, *const u32, usize, *const f64) -> Answer;
type GetWhole = unsafe extern "C" fn(Component, *const u32, usize, *mut c_int) -> Answer;
type SetWhole = unsafe extern "C" fn(Component, *const u32, usize, *const c_int) -> Answer;
type SetString = unsafe extern "C" fn(Component, *const u32, usize, *const *const c_char) -> Answer;
type DoStep = unsafe extern "C" fn(Component, f64, f64, c_int) -> Answer;
type DirectionalDerivative =
    unsafe extern "C" fn(Component, *const u32, usize, *const u32, usize, *const f64, *mut f64) -> Answer;
type NewDiscreteStates = unsafe extern "C" fn(Component, *mut EventInfo) -> Answer;
type GetNumbers = unsafe extern "C" fn(Component, *mut f64, usize) -> Answer;
type SetNumbers = unsafe extern "C" fn(Component, *const f64, usize) -> Answer;
type SetTime = unsafe extern "C" fn(Component, f64) -> Answer;
type CompletedIntegratorStep = unsafe extern "C" fn(Component, c_int, *mut c_int, *mut c_int) -> Answer;

/// Makes an instance; null if that fails.
///
/// # Safety
/// The library must export the standard's functions under their names, and the callbacks must live as long as the
/// instance.
pub(super) unsafe fn instantiate(
    binary: &Binary,
    plan: &Plan,
    callbacks: &CallbackFunctions,
) -> Result<Component, String> {
    let text = |text: &str| CString::new(text).map_err(|_| "a name contains a NUL character".to_owned());
    let (name, guid, resources) = (text(&plan.name)?, text(&plan.guid)?, text(&plan.resources)?);
    let (guid, resources) = (guid.as_ptr(), resources.as_ptr());
    // SAFETY: the type is the standard's; strings and callbacks live as long as the standard asks.
    unsafe {
        let instantiate = std::mem::transmute::<Symbol, Instantiate>(binary.instantiate(plan.kind)?);
        Ok(instantiate(name.as_ptr(), plan.kind, guid, resources, callbacks, 0, plan.logs.into()))
    }
}

/// Calls a function. Returns the reason if there is no answer.
///
/// # Safety
/// The library must export the standard's functions under their names, and the instance must be alive.
pub(super) unsafe fn call(component: Component, binary: &Binary, call: Call<'_>) -> Result<Answer, String> {
    let function = call.function();
    // SAFETY: the types are those that the standard gives the functions; `Instance` passes as many values as
    // references, and texts outlive the calls.
    unsafe {
        Ok(match call {
            Call::Plain(_) => binary.function::<Plain>(function)?(component),
            Call::SetupExperiment { start, stop } => {
                binary.function::<Setup>(function)?(component, 0, 0.0, start, 1, stop)
            }
            Call::GetReal(references, values) => {
                let call = binary.function::<GetReal>(function)?;
                call(component, references.as_ptr(), references.len(), values.as_mut_ptr())
            }
            Call::SetReal(references, values) => {
                let call = binary.function::<SetReal>(function)?;
                call(component, references.as_ptr(), references.len(), values.as_ptr())
            }
            Call::GetWhole(_, references, values) => {
                let call = binary.function::<GetWhole>(function)?;
                call(component, references.as_ptr(), references.len(), values.as_mut_ptr())
            }
            Call::SetWhole(_, references, values) => {
                let call = binary.function::<SetWhole>(function)?;
                call(component, references.as_ptr(), references.len(), values.as_ptr())
            }
            Call::SetString(reference, text) => {
                let text = CString::new(text.replace('\0', "")).unwrap_or_default();
                binary.function::<SetString>(function)?(component, &raw const reference, 1, &text.as_ptr())
            }
            Call::DoStep { time, step } => binary.function::<DoStep>(function)?(component, time, step, 1),
            Call::DirectionalDerivative { unknowns, knowns, seed, result } => {
                let call = binary.function::<DirectionalDerivative>(function)?;
                let (unknown, known) = (unknowns.as_ptr(), knowns.as_ptr());
                call(component, unknown, unknowns.len(), known, knowns.len(), seed.as_ptr(), result.as_mut_ptr())
            }
            Call::GetNumbers(_, numbers) => {
                binary.function::<GetNumbers>(function)?(component, numbers.as_mut_ptr(), numbers.len())
            }
            Call::SetContinuousStates(states) => {
                binary.function::<SetNumbers>(function)?(component, states.as_ptr(), states.len())
            }
            Call::SetTime(time) => binary.function::<SetTime>(function)?(component, time),
            Call::NewDiscreteStates(info) => binary.function::<NewDiscreteStates>(function)?(component, info),
            Call::CompletedIntegratorStep([event, end]) => {
                binary.function::<CompletedIntegratorStep>(function)?(component, 1, event, end)
            }
        })
    }
}
