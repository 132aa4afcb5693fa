//! Numbers that judge a run.

use nalgebra::{DMatrix, DVector};

use super::closed_loop::Recording;
use super::ssp::{IdealModel, Metric, Statistic, Structure};
use crate::near;

/// A measured metric.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Measured {
    /// What it is.
    pub label: String,
    /// Its value; none where no time was left to measure in.
    pub value: Option<f64>,
    /// The largest value that is as it should be.
    pub limit: Option<f64>,
}

impl Measured {
    /// Whether it is within its limit; none where there is no limit, or no value yet.
    pub fn holds(&self) -> Option<bool> {
        self.limit.zip(self.value).map(|(limit, value)| value <= limit)
    }
}

/// Adds the ideal models to a recording, then measures.
///
/// # Errors
/// When a metric or a model names a signal that isn't there.
pub fn measure(structure: &Structure, recording: &mut Recording) -> Result<Vec<Measured>, String> {
    let signals = recording.names.len();
    for model in &structure.models {
        let column = simulate(model, recording)?;
        match recording.names.iter().position(|name| *name == model.name) {
            Some(k) if k < signals => return Err(format!("the ideal model `{}` has the name of a signal", model.name)),
            Some(k) => {
                recording.columns[k].iter_mut().zip(column).for_each(|(sum, part)| *sum += part);
                continue;
            }
            None => {}
        }
        recording.names.push(model.name.clone());
        recording.measures.push(String::new());
        recording.columns.push(column);
    }
    structure.metrics.iter().map(|metric| value_of(metric, recording)).collect()
}

fn signal<'a>(recording: &'a Recording, name: &str) -> Result<&'a [f64], String> {
    recording
        .column(name)
        .ok_or_else(|| format!("there is no signal `{name}`; {}", near::choice(name, &recording.names, "")))
}

