//! The command line: reads arguments, calls what does the work, prints. Nothing is decided here.
// They panic if nobody reads; see `console`.
#![deny(clippy::print_stdout, clippy::print_stderr)]

#[macro_use]
mod console;

mod command;

use std::any::TypeId;
use std::ffi::OsString;
use std::process::ExitCode;

use adaptive_fmu::error::{Error, one_line};
use adaptive_fmu::{begun, cache, exporter, fmu};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};

/// Export adaptive controllers and their plants as FMUs (FMI 2.0), and simulate closed loops of FMUs.
///
/// Exit codes: 0 (success), 1 (failure, with the reason on stderr), 2 (invalid arguments), 3 (a loop ran but a metric
/// exceeds its limit, a verification failed or is undecided, or a new or checked design or an FMU is not sound), 130 (a run was interrupted).
///
/// Environment variables: NO_COLOR and CLICOLOR_FORCE control colours, ADAPTIVE_FMU_CACHE is the folder of the cache,
/// CC is the C compiler of `export --compile`.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    global: command::global::GlobalOptions,
}

#[derive(Subcommand)]
enum Command {
    /// List the FMUs, the closed loops and the kinds of systems
    List(command::list::Arguments),
    /// Write a description of your own FMU to be filled in, or the structure of a loop
    New(Box<command::new::Arguments>),
    /// From a plant to the recommended controller: design, simulate and compare controllers of several kinds
    Design(command::design::Arguments),
    /// Print the JSON schema of descriptions
    Schema,
    /// Check the design in an FMU's description: poles, margins, and whether its conditions are met
    Check(command::check::Arguments),
    /// Export FMUs from descriptions and loops
    Export(command::export::Arguments),
    /// Write an archive per platform for users without Rust: program, libraries, descriptions, documentation, licences
    Dist(command::dist::Arguments),
    /// Show the origin, contents, platforms and variables of an FMU
    Info(command::info::Arguments),
    /// Check an FMU against the FMI standard: archive, description, libraries and a short run
    Validate(command::validate::Arguments),
    /// Run a closed loop of FMUs and write metrics, a page with plots, and CSV
    Run(command::run::Arguments),
    /// Simulate a single FMU with inputs over time and write a page with plots, and CSV
    Simulate(command::simulate::Arguments),
    /// Run closed loops, optionally with other values, and show them and earlier results on one page
    Compare(command::compare::Arguments),
    /// Run a closed loop with all combinations of some values and plot metrics, families of curves and maps
    Sweep(command::sweep::Arguments),
    /// Reproduce the thesis: run every example, check its claims and write one page
    Report(command::report::Arguments),
    /// Compare controllers on equal terms: same gain search, conditions, margins and random plants
    League(command::league::Arguments),
    /// Show a closed loop in the browser, with sliders for its parameters and plots that update immediately
    Explore(command::explore::Arguments),
    /// Write a page that designs controllers and generates FMUs in a browser, without a server
    Playground(command::playground::Arguments),
    /// Verify a closed loop by random samples: how many runs fail, with a confidence, and which
    Verify(Box<command::verify::Arguments>),
    /// Tune parameters of a closed loop by a particle swarm
    Tune(command::tune::Arguments),
    /// Identify a linear model of a plant from records, with the uncertainty that they leave
    Identify(command::identify::Arguments),
    /// Linearise an FMU or a loop about an operating point: A, B, C, D and eigenvalues
    Linearise(command::linearise::Arguments),
    /// Print a shell script that completes commands, options and names
    Completions(command::completions::Arguments),
    /// Write manual pages, one per command
    Manual(command::manual::Arguments),
    /// Update the generated files in the source folder: descriptions of FMUs, the schema, tables
    #[command(hide = true)]
    Generate,
    /// Answer requests of another program, each of them one line of JSON
    #[command(hide = true)]
    Serve,
    /// Run an FMU of another tool for another process of this program
    #[command(name = fmu::UNIT_PROCESS, hide = true)]
    UnitProcess,
}

/// The longest message, in characters.
const LONGEST_MESSAGE: usize = 4000;

/// The shared library that goes into FMUs. A build for tests has none: it uses the one next to it.
#[cfg(not(debug_assertions))]
static LIBRARY: Option<&[u8]> = adaptive_fmu_embedded::library!(adaptive_fmu_library);
#[cfg(debug_assertions)]
static LIBRARY: Option<&[u8]> = None;

fn main() -> ExitCode {
    LIBRARY.into_iter().for_each(exporter::hold);
    let code = match parsed(std::env::args_os()) {
        Ok(arguments) => run(arguments),
        // Also help and the version, which were asked for.
        Err(error) => {
            let printed = error.print();
            if !error.use_stderr() {
                console::note(printed);
            }
            u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
        }
    };
    exporter::tidy();
    console::ended(code)
}

/// Parses the words of a command line. A value may be a negative number, whatever option or place it is for.
fn parsed(words: impl IntoIterator<Item = impl Into<OsString> + Clone>) -> Result<Arguments, clap::Error> {
    let mut command = taking_negative_numbers(command::help::arranged(Arguments::command()));
    let mut found = command.try_get_matches_from_mut(words)?;
    Arguments::from_arg_matches_mut(&mut found).map_err(|error| error.format(&mut command))
}

