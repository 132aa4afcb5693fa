//! The diagrams of a run: the plots of its loop, and the errors of its metrics in their funnels. The loop determines
//! the references.

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::{Diagram, Given, Mark, Part, Shown, time_label};
use crate::simulation::Recording;
use crate::structure::{Event, Metric, PerformanceFunction, Plot, Scale, Structure};

impl Structure {
    /// True for a signal that others follow: a plot's own references, ideal models, and outputs of components without
    /// inputs from the loop.
    fn is_reference(&self, plot: &Plot, signal: &str) -> bool {
        plot.references.iter().any(|name| name == signal)
            || self.models.iter().any(|model| model.name == signal)
            || self.unit_of(signal).is_some_and(|unit| self.sources().any(|source| source == unit.name))
    }

    /// The part of each signal in a plot. A metric, also one with an ideal model, shows which signal follows a
    /// reference. Otherwise it is the signal before the reference, or the one after it in a plot that begins with a
    /// reference.
    pub fn parts(&self, plot: &Plot) -> Vec<Part> {
        let references: Vec<bool> = plot.signals.iter().map(|signal| self.is_reference(plot, signal)).collect();
        if references.iter().all(|is_reference| *is_reference) {
            return vec![Part::Own; references.len()];
        }
        let own =
            |signal: &str| plot.signals.iter().position(|other| other == signal).filter(|&place| !references[place]);
        let compared = |reference: &str| {
            self.metrics.iter().find_map(|Metric { of, minus, .. }| {
                let minus = minus.as_deref()?;
                if minus == reference { own(of) } else { own(minus).filter(|_| of == reference) }
            })
        };
        let by_model = |reference: &str| {
            let models = self.models.iter().filter(|model| model.input == reference);
            models.map(|model| compared(&model.name)).find_map(|place| place)
        };
        let first = references.first().is_some_and(|is_reference| *is_reference);
        let neighbour = |place: usize| {
            let before = || (0..place).rev().find(|&other| !references[other]);
            let behind = || (place..references.len()).find(|&other| !references[other]);
            if first { behind().or_else(before) } else { before().or_else(behind) }
        };
        let part = |(place, signal): (usize, &String)| match references[place] {
            false => Part::Own,
            true => compared(signal)
                .or_else(|| by_model(signal))
                .or_else(|| neighbour(place))
                .map_or(Part::Reference, Part::ReferenceOf),
        };
        plot.signals.iter().enumerate().map(part).collect()
    }
}

/// A signal of a recording.
///
/// # Errors
/// When it isn't there.
fn column<'a>(recording: &'a Recording, name: &str) -> Result<&'a [f64], String> {
    recording.column(name).ok_or_else(|| format!("there is no signal `{name}`"))
}

/// The diagram of a plot over the abscissa of its recording.
///
/// # Errors
/// When it names a signal that isn't there.
pub fn of_plot<'a>(x: &str, plot: &Plot, parts: &[Part], recording: &'a Recording) -> Result<Diagram<'a>, String> {
    let given = |(name, part): (&String, &Part)| {
        Ok(Given {
            name: name.clone(),
            unit: recording.measure(name).unwrap_or_default().to_owned(),
            part: *part,
            shown: Shown::signal(name),
            times: Cow::Borrowed(&recording.times),
            values: Cow::Borrowed(column(recording, name)?),
        })
    };
    let given = plot.signals.iter().zip(parts).map(given).collect::<Result<_, String>>()?;
    Ok(Diagram::new(&plot.title, x, plot.scale, given))
}

/// The diagrams of a run; those of all outputs that components pass on, if its loop has no plots.
///
/// # Errors
/// When one names a signal that isn't there.
pub fn diagrams<'a>(structure: &Structure, recording: &'a Recording) -> Result<Vec<Diagram<'a>>, String> {
    let time = time_label();
    let of_units = if structure.plots.is_empty() { structure.plots_of_units() } else { Vec::new() };
    let plots =
        structure.plots.iter().chain(&of_units).map(|plot| of_plot(&time, plot, &structure.parts(plot), recording));
    let mut diagrams = plots.collect::<Result<Vec<_>, _>>()?;
    let mut funnels: Vec<PerformanceFunction> = structure.metrics.iter().filter_map(|metric| metric.funnel).collect();
    funnels.dedup();
    for (place, funnel) in funnels.iter().enumerate() {
        let title = "errors in their funnel".to_owned();
        let title = if funnels.len() > 1 { format!("{title} {}", place + 1) } else { title };
        diagrams.push(in_funnel(&title, structure, *funnel, recording)?);
    }
    let end = recording.times.last().copied().unwrap_or(f64::NEG_INFINITY);
    let events = structure.events.iter().filter(|event| event.time < end);
    let marks: Vec<_> =
        events.map(|Event { time, name, text, .. }| Mark { time: *time, text: format!("{name} = {text}") }).collect();
    diagrams.iter_mut().for_each(|diagram| diagram.marks.clone_from(&marks));
    Ok(diagrams)
}

/// Magnitudes of the errors with a funnel as a limit.
fn in_funnel<'a>(
    title: &str,
    structure: &Structure,
    funnel: PerformanceFunction,
    recording: &'a Recording,
) -> Result<Diagram<'a>, String> {
    let (mut given, mut seen) = (Vec::new(), BTreeSet::new());
    for Metric { of, minus, .. } in structure.metrics.iter().filter(|metric| metric.funnel == Some(funnel)) {
        if !seen.insert((of, minus)) {
            continue;
        }
        let minus_column = minus.as_ref().map(|name| column(recording, name)).transpose()?;
        let subtracted = |row: usize| minus_column.map_or(0.0, |column| column[row]);
        let magnitudes = column(recording, of)?.iter().enumerate().map(|(row, value)| (value - subtracted(row)).abs());
        let name = minus.as_ref().map_or_else(|| format!("|{of}|"), |minus| format!("|{of} − {minus}|"));
        given.push(Given {
            name,
            unit: recording.measure(of).unwrap_or_default().to_owned(),
            part: Part::Own,
            shown: Shown { of: Some(of.clone()), minus: minus.clone(), magnitude: true, funnel: None },
            times: Cow::Borrowed(&recording.times),
            values: magnitudes.collect(),
        });
    }
    given.push(bound(funnel, &recording.times));
    Ok(Diagram::new(title, &time_label(), Scale::Logarithmic, given))
}

/// The funnel as a curve: the limit of magnitudes.
pub fn bound(funnel: PerformanceFunction, times: &[f64]) -> Given<'_> {
    let start = times.first().copied().unwrap_or_default();
    Given {
        name: "funnel ρ".to_owned(),
        unit: String::new(),
        part: Part::Reference,
        shown: Shown::funnel(funnel),
        values: times.iter().map(|time| funnel.at(time - start)).collect(),
        times: Cow::Borrowed(times),
    }
}
