//! Saved states of an instance: slots that a master names by a number, and bytes that it may keep.

use std::hash::{BuildHasher, RandomState};

use uuid::Uuid;

use crate::model::{Block, Model};

use super::calls::{Interface, Phase, Standard};

/// Everything that a continuation depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Mark of the unit that it belongs to, with its sizes, the interface and the build.
    pub identity: [u8; 16],
    /// All values.
    pub block: Block,
    /// Phase in the state machine.
    pub phase: Phase,
    /// Stop time, if the master set one.
    pub stop_time: Option<f64>,
}

const MAGIC: &[u8; 8] = b"AFMUSTAT";
const VERSION: u32 = 1;
/// Magic, version, checksum, identity, phase, stop time (with its flag), and the two lengths.
const HEADER: usize = 8 + 4 + 4 + 16 + 1 + 1 + 8 + 8 + 8;

/// Number of bytes of a serialised state.
pub fn serialised_size(block: &Block) -> usize {
    HEADER + 8 * block.reals.len() + 4 * block.integers.len()
}

/// Mark of compatible states: those of one FMU (by its GUID) and interface in one build, by the checksum of its
/// sources, since the meaning of a state may change with them, and a step of co-simulation can't go on from within a
/// master's integrator.
pub fn identity(guid: [u8; 16], interface: Interface, source: &str) -> [u8; 16] {
    let name = [source, interface.describe()].concat();
    Uuid::new_v5(&Uuid::from_bytes(guid), name.as_bytes()).into_bytes()
}

/// A state as bytes.
pub fn serialise(snapshot: &Snapshot) -> Vec<u8> {
    let Block { reals, integers } = &snapshot.block;
    let mut content = Vec::with_capacity(serialised_size(&snapshot.block));
    content.extend(snapshot.identity);
    content.push(snapshot.phase as u8);
    content.push(u8::from(snapshot.stop_time.is_some()));
    content.extend(snapshot.stop_time.unwrap_or(0.0).to_le_bytes());
    content.extend((reals.len() as u64).to_le_bytes());
    content.extend((integers.len() as u64).to_le_bytes());
    content.extend(reals.iter().flat_map(|value| value.to_le_bytes()));
    content.extend(integers.iter().flat_map(|value| value.to_le_bytes()));
    let checksum = crc32fast::hash(&content);
    [MAGIC, &VERSION.to_le_bytes()[..], &checksum.to_le_bytes(), &content].concat()
}

/// A state from bytes, for an instance of a model.
///
/// # Errors
/// Why these bytes are no state of such an instance.
pub fn deserialise(
    bytes: &[u8],
    (identity, of): ([u8; 16], (Standard, Interface)),
    model: &Model,
) -> Result<Snapshot, String> {
    let like = model.start();
    let expected = serialised_size(like);
    if bytes.len() != expected {
        return Err(format!("{} bytes; a state of this FMU has {expected}", bytes.len()));
    }
    let mut rest = bytes;
    let mut take = |count: usize| {
        let (head, tail) = rest.split_at(count);
        rest = tail;
        head
    };
    if take(8) != MAGIC {
        return Err("these are not bytes of a serialised state".to_owned());
    }
    let version = u32_of(take(4));
    if version != VERSION {
        return Err(format!("written in format {version}; this library reads format {VERSION}"));
    }
    let checksum = u32_of(take(4));
    if crc32fast::hash(&bytes[16..]) != checksum {
        return Err("corrupted: the checksum does not fit".to_owned());
    }
    if take(16) != identity {
        return Err("a state of another FMU, of another version of this one, or of its other interface".to_owned());
    }
    let phase = take(1)[0];
    let phase = Phase::ALL.get(phase as usize).filter(|phase| phase.is_of(of)).copied();
    let phase = phase.ok_or("corrupted: no such phase")?;
    let has_stop_time = take(1)[0];
    let stop_time = f64_of(take(8));
    let (reals, integers) = (u64_of(take(8)), u64_of(take(8)));
    if (reals, integers) != (like.reals.len() as u64, like.integers.len() as u64) {
        return Err("corrupted: its sizes are not those of this FMU".to_owned());
    }
    let reals = take(8 * like.reals.len()).chunks_exact(8).map(f64_of).collect();
    let integers = take(4 * like.integers.len()).chunks_exact(4).map(|bytes| u32_of(bytes) as i32).collect();
    if has_stop_time > 1 || (has_stop_time == 1 && !stop_time.is_finite()) {
        return Err("corrupted: its stop time is none".to_owned());
    }
    let block = Block { reals, integers };
    model.check_integers(&block).map_err(|reason| format!("corrupted: {reason}"))?;
    Ok(Snapshot { identity, block, phase, stop_time: (has_stop_time == 1).then_some(stop_time) })
}

fn u32_of(bytes: &[u8]) -> u32 {
    u32::from_le_bytes(bytes.try_into().unwrap_or_default())
}

fn u64_of(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().unwrap_or_default())
}

fn f64_of(bytes: &[u8]) -> f64 {
    f64::from_bits(u64_of(bytes))
}

/// The saved states of one instance. What the master holds is slot and generation, never an address.
#[derive(Debug)]
pub struct Slots {
    slots: Vec<Slot>,
    /// Mixed into the generations, so that a state of another instance, of whatever library, is not taken for one of
    /// its own.
    salt: usize,
}

impl Default for Slots {
    fn default() -> Self {
        Slots { slots: Vec::new(), salt: RandomState::new().hash_one(()) as usize >> SLOT_BITS }
    }
}

#[derive(Debug, Default)]
struct Slot {
    generation: usize,
    saved: Option<Snapshot>,
}

const SLOT_BITS: u32 = 16;

impl Slots {
    /// Saves a state; the number under which it is found (never 0).
    ///
    /// # Errors
    /// When there are too many.
    pub fn save(&mut self, snapshot: Snapshot) -> Result<usize, String> {
        // A slot whose generations are used up is not used again: a number never names two states.
        let usable = |slot: &Slot| slot.saved.is_none() && slot.generation < usize::MAX >> SLOT_BITS;
        let free = self.slots.iter().position(usable);
        let index = free.unwrap_or(self.slots.len());
        if index >= (1 << SLOT_BITS) - 1 {
            return Err(format!("{index} states are saved and none was freed: free some"));
        }
        if free.is_none() {
            self.slots.push(Slot::default());
        }
        let slot = &mut self.slots[index];
        slot.generation += 1;
        slot.saved = Some(snapshot);
        Ok((slot.generation ^ self.salt) << SLOT_BITS | (index + 1))
    }

    fn slot(&mut self, name: usize) -> Option<&mut Slot> {
        let index = (name & ((1 << SLOT_BITS) - 1)).checked_sub(1)?;
        let slot = self.slots.get_mut(index)?;
        (slot.generation ^ self.salt == name >> SLOT_BITS && slot.saved.is_some()).then_some(slot)
    }

    /// The state of this number.
    pub fn find(&mut self, name: usize) -> Option<&mut Snapshot> {
        self.slot(name)?.saved.as_mut()
    }

    /// Frees a state. Returns true if there was one.
    pub fn free(&mut self, name: usize) -> bool {
        self.slot(name).is_some_and(|slot| slot.saved.take().is_some())
    }
}
