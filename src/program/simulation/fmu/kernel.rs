//! Equations of units that were built with this crate, compiled while they already run: their library tells what was recorded
//! of them, this program makes machine code of it, and hands it to instances when it is there. The bits are the same before
//! and after.

use std::collections::HashMap;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;

use super::in_process::Binary;
use crate::cache::{self, Checksum};
use crate::fmi2::build::Build;
use crate::fmi2::describe::read_kernel;
use crate::fmi2::types::Component;
use crate::jit::{self, Compiled};
use crate::kernel::Kernel;

/// What a library exports beside the functions of the standard.
type Tell = unsafe extern "C" fn(Component, Option<Reply>, *mut c_void) -> c_int;
type Reply = unsafe extern "C" fn(*mut c_void, *const c_char);
type Take = unsafe extern "C" fn(Component, *const Kernel) -> c_int;

const TELL: &str = "adaptive_fmu_kernel_functions";
const TAKE: &str = "adaptive_fmu_take_kernel";

/// Checksum of the library in a file that holds these bytes; none where it isn't of this crate. How it was built doesn't
/// tell it: a user's own models change without that.
pub(super) fn checksum(file: &Path, library: &[u8]) -> Option<Checksum> {
    Build::within(library).map(|_| cache::checksum(file, library))
}

/// A kernel that is there now, later or never.
#[derive(Debug, Clone)]
pub(super) struct Awaited(Arc<Sought>);

#[derive(Debug, Default)]
struct Sought {
    found: OnceLock<Result<Made, String>>,
    /// Whether it is being made: a unit that never steps needs none.
    begun: Mutex<bool>,
}

/// A kernel, and the library whose functions it calls.
#[derive(Debug)]
struct Made {
    compiled: Compiled,
    _library: Arc<Binary>,
}

/// Kernels that this process knows, by library and description. They stay until it ends.
static KNOWN: Mutex<Option<HashMap<(Checksum, String), Awaited>>> = Mutex::new(None);

impl Awaited {
    /// The kernel of the unit with a description, in a library with this checksum.
    pub fn of(binary: &Binary, library: &Checksum, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        binary.symbol(TELL).and(binary.symbol(TAKE))?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = known.get_or_insert_default().entry((*library, text));
        Some(entry.or_insert_with(|| Awaited(Arc::default())).clone())
    }

    /// How equations are evaluated.
    pub fn told(&self) -> String {
        let failed = self.0.found.get().and_then(|found| found.as_ref().err().cloned());
        let as_they_are = failed.or_else(jit::refused).map(|reason| format!("as they are: {reason}"));
        as_they_are.unwrap_or_else(|| "compiled while it runs".to_owned())
    }

    /// Hands it to an instance of the library, where it is there, and begins to make it where it isn't; whether there is
    /// nothing more to wait for.
    pub fn hand_to(&self, component: Component, binary: &Arc<Binary>) -> bool {
        let Some(found) = self.0.found.get() else {
            self.begin(component, binary);
            return false;
        };
        if let (Ok(made), Some(take)) = (found, binary.symbol(TAKE)) {
            // SAFETY: a library of this crate gives the symbol this type, and told itself what was compiled. The instance is
            // alive and in no other call; the kernel stays in memory until the process ends (`KNOWN`).
            unsafe { std::mem::transmute::<unsafe extern "C" fn(), Take>(take)(component, made.compiled.kernel()) };
        }
        true
    }

    /// Begins to make it, if nothing has.
    fn begin(&self, component: Component, binary: &Arc<Binary>) {
        let mut begun = self.0.begun.lock().unwrap_or_else(PoisonError::into_inner);
        if std::mem::replace(&mut *begun, true) {
            return;
        }
        let told = functions(component, binary);
        let (awaited, binary) = (self.clone(), Arc::clone(binary));
        thread::spawn(move || {
            let compiled = told.and_then(|told| Compiled::of(&read_kernel(&told).flatten()?));
            awaited.0.found.set(compiled.map(|compiled| Made { compiled, _library: binary }))
        });
    }
}

/// What an instance tells of its equations.
fn functions(component: Component, binary: &Binary) -> Result<String, String> {
    let mut reply: Option<String> = None;
    if let Some(tell) = binary.symbol(TELL) {
        // SAFETY: a library of this crate gives the symbol this type; the instance is alive and in no other call, and the
        // reply's place lives longer than this one.
        unsafe {
            let tell = std::mem::transmute::<unsafe extern "C" fn(), Tell>(tell);
            tell(component, Some(keep), std::ptr::from_mut(&mut reply).cast());
        }
    }
    reply.ok_or_else(|| "its library doesn't tell them".to_owned())
}

unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: called by the library with the place that it was given, and a C string.
    unsafe { *context.cast::<Option<String>>() = Some(CStr::from_ptr(text).to_string_lossy().into_owned()) };
}
