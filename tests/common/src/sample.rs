//! What a run of the tests looks at: all units (`tests/all`), or one of each kind (`tests/run`), which the commit chooses, so that all
//! are met in turn. `TEST_SAMPLE=N` in the environment asks for the sample of a run that failed.

use std::collections::BTreeMap;
use std::env::var;
use std::process::Command;

use crate::{description, description_names};

/// The number of the sample.
fn number() -> usize {
    if let Some(given) = var("TEST_SAMPLE").ok().filter(|given| !given.is_empty()) {
        return given.parse().expect("TEST_SAMPLE is a number");
    }
    let asked = Command::new("git").args(["rev-parse", "--short=7", "HEAD"]).output();
    let commit = asked.map(|told| String::from_utf8_lossy(&told.stdout).trim().to_owned()).unwrap_or_default();
    usize::from_str_radix(&commit, 16).map_or(0, |commit| commit % 1000)
}

/// The units that a test of what follows from the framework or from the kind looks at.
pub fn sampled_names() -> Vec<String> {
    if var("TEST_ALL").is_ok_and(|all| all == "1") {
        return description_names();
    }
    let mut kinds = BTreeMap::<_, Vec<_>>::new();
    for name in description_names() {
        let text = description(&name);
        let kind = text.lines().find(|line| line.starts_with("model = ")).expect("a description names its model");
        kinds.entry(kind.to_owned()).or_default().push(name);
    }
    let number = number();
    println!("TEST_SAMPLE={number} looks at the same units");
    kinds.into_values().map(|mut names| names.swap_remove(number % names.len())).collect()
}

/// All of what is many, or every third: which one doesn't go by which unit of a kind is looked at.
pub fn sampled<T>(all: Vec<T>) -> Vec<T> {
    let everything = var("TEST_ALL").is_ok_and(|all| all == "1");
    let (step, from) = if everything { (1, 0) } else { (3, number() / 3 % 3) };
    all.into_iter().skip(from).step_by(step).collect()
}
