//! A panic never crosses the C boundary, and prints nothing into the host's streams.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};
use std::sync::OnceLock;

thread_local! {
    static INSIDE: Cell<bool> = const { Cell::new(false) };
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Runs code that may panic.
///
/// # Errors
/// The panic's text and place.
pub fn contain<T>(call: impl FnOnce() -> T) -> Result<T, String> {
    silence();
    INSIDE.set(true);
    let result = catch_unwind(AssertUnwindSafe(call));
    INSIDE.set(false);
    result.map_err(|payload| format!("{} ({})", text(&*payload), PLACE.take()))
}

type Hook = Box<dyn Fn(&PanicHookInfo<'_>) + Send + Sync>;

/// Installs a hook in this library's own copy of the standard library. It notes where a contained panic happened, and
/// passes all others to the previous hook. That one is stored in a static, not captured: an allocation would be lost
/// when a master unloads the library.
fn silence() {
    static BEFORE: OnceLock<Hook> = OnceLock::new();
    BEFORE.get_or_init(|| {
        let before = take_hook();
        set_hook(Box::new(|info| {
            if INSIDE.get() {
                PLACE.set(info.location().map(ToString::to_string).unwrap_or_default());
            } else if let Some(before) = BEFORE.get() {
                before(info);
            }
        }));
        before
    });
}

fn text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a fault without a text".to_owned())
}
