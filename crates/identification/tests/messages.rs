//! Each fault of a record gives its own message, and no other.

mod support;

use adaptive_fmu_identification::{
    Cause, Entry, Kind, Options, Record, Row, Signals, Structure, Verdict, identify_outputs, identify_states,
};
use support::{
    Columns, Plant, ROWS, Random, STEP, columns, columns_of, good, identify, identify_with, kinds, names, noisy,
    record, refusal, signals, text, times,
};

fn two_inputs() -> Plant {
    Plant::new(2, 2, &[-1.0, 0.3, 0.4, -0.7], &[1.0, 0.2, 0.1, 0.8], &[0.1, 0.2])
}

#[test]
fn good_records_have_none() {
    for seed in 1..=6 {
        let found = good(identify(columns(seed).record()));
        assert_eq!(kinds(&found), [], "{:?}", found.findings);
        assert!(found.is_sound());
        let mut random = Random(seed + 50);
        let u = (0..2).map(|_| random.levels(ROWS, 40)).collect();
        let found = good(identify(columns_of(&two_inputs(), seed, u).record()));
        assert_eq!(kinds(&found), [], "{:?}", found.findings);
    }
}

#[test]
fn time_must_grow() {
    let mut columns = columns(1);
    columns.time[500] = columns.time[499];
    let mut record = columns.record();
    record.lines = (2..2 + ROWS).collect();
    let expected = "record: line 502: time = 24.95 after 24.95: must grow".to_owned();
    let (cause, text) = refusal(identify(record));
    assert_eq!(cause, Cause::Time);
    assert_eq!(text.replace("24.950000000000003", "24.95"), expected);
}

#[test]
fn steps_that_differ_are_noted() {
    let (plant, mut random) = (Plant::oscillator(), Random(2));
    let mut time = vec![0.0];
    (0..ROWS - 1).for_each(|k| time.push(time[k] + if k % 4 == 1 { 0.08 } else { 0.04 }));
    let u = vec![random.levels(ROWS, 40)];
    let mut x = plant.simulate(&time, &u, &[0.0, 0.0]);
    noisy(&mut random, &mut x, 0.02);
    let found = good(identify(record(time, &u, &x)));
    assert_eq!(kinds(&found), [Kind::StepsDiffer]);
    assert_eq!(text(&found, Kind::StepsDiffer), "steps differ: 0.04 … 0.08 s");
}

#[test]
fn gaps_and_missing_values_cut_the_record() {
    let mut with_gap = columns(3);
    with_gap.time[300..].iter_mut().for_each(|time| *time += 4.0);
    let found = good(identify(with_gap.record()));
    assert_eq!(kinds(&found), [Kind::Gap]);
    assert!(text(&found, Kind::Gap).starts_with("record: a gap before row 301: steps above 0.15 s"));

    let mut with_hole = columns(3);
    with_hole.u[0][200] = f64::NAN;
    let found = good(identify(with_hole.record()));
    assert_eq!(kinds(&found), [Kind::Gap]);
    assert_eq!(text(&found, Kind::Gap), "record: row 201: values are missing; the record is cut there");

    let mut with_cell = columns(3);
    with_cell.x[1][200] = f64::NAN;
    let found = good(identify(with_cell.record()));
    assert_eq!(kinds(&found), [Kind::MissingCells]);

    let mut twice = columns(3);
    (twice.u[0][200], twice.u[0][203]) = (f64::NAN, f64::NAN);
    let found = good(identify(twice.record()));
    assert_eq!(kinds(&found), [Kind::Gap, Kind::ShortWindow]);
}

#[test]
fn single_wrong_cells_are_left_out() {
    let mut columns = columns(4);
    let mut at = Vec::new();
    for k in 0..10 {
        at.push(20 + 53 * k);
        columns.x[k % 2][20 + 53 * k] += if k % 3 == 0 { 15.0 } else { -15.0 } * if k % 2 == 0 { 0.5 } else { 1.0 };
    }
    let found = good(identify(columns.record()));
    assert_eq!(kinds(&found), [Kind::WrongCells]);
    let mut rows: Vec<usize> = found.wrong_cells.iter().map(|cell| cell.row).collect();
    rows.sort_unstable();
    rows.dedup();
    assert_eq!(rows, at);
    let damping = -found.model.A[1][1] / (2.0 * (-found.model.A[1][0]).sqrt());
    assert!((damping - 0.25).abs() < 0.01, "{damping}");
    assert_eq!(found.findings.iter().find(|finding| finding.kind == Kind::WrongCells).unwrap().verdict, Verdict::Note);
}

