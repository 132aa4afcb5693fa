//! Functions that a library for Linux needs from the C library there. A linker binds each of them to its newest
//! version, and the library then can't be loaded where that is missing. So functions that have become newer are bound
//! to their first versions, which every glibc provides, and later ones are used where the running system has them.
//!
//! The linker finds these functions before those of the C library, for Rust's standard library too. They are hidden: no
//! other library in the process sees them. They bind to versions of glibc 2.17 or older, the oldest that Rust supports.
//! Exported FMUs need them, or the mathematics of others' models does; `info` shows the needs of a library.

use std::ffi::{c_char, c_int, c_long, c_uint, c_void};

/// Destructor of a thread's value of a key.
pub type Destructor = unsafe extern "C" fn(*mut c_void);
/// `pthread_key_create`.
pub type KeyCreate = unsafe extern "C" fn(*mut c_uint, Option<Destructor>) -> c_int;
/// `pthread_key_delete`.
pub type KeyDelete = unsafe extern "C" fn(c_uint) -> c_int;
/// `pthread_setspecific`.
pub type SetSpecific = unsafe extern "C" fn(c_uint, *const c_void) -> c_int;
/// `dlsym`.
pub type Lookup = unsafe extern "C" fn(*mut c_void, *const c_char) -> *mut c_void;
/// `__cxa_thread_atexit_impl`.
pub type AtThreadExit = unsafe extern "C" fn(Destructor, *mut c_void, *mut c_void) -> c_int;

/// `pthread_key_create`: in a library of its own before glibc 2.34, which a host without threads may lack. Its one
/// thread ends with the process, and nothing of it is left to clean up.
///
/// # Safety
/// As for that function, which `function` is where the process has it.
pub unsafe extern "C" fn key_create(
    key: *mut c_uint,
    destructor: Option<Destructor>,
    function: Option<KeyCreate>,
) -> c_int {
    // SAFETY: the caller's arguments, as the caller vouches for them.
    match function {
        Some(create) => unsafe { create(key, destructor) },
        None => {
            // The standard library takes no key 0.
            unsafe { key.write(1) };
            0
        }
    }
}

/// `pthread_key_delete`, likewise.
///
/// # Safety
/// As for that function.
pub unsafe extern "C" fn key_delete(key: c_uint, function: Option<KeyDelete>) -> c_int {
    // SAFETY: the caller's argument, as the caller vouches for it.
    function.map_or(0, |delete| unsafe { delete(key) })
}

/// `pthread_setspecific`, likewise.
///
/// # Safety
/// As for that function.
pub unsafe extern "C" fn set_specific(key: c_uint, value: *const c_void, function: Option<SetSpecific>) -> c_int {
    // SAFETY: the caller's arguments, as the caller vouches for them.
    function.map_or(0, |set| unsafe { set(key, value) })
}

/// `__cxa_thread_atexit_impl`, of glibc 2.18. An older one is not asked to end the thread's values, whose memory then
/// stays taken: other means of ending them could reach into a library that was unloaded before.
///
/// # Safety
/// As for that function; `lookup` is dlsym, where the process has it.
pub unsafe extern "C" fn at_thread_exit(
    destructor: Destructor,
    value: *mut c_void,
    library: *mut c_void,
    lookup: Option<Lookup>,
) -> c_int {
    let Some(lookup) = lookup else { return 0 };
    // SAFETY: dlsym takes the default place and a C string, and gives the address of the function of that name; its
    // arguments are the caller's.
    unsafe {
        let found = lookup(libc::RTLD_DEFAULT, c"__cxa_thread_atexit_impl".as_ptr());
        std::mem::transmute::<*mut c_void, Option<AtThreadExit>>(found)
            .map_or(0, |register| register(destructor, value, library))
    }
}

/// `gettid`, of glibc 2.30: what it does.
pub extern "C" fn thread_id() -> c_int {
    // SAFETY: this call of the system takes no arguments and always succeeds.
    unsafe { libc::syscall(libc::SYS_gettid) as c_int }
}

/// `getrandom`, of glibc 2.25: what it does.
///
/// # Safety
/// As for that function.
pub unsafe extern "C" fn random(buffer: *mut c_void, size: usize, flags: c_uint) -> isize {
    // SAFETY: the caller's arguments, as the caller vouches for them.
    unsafe { libc::syscall(libc::SYS_getrandom, buffer, size, flags) as isize }
}

/// `statx`, of glibc 2.28: what it does.
///
/// # Safety
/// As for that function.
pub unsafe extern "C" fn file_status(
    folder: c_int,
    path: *const c_char,
    flags: c_int,
    mask: c_uint,
    status: *mut c_void,
) -> c_int {
    // SAFETY: the caller's arguments, as the caller vouches for them.
    unsafe { libc::syscall(libc::SYS_statx, c_long::from(folder), path, c_long::from(flags), mask, status) as c_int }
}

