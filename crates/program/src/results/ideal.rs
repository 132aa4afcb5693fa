//! Ideal models of a loop: responses that its outputs should follow, simulated along with its recording.

use nalgebra::{DMatrix, DVector};

use crate::simulation::{Recording, place};
use crate::structure::IdealModel;

/// The ideal models of a loop, for one part of a run after the other.
#[derive(Debug)]
pub(super) struct Ideals {
    /// Number of signals of the loop itself.
    signals: usize,
    ideals: Vec<Ideal>,
}

#[derive(Debug)]
struct Ideal {
    input: usize,
    /// Its column; if another model has the same, their responses are added.
    column: usize,
    response: Response,
}

impl Ideals {
    /// Returns the ideal models for a recording, which gets their names.
    ///
    /// # Errors
    /// If one names a signal that isn't there, or has the name of one.
    pub fn new(models: &[IdealModel], recording: &mut Recording) -> Result<Self, String> {
        let (signals, mut ideals, mut names) = (recording.names.len(), Vec::new(), recording.names.clone());
        for model in models {
            let input = place(&names, &model.input)?;
            let column = names.iter().position(|name| *name == model.name).unwrap_or(names.len());
            if column < signals {
                return Err(format!(
                    "the ideal model `{}` has the same name as a signal. Rename the ideal model",
                    model.name
                ));
            }
            if column == names.len() {
                names.push(model.name.clone());
            }
            ideals.push(Ideal { input, column, response: Response::new(model) });
        }
        recording.measures.resize(recording.measures.len() + names.len() - signals, String::new());
        recording.names = names;
        Ok(Ideals { signals, ideals })
    }

    /// Adds their columns to further points.
    pub fn add(&mut self, points: &mut Recording) {
        points.columns.truncate(self.signals);
        for Ideal { input, column, response } in &mut self.ideals {
            let further = points.times.iter().zip(&points.columns[*input]);
            let further: Vec<f64> = further.map(|(time, input)| response.next(*time, *input)).collect();
            match points.columns.get_mut(*column) {
                Some(sums) => sums.iter_mut().zip(further).for_each(|(sum, part)| *sum += part),
                None => points.columns.push(further),
            }
        }
    }
}

/// Response of a model to an input that is linear between the recorded points. It is exact for such an input, by the
/// exponential of the matrix [A B 0; 0 0 1; 0 0 0] over each step. The impulse response is added for the initial
/// state.
#[derive(Debug)]
struct Response {
    numerator: Vec<f64>,
    initial: Vec<f64>,
    generator: DMatrix<f64>,
    /// Its exponential over a step of this length.
    transition: DMatrix<f64>,
    step: f64,
    state: DVector<f64>,
    free: DVector<f64>,
    /// Workspace for the next vector.
    spare: DVector<f64>,
    /// Time and input of the last point.
    last: Option<(f64, f64)>,
}

impl Response {
    fn new(model: &IdealModel) -> Self {
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
        let mut free = DVector::zeros(n + 2);
        free[n - 1] = 1.0 / leading;
        Response {
            numerator: model.numerator.clone(),
            initial: model.initial.clone(),
            generator,
            transition: DMatrix::zeros(0, 0),
            step: f64::NAN,
            state: DVector::zeros(n + 2),
            free,
            spare: DVector::zeros(n + 2),
            last: None,
        }
    }

    /// The response at the next point.
    fn next(&mut self, time: f64, input: f64) -> f64 {
        let Some((before, last)) = self.last.replace((time, input)) else { return output(&self.initial, &self.free) };
        let h = time - before;
        if (h - self.step).abs() > 1e-9 * h || self.step.is_nan() {
            (self.transition, self.step) = ((&self.generator * h).exp(), h);
        }
        let n = self.state.len() - 2;
        self.state[n] = last;
        self.state[n + 1] = (input - last) / h;
        for vector in [&mut self.state, &mut self.free] {
            self.transition.mul_to(vector, &mut self.spare);
            std::mem::swap(vector, &mut self.spare);
        }
        output(&self.numerator, &self.state) + output(&self.initial, &self.free)
    }
}

/// The output from its coefficients, highest power first.
fn output(coefficients: &[f64], state: &DVector<f64>) -> f64 {
    coefficients.iter().rev().zip(state.iter()).map(|(b, x)| b * x).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(step: f64, count: u32) -> Recording {
        let times: Vec<f64> = (0..count).map(|k| f64::from(k) * step).collect();
        Recording { names: vec!["r".into()], columns: vec![times.clone()], times, ..Recording::default() }
    }

    fn simulate(model: &IdealModel, recording: &Recording) -> Vec<f64> {
        let mut response = Response::new(model);
        recording.times.iter().zip(&recording.columns[0]).map(|(time, input)| response.next(*time, *input)).collect()
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
        let response = simulate(&model, &recording);
        for (y, t) in response.iter().zip(&recording.times) {
            // 3/(s+2) of a ramp: 3/2 (t − (1 − e^(−2t))/2)
            let exact = 1.5 * (t - (1.0 - (-2.0 * t).exp()) / 2.0);
            assert!((y - exact).abs() < 1e-12, "t = {t}: {y}, not {exact}");
        }
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
        for (y, t) in simulate(&model, &recording).iter().zip(&recording.times) {
            let exact = 1.5 * (-t).exp() - (-2.0 * t).exp();
            assert!((y - exact).abs() < 1e-14, "t = {t}: {y}, not {exact}");
        }
    }
}
