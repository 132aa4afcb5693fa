//! Records without noise give the plant again.

mod support;

use adaptive_fmu_identification::{Entry, Hold, Options, Record, Row, Structure, identify_outputs, identify_states};
use nalgebra::DMatrix;
use support::{Plant, Random, good, names, record, signals, times};

/// The largest difference of an entry, relative to the matrix in units of the signals.
fn difference(found: &[Vec<f64>], true_: &DMatrix<f64>, rows: &[f64], columns: &[f64]) -> f64 {
    let scaled = |value: f64, i: usize, j: usize| value * columns[j] / rows[i];
    let (mut most, mut largest): (f64, f64) = (0.0, 0.0);
    for i in 0..true_.nrows() {
        for j in 0..true_.ncols() {
            most = most.max((scaled(found[i][j], i, j) - scaled(true_[(i, j)], i, j)).abs());
            largest = largest.max(scaled(true_[(i, j)], i, j).abs());
        }
    }
    most / largest
}

fn deviations(columns: &[Vec<f64>]) -> Vec<f64> {
    let of = |column: &Vec<f64>| {
        let mean = column.iter().sum::<f64>() / column.len() as f64;
        (column.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / column.len() as f64).sqrt()
    };
    columns.iter().map(of).collect()
}

fn check(plant: &Plant, records: &[Record], options: &Options) {
    let (n, m) = plant.b.shape();
    let found = good(identify_states(records, None, &signals(m, n), options));
    let columns = |letter: &str, count: usize| -> Vec<Vec<f64>> {
        names(letter, count).iter().map(|name| records[0].column(name).unwrap().values.clone()).collect()
    };
    let (x, u) = (deviations(&columns("x", n)), deviations(&columns("u", m)));
    let of_a = difference(&found.model.A, &plant.a, &x, &x);
    let of_b = difference(&found.model.B, &plant.b, &x, &u);
    assert!(of_a < 1e-8 && of_b < 1e-8, "n = {n}: A {of_a:e}, B {of_b:e}");
}

#[test]
fn one_to_six_states() {
    for n in 1..=6 {
        let mut random = Random(n as u64);
        let m = 1 + n / 4;
        let plant = Plant::random(&mut random, n, m);
        let time = times(400, 0.1);
        let u: Vec<_> = (0..m).map(|_| random.levels(400, 16)).collect();
        let x = plant.simulate(&time, &u, &vec![0.1; n]);
        check(&plant, &[record(time, &u, &x)], &Options::default());
    }
}

#[test]
fn several_steps_and_a_gap() {
    let mut random = Random(7);
    let plant = Plant::random(&mut random, 3, 1);
    let mut time = vec![0.0];
    for k in 0..499 {
        let step = [0.1, 0.1, 0.05, 0.1, 0.15][k % 5] + if k == 250 { 3.0 } else { 0.0 };
        time.push(time[k] + step);
    }
    let u = [random.levels(500, 16)];
    let x = plant.simulate(&time, &u, &[0.1, 0.2, 0.3]);
    check(&plant, &[record(time, &u, &x)], &Options::default());
}

#[test]
fn more_distinct_steps_than_there_are_exponentials_of() {
    let mut random = Random(17);
    let plant = Plant::random(&mut random, 3, 1);
    let mut time = vec![0.0];
    (0..399).for_each(|k| time.push(time[k] + random.uniform(0.08, 0.12)));
    let u = [random.levels(400, 16)];
    let x = plant.simulate(&time, &u, &[0.1, 0.2, 0.3]);
    check(&plant, &[record(time, &u, &x)], &Options::default());
}

#[test]
fn two_records_with_different_constants_and_missing_cells() {
    let mut random = Random(9);
    let plant = Plant::random(&mut random, 4, 2);
    let other = Plant { d: &plant.d * -3.0, ..plant.clone() };
    let records: Vec<Record> = [&plant, &other]
        .into_iter()
        .map(|plant| {
            let time = times(300, 0.1);
            let u: Vec<_> = (0..2).map(|_| random.levels(300, 16)).collect();
            let mut x = plant.simulate(&time, &u, &[0.0; 4]);
            x[1][40] = f64::NAN;
            x[2][90] = f64::NAN;
            record(time, &u, &x)
        })
        .collect();
    check(&plant, &records, &Options::default());
}

