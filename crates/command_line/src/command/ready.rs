//! FMUs that are cached from one request to the next when another program is served.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::Ready;

static KEPT: Mutex<Option<Arc<Ready>>> = Mutex::new(None);
/// Those that a command of many runs holds until its end.
static HELD: Mutex<Weak<Ready>> = Mutex::new(Weak::new());

/// Starts caching. If no FMU can be generated, each command reports the reason itself.
pub fn keep() {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Ready::new().ok().map(Arc::new);
}

/// Returns the cached ones, or a place for those of this command.
///
/// # Errors
/// Their library is missing, or no temporary folder can be created.
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

/// Returns the cached ones.
pub fn kept() -> Option<Arc<Ready>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Removes them.
pub fn forget() {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).take();
}
