//! The separate process of an FMU, from within.

use std::fs::File;
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::parent_id;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use super::in_process::{Binary, InProcess};
use super::messages::Messages;
use super::unit::{OK, RunningUnit};
use super::wire::{Beginning, Reply, Request, receive, send};
use crate::process::leave_requests_to_another;

/// Interval of checks that the process which this one works for still exists.
const LOOK: Duration = Duration::from_secs(1);

unsafe extern "C" {
    fn fflush(file: *mut libc::FILE) -> libc::c_int;
}

/// Runs an FMU for the process at the other end of the standard input, until that ends.
///
/// # Errors
/// If communication with the other process fails.
pub fn serve() -> io::Result<()> {
    let stream = taken_from_standard_input()?;
    end_with_parent();
    // Slurm, systemd and containers send signals to all processes.
    leave_requests_to_another();
    let mut buffer = Vec::new();
    let beginning: Beginning = receive(&stream, &mut buffer)?;
    let made = Binary::load(&beginning.library, beginning.plan.standard)
        .map_err(|reason| format!("its library can't be loaded: {reason}"))
        .and_then(|binary| InProcess::new(&Arc::new(binary), None, &beginning.plan));
    let (answer, mut unit) = match made {
        Ok(unit) => (Ok(OK), Some(unit)),
        Err(reason) => (Err(reason), None),
    };
    let messages = unit.as_ref().map_or_else(Messages::default, RunningUnit::messages);
    send(&stream, &Reply { answer, messages, reals: Vec::new(), wholes: Vec::new() }, &mut buffer)?;
    let Some(unit) = &mut unit else { return Ok(()) };
    while let Some(request) = next(&stream, &mut buffer)? {
        let reply = request.answered_by(unit);
        // An FMU's output must appear even if the next call ends this process.
        // SAFETY: flushes all of C's streams.
        unsafe { fflush(std::ptr::null_mut()) };
        send(&stream, &reply, &mut buffer)?;
        if matches!(request, Request::Free) {
            break;
        }
    }
    // No more code of the FMU runs, neither its exit handlers nor its library's destructors.
    // SAFETY: ends this process.
    unsafe { libc::_exit(0) }
}

/// The next request; none if the other process is gone.
fn next(stream: &UnixStream, buffer: &mut Vec<u8>) -> io::Result<Option<Request<'static>>> {
    match receive(stream, buffer) {
        Ok(request) => Ok(Some(request)),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

/// The connection that this process got as its standard input. An FMU that reads from there finds nothing.
fn taken_from_standard_input() -> io::Result<UnixStream> {
    let stream = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let nothing: OwnedFd = File::open("/dev/null")?.into();
    // SAFETY: the standard input is replaced by a file that is open; nothing in this process has read from it.
    let replaced = unsafe { libc::dup2(nothing.as_raw_fd(), libc::STDIN_FILENO) };
    if replaced < 0 { Err(io::Error::last_os_error()) } else { Ok(stream) }
}

/// Ends this process when the one that it works for is gone, also during a call of the FMU.
fn end_with_parent() {
    let parent = parent_id();
    thread::spawn(move || {
        while parent_id() == parent {
            thread::sleep(LOOK);
        }
        // SAFETY: ends this process and all that the FMU started in its group, whatever its other threads do.
        unsafe {
            libc::kill(0, libc::SIGKILL);
            libc::_exit(1)
        }
    });
}
