//! Equations of units that were built with this crate, compiled while they already run: made once by the C compiler that
//! is found, kept in the user's cache folder, and handed to instances when they are there. The bits are the same before
//! and after.

use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;

use libloading::Library;

use super::in_process::Binary;
use crate::cache::Entry;
use crate::fmi2::build::Build;
use crate::fmi2::describe::read_kernel;
use crate::fmi2::source::kernel::ENTRY;
use crate::fmi2::types::Component;
use crate::kernel::{Kernel, VERSION};

/// The same bits as those of the generic equations ask for no fused operations. No kernel asks how a function failed.
const OPTIONS: [&str; 8] =
    ["-std=c99", "-O1", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared", "-s"];

/// Whether a compiler was looked for and none found.
static NO_COMPILER: AtomicBool = AtomicBool::new(false);

/// What a library exports beside the functions of the standard.
type Describe = unsafe extern "C" fn(*const c_char, Option<Reply>, *mut c_void) -> c_int;
type Reply = unsafe extern "C" fn(*mut c_void, *const c_char);
type Take = unsafe extern "C" fn(Component, *const Kernel) -> c_int;

/// What is told where units evaluate their equations as they are, for want of a compiler.
pub fn without_compiler() -> Option<&'static str> {
    NO_COMPILER.load(Ordering::Relaxed).then_some(
        "no C compiler (cc, or the one that CC names) is found: equations are evaluated as they are, several times as \
         slowly; the results are the same",
    )
}

/// A kernel that is loaded.
#[derive(Debug)]
pub(super) struct Loaded {
    kernel: Kernel,
    _library: Library,
}

/// A kernel that is there now, later or never.
#[derive(Debug, Clone)]
pub(super) struct Awaited(Arc<OnceLock<Option<Loaded>>>);

impl Awaited {
    /// The kernel of the unit with a description, in a library; nothing where it isn't of this crate.
    pub fn of(binary: &Arc<Binary>, build: &Build, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        binary.symbol(TAKE)?;
        let kept = kept(build, &text)?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(awaited) = known.get_or_insert_default().get(kept.file()) {
            return Some(awaited.clone());
        }
        let awaited = Awaited(Arc::default());
        known.get_or_insert_default().insert(kept.file().to_owned(), awaited.clone());
        match load(kept.file()) {
            Some(loaded) => _ = awaited.0.set(Some(loaded)),
            None => {
                let work = Work { binary: Arc::clone(binary), text, kept, awaited: awaited.clone() };
                // At once, not in turn: of a run that is shorter than a compiler all kernels are there for the next.
                thread::spawn(move || work.awaited.0.set(make(&work)));
            }
        }
        Some(awaited)
    }

    /// Hands it to an instance of the library, where it is there; whether there is nothing more to wait for.
    pub fn hand_to(&self, component: Component, binary: &Binary) -> bool {
        let Some(found) = self.0.get() else { return false };
        if let (Some(loaded), Some(take)) = (found, binary.symbol(TAKE)) {
            // SAFETY: a library of this crate gives the symbol this type. The instance is alive and in no other call;
            // the kernel stays loaded until the process ends (`KNOWN`).
            unsafe { std::mem::transmute::<unsafe extern "C" fn(), Take>(take)(component, &raw const loaded.kernel) };
        }
        true
    }
}

const TAKE: &str = "adaptive_fmu_take_kernel";
const TEXT: &str = "adaptive_fmu_kernel_text";

/// Kernels that this process knows, by the files that they are kept in.
static KNOWN: Mutex<Option<HashMap<PathBuf, Awaited>>> = Mutex::new(None);

/// Where a kernel is kept, by what its unit was made of and what compiles it.
fn kept(build: &Build, description: &str) -> Option<Entry> {
    let (build, compiler, options) = (serde_json::to_string(build).ok()?, compiler(), OPTIONS.join(" "));
    let parts = [&build, description, &compiler, &options].map(str::as_bytes);
    Entry::of("kernel", &[parts.as_slice(), &[&VERSION.to_le_bytes()]].concat())
}

fn compiler() -> String {
    std::env::var("CC").ok().filter(|name| !name.is_empty()).unwrap_or_else(|| "cc".to_owned())
}

/// Loads a kernel from its file.
fn load(file: &Path) -> Option<Loaded> {
    // One that was cut off would be mapped all the same, and end this process: the table of its sections is its end.
    object::File::parse(&*fs::read(file).ok()?).ok()?;
    // SAFETY: the file was made by a compiler of this module's text, under the user's own folder, and put in its place whole.
    // Its one symbol has this type.
    let loaded = unsafe {
        let library = Library::new(file).ok()?;
        let entry = *library.get::<unsafe extern "C" fn() -> *const Kernel>(ENTRY).ok()?;
        Loaded { kernel: *entry().as_ref()?, _library: library }
    };
    Some(loaded)
}

/// A kernel that is to be made.
struct Work {
    binary: Arc<Binary>,
    text: String,
    kept: Entry,
    awaited: Awaited,
}

/// Writes, compiles and loads a kernel; nothing where any of that fails.
fn make(work: &Work) -> Option<Loaded> {
    if NO_COMPILER.load(Ordering::Relaxed) {
        return None;
    }
    let text = kernel_text(&work.binary, &work.text)?;
    let own = work.kept.unfinished();
    let source = own.with_extension("tmp.c");
    fs::write(&source, text).ok()?;
    let compiled = compile(&source, &own, work.kept.file());
    // Gone already where a shell compiled it.
    let _ = fs::remove_file(&source);
    if compiled { load(work.kept.file()) } else { None }
}

/// Compiles a source, and puts the library in its place when it is whole. Where this process ends before the compiler, a
/// shell does that: the next run finds the kernel. What is simulated comes first.
fn compile(source: &Path, own: &Path, file: &Path) -> bool {
    let compiler = compiler();
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        let script = "trap '' INT HUP; source=$1 own=$2 file=$3; shift 3; nice -n 5 \"$@\" -o \"$own\" \"$source\" -lm; code=$?; \
                      if [ $code = 0 ]; then mv -f \"$own\" \"$file\"; else rm -f \"$own\"; fi; rm -f \"$source\"; \
                      exit $code";
        shell.args(["-c", script, "sh"]).args([source, own, file]).arg(&compiler).args(OPTIONS);
        shell
    } else {
        let mut command = Command::new(&compiler);
        command.args(OPTIONS).arg("-o").arg(own).arg(source);
        command
    };
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let Ok(status) = command.status() else {
        NO_COMPILER.store(true, Ordering::Relaxed);
        return false;
    };
    // What a shell says of a command that isn't there.
    if cfg!(unix) && matches!(status.code(), Some(126 | 127)) {
        NO_COMPILER.store(true, Ordering::Relaxed);
    }
    status.success() && (cfg!(unix) || fs::rename(own, file).is_ok())
}

/// The C of a unit's equations, as its library writes it.
fn kernel_text(binary: &Binary, description: &str) -> Option<String> {
    let (function, description) = (binary.symbol(TEXT)?, CString::new(description).ok()?);
    let mut reply: Option<String> = None;
    // SAFETY: a library of this crate gives the symbol this type; the text and the reply's place live longer than the call.
    unsafe {
        let function = std::mem::transmute::<unsafe extern "C" fn(), Describe>(function);
        function(description.as_ptr(), Some(keep), std::ptr::from_mut(&mut reply).cast());
    }
    read_kernel(&reply?).ok()?.ok()
}

unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: called by the library with the place that it was given, and a C string.
    unsafe { *context.cast::<Option<String>>() = Some(CStr::from_ptr(text).to_string_lossy().into_owned()) };
}