#[test]
fn inputs_that_are_linear_between_rows() {
    let mut random = Random(11);
    let plant = Plant::random(&mut random, 2, 1);
    // Ramps are simulated as a further state that integrates the slope.
    let extended = Plant::new(
        3,
        1,
        &[plant.a[(0, 0)], plant.a[(0, 1)], plant.b[0], plant.a[(1, 0)], plant.a[(1, 1)], plant.b[1], 0.0, 0.0, 0.0],
        &[0.0, 0.0, 1.0],
        &[plant.d[0], plant.d[1], 0.0],
    );
    let time = times(400, 0.1);
    let slopes = [random.levels(400, 12)];
    let mut x = extended.simulate(&time, &slopes, &[0.1, 0.2, 0.0]);
    let u = [x.pop().unwrap()];
    check(&plant, &[record(time, &u, &x)], &Options { hold: Hold::FirstOrder, ..Options::default() });
}

#[test]
fn known_entries_stay_as_they_are() {
    let plant = Plant::oscillator();
    let mut random = Random(12);
    let time = times(400, 0.05);
    let u = [random.levels(400, 30)];
    let x = plant.simulate(&time, &u, &[0.0, 0.0]);
    let structure = Structure {
        a: Some(vec![Row::Words("x1' = x2".to_owned()), Row::Entries(vec![Entry::Negative, Entry::Negative])]),
        ..Structure::default()
    };
    let options = Options { structure, ..Options::default() };
    let records = [record(time, &u, &x)];
    check(&plant, &records, &options);
    let found = good(identify_states(&records, None, &signals(1, 2), &options));
    assert_eq!(found.model.A[0], [0.0, 1.0]);
    assert_eq!(found.entries.len(), 4);
}

#[test]
fn outputs_alone_give_the_poles_and_the_gain() {
    for (n, m, p) in [(1, 1, 2), (2, 1, 1), (3, 2, 1), (3, 1, 2), (4, 2, 2)] {
        let mut random = Random(20 + n as u64);
        let plant = Plant::random(&mut random, n, m);
        let time = times(700, 0.1);
        let u: Vec<_> = (0..m).map(|_| random.levels(700, 16)).collect();
        let x = plant.simulate(&time, &u, &vec![0.1; n]);
        let c = DMatrix::from_fn(p, n, |i, j| {
            random.uniform(0.5, 1.0) / x[j][300].abs().max(0.1) * if i == j { 2.0 } else { -1.0 }
        });
        let y: Vec<Vec<f64>> = (0..p)
            .map(|i| (0..700).map(|k| 5.0 + (0..n).map(|j| c[(i, j)] * x[j][k]).sum::<f64>()).collect())
            .collect();
        let options = Options { order: Some(n), ..Options::default() };
        let found = good(identify_outputs(&[record(time, &u, &y)], None, &signals(m, p), &options));
        eprintln!(
            "{:?} {:?} {:?} {:?} {:?}",
            found.model.fit, found.model.noise, found.orders, found.model.kappa, found.poles
        );
        let matrix = |rows: &[Vec<f64>]| DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j]);
        let (a, b) = (matrix(&found.model.A), matrix(&found.model.B));
        let outputs = DMatrix::from_fn(p, n, |i, j| found.model.C[i][j]);
        // What doesn't depend on the states' coordinates: C A^k B.
        for k in 0..2 * n {
            let (mut one, mut other) = (b.clone(), plant.b.clone());
            (0..k).for_each(|_| (one, other) = (&a * &one, &plant.a * &other));
            let (one, other) = (&outputs * one, &c * other);
            assert!((&one - &other).amax() < 1e-5 * other.amax().max(1.0), "n = {n}, k = {k}: {one} {other}");
        }
    }
}

#[test]
fn a_long_record_of_outputs_is_as_good_as_a_short_one() {
    let (plant, mut random) = (Plant::oscillator(), Random(26));
    let time = times(9000, 0.1);
    let u = [random.levels(9000, 16)];
    let x = plant.simulate(&time, &u, &[0.1, 0.2]);
    let options = Options { order: Some(2), ..Options::default() };
    let found = good(identify_outputs(&[record(time, &u, &x[..1])], None, &signals(1, 1), &options));
    for (entry, true_) in found.model.A[1].iter().zip([-4.0, -1.0]) {
        assert!((entry - true_).abs() < 1e-8, "{entry}");
    }
}
