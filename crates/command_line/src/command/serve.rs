//! `serve`: another program (the Python package) asks for commands by standard input, one a line, and has the answers by
//! standard output: units that were made ready for one request are there for the next.
//!
//! A request is `{"request": NUMBER, "arguments": [...], "folder": FOLDER}`: what a command line would hold, and where it would
//! be given. `{"stop": NUMBER}` interrupts that request. What comes back are messages ([`console`]): `text` and `note` are
//! lines of the two streams, `progress` and `recording` (with numbers behind it) come as they are there, `end` is the exit code.
//! Whatever a line is but a `stop` or a result, it has an `end`. A request with `"workers": true` may send `job` messages; the
//! result of each comes back as `{"done": NUMBER, "result": TEXT}`.

use std::io::{BufRead, stdin};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::Duration;
use std::{env, thread};

use adaptive_fmu::simulation::Recording;
use adaptive_fmu::workers::{Workers, employ};
use serde::Deserialize;
use serde_json::{Value, json};

use super::workers::{self, OfRequest};
use super::{progress, ready};
use crate::console;

/// Interval between checks whether to end, while there is no request.
const LOOK: Duration = Duration::from_millis(500);
/// The exit code of wrong arguments.
pub const NOT_UNDERSTOOD: u8 = 2;

/// A request, or why a line is none.
type Asked = Result<Request, String>;

#[derive(Deserialize)]
#[serde(untagged)]
enum Line {
    Request(Request),
    Stop { stop: u64 },
    Done { done: u64, result: String },
}

#[derive(Deserialize)]
struct Request {
    request: u64,
    arguments: Vec<String>,
    folder: PathBuf,
    #[serde(default)]
    workers: bool,
}

/// Answers requests, a command line each, until there are no more.
pub fn execute(answer: impl Fn(&[String]) -> ExitCode) -> ExitCode {
    console::serve();
    ready::keep();
    let (sender, requests) = channel();
    thread::spawn(move || listen(&sender));
    while let Some(asked) = next(&requests) {
        let Request { request, arguments, folder, workers } = match asked {
            Ok(request) => request,
            // The program that asked waits for the end nevertheless.
            Err(reason) => {
                error_line!("error: {reason}");
                console::send("end", &json!(NOT_UNDERSTOOD), &[]);
                continue;
            }
        };
        progress::answer(request);
        employ(workers.then(|| Arc::new(OfRequest::new()) as Arc<dyn Workers>));
        let words: Vec<String> = [env!("CARGO_BIN_NAME").to_owned()].into_iter().chain(arguments).collect();
        let code = match env::set_current_dir(&folder) {
            Ok(()) => answer(&words),
            Err(error) => {
                error_line!("error: {}: {error}", folder.display());
                ExitCode::FAILURE
            }
        };
        console::send("end", &json!(number(code)), &[]);
    }
    ready::forget();
    ExitCode::SUCCESS
}

/// The next request; none when there are no more, or the process is asked to end.
fn next(requests: &Receiver<Asked>) -> Option<Asked> {
    while !progress::is_asked_to_end() {
        match requests.recv_timeout(LOOK) {
            Err(RecvTimeoutError::Timeout) => {}
            request => return request.ok(),
        }
    }
    None
}

/// Passes requests on; a request to stop one is accepted while that is answered. When there are no more requests,
/// whatever runs is stopped.
fn listen(sender: &Sender<Asked>) {
    let mut last = 0;
    for line in stdin().lock().split(b'\n').map_while(Result::ok) {
        match serde_json::from_slice(&line) {
            Ok(Line::Request(request)) => {
                last = request.request;
                if sender.send(Ok(request)).is_err() {
                    return;
                }
            }
            Ok(Line::Stop { stop }) => progress::stop(stop),
            // One that can't be read is none: its job stays without a result.
            Ok(Line::Done { done, result }) => workers::take(done, serde_json::from_str(&result).unwrap_or_default()),
            Err(error) => {
                let line = String::from_utf8_lossy(&line);
                if sender.send(Err(format!("the request can't be read ({error}): {line}"))).is_err() {
                    return;
                }
            }
        }
    }
    progress::stop(last);
}

/// The number of an exit code, which only the system can read.
fn number(code: ExitCode) -> u8 {
    (0..=u8::MAX).find(|number| ExitCode::from(*number) == code).unwrap_or(1)
}

/// Sends a recording with information about it: times, then a column a name, numbers of eight bytes, the least first.
pub fn send(recording: &Recording, mut about: Value) {
    let Recording { names, measures, times, columns, warnings, details: _ } = recording;
    about["rows"] = json!(times.len());
    about["names"] = json!(names);
    about["units"] = json!(measures);
    about["warnings"] = json!(warnings);
    let all = times.iter().chain(columns.iter().flatten());
    let bytes: Vec<u8> = all.flat_map(|number| number.to_le_bytes()).collect();
    console::send("recording", &about, &bytes);
}

/// The folder that files go to: the one that is named, else `usual`; none where a program is served that names none.
pub fn folder<'a>(named: Option<&'a Path>, usual: &'a str) -> Option<&'a Path> {
    named.or_else(|| (!console::serves()).then(|| Path::new(usual)))
}
