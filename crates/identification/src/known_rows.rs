//! Known rows of a structure that records contradict: mostly units of measurement.

use crate::data::Data;
use crate::estimate::estimate;
use crate::faults::Names;
use crate::finding::{Finding, Kind};
use crate::layout::{Layout, Place};
use crate::sampled::Hold;
use crate::starts::integral_form;
use crate::structure::{Entries, Entry};
use crate::text::{combination, digits, number};
use crate::uncertainty::Uncertainty;

/// Factors between units that are mixed up.
const FACTORS: [f64; 6] = [57.2958, 0.0174533, 9.5493, 0.10472, 60.0, 1000.0];
/// Number of standard errors within which a factor counts as a known one, and beyond which it isn't 1.
const SURE: f64 = 5.0;
/// A quick estimate must be off by this factor before a fit is made.
const SUSPICIOUS: f64 = 1.1;

/// Findings about rows of which all entries are known and not all are 0: with these free, a factor between units is found.
pub(crate) fn check(data: &Data, entries: &Entries, hold: Hold, names: &Names, findings: &mut Vec<Finding>) {
    for row in 0..data.n {
        let places = known_places(entries, row);
        if places.is_empty() || entries.a[row].iter().chain(&entries.b[row]).any(|entry| entry.is_free()) {
            continue;
        }
        let freed = freed(entries, row);
        let layout = Layout::new(&freed, &data.scaling, data.records);
        if !is_suspicious(data, &layout, &places) {
            continue;
        }
        let Some(found) = found(data, &layout, &places, hold) else { continue };
        let state = &names.signals.measured[row];
        match factor(&found) {
            Some(factor) => {
                let signals = names.signals;
                let all = signals.measured.iter().chain(&signals.inputs).map(String::as_str);
                let value = |entry: &Entry| if let Entry::Known(value) = entry { *value } else { 0.0 };
                let known = entries.a[row].iter().chain(&entries.b[row]).map(value);
                let terms: Vec<(f64, &str)> = known.zip(all).collect();
                let text = format!(
                    "{state}' is {} times what the structure has, {state}' = {}: is {state} in other units?",
                    digits(factor, 3),
                    combination(&terms, 0.0)
                );
                findings.push(Finding::not_sound(Kind::WrongRow, text));
            }
            None => {
                let off = found.iter().filter(|entry| !entry.is(1.0));
                let of = |entry: &Ratio| {
                    let [value, error] = [entry.ratio * entry.known, entry.error * entry.known.abs()].map(number);
                    format!("{} = {value} ± {error} for {}", names.entry(entry.place), number(entry.known))
                };
                let text = off.map(of).collect::<Vec<_>>().join(", ");
                let text = format!("row {} of the structure isn't what the record shows: {text}", row + 1);
                findings.push(Finding::warning(Kind::WrongRow, text));
            }
        }
    }
}

/// An entry of a row that is known and not 0.
struct Known {
    place: Place,
    value: f64,
}

fn known_places(entries: &Entries, row: usize) -> Vec<Known> {
    let of = |entry: &Entry, place: Place| match entry {
        Entry::Known(value) if *value != 0.0 => Some(Known { place, value: *value }),
        _ => None,
    };
    let a = entries.a[row].iter().enumerate().filter_map(|(j, entry)| of(entry, Place::A(row, j)));
    let b = entries.b[row].iter().enumerate().filter_map(|(j, entry)| of(entry, Place::B(row, j)));
    a.chain(b).collect()
}

fn freed(entries: &Entries, row: usize) -> Entries {
    let free = |all: &[Entry]| {
        all.iter().map(|entry| if *entry == Entry::Known(0.0) { *entry } else { Entry::Free }).collect()
    };
    let mut freed = entries.clone();
    freed.a[row] = free(&entries.a[row]);
    freed.b[row] = free(&entries.b[row]);
    freed
}

/// Ratios of estimated entries to known ones, and their standard errors.
fn ratios<'a>(
    data: &'a Data,
    layout: &'a Layout,
    known: &'a [Known],
    unknowns: &'a [f64],
) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
    known.iter().filter_map(move |known| {
        let k = layout.unknowns.iter().position(|unknown| unknown.place == known.place)?;
        let scale = crate::layout::factor(known.place, &data.scaling) / known.value;
        Some((k, unknowns[k] * scale, scale.abs()))
    })
}

fn is_suspicious(data: &Data, layout: &Layout, known: &[Known]) -> bool {
    [10, 60].iter().any(|length| {
        let Some(unknowns) = integral_form(data, layout, *length) else { return false };
        let all: Vec<f64> = ratios(data, layout, known, &unknowns).map(|(_, ratio, _)| ratio).collect();
        all.iter().any(|ratio| !(1.0 / SUSPICIOUS..=SUSPICIOUS).contains(ratio))
    })
}

/// An estimated entry over the known one, with its standard error.
struct Ratio {
    place: Place,
    known: f64,
    ratio: f64,
    error: f64,
}

impl Ratio {
    fn is(&self, factor: f64) -> bool {
        (self.ratio - factor).abs() <= SURE * self.error.max(1e-5 * factor)
    }
}

/// Entries that a fit with these free finds. `None` where they agree with what is known.
fn found(data: &Data, layout: &Layout, known: &[Known], hold: Hold) -> Option<Vec<Ratio>> {
    let found = estimate(data, layout, hold, usize::MAX).ok()?;
    let errors = Uncertainty::of(&found.problem(data, layout, hold), found.fit())?.errors();
    let all: Vec<Ratio> = ratios(data, layout, known, &found.fit().unknowns)
        .zip(known)
        .map(|((k, ratio, scale), Known { place, value })| Ratio {
            place: *place,
            known: *value,
            ratio,
            error: errors[k] * scale,
        })
        .collect();
    let agrees = all.iter().all(|entry| entry.is(1.0));
    (!agrees).then_some(all)
}

/// The factor between units that all entries have.
fn factor(found: &[Ratio]) -> Option<f64> {
    let mut both = FACTORS.into_iter().flat_map(|factor| [factor, 1.0 / factor]);
    both.find(|factor| found.iter().all(|entry| entry.is(*factor)))
}
