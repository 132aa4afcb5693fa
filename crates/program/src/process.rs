//! Requests of the system that this process ends, and the user who owns it.

use std::ffi::c_int;
use std::sync::atomic::{AtomicI64, Ordering};

/// Time of the first request to end, in seconds; 0 for none.
static ASKED: AtomicI64 = AtomicI64::new(0);
/// Seconds after which a request is another one: `timeout` and shells send each twice.
const ANOTHER: i64 = 2;

/// Notes requests to end (SIGTERM: Slurm, `timeout`, containers, systemd), and a terminal or connection that is gone
/// (SIGHUP), see [`is_asked_to_end`]. Another request later ends the process with this exit code. Signals that the
/// process was started to ignore, as by `nohup`, stay ignored.
pub fn listen_to_requests_to_end(exit_code: u8) {
    EXIT_CODE.store(exit_code.into(), Ordering::SeqCst);
    for signal in [libc::SIGTERM, libc::SIGHUP] {
        let heard = hear as extern "C" fn(c_int);
        // SAFETY: the handler uses atomics, and calls only what a handler may call.
        unsafe {
            if libc::signal(signal, heard as libc::sighandler_t) == libc::SIG_IGN {
                libc::signal(signal, libc::SIG_IGN);
            }
        }
    }
}

static EXIT_CODE: AtomicI64 = AtomicI64::new(0);

extern "C" fn hear(_: c_int) {
    // SAFETY: both functions may be called in a handler of signals.
    unsafe {
        let now = libc::time(std::ptr::null_mut()) as i64;
        let first = ASKED.compare_exchange(0, now, Ordering::SeqCst, Ordering::SeqCst).unwrap_or_else(|first| first);
        if first > 0 && now - first >= ANOTHER {
            libc::_exit(EXIT_CODE.load(Ordering::SeqCst) as c_int);
        }
    }
}

/// Ignores requests to end from now on: the process ends with another one, which answers them. Its child processes
/// don't inherit that.
pub(crate) fn leave_requests_to_another() {
    extern "C" fn pass(_: c_int) {}
    for signal in [libc::SIGTERM, libc::SIGHUP] {
        let pass = pass as extern "C" fn(c_int);
        // SAFETY: the handler does nothing.
        unsafe { libc::signal(signal, pass as libc::sighandler_t) };
    }
}

/// True if a request to end came since the process listens.
pub fn is_asked_to_end() -> bool {
    ASKED.load(Ordering::SeqCst) > 0
}

/// The user whose rights this process has.
pub(crate) fn user() -> u32 {
    // SAFETY: it takes no arguments and can't fail.
    unsafe { libc::geteuid() }
}
