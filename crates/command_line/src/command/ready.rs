//! FMUs that are cached from one request to the next when another program is served.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use adaptive_fmu::error::Error;
use adaptive_fmu::fmu::Ready;

static CACHED: Mutex<Option<Arc<Ready>>> = Mutex::new(None);
/// Those that a command of many runs holds until its end.
static IN_USE: Mutex<Weak<Ready>> = Mutex::new(Weak::new());

/// Starts caching. If no FMU can be generated, each command reports the reason itself.
pub fn keep() {
    *CACHED.lock().unwrap_or_else(PoisonError::into_inner) = Ready::new().ok().map(Arc::new);
}

/// Returns the cached ones, or a place for those of this command.
///
/// # Errors
/// Their library is missing, or no temporary folder can be created.
pub fn units() -> Result<Arc<Ready>, Error> {
    if let Some(cached) = cached() {
        return Ok(cached);
    }
    let mut in_use = IN_USE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(in_use) = in_use.upgrade() {
        return Ok(in_use);
    }
    let units = Arc::new(Ready::new()?);
    *in_use = Arc::downgrade(&units);
    Ok(units)
}

/// Returns the cached ones.
pub fn cached() -> Option<Arc<Ready>> {
    CACHED.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Removes them.
pub fn forget() {
    CACHED.lock().unwrap_or_else(PoisonError::into_inner).take();
}
