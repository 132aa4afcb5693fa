//! Records as they come: large means, records that are short or have steps of their own, clocks that are rounded, delays.

mod support;

use adaptive_fmu_identification::{
    Cause, Entry, Free, Identified, Kind, Options, Record, Row, Structure, Verdict, identify_states,
};
use nalgebra::DMatrix;
use support::{
    Columns, Plant, ROWS, Random, STEP, columns, columns_of, good, identify, identify_with, kinds, noisy, of_output,
    refusal, signals, text, times,
};

fn matrix(rows: &[Vec<f64>]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

/// The same record with constants added to its signals.
fn moved(mut columns: Columns, by: [f64; 3]) -> Record {
    let all = columns.u.iter_mut().chain(&mut columns.x);
    all.zip(by).for_each(|(column, by)| column.iter_mut().for_each(|value| *value += by));
    columns.record()
}

#[test]
fn large_means_do_not_matter() {
    let structure =
        |rows: &[&str]| Structure { rows: rows.iter().map(|row| (*row).to_owned()).collect(), ..Structure::default() };
    // With kinematics only the position may be anywhere.
    for (rows, by) in [(&[][..], [1e5, -3e6, 2e6]), (&["x1' = x2"][..], [1e5, -3e6, 0.0])] {
        let options = Options { structure: structure(rows), ..Options::default() };
        let [plain, moved] = [[0.0; 3], by].map(|by| good(identify_with(moved(columns(30), by), &options)));
        assert!(moved.is_sound() && kinds(&moved).is_empty(), "{:?}", moved.findings);
        assert!((moved.condition / plain.condition - 1.0).abs() < 1e-3, "{} {}", moved.condition, plain.condition);
        let [of_plain, of_moved] = [&plain, &moved].map(|found| (matrix(&found.model.A), matrix(&found.model.B)));
        assert!((&of_plain.0 - &of_moved.0).amax() < 1e-5 && (&of_plain.1 - &of_moved.1).amax() < 1e-5);
        // d of signals as they are: x' = A (x − c) + B (u − c_u) + d.
        let expected = DMatrix::from_column_slice(2, 1, &plain.model.offset[0])
            - &of_moved.0 * DMatrix::from_column_slice(2, 1, &by[1..])
            - &of_moved.1 * by[0];
        let off = (DMatrix::from_column_slice(2, 1, &moved.model.offset[0]) - &expected).amax();
        assert!(off < 1e-9 * expected.amax() + 1e-4, "{off} {expected}");
        let is_constant = |found: &Identified, k: usize| found.entries[k].entry.0 == "d";
        for k in (0..plain.entries.len()).filter(|k| !is_constant(&plain, *k)) {
            let [one, other] = [&plain, &moved].map(|found| found.entries[k].error / found.entries[k].kappa);
            assert!((other / one - 1.0).abs() < 0.01, "{k}: {one} {other}");
        }
    }
}

#[test]
fn the_uncertainty_of_a_constant_contains_that_of_the_mean() {
    let found = good(identify(moved(columns(31), [0.0, 1000.0, 0.0])));
    let variance = |k: usize| found.model.covariance[k][k];
    let place = |matrix: &str, i: usize, j: usize| {
        let is = |Free(of, row, column): &Free| of == matrix && (*row, *column) == (i, j);
        found.model.free.iter().position(is).unwrap()
    };
    for row in [1, 2] {
        // Far away from the mean, the error of d is 1000 times that of the entry which the signal has.
        let ratio = variance(place("d", row, 1)) / variance(place("A", row, 1)) / 1e6;
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }
}

#[test]
fn records_without_rows_enough_are_left_out_and_others_have_gaps_of_their_own() {
    let part = |seed: u64, rows: usize| {
        let mut columns = columns(seed);
        columns.time.truncate(rows);
        columns.u.iter_mut().chain(&mut columns.x).for_each(|column| column.truncate(rows));
        columns
    };
    let named = |name: &str, columns: Columns| Record { name: name.to_owned(), ..columns.record() };
    let (plant, mut random) = (Plant::oscillator(), Random(34));
    let (time, u) = (times(60, 10.0 * STEP), vec![random.levels(60, 6)]);
    let mut x = plant.simulate(&time, &u, &[0.0, 0.0]);
    noisy(&mut random, &mut x, 0.01);
    let records = [named("first", part(32, ROWS)), named("tiny", part(33, 3)), named("slow", Columns { time, u, x })];
    let found = good(identify_states(&records, None, &signals(1, 2), &Options::default()));
    assert!(found.is_sound(), "{:?}", found.findings);
    assert_eq!(kinds(&found), [Kind::LeftOut, Kind::StepsDiffer]);
    assert_eq!(text(&found, Kind::LeftOut), "tiny is left out: it has 3 rows, and at least 4 are needed");
    let listed: Vec<_> = found.model.records.iter().map(|record| record.file.as_str()).collect();
    assert_eq!(listed, ["first", "slow"]);
    assert_eq!(found.model.offset.len(), 2);
    // A sampled model has one step.
    let found = good(of_output(&records, None, &Options { order: Some(2), ..Options::default() }));
    assert_eq!(
        found.findings.iter().filter(|finding| finding.kind == Kind::LeftOut).count(),
        2,
        "{:?}",
        found.findings
    );
    assert_eq!(found.model.records.len(), 1);
}

#[test]
fn a_delay_between_rows_acts_from_the_next_row_on() {
    let found = good(identify_with(columns(35).record(), &Options { delays: vec![0.004], ..Options::default() }));
    let expected = "the delay of u1, 0.004 s, isn't a multiple of the step 0.05 s: it acts as 0.05 s";
    assert_eq!(text(&found, Kind::Delay), expected);
    assert!((found.model.delay[0] / STEP - 1.0).abs() < 1e-12);
    // Steps that differ have none that it could be a multiple of.
    let mut random = Random(35);
    let mut record = columns(35).record();
    record.time.iter_mut().for_each(|time| *time += STEP * random.uniform(-0.3, 0.3));
    let found = good(identify_with(record, &Options { delays: vec![0.004], ..Options::default() }));
    assert_eq!((text(&found, Kind::Delay), &found.model.delay[..]), ("", &[0.004][..]));
    for (delay, message) in [
        (100.0, "record: a delay of 100 s leaves fewer than 4 rows of its 40 s"),
        (-1.0, "delay = -1: must be a finite number, at least 0"),
    ] {
        let result = identify_with(columns(35).record(), &Options { delays: vec![delay], ..Options::default() });
        assert_eq!(refusal(result).1, message);
    }
}

#[test]
fn a_delay_of_a_part_of_a_step_is_no_longer_one() {
    let mut warned = 0;
    for seed in 36..42 {
        // Rows of a fifth of a step, of which each fifth one is recorded.
        let mut random = Random(seed);
        let levels: Vec<f64> = random.levels(ROWS, 40).into_iter().flat_map(|level| [level; 5]).collect();
        let plant = Plant::new(2, 1, &[-2.0, 1.0, -3.0, -4.0], &[0.0, 5.0], &[0.0, 0.0]);
        let x = plant.simulate(&times(5 * ROWS, STEP / 5.0), std::slice::from_ref(&levels), &[0.0, 0.0]);
        let each_fifth =
            |column: &[f64], first: usize| column.iter().skip(first).step_by(5).copied().collect::<Vec<_>>();
        let mut x: Vec<_> = x.iter().map(|column| each_fifth(column, 4)).collect();
        noisy(&mut random, &mut x, 0.002);
        let columns = Columns { time: times(ROWS, STEP), u: vec![each_fifth(&levels, 5)], x };
        let mut record = columns.record();
        record.columns[0].values.push(0.0);
        let found = good(identify(record));
        warned += usize::from(!text(&found, Kind::Delay).is_empty());
        assert!(!text(&found, Kind::Delay).contains("Try"), "{}", text(&found, Kind::Delay));
    }
    assert!(warned > 0);
}

#[test]
fn the_disturbance_is_the_same_in_tiny_units() {
    let plant = Plant::new(2, 2, &[-1.0, 0.3, 0.4, -0.7], &[1.0, 0.2, 0.1, 0.8], &[0.1, 0.2]);
    let mut random = Random(43);
    let u: Vec<_> = (0..2).map(|_| random.levels(ROWS, 40)).collect();
    let found = |factor: f64| {
        let mut columns = columns_of(&plant, 43, u.clone());
        columns.u[0].iter_mut().for_each(|value| *value *= factor);
        good(identify(columns.record())).model.disturbance
    };
    let (plain, scaled) = (found(1.0), found(1e14));
    assert!((scaled[0] / 1e14 / plain[0] - 1.0).abs() < 1e-3, "{scaled:?} {plain:?}");
    assert!((scaled[1] / plain[1] - 1.0).abs() < 1e-3, "{scaled:?} {plain:?}");
}

#[test]
fn outputs_need_steps_that_are_alike_not_exact() {
    let plant = Plant::oscillator();
    let step = 1.0 / 30.0;
    let mut random = Random(44);
    let u = vec![random.levels(ROWS, 40)];
    let mut x = plant.simulate(&times(ROWS, step), &u, &[0.0, 0.0]);
    noisy(&mut random, &mut x, 0.005);
    let clocks: [&mut dyn FnMut(f64) -> f64; 3] =
        [&mut |time| (time * 1e4).round() / 1e4, &mut |time| time + 1.7e9, &mut |time| {
            time + random.uniform(-0.002, 0.002) * step
        }];
    for clock in clocks {
        let time = times(ROWS, step).into_iter().map(clock).collect();
        let record = Columns { time, u: u.clone(), x: vec![x[0].clone()] }.record();
        let found = good(of_output(&[record], None, &Options { order: Some(2), ..Options::default() }));
        assert!((found.model.sample_time / step - 1.0).abs() < 1e-4, "{}", found.model.sample_time);
        let [damping, stiffness] = [-found.model.A[1][1], -found.model.A[1][0]];
        assert!((damping - 1.0).abs() < 0.05 && (stiffness / 4.0 - 1.0).abs() < 0.02, "{damping} {stiffness}");
        assert!(found.is_sound(), "{:?}", found.findings);
    }
    let mut time = vec![0.0];
    (1..ROWS).for_each(|k| time.push(time[k - 1] + step * random.uniform(0.5, 1.5)));
    let (cause, error) = refusal(of_output(&[Columns { time, u, x }.record()], None, &Options::default()));
    assert_eq!(cause, Cause::TooShort);
    assert!(error.starts_with("the steps differ (0.0") && error.contains("Resample the records"), "{error}");
}

#[test]
fn a_double_integrator_is_sound() {
    let plant = Plant::new(2, 1, &[0.0, 1.0, 0.0, 0.0], &[0.0, 1.0], &[0.0, 0.0]);
    for seed in 45..49 {
        let found = good(identify(columns_of(&plant, seed, vec![Random(seed).levels(ROWS, 40)]).record()));
        assert!(found.is_sound(), "{:?}", found.findings);
    }
}

#[test]
fn signals_without_values_and_inputs_that_are_constant_in_each_record_are_named() {
    let nan = |place: usize| {
        let mut record = columns(50).record();
        record.columns[place].values.fill(f64::NAN);
        refusal(identify(record)).1
    };
    assert_eq!(nan(0), "record: u1 has no values");
    assert_eq!(nan(2), "x2 has no values");
    let at = |level: f64| columns_of(&Plant::oscillator(), 51, vec![vec![level; ROWS]]).record();
    let (cause, error) = refusal(identify_states(&[at(1.0), at(3.0)], None, &signals(1, 2), &Options::default()));
    assert_eq!(cause, Cause::StillInput);
    assert!(
        error.starts_with("u1 is constant in each record, as the record's constant is: leave the constant out"),
        "{error}"
    );
}

#[test]
fn a_known_row_that_is_wrong_without_a_factor_of_units_is_a_warning() {
    let row = |entries: [f64; 2]| Row::Entries(entries.map(Entry::Known).to_vec());
    let structure = Structure {
        a: Some(vec![row([-3.0, 1.5]), Row::Entries(vec![Entry::Free; 2])]),
        b: Some(vec![vec![Entry::Known(0.0)], vec![Entry::Free]]),
        ..Structure::default()
    };
    let plant = Plant::new(2, 1, &[-2.0, 1.0, -3.0, -4.0], &[0.0, 5.0], &[0.0, 0.0]);
    let record = columns_of(&plant, 52, vec![Random(52).levels(ROWS, 40)]).record();
    let found = good(identify_with(record, &Options { structure, ..Options::default() }));
    let finding = found.findings.iter().find(|finding| finding.kind == Kind::WrongRow).expect("a finding");
    assert_eq!(finding.verdict, Verdict::Warning);
    let message = &finding.text;
    assert!(message.starts_with("row 1 of the structure isn't what the record shows: d(x1)/x1 = -"), "{message}");
    assert!(message.contains(" for -3, d(x1)/x2 = ") && message.ends_with(" for 1.5"), "{message}");
}
