//! Calls of FMI 3.0: the master names elements, the standard passes whole arrays.

use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::ffi::{CString, c_char, c_int, c_void};
use std::rc::Rc;

use super::in_process::{Binary, Plan, Symbol};
use super::messages::{Log, log_message};
use super::unit::{Answer, Call, DISCARD, OK, WARNING};
use crate::fmi2::calls::Function;
use crate::fmi2::types::{Component, EventInfo, MODEL_EXCHANGE};
use crate::model_description::{Array, Type};

/// The status is an integer, since another tool's FMU may pass any number.
type LogMessage = unsafe extern "C-unwind" fn(*mut c_void, c_int, *const c_char, *const c_char);
/// A Boolean that an FMU writes: a byte, since another tool may write values other than 0 and 1.
type Flag = u8;
type InstantiateExchange =
    unsafe extern "C" fn(*const c_char, *const c_char, *const c_char, bool, bool, *mut c_void, LogMessage) -> Component;
type InstantiateCoSimulation = unsafe extern "C" fn(
    *const c_char,
    *const c_char,
    *const c_char,
    bool,
    bool,
    bool,
    bool,
    *const u32,
    usize,
    *mut c_void,
    LogMessage,
    *const c_void,
) -> Component;
type Plain = unsafe extern "C" fn(Component) -> Answer;
type Initialise = unsafe extern "C" fn(Component, bool, f64, f64, bool, f64) -> Answer;
type Get<T> = unsafe extern "C" fn(Component, *const u32, usize, *mut T, usize) -> Answer;
type Set<T> = unsafe extern "C" fn(Component, *const u32, usize, *const T, usize) -> Answer;
type DoStep = unsafe extern "C" fn(Component, f64, f64, bool, *mut Flag, *mut Flag, *mut Flag, *mut f64) -> Answer;
type DirectionalDerivative =
    unsafe extern "C" fn(Component, *const u32, usize, *const u32, usize, *const f64, usize, *mut f64, usize) -> Answer;
type GetNumbers = unsafe extern "C" fn(Component, *mut f64, usize) -> Answer;
type SetNumbers = unsafe extern "C" fn(Component, *const f64, usize) -> Answer;
type SetTime = unsafe extern "C" fn(Component, f64) -> Answer;
type Update =
    unsafe extern "C" fn(Component, *mut Flag, *mut Flag, *mut Flag, *mut Flag, *mut Flag, *mut f64) -> Answer;
type CompletedStep = unsafe extern "C" fn(Component, bool, *mut Flag, *mut Flag) -> Answer;

/// An instance of FMI 3.0.
#[derive(Debug)]
pub(super) struct Instance3 {
    component: Component,
    arrays: Vec<Array>,
    /// The number of each array's first element.
    firsts: Vec<usize>,
    /// Values that arrays were set to: a master sets elements, the standard whole arrays.
    set: RefCell<Vec<Option<Vec<f64>>>>,
    /// Cached groups, since a master names the same elements in each step.
    groups: RefCell<Groups>,
    /// Start and stop time.
    experiment: Cell<(f64, f64)>,
}

/// Arrays of one type, each once, that contain some of the elements that a master names.
#[derive(Debug)]
struct Group {
    of: Type,
    arrays: Vec<usize>,
    references: Vec<u32>,
    /// Number of their values.
    size: usize,
    /// Elements: the place in the master's list, that among the values, and the array.
    elements: Vec<(usize, usize, usize)>,
}

/// Groups of elements, by the lists that a master names.
type Groups = HashMap<Vec<u32>, Rc<[Group]>>;

