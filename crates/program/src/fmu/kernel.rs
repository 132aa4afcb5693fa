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
use std::time::Duration;

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

/// Only a run that goes on for so long after its equations were compiled is worth the second kernel.
const PATIENCE: Duration = Duration::from_millis(200);

/// So many instances have kernels of their own at a time; each takes some 10 ms and 50 kB.
const MOST_FOLDED: usize = 16;

/// True if instances get kernels of their own.
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

/// The functions of a library, as it was loaded once.
#[derive(Debug, Clone, Copy)]
struct Functions {
    tell: Tell,
    take: Take,
    has: Has,
}

#[derive(Debug, Default)]
pub(super) struct Sought {
    /// First one that is made quickly, and then a better one with the Jacobian too, which many runs are too short for.
    found: [OnceLock<Result<Made, String>>; 2],
    /// True if it is being made: a unit that never steps needs none.
    begun: AtomicBool,
}

/// A kernel, and the library whose functions it calls.
#[derive(Debug)]
struct Made {
    compiled: Compiled,
    _library: Arc<Binary>,
}

/// Kernels by library and description.
type Known = HashMap<(Checksum, String), Arc<Sought>>;

/// Those for any parameters that this process has. They stay until it ends.
static KNOWN: Mutex<Option<Known>> = Mutex::new(None);

impl Awaited {
    /// The kernel of the unit with a description, in a library with this checksum.
    pub fn of(binary: &Binary, library: &Checksum, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        let functions = Functions::of(binary)?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        // The library may be loaded many times, each time to another place: the kernel serves all, functions are of this one.
        let sought = Arc::clone(known.get_or_insert_default().entry((*library, text)).or_default());
        Some(Awaited { sought, functions })
    }

    /// How equations are evaluated.
    pub fn told(&self) -> String {
        let failed = self.sought.found[0].get().and_then(|found| found.as_ref().err().cloned());
        let as_they_are = failed.or_else(jit::refused).map(|reason| format!("not compiled: {reason}"));
        as_they_are.unwrap_or_else(|| "compiled during the run".to_owned())
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
    /// It waits for its unit's kernel, the first or the second.
    Waiting(Awaited, usize),
    /// It waits for one of its own; if that is of no use, there is the unit's.
    Folding(Folding),
    /// It has one of its own, and waits for the second or not. Now and then it is asked whether it still has; so many steps ago.
    Folded(Folding, bool, u8),
}

impl Equations {
    /// Of an instance of a unit, where that has a kernel.
    pub fn of(unit: Option<Awaited>) -> Self {
        let folds = FOLDS.load(Ordering::Relaxed).then(Counted::one).flatten();
        match (unit, folds) {
            (None, _) => Equations::Settled,
            (Some(unit), None) => Equations::Waiting(unit, 0),
            (Some(of_unit), Some(_counted)) => Equations::Folding(Folding { own: Arc::default(), of_unit, _counted }),
        }
    }

    /// Hands a kernel to the instance, where one is there, and begins to make it where it isn't.
    pub fn look(&mut self, component: Component, binary: &Arc<Binary>) {
        let of_unit = |unit: &Awaited, which| unit.sought.hand_to(which, component, (binary, unit.functions), false);
        let of_own = |it: &Folding, which| it.own.hand_to(which, component, (binary, it.of_unit.functions), true);
        *self = match std::mem::replace(self, Equations::Settled) {
            Equations::Settled => Equations::Settled,
            Equations::Waiting(unit, which) => match of_unit(&unit, which) {
                None => Equations::Waiting(unit, which),
                Some(true) if which == 0 => Equations::Waiting(unit, 1),
                Some(_) => Equations::Settled,
            },
            Equations::Folding(folding) => match of_own(&folding, 0) {
                None => Equations::Folding(folding),
                Some(true) => Equations::Folded(folding, true, 0),
                Some(false) => Equations::Waiting(folding.of_unit, 0),
            },
            // SAFETY: a library of this crate gives the symbol this type; the instance is alive and in no other call.
            Equations::Folded(folding, _, u8::MAX) if unsafe { (folding.of_unit.functions.has)(component) } == 0 => {
                // It has left what is dropped here, and nothing else is of use.
                Equations::Waiting(folding.of_unit, 0)
            }
            Equations::Folded(folding, waits, asked) => {
                // Where it refuses the second, it may still have the first.
                let waits = waits && of_own(&folding, 1).is_none();
                Equations::Folded(folding, waits, asked.wrapping_add(1))
            }
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
    /// Hands one of the two to an instance of the library; whether that took it, and nothing where it isn't there yet.
    fn hand_to(
        self: &Arc<Self>,
        which: usize,
        component: Component,
        (binary, functions): (&Arc<Binary>, Functions),
        folded: bool,
    ) -> Option<bool> {
        let Some(found) = self.found[which].get() else {
            if which == 0 && !self.begun.swap(true, Ordering::Relaxed) {
                self.begin(told(component, functions.tell, folded), binary);
            }
            return None;
        };
        // SAFETY: the library itself told what was compiled. The instance is alive and in no other call; the kernel stays in
        // memory until the process ends (`KNOWN`) or, folded, as long as what holds the instance.
        let take = |made: &Made| unsafe { (functions.take)(component, made.compiled.kernel(), folded.into()) } != 0;
        Some(found.as_ref().is_ok_and(take))
    }

    /// Begins to make both of what was told.
    fn begin(self: &Arc<Self>, told: Result<String, String>, binary: &Arc<Binary>) {
        let (sought, binary) = (Arc::clone(self), Arc::clone(binary));
        thread::spawn(move || {
            let made = |compiled| Made { compiled, _library: Arc::clone(&binary) };
            let functions = told.and_then(|told| read_kernel(&told).flatten());
            let found = functions.as_ref().map_err(Clone::clone).and_then(Compiled::evaluation);
            let _ = sought.found[0].set(found.map(made));
            let Some(functions) = functions.ok().filter(|functions| functions.jacobian.is_some()) else { return };
            thread::sleep(PATIENCE);
            // Unless nobody waits any more.
            if Arc::strong_count(&sought) > 1 {
                let _ = sought.found[1].set(Compiled::of(&functions).map(made));
            }
        });
    }
}

/// What an instance tells of its equations.
fn told(component: Component, tell: Tell, folded: bool) -> Result<String, String> {
    let mut reply: Option<String> = None;
    // SAFETY: the instance is alive and in no other call, and the reply's place lives longer than this one.
    unsafe { tell(component, folded.into(), Some(keep), std::ptr::from_mut(&mut reply).cast()) };
    reply.ok_or_else(|| "the library of the FMU doesn't provide its equations".to_owned())
}

unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: called by the library with the place that it was given, and a C string.
    unsafe { *context.cast::<Option<String>>() = Some(CStr::from_ptr(text).to_string_lossy().into_owned()) };
}
