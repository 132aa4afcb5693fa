//! Equations of units that were built with this crate, compiled while they already run: their library tells what was recorded
//! of them, this program makes machine code of it, and hands it to instances when it is there. The bits are the same before
//! and after.
//!
//! A kernel is for any parameters, and then for all instances of a unit; or it is folded, for those of one instance alone,
//! whose numbers stand in the code. An instance leaves a folded one by itself as soon as a parameter is another.

use std::collections::HashMap;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;

use super::in_process::{Binary, Symbol};
use crate::cache::{self, Checksum};
use crate::fmi2::build::Build;
use crate::fmi2::describe::read_kernel;
use crate::fmi2::types::Component;
use crate::jit::{self, Compiled};
use crate::kernel::Kernel;

/// What a library exports beside the functions of the standard.
type Tell = unsafe extern "C" fn(Component, c_int, Option<Reply>, *mut c_void) -> c_int;
type Reply = unsafe extern "C" fn(*mut c_void, *const c_char);
type Take = unsafe extern "C" fn(Component, *const Kernel, c_int) -> c_int;
type Has = unsafe extern "C" fn(Component) -> c_int;

/// So many instances have kernels of their own at a time; each takes some 10 ms and 50 kB.
const MOST_FOLDED: usize = 16;

/// Whether instances get kernels of their own.
static FOLDS: AtomicBool = AtomicBool::new(false);
/// How many have.
static FOLDED: AtomicUsize = AtomicUsize::new(0);

/// From now on, or no longer, equations are compiled for the parameters of each instance: that pays where each is stepped for
/// long, and few are made.
pub fn fold_parameters(folds: bool) {
    FOLDS.store(folds, Ordering::Relaxed);
}

/// Checksum of the library in a file that holds these bytes; none where it isn't of this crate. How it was built doesn't
/// tell it: a user's own models change without that.
pub(super) fn checksum(file: &Path, library: &[u8]) -> Option<Checksum> {
    Build::within(library).map(|_| cache::checksum(file, library))
}

/// A kernel of a unit that is there now, later or never.
#[derive(Debug, Clone)]
pub(super) struct Awaited {
    sought: Arc<Sought>,
    functions: Functions,
}

/// The functions of a library.
#[derive(Debug, Clone, Copy)]
struct Functions {
    tell: Tell,
    take: Take,
    has: Has,
}

#[derive(Debug, Default)]
pub(super) struct Sought {
    found: OnceLock<Result<Made, String>>,
    /// Whether it is being made: a unit that never steps needs none.
    begun: AtomicBool,
}

/// A kernel, and the library whose functions it calls.
#[derive(Debug)]
struct Made {
    compiled: Compiled,
    _library: Arc<Binary>,
}

/// Kernels for any parameters that this process knows, by library and description. They stay until it ends.
static KNOWN: Mutex<Option<HashMap<(Checksum, String), Awaited>>> = Mutex::new(None);

impl Awaited {
    /// The kernel of the unit with a description, in a library with this checksum.
    pub fn of(binary: &Binary, library: &Checksum, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        let functions = Functions::of(binary)?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = known.get_or_insert_default().entry((*library, text));
        Some(entry.or_insert_with(|| Awaited { sought: Arc::default(), functions }).clone())
    }

    /// How equations are evaluated.
    pub fn told(&self) -> String {
        let failed = self.sought.found.get().and_then(|found| found.as_ref().err().cloned());
        let as_they_are = failed.or_else(jit::refused).map(|reason| format!("as they are: {reason}"));
        as_they_are.unwrap_or_else(|| "compiled while it runs".to_owned())
    }
}

/// Instances with kernels of their own, as long as they live.
#[derive(Debug)]
pub(super) struct Counted;