#[test]
fn too_few_rows_are_refused() {
    let mut random = Random(5);
    let columns = columns_of(&Plant::oscillator(), 5, vec![random.levels(30, 5)]);
    let (cause, text) = refusal(identify_with(columns.record(), &Options { hold_out: 0.0, ..Options::default() }));
    assert_eq!(cause, Cause::TooShort);
    assert_eq!(
        text,
        "30 rows of 2 states are 60 numbers for 14 unknowns (8, 4 of K, 2 initial): at least 70 are needed, 35 rows"
    );
}

#[test]
fn a_short_record_for_the_slowest_pole_is_a_warning() {
    let plant = Plant::new(2, 1, &[-0.03, 0.5, 0.0, -2.0], &[1.0, 2.0], &[0.0, 0.0]);
    let mut random = Random(6);
    let mut columns = columns_of(&plant, 6, vec![random.levels(ROWS, 30)]);
    columns.x = plant.simulate(&columns.time, &columns.u, &[0.0, 0.0]);
    noisy(&mut random, &mut columns.x, 0.002);
    let found = good(identify(columns.record()));
    assert_eq!(kinds(&found), [Kind::ShortRecord], "{:?}", found.findings);
    assert!(text(&found, Kind::ShortRecord).contains("at least 3 are needed"));
}

#[test]
fn an_input_that_never_moves_is_refused_or_left_out() {
    let mut random = Random(7);
    let u = vec![random.levels(ROWS, 40), vec![12.0; ROWS]];
    let plant = Plant::new(2, 2, &[-1.0, 0.3, 0.4, -0.7], &[1.0, 0.0, 0.1, 0.01], &[0.1, 0.2]);
    let record = columns_of(&plant, 7, u).record();
    let (cause, error) = refusal(identify(record.clone()));
    assert_eq!(cause, Cause::StillInput);
    assert!(error.starts_with("u2 never moves (12 … 12): its effect can't be seen."), "{error}");
    let found = good(identify_with(record, &Options { fixed: vec!["u2".to_owned()], ..Options::default() }));
    assert_eq!(kinds(&found), [Kind::FixedInput]);
    assert_eq!(found.model.inputs, ["u1"]);
}

#[test]
fn the_others_keep_their_delays_where_an_input_is_left_out() {
    let mut random = Random(27);
    let acted = random.levels(ROWS + 3, 40);
    let mut columns = columns_of(&Plant::oscillator(), 27, vec![acted[..ROWS].to_vec()]);
    columns.u = vec![vec![12.0; ROWS], acted[3..].to_vec()];
    let fixed = Options { fixed: vec!["u1".to_owned()], delays: vec![0.0, 0.15], ..Options::default() };
    let found = good(identify_with(columns.record(), &fixed));
    assert_eq!((&found.model.inputs[..], &found.model.delay[..]), (&["u2".to_owned()][..], &[0.15][..]));
    assert_eq!(kinds(&found), [Kind::FixedInput], "{:?}", found.findings);
}

#[test]
fn a_structure_in_which_nothing_is_free_is_refused() {
    let entries = |values: &[f64]| values.iter().map(|value| Entry::Known(*value)).collect::<Vec<_>>();
    let known = |corner: Entry| Structure {
        a: Some(vec![Row::Entries(vec![corner, Entry::Known(1.0)]), Row::Entries(entries(&[-4.0, -1.0]))]),
        b: Some(vec![entries(&[0.0]), entries(&[4.0])]),
        ..Structure::default()
    };
    let options = |corner| Options { structure: known(corner), offsets: false, ..Options::default() };
    let (cause, error) = refusal(identify_with(columns(26).record(), &options(Entry::Known(0.0))));
    let expected = "nothing is left to estimate: make an entry \"?\"";
    assert_eq!((cause, error.as_str()), (Cause::Request, expected));
    // The only unknown ends at the bound of its sign.
    let plant = Plant::new(2, 1, &[-0.2, 1.0, -4.0, -1.0], &[0.0, 4.0], &[0.0, 0.0]);
    let record = columns_of(&plant, 26, vec![Random(26).levels(ROWS, 40)]).record();
    let found = good(identify_with(record, &options(Entry::Positive)));
    assert!(found.entries.is_empty() && text(&found, Kind::EntryAtZero).starts_with("d(x1)/x1 ended at 0"));
}

