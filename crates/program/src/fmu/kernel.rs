//! Equations of FMUs that were built with this crate, compiled while these already run: their library hands over the
//! recorded equations, and this program hands their machine code to instances once it is ready. Results are the same
//! to the bit.
//!
//! A kernel is for any parameters, and so for all instances of an FMU; or it is folded: its code contains the values of
//! one instance's parameters, or of those that all samples of a study have in common. An instance drops a folded kernel by
//! itself as soon as such a parameter changes.

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

/// Functions that a library exports in addition to those of the standard.
type ReadFunctions = unsafe extern "C" fn(Component, Component, Option<Reply>, *mut c_void) -> c_int;
type Reply = unsafe extern "C" fn(*mut c_void, *const c_char);
type Take = unsafe extern "C" fn(Component, *const Kernel) -> c_int;
type Has = unsafe extern "C" fn(Component) -> c_int;

/// Delay of the second kernel, which doesn't pay for runs that end sooner.
const PATIENCE: Duration = Duration::from_millis(200);

/// Largest number of instances with folded kernels at a time; each takes some 10 ms and 50 kB.
const MOST_FOLDED: usize = 16;

/// True if instances get kernels of their own.
static FOLDS: AtomicBool = AtomicBool::new(false);
/// Number of instances that have one.
static FOLDED: AtomicUsize = AtomicUsize::new(0);

/// Turns folding on or off for all further instances: equations are then compiled for the parameters of each. That pays
/// if instances are few and each takes many steps.
pub fn fold_parameters(folds: bool) {
    FOLDS.store(folds, Ordering::Relaxed);
}

/// Checksum of a library from its file's bytes; none if it isn't of this crate. The mark of the build isn't enough,
/// since a user's own models change without it.
pub(super) fn checksum(file: &Path, library: &[u8]) -> Option<Checksum> {
    Build::within(library).map(|_| cache::checksum(file, library))
}

/// A kernel of an FMU that is ready now, later or never.
#[derive(Debug, Clone)]
pub(super) struct Awaited {
    sought: Arc<Sought>,
    functions: Functions,
    /// A kernel for the parameters that further instances have in common.
    common: Arc<OnceLock<Common>>,
}

/// A kernel for parameters that several instances have in common.
#[derive(Debug, Clone)]
pub struct Common(Arc<Sought>);

/// The functions of one loaded library.
#[derive(Debug, Clone, Copy)]
struct Functions {
    read: ReadFunctions,
    take: Take,
    has: Has,
}

#[derive(Debug, Default)]
pub(super) struct Sought {
    /// A first kernel, which compiles quickly, and a second one with the Jacobian, which many runs are too short for.
    found: [OnceLock<Result<Made, String>>; 2],
    /// True once its compilation has begun: an FMU that never steps needs none.
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

/// All kernels for any parameters, until the process ends.
static KNOWN: Mutex<Option<Known>> = Mutex::new(None);

impl Awaited {
    /// The kernel of the FMU with a description, in a library with this checksum.
    pub fn of(binary: &Binary, library: &Checksum, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        let functions = Functions::of(binary)?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        // The library may be loaded at several addresses: the kernel serves all, the functions only this one.
        let sought = Arc::clone(known.get_or_insert_default().entry((*library, text)).or_default());
        Some(Awaited { sought, functions, common: Arc::default() })
    }

    /// Compiles a kernel for the parameters that two instances of the library have in common; none if that fails.
    pub fn compile_common(&self, components: [Component; 2], binary: &Arc<Binary>) -> Option<Common> {
        let functions =
            read_kernel(&equations_text(components[0], components[1], self.functions.read).ok()?).ok()?.ok()?;
        let made = Made { compiled: Compiled::of(&functions).ok()?, _library: Arc::clone(binary) };
        // It is complete, so a second one never comes.
        let found = [OnceLock::from(Ok(made)), OnceLock::from(Err(String::new()))];
        Some(Common(Arc::new(Sought { found, begun: AtomicBool::new(true) })))
    }

    /// Hands a kernel of common parameters to all further instances.
    pub fn share(&self, common: &Common) {
        let _ = self.common.set(common.clone());
    }