/// Makes an instance; null if that fails.
///
/// # Safety
/// The library must export the standard's functions under their names.
pub(super) unsafe fn instantiate(binary: &Binary, plan: &Plan, log: &Log) -> Result<Component, String> {
    let text = |text: &str| CString::new(text).map_err(|_| "a name contains a NUL character".to_owned());
    let (name, token, resources) = (text(&plan.name)?, text(&plan.guid)?, text(&plan.resources)?);
    let (name, token, resources) = (name.as_ptr(), token.as_ptr(), resources.as_ptr());
    let (symbol, log) = (binary.instantiate(plan.kind)?, std::ptr::from_ref(log).cast_mut().cast());
    // SAFETY: the type is the standard's, as the caller states; texts live as long as the standard asks.
    unsafe {
        Ok(if plan.kind == MODEL_EXCHANGE {
            let call = std::mem::transmute::<Symbol, InstantiateExchange>(symbol);
            call(name, token, resources, false, plan.logs, log, log_message)
        } else {
            let call = std::mem::transmute::<Symbol, InstantiateCoSimulation>(symbol);
            let (none, nothing) = (std::ptr::null(), std::ptr::null());
            let event_mode = plan.event_mode;
            call(name, token, resources, false, plan.logs, event_mode, false, none, 0, log, log_message, nothing)
        })
    }
}

impl Instance3 {
    pub fn new(component: Component, arrays: &[Array]) -> Self {
        let firsts = arrays.iter().scan(0, |next, array| Some(std::mem::replace(next, *next + array.count)));
        Instance3 {
            component,
            firsts: firsts.collect(),
            set: RefCell::new(arrays.iter().map(|array| array.start.clone()).collect()),
            arrays: arrays.to_vec(),
            groups: RefCell::default(),
            experiment: Cell::default(),
        }
    }

    /// Calls a function. Returns the reason if there is no answer.
    ///
    /// # Safety
    /// The library must export the standard's functions under their names, and the instance must be alive.
    pub unsafe fn call(&self, binary: &Binary, call: Call<'_>) -> Result<Answer, String> {
        let (component, function) = (self.component, call.function());
        // SAFETY: the types are those that the standard gives the functions; arrays have the lengths that are passed,
        // and texts outlive the calls.
        unsafe {
            match call {
                // EnterInitializationMode passes these times.
                Call::SetupExperiment { start, stop } => {
                    self.experiment.set((start, stop));
                    Ok(OK)
                }
                Call::Plain(Function::EnterInitializationMode) => {
                    let (start, stop) = self.experiment.get();
                    Ok(binary.function::<Initialise>(function)?(component, false, 0.0, start, true, stop))
                }
                Call::Plain(_) => Ok(binary.function::<Plain>(function)?(component)),
                Call::GetReal(numbers, values) => self.get(binary, numbers, |k, value| {
                    values[k] = value;
                    true
                }),
                Call::GetWhole(_, numbers, values) => self.get(binary, numbers, |k, value| {
                    values[k] = value as i32;
                    f64::from(values[k]) == value
                }),
                Call::SetReal(numbers, values) => self.set(binary, numbers, |k| values[k]),
                Call::SetWhole(_, numbers, values) => self.set(binary, numbers, |k| f64::from(values[k])),
                Call::SetString(number, text) => self.set_text(binary, number, text),
                Call::DoStep { time, step } => self.do_step(binary.function::<DoStep>(function)?, time, step),
                Call::DirectionalDerivative { unknowns, knowns, seed, result } => {
                    let call = binary.function::<DirectionalDerivative>(function)?;
                    self.directional_derivative(call, (unknowns, result), (knowns, seed))
                }
                Call::GetNumbers(_, numbers) => {
                    Ok(binary.function::<GetNumbers>(function)?(component, numbers.as_mut_ptr(), numbers.len()))
                }
                Call::SetContinuousStates(states) => {
                    Ok(binary.function::<SetNumbers>(function)?(component, states.as_ptr(), states.len()))
                }
                Call::SetTime(time) => Ok(binary.function::<SetTime>(function)?(component, time)),
                Call::NewDiscreteStates(info) => self.update(binary.function::<Update>(function)?, info),
                Call::CompletedIntegratorStep(asked) => {
                    let [mut event, mut end] = [0; 2];
                    let call = binary.function::<CompletedStep>(function)?;
                    let answer = call(component, true, &raw mut event, &raw mut end);
                    *asked = [event.into(), end.into()];
                    Ok(answer)
                }
            }
        }
    }

