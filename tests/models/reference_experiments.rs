//! The reference experiments that come with this package's FMUs: each is what its equations give today, by a longer integration than an
//! export allows.

use std::sync::Arc;

use adaptive_fmu::reference::{EXPORT_WORK, ReferenceExperiment, Table};
use common::described::model;
use common::sample::sampled_names;
use common::{at_top, description};

/// The part of its tolerance by which a stored result may deviate: other processors round otherwise.
const PART: f64 = 0.01;

fn made(name: &str) -> ReferenceExperiment {
    ReferenceExperiment::of(&Arc::new(model(&description(name)).unwrap()), 5.0 * EXPORT_WORK).unwrap()
}

/// The largest deviation, relative to the largest value of its column.
fn deviation(table: &Table, other: &Table) -> f64 {
    assert_eq!((&table.names, table.rows.len()), (&other.names, other.rows.len()));
    let of_column = |column: usize| {
        let largest = table.rows.iter().map(|row| row[column].abs()).fold(f64::MIN_POSITIVE, f64::max);
        table.rows.iter().zip(&other.rows).map(|(a, b)| (a[column] - b[column]).abs() / largest).fold(0.0, f64::max)
    };
    (0..=table.names.len()).map(of_column).fold(0.0, f64::max)
}

/// With UPDATE_REFERENCES=1 they are written anew.
#[test]
fn stored_reference_experiments_are_those_of_the_equations() {
    for name in sampled_names() {
        let (file, made) = (at_top("modelDescription/references").join(format!("{name}.json")), made(&name));
        if std::env::var_os("UPDATE_REFERENCES").is_some() {
            let text = serde_json::to_string(&made).unwrap().replace("],[", "],\n[");
            std::fs::write(&file, text + "\n").unwrap();
        }
        let text =
            std::fs::read_to_string(&file).unwrap_or_else(|_| panic!("{name}: run with UPDATE_REFERENCES=1 once"));
        let stored: ReferenceExperiment = serde_json::from_str(&text).unwrap();
        assert_eq!((stored.stop, stored.step, &stored.chosen), (made.stop, made.step, &made.chosen), "{name}");
        assert!((0.5..=2.0).contains(&(stored.tolerance / made.tolerance)), "{name}: {}", stored.tolerance);
        assert_eq!(stored.stimuli, made.stimuli, "{name}");
        let off = deviation(&stored.references, &made.references);
        assert!(off <= PART * made.tolerance, "{name}: its stored results deviate by {off:e}");
    }
}