impl Counted {
    fn one() -> Option<Self> {
        // What is counted is dropped again where there are too many.
        let before = FOLDED.fetch_add(1, Ordering::Relaxed);
        Some(Counted).filter(|_| before < MOST_FOLDED)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        FOLDED.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A kernel of an instance's own.
#[derive(Debug)]
pub(super) struct Folding {
    own: Arc<Sought>,
    of_unit: Awaited,
    _counted: Counted,
}

/// What becomes of the equations of an instance.
#[derive(Debug)]
pub(super) enum Equations {
    /// Nothing more.
    Settled,
    /// It waits for its unit's kernel.
    Waiting(Awaited),
    /// It waits for one of its own; if that is of no use, there is the unit's.
    Folding(Folding),
    /// It has one of its own. Now and then it is asked whether it still has; so many steps ago.
    Folded(Folding, u8),
}

impl Equations {
    /// Of an instance of a unit, where that has a kernel.
    pub fn of(unit: Option<Awaited>) -> Self {
        let folds = FOLDS.load(Ordering::Relaxed).then(Counted::one).flatten();
        match (unit, folds) {
            (None, _) => Equations::Settled,
            (Some(unit), None) => Equations::Waiting(unit),
            (Some(of_unit), Some(_counted)) => Equations::Folding(Folding { own: Arc::default(), of_unit, _counted }),
        }
    }

    /// Hands a kernel to the instance, where one is there, and begins to make it where it isn't.
    pub fn look(&mut self, component: Component, binary: &Arc<Binary>) {
        let hand =
            |sought: &Arc<Sought>, of: &Awaited, folded| sought.hand_to(component, (binary, of.functions), folded);
        *self = match std::mem::replace(self, Equations::Settled) {
            Equations::Settled => Equations::Settled,
            Equations::Waiting(unit) => match hand(&unit.sought, &unit, false) {
                None => Equations::Waiting(unit),
                Some(_) => Equations::Settled,
            },
            Equations::Folding(folding) => match hand(&folding.own, &folding.of_unit, true) {
                None => Equations::Folding(folding),
                Some(true) => Equations::Folded(folding, 0),
                Some(false) => Equations::Waiting(folding.of_unit),
            },
            // SAFETY: a library of this crate gives the symbol this type; the instance is alive and in no other call.
            Equations::Folded(folding, u8::MAX) if unsafe { (folding.of_unit.functions.has)(component) } == 0 => {
                // It has left what is dropped here.
                Equations::Waiting(folding.of_unit)
            }
            Equations::Folded(folding, asked) => Equations::Folded(folding, asked.wrapping_add(1)),
        };
    }
}

impl Functions {
    fn of(binary: &Binary) -> Option<Self> {
        let find = |name| binary.symbol(name);
        let (tell, take) = (find("adaptive_fmu_kernel_functions")?, find("adaptive_fmu_take_kernel")?);
        let has = find("adaptive_fmu_has_kernel")?;
        // SAFETY: a library of this crate gives the symbols these types.
        unsafe {
            Some(Functions {
                tell: std::mem::transmute::<Symbol, Tell>(tell),
                take: std::mem::transmute::<Symbol, Take>(take),
                has: std::mem::transmute::<Symbol, Has>(has),
            })
        }
    }
}

impl Sought {
    /// Hands it to an instance of the library; whether that took it, and nothing where it isn't there yet.
    fn hand_to(
        self: &Arc<Self>,
        component: Component,
        (binary, functions): (&Arc<Binary>, Functions),
        folded: bool,
    ) -> Option<bool> {
        let Some(found) = self.found.get() else {
            if !self.begun.swap(true, Ordering::Relaxed) {
                self.begin(told(component, functions.tell, folded), binary);
            }
            return None;
        };
        // SAFETY: the library itself told what was compiled. The instance is alive and in no other call; the kernel stays in
        // memory until the process ends (`KNOWN`) or, folded, as long as what holds the instance.
        let take = |made: &Made| unsafe { (functions.take)(component, made.compiled.kernel(), folded.into()) } != 0;
        Some(found.as_ref().is_ok_and(take))
    }

    /// Begins to make it of what was told.
    fn begin(self: &Arc<Self>, told: Result<String, String>, binary: &Arc<Binary>) {
        let (sought, binary) = (Arc::clone(self), Arc::clone(binary));
        thread::spawn(move || {
            let compiled = told.and_then(|told| Compiled::of(&read_kernel(&told).flatten()?));
            sought.found.set(compiled.map(|compiled| Made { compiled, _library: binary }))
        });
    }
}

/// What an instance tells of its equations.
fn told(component: Component, tell: Tell, folded: bool) -> Result<String, String> {
    let mut reply: Option<String> = None;
    // SAFETY: the instance is alive and in no other call, and the reply's place lives longer than this one.
    unsafe { tell(component, folded.into(), Some(keep), std::ptr::from_mut(&mut reply).cast()) };
    reply.ok_or_else(|| "its library doesn't tell them".to_owned())
}

unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: called by the library with the place that it was given, and a C string.
    unsafe { *context.cast::<Option<String>>() = Some(CStr::from_ptr(text).to_string_lossy().into_owned()) };
}
