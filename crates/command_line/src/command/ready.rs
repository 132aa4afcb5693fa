//! Units that are kept from one request to the next, where another program is served.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::Ready;

static KEPT: Mutex<Option<Arc<Ready>>> = Mutex::new(None);
/// Those that a command of many runs holds until its end.
static HELD: Mutex<Weak<Ready>> = Mutex::new(Weak::new());

/// From now on they are kept. Where none can be had, each command tells why itself.
pub fn keep() {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Ready::new().ok().map(Arc::new);
}

/// Those that are kept, or a place for those of this command.
///
/// # Errors
/// When the library that they are of isn't there, or no temporary folder can be had.
pub fn units() -> Result<Arc<Ready>, Error> {
    if let Some(kept) = kept() {
        return Ok(kept);
    }
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(held) = held.upgrade() {
        return Ok(held);
    }
    let units = Arc::new(Ready::new()?);
    *held = Arc::downgrade(&units);
    Ok(units)
}

/// Those that are kept.
pub fn kept() -> Option<Arc<Ready>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Removes them.
pub fn forget() {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).take();
}