#[test]
fn inputs_that_move_together_are_refused() {
    let mut random = Random(8);
    let first = random.levels(ROWS, 40);
    let second = first.iter().map(|value| 0.83 * value + 2.0 + 1e-4 * random.normal()).collect();
    let (cause, error) = refusal(identify(columns_of(&two_inputs(), 8, vec![first, second]).record()));
    assert_eq!(cause, Cause::DependentInputs);
    assert!(error.starts_with("u2 = 0.83 u1 + 2 within 0.0"), "{error}");
}

/// A loop with u = −K y, y with noise, and levels added after some row.
fn closed_loop(seed: u64, added: f64) -> Columns {
    let (plant, mut random) = (Plant::new(2, 1, &[0.0, 1.0, 1.0, -0.3], &[0.0, 1.0], &[0.0, 0.2]), Random(seed));
    let (time, levels) = (times(ROWS, STEP), random.levels(ROWS, 40));
    let (mut u, mut y, mut x) = (Vec::new(), vec![Vec::new(); 2], vec![1.0, 0.0]);
    for level in &levels {
        let measured: Vec<f64> = x.iter().map(|value| value + 0.01 * random.normal()).collect();
        u.push(-4.0 * measured[0] - 2.0 * measured[1] + added * level);
        (0..2).for_each(|i| y[i].push(measured[i]));
        let next = plant.simulate(&[0.0, STEP], &[vec![u[u.len() - 1]; 2]], &x);
        x = next.iter().map(|column| column[1]).collect();
    }
    Columns { time, u: vec![u], x: y }
}

#[test]
fn feedback_without_anything_added_is_refused() {
    let (cause, error) = refusal(identify(closed_loop(9, 0.0).record()));
    assert_eq!(cause, Cause::Feedback);
    assert!(error.starts_with("u1 = -4 x1 - 2 x2: a feedback without anything added"), "{error}");
    let found = good(identify(closed_loop(9, 1.0).record()));
    assert_eq!(kinds(&found), []);
    assert_eq!(found.model.method, "innovation form");
}

#[test]
fn an_input_at_its_limit_is_a_warning() {
    let mut random = Random(10);
    let u = random.levels(ROWS, 40).iter().map(|level| level.clamp(-2.0, 0.2)).collect();
    let found = good(identify(columns_of(&Plant::oscillator(), 10, vec![u]).record()));
    assert_eq!(kinds(&found), [Kind::InputAtLimit]);
    assert!(text(&found, Kind::InputAtLimit).starts_with("u1 is at 0.2 in "));
    // Two levels are an experiment, not a limit.
    let u = random.levels(ROWS, 40).iter().map(|level| level.signum()).collect();
    assert_eq!(kinds(&good(identify(columns_of(&Plant::oscillator(), 10, vec![u]).record()))), []);
}

#[test]
fn steps_of_a_sensor_are_noted() {
    let mut columns = columns(11);
    columns.x[0].iter_mut().for_each(|value| *value = (*value / 0.05).round() * 0.05);
    let found = good(identify(columns.record()));
    assert_eq!(kinds(&found), [Kind::Quantised]);
    assert_eq!(text(&found, Kind::Quantised), "x1 has steps of 0.05: at least 0.0144 of its noise is that");
}

#[test]
fn a_known_row_in_other_units_is_found() {
    let structure = Structure { rows: vec!["x1' = x2".to_owned()], ..Structure::default() };
    let options = Options { structure, ..Options::default() };
    assert_eq!(kinds(&good(identify_with(columns(12).record(), &options))), []);
    let mut columns = columns(12);
    columns.x[0].iter_mut().for_each(|angle| *angle = angle.to_degrees());
    let found = identify_with(columns.record(), &options);
    // The model of the wrong structure may be refused, too; the finding comes first.
    let message = match &found {
        Ok(found) => text(found, Kind::WrongRow).to_owned(),
        Err(refusal) => refusal.text.clone(),
    };
    assert!(
        message.starts_with("x1' is 57.3 times what the structure has, x1' = x2: is x1 in other units?"),
        "{message}"
    );
}

