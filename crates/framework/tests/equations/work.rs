//! A communication step ends, however much it is asked for: with an error, within its limit of work.

use adaptive_fmu::error::StepError;
use adaptive_fmu::execution::Execution;
use common::described::model;
use common::description;
use common::sample::sampled_names;

/// A chain of so many lags with rates from 1 to 1e6 1/s, each driven by its neighbours, that oscillates at 1e4 rad/s at
/// its end.
fn chain(states: usize) -> String {
    let mut rows = Vec::new();
    for i in 0..states {
        let mut row = vec![0.0; states];
        row[i] = -10_f64.powf(6.0 * i as f64 / states as f64);
        if i > 0 {
            row[i - 1] = 0.3 * row[i].abs();
        }
        if i + 1 < states {
            row[i + 1] = 0.3 * row[i].abs();
        }
        rows.push(row);
    }
    let n = states;
    rows[n - 3][n - 2] = 0.0;
    (rows[n - 1][n - 1], rows[n - 2][n - 2], rows[n - 1][n - 2], rows[n - 2][n - 1]) = (0.0, 0.0, 1e4, -1e4);
    format!(
        "name = 'Chain'\nmodel = 'state-space'\ndescription = ''\n[structure]\nA = {rows:?}\nB = {:?}\nC = [{:?}]\n[start]\n\
         x0 = {:?}\n",
        vec![[0.0]; n],
        vec![1.0; n],
        vec![1.0; n],
    )
}

/// Initialised, or why it can't be.
fn execution(text: &str) -> Execution {
    let mut execution = Execution::new(model(text).unwrap());
    execution.initialise().unwrap();
    execution
}

#[test]
fn a_step_of_two_hundred_states_ends_within_its_work() {
    for method in ["automatic", "explicit", "stiff"] {
        let text = format!("{}integration_method = '{method}'\n", chain(200));
        let start = std::time::Instant::now();
        let error = execution(&text).step(0.0, 1e3).unwrap_err();
        println!("{method}: {:?}, {error}", start.elapsed());
        assert!(matches!(error, StepError::TooMuchWork { .. }), "{method}: {error}");
    }
}

#[test]
fn a_larger_limit_of_work_takes_a_step_further_and_a_smaller_one_less_far() {
    let reached = |limit: f64| {
        let text = format!("{}work_limit = {limit:e}\n", chain(20));
        match execution(&text).step(0.0, 1e3).unwrap_err() {
            StepError::TooMuchWork { time, .. } => time,
            other => panic!("{other}"),
        }
    };
    let times = [1e6, 1e7, 1e8].map(reached);
    assert!(times[0] < 0.5 * times[1] && times[1] < 0.5 * times[2], "{times:?}");
}

#[test]
fn a_step_of_any_unit_with_large_inputs_ends_or_leaves_it_as_it_was() {
    for name in sampled_names() {
        let mut unit = execution(&description(&name));
        let inputs = unit.model().variables().reals(adaptive_fmu::system::Section::Input);
        unit.block_mut().reals[inputs].iter_mut().enumerate().for_each(|(k, u)| *u += 1e3 * (k as f64 - 1.5));
        let before = unit.block().clone();
        // Whether it can be finished or not: without it, the unit is as it was.
        if let Err(error) = unit.step(0.0, 10.0) {
            assert_eq!(unit.block(), &before, "{name}: {error}");
        }
    }
}