    /// Takes one step to its end: early return isn't allowed.
    unsafe fn do_step(&self, call: DoStep, time: f64, step: f64) -> Result<Answer, String> {
        let ([mut event, mut end, mut early], mut last) = ([0; 3], time);
        // SAFETY: as of `call`.
        let answer = unsafe {
            call(self.component, time, step, true, &raw mut event, &raw mut end, &raw mut early, &raw mut last)
        };
        match answer {
            OK | WARNING if end != 0 => Err("the FMU requested to end the simulation".to_owned()),
            OK | WARNING if early != 0 => Err(format!("it returned early, at {last} s, though this was not allowed")),
            answer => Ok(answer),
        }
    }

    unsafe fn update(&self, call: Update, info: &mut EventInfo) -> Result<Answer, String> {
        let ([mut needed, mut end, mut nominals, mut values, mut defined], mut time) = ([0; 5], 0.0);
        // SAFETY: as of `call`.
        let answer = unsafe {
            let flags = (&raw mut needed, &raw mut end, &raw mut nominals, &raw mut values, &raw mut defined);
            call(self.component, flags.0, flags.1, flags.2, flags.3, flags.4, &raw mut time)
        };
        *info = EventInfo {
            new_discrete_states_needed: needed.into(),
            terminate_simulation: end.into(),
            nominals_changed: nominals.into(),
            values_changed: values.into(),
            next_event_time_defined: defined.into(),
            next_event_time: time,
        };
        Ok(answer)
    }

    /// The array of an element, and its place there.
    fn place(&self, number: u32) -> Result<(usize, usize), String> {
        let after = self.firsts.partition_point(|&first| first <= number as usize);
        // Arrays without elements are skipped, since they have the same first number as the next one.
        let array = after.checked_sub(1).ok_or_else(|| format!("there is no element {number}"))?;
        let k = number as usize - self.firsts[array];
        if k < self.arrays[array].count { Ok((array, k)) } else { Err(format!("there is no element {number}")) }
    }

    /// The arrays of elements, by their types.
    fn groups(&self, numbers: &[u32]) -> Result<Rc<[Group]>, String> {
        if let Some(known) = self.groups.borrow().get(numbers) {
            return Ok(Rc::clone(known));
        }
        let found: Rc<[Group]> = self.grouped(numbers, |of| of)?.into();
        self.groups.borrow_mut().insert(numbers.to_vec(), Rc::clone(&found));
        Ok(found)
    }

    fn grouped(&self, numbers: &[u32], by: impl Fn(Type) -> Type) -> Result<Vec<Group>, String> {
        let (mut groups, mut places): (Vec<Group>, HashMap<usize, usize>) = (Vec::new(), HashMap::new());
        for (k, &number) in numbers.iter().enumerate() {
            let (array, element) = self.place(number)?;
            let (of, Array { reference, count, .. }) = (by(self.arrays[array].of), &self.arrays[array]);
            let own = groups.iter().position(|group| group.of == of).unwrap_or(groups.len());
            if own == groups.len() {
                let (arrays, references, elements) = (Vec::new(), Vec::new(), Vec::new());
                groups.push(Group { of, arrays, references, size: 0, elements });
            }
            let group = &mut groups[own];
            let first = *places.entry(array).or_insert_with(|| {
                group.arrays.push(array);
                group.references.push(*reference);
                group.size += count;
                group.size - count
            });
            group.elements.push((k, first + element, array));
        }
        Ok(groups)
    }

    /// Passes values with their places in the list to `give`, which returns false for one that it can't take.
    unsafe fn get(
        &self,
        binary: &Binary,
        numbers: &[u32],
        mut give: impl FnMut(usize, f64) -> bool,
    ) -> Result<Answer, String> {
        let mut worst = OK;
        for Group { of, references, size, elements, .. } in self.groups(numbers)?.iter() {
            // SAFETY: as of `call`.
            let (answer, values) = unsafe { self.read(binary, *of, references, *size)? };
            worst = worst.max(answer);
            if answer >= DISCARD {
                return Ok(answer);
            }
            for &(k, place, array) in elements {
                if !give(k, values[place]) {
                    let (name, value) = (&self.arrays[array].name, values[place]);
                    return Err(format!("`{name}` = {value}: only whole numbers of 32 bits can be read"));
                }
            }
        }
        Ok(worst)
    }

