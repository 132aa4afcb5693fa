//! Saved states of a unit.

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu_library::fmi2_functions::*;

use super::{OK, Unit};

impl Unit {
    /// A new saved state.
    pub fn save(&self) -> FmuState {
        let mut state = std::ptr::null_mut();
        assert_eq!(unsafe { fmi2GetFMUstate(self.component, &mut state) }, OK, "{:?}", self.messages());
        state
    }

    pub fn restore(&self, state: FmuState) -> Status {
        unsafe { fmi2SetFMUstate(self.component, state) }
    }

    pub fn free(&self, state: FmuState) -> Status {
        let mut state = state;
        unsafe { fmi2FreeFMUstate(self.component, &mut state) }
    }

    /// A saved state as bytes.
    pub fn bytes(&self, state: FmuState) -> Vec<u8> {
        let mut size = 0;
        assert_eq!(unsafe { fmi2SerializedFMUstateSize(self.component, state, &mut size) }, OK);
        let mut bytes = vec![0_u8; size];
        assert_eq!(unsafe { fmi2SerializeFMUstate(self.component, state, bytes.as_mut_ptr().cast(), size) }, OK);
        bytes
    }

    /// A saved state from bytes; NULL and the status when they are refused.
    pub fn deserialise(&self, bytes: &[u8]) -> (Status, FmuState) {
        let mut state = std::ptr::null_mut();
        let pointer = bytes.as_ptr().cast();
        let status = unsafe { fmi2DeSerializeFMUstate(self.component, pointer, bytes.len(), &mut state) };
        (status, state)
    }

    /// Everything that a continuation depends on, as bytes.
    pub fn fingerprint(&self) -> Vec<u8> {
        let state = self.save();
        let bytes = self.bytes(state);
        assert_eq!(self.free(state), OK);
        bytes
    }
}
