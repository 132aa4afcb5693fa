//! Equations of units that were built with this crate, compiled while they already run: made once by the C compiler that
//! is found, kept in the user's cache folder, and handed to instances when they are there. The bits are the same before
//! and after.

use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;

use super::in_process::Binary;
use crate::c_compiler;
use crate::cache::{self, Checksum, Entry};
use crate::dynamic::Library;
use crate::fmi2::build::Build;
use crate::fmi2::describe::read_kernel;
use crate::fmi2::source::kernel::ENTRY;
use crate::fmi2::types::Component;
use crate::kernel::Kernel;

/// The same bits as those of the generic equations ask for no fused operations. No kernel asks how a function failed.
const OPTIONS: [&str; 8] =
    ["-std=c99", "-O1", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared", "-s"];

/// Compiles as a process of lower priority, where there is `nice`. Its exit code is the compiler's.
const SCRIPT: &str = r#"trap '' INT HUP TERM; umask 077
source=$1 own=$2 file=$3 sum=$4; shift 4
if command -v nice >/dev/null; then set -- nice -n 5 "$@"; fi
"$@" -o "$own" "$source" -lm; code=$?
if [ $code = 0 ]; then cksum <"$own" >"$own.sum" && mv -f "$own.sum" "$sum" && mv -f "$own" "$file"; fi
rm -f "$source" "$own" "$own.sum"; exit $code"#;

/// Why this process compiles nothing, where it can't.
static TROUBLE: OnceLock<String> = OnceLock::new();

/// What a library exports beside the functions of the standard.
type Describe = unsafe extern "C" fn(*const c_char, Option<Reply>, *mut c_void) -> c_int;
type Reply = unsafe extern "C" fn(*mut c_void, *const c_char);
type Take = unsafe extern "C" fn(Component, *const Kernel) -> c_int;

/// What is told where equations couldn't be compiled, with what to do.
pub fn compiler_trouble() -> Option<&'static str> {
    TROUBLE.get().map(String::as_str)
}

fn tell(trouble: &str, advice: &str) {
    let _ = TROUBLE.set(format!(
        "{trouble}: equations are evaluated as they are, which gives the same results and takes up to three times as long; \
         {advice}, or turn compiling off by setting ADAPTIVE_FMU_CACHE to nothing"
    ));
}

/// The function of a kernel's library. What it points to is read by the library that wrote the kernel's text alone: another
/// version's is laid out otherwise.
type Table = unsafe extern "C" fn() -> *const Kernel;

/// A kernel that is loaded.
#[derive(Debug)]
pub(super) struct Loaded {
    table: Table,
    _library: Library,
}

/// Checksum of the library in a file that holds these bytes; none where it isn't of this crate. How it was built doesn't
/// tell it: a user's own models change without that.
pub(super) fn checksum(file: &Path, library: &[u8]) -> Option<Checksum> {
    Build::within(library).map(|_| cache::checksum(file, library))
}

/// A kernel that is there now, later or never.
#[derive(Debug, Clone)]
pub(super) struct Awaited(Arc<Sought>);

#[derive(Debug)]
struct Sought {
    found: OnceLock<Option<Loaded>>,
    /// What makes it, until that begins: a unit that never steps needs none.
    work: Mutex<Option<Work>>,
}

impl Awaited {
    /// The kernel of the unit with a description, in a library with this checksum.
    pub fn of(binary: &Arc<Binary>, library: &Checksum, description: &Path) -> Option<Self> {
        let text = fs::read_to_string(description).ok()?;
        binary.symbol(TAKE)?;
        let kept = kept(library, &text)?;
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(awaited) = known.get_or_insert_default().get(kept.file()) {
            return Some(awaited.clone());
        }
        let sought = match load(&kept) {
            Some(loaded) => Sought { found: OnceLock::from(Some(loaded)), work: Mutex::default() },
            None => {
                let work = Work { binary: Arc::clone(binary), text, kept: kept.clone() };
                Sought { found: OnceLock::new(), work: Mutex::new(Some(work)) }
            }
        };
        let awaited = Awaited(Arc::new(sought));
        known.get_or_insert_default().insert(kept.file().to_owned(), awaited.clone());
        Some(awaited)
    }

    /// How equations are evaluated as things stand.
    pub fn told(&self) -> &'static str {
        match self.0.found.get() {
            Some(Some(_)) => "in this process, by compiled equations",
            Some(None) => "in this process, by its equations as they are: they couldn't be compiled",
            None => "in this process, by its equations as they are until they are compiled",
        }
    }

    /// Hands it to an instance of the library, where it is there, and begins to make it where it isn't; whether there is
    /// nothing more to wait for.
    pub fn hand_to(&self, component: Component, binary: &Binary) -> bool {
        let Some(found) = self.0.found.get() else {
            self.begin();
            return false;
        };
        if let (Some(loaded), Some(take)) = (found, binary.symbol(TAKE)) {
            // SAFETY: a library of this crate gives the symbol this type, and this very one wrote the kernel's text. The
            // instance is alive and in no other call; the kernel stays loaded until the process ends (`KNOWN`).
            unsafe { std::mem::transmute::<unsafe extern "C" fn(), Take>(take)(component, (loaded.table)()) };
        }
        true
    }

    /// Begins to make it, if nothing has.
    fn begin(&self) {
        if let Some(work) = self.0.work.lock().unwrap_or_else(PoisonError::into_inner).take() {
            let awaited = self.clone();
            // At once, not in turn: of a run that is shorter than a compiler all kernels are there for the next.
            thread::spawn(move || awaited.0.found.set(make(&work)));
        }
    }
}

