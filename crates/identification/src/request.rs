//! First steps with any request.

use crate::data::Part;
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::options::Options;
use crate::record::{Record, Signals};

/// Signals without the inputs that are left out.
pub(crate) fn without_fixed(
    signals: &Signals,
    options: &Options,
    findings: &mut Vec<Finding>,
) -> Result<Signals, Refusal> {
    let mut kept = signals.clone();
    for fixed in &options.fixed {
        if !signals.inputs.contains(fixed) {
            let text = format!("`{fixed}` is no input; there are: {}", signals.inputs.join(", "));
            return Err(Refusal::new(Cause::Request, text));
        }
        kept.inputs.retain(|input| input != fixed);
        findings.push(Finding::note(
            Kind::FixedInput,
            format!("{fixed} is left out: the model holds where it is as it was"),
        ));
    }
    Ok(kept)
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
