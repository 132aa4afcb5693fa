//! FMUs in separate processes: if one crashes, hangs, ends its process or writes to its standard output, the program
//! continues and reports it.

use std::cell::RefCell;
use std::io::{self, BufRead, BufReader, ErrorKind, PipeReader};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::UNIT_PROCESS;
use super::in_process::Plan;
use super::messages::{Log, Messages};
use super::unit::{Answer, Call, OK, RunningUnit};
use super::wire::{Beginning, Reply, Request, receive, send};

/// Time to wait for the last output of a process that has ended.
const LAST_WORDS: Duration = Duration::from_millis(500);
/// Largest length of a line of an FMU's output, in bytes.
const LONGEST_LINE: u64 = 4096;

/// An instance in a separate process.
#[derive(Debug)]
pub(super) struct OwnProcess {
    child: RefCell<Child>,
    stream: UnixStream,
    patience: Duration,
    buffer: RefCell<Vec<u8>>,
    /// Messages that came with answers.
    messages: RefCell<Messages>,
    written: Arc<Log>,
    listener: RefCell<Option<JoinHandle<()>>>,
    /// Reason why the process no longer answers.
    gone: RefCell<Option<String>>,
    is_freed: bool,
}

impl OwnProcess {
    /// Makes an instance in a process of a program that must answer within `patience`. Returns the reason if it can't.
    pub fn new(program: &Path, patience: Duration, library: &Path, plan: &Plan) -> Result<Self, String> {
        let unit =
            Self::begun(program, patience).map_err(|error| format!("no process could be started for it: {error}"))?;
        let beginning = Beginning { library: library.to_owned(), plan: plan.clone() };
        let sent = send(&unit.stream, &beginning, &mut unit.buffer.borrow_mut());
        let reply: Result<Reply, String> = sent.map_err(|error| unit.lost(&error)).and_then(|()| unit.reply());
        let refused = match reply {
            Ok(Reply { answer: Ok(_), messages, .. }) => {
                unit.messages.borrow_mut().append(messages);
                return Ok(unit);
            }
            Ok(Reply { answer: Err(reason), .. }) => reason,
            Err(reason) => format!("{} failed: {reason}", plan.instantiates()),
        };
        let written = unit.written.take();
        Err(if written.is_empty() { refused } else { format!("{refused}; {}", written.joined()) })
    }

    fn begun(program: &Path, patience: Duration) -> io::Result<Self> {
        let (stream, other) = UnixStream::pair()?;
        stream.set_read_timeout(Some(patience))?;
        stream.set_write_timeout(Some(patience))?;
        let (reader, writer) = io::pipe()?;
        let mut command = Command::new(program);
        command.arg(UNIT_PROCESS).stdin(Stdio::from(OwnedFd::from(other)));
        command.stdout(writer.try_clone()?).stderr(writer);
        // Only this program answers an interrupt from the terminal.
        let child = command.process_group(0).spawn()?;
        // The command owns the other ends. Without them, reading ends when the child ends.
        drop(command);
        let written = Arc::<Log>::default();
        let log = Arc::clone(&written);
        let listener = RefCell::new(Some(thread::spawn(move || keep_lines(reader, &log))));
        let (child, buffer, messages) = (RefCell::new(child), RefCell::default(), RefCell::default());
        let gone = RefCell::default();
        Ok(OwnProcess { child, stream, patience, buffer, messages, written, listener, gone, is_freed: false })
    }

    fn request(&self, request: &Request) -> Result<Reply, String> {
        if let Some(reason) = &*self.gone.borrow() {
            return Err(reason.clone());
        }
        send(&self.stream, request, &mut self.buffer.borrow_mut()).map_err(|error| self.lost(&error))?;
        self.reply()
    }

    fn reply(&self) -> Result<Reply, String> {
        let reply = receive(&self.stream, &mut self.buffer.borrow_mut());
        reply.map_err(|error| self.lost(&error))
    }