    /// Values of all elements of some arrays of a type.
    unsafe fn read(
        &self,
        binary: &Binary,
        of: Type,
        references: &[u32],
        size: usize,
    ) -> Result<(Answer, Vec<f64>), String> {
        macro_rules! read {
            ($type:ty, $name:literal, $number:expr) => {{
                let mut values: Vec<$type> = vec![Default::default(); size];
                // SAFETY: the type of the function is the standard's; both arrays have the lengths that are passed.
                let answer = unsafe {
                    let call = std::mem::transmute::<Symbol, Get<$type>>(needed(binary, $name)?);
                    call(self.component, references.as_ptr(), references.len(), values.as_mut_ptr(), size)
                };
                (answer, values.into_iter().map($number).collect())
            }};
        }
        Ok(match of {
            Type::Float64 => {
                let mut values = vec![0.0; size];
                // SAFETY: likewise.
                let answer = unsafe {
                    let call = binary.function::<Get<f64>>(Function::GetReal)?;
                    call(self.component, references.as_ptr(), references.len(), values.as_mut_ptr(), size)
                };
                (answer, values)
            }
            Type::Float32 => read!(f32, "fmi3GetFloat32", f64::from),
            Type::Int8 => read!(i8, "fmi3GetInt8", f64::from),
            Type::UInt8 => read!(u8, "fmi3GetUInt8", f64::from),
            Type::Int16 => read!(i16, "fmi3GetInt16", f64::from),
            Type::UInt16 => read!(u16, "fmi3GetUInt16", f64::from),
            Type::Int32 => read!(i32, "fmi3GetInt32", f64::from),
            Type::UInt32 => read!(u32, "fmi3GetUInt32", f64::from),
            Type::Int64 | Type::Enumeration => read!(i64, "fmi3GetInt64", |value| value as f64),
            Type::UInt64 => read!(u64, "fmi3GetUInt64", |value| value as f64),
            Type::Boolean => read!(Flag, "fmi3GetBoolean", |value| f64::from(u8::from(value != 0))),
            Type::String => return Err("texts can't be read".to_owned()),
        })
    }

    unsafe fn set(&self, binary: &Binary, numbers: &[u32], value: impl Fn(usize) -> f64) -> Result<Answer, String> {
        let mut worst = OK;
        for group in self.groups(numbers)?.iter() {
            // SAFETY: as of `call`.
            let mut values = unsafe { self.before(binary, group)? };
            let (least, most) = group.of.range();
            for &(k, place, array) in &group.elements {
                values[place] = value(k);
                if values[place] < least || values[place] > most {
                    let (name, value, of) = (&self.arrays[array].name, values[place], group.of);
                    return Err(format!("`{name}` = {value}: {of:?} must be within {least} … {most}"));
                }
            }
            // SAFETY: likewise.
            let answer = unsafe { self.write(binary, group.of, &group.references, &values)? };
            worst = worst.max(answer);
            if answer >= DISCARD {
                return Ok(answer);
            }
            let (mut set, mut rest) = (self.set.borrow_mut(), &values[..]);
            for &array in &group.arrays {
                let (own, others) = rest.split_at(self.arrays[array].count);
                (set[array], rest) = (Some(own.to_vec()), others);
            }
        }
        Ok(worst)
    }

    /// Values of arrays before some of their elements are set: those set last, else the instance's.
    unsafe fn before(&self, binary: &Binary, group: &Group) -> Result<Vec<f64>, String> {
        let set = self.set.borrow();
        let known = group.arrays.iter().map(|&array| set[array].as_deref()).collect::<Option<Vec<_>>>();
        if let Some(known) = known {
            return Ok(known.concat());
        }
        if group.arrays.iter().all(|&array| self.arrays[array].count == 1) {
            return Ok(vec![0.0; group.size]);
        }
        // SAFETY: as of `call`.
        let (answer, values) = unsafe { self.read(binary, group.of, &group.references, group.size)? };
        if answer >= DISCARD {
            return Err("one element of an array can't be set because the others can't be read".to_owned());
        }
        Ok(values)
    }

