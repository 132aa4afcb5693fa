//! The progress of a run, and its interruption.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use adaptive_fmu::error::Error;
#[cfg(unix)]
use adaptive_fmu::process;
use adaptive_fmu::results::Ending;
use adaptive_fmu::simulation::Recording;
use adaptive_fmu::structure::Settings;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;

use crate::console::{self, Detail};

/// Exit code of a run that was interrupted: 128 and the number of the signal, as shells have it.
pub const INTERRUPTED: u8 = 130;
const REFRESH: Duration = Duration::from_millis(200);

static ASKED_TO_STOP: AtomicBool = AtomicBool::new(false);
/// The request that is answered, and the one that is to stop, where another program is served; none is 0.
static ANSWERED: AtomicU64 = AtomicU64::new(0);
static STOPPED: AtomicU64 = AtomicU64::new(0);

/// Has Ctrl-C ask the run to stop at the next communication point, and a second one end the program immediately. So do
/// requests of the system to end the process, where the system has such signals.
fn listen_to_interrupts() {
    static LISTENING: Once = Once::new();
    LISTENING.call_once(|| {
        let heard = ctrlc::set_handler(|| {
            if ASKED_TO_STOP.swap(true, Ordering::SeqCst) {
                std::process::exit(INTERRUPTED.into());
            }
        });
        if let Err(error) = heard {
            error_line!("warning: Ctrl-C will end the run without results: {error}");
        }
        #[cfg(unix)]
        process::listen_to_requests_to_end(INTERRUPTED);
    });
}

/// Sets the request that is answered. A request to stop it counts even if it came first.
pub fn answer(request: u64) {
    ANSWERED.store(request, Ordering::SeqCst);
}

/// Asks the answer to this request to stop at the next communication point.
pub fn stop(request: u64) {
    STOPPED.store(request, Ordering::SeqCst);
}

/// True if the system asked the process to end.
pub fn is_asked_to_end() -> bool {
    #[cfg(unix)]
    return process::is_asked_to_end();
    #[cfg(not(unix))]
    return false;
}

/// True if the user asked the run to stop, or the system the process to end.
pub fn is_interrupted() -> bool {
    let answered = ANSWERED.load(Ordering::SeqCst);
    ASKED_TO_STOP.load(Ordering::SeqCst)
        || is_asked_to_end()
        || answered > 0 && answered == STOPPED.load(Ordering::SeqCst)
}

/// The bars of all runs on stderr, where that is a terminal.
pub struct Bars(MultiProgress);

impl Bars {
    /// Returns bars, and has interrupts caught from now on.
    pub fn new(silent: bool) -> Self {
        listen_to_interrupts();
        Bars(if silent || console::serves() || !console::shows(Detail::Usual) {
            MultiProgress::with_draw_target(ProgressDrawTarget::hidden())
        } else {
            MultiProgress::new()
        })
    }

    /// A line on stderr, above the bars.
    pub fn print(&self, line: &str) {
        self.0.suspend(|| error_line!("{line}"));
    }
}

/// The bar of a run.
pub struct Progress {
    bar: ProgressBar,
    settings: Settings,
    begun: Instant,
    updated: Instant,
}

impl Progress {
    pub fn new(bars: &Bars, name: &str, settings: Settings) -> Self {
        let length = ((settings.stop_time - settings.start_time) * 1e3) as u64;
        let bar = bars.0.add(ProgressBar::new(length)).with_prefix(name.to_owned());
        if let Ok(style) = ProgressStyle::with_template("{prefix:14} {bar:30} {percent:>3} %  {msg}, {eta} left") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(REFRESH);
        let now = Instant::now();
        Progress { bar, settings, begun: now, updated: now }
    }

    /// Runs until the stop time, the user's interruption or an FMU's failure; the recorded points are returned in any
    /// case.
    pub fn watch(
        mut self,
        run: impl FnOnce(&mut dyn FnMut(f64) -> bool) -> Result<Recording, (Error, Box<Recording>)>,
    ) -> (Recording, Ending, Option<Error>) {
        let mut ending = Ending::Complete;
        let result = run(&mut |time| {
            self.show(time);
            if is_interrupted() && time < self.settings.stop_time {
                ending = Ending::Interrupted;
            }
            ending == Ending::Complete
        });
        self.bar.finish_and_clear();
        match result {
            Ok(recording) => (recording, ending, None),
            Err((error, recording)) => (*recording, Ending::Failed(error.to_string()), Some(error)),
        }
    }

    /// Shows how far the run is.
    fn show(&mut self, time: f64) {
        // Far more often than anyone can read, and writing costs more than a step.
        if self.updated.elapsed() < REFRESH / 2 {
            return;
        }
        self.updated = Instant::now();
        let done = time - self.settings.start_time;
        let speed = done / self.begun.elapsed().as_secs_f64();
        let message = format!("t = {time:.2} of {} s, {speed:.1} × real time", self.settings.stop_time);
        if console::serves() {
            let part = done / (self.settings.stop_time - self.settings.start_time);
            return console::send("progress", &json!({ "done": part, "told": message }), &[]);
        }
        self.bar.set_message(message);
        self.bar.set_position((done * 1e3) as u64);
    }
}

/// The bar of many runs.
pub struct Counter(ProgressBar);

impl Counter {
    /// Returns a bar of `runs` runs, of which `done` were done before.
    pub fn new(bars: &Bars, name: &str, runs: usize, done: usize) -> Self {
        let bar = bars.0.add(ProgressBar::new(runs as u64)).with_prefix(name.to_owned());
        if let Ok(style) = ProgressStyle::with_template("{prefix:14} {bar:30} {pos} of {len} runs, {msg}, {eta} left") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(REFRESH);
        bar.set_position(done as u64);
        bar.reset_eta();
        Counter(bar)
    }

    /// One more run is done.
    pub fn count(&self, message: &str) {
        self.advance(1, message);
    }

    /// No run is done any more.
    pub fn restart(&self) {
        self.0.set_position(0);
    }

    /// Counts `count` more runs as done.
    pub fn advance(&self, count: usize, message: &str) {
        self.0.set_message(message.to_owned());
        self.0.inc(count as u64);
        if console::serves() {
            let (done, runs) = (self.0.position(), self.0.length().unwrap_or(1));
            let shown = format!("{done} of {runs} runs, {message}");
            console::send("progress", &json!({ "done": done as f64 / runs as f64, "told": shown }), &[]);
        }
    }

    pub fn clear(&self) {
        self.0.finish_and_clear();
    }
}
