//! The units and loops that a run of the tests takes: all (`tests/all`), or one unit of each kind and every third loop. TEST_SAMPLE=N
//! in the environment chooses them; `tests/run` takes N from the commit, so that all are met in turn.

use std::collections::BTreeMap;
use std::env::var;

use crate::{description, description_names};

/// The number of the sample; none where everything is taken.
fn number() -> Option<usize> {
    let number = || var("TEST_SAMPLE").map_or(0, |given| given.parse().expect("TEST_SAMPLE is a number"));
    let sampled = !var("TEST_ALL").is_ok_and(|all| all == "1");
    sampled.then(number).inspect(|number| println!("TEST_SAMPLE={number}"))
}

/// Names of units for tests of what follows from the framework or from the kind.
pub fn sampled_names() -> Vec<String> {
    number().map_or_else(description_names, one_of_each_kind)
}

fn one_of_each_kind(number: usize) -> Vec<String> {
    let mut kinds = BTreeMap::<_, Vec<_>>::new();
    for name in description_names() {
        let text = description(&name);
        let kind = text.lines().find(|line| line.starts_with("model = ")).expect("a description names its model");
        kinds.entry(kind.to_owned()).or_default().push(name);
    }
    kinds.into_values().map(|mut names| names.swap_remove(number % names.len())).collect()
}

/// Every third of these, or all.
pub fn sampled<T>(all: Vec<T>) -> Vec<T> {
    match number() {
        Some(number) => third(number, all),
        None => all,
    }
}

/// The third doesn't go by the remainders that choose among units of a kind: else some would never be in theirs.
fn third<T>(number: usize, all: Vec<T>) -> Vec<T> {
    all.into_iter().skip(number / 64 % 3).step_by(3).collect()
}

/// All units are met in turn, in thirds of the samples too.
#[test]
fn in_turn_all_units_are_met() {
    let mut met: Vec<_> = (0..1000).flat_map(|number| third(number, one_of_each_kind(number))).collect();
    met.sort();
    met.dedup();
    assert_eq!(met, description_names());
}