#[test]
fn an_input_that_acts_later_is_a_warning_with_the_delay() {
    let mut random = Random(13);
    let acted = random.levels(ROWS + 3, 40);
    let mut columns = columns_of(&Plant::oscillator(), 13, vec![acted[..ROWS].to_vec()]);
    columns.u = vec![acted[3..].to_vec()];
    let record = columns.record();
    let found = good(identify(record.clone()));
    assert_eq!(kinds(&found), [Kind::Delay], "{:?}", found.findings);
    assert!(text(&found, Kind::Delay).ends_with("Try a delay of 0.15 s"), "{}", text(&found, Kind::Delay));
    let with = |delay: f64| good(identify_with(record.clone(), &Options { delays: vec![delay], ..Options::default() }));
    assert_eq!(kinds(&with(0.15)), []);
    // What is given is a part of it.
    assert!(text(&with(0.05), Kind::Delay).ends_with("Try a delay of 0.15 s"), "{:?}", with(0.05).findings);
}

#[test]
fn an_entry_that_is_not_excited_is_not_sound() {
    // Only noise moves the second state, so its effect can't be seen.
    let plant = Plant::new(2, 1, &[-1.0, 0.5, 0.0, -1.5], &[1.0, 0.0], &[0.0, 0.0]);
    let mut random = Random(14);
    let mut columns = columns_of(&plant, 14, vec![random.levels(ROWS, 40)]);
    columns.x[1] = (0..ROWS).map(|_| 1e-3 * random.normal()).collect();
    let found = good(identify(columns.record()));
    let unseen = found.findings.iter().find(|finding| finding.kind == Kind::Unseen).expect("an unseen entry");
    assert_eq!(unseen.verdict, Verdict::NotSound);
    assert!(!found.is_sound() && unseen.text.contains("this record doesn't show it"), "{}", unseen.text);
}

#[test]
fn a_missing_state_is_refused() {
    let plant = Plant::new(3, 1, &[0.0, 1.0, 0.0, -9.0, -0.2, 4.0, 0.0, 0.0, -0.3], &[0.0, 0.0, 1.0], &[0.0; 3]);
    let mut random = Random(15);
    let mut columns = columns_of(&plant, 15, vec![random.levels(ROWS, 40)]);
    columns.x = vec![columns.x[1].clone()];
    let (cause, error) = refusal(identify(columns.record()));
    assert_eq!(cause, Cause::NoModel);
    assert!(error.starts_with("no model of these states follows the record (best: "), "{error}");
    assert!(error.ends_with("is a state missing?"), "{error}");
}

#[test]
fn a_plant_that_changes_in_the_held_out_part_is_not_sound() {
    let mut random = Random(16);
    let u = vec![random.levels(ROWS, 40)];
    let mut columns = columns_of(&Plant::oscillator(), 16, u.clone());
    let other = Plant::new(2, 1, &[0.0, 1.0, -4.0, -1.0], &[0.0, -1.0], &[0.0, 0.3]);
    let changed = columns_of(&other, 16, u);
    (0..2).for_each(|i| columns.x[i][560..].copy_from_slice(&changed.x[i][560..]));
    let found = good(identify(columns.record()));
    assert_eq!(kinds(&found), [Kind::HeldOutFit], "{:?}", found.findings);
    assert!(!found.is_sound());
}

#[test]
fn a_held_out_part_that_rests_is_not_judged() {
    let mut random = Random(17);
    let mut level = random.levels(ROWS, 40);
    level[400..].fill(0.1);
    let found = good(identify(columns_of(&Plant::oscillator(), 17, vec![level]).record()));
    assert_eq!(kinds(&found), [Kind::HeldOutStill]);
    assert!(found.is_sound());
}

#[test]
fn an_entry_whose_sign_the_record_contradicts_ends_at_0_and_is_named() {
    let row = |entries: [Entry; 2]| Row::Entries(entries.to_vec());
    let structure = Structure {
        a: Some(vec![row([Entry::Negative, Entry::Free]), row([Entry::Free, Entry::Free])]),
        ..Structure::default()
    };
    let plant = Plant::new(2, 1, &[0.05, 1.0, -4.0, -1.0], &[0.0, 4.0], &[0.0, 0.3]);
    let mut random = Random(18);
    let record = columns_of(&plant, 18, vec![random.levels(ROWS, 40)]).record();
    let found = good(identify_with(record, &Options { structure, ..Options::default() }));
    assert_eq!(found.model.A[0][0], 0.0);
    assert_eq!(text(&found, Kind::EntryAtZero), "d(x1)/x1 ended at 0, the bound of its sign, and counts as known");
    assert_eq!(found.entries.len(), 7);
}

