//! Known rows of a structure that records contradict: mostly units of measurement.

use crate::data::Data;
use crate::estimate::{Estimate, Method, estimate};
use crate::faults::Names;
use crate::finding::{Finding, Kind};
use crate::layout::{Layout, Place};
use crate::sampled::Hold;
use crate::starts::integral_form;
use crate::structure::{Entries, Entry};
use crate::text::{combination, digits};
use crate::uncertainty::Uncertainty;

/// Factors between units that are mixed up.
const FACTORS: [f64; 6] = [57.2958, 0.0174533, 9.5493, 0.10472, 60.0, 1000.0];
/// A factor is that one within so many standard errors, and isn't 1.
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
        if let Some(factor) = factor(data, &layout, &places, hold) {
            let signals = names.signals;
            let all = signals.measured.iter().chain(&signals.inputs).map(String::as_str);
            let value = |entry: &Entry| if let Entry::Known(value) = entry { *value } else { 0.0 };
            let known: Vec<f64> = entries.a[row].iter().chain(&entries.b[row]).map(value).collect();
            let terms = |times: f64| known.iter().map(|value| value * times).zip(all.clone()).collect::<Vec<_>>();
            let state = &signals.measured[row];
            let text = format!(
                "{state}' is {} times what the structure has, {state}' = {}: is {state} in other units?",
                digits(factor, 3),
                combination(&terms(1.0), 0.0)
            );
            findings.push(Finding::not_sound(Kind::WrongRow, text));
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

/// The factor between units that a fit with the entries free shows.
fn factor(data: &Data, layout: &Layout, known: &[Known], hold: Hold) -> Option<f64> {
    let found: Estimate = estimate(data, layout, hold, usize::MAX).ok()?;
    let problem = found.problem(data, layout, hold);
    let uncertainty = Uncertainty::of(&problem, found.fit())?;
    let errors = uncertainty.errors();
    let all: Vec<(f64, f64)> = ratios(data, layout, known, &found.fit().unknowns)
        .map(|(k, ratio, scale)| (ratio, errors[k] * scale))
        .collect();
    debug_assert!(matches!(found.method, Method::OutputError | Method::Innovation));
    let is = |factor: f64| all.iter().all(|(ratio, error)| (ratio - factor).abs() <= SURE * error.max(1e-5 * factor));
    if all.iter().all(|(ratio, error)| (ratio - 1.0).abs() <= SURE * error) {
        return None;
    }
    let mut both = FACTORS.into_iter().flat_map(|factor| [factor, 1.0 / factor]);
    both.find(|factor| is(*factor))
}
