//! Parameters that a system's design reads.
//!
//! Results of [`System::prepare`](crate::system::System::prepare) are constants of an FMU with C sources, so the
//! parameters that it reads can't be tuned there. It is ordinary Rust, which can't be recorded. So its parameters are
//! found by trials: each variable gets other values that a user may set until the result changes. The result is
//! everything that it leaves: prepared values to the bit, messages, reasons, a panic. A mode may hide what a design
//! reads. So it runs at other points than the start, too: with every choice at other items, and with the variables
//! found so far at other values. If it reads one element of a variable, all elements count.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::error::Invalid;
use crate::structure::Place;
use crate::system::{Data, DynSystem, MessageLog, Point, Section, Variable, Variables};

/// Points with other items of all choices, other Booleans and integers.
const MIXES: u64 = 16;
/// Mark of a prepared value that wasn't written.
const NOT_WRITTEN: (f64, i32) = (f64::NAN, i32::MIN);

/// The parameters that a system's `prepare` reads, around the values of a block.
pub(crate) fn designed(system: &dyn DynSystem, variables: &Variables, block: (&[f64], &[i32])) -> BTreeSet<Place> {
    let mut trials = Trials { system, variables, reals: block.0.to_vec(), integers: block.1.to_vec() };
    let is_own = |variable: &&Variable| variable.section == Section::Parameter && !variables.is_control(variable);
    let mut unread: Vec<_> = variables.iter().filter(is_own).collect();
    let start = trials.parameters();
    let mixes = (0..MIXES).map(|number| mixed(&start, &unread, number)).filter(|mix| *mix != start);
    let mut points: Vec<_> = [start.clone()].into_iter().chain(mixes).collect();
    let mut read = BTreeSet::new();
    while let Some(point) = points.pop() {
        trials.set(&point);
        let Some(answer) = trials.answer() else { continue };
        unread.retain(|variable| {
            let others = trials.other_answers(&answer, variable);
            if others.is_empty() {
                return true;
            }
            points.extend(others);
            read.extend(variable.elements().map(|element| Place::of(variables, element)));
            false
        });
    }
    read
}

/// Values of all parameters.
#[derive(Clone, PartialEq)]
struct Parameters {
    reals: Vec<f64>,
    integers: Vec<i32>,
}

/// All that a design leaves.
#[derive(PartialEq)]
struct Answer {
    refused: Result<(), Invalid>,
    log: MessageLog,
    reals: Vec<u64>,
    integers: Vec<i32>,
}

/// A block that other values are tried in.
struct Trials<'a> {
    system: &'a dyn DynSystem,
    variables: &'a Variables,
    reals: Vec<f64>,
    integers: Vec<i32>,
}

impl Trials<'_> {
    fn parameters(&self) -> Parameters {
        Parameters {
            reals: self.reals[self.variables.reals(Section::Parameter)].to_vec(),
            integers: self.integers[self.variables.integers(Section::Parameter)].to_vec(),
        }
    }

    fn set(&mut self, parameters: &Parameters) {
        self.reals[self.variables.reals(Section::Parameter)].copy_from_slice(&parameters.reals);
        self.integers[self.variables.integers(Section::Parameter)].copy_from_slice(&parameters.integers);
    }

    /// The design of the present parameters; none if it panics.
    fn answer(&mut self) -> Option<Answer> {
        let reals = self.variables.reals(Section::Prepared);
        let integers = self.variables.integers(Section::Prepared);
        self.reals[reals.clone()].fill(NOT_WRITTEN.0);
        self.integers[integers.clone()].fill(NOT_WRITTEN.1);
        let mut log = MessageLog::new();
        let point = &mut Point::new(&mut self.reals, &mut self.integers, self.variables.offsets(), &mut log);
        let refused = catch_unwind(AssertUnwindSafe(|| self.system.prepare(point))).ok()?;
        let reals = self.reals[reals].iter().map(|value| value.to_bits()).collect();
        Some(Answer { refused, log, reals, integers: self.integers[integers].to_vec() })
    }

    /// Parameters that differ in one value of a variable and have another answer: of those that are accepted the ones with
    /// the least and the largest value, or else one that is refused.
    fn other_answers(&mut self, answer: &Answer, variable: &Variable) -> Vec<Parameters> {
        let mut refused = Vec::new();
        for index in variable.elements().map(|element| self.variables.index(element)) {
            let mut accepted = Vec::new();
            let before = self.parameters();
            for other in others(&variable.data, self.value(variable, index)) {
                self.put(variable, index, other);
                let tried = self.parameters();
                match self.answer() {
                    Some(changed) if changed == *answer => {}
                    Some(changed) if changed.refused.is_ok() => accepted.push((other, tried)),
                    _ => refused = vec![tried],
                }
                self.set(&before);
            }
            accepted.sort_by(|(one, _), (other, _)| one.total_cmp(other));
            if let Some(largest) = accepted.pop() {
                return [largest].into_iter().chain(accepted.into_iter().next()).map(|(_, tried)| tried).collect();
            }
        }
        refused
    }

    fn value(&self, variable: &Variable, index: usize) -> f64 {
        if variable.is_real() { self.reals[index] } else { f64::from(self.integers[index]) }
    }

    fn put(&mut self, variable: &Variable, index: usize, value: f64) {
        if variable.is_real() {
            self.reals[index] = value;
        } else {
            self.integers[index] = value as i32;
        }
    }
}

/// Other values than this one that a user may set.
fn others(data: &Data, value: f64) -> Vec<f64> {
    let near = [1.001 * value, 0.5 * value, 2.0 * value, value + 1.0, value - 1.0, -value];
    let far = [0.0, 1.0, -1.0, 1e-3, f64::MIN_POSITIVE, 1e9, -1e9, 1e300, -1e300];
    let within = match data {
        Data::Real { min, max, .. } => near.into_iter().chain(far).chain(*min).chain(*max).collect(),
        Data::Integer { limits, .. } => {
            let (least, most) = limits.unwrap_or((i32::MIN, i32::MAX));
            [value + 1.0, value - 1.0, 0.0, 1.0, -1.0, f64::from(least), f64::from(most)].to_vec()
        }
        Data::Boolean { .. } => vec![1.0 - value],
        Data::Choice { items, .. } => (1..=items.len()).map(|item| item as f64).collect(),
    };
    within.into_iter().filter(|&other| other != value && data.allows(other)).collect()
}

/// The parameters with choices, Booleans and integers drawn among others.
fn mixed(start: &Parameters, variables: &[&Variable], number: u64) -> Parameters {
    let mut mix = start.clone();
    for (k, variable) in variables.iter().enumerate().filter(|(_, variable)| !variable.is_real()) {
        let place = variable.start;
        let value = f64::from(mix.integers[place]);
        let others = others(&variable.data, value);
        let drawn = scattered(number << 32 | k as u64) as usize % (others.len() + 1);
        mix.integers[place] = others.get(drawn).map_or(mix.integers[place], |&other| other as i32);
    }
    mix
}

/// A number that looks random even for neighbouring inputs (splitmix64).
fn scattered(number: u64) -> u64 {
    let mut z = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}
