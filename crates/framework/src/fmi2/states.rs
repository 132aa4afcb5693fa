//! Saving, restoring and serialising an instance.

use super::calls::{Answer, Function, Refused, Standard};
use super::instance::Instance;
use super::snapshot::{self, Snapshot};

impl Instance {
    fn snapshot(&self) -> Snapshot {
        let Instance { identity, phase, stop_time, .. } = *self;
        Snapshot { identity, block: self.execution.block().clone(), phase, stop_time }
    }

    /// fmi2GetFMUstate, into the slot of this name, or a new one where it is 0.
    ///
    /// # Errors
    /// When there is no such slot.
    pub fn get_state(&mut self, name: usize) -> Answer<usize> {
        let function = self.called(Function::GetFMUstate);
        let snapshot = self.snapshot();
        if name == 0 {
            return self.slots.save(snapshot).map_err(|reason| Refused(format!("{function}: {reason}")));
        }
        *self.slots.find(name).ok_or_else(|| unknown_state(function))? = snapshot;
        Ok(name)
    }

    /// fmi2SetFMUstate
    ///
    /// # Errors
    /// When there is no such state, or it is one of other sizes.
    pub fn set_state(&mut self, name: usize) -> Answer {
        let function = self.called(Function::SetFMUstate);
        let saved = self.slots.find(name).ok_or_else(|| unknown_state(function))?;
        if saved.identity != self.identity {
            let reason =
                "this state has other sizes than the instance: reset it, and set these in Configuration Mode first";
            return Err(Refused(format!("{function}: {reason}")));
        }
        self.execution.block_mut().copy_from(&saved.block);
        self.phase = saved.phase;
        self.stop_time = saved.stop_time;
        self.execution.log.clear();
        if self.of.0 == Standard::Fmi3 {
            self.execution.find_indicators();
        }
        Ok(())
    }

    /// fmi2FreeFMUstate
    ///
    /// # Errors
    /// When there is no such state.
    pub fn free_state(&mut self, name: usize) -> Answer {
        let function = self.called(Function::FreeFMUstate);
        if self.slots.free(name) { Ok(()) } else { Err(unknown_state(function)) }
    }

    /// fmi2SerializedFMUstateSize
    ///
    /// # Errors
    /// When there is no such state.
    pub fn serialised_size(&mut self, name: usize) -> Answer<usize> {
        let function = self.called(Function::SerializedFMUstateSize);
        let saved = self.slots.find(name).ok_or_else(|| unknown_state(function))?;
        Ok(snapshot::serialised_size(&saved.block))
    }

    /// fmi2SerializeFMUstate
    ///
    /// # Errors
    /// When there is no such state.
    pub fn serialise(&mut self, name: usize) -> Answer<Vec<u8>> {
        let function = self.called(Function::SerializeFMUstate);
        let saved = self.slots.find(name).ok_or_else(|| unknown_state(function))?;
        Ok(snapshot::serialise(saved))
    }

    /// fmi2DeSerializeFMUstate; the name of the new saved state.
    ///
    /// # Errors
    /// When the bytes are no state of this unit.
    pub fn deserialise(&mut self, bytes: &[u8]) -> Answer<usize> {
        let function = self.called(Function::DeSerializeFMUstate);
        let refuse = |reason: String| Refused(format!("{function}: {reason}"));
        let snapshot =
            snapshot::deserialise(bytes, (self.identity, self.of), self.execution.model()).map_err(refuse)?;
        self.slots.save(snapshot).map_err(refuse)
    }
}

fn unknown_state(function: &str) -> Refused {
    Refused(format!("{function}: this is not a saved state of this instance (never was, or freed before)"))
}