    /// Sets all elements of some arrays of a type.
    unsafe fn write(&self, binary: &Binary, of: Type, references: &[u32], values: &[f64]) -> Result<Answer, String> {
        macro_rules! write {
            ($type:ty, $name:literal, $convert:expr) => {{
                let values: Vec<$type> = values.iter().map($convert).collect();
                // SAFETY: the type of the function is the standard's; both arrays have the lengths that are passed.
                unsafe {
                    let call = std::mem::transmute::<Symbol, Set<$type>>(needed(binary, $name)?);
                    call(self.component, references.as_ptr(), references.len(), values.as_ptr(), values.len())
                }
            }};
        }
        Ok(match of {
            Type::Float64 => {
                // SAFETY: likewise.
                unsafe {
                    let call = binary.function::<Set<f64>>(Function::SetReal)?;
                    call(self.component, references.as_ptr(), references.len(), values.as_ptr(), values.len())
                }
            }
            Type::Float32 => write!(f32, "fmi3SetFloat32", |value| *value as f32),
            Type::Int8 => write!(i8, "fmi3SetInt8", |value| *value as i8),
            Type::UInt8 => write!(u8, "fmi3SetUInt8", |value| *value as u8),
            Type::Int16 => write!(i16, "fmi3SetInt16", |value| *value as i16),
            Type::UInt16 => write!(u16, "fmi3SetUInt16", |value| *value as u16),
            Type::Int32 => write!(i32, "fmi3SetInt32", |value| *value as i32),
            Type::UInt32 => write!(u32, "fmi3SetUInt32", |value| *value as u32),
            Type::Int64 | Type::Enumeration => write!(i64, "fmi3SetInt64", |value| *value as i64),
            Type::UInt64 => write!(u64, "fmi3SetUInt64", |value| *value as u64),
            Type::Boolean => write!(bool, "fmi3SetBoolean", |value| *value != 0.0),
            Type::String => return Err("a text can't be set to a number".to_owned()),
        })
    }

    unsafe fn set_text(&self, binary: &Binary, number: u32, text: &str) -> Result<Answer, String> {
        let (array, _) = self.place(number)?;
        if self.arrays[array].count != 1 {
            return Err("elements of arrays of texts can't be set".to_owned());
        }
        let text = CString::new(text.replace('\0', "")).unwrap_or_default();
        let (reference, text) = (self.arrays[array].reference, text.as_ptr());
        // SAFETY: as of `call`; the text lives until the call ends.
        unsafe {
            let call = binary.function::<Set<*const c_char>>(Function::SetString)?;
            Ok(call(self.component, &raw const reference, 1, &raw const text, 1))
        }
    }

    unsafe fn directional_derivative(
        &self,
        call: DirectionalDerivative,
        (unknowns, result): (&[u32], &mut [f64]),
        (knowns, seed): (&[u32], &[f64]),
    ) -> Result<Answer, String> {
        // Derivatives are Float64, whatever types the variables have.
        let all = |numbers: &[u32]| self.grouped(numbers, |_| Type::Float64).map(|mut groups| groups.pop());
        let (Some(of), Some(by)) = (all(unknowns)?, all(knowns)?) else { return Ok(OK) };
        let (mut whole_seed, mut whole) = (vec![0.0; by.size], vec![0.0; of.size]);
        by.elements.iter().for_each(|&(k, place, _)| whole_seed[place] = seed[k]);
        let (unknown, known) = (&of.references, &by.references);
        // SAFETY: as of `call`.
        let answer = unsafe {
            let (seed, result) = (whole_seed.as_ptr(), whole.as_mut_ptr());
            let (unknown, unknowns, known, knowns) = (unknown.as_ptr(), unknown.len(), known.as_ptr(), known.len());
            call(self.component, unknown, unknowns, known, knowns, seed, by.size, result, of.size)
        };
        of.elements.iter().for_each(|&(k, place, _)| result[k] = whole[place]);
        Ok(answer)
    }
}

fn needed(binary: &Binary, name: &str) -> Result<Symbol, String> {
    binary.symbol(name).ok_or_else(|| format!("its library doesn't export {name}"))
}