fn taking_negative_numbers(command: clap::Command) -> clap::Command {
    let names: Vec<_> = command.get_subcommands().map(|command| command.get_name().to_owned()).collect();
    let command = command.mut_args(|argument| {
        let takes_values = argument.get_action().takes_values();
        // clap takes `-1e-3` for no number.
        let is_real = takes_values && argument.get_value_parser().type_id() == TypeId::of::<f64>();
        if is_real { argument.allow_hyphen_values(true) } else { argument.allow_negative_numbers(takes_values) }
    });
    names.into_iter().fold(command, |command, name| command.mut_subcommand(name, taking_negative_numbers))
}

/// Runs a command line for a program that is served.
fn answer(words: &[String]) -> ExitCode {
    match parsed(words) {
        Ok(arguments) => run(arguments),
        Err(error) => {
            error_line!("{}", error.to_string().trim_end());
            u8::try_from(error.exit_code()).map_or(ExitCode::FAILURE, ExitCode::from)
        }
    }
}

fn run(Arguments { command, global }: Arguments) -> ExitCode {
    begun::note();
    global.apply();
    let code = match execute(command) {
        Ok(code) => code,
        Err(error) => {
            // Names and values of a file may hold anything, of any length.
            let text = one_line(&error.to_string());
            let shown = text.char_indices().nth(LONGEST_MESSAGE).map_or(&*text, |(end, _)| &text[..end]);
            error_line!("error: {shown}{}", if shown.len() < text.len() { "…" } else { "" });
            // Callers from other languages have exceptions for wrong arguments.
            let is_argument = matches!(error, Error::Argument(_) | Error::Unknown { .. });
            if is_argument && console::serves() {
                ExitCode::from(command::serve::NOT_UNDERSTOOD)
            } else {
                ExitCode::FAILURE
            }
        }
    };
    cache::trouble().iter().for_each(|line| error_line!("warning: {line}"));
    code
}

fn execute(command: Command) -> Result<ExitCode, Error> {
    // Of few runs with parameters that stay.
    fmu::fold_parameters(matches!(command, Command::Run(_) | Command::Compare(_) | Command::Report(_)));
    match command {
        Command::List(arguments) => command::list::execute(&arguments).map(|()| ExitCode::SUCCESS),
        Command::New(arguments) => command::new::execute(&arguments),
        Command::Design(arguments) => command::design::execute(&arguments),
        Command::Schema => Ok(command::schema::execute()),
        Command::Check(arguments) => command::check::execute(&arguments),
        Command::Export(arguments) => command::export::execute(&arguments),
        Command::Dist(arguments) => {
            command::dist::execute(&arguments, &Arguments::command()).map(|()| ExitCode::SUCCESS)
        }
        Command::Identify(arguments) => command::identify::execute(&arguments),
        Command::Linearise(arguments) => command::linearise::execute(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Info(arguments) => command::info::execute(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Validate(arguments) => command::validate::execute(&arguments),
        Command::Simulate(arguments) => command::simulate::execute(&arguments),
        Command::Run(arguments) => command::run::execute(&arguments),
        Command::Compare(arguments) => command::compare::execute(&arguments),
        Command::Sweep(arguments) => command::sweep::execute(&arguments),
        Command::Report(arguments) => command::report::execute(&arguments),
        Command::League(arguments) => command::league::execute(&arguments),
        Command::Explore(arguments) => command::explore::execute(&arguments),
        Command::Playground(arguments) => command::playground::execute(&arguments).map(|()| ExitCode::SUCCESS),
        Command::Verify(arguments) => command::verify::execute(&arguments),
        Command::Tune(arguments) => command::tune::execute(&arguments),
        Command::Completions(arguments) => Ok(command::completions::execute(&arguments, &Arguments::command())),
        Command::Manual(arguments) => {
            command::manual::execute(&arguments, &Arguments::command()).map(|()| ExitCode::SUCCESS)
        }
        Command::Generate => command::generate::execute().map(|()| ExitCode::SUCCESS),
        Command::Serve => Ok(command::serve::execute(answer)),
        Command::UnitProcess => serve_unit(),
    }
}

#[cfg(unix)]
fn serve_unit() -> Result<ExitCode, Error> {
    fmu::serve_unit().map_err(Error::file("the connection to the other process"))?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(not(unix))]
fn serve_unit() -> Result<ExitCode, Error> {
    error_line!("on this platform FMUs of other tools run in the process of the loop");
    Ok(ExitCode::FAILURE)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every command with what leads to it, those of `new` too.
    fn commands(command: &clap::Command, way: &[String]) -> Vec<(Vec<String>, clap::Command)> {
        let own = [way, &[command.get_name().to_owned()]].concat();
        let below = command.get_subcommands().flat_map(|command| commands(command, &own)).collect::<Vec<_>>();
        [(own, command.clone())].into_iter().chain(below).collect()
    }

    #[test]
    fn a_negative_number_is_a_value_of_every_option() {
        let mut options = 0;
        for (way, command) in commands(&Arguments::command(), &[]) {
            for argument in command.get_arguments().filter(|argument| argument.get_action().takes_values()) {
                let Some(name) = argument.get_long() else { continue };
                for number in ["-1", "-0.5", "-1e3"] {
                    let words = way.iter().cloned().chain([format!("--{name}"), number.to_owned()]);
                    let refused = parsed(words).err().map(|error| error.kind());
                    // It may be beyond what is allowed, or something else may be missing.
                    assert_ne!(refused, Some(clap::error::ErrorKind::UnknownArgument), "{way:?} --{name} {number}");
                    options += 1;
                }
            }
        }
        assert!(options > 150, "{options}");
    }

    #[test]
    fn the_command_line_is_sound() {
        Arguments::command().debug_assert();
    }
}
