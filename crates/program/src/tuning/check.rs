//! Checks that a file has every value of its swarm, so that a search can go on from it.

use serde_json::Value;

use super::{Motion, Question};

/// A value in a file, with its path.
struct Place<'a> {
    path: String,
    value: &'a Value,
}

/// A best position in a file: the position as written, and its value.
type Found<'a> = (&'a Value, f64);

/// Checks the swarm of a file against its question.
///
/// # Errors
/// The key, its value and what is allowed.
pub(super) fn check(swarm: &Value, question: &Question) -> Result<(), String> {
    let swarm = Place { path: "swarm".to_owned(), value: swarm };
    let Question { parameters, particles, motion, .. } = question;
    let bounds: Vec<(f64, f64)> = parameters.iter().map(|range| (range.low, range.high)).collect();
    swarm.entry("motion")?.require(&serde_json::to_value(motion).unwrap_or_default())?;
    swarm.entry("bounds")?.require(&serde_json::to_value(&bounds).unwrap_or_default())?;
    let random = swarm.entry("random")?;
    random.value.as_u64().ok_or_else(|| random.wrong(&format!("must be a whole number from 0 to {}", u64::MAX)))?;
    let mut found = Vec::new();
    for particle in swarm.entry("particles")?.items(*particles)? {
        found.extend(check_particle(&particle, &bounds, *motion)?);
    }
    let best = best(&swarm, &bounds)?;
    check_best(&swarm, best, &found)?;
    check_history(&swarm.entry("history")?, best.map(|(_, value)| value), *particles)
}

fn check_particle<'a>(
    particle: &Place<'a>,
    bounds: &[(f64, f64)],
    motion: Motion,
) -> Result<Option<Found<'a>>, String> {
    particle.entry("position")?.numbers(bounds)?;
    let limit = |(low, high): &(f64, f64)| motion.velocity_limit * (high - low);
    let speeds: Vec<_> = bounds.iter().map(|bounds| (-limit(bounds), limit(bounds))).collect();
    particle.entry("velocity")?.numbers(&speeds)?;
    best(particle, bounds)
}

/// The best position of a particle, or of the swarm; none if no run was complete.
fn best<'a>(of: &Place<'a>, bounds: &[(f64, f64)]) -> Result<Option<Found<'a>>, String> {
    let best = of.entry("best")?;
    if best.value.is_null() {
        return Ok(None);
    }
    let position = best.entry("position")?;
    position.numbers(bounds)?;
    Ok(Some((position.value, best.entry("value")?.number(f64::MIN, f64::MAX)?)))
}

/// The best position of all is the best one of a particle.
fn check_best(swarm: &Place, best: Option<Found>, found: &[Found]) -> Result<(), String> {
    let place = swarm.entry("best")?;
    let least = found.iter().map(|(_, value)| *value).reduce(f64::min);
    match (best, least) {
        (None, None) => Ok(()),
        (Some((position, value)), Some(least)) if value == least => {
            if found.contains(&(position, value)) {
                return Ok(());
            }
            Err(place.entry("position")?.wrong("must be the best position of a particle"))
        }
        (Some(_), Some(least)) => {
            Err(place.entry("value")?.wrong(&format!("must be {least:?}, the smallest of all particles' best values")))
        }
        (Some(_), None) => Err(place.wrong("must be null, because no particle has a best position")),
        (None, Some(_)) => Err(place.wrong("must be the best position of all particles")),
    }
}

/// The best value so far never increases, and ends at that of the swarm.
fn check_history(history: &Place, best: Option<f64>, particles: usize) -> Result<(), String> {
    let Value::Array(generations) = history.value else { return Err(history.wrong("must be a list")) };
    let mut before = f64::INFINITY;
    let mut last = None;
    for generation in history.items(generations.len())? {
        let so_far = generation.entry("best")?;
        last = match so_far.value {
            Value::Null if before == f64::INFINITY => None,
            _ => Some(so_far.number(f64::MIN, before.min(f64::MAX))?),
        };
        before = last.unwrap_or(before);
        let median = generation.entry("median")?;
        if !median.value.is_null() {
            median.number(last.unwrap_or(f64::MAX), f64::MAX)?;
        }
        let failed = generation.entry("failed")?;
        let wrong = || failed.wrong(&format!("must be a whole number from 0 to {particles}"));
        failed.value.as_u64().filter(|&failed| failed <= particles as u64).ok_or_else(wrong)?;
    }
    if last == best {
        return Ok(());
    }
    let least = best.map_or("null".to_owned(), |best| format!("{best:?}"));
    Err(format!("{}: the best value of the last generation must be the swarm's best value, {least}", history.path))
}

impl<'a> Place<'a> {
    fn entry(&self, key: &str) -> Result<Place<'a>, String> {
        let value = self.value.get(key).ok_or_else(|| format!("{} has no {key}", self.path))?;
        Ok(Place { path: format!("{}.{key}", self.path), value })
    }

    fn items(&self, count: usize) -> Result<Vec<Place<'a>>, String> {
        let wrong = || self.wrong("must be a list");
        let items = self.value.as_array().ok_or_else(wrong)?;
        if items.len() != count {
            return Err(format!("{} has {} entries: must have {count}", self.path, items.len()));
        }
        let place = |(k, value)| Place { path: format!("{}[{k}]", self.path), value };
        Ok(items.iter().enumerate().map(place).collect())
    }

    fn number(&self, low: f64, high: f64) -> Result<f64, String> {
        let allowed = || match (low > f64::MIN, high < f64::MAX) {
            (true, true) => format!("must be a number from {low:?} to {high:?}"),
            (true, false) => format!("must be a finite number, at least {low:?}"),
            (false, true) => format!("must be a number, at most {high:?}"),
            (false, false) => "must be a finite number".to_owned(),
        };
        let number = self.value.as_f64().filter(|number| (low..=high).contains(number));
        number.ok_or_else(|| self.wrong(&allowed()))
    }

    fn numbers(&self, bounds: &[(f64, f64)]) -> Result<(), String> {
        let items = self.items(bounds.len())?;
        items.iter().zip(bounds).try_for_each(|(item, &(low, high))| item.number(low, high).map(drop))
    }

    /// Checks that it equals the question's value.
    fn require(&self, asked: &Value) -> Result<(), String> {
        if self.value == asked {
            return Ok(());
        }
        match asked {
            Value::Object(entries) => {
                for (key, asked) in entries {
                    self.entry(key)?.require(asked)?;
                }
            }
            Value::Array(entries) => {
                for (item, asked) in self.items(entries.len())?.iter().zip(entries) {
                    item.require(asked)?;
                }
            }
            _ => {}
        }
        Err(self.wrong(&format!("must be {asked}, as in question")))
    }

    fn wrong(&self, allowed: &str) -> String {
        /// The beginning of a long list or text is enough.
        const SHOWN: usize = 60;
        let text = self.value.to_string();
        let shown: String = text.chars().take(SHOWN).collect();
        let more = if shown.len() < text.len() { "…" } else { "" };
        format!("{} = {shown}{more}: {allowed}", self.path)
    }
}