/// The text of the functions, each in a section of its own: the linker leaves out what nothing calls.
#[doc(hidden)]
#[macro_export]
macro_rules! bind_old_glibc {
    () => {
        // Some of these have become newer, others may.
        $crate::bind_old_glibc! { @first exp exp2 expm1 log log2 log10 log1p pow cbrt hypot fmod }
        $crate::bind_old_glibc! { @first sin cos sincos tan asin acos atan atan2 sinh cosh tanh }
        // Before glibc 2.33 these two took the version of the structure that they fill in as their first argument.
        $crate::bind_old_glibc! { @function "stat64", "__xstat64", [$crate::old_glibc_text!(structure)], {} }
        $crate::bind_old_glibc! { @function "fstat64", "__fxstat64", [$crate::old_glibc_text!(structure)], {} }
        $crate::bind_old_glibc! { @where_there "pthread_key_create", "pthread_key_create", third, key_create }
        $crate::bind_old_glibc! { @where_there "pthread_key_delete", "pthread_key_delete", second, key_delete }
        $crate::bind_old_glibc! { @where_there "pthread_setspecific", "pthread_setspecific", third, set_specific }
        $crate::bind_old_glibc! { @where_there "__cxa_thread_atexit_impl", "dlsym", fourth, at_thread_exit }
        $crate::bind_old_glibc! { @own "gettid", thread_id }
        $crate::bind_old_glibc! { @own "getrandom", random }
        $crate::bind_old_glibc! { @own "statx", file_status }
    };
    (@first $($name:ident)*) => {
        $($crate::bind_old_glibc! { @function stringify!($name), stringify!($name), [""], {} })*
    };
    // Goes on in a function of the C library, after some instructions.
    (@function $name:expr, $old:expr, [$before:expr], {}) => {
        std::arch::global_asm!(
            $crate::old_glibc_text!(start $name),
            $before,
            $crate::old_glibc_text!(jump $name),
            $crate::old_glibc_text!(end $name),
            $crate::old_glibc_text!(bind $name, $old),
        );
    };
    // Goes on in one of the functions above, with the address of a function of the C library, or none.
    (@where_there $name:literal, $old:literal, $argument:ident, $function:ident) => {
        std::arch::global_asm!(
            $crate::old_glibc_text!(start $name),
            concat!(".weak adaptive_fmu_old_", $name),
            $crate::old_glibc_text!($argument $name),
            $crate::old_glibc_text!(own),
            $crate::old_glibc_text!(end $name),
            $crate::old_glibc_text!(bind $name, $old),
            function = sym $crate::fmi2::old_glibc::$function,
        );
    };
    (@own $name:literal, $function:ident) => {
        std::arch::global_asm!(
            $crate::old_glibc_text!(start $name),
            $crate::old_glibc_text!(own),
            $crate::old_glibc_text!(end $name),
            function = sym $crate::fmi2::old_glibc::$function,
        );
    };
}

/// The parts of such a function. It is weak, as Rust's standard library refers to some of them; the linker uses it
/// nevertheless.
#[doc(hidden)]
#[macro_export]
macro_rules! old_glibc_text {
    (start $name:expr) => {
        concat!(
            ".pushsection .text.adaptive_fmu.", $name, ",\"ax\",@progbits\n.balign 16\n",
            ".weak ", $name, "\n.hidden ", $name, "\n.type ", $name, ",@function\n", $name, ":"
        )
    };
    (end $name:expr) => {
        concat!(".size ", $name, ", . - ", $name, "\n.popsection")
    };
    ($($part:tt)*) => {
        $crate::old_glibc_instructions!($($part)*)
    };
}

/// Their instructions; all versions began with 2.2.5.
#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
#[macro_export]
macro_rules! old_glibc_instructions {
    (bind $name:expr, $old:expr) => {
        concat!(".symver adaptive_fmu_old_", $name, ", ", $old, "@GLIBC_2.2.5")
    };
    (jump $name:expr) => {
        concat!("jmp qword ptr [rip + adaptive_fmu_old_", $name, "@GOTPCREL]")
    };
    (structure) => {
        "mov rdx, rsi\nmov rsi, rdi\nmov edi, 1"
    };
    (own) => {
        "jmp {function}"
    };
    (second $name:expr) => {
        concat!("mov rsi, qword ptr [rip + adaptive_fmu_old_", $name, "@GOTPCREL]")
    };
    (third $name:expr) => {
        concat!("mov rdx, qword ptr [rip + adaptive_fmu_old_", $name, "@GOTPCREL]")
    };
    (fourth $name:expr) => {
        concat!("mov rcx, qword ptr [rip + adaptive_fmu_old_", $name, "@GOTPCREL]")
    };
}