const TAKE: &str = "adaptive_fmu_take_kernel";
const TEXT: &str = "adaptive_fmu_kernel_text";

/// Kernels that this process knows, by the files that they are kept in.
static KNOWN: Mutex<Option<HashMap<PathBuf, Awaited>>> = Mutex::new(None);

/// Where a kernel is kept, by what its unit was made of and what compiles it.
fn kept(library: &Checksum, description: &str) -> Option<Entry> {
    Entry::of(
        "kernel",
        &[library, description.as_bytes(), c_compiler::named().as_bytes(), OPTIONS.join(" ").as_bytes()],
    )
}

/// Where the checksum of a kernel stands. A shell writes it, also when this process has ended: it is that of `cksum`.
fn sum_of(kernel: &Entry) -> Entry {
    kernel.with_extension("sum")
}

/// Loads a kernel from its file. One that was damaged would be mapped all the same, and end this process.
fn load(kernel: &Entry) -> Option<Loaded> {
    let expected = String::from_utf8(sum_of(kernel).bytes()?).ok()?;
    if cksum(&kernel.bytes()?) != expected.trim() {
        kernel.note_damage();
        return None;
    }
    // SAFETY: the file was made by a compiler of this module's text, lies in a folder that is the user's alone, and is as it
    // was put there. Its one symbol has this type.
    unsafe {
        let library = Library::new(kernel.file()).ok()?;
        Some(Loaded { table: *library.get::<Table>(ENTRY).ok()?, _library: library })
    }
}

/// A kernel that is to be made.
#[derive(Debug)]
struct Work {
    binary: Arc<Binary>,
    text: String,
    kept: Entry,
}

/// Writes, compiles and loads a kernel; nothing where any of that fails.
fn make(work: &Work) -> Option<Loaded> {
    if TROUBLE.get().is_some() {
        return None;
    }
    let text = kernel_text(&work.binary, &work.text)?;
    let own = work.kept.unfinished();
    let source = own.with_extension("tmp.c");
    fs::write(&source, text).ok()?;
    let compiled = compile(&source, &own, &work.kept);
    // Gone already where a shell compiled it.
    let _ = fs::remove_file(&source);
    if compiled { load(&work.kept) } else { None }
}

/// Checksum and length of bytes, as POSIX has `cksum` print them.
fn cksum(bytes: &[u8]) -> String {
    const POLYNOMIAL: u32 = 0x04C1_1DB7;
    let step = |sum: u32, byte: u8| {
        let shifted = |sum: u32| if sum >> 31 == 1 { sum << 1 ^ POLYNOMIAL } else { sum << 1 };
        (0..8).fold(sum ^ u32::from(byte) << 24, |sum, _| shifted(sum))
    };
    // The length follows, its lowest byte first, without zeros at its end.
    let length = std::iter::successors(Some(bytes.len()), |rest| Some(rest >> 8)).take_while(|rest| *rest > 0);
    let all = bytes.iter().copied().chain(length.map(|rest| (rest & 0xFF) as u8));
    format!("{} {}", !all.fold(0, step), bytes.len())
}

/// Compiles a source, and puts the library in its place when it is whole. Where this process ends before the compiler, a
/// shell does that: the next run finds the kernel. What is simulated comes first.
fn compile(source: &Path, own: &Path, kernel: &Entry) -> bool {
    let compiler = c_compiler::named();
    let (program, arguments) = c_compiler::words(&compiler);
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        let sum = sum_of(kernel);
        shell.args(["-c", SCRIPT, "sh"]).args([source, own, kernel.file(), sum.file()]).arg(&program).args(arguments);
        shell.args(OPTIONS);
        shell
    } else {
        let mut command = Command::new(&program);
        command.args(arguments).args(OPTIONS).arg("-o").arg(own).arg(source);
        command
    };
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    // A shell says so of a command that isn't there, or can't be run.
    match command.status().map(|status| status.code()) {
        Ok(Some(0)) if cfg!(unix) => true,
        Ok(Some(0)) => {
            let put = |bytes: Vec<u8>| fs::write(sum_of(kernel).file(), cksum(&bytes));
            fs::read(own).and_then(put).and_then(|()| fs::rename(own, kernel.file())).is_ok()
        }
        Err(_) | Ok(Some(126 | 127)) => {
            tell(&format!("no C compiler: `{compiler}` isn't found"), "install one, or name one by CC");
            false
        }
        Ok(Some(code)) => {
            let advice = "see that it compiles a program with <math.h>, or name another by CC";
            tell(&format!("the C compiler `{compiler}` fails (exit code {code})"), advice);
            false
        }
        // It was killed.
        Ok(None) => false,
    }
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

#[cfg(test)]
mod tests {
    use super::cksum;

    #[test]
    fn checksums_are_those_of_posix() {
        // As `printf 123456789 | cksum` prints them, and for no bytes and for 300.
        assert_eq!(cksum(b"123456789"), "930766865 9");
        assert_eq!(cksum(b""), "4294967295 0");
        assert_eq!(cksum(&[b'a'; 300]), "1664553091 300");
    }
}
