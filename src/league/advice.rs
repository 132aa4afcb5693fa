//! Which controller to take: lines that a person wrote, with the numbers behind them, and whether these bear them out.

use super::quantity::number_of;
use super::record::Record;
use super::study::{Advice, Study};
use crate::simulation::four_digits;

/// A line of advice beside what was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// When it is meant.
    pub when: String,
    /// What to take.
    pub take: String,
    /// Why, with the numbers in their places.
    pub because: String,
    /// Whether all that it rests on holds; none where not all of it is known.
    pub holds: Option<bool>,
}

/// The advice of a study with its numbers.
///
/// # Errors
/// When it names what the league doesn't have.
pub fn advice(study: &Study, records: &[Record]) -> Result<Vec<Measured>, String> {
    study.advice.iter().map(|advice| measured(study, records, advice)).collect()
}

fn measured(study: &Study, records: &[Record], advice: &Advice) -> Result<Measured, String> {
    let mut because = String::new();
    let mut rest = advice.because.as_str();
    while let Some((before, after)) = rest.split_once('{') {
        let (word, behind) = after.split_once('}').ok_or_else(|| format!("`{}`: a {{ has no }}", advice.because))?;
        because.push_str(before);
        because.push_str(&number_of(study, records, word)?.map_or("–".to_owned(), four_digits));
        rest = behind;
    }
    because.push_str(rest);
    let known = advice.holds.iter().map(|claim| holds(study, records, claim)).collect::<Result<Vec<_>, _>>()?;
    let holds = known.iter().copied().try_fold(true, |all, one| Some(all && one?));
    Ok(Measured { when: advice.when.clone(), take: advice.take.clone(), because, holds })
}

/// `A < B` or `A > B`, each a number or PLANT/CONTROLLER.QUANTITY.
fn holds(study: &Study, records: &[Record], claim: &str) -> Result<Option<bool>, String> {
    let words: Vec<&str> = claim.split_whitespace().collect();
    let [left, sign @ ("<" | ">"), right] = words[..] else {
        return Err(format!("`{claim}` must be A < B or A > B, each a number or PLANT/CONTROLLER.QUANTITY"));
    };
    let value = |word: &str| word.parse().map_or_else(|_| number_of(study, records, word), |number| Ok(Some(number)));
    let (left, right): (Option<f64>, Option<f64>) = (value(left)?, value(right)?);
    Ok(left.zip(right).map(|(left, right)| if sign == "<" { left < right } else { left > right }))
}
