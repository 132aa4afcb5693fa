//! The held-out part: its results, and the message if it can't have any.

mod support;

use adaptive_fmu_identification::{
    Cause, Entry, Identified, Kind, Options, Record, Refusal, Row, Signals, Structure, identify_outputs,
};
use support::{
    Columns, Plant, ROWS, Random, STEP, columns, columns_of, good, identify_with, kinds, noisy, of_output, refusal,
    text, times,
};

const NOTHING: &str = "nothing is held out: fewer than ";

/// A plant with two real poles, far apart, of which noise hides little.
fn plant() -> Plant {
    Plant::new(2, 1, &[-2.0, 1.0, -3.0, -4.0], &[0.0, 5.0], &[0.0, 0.0])
}

fn of_levels(seed: u64, u: Vec<f64>, step: f64) -> Columns {
    let (mut random, time, u) = (Random(seed + 100), times(u.len(), step), vec![u]);
    let mut x = plant().simulate(&time, &u, &[0.0, 0.0]);
    noisy(&mut random, &mut x, 0.005);
    Columns { time, u, x }
}

fn levels(seed: u64) -> Vec<f64> {
    Random(seed).levels(ROWS, 40)
}

#[test]
fn the_order_is_by_bic_where_the_held_out_part_shows_nothing() {
    let is_by_bic = |found: &Identified, why: &str| {
        let message = text(found, Kind::Order);
        assert!(message.starts_with(&format!("{why}: order 2 is by BIC, of which less is better (1: ")), "{message}");
        assert_eq!(found.model.A.len(), 2);
    };
    // At rest from before the held-out part on.
    let mut rests = levels(60);
    rests[450..].fill(0.0);
    let found = good(of_output(&[of_levels(60, rests, STEP).record()], None, &Options::default()));
    is_by_bic(&found, "the held-out part doesn't move");
    assert!(found.orders.iter().all(|order| order.held_out.is_none()));
    // Steps of a file of its own that a sampled model of the record doesn't have.
    let record = [of_levels(61, levels(61), STEP).record()];
    let other = [of_levels(62, levels(62), 1.5 * STEP).record()];
    let found = good(of_output(&record, Some(&other), &Options::default()));
    is_by_bic(&found, "nothing is held out");
    assert!(text(&found, Kind::NothingHeldOut).starts_with(NOTHING), "{:?}", found.findings);
    // As asked for.
    let found = good(of_output(&record, None, &Options { hold_out: 0.0, ..Options::default() }));
    is_by_bic(&found, "nothing is held out");
    assert_eq!(text(&found, Kind::NothingHeldOut), "");
}

#[test]
fn a_model_that_explains_nothing_is_not_sound() {
    let row = |entries: [Entry; 2]| Row::Entries(entries.to_vec());
    let known = Entry::Known;
    let record = of_levels(63, levels(63), STEP).record();
    for rows in [
        [row([known(-200.0), known(100.0)]), row([known(-3.0), known(-4.0)])],
        [row([Entry::Positive, known(0.0)]), row([known(0.0), Entry::Positive])],
    ] {
        for hold_out in [0.0, 0.3] {
            let structure = Structure { a: Some(rows.to_vec()), ..Structure::default() };
            let found = identify_with(record.clone(), &Options { structure, hold_out, ..Options::default() });
            let Ok(found) = found else { continue };
            assert!(!found.is_sound(), "{:?} {:?}", found.findings, found.model.fit);
            let message = text(&found, Kind::HeldOutFit);
            assert!(message.contains(": the model explains ") && message.ends_with(" % of its motion"), "{message}");
            assert_eq!(text(&found, Kind::HeldOutStill), "");
        }
    }
    // Only noise.
    let mut random = Random(64);
    let x = vec![(0..ROWS).map(|_| random.normal()).collect()];
    let noise = Columns { time: times(ROWS, STEP), u: vec![levels(64)], x }.record();
    match of_output(&[noise], None, &Options::default()) {
        Ok(found) => assert!(!found.is_sound(), "{:?}", found.findings),
        Err(refusal) => assert_eq!(refusal.cause, Cause::NoModel),
    }
}

#[test]
fn what_is_not_checked_is_reported() {
    let refused = |record: Record, options: &Options| {
        let found = good(identify_with(record, options));
        assert_eq!(kinds(&found), [Kind::NothingHeldOut], "{:?}", found.findings);
        text(&found, Kind::NothingHeldOut).to_owned()
    };
    let expected = "nothing is held out: fewer than 4 consecutive rows of equal steps have all values there, so the model isn't checked";
    assert_eq!(refused(columns(65).record(), &Options { hold_out: 0.003, ..Options::default() }), expected);
    let mut without = columns(65).record();
    without.columns[0].values[560..].fill(f64::NAN);
    assert_eq!(refused(without, &Options::default()), expected);
    let short = Options { hold_out: 0.02, ..Options::default() };
    let found = good(of_output(&[columns(65).record()], None, &short));
    assert!(
        text(&found, Kind::NothingHeldOut).starts_with("nothing is held out: fewer than 24 "),
        "{:?}",
        found.findings
    );
}

