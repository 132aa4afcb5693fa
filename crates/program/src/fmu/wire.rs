//! Calls as messages between processes.

use std::borrow::Cow;
use std::io::{self, ErrorKind, Read, Write};
use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::in_process::Plan;
use super::messages::Messages;
use super::unit::{Answer, Call, RunningUnit, no_event_info};
use crate::fmi2::calls::Function;

/// Largest length of a message, in bytes: a longer one isn't ours.
const LONGEST: u32 = 1 << 30;

/// The first message to an FMU's process: the library and the plan of its instance.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Beginning {
    pub library: PathBuf,
    pub plan: Plan,
}

/// A call of a function, with its arguments and the number of its results.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Request<'a> {
    Plain(Function),
    SetupExperiment { start: f64, stop: f64 },
    GetReal(Cow<'a, [u32]>),
    SetReal(Cow<'a, [u32]>, Cow<'a, [f64]>),
    GetWhole(Function, Cow<'a, [u32]>),
    SetWhole(Function, Cow<'a, [u32]>, Cow<'a, [i32]>),
    SetString(u32, Cow<'a, str>),
    DoStep { time: f64, step: f64 },
    DirectionalDerivative { unknowns: Cow<'a, [u32]>, knowns: Cow<'a, [u32]>, seed: Cow<'a, [f64]> },
    GetNumbers(Function, usize),
    SetContinuousStates(Cow<'a, [f64]>),
    SetTime(f64),
    NewDiscreteStates,
    CompletedIntegratorStep,
    Free,
}

/// Result of a call.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Reply {
    /// The answer, or the reason if there is none.
    pub answer: Result<Answer, String>,
    /// Messages that the FMU logged.
    pub messages: Messages,
    pub reals: Vec<f64>,
    pub wholes: Vec<i32>,
}

impl<'a> Request<'a> {
    pub fn of(call: &'a Call<'_>) -> Self {
        match call {
            Call::Plain(function) => Request::Plain(*function),
            Call::SetupExperiment { start, stop } => Request::SetupExperiment { start: *start, stop: *stop },
            Call::GetReal(references, _) => Request::GetReal((*references).into()),
            Call::SetReal(references, values) => Request::SetReal((*references).into(), (*values).into()),
            Call::GetWhole(function, references, _) => Request::GetWhole(*function, (*references).into()),
            Call::SetWhole(function, references, values) => {
                Request::SetWhole(*function, (*references).into(), (*values).into())
            }
            Call::SetString(reference, text) => Request::SetString(*reference, (*text).into()),
            Call::DoStep { time, step } => Request::DoStep { time: *time, step: *step },
            Call::DirectionalDerivative { unknowns, knowns, seed, .. } => Request::DirectionalDerivative {
                unknowns: (*unknowns).into(),
                knowns: (*knowns).into(),
                seed: (*seed).into(),
            },
            Call::GetNumbers(function, numbers) => Request::GetNumbers(*function, numbers.len()),
            Call::SetContinuousStates(states) => Request::SetContinuousStates((*states).into()),
            Call::SetTime(time) => Request::SetTime(*time),
            Call::NewDiscreteStates(_) => Request::NewDiscreteStates,
            Call::CompletedIntegratorStep(_) => Request::CompletedIntegratorStep,
        }
    }

    /// Calls the function of an instance.
    pub fn answered_by(&self, unit: &mut dyn RunningUnit) -> Reply {
        let (mut reals, mut wholes) = (Vec::new(), Vec::new());
        let answer = match self {
            Request::Plain(function) => unit.call(Call::Plain(*function)),
            Request::SetupExperiment { start, stop } => unit.call(Call::SetupExperiment { start: *start, stop: *stop }),
            Request::GetReal(references) => unit.call(Call::GetReal(references, sized(&mut reals, references.len()))),
            Request::SetReal(references, values) => unit.call(Call::SetReal(references, values)),
            Request::GetWhole(function, references) => {
                unit.call(Call::GetWhole(*function, references, sized(&mut wholes, references.len())))
            }
            Request::SetWhole(function, references, values) => unit.call(Call::SetWhole(*function, references, values)),
            Request::SetString(reference, text) => unit.call(Call::SetString(*reference, text)),
            Request::DoStep { time, step } => unit.call(Call::DoStep { time: *time, step: *step }),
            Request::DirectionalDerivative { unknowns, knowns, seed } => {
                let result = sized(&mut reals, unknowns.len());
                unit.call(Call::DirectionalDerivative { unknowns, knowns, seed, result })
            }
            Request::GetNumbers(function, count) => unit.call(Call::GetNumbers(*function, sized(&mut reals, *count))),
            Request::SetContinuousStates(states) => unit.call(Call::SetContinuousStates(states)),
            Request::SetTime(time) => unit.call(Call::SetTime(*time)),
            Request::NewDiscreteStates => {
                let mut info = no_event_info();
                let answer = unit.call(Call::NewDiscreteStates(&mut info));
                reals.push(info.next_event_time);
                wholes.extend([info.new_discrete_states_needed, info.terminate_simulation, info.nominals_changed]);
                wholes.extend([info.values_changed, info.next_event_time_defined]);
                answer
            }
            Request::CompletedIntegratorStep => {
                let mut asked = [0; 2];
                let answer = unit.call(Call::CompletedIntegratorStep(&mut asked));
                wholes.extend(asked);
                answer
            }
            Request::Free => unit.free().map(|()| super::unit::OK),
        };
        Reply { answer, messages: unit.messages(), reals, wholes }
    }
}

/// Fills a vector with `count` zeros.
fn sized<T: Default + Clone>(values: &mut Vec<T>, count: usize) -> &mut [T] {
    values.resize(count, T::default());
    values
}

impl Reply {
    /// Copies the results to the call's places.
    pub fn hand_over(&self, call: Call<'_>) -> Result<(), String> {
        match call {
            Call::GetReal(_, values)
            | Call::DirectionalDerivative { result: values, .. }
            | Call::GetNumbers(_, values) => copy(&self.reals, values),
            Call::GetWhole(_, _, values) => copy(&self.wholes, values),
            Call::CompletedIntegratorStep(asked) => copy(&self.wholes, asked),
            Call::NewDiscreteStates(info) => {
                let (mut wholes, mut time) = ([0; 5], [0.0]);
                copy(&self.wholes, &mut wholes)?;
                copy(&self.reals, &mut time)?;
                [
                    info.new_discrete_states_needed,
                    info.terminate_simulation,
                    info.nominals_changed,
                    info.values_changed,
                    info.next_event_time_defined,
                ] = wholes;
                [info.next_event_time] = time;
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

fn copy<T: Copy>(given: &[T], wanted: &mut [T]) -> Result<(), String> {
    if given.len() != wanted.len() {
        return Err(format!("its process returned {} values instead of {}", given.len(), wanted.len()));
    }
    wanted.copy_from_slice(given);
    Ok(())
}

/// Writes a message: its length, then its bytes.
pub(super) fn send(mut to: impl Write, message: &impl Serialize, buffer: &mut Vec<u8>) -> io::Result<()> {
    buffer.clear();
    buffer.extend([0; 4]);
    let mut bytes = postcard::to_extend(message, std::mem::take(buffer)).map_err(io::Error::other)?;
    let length = u32::try_from(bytes.len() - 4).ok().filter(|length| *length <= LONGEST);
    bytes[..4].copy_from_slice(&length.ok_or(ErrorKind::FileTooLarge)?.to_le_bytes());
    to.write_all(&bytes)?;
    *buffer = bytes;
    Ok(())
}

/// Reads a message.
pub(super) fn receive<T: DeserializeOwned>(mut from: impl Read, buffer: &mut Vec<u8>) -> io::Result<T> {
    let mut length = [0; 4];
    from.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Err(ErrorKind::InvalidData.into());
    }
    buffer.clear();
    // The buffer grows as bytes arrive, so a wrong length takes no memory.
    from.take(length.into()).read_to_end(buffer)?;
    if buffer.len() != length as usize {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    postcard::from_bytes(buffer).map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}
