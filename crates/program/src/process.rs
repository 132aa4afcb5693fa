//! What the system has to say to and of this process: requests to end, and whose it is.

use std::ffi::c_int;
use std::sync::atomic::{AtomicI64, Ordering};

/// When the first request to end came, in seconds; none is 0.
static ASKED: AtomicI64 = AtomicI64::new(0);
/// A request that comes so much later, in seconds, is another one: `timeout` and shells send each twice.
const ANOTHER: i64 = 2;

/// From now on a request to end (SIGTERM: Slurm, `timeout`, containers, systemd), and a terminal or connection that is gone
/// (SIGHUP), are noted, see [`is_asked_to_end`]; another one later ends the process with this exit code. What the process
/// was started to ignore stays ignored, as by `nohup`.
pub fn listen_to_requests_to_end(exit_code: u8) {
    EXIT_CODE.store(exit_code.into(), Ordering::SeqCst);
    for signal in [libc::SIGTERM, libc::SIGHUP] {
        let heard = hear as extern "C" fn(c_int);
        // SAFETY: the handler touches atomics, and calls what may be called in one.
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

/// From now on requests to end change nothing: the process ends with another one, which answers them. What it starts itself
/// doesn't inherit that.
pub(crate) fn leave_requests_to_another() {
    extern "C" fn pass(_: c_int) {}
    for signal in [libc::SIGTERM, libc::SIGHUP] {
        let pass = pass as extern "C" fn(c_int);
        // SAFETY: the handler does nothing.
        unsafe { libc::signal(signal, pass as libc::sighandler_t) };
    }
}

/// True if the process was asked to end since it listens.
pub fn is_asked_to_end() -> bool {
    ASKED.load(Ordering::SeqCst) > 0
}

/// The user whose rights this process has.
pub(crate) fn user() -> u32 {
    // SAFETY: it takes nothing and can't fail.
    unsafe { libc::geteuid() }
}