    /// Ends the process that doesn't answer. Returns the reason.
    fn lost(&self, error: &io::Error) -> String {
        let reason = if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) {
            let patience = self.patience.as_secs_f64();
            format!(
                "did not respond within {patience} s, so its process was ended. Use --patience for a longer time \
                 limit"
            )
        } else {
            self.status().map_or_else(|| format!("its process can't be reached: {error}"), ending)
        };
        self.end();
        *self.gone.borrow_mut() = Some(reason.clone());
        reason
    }

    /// Exit status of the process, if it ends soon.
    fn status(&self) -> Option<ExitStatus> {
        let begun = Instant::now();
        while begun.elapsed() < LAST_WORDS {
            if let Ok(Some(status)) = self.child.borrow_mut().try_wait() {
                return Some(status);
            }
            thread::sleep(Duration::from_millis(1));
        }
        None
    }

    /// Ends the process and stores its last output.
    fn end(&self) {
        let mut child = self.child.borrow_mut();
        // Includes all processes that the FMU started, unless they left its group.
        // SAFETY: sends a signal to a group that this process made.
        unsafe { libc::kill(-(child.id() as libc::pid_t), libc::SIGKILL) };
        // It may have ended by itself.
        let _ = child.kill();
        let _ = child.wait();
        // A process that the FMU started may keep the pipe open for ever.
        let begun = Instant::now();
        if let Some(listener) = self.listener.take() {
            while !listener.is_finished() && begun.elapsed() < LAST_WORDS {
                thread::sleep(Duration::from_micros(100));
            }
        }
    }
}

/// Stores an FMU's output, line by line.
fn keep_lines(reader: PipeReader, log: &Log) {
    let mut reader = BufReader::new(reader);
    let mut line = Vec::new();
    loop {
        line.clear();
        let read = io::Read::take(&mut reader, LONGEST_LINE).read_until(b'\n', &mut line);
        if matches!(read, Ok(0) | Err(_)) {
            return;
        }
        let text = String::from_utf8_lossy(&line);
        if !text.trim().is_empty() {
            log.push(&format!("wrote: {}", text.trim_end()));
        }
    }
}

fn ending(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(signal), _) => format!("crashed with signal {signal}{}", signal_name(signal)),
        (None, Some(code)) => format!("ended its process with exit code {code}"),
        (None, None) => format!("its process ended: {status}"),
    }
}

fn signal_name(signal: i32) -> &'static str {
    match signal {
        libc::SIGSEGV => " (SIGSEGV, invalid address)",
        libc::SIGABRT => " (SIGABRT, call of abort)",
        libc::SIGFPE => " (SIGFPE, arithmetic fault)",
        libc::SIGILL => " (SIGILL, invalid instruction)",
        libc::SIGBUS => " (SIGBUS, invalid address)",
        libc::SIGKILL => " (SIGKILL)",
        libc::SIGTERM => " (SIGTERM)",
        _ => "",
    }
}

impl RunningUnit for OwnProcess {
    fn call(&self, call: Call<'_>) -> Result<Answer, String> {
        let Reply { answer, messages, reals, wholes } = self.request(&Request::of(&call))?;
        self.messages.borrow_mut().append(messages);
        let answer = answer?;
        Reply { answer: Ok(answer), messages: Messages::default(), reals, wholes }.hand_over(call)?;
        Ok(answer)
    }

    fn messages(&self) -> Messages {
        let mut messages = self.messages.take();
        messages.append(self.written.take());
        messages
    }

    fn free(&mut self) -> Result<(), String> {
        if std::mem::replace(&mut self.is_freed, true) || self.gone.borrow().is_some() {
            return Ok(());
        }
        let Reply { answer, messages, .. } = self.request(&Request::Free)?;
        self.messages.borrow_mut().append(messages);
        self.end();
        answer.map(|answer| debug_assert_eq!(answer, OK))
    }
}

impl Drop for OwnProcess {
    fn drop(&mut self) {
        // A caller who needs to know of a failure calls `free` before.
        let _ = self.free();
        self.end();
    }
}