#[test]
fn a_state_without_values_in_the_held_out_part_has_no_fit() {
    let mut record = columns(66).record();
    record.columns[2].values[560..].fill(f64::NAN);
    let found = good(identify_with(record, &Options::default()));
    assert!(found.model.fit.held_out[1].is_nan() && found.model.fit.held_out[0] > 95.0, "{:?}", found.model.fit);
    assert_eq!(text(&found, Kind::HeldOutStill), "x2 has no values in the held-out part: its fit isn't judged");
    let text = serde_json::to_string(&found).unwrap();
    let again: Identified = serde_json::from_str(&text).unwrap();
    assert!(again.model.fit.held_out[1].is_nan() && again.ceiling[1].is_nan());
}

#[test]
fn options_without_meaning_for_outputs_are_refused() {
    let record = [columns(67).record()];
    for (options, message) in [
        (
            Options { offsets: false, ..Options::default() },
            "a constant of each output in each record: it can't be left out",
        ),
        (
            Options { longest_window: Some(1.0), ..Options::default() },
            "follow whole records: there is no longest window",
        ),
        (Options { order: Some(11), ..Options::default() }, "order 11: must be within 1 … 10 for this record"),
    ] {
        let (cause, text) = refusal(of_output(&record, None, &options));
        assert!(cause == Cause::Request && text.ends_with(message), "{text}");
    }
}

#[test]
fn short_records_of_outputs_are_refused_with_the_rows_that_are_needed() {
    let short = |rows: usize, order: Option<usize>| {
        let mut columns = columns_of(&plant(), 68, vec![Random(68).levels(rows, 8)]);
        columns.time.truncate(rows);
        of_output(&[columns.record()], None, &Options { order, hold_out: 0.0, ..Options::default() })
    };
    let (cause, error) = refusal(short(30, None));
    assert_eq!(cause, Cause::TooShort);
    assert_eq!(error, "30 rows with equal steps: one state needs at least 40");
    assert_eq!(refusal(short(50, Some(2))).1, "order 2: must be within 1 … 1 for this record; it needs 60 rows");
    assert_eq!(good(short(60, Some(2))).model.A.len(), 2);
    // Where one order is all that there is, it isn't a given one.
    assert!(text(&good(short(50, None)), Kind::Order).starts_with("nothing is held out: order 1 is by BIC"));
}

/// The output of an unstable plant in a closed loop.
fn of_unstable(seed: u64) -> Record {
    let (plant, mut random) = (Plant::new(2, 1, &[0.0, 1.0, 4.0, -0.5], &[0.0, 3.0], &[0.0, 0.0]), Random(seed));
    let (mut u, mut y, mut x) = (Vec::new(), vec![Vec::new(); 1], vec![0.0, 0.0]);
    for level in random.levels(1500, 40) {
        y[0].push(x[0] + 0.002 * random.normal());
        u.push(2.0 * level - 5.0 * x[0] - 2.0 * x[1]);
        let next = plant.simulate(&[0.0, 0.02], &[vec![u[u.len() - 1]; 2]], &x);
        x = next.iter().map(|column| column[1]).collect();
    }
    Columns { time: times(1500, 0.02), u: vec![u], x: y }.record()
}

#[test]
fn a_long_record_of_an_unstable_plant_names_the_pole() {
    let mut refused = 0;
    for seed in 69..73 {
        match of_output(&[of_unstable(seed)], None, &Options { order: Some(2), ..Options::default() }) {
            Ok(found) => assert!(!found.is_sound(), "{:?}", found.findings),
            Err(Refusal { cause, text }) => {
                assert_eq!(cause, Cause::NoModel);
                let expected =
                    " 1/s or more is unstable, over so long a record. Use shorter records, or measure the states";
                assert!(text.ends_with(expected), "{text}");
                refused += 1;
            }
        }
    }
    assert!(refused > 0);
}

#[test]
fn states_of_outputs_have_names_that_controllers_take() {
    let mut record = columns(70).record();
    record.columns[0].name = "x1_1".to_owned();
    let signals = Signals::new(&["x1_1"], &["x1"]);
    let options = Options { order: Some(2), ..Options::default() };
    let found = good(identify_outputs(&[record], None, &signals, &options));
    assert_eq!(found.model.states, ["x1", "x1_1_"]);
}
