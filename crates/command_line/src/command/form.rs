//! The form of the many runs of a search or a study: one continuous system where that can be, else separate FMUs.

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter::Library;
use adaptive_fmu::structure::composite as composite_of;
use adaptive_fmu::structure::{LoopFiles, Structure};

use super::loop_options::LoopOptions;

/// The form of runs.
pub struct Form {
    pub options: LoopOptions,
    pub structure: Structure,
    /// The form of `run`, where another one was chosen by itself.
    pub verified: Option<(LoopOptions, Structure)>,
}

impl Form {
    /// Chooses one continuous system, which is fast, if the user asks for nothing else and the loop allows it; with
    /// this tolerance, if one is given and the user gives none.
    pub fn of(asked: &LoopOptions, separate: bool, files: &LoopFiles, tolerance: Option<f64>) -> Result<Self, Error> {
        let options = asked.clone();
        let structure = options.structure(files)?;
        let LoopOptions { composite, fmus, order, accept_algebraic_loops, .. } = &options;
        if separate || *composite || fmus.is_some() || order.is_some() || *accept_algebraic_loops {
            return Ok(Form { options, structure, verified: None });
        }
        let as_one = LoopOptions { composite: true, ..options.clone() };
        let mut whole = as_one.structure(files)?;
        match composite_of(&whole, &Library::next_to_program()?) {
            Ok((_, notes)) => {
                notes.iter().for_each(|note| remark!("{note} (use --separate to run separate FMUs)"));
            }
            Err(reason) => {
                remark!("running separate FMUs because the loop can't be simulated as a single FMU: {reason}");
                return Ok(Form { options, structure, verified: None });
            }
        }
        if let Some(tolerance) = tolerance.filter(|_| whole.whole.is_empty()) {
            whole.set(&format!("relative_tolerance={tolerance}"))?;
        }
        // Separate components have no parameters of the whole.
        let verified = structure.whole.is_empty().then_some((options, structure));
        Ok(Form { options: as_one, structure: whole, verified })
    }
}
