//! First steps with any request.

use crate::data::{ALIKE, Data, Part, Scaling, Source};
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::options::Options;
use crate::record::{Record, Signals};
use crate::sampled::Hold;
use crate::text::number;

/// Signals and options without the inputs that are left out.
pub(crate) fn without_fixed(
    signals: &Signals,
    options: &Options,
    findings: &mut Vec<Finding>,
) -> Result<(Signals, Options), Refusal> {
    let refuse = |text: String| Err(Refusal::new(Cause::Request, text));
    let (mut remaining, mut remaining_options) = (signals.clone(), options.clone());
    let (inputs, delays) = (signals.inputs.len(), &options.delays);
    if !delays.is_empty() && delays.len() != inputs {
        return refuse(format!("{} delays of {inputs} inputs: must be one for each, or none", delays.len()));
    }
    if let Some(delay) = delays.iter().find(|delay| !delay.is_finite() || **delay < 0.0) {
        return refuse(format!("delay = {delay}: must be a finite number, at least 0"));
    }
    for fixed in &options.fixed {
        let Some(place) = remaining.inputs.iter().position(|input| input == fixed) else {
            return refuse(format!("`{fixed}` is no input; there are: {}", remaining.inputs.join(", ")));
        };
        remaining.inputs.remove(place);
        if !remaining_options.delays.is_empty() {
            remaining_options.delays.remove(place);
        }
        findings.push(Finding::note(
            Kind::FixedInput,
            format!("{fixed} is left out: the model holds where it is as it was"),
        ));
    }
    Ok((remaining, remaining_options))
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

/// Data of the held-out part with their records: records of their own, or the last part of each. `None` where no rows are left of it,
/// with a warning.
pub(crate) fn tested<'r>(
    own: Option<&'r [Record]>,
    (source, last): (&Source<'r>, &Part),
    (signals, options): (&Signals, &Options),
    (scaling, prepare): (&Scaling, impl Fn(Data) -> Data),
    findings: &mut Vec<Finding>,
) -> Result<Option<(Data, Vec<&'r Record>)>, Refusal> {
    let found = match own {
        Some(records) => {
            let source = Source::new(records, signals, options, source.fewest)?;
            let part = records.iter().map(|record| 0..record.len()).collect();
            Some(source.data(&part, Some(scaling), None)?)
        }
        None => source.data(last, Some(scaling), None).ok(),
    };
    let found = found.map(prepare).filter(|data| !data.segments.is_empty());
    if found.is_none() && (own.is_some() || options.hold_out > 0.0) {
        let text = format!(
            "nothing is held out: fewer than {} consecutive rows of equal steps have all values there, so the model isn't checked",
            source.fewest
        );
        findings.push(Finding::warning(Kind::NothingHeldOut, text));
    }
    Ok(found.map(|data| data.of_records(own.unwrap_or(source.records))))
}

/// The delays as they act: an input that holds from row to row acts from the next row on. Where steps differ, that is as often
/// sooner as later.
pub(crate) fn act(options: &mut Options, signals: &Signals, data: &Data, findings: &mut Vec<Finding>) {
    let [least, most] = data.steps.extremes();
    if options.hold != Hold::ZeroOrder || most > (1.0 + 2.0 * ALIKE) * least {
        return;
    }
    let h = data.scaling.h;
    for (delay, input) in options.delays.iter_mut().zip(&signals.inputs) {
        let steps = *delay / h;
        if (steps - steps.round()).abs() <= ALIKE {
            continue;
        }
        let acts = steps.ceil() * h;
        let [given, step, of_acts] = [*delay, h, acts].map(number);
        let text =
            format!("the delay of {input}, {given} s, isn't a multiple of the step {step} s: it acts as {of_acts} s");
        findings.push(Finding::warning(Kind::Delay, text));
        *delay = acts;
    }
}

/// Durations of records together, s.
pub(crate) fn duration(records: &[&Record]) -> f64 {
    records.iter().map(|record| record.time[record.len() - 1] - record.time[0]).sum()
}
