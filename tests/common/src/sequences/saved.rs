//! Functions that save, restore and serialise states.

use std::ptr::null_mut;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu_library::fmi2_functions::*;

use super::dice::Dice;
use super::{Arguments, Mark, OK, Sequence};

/// The most saved states at a time.
const MOST: usize = 6;

/// A saved state, as the master holds it, and where the instance was.
pub struct Saved {
    handle: FmuState,
    mark: Mark,
}

impl Sequence<'_> {
    pub(super) fn states(&mut self, name: &'static str, dice: &mut Dice) {
        match name {
            "fmi2GetFMUstate" => self.get_state(dice),
            "fmi2SetFMUstate" => self.set_state(dice),
            "fmi2FreeFMUstate" => self.free_state(dice),
            "fmi2DeSerializeFMUstate" => self.deserialise(dice),
            _ => self.serialise(name, dice),
        }
    }

    /// A handle that a master may have: mostly one of its own states, with its place; otherwise a freed one, one of
    /// another instance, an invalid one, or NULL.
    fn handle(&self, dice: &mut Dice) -> (FmuState, Option<usize>) {
        let own = dice.below(self.saved.len().max(1));
        match dice.below(12) {
            0 => (null_mut(), None),
            1 => (self.subject.foreign, None),
            2 => (dice.pick(&[1, 2, 0xffff, 0x1_0000, 0x7fff_0001, usize::MAX]) as FmuState, None),
            3 if !self.freed.is_empty() => (dice.pick(&self.freed), None),
            _ => self.saved.get(own).map_or((null_mut(), None), |saved| (saved.handle, Some(own))),
        }
    }

    fn get_state(&mut self, dice: &mut Dice) {
        let (given, own) = self.handle(dice);
        let given = if self.saved.len() < MOST && dice.one_in(2) { null_mut() } else { given };
        let own = own.filter(|_| !given.is_null());
        let nowhere = dice.one_in(20);
        let right = !nowhere && (own.is_some() || given.is_null());
        let mut state = given;
        let status = self.call("fmi2GetFMUstate", Arguments::of(right), format!("{own:?}, {given:?}"), |c| unsafe {
            fmi2GetFMUstate(c, if nowhere { null_mut() } else { &mut state })
        });
        self.expect(given.is_null() || state == given, "the master's own pointer stays as it is");
        if status != Some(OK) {
            return self.expect(state == given, "no state is given");
        }
        self.expect(!state.is_null() && state != self.subject.foreign && !self.freed.contains(&state), "a new state");
        match own {
            Some(place) => self.saved[place].mark = self.now.clone(),
            None => self.saved.push(Saved { handle: state, mark: self.now.clone() }),
        }
        self.keep_few();
    }

    /// Frees the oldest of too many saved states.
    fn keep_few(&mut self) {
        if self.saved.len() > MOST {
            let oldest = self.saved.remove(0).handle;
            self.expect(self.unit.free(oldest) == OK, "a saved state is freed");
            self.freed.push(oldest);
        }
    }

    fn set_state(&mut self, dice: &mut Dice) {
        let (state, own) = self.handle(dice);
        let text = format!("{own:?}, {state:?}");
        let status =
            self.call("fmi2SetFMUstate", Arguments::of(own.is_some()), text, |c| unsafe { fmi2SetFMUstate(c, state) });
        if let (Some(OK), Some(place)) = (status, own) {
            let mark = self.saved[place].mark.clone();
            self.expect(self.now.fingerprint == mark.fingerprint, "a restored state is the one that was saved");
            self.now = mark;
        }
    }

    fn free_state(&mut self, dice: &mut Dice) {
        let (given, own) = self.handle(dice);
        let nowhere = dice.one_in(20);
        let right = nowhere || own.is_some() || given.is_null();
        let mut state = given;
        let status = self.call("fmi2FreeFMUstate", Arguments::of(right), format!("{own:?}, {given:?}"), |c| unsafe {
            fmi2FreeFMUstate(c, if nowhere { null_mut() } else { &mut state })
        });
        if let (Some(OK), Some(place), false) = (status, own, nowhere) {
            self.expect(state.is_null(), "the pointer to a freed state becomes NULL");
            self.freed.push(self.saved.remove(place).handle);
        }
    }

    fn serialise(&mut self, name: &'static str, dice: &mut Dice) {
        let (state, own) = self.handle(dice);
        let needed = self.start.fingerprint.len();
        let (mut size, nowhere) = (7, dice.one_in(20));
        let text = format!("{own:?}, {state:?}, NULL: {nowhere}");
        if name == "fmi2SerializedFMUstateSize" {
            let right = Arguments::of(own.is_some() && !nowhere);
            let status = self.call(name, right, text, |c| unsafe {
                fmi2SerializedFMUstateSize(c, state, if nowhere { null_mut() } else { &mut size })
            });
            return self.expect(size == if status == Some(OK) { needed } else { 7 }, "the size that bytes need");
        }
        let length = if dice.one_in(8) { dice.below(2 * needed) } else { needed };
        let mut bytes = vec![7_u8; length];
        let right = Arguments::of(own.is_some() && length >= needed && !nowhere);
        let status = self.call(name, right, text, |c| unsafe {
            fmi2SerializeFMUstate(c, state, if nowhere { null_mut() } else { bytes.as_mut_ptr().cast() }, length)
        });
        let given = own.filter(|_| status == Some(OK)).map_or(&[][..], |place| &self.saved[place].mark.fingerprint);
        let (written, rest) = bytes.split_at(given.len());
        self.expect(written == given && rest.iter().all(|&byte| byte == 7), "its bytes, and nothing behind them");
    }

    fn deserialise(&mut self, dice: &mut Dice) {
        let mark = match dice.below(2 * MOST) {
            place if place < self.saved.len() => self.saved[place].mark.clone(),
            _ => self.now.clone(),
        };
        let own = dice.one_in(3);
        let bytes = if own { mark.fingerprint.clone() } else { self.corrupted(dice, &mark.fingerprint) };
        let nowhere = dice.below(40);
        let mut state = null_mut();
        let right = own && nowhere < 38;
        let text = format!("{} bytes, its own: {own}, NULL: {}", bytes.len(), nowhere > 37);
        let status = self.call("fmi2DeSerializeFMUstate", Arguments::of(right), text, |c| unsafe {
            let pointer = if nowhere == 38 && !bytes.is_empty() { std::ptr::null() } else { bytes.as_ptr().cast() };
            fmi2DeSerializeFMUstate(c, pointer, bytes.len(), if nowhere == 39 { null_mut() } else { &mut state })
        });
        self.expect(
            (status == Some(OK)) != state.is_null(),
            "a state is given where the bytes are good, and only there",
        );
        if status == Some(OK) {
            self.saved.push(Saved { handle: state, mark });
            self.keep_few();
        }
    }

    /// Bytes that are no state of this unit: changed, cut short, lengthened, or of another.
    fn corrupted(&mut self, dice: &mut Dice, bytes: &[u8]) -> Vec<u8> {
        self.tally.corrupted += 1;
        let mut changed = bytes.to_vec();
        let place = dice.below(bytes.len());
        match dice.below(8) {
            0 => changed.truncate(place),
            1 => changed.extend(vec![0; 1 + place % 64]),
            2 => changed.clone_from(&self.subject.strangers[place % self.subject.strangers.len()]),
            3 => changed[place..].fill(0xa5),
            4 => changed.rotate_left(1 + place % (bytes.len() - 1)),
            _ => changed[place] ^= 1 + dice.below(255) as u8,
        }
        changed
    }
}