#[test]
fn names_and_options_that_do_not_fit_are_refused() {
    let record = columns(19).record();
    let refused = |signals: Signals, options: &Options| {
        let refusal = identify_states(std::slice::from_ref(&record), None, &signals, options).unwrap_err();
        assert_eq!(refusal.cause, Cause::Request);
        refusal.text
    };
    let options = Options::default();
    assert_eq!(refused(Signals::new(&["u"], &["x1"]), &options), "record has no column `u`; there are: u1, x1, x2");
    assert_eq!(refused(Signals::new(&["u1"], &["u1"]), &options), "`u1` is given twice");
    assert!(refused(Signals::new(&[], &["x1"]), &options).starts_with("a model needs at least one input"));
    assert!(refused(signals(1, 2), &Options { hold_out: 1.0, ..options.clone() }).starts_with("1 of each record"));
    assert!(refused(signals(1, 2), &Options { fixed: names("v", 1), ..options }).starts_with("`v1` is no input"));
}

#[test]
fn wrong_cells_of_the_held_out_part_do_not_spoil_its_fit() {
    let mut columns = columns(20);
    columns.x[0][600] += 20.0;
    columns.x[1][700] -= 20.0;
    let found = good(identify(columns.record()));
    assert_eq!(kinds(&found), [Kind::WrongCells]);
    let message = text(&found, Kind::WrongCells);
    assert!(message.starts_with("record: row 601, 701: wrong cells"), "{message}");
    assert!(found.model.fit.held_out.iter().all(|fit| *fit > 97.0), "{:?}", found.model.fit);
}

#[test]
fn wrong_cells_of_outputs_are_left_out() {
    let mut columns = columns(21);
    columns.x.pop();
    for row in [100, 333, 620] {
        columns.x[0][row] += 10.0;
    }
    let record = columns.record();
    let found = good(identify_outputs(&[record], None, &signals(1, 1), &Options::default()));
    assert_eq!(found.wrong_cells.iter().map(|cell| cell.row).collect::<Vec<_>>(), [100, 333]);
    assert!(found.model.fit.held_out[0] > 97.0 && found.is_sound(), "{:?}", found.findings);
    assert_eq!(found.model.states, ["x1", "x1_1"]);
}

#[test]
fn records_that_are_held_out_as_a_whole_are_another_test() {
    let found =
        identify_states(&[columns(22).record()], Some(&[columns(23).record()]), &signals(1, 2), &Options::default());
    let found = good(found);
    assert_eq!(kinds(&found), []);
    assert!(found.model.fit.held_out.iter().all(|fit| *fit > 97.0), "{:?}", found.model.fit);
    let none = good(identify_with(columns(22).record(), &Options { hold_out: 0.0, ..Options::default() }));
    assert!(none.model.fit.held_out.is_empty() && none.ceiling.is_empty());
}

#[test]
fn odd_records_are_refused() {
    let refused = |change: &dyn Fn(&mut Record)| {
        let mut record = columns(24).record();
        change(&mut record);
        refusal(identify(record))
    };
    let rows = |count: usize| {
        move |record: &mut Record| {
            record.time.truncate(count);
            record.columns.iter_mut().for_each(|column| column.values.truncate(count));
        }
    };
    for count in 0..30 {
        assert_eq!(refused(&rows(count)).0, Cause::TooShort, "{count}");
    }
    let (cause, error) = refused(&|record| record.columns[1].values[7] = f64::INFINITY);
    assert_eq!((cause, error.as_str()), (Cause::Request, "record: row 8: x1 = inf: must be finite or NaN"));
    assert_eq!(refused(&|record| record.columns[0].values.fill(f64::NAN)).0, Cause::TooShort);
    assert_eq!(refused(&|record| record.columns[0].values.truncate(3)).0, Cause::Request);
    assert_eq!(refused(&|record| record.time[3] = f64::NAN).0, Cause::Time);
    let (cause, error) = refused(&|record| record.columns[1].values.fill(5.0));
    let expected = "x1 never moves (5 … 5): there is nothing to model. Leave it out, or excite it";
    assert_eq!((cause, error.as_str()), (Cause::StillState, expected));
}
