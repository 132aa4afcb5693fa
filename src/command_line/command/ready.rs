//! Units that are kept from one request to the next, where another program is served.

use std::sync::{Arc, Mutex, PoisonError};

use adaptive_fmu::error::Error;
use adaptive_fmu::simulation::Ready;

static KEPT: Mutex<Option<Arc<Ready>>> = Mutex::new(None);

/// From now on they are kept. Where none can be had, each command tells why itself.
pub fn keep() {
    *KEPT.lock().unwrap_or_else(PoisonError::into_inner) = Ready::new().ok().map(Arc::new);
}

/// Those that are kept, or a place for those of this command.
///
/// # Errors
/// When the library that they are of isn't there, or no temporary folder can be had.
pub fn units() -> Result<Arc<Ready>, Error> {
    kept().map_or_else(|| Ready::new().map(Arc::new), Ok)
}

/// Those that are kept.
pub fn kept() -> Option<Arc<Ready>> {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Removes them.
pub fn forget() {
    KEPT.lock().unwrap_or_else(PoisonError::into_inner).take();
}
