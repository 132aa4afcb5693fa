//! Advice on which controller to choose: lines written by hand, with the numbers behind them, and a check of each.

use serde::Serialize;

use super::quantity::meant;
use super::record::Record;
use super::study::{Advice, Study};

/// A line of advice with measured numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Situation that it applies to.
    pub when: String,
    /// Controller to choose; empty if only nested lines name one.
    pub take: String,
    /// Reason, with the numbers filled in.
    pub because: String,
    /// True if all its claims hold; none if not all are known.
    pub holds: Option<bool>,
    /// Nested lines for further conditions.
    pub within: Vec<Measured>,
}

/// The advice of a study with its numbers, without that on pairs that weren't run.
///
/// # Errors
/// If it names what the league doesn't have.
pub fn advice(study: &Study, records: &[Record]) -> Result<Vec<Measured>, String> {
    all_measured(study, records, &study.advice)
}

fn all_measured(study: &Study, records: &[Record], lines: &[Advice]) -> Result<Vec<Measured>, String> {
    let lines = lines.iter().map(|advice| measured(study, records, advice)).collect::<Result<Vec<_>, _>>()?;
    Ok(lines.into_iter().flatten().collect())
}

fn measured(study: &Study, records: &[Record], advice: &Advice) -> Result<Option<Measured>, String> {
    let (mut because, mut ran) = (String::new(), true);
    let mut rest = advice.because.as_str();
    while let Some((before, after)) = rest.split_once('{') {
        let (word, behind) = after.split_once('}').ok_or_else(|| format!("`{}`: {{ without }}", advice.because))?;
        because.push_str(before);
        let (quantity, found) = meant(study, records, word)?;
        ran &= found.is_some_and(|(_, record)| record.next().is_none());
        let value = found.and_then(|(plant, record)| quantity.of(plant, record));
        because.push_str(&value.map_or("–".to_owned(), |value| quantity.to_text(value)));
        rest = behind;
    }
    because.push_str(rest);
    let known =
        advice.holds.iter().map(|claim| holds(study, records, claim, &mut ran)).collect::<Result<Vec<_>, _>>()?;
    let holds = known.iter().copied().try_fold(true, |all, one| Some(all && one?));
    let within = all_measured(study, records, &advice.within)?;
    if ran && !advice.take.is_empty() {
        return Ok(Some(Measured { when: advice.when.clone(), take: advice.take.clone(), because, holds, within }));
    }
    // Only its nested lines remain.
    let (when, take, because) = (advice.when.clone(), String::new(), String::new());
    Ok((!within.is_empty()).then_some(Measured { when, take, because, holds: Some(true), within }))
}

/// Checks `A < B` or `A > B`, each a number or PLANT/CONTROLLER.QUANTITY. Intervals must not overlap.
fn holds(study: &Study, records: &[Record], claim: &str, ran: &mut bool) -> Result<Option<bool>, String> {
    let words: Vec<&str> = claim.split_whitespace().collect();
    let [left, sign @ ("<" | ">"), right] = words[..] else {
        return Err(format!("`{claim}` must be A < B or A > B, each a number or PLANT/CONTROLLER.QUANTITY"));
    };
    let mut interval = |word: &str| {
        if let Ok(number) = word.parse::<f64>() {
            return Ok(Some([number; 2]));
        }
        let (quantity, found) = meant(study, records, word)?;
        *ran &= found.is_some_and(|(_, record)| record.next().is_none());
        Ok::<_, String>(found.and_then(|(plant, record)| quantity.interval_of(plant, record)))
    };
    let (left, right) = (interval(left)?, interval(right)?);
    Ok(left.zip(right).map(|(left, right)| if sign == "<" { left[1] < right[0] } else { left[0] > right[1] }))
}
