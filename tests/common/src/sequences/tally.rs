//! Counts of calls and of their results.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use adaptive_fmu::fmi2::types::Status;

/// A call that takes longer is a hang: no call may integrate more than a bounded number of substeps, and in the slowest
/// FMU those take a fraction of it.
const HANG: Duration = Duration::from_secs(300);

/// Calls so far.
#[derive(Default)]
pub struct Tally {
    /// Results by function: OK, Discard, error.
    answers: BTreeMap<&'static str, [u64; 3]>,
    /// Serialised states that were corrupted, cut short, or of another unit.
    pub corrupted: u64,
    /// Number of times that a sequence went on, back, and on again.
    pub continued: u64,
    longest: Duration,
    /// The calls that led to it.
    slowest: String,
}

impl Tally {
    pub fn calls(&self) -> u64 {
        self.answers.values().flatten().sum()
    }

    pub fn add(&mut self, name: &'static str, status: Status, took: Duration, text: impl FnOnce() -> String) {
        let place = match status {
            Status::Ok | Status::Warning => 0,
            Status::Discard => 1,
            Status::Error => 2,
        };
        self.answers.entry(name).or_default()[place] += 1;
        if took > self.longest {
            (self.longest, self.slowest) = (took, text());
            assert!(took < HANG, "a call of {took:?}: {}", self.slowest);
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:34} {:>10} {:>10} {:>10}", "", "OK", "Discard", "Error")?;
        let mut total = [0; 3];
        for (name, answers) in &self.answers {
            let [ok, discard, error] = answers;
            writeln!(f, "{name:34} {ok:10} {discard:10} {error:10}")?;
            total.iter_mut().zip(answers).for_each(|(sum, count)| *sum += count);
        }
        let [ok, discard, error] = total;
        writeln!(f, "{:34} {ok:10} {discard:10} {error:10}", "all")?;
        writeln!(f, "{} serialised states that were corrupted or foreign", self.corrupted)?;
        writeln!(f, "{} continuations, each three times", self.continued)?;
        let last: Vec<_> = self.slowest.lines().rev().take(8).collect();
        writeln!(
            f,
            "the longest call took {:?}: the last of\n{}",
            self.longest,
            last.into_iter().rev().collect::<Vec<_>>().join("\n")
        )
    }
}