fn value_of(metric: &Metric, recording: &Recording) -> Result<Measured, String> {
    let of = signal(recording, &metric.of)?;
    let minus = metric.minus.as_ref().map(|name| signal(recording, name)).transpose()?;
    let values = recording.times.iter().enumerate().filter(|(_, time)| **time >= metric.from - 1e-9);
    let start = recording.times.first().copied().unwrap_or_default();
    let size = |time: f64| metric.funnel.map_or(1.0, |funnel| funnel.at(time - start));
    let difference = |(k, time): (usize, &f64)| (of[k] - minus.map_or(0.0, |minus| minus[k])) / size(*time);
    let values: Vec<f64> = values.map(difference).collect();
    let value = match metric.statistic {
        _ if values.is_empty() => None,
        Statistic::Max => {
            Some(values.iter().fold(
                0.0,
                |largest: f64, value| if value.abs() > largest || value.is_nan() { value.abs() } else { largest },
            ))
        }
        Statistic::Rms => Some((values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()),
    };
    Ok(Measured { label: metric.label.clone(), value, limit: metric.limit })
}

/// Response of the model, its input linear between the recorded points: exact but for that, by the exponential of the
/// matrix [A B 0; 0 0 1; 0 0 0] over each step. Beside it runs what is left of an impulse, for the initial state.
fn simulate(model: &IdealModel, recording: &Recording) -> Result<Vec<f64>, String> {
    let input = signal(recording, &model.input)?;
    let n = model.denominator.len() - 1;
    let leading = model.denominator[0];
    // Controllable canonical form, first state the slowest.
    let mut generator = DMatrix::zeros(n + 2, n + 2);
    for i in 0..n - 1 {
        generator[(i, i + 1)] = 1.0;
    }
    for i in 0..n {
        generator[(n - 1, i)] = -model.denominator[n - i] / leading;
    }
    generator[(n - 1, n)] = 1.0 / leading;
    generator[(n, n + 1)] = 1.0;
    let output = |coefficients: &[f64], x: &DVector<f64>| -> f64 {
        coefficients.iter().rev().zip(x.iter()).map(|(b, x)| b * x).sum()
    };
    let (mut state, mut free, mut next) = (DVector::zeros(n + 2), DVector::zeros(n + 2), DVector::zeros(n + 2));
    free[n - 1] = 1.0 / leading;
    let (mut transition, mut step) = (DMatrix::zeros(0, 0), f64::NAN);
    let mut response = vec![output(&model.initial, &free); input.len().min(1)];
    for k in 1..input.len() {
        let h = recording.times[k] - recording.times[k - 1];
        if (h - step).abs() > 1e-9 * h || step.is_nan() {
            (transition, step) = ((&generator * h).exp(), h);
        }
        state[n] = input[k - 1];
        state[n + 1] = (input[k] - input[k - 1]) / h;
        for vector in [&mut state, &mut free] {
            transition.mul_to(vector, &mut next);
            std::mem::swap(vector, &mut next);
        }
        response.push(output(&model.numerator, &state) + output(&model.initial, &free));
    }
    Ok(response)
}

#[cfg(test)]
mod tests {
    use super::super::ssp::PerformanceFunction;
    use super::*;

    fn ramp(step: f64, count: u32) -> Recording {
        let times: Vec<f64> = (0..count).map(|k| f64::from(k) * step).collect();
        Recording { names: vec!["r".into()], columns: vec![times.clone()], times, ..Recording::default() }
    }

    #[test]
    fn an_ideal_model_answers_a_ramp_exactly() {
        let model = IdealModel {
            name: "y".into(),
            input: "r".into(),
            numerator: vec![6.0],
            denominator: vec![2.0, 4.0],
            initial: vec![],
        };
        let recording = ramp(0.1, 50);
        let response = simulate(&model, &recording).unwrap();
        for (y, t) in response.iter().zip(&recording.times) {
            // 3/(s+2) of a ramp: 3/2 (t − (1 − e^(−2t))/2)
            let exact = 1.5 * (t - (1.0 - (-2.0 * t).exp()) / 2.0);
            assert!((y - exact).abs() < 1e-12, "t = {t}: {y}, not {exact}");
        }
    }

    #[test]
    fn a_metric_counts_from_its_time_on() {
        let recording = ramp(1.0, 5);
        let metric = |statistic, from| Metric {
            label: "m".into(),
            statistic,
            of: "r".into(),
            minus: None,
            funnel: None,
            from,
            limit: None,
        };
        assert_eq!(value_of(&metric(Statistic::Max, 0.0), &recording).unwrap().value, Some(4.0));
        assert_eq!(value_of(&metric(Statistic::Rms, 3.0), &recording).unwrap().value, Some(12.5_f64.sqrt()));
        assert_eq!(value_of(&metric(Statistic::Max, 9.0), &recording).unwrap().value, None);
    }

    #[test]
    fn an_ideal_model_starts_where_its_initial_state_is() {
        // (0.5 s + 2)/(s² + 3 s + 2) = 1.5/(s + 1) − 1/(s + 2), without an input.
        let model = IdealModel {
            name: "y".into(),
            input: "r".into(),
            numerator: vec![1.0],
            denominator: vec![1.0, 3.0, 2.0],
            initial: vec![0.5, 2.0],
        };
        let times = vec![0.0, 0.1, 0.3, 0.7];
        let recording =
            Recording { names: vec!["r".into()], columns: vec![vec![0.0; 4]], times, ..Recording::default() };
        for (y, t) in simulate(&model, &recording).unwrap().iter().zip(&recording.times) {
            let exact = 1.5 * (-t).exp() - (-2.0 * t).exp();
            assert!((y - exact).abs() < 1e-14, "t = {t}: {y}, not {exact}");
        }
    }

    #[test]
    fn an_error_is_measured_against_its_funnel() {
        let recording = ramp(1.0, 3);
        let funnel = Some(PerformanceFunction { start: 3.0, end: 1.0, rate: 2.0_f64.ln() });
        let of = || "r".to_owned();
        let metric = Metric {
            label: "m".into(),
            statistic: Statistic::Max,
            of: of(),
            minus: None,
            funnel,
            from: 0.0,
            limit: None,
        };
        // rho = 3, 2, 1.5 at e = 0, 1, 2.
        let value = value_of(&metric, &recording).unwrap().value.unwrap();
        assert!((value - 2.0 / 1.5).abs() < 1e-15, "{value}");
    }
}
