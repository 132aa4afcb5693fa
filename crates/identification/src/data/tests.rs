use super::*;

fn record(time: Vec<f64>, u: Vec<f64>, x: Vec<f64>, v: Vec<f64>) -> Record {
    Record::new("record", time, vec![("u".to_owned(), u), ("x".to_owned(), x), ("v".to_owned(), v)])
}

fn signals() -> Signals {
    Signals::new(&["u"], &["x", "v"])
}

fn ramp(count: usize) -> Vec<f64> {
    (0..count).map(|k| k as f64).collect()
}

fn data(record: Record) -> (Data, Vec<Finding>) {
    let records = [record];
    let part = records.iter().map(|record| 0..record.len()).collect();
    let mut findings = Vec::new();
    let source = Source::new(&records, &signals(), &Options::default(), 4).unwrap();
    (source.data(&part, None, Some(&mut findings)).unwrap(), findings)
}

#[test]
fn a_record_is_cut_at_gaps_and_where_values_are_missing() {
    let mut time = ramp(40);
    time[20..].iter_mut().for_each(|time| *time += 10.0);
    let (mut u, mut x, mut v) = (ramp(40), ramp(40), ramp(40));
    u[10] = f64::NAN;
    (x[30], v[30]) = (f64::NAN, f64::NAN);
    x[33] = f64::NAN;
    u[37] = f64::NAN;
    let (data, findings) = data(record(time, u, x, v));
    let segments: Vec<_> = data.segments.iter().map(|segment| (segment.first, segment.len())).collect();
    assert_eq!(segments, [(0, 10), (11, 9), (20, 10), (31, 6)]);
    assert_eq!(data.segments[3].mask[(0, 2)], 0.0);
    assert_eq!(data.segments[3].mask.sum(), 11.0);
    let texts: Vec<_> = findings.iter().map(|finding| finding.text.as_str()).collect();
    assert_eq!(
        texts,
        [
            "record: a gap before row 21: steps above 3 s; the record is cut there",
            "record: row 11, 31, 38: values are missing; the record is cut there",
            "record: row 34: some states are missing; their weight is 0 there",
            "record: row 39, 40: fewer than 4 rows between two cuts are left out",
        ]
    );
}

#[test]
fn signals_are_scaled_and_time_is_in_samples_of_the_commonest_step() {
    let mut time = vec![0.0];
    for k in 0..30 {
        time.push(time[k] + if k % 3 == 0 { 0.04 } else { 0.02 });
    }
    let values: Vec<f64> = (0..31).map(|k| 5.0 + 3.0 * (k as f64).sin()).collect();
    let (data, findings) = data(record(time, values.clone(), values.clone(), values.clone()));
    assert!((data.scaling.h - 0.02).abs() < 1e-15);
    assert_eq!(data.steps.lengths.len(), 2);
    assert!((data.steps.lengths[1] - 2.0).abs() < 1e-12);
    assert_eq!(data.segments[0].step[..4], [1, 0, 0, 1]);
    assert!((data.segments[0].y[(0, 3)] * standard_deviation(values.iter().copied()) - values[3]).abs() < 1e-12);
    assert_eq!(findings[0].text, "steps differ: 0.02 … 0.04 s");
}

#[test]
fn many_steps_are_near_64_of_them() {
    let mut time = vec![0.0];
    for k in 0..300 {
        time.push(time[k] + 0.1 * (1.0 + 0.3 * (k as f64 * 0.7).sin()));
    }
    let (data, _) = data(record(time.clone(), ramp(301), ramp(301), ramp(301)));
    assert!(data.steps.lengths.len() <= 65);
    let segment = &data.segments[0];
    for k in 0..300 {
        let length = (data.steps.lengths[segment.step[k]] + segment.rest[k]) * data.scaling.h;
        assert!((length - (time[k + 1] - time[k])).abs() < 5e-6 * length);
        assert!(segment.rest[k].abs() < 0.01);
    }
}

#[test]
fn an_input_with_a_delay_is_the_value_before() {
    let late = |hold| delayed(&[0.0, 1.0, 2.0, 3.0], &[5.0, 6.0, 7.0, 8.0], 1.5, hold);
    assert!(late(Hold::ZeroOrder)[..2].iter().all(|value| value.is_nan()));
    assert_eq!(late(Hold::ZeroOrder)[2..], [5.0, 6.0]);
    assert_eq!(late(Hold::FirstOrder)[2..], [5.5, 6.5]);
    // Seconds since 1970 have steps that are rounded.
    let time: Vec<f64> = (0..9).map(|k| 1.7e9 + 0.02 * f64::from(k)).collect();
    assert_eq!(delayed(&time, &ramp(9), 0.06, Hold::ZeroOrder)[3..], ramp(6));
    // 30 rows a second, in ms.
    let time: Vec<f64> = (0..9).map(|k| (1e3 / 30.0 * f64::from(k)).round() / 1e3).collect();
    assert_eq!(delayed(&time, &ramp(9), 0.1, Hold::ZeroOrder)[3..], ramp(6));
}

#[test]
fn times_that_do_not_grow_are_refused_with_their_line() {
    let mut wrong = record(vec![0.0, 3.2, 3.2], ramp(3), ramp(3), ramp(3));
    wrong.lines = vec![2, 3, 812];
    let records = [wrong];
    let refusal = Source::new(&records, &signals(), &Options::default(), 4).err().unwrap();
    assert_eq!(
        (refusal.cause, refusal.text.as_str()),
        (Cause::Time, "record: line 812: time = 3.2 after 3.2: must grow")
    );
}
