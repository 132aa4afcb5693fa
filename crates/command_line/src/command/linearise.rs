//! `linearise`: the linear system that an FMU is like about an operating point.

use std::path::Path;
use std::sync::Arc;

use adaptive_fmu::analysis::{AtBound, Linearisation, Method, OperatingPoint, Quantity, Trim, linearise};
use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::fmu::{Fmu, Hosting};
use adaptive_fmu::report::number;
use adaptive_fmu::structure::{LoopFiles, Structure, composite};
use nalgebra::DMatrix;
use serde_json::{Value, json};

use super::export::warn_of;
use super::hosting::HostingOptions;
use super::names::Names;
use super::number::{finite, positive};
use super::ready;
use super::trim::TrimOptions;

#[derive(clap::Args)]
pub struct Arguments {
    /// FMU archive (NAME.fmu), FMU of this package, description file (NAME.toml), or loop of FMUs of this package.
    ///
    /// A loop is given by its name, a folder, an .ssd file, or an .ssp archive.
    name: String,
    /// Time of the operating point, s [default: start time]
    ///
    /// The states are those of a simulation up to this time, unless --steady-state, --free, --want or --hold is given.
    #[arg(long, value_name = "TIME", value_parser = finite)]
    at: Option<f64>,
    /// Linearise at states whose derivatives are zero at the time of the operating point
    #[arg(long)]
    steady_state: bool,
    #[command(flatten)]
    trim: TrimOptions,
    /// Start value of a parameter, or constant value of an input (repeatable)
    #[arg(long, value_name = "NAME=VALUE", value_parser = assignment)]
    set: Vec<(String, String)>,
    /// Names of the states, if the description of the FMU declares none [default: all Real outputs]
    ///
    /// They must be Real outputs or local variables.
    #[arg(long, value_name = "NAME,…")]
    states: Option<Names>,
    /// Communication step of simulations and experiments, s [default: the one the FMU proposes, or 0.001]
    #[arg(long, value_parser = positive)]
    step: Option<f64>,
    #[command(flatten)]
    hosting: HostingOptions,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

pub fn assignment(text: &str) -> Result<(String, String), String> {
    // A name may hold `=`; a value never does.
    let (name, value) = text.rsplit_once('=').ok_or("must be NAME=VALUE")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

/// Prints the linear system.
pub fn execute(arguments: &Arguments) -> Result<(), Error> {
    let fmu = open_unit(&arguments.name, &arguments.hosting.hosting()?)?;
    let Arguments { at: time, steady_state, set, states, step, .. } = arguments;
    let states = states.clone().map_or_else(Vec::new, |Names(names)| names);
    let (time, steady_state, start, step) = (*time, *steady_state, set.clone(), *step);
    let point = OperatingPoint { time, steady_state, start, states, step, ..OperatingPoint::default() };
    let linear = linearise(&fmu, &arguments.trim.apply(point))?;
    if arguments.json {
        print_line!("{}", as_json(&linear));
    } else {
        print(&linear);
    }
    Ok(())
}

/// Opens an archive, or generates an FMU from a description or else from a whole closed loop.
pub fn open_unit(name: &str, hosting: &Hosting) -> Result<Arc<Fmu>, Error> {
    let file = Path::new(name);
    if file.extension().is_some_and(|extension| extension == "fmu") {
        let fmu = Arc::new(Fmu::open_any(file, hosting)?);
        detail!("{name}: {}", fmu.origin());
        return Ok(fmu);
    }
    let ready = ready::units()?;
    let source = match exporter::find_description(name) {
        Err(Error::Unknown { known, .. }) => {
            warn_of(ready.library())?;
            let (source, warnings) = composite(&find_loop(name, &known)?, ready.library())?;
            warnings.iter().for_each(|warning| error_line!("warning: {warning}"));
            source
        }
        description => description?,
    };
    let fmu = ready.fmu(&source)?;
    detail!("{name}: {}", fmu.origin());
    Ok(fmu)
}

fn find_loop(name: &str, fmus: &[String]) -> Result<Structure, Error> {
    let files = LoopFiles::find(name).map_err(|error| match error {
        Error::Unknown { name, known, all, .. } => {
            Error::Unknown { what: "FMU or loop", name, known: [fmus, &known].concat(), all }
        }
        other => other,
    })?;
    files.structure()
}

/// JSON for scripts, which `new` takes as a plant.
pub fn as_json(linear: &Linearisation) -> Value {
    let Linearisation { name, time, method, trim, states, inputs, outputs, a, b, c, d, eigenvalues } = linear;
    let (steady, unique) = (trim.as_ref().is_some_and(|trim| trim.is_steady), trim.as_ref().map(Trim::is_unique));
    let rows = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
        matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
    };
    json!({ "fmu": name, "time": time, "method": method, "steady_state": steady, "unique": unique, "trim": trim,
            "states": states, "inputs": inputs, "outputs": outputs,
            "A": rows(a), "B": rows(b), "C": rows(c), "D": rows(d), "eigenvalues": eigenvalues })
}

fn print(linear: &Linearisation) {
    let Linearisation { name, time, method, trim, states, inputs, outputs, a, b, c, d, eigenvalues } = linear;
    let what = match trim {
        None => "state",
        Some(trim) if trim.is_steady => "steady state",
        Some(_) => "operating point",
    };
    print_line!("{name}, {what} at t = {time} s, {}", method_text(*method));
    trim.iter().flat_map(remarks).for_each(|line| print_line!("{line}"));
    print_line!();
    for (kind, quantities) in [("state", states), ("input", inputs), ("output", outputs)] {
        for Quantity { name, unit, value, .. } in quantities {
            print_line!("{kind:8} {name:28} {:>14} {}", number(*value), unit.as_deref().unwrap_or(""));
        }
    }
    let derivative = |name: &String| format!("der({name})");
    let plain = |name: &String| name.clone();
    print_matrix("A", a, &rows_of(states, derivative), states);
    print_matrix("B", b, &rows_of(states, derivative), inputs);
    print_matrix("C", c, &rows_of(outputs, plain), states);
    print_matrix("D", d, &rows_of(outputs, plain), inputs);
    if !eigenvalues.is_empty() {
        print_line!("\n{:>14} {:>14} {:>10} {:>16}", "eigenvalue, Re", "Im in rad/s", "damping", "frequency, rad/s");
    }
    for value in eigenvalues {
        let damping = value.damping.map_or("–".to_owned(), |damping| format!("{damping:.4}"));
        let [real, imaginary, frequency] = [value.real, value.imaginary, value.frequency].map(number);
        print_line!("{real:>14} {imaginary:>14} {damping:>10} {frequency:>16}");
    }
}

/// Properties of an operating point that was sought, a line each.
pub fn remarks(trim: &Trim) -> Vec<String> {
    let Trim { equations, unknowns, rank, can_move, at_bound, .. } = trim;
    let is_plain = trim.free.is_empty() && trim.wanted.is_empty() && trim.held.is_empty();
    let mut lines = Vec::new();
    if !is_plain {
        let steps = if trim.steps == 1 { "step" } else { "steps" };
        lines.push(format!(
            "{equations} equations in {unknowns} unknowns, of rank {rank}, solved in {} Newton {steps}",
            trim.steps
        ));
    }
    if !trim.is_unique() {
        let singular = if is_plain { "A is singular: this steady state" } else { "This operating point" };
        let moves = can_move.join(", ");
        lines.push(format!("{singular}, the one near the start values, is one of many; these can move: {moves}"));
    }
    for AtBound { name, value, unit, is_largest } in at_bound {
        let which = if *is_largest { "largest" } else { "smallest" };
        lines.push(format!("{name} is at its {which} value, {} {}", number(*value), unit.as_deref().unwrap_or("")));
    }
    lines.into_iter().map(|line| line.trim_end().to_owned()).collect()
}

/// Text about how it was found.
pub fn method_text(method: Method) -> String {
    match method {
        Method::Derivatives => "by its exact derivatives".to_owned(),
        Method::Differences { part } => {
            format!("by central differences, each value perturbed by {part:e} of its magnitude")
        }
        Method::Responses { part, starts, step, misfit, difference } => {
            let changed = match starts {
                0 => "inputs".to_owned(),
                1 => "inputs and the start value of 1 state".to_owned(),
                _ => format!("inputs and the start values of {starts} states"),
            };
            format!(
                "from responses to {changed}, perturbed by {part} of their magnitude or half their range, sampled \
                 every {step} s; responses of the linear system differ by {misfit:.1e} of the largest response, two \
                 extrapolations to zero perturbation by {difference:.1e} of the largest entry"
            )
        }
    }
}

fn rows_of(quantities: &[Quantity], name: impl Fn(&String) -> String) -> Vec<String> {
    quantities.iter().map(|quantity| name(&quantity.name)).collect()
}

fn print_matrix(name: &str, matrix: &DMatrix<f64>, rows: &[String], columns: &[Quantity]) {
    if matrix.is_empty() {
        return;
    }
    let length = |text: &String| text.chars().count();
    let first = rows.iter().map(length).max().unwrap_or_default();
    let widths: Vec<usize> = columns.iter().map(|column| 2 + length(&column.name).max(14)).collect();
    let titles: Vec<_> =
        columns.iter().zip(&widths).map(|(column, width)| format!("{:>width$}", column.name)).collect();
    print_line!("\n{name:first$}{}", titles.concat());
    for (title, row) in rows.iter().zip(matrix.row_iter()) {
        let values: Vec<_> = row.iter().zip(&widths).map(|(v, width)| format!("{:>width$}", number(*v))).collect();
        print_line!("{title:first$}{}", values.concat());
    }
}
