//! Functions that take or give values.

use std::ffi::{CStr, c_int};
use std::ptr::{null, null_mut};

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::system::Causality;
use adaptive_fmu_library::fmi2_functions::*;

use super::catalog::Entry;
use super::dice::Dice;
use super::{Arguments, OK, Sequence};

/// Value of a buffer before it is written, and after its end.
const BLANK: f64 = 7.25;

/// A few variables as arguments.
struct Picked {
    references: Vec<u32>,
    entries: Vec<Entry>,
    right: bool,
}

/// A pointer, or NULL; where there are elements NULL is wrong.
fn or_null<T>(dice: &mut Dice, values: &[T], right: &mut bool) -> *const T {
    if !dice.one_in(40) {
        return values.as_ptr();
    }
    *right &= values.is_empty();
    null()
}

fn or_null_mut<T>(dice: &mut Dice, values: &mut [T], right: &mut bool) -> *mut T {
    if !dice.one_in(40) {
        return values.as_mut_ptr();
    }
    *right &= values.is_empty();
    null_mut()
}

impl Sequence<'_> {
    /// Up to three variables, mostly of those that are wanted, of the type that a function is for.
    fn pick(&self, name: &str, dice: &mut Dice, wanted: impl Fn(&Entry) -> bool) -> Picked {
        let all = self.subject.catalog.of(name);
        let fitting: Vec<Entry> = all.iter().filter(|entry| wanted(entry)).copied().collect();
        let mut picked = Picked { references: Vec::new(), entries: Vec::new(), right: true };
        for _ in 0..dice.below(4) {
            match dice.below(24) {
                0 => picked.refuse(dice.pick(&self.subject.catalog.unknown)),
                1 => {
                    let other =
                        ["fmi2GetReal", "fmi2GetInteger", "fmi2GetBoolean"].map(|name| self.subject.catalog.of(name));
                    let other: Vec<_> = other
                        .into_iter()
                        .flatten()
                        .filter(|e| all.iter().all(|a| a.reference != e.reference))
                        .collect();
                    if !other.is_empty() {
                        picked.refuse(dice.pick(&other).reference);
                    }
                }
                2 if !all.is_empty() => picked.take(dice.pick(all), &wanted),
                _ if !fitting.is_empty() => picked.take(dice.pick(&fitting), &wanted),
                _ => {}
            }
        }
        picked
    }

    pub(super) fn get(&mut self, name: &'static str, dice: &mut Dice) {
        let Picked { references, entries, mut right } = self.pick(name, dice, |_| true);
        let count = references.len();
        let vr = or_null(dice, &references, &mut right);
        let (mut reals, mut integers) = (vec![BLANK; count + 1], vec![77; count + 1]);
        let (real, integer) = match name {
            "fmi2GetReal" => (or_null_mut(dice, &mut reals[..count], &mut right), null_mut()),
            _ => (null_mut(), or_null_mut(dice, &mut integers[..count], &mut right)),
        };
        let text = format!("{references:?}");
        let status = self.call(name, Arguments::of(right), text, |c| unsafe {
            match name {
                "fmi2GetReal" => fmi2GetReal(c, vr, count, real),
                "fmi2GetInteger" => fmi2GetInteger(c, vr, count, integer),
                _ => fmi2GetBoolean(c, vr, count, integer),
            }
        });
        let untouched = reals.iter().all(|&value| value == BLANK) && integers.iter().all(|&value| value == 77);
        self.expect(status == Some(OK) || untouched, "a call that is not OK gives nothing");
        self.expect(reals[count] == BLANK && integers[count] == 77, "nothing is written behind the end");
        self.expect_finite(&reals);
        if status == Some(OK) && name == "fmi2GetBoolean" {
            self.expect(integers[..count].iter().all(|&value| value == TRUE || value == FALSE), "Booleans are 0 or 1");
        }
        // The next step reports a rate of NaN; one at the start may depend on inputs that are still to be set.
        let stands = self.stands() && entries.iter().all(|entry| !entry.rate);
        self.expect(!stands || status.is_none_or(|status| status == OK), "values are numbers between steps");
    }

    pub(super) fn set(&mut self, name: &'static str, dice: &mut Dice) {
        let phase = self.now.phase;
        let Picked { references, entries, mut right } = self.pick(name, dice, |entry| entry.settable(phase));
        let count = references.len();
        let near = |k: usize| entries.get(k).map_or(1.0, |entry| entry.near);
        let mut reals = Vec::new();
        for k in 0..count {
            // Most sets of parameters stay ones with which a unit can start.
            let input = entries.get(k).is_none_or(|entry| entry.causality == Causality::Input);
            reals.push(if input || dice.one_in(5) { dice.number(near(k)) } else { near(k) });
        }
        let mut integers: Vec<c_int> = Vec::new();
        for k in 0..count {
            let items = entries.get(k).and_then(|entry| entry.items);
            integers.push(match (name, items) {
                ("fmi2SetBoolean", _) => dice.pick(&[FALSE, TRUE, TRUE, 2, c_int::MIN]),
                (_, Some(items)) if !dice.one_in(8) => 1 + dice.below(items as usize) as c_int,
                _ if !dice.one_in(4) => near(k) as c_int,
                _ => dice.pick(&[near(k) as c_int, 0, 1, -1, 1000, c_int::MAX, c_int::MIN]),
            });
            right &= name != "fmi2SetInteger" || items.is_none_or(|items| (1..=items).contains(&integers[k]));
        }
        if name == "fmi2SetReal" && count > 0 && dice.one_in(16) {
            reals[count - 1] = dice.not_finite();
            right = false;
        }
        let vr = or_null(dice, &references, &mut right);
        let (real, integer) = match name {
            "fmi2SetReal" => (or_null(dice, &reals, &mut right), null()),
            _ => (null(), or_null(dice, &integers, &mut right)),
        };
        let text = format!(
            "{references:?}, {:?}",
            if name == "fmi2SetReal" { format!("{reals:?}") } else { format!("{integers:?}") }
        );
        let status = self.call(name, Arguments::of(right), text, |c| unsafe {
            match name {
                "fmi2SetReal" => fmi2SetReal(c, vr, count, real),
                "fmi2SetInteger" => fmi2SetInteger(c, vr, count, integer),
                _ => fmi2SetBoolean(c, vr, count, integer),
            }
        });
        if status == Some(OK) {
            self.now.waiting |= phase == 'V' && entries.iter().any(|entry| entry.causality == Causality::Parameter);
            if phase != 'I' {
                self.expect_set(name, &references, &reals, &integers);
            }
        }
    }

    /// Asserts that values which were set read back; of a variable that was named twice, the last.
    fn expect_set(&mut self, name: &str, references: &[u32], reals: &[f64], integers: &[c_int]) {
        let (c, count) = (self.unit.component, references.len());
        let (mut read_reals, mut read_integers) = (vec![BLANK; count], vec![77; count]);
        let status = unsafe {
            match name {
                "fmi2SetReal" => fmi2GetReal(c, references.as_ptr(), count, read_reals.as_mut_ptr()),
                "fmi2SetInteger" => fmi2GetInteger(c, references.as_ptr(), count, read_integers.as_mut_ptr()),
                _ => fmi2GetBoolean(c, references.as_ptr(), count, read_integers.as_mut_ptr()),
            }
        };
        self.expect(status == OK, "what was set can be read");
        for (k, reference) in references.iter().enumerate() {
            let last = references.iter().rposition(|other| other == reference).unwrap_or(k);
            let same = match name {
                "fmi2SetReal" => read_reals[k].to_bits() == reals[last].to_bits(),
                "fmi2SetInteger" => read_integers[k] == integers[last],
                _ => read_integers[k] == Boolean::from(integers[last] != 0),
            };
            self.expect(same, "what was set reads back");
        }
    }

    pub(super) fn strings(&mut self, name: &'static str, dice: &mut Dice) {
        let (reference, count) = (dice.below(100) as u32, dice.below(2));
        let mut text = [c"text".as_ptr()];
        let (vr, get) = (&raw const reference, name == "fmi2GetString");
        self.call(name, Arguments::of(count == 0), format!("{count} values"), |c| unsafe {
            if get {
                fmi2GetString(c, vr, count, text.as_mut_ptr())
            } else {
                fmi2SetString(c, vr, count, text.as_ptr())
            }
        });
    }

    pub(super) fn first_derivatives(&mut self, name: &'static str, dice: &mut Dice) {
        let sets = name == "fmi2SetRealInputDerivatives";
        let wanted = if sets { Causality::Input } else { Causality::Output };
        let Picked { references, mut right, .. } = self.pick(name, dice, |entry| entry.causality == wanted);
        let count = references.len();
        let mut orders = vec![1; count];
        let mut values: Vec<f64> = (0..count).map(|_| if sets { dice.slope() } else { BLANK }).collect();
        if count > 0 && dice.one_in(12) {
            orders[0] = dice.pick(&[0, 2, -1, c_int::MAX]);
            right = false;
        } else if sets && count > 0 && dice.one_in(12) {
            values[0] = dice.not_finite();
            right = false;
        }
        let (vr, order) = (or_null(dice, &references, &mut right), or_null(dice, &orders, &mut right));
        let value = or_null_mut(dice, &mut values, &mut right);
        let text = format!("{references:?}, {orders:?}");
        let status = self.call(name, Arguments::of(right), text, |c| unsafe {
            if sets {
                fmi2SetRealInputDerivatives(c, vr, count, order, value)
            } else {
                fmi2GetRealOutputDerivatives(c, vr, count, order, value)
            }
        });
        if !sets {
            self.expect(status == Some(OK) || values.iter().all(|&value| value == BLANK), "nothing is given");
            self.expect_finite(&values);
        }
    }

    pub(super) fn directional_derivative(&mut self, dice: &mut Dice) {
        let name = "fmi2GetDirectionalDerivative";
        let unknowns = self.pick(name, dice, Entry::calculated);
        // A start depends on inputs only.
        let starts = self.now.phase == 'M';
        let knowns = self.pick(name, dice, |entry| entry.causality == Causality::Input || entry.state && !starts);
        let mut right = unknowns.right && knowns.right;
        let mut seed: Vec<f64> = knowns.references.iter().map(|_| dice.number(1.0)).collect();
        if !seed.is_empty() && dice.one_in(16) {
            seed[0] = dice.not_finite();
            right = false;
        }
        let (of, by) = (&unknowns.references, &knowns.references);
        let mut result = vec![BLANK; of.len()];
        let (of_vr, by_vr) = (or_null(dice, of, &mut right), or_null(dice, by, &mut right));
        let (seed_at, result_at) = (or_null(dice, &seed, &mut right), or_null_mut(dice, &mut result, &mut right));
        let text = format!("{of:?}, {by:?}, {seed:?}");
        let status = self.call(name, Arguments::of(right), text, |c| unsafe {
            fmi2GetDirectionalDerivative(c, of_vr, of.len(), by_vr, by.len(), seed_at, result_at)
        });
        self.expect(status == Some(OK) || result.iter().all(|&value| value == BLANK), "nothing is given");
        self.expect_finite(&result);
    }

    /// The functions of model exchange that take or give all states or indicators.
    pub(super) fn all_states(&mut self, name: &'static str, dice: &mut Dice) {
        let indicators = name == "fmi2GetEventIndicators";
        let expected = if indicators { self.subject.catalog.indicators } else { self.subject.catalog.states };
        let count = if dice.one_in(12) { dice.below(expected + 8) } else { expected };
        let (mut right, sets) = (count == expected, name == "fmi2SetContinuousStates");
        let near: Vec<f64> = self.subject.catalog.reals.iter().filter(|e| e.state).map(|e| e.near).collect();
        let mut values = vec![BLANK; count];
        if sets {
            let scale = dice.number(0.1);
            (0..count).for_each(|k| values[k] = near.get(k).unwrap_or(&0.0) + scale * ((k + 1) as f64).sin());
            if count > 0 && dice.one_in(12) {
                values[count - 1] = dice.not_finite();
                right = false;
            }
        }
        let given = values.clone();
        let text = format!("{:.40}, {count}", if sets { format!("{values:?}") } else { String::new() });
        let x = or_null_mut(dice, &mut values, &mut right);
        let status = self.call(name, Arguments::of(right), text, |c| unsafe {
            match name {
                "fmi2SetContinuousStates" => fmi2SetContinuousStates(c, x, count),
                "fmi2GetContinuousStates" => fmi2GetContinuousStates(c, x, count),
                "fmi2GetDerivatives" => fmi2GetDerivatives(c, x, count),
                "fmi2GetEventIndicators" => fmi2GetEventIndicators(c, x, count),
                _ => fmi2GetNominalsOfContinuousStates(c, x, count),
            }
        });
        match status {
            None => self.expect(same_bits(&values, &given), "a refused call gives nothing"),
            Some(OK) if sets => {
                let mut read = vec![BLANK; count];
                let status = unsafe { fmi2GetContinuousStates(self.unit.component, read.as_mut_ptr(), count) };
                self.expect(status == OK && same_bits(&read, &given), "states that were set read back");
                // They were read at the new point.
                self.now.fingerprint = self.unit.fingerprint();
            }
            Some(OK) => self.expect_finite(&values),
            Some(_) => self.expect(same_bits(&values, &given), "nothing is given"),
        }
    }

    /// Status of steps, which are never asynchronous.
    pub(super) fn status(&mut self, name: &'static str, dice: &mut Dice) {
        let kind = dice.pick(&[status_kind::LAST_SUCCESSFUL_TIME, status_kind::TERMINATED, 0, 1, -1, c_int::MAX]);
        let (mut time, mut flag, mut text) = (BLANK, 77, c"".as_ptr());
        let nowhere = dice.one_in(10);
        let looks = matches!(name, "fmi2GetRealStatus" | "fmi2GetBooleanStatus");
        let status =
            self.call(name, Arguments::of(!(nowhere && looks)), format!("{kind}, NULL: {nowhere}"), |c| unsafe {
                match name {
                    "fmi2GetRealStatus" => fmi2GetRealStatus(c, kind, if nowhere { null_mut() } else { &mut time }),
                    "fmi2GetBooleanStatus" => {
                        fmi2GetBooleanStatus(c, kind, if nowhere { null_mut() } else { &mut flag })
                    }
                    "fmi2GetIntegerStatus" => fmi2GetIntegerStatus(c, kind, &mut flag),
                    "fmi2GetStringStatus" => fmi2GetStringStatus(c, kind, &mut text),
                    _ => fmi2GetStatus(c, kind, &mut flag),
                }
            });
        if status == Some(OK) && name == "fmi2GetRealStatus" {
            self.expect(time.to_bits() == self.now.time.to_bits(), &format!("{time} s is where the last step led"));
        }
        self.expect(unsafe { CStr::from_ptr(text) }.is_empty(), "no text is given");
    }
}

fn same_bits(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl Picked {
    fn refuse(&mut self, reference: u32) {
        self.references.push(reference);
        self.right = false;
    }

    fn take(&mut self, entry: Entry, wanted: impl Fn(&Entry) -> bool) {
        self.references.push(entry.reference);
        self.entries.push(entry);
        self.right &= wanted(&entry);
    }
}