    /// Text on how equations are evaluated.
    pub fn status(&self) -> String {
        let failed = self.sought.found[0].get().and_then(|found| found.as_ref().err().cloned());
        let as_they_are = failed.or_else(jit::refused).map(|reason| format!("not compiled: {reason}"));
        as_they_are.unwrap_or_else(|| "compiled during the run".to_owned())
    }
}

/// Counts an instance with a folded kernel until it is dropped.
#[derive(Debug)]
pub(super) struct Counted;

impl Counted {
    fn one() -> Option<Self> {
        // If there are too many, dropping the value uncounts it.
        let before = FOLDED.fetch_add(1, Ordering::Relaxed);
        Some(Counted).filter(|_| before < MOST_FOLDED)
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        FOLDED.fetch_sub(1, Ordering::Relaxed);
    }
}

/// A folded kernel of an instance.
#[derive(Debug)]
pub(super) struct Folding {
    own: Arc<Sought>,
    of_unit: Awaited,
    _counted: Option<Counted>,
}

/// State of the equations of an instance.
#[derive(Debug)]
pub(super) enum Equations {
    /// No kernel is awaited any more.
    Settled,
    /// It waits for its FMU's kernel, the first or the second.
    Waiting(Awaited, usize),
    /// It waits for a folded one; if it can't use that, it takes the FMU's.
    Folding(Folding),
    /// It has a folded one. True if it waits for the second; the number of steps since the last check that it still
    /// has one.
    Folded(Folding, bool, u8),
}

impl Equations {
    /// Equations of an instance of an FMU, with its kernel if it has one.
    pub fn of(unit: Option<Awaited>) -> Self {
        let Some(of_unit) = unit else { return Equations::Settled };
        if let Some(Common(own)) = of_unit.common.get().cloned() {
            return Equations::Folding(Folding { own, of_unit, _counted: None });
        }
        match FOLDS.load(Ordering::Relaxed).then(Counted::one).flatten() {
            None => Equations::Waiting(of_unit, 0),
            counted => Equations::Folding(Folding { own: Arc::default(), of_unit, _counted: counted }),
        }
    }

    /// Hands a kernel to the instance if one is ready, else starts its compilation.
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
                // The instance no longer uses the kernel, which is dropped here.
                Equations::Waiting(folding.of_unit, 0)
            }
            Equations::Folded(folding, waits, asked) => {
                // If it refuses the second, it may still have the first.
                let waits = waits && of_own(&folding, 1).is_none();
                Equations::Folded(folding, waits, asked.wrapping_add(1))
            }
        };
    }
}

impl Functions {
    fn of(binary: &Binary) -> Option<Self> {
        let find = |name| binary.symbol(name);
        let (read, take) = (find("adaptive_fmu_kernel_functions")?, find("adaptive_fmu_take_kernel")?);
        let has = find("adaptive_fmu_has_kernel")?;
        // SAFETY: a library of this crate gives the symbols these types.
        unsafe {
            Some(Functions {
                read: std::mem::transmute::<Symbol, ReadFunctions>(read),
                take: std::mem::transmute::<Symbol, Take>(take),
                has: std::mem::transmute::<Symbol, Has>(has),
            })
        }
    }
}

impl Sought {
    /// Hands one of the two to an instance of the library. Returns true if that took it, and none if it isn't ready.
    fn hand_to(
        self: &Arc<Self>,
        which: usize,
        component: Component,
        (binary, functions): (&Arc<Binary>, Functions),
        folded: bool,
    ) -> Option<bool> {
        let Some(found) = self.found[which].get() else {
            if which == 0 && !self.begun.swap(true, Ordering::Relaxed) {
                // For its own parameters, or for any.
                let other = if folded { component } else { std::ptr::null_mut() };
                self.begin(equations_text(component, other, functions.read), binary);
            }
            return None;
        };
        // SAFETY: the library itself handed over the compiled equations. The instance is alive and in no other call;
        // the kernel stays in memory until the process ends (`KNOWN`) or, if folded, as long as the instance's owner.
        let take = |made: &Made| unsafe { (functions.take)(component, made.compiled.kernel()) } != 0;
        Some(found.as_ref().is_ok_and(take))
    }

    /// Starts the compilation of both.
    fn begin(self: &Arc<Self>, text: Result<String, String>, binary: &Arc<Binary>) {
        let (sought, binary) = (Arc::clone(self), Arc::clone(binary));
        thread::spawn(move || {
            let made = |compiled| Made { compiled, _library: Arc::clone(&binary) };
            let functions = text.and_then(|text| read_kernel(&text).flatten());
            let found = functions.as_ref().map_err(Clone::clone).and_then(Compiled::evaluation);
            let _ = sought.found[0].set(found.map(made));
            let Some(functions) = functions.ok().filter(|functions| functions.jacobian.is_some()) else { return };
            thread::sleep(PATIENCE);
            // Skipped if nobody waits any more.
            if Arc::strong_count(&sought) > 1 {
                let _ = sought.found[1].set(Compiled::of(&functions).map(made));
            }
        });
    }
}

/// The equations of an instance, as text: for any parameters, or for those that it has in common with another one.
fn equations_text(component: Component, other: Component, read: ReadFunctions) -> Result<String, String> {
    let mut reply: Option<String> = None;
    // SAFETY: the instances are alive and in no other call, and the reply outlives the call.
    unsafe { read(component, other, Some(keep), std::ptr::from_mut(&mut reply).cast()) };
    reply.ok_or_else(|| "the library of the FMU doesn't provide its equations".to_owned())
}

unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: the library calls it with the context that it was given, and a C string.
    unsafe { *context.cast::<Option<String>>() = Some(CStr::from_ptr(text).to_string_lossy().into_owned()) };
}
