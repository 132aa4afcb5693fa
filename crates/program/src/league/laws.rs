//! Strengths and weaknesses of each controller over all its plants, as measured.

use super::condition::Condition;
use super::quantity::Quantity;
use super::record::Record;
use super::standing::{Rank, standings};
use super::study::Study;

/// A controller on all its plants.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Its name.
    pub name: String,
    /// Measured facts, a sentence each.
    pub sentences: Vec<String>,
}

/// All controllers with a computed pair, in the order in which the study names them first.
pub fn laws(study: &Study, records: &[Record]) -> Vec<Law> {
    let mut names: Vec<&str> = Vec::new();
    for entry in study.plant.iter().flat_map(|plant| &plant.controller) {
        if !names.contains(&entry.name.as_str()) {
            names.push(&entry.name);
        }
    }
    let law = |name: &str| {
        let is_own = |record: &&Record| record.controller == name && record.next().is_none();
        let own: Vec<&Record> = records.iter().filter(is_own).collect();
        (!own.is_empty()).then(|| Law { name: name.to_owned(), sentences: sentences(study, records, &own) })
    };
    names.into_iter().filter_map(law).collect()
}

fn sentences(study: &Study, records: &[Record], own: &[&Record]) -> Vec<String> {
    let mut lines = vec![conditions(own)];
    lines.extend(ranks(study, records, own));
    for name in ["median", "variation", "dead_time", "step", "instructions"] {
        lines.extend(Quantity::named(name).ok().and_then(|quantity| relative_to_best(study, records, own, quantity)));
    }
    lines
}

/// The number of conditions that it passed, and those that it failed.
fn conditions(own: &[&Record]) -> String {
    let all = own.iter().flat_map(|record| {
        let conditions = record.conditions.iter().flatten();
        conditions.map(move |(condition, judged)| (record.plant.as_str(), *condition, judged.outcome.holds()))
    });
    let all: Vec<(&str, Condition, bool)> = all.collect();
    let failed: Vec<_> = all.iter().filter(|(.., holds)| !holds).collect();
    let passed = all.len() - failed.len();
    let plants = if own.len() == 1 { format!("on {}", own[0].plant) } else { format!("on {} plants", own.len()) };
    let mut text = format!("Passes {passed} of {} conditions {plants}", all.len());
    if !failed.is_empty() {
        let plants = own.iter().map(|record| record.plant.as_str());
        let listed = plants.filter_map(|plant| {
            let of: Vec<_> = failed.iter().filter(|(known, ..)| *known == plant).map(|(_, c, _)| c.title()).collect();
            (!of.is_empty()).then(|| format!("{plant} ({})", of.join(", ")))
        });
        text.push_str(&format!("; fails on {}", listed.collect::<Vec<_>>().join(", ")));
    }
    text + "."
}

/// Plants on which it is first or behind others, if intervals separate them.
fn ranks(study: &Study, records: &[Record], own: &[&Record]) -> Option<String> {
    let (mut first, mut behind, mut ranked) = (Vec::new(), Vec::new(), 0);
    for record in own {
        let of_plant = of_plant(study, records, &record.plant);
        let place = of_plant.iter().position(|other| other.controller == record.controller)?;
        let standings = standings(&of_plant);
        let others = standings.iter().filter(|standing| standing.error.is_some()).count();
        // A single controller is neither first nor last.
        let Some(Rank { place, shared }) = standings[place].error.filter(|_| others > 1) else { continue };
        ranked += 1;
        match (place, shared) {
            (1, false) => first.push(record.plant.as_str()),
            (1, true) => {}
            _ => behind.push(format!("{} (place {place} of {others})", record.plant)),
        }
    }
    if ranked == 0 {
        return None;
    }
    let mut sentences = Vec::new();
    if !first.is_empty() {
        sentences.push(format!("smallest median error, without a tie, on {}", first.join(", ")));
    }
    let with_others = ranked - first.len() - behind.len();
    if with_others > 0 {
        sentences.push(format!(
            "tied for the smallest median error (overlapping intervals) on {with_others} of {ranked} plants"
        ));
    }
    if !behind.is_empty() {
        sentences.push(format!("behind others on {}", behind.join(", ")));
    }
    let mut sentences = sentences.join("; ") + ".";
    sentences[..1].make_ascii_uppercase();
    Some(sentences)
}

/// A quantity relative to the best of each plant.
fn relative_to_best(study: &Study, records: &[Record], own: &[&Record], quantity: Quantity) -> Option<String> {
    let mut ratios = Vec::new();
    for record in own {
        let plant = study.plant.iter().find(|plant| plant.name == record.plant)?;
        let values = of_plant(study, records, &record.plant).into_iter().filter_map(|other| quantity.of(plant, other));
        let best = values.reduce(if quantity.more_is_better { f64::max } else { f64::min });
        if let (Some(value), Some(best)) = (quantity.of(plant, record), best) {
            ratios.push((value / best, record.plant.as_str()));
        }
    }
    ratios.sort_by(|a, b| a.0.total_cmp(&b.0));
    let title = capital(quantity.title);
    let (Some((low, at_low)), Some((high, at_high))) = (ratios.first(), ratios.last()) else {
        return Some(format!("{title}: none, because it fails."));
    };
    // A failure has no number, which must not be taken for a good one.
    let without = own.len() - ratios.len();
    let without = if without == 0 { String::new() } else { format!("; none on {without} of {} plants", own.len()) };
    if ratios.len() == 1 {
        return Some(format!("{title}: {low:.2} times the best of {at_low}{without}."));
    }
    Some(format!("{title}: {low:.2} ({at_low}) to {high:.2} ({at_high}) times the best of each plant{without}."))
}

fn capital(text: &str) -> String {
    let mut text = text.to_owned();
    text[..1].make_ascii_uppercase();
    text
}

/// The records of a plant, in the order of its controllers.
pub(super) fn of_plant<'a>(study: &Study, records: &'a [Record], name: &str) -> Vec<&'a Record> {
    let plant = study.plant.iter().find(|plant| plant.name == name);
    let laws = plant.into_iter().flat_map(|plant| &plant.controller);
    laws.filter_map(|entry| records.iter().find(|record| record.plant == name && record.controller == entry.name))
        .collect()
}
