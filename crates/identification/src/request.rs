//! First steps with any request.

use crate::data::Part;
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::options::Options;
use crate::record::{Record, Signals};

/// Signals and options without the inputs that are left out.
pub(crate) fn without_fixed(
    signals: &Signals,
    options: &Options,
    findings: &mut Vec<Finding>,
) -> Result<(Signals, Options), Refusal> {
    let refuse = |text: String| Err(Refusal::new(Cause::Request, text));
    let (mut kept, mut of_kept) = (signals.clone(), options.clone());
    let (inputs, delays) = (signals.inputs.len(), &options.delays);
    if !delays.is_empty() && delays.len() != inputs {
        return refuse(format!("{} delays of {inputs} inputs: must be one for each, or none", delays.len()));
    }
    if let Some(delay) = delays.iter().find(|delay| !delay.is_finite() || **delay < 0.0) {
        return refuse(format!("delay = {delay}: must be a finite number, at least 0"));
    }
    for fixed in &options.fixed {
        let Some(place) = kept.inputs.iter().position(|input| input == fixed) else {
            return refuse(format!("`{fixed}` is no input; there are: {}", kept.inputs.join(", ")));
        };
        kept.inputs.remove(place);
        if !of_kept.delays.is_empty() {
            of_kept.delays.remove(place);
        }
        findings.push(Finding::note(
            Kind::FixedInput,
            format!("{fixed} is left out: the model holds where it is as it was"),
        ));
    }
    Ok((kept, of_kept))
}

/// Rows of each record that are estimated from, and those held out.
pub(crate) fn parts(records: &[Record], all: bool, options: &Options) -> Result<(Part, Part), Refusal> {
    if !(0.0..0.9).contains(&options.hold_out) {
        let text = format!("{} of each record can't be held out: at least 0 and less than 0.9", options.hold_out);
        return Err(Refusal::new(Cause::Request, text));
    }
    let fraction = if all { 0.0 } else { options.hold_out };
    let split = |record: &Record| record.len() - (fraction * record.len() as f64).round() as usize;
    let first = records.iter().map(|record| 0..split(record)).collect();
    Ok((first, records.iter().map(|record| split(record)..record.len()).collect()))
}