/// Their instructions; all versions began with 2.17.
#[cfg(target_arch = "aarch64")]
#[doc(hidden)]
#[macro_export]
macro_rules! old_glibc_instructions {
    (bind $name:expr, $old:expr) => {
        concat!(".symver adaptive_fmu_old_", $name, ", ", $old, "@GLIBC_2.17")
    };
    (jump $name:expr) => {
        concat!($crate::old_glibc_instructions!(load "x16", $name), "\nbr x16")
    };
    (structure) => {
        "mov x2, x1\nmov x1, x0\nmov w0, #0"
    };
    (own) => {
        "b {function}"
    };
    (second $name:expr) => {
        $crate::old_glibc_instructions!(load "x1", $name)
    };
    (third $name:expr) => {
        $crate::old_glibc_instructions!(load "x2", $name)
    };
    (fourth $name:expr) => {
        $crate::old_glibc_instructions!(load "x3", $name)
    };
    (load $register:literal, $name:expr) => {
        concat!(
            "adrp ", $register, ", :got:adaptive_fmu_old_", $name, "\n",
            "ldr ", $register, ", [", $register, ", :got_lo12:adaptive_fmu_old_", $name, "]"
        )
    };
}

#[cfg(test)]
mod tests {
    use std::ptr::null_mut;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    static ENDED: AtomicUsize = AtomicUsize::new(0);

    unsafe extern "C" fn count(value: *mut c_void) {
        ENDED.fetch_add(value as usize, Ordering::SeqCst);
    }

    #[test]
    fn what_a_thread_holds_is_ended_with_it_where_the_process_has_the_functions() {
        let (mut key, mut none) = (0, 0);
        // SAFETY: the functions are the C library's, or none; the keys' place is this function's, their destructor only
        // counts, and so does that of the value, which belongs to no library.
        unsafe {
            assert_eq!(key_create(&raw mut key, Some(count), Some(libc::pthread_key_create)), 0);
            assert_eq!(key_create(&raw mut none, Some(count), None), 0);
        }
        assert_ne!(none, 0);
        let thread = std::thread::spawn(move || unsafe {
            assert_eq!(set_specific(key, 2_usize as *const c_void, Some(libc::pthread_setspecific)), 0);
            assert_eq!(set_specific(none, 10_usize as *const c_void, None), 0);
            assert_eq!(at_thread_exit(count, 100_usize as *mut c_void, null_mut(), Some(libc::dlsym)), 0);
            assert_eq!(at_thread_exit(count, 1000_usize as *mut c_void, null_mut(), None), 0);
            assert_eq!(at_thread_exit(count, 10000_usize as *mut c_void, null_mut(), Some(knows_nothing)), 0);
        });
        thread.join().unwrap();
        assert_eq!(ENDED.load(Ordering::SeqCst), 102);
        // SAFETY: the key is that of above, the other none.
        assert_eq!(unsafe { (key_delete(key, Some(libc::pthread_key_delete)), key_delete(none, None)) }, (0, 0));
    }

    unsafe extern "C" fn knows_nothing(_: *mut c_void, _: *const c_char) -> *mut c_void {
        null_mut()
    }

    #[test]
    fn calls_of_the_system_answer_as_the_functions_of_the_c_library_do() {
        let own = std::fs::read_link("/proc/thread-self").unwrap();
        assert_eq!(own.file_name().unwrap().to_str(), Some(thread_id().to_string().as_str()));
        let (mut bytes, mut status) = ([0_u8; 32], [0_u8; 256]);
        let size = |status: &[u8; 256]| u64::from_le_bytes(status[40..48].try_into().unwrap());
        let file = std::ffi::CString::new(env!("CARGO_MANIFEST_DIR").to_owned() + "/Cargo.toml").unwrap();
        // SAFETY: the buffers have the given lengths, and the structure of statx.
        unsafe {
            assert_eq!(random(bytes.as_mut_ptr().cast(), bytes.len(), 0), 32);
            assert_eq!(file_status(libc::AT_FDCWD, file.as_ptr(), 0, 0x7ff, status.as_mut_ptr().cast()), 0);
            assert_eq!(size(&status), std::fs::metadata("Cargo.toml").unwrap().len());
            assert_eq!(file_status(-1, c"nowhere".as_ptr(), 0, 0x7ff, status.as_mut_ptr().cast()), -1);
        }
        assert_eq!(std::io::Error::last_os_error().raw_os_error(), Some(libc::EBADF));
        assert_ne!(bytes, [0; 32]);
    }
}
