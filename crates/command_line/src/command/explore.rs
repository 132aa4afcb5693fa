//! `explore`: a closed loop in the browser, with sliders for its parameters.

use std::fs::OpenOptions;
use std::io::{self, IsTerminal, Write, stdout};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use adaptive_fmu::error::Error;
use adaptive_fmu::explore::{Server, Session, cases, coarse, token, write_page};
use adaptive_fmu::exporter::{Library, loops};
use adaptive_fmu::scratch::Scratch;
use adaptive_fmu::structure::composite as composite_of;
use adaptive_fmu::structure::{LoopFiles, Structure};
use serde_json::json;

use super::loop_options::LoopOptions;
use super::number::positive;
use super::open;
use super::parameters::Parameters;
use super::progress::{Bars, is_interrupted};

/// Interval at which the program checks whether the user wants to end.
const LOOK: Duration = Duration::from_millis(50);

/// Options for a page that a server answers.
const SERVED: [&str; 17] = [
    "separate",
    "composite",
    "port",
    "open",
    "no_open",
    "duration",
    "fmus",
    "step",
    "until",
    "order",
    "accept_algebraic_loops",
    "terminals",
    "case",
    "set",
    "in_process",
    "patience",
    "json",
];

#[derive(clap::Args)]
pub struct Arguments {
    /// Loop of this package, or SSP: a folder with SystemStructure.ssd, an .ssd file, or an .ssp archive
    #[arg(value_name = "LOOP")]
    name: String,
    /// Simulate the components separately, at their communication step, as `run` does.
    ///
    /// By default the loop is one continuous system if possible, which is many times faster. --fmus, --order and
    /// --accept-algebraic-loops also select separate components.
    #[arg(long, conflicts_with = "composite")]
    separate: bool,
    /// Port of the page on this machine; 0 selects a free port
    #[arg(long, default_value_t = 0)]
    port: u16,
    /// Always open the page in the browser [default: only from a terminal with a display]
    #[arg(long, conflicts_with = "no_open")]
    open: bool,
    /// Print the address without opening a browser
    #[arg(long)]
    no_open: bool,
    /// Folder for parameter sets and FMUs, which go to its subfolder LOOP-explored
    #[arg(long, default_value = "results")]
    out: PathBuf,
    /// Write the page of a loop of this package as files that need no server, into the folder of --out.
    ///
    /// LIBRARY is the library of this package, built for wasm32-unknown-unknown. Pages in the same folder share it.
    #[arg(long, value_name = "LIBRARY.wasm", conflicts_with_all = SERVED)]
    page: Option<PathBuf>,
    /// Time after which the command ends, s [default: it runs until Ctrl-C]
    #[arg(long = "for", value_name = "SECONDS", value_parser = positive)]
    duration: Option<f64>,
    #[command(flatten)]
    options: LoopOptions,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Serves the page of a loop until the user ends it.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    if let Some(library) = &arguments.page {
        return written(arguments, library);
    }
    // From here on Ctrl-C is heard.
    let _bars = Bars::new(true);
    let files = LoopFiles::find(&arguments.name)?;
    let session = Arc::new(session(arguments, &files)?);
    let token = token().map_err(Error::file("random numbers"))?;
    let server = Server::new(Arc::clone(&session), arguments.port, token);
    let server = server.map_err(Error::file(format!("127.0.0.1:{}", arguments.port)))?;
    let url = server.url();
    if arguments.json {
        print_line!("{}", json!({ "url": url }));
    } else {
        print_line!("{url}");
        error_line!("the page of {} is at this address, on this machine only. Press Ctrl-C to end", arguments.name);
    }
    thread::spawn(move || server.serve());
    let opens = !arguments.no_open && (arguments.open || stdout().is_terminal() && has_display());
    // It is there as long as the page is.
    let _address = opens.then(|| opened(&url)).transpose()?;
    let begun = Instant::now();
    let is_over = || arguments.duration.is_some_and(|seconds| begun.elapsed().as_secs_f64() >= seconds);
    while !is_interrupted() && !is_over() {
        thread::sleep(LOOK);
    }
    session.end();
    Ok(ExitCode::SUCCESS)
}

/// Opens the page by a file that leads to it: the list of processes shows a program's arguments, where anybody on this
/// machine could read the token. Only its user can read the file, which is removed with its folder.
fn opened(url: &str) -> Result<Scratch, Error> {
    let folder = Scratch::new()?;
    let text = format!(
        "<!DOCTYPE html>\n<meta charset=\"utf-8\">\n<meta name=\"referrer\" content=\"no-referrer\">\n\
         <meta http-equiv=\"refresh\" content=\"0; url={url}\">\n<title>explore</title>\n<a href=\"{url}\">The page of the loop</a>\n"
    );
    let file = folder.path().join("explore.html");
    write_for_user(&file, &text).map_err(Error::file(&file))?;
    open::show(file.as_os_str());
    Ok(folder)
}

/// Writes a file that nobody else can read, whatever the mask.
fn write_for_user(file: &Path, text: &str) -> io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(file)?.write_all(text.as_bytes())
}

/// Writes the page as files.
fn written(arguments: &Arguments, library: &Path) -> Result<ExitCode, Error> {
    if !loops().iter().any(|(name, _)| *name == arguments.name) {
        let known = loops().iter().map(|(name, _)| *name);
        return Err(Error::unknown("loop of this package", &arguments.name, known, "`adaptive-fmu list`"));
    }
    let bytes = std::fs::read(library).map_err(Error::file(library))?;
    let page = write_page(&arguments.name, (library, &bytes), &arguments.out)?;
    print_line!("{}", page.display());
    Ok(ExitCode::SUCCESS)
}

/// The loop, ready to run: as it is, and with each of the cases next to it.
fn session(arguments: &Arguments, files: &LoopFiles) -> Result<Session, Error> {
    let (options, structure, mut notes) = form(arguments, files)?;
    let fine = options.settings(&structure)?;
    let settings = if options.composite && options.step.is_none() { coarse(fine) } else { fine };
    let hosting = options.hosting.hosting()?;
    let load = |structure: &Structure| options.units(structure)?.load(structure, &hosting);
    let plain = LoopOptions { parameters: Parameters::default(), ..options.clone() };
    let plain = load(&plain.structure(files)?)?;
    let (bases, left_out) = cases(structure, files, load)?;
    notes.extend(left_out);
    Ok(Session::new(bases, &plain, (settings, fine), options.composite, notes, arguments.out.clone())
        .with_terminals(options.terminals))
}

/// Chooses a single FMU if possible, unless the user asks for separate ones; with notes for the user.
fn form(arguments: &Arguments, files: &LoopFiles) -> Result<(LoopOptions, Structure, Vec<String>), Error> {
    let options = arguments.options.clone();
    let structure = options.structure(files)?;
    let LoopOptions { composite, fmus, order, accept_algebraic_loops, .. } = &options;
    if arguments.separate || *composite || fmus.is_some() || order.is_some() || *accept_algebraic_loops {
        return Ok((options, structure, Vec::new()));
    }
    let as_one = LoopOptions { composite: true, ..options.clone() };
    let whole = as_one.structure(files)?;
    match composite_of(&whole, &Library::next_to_program()?) {
        Ok(_) => Ok((as_one, whole, Vec::new())),
        Err(reason) => {
            let note =
                format!("this loop is run as separate FMUs because it can't be simulated as a single FMU: {reason}");
            Ok((options, structure, vec![note]))
        }
    }
}

/// True if a browser could be seen.
fn has_display() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    cfg!(any(windows, target_os = "macos")) || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}
