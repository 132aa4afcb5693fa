//! Continuous models from measured outputs, in observable companion form: the states are each output and its derivatives, without
//! those of the inputs.

use nalgebra::DMatrix;

use super::subspace::Discrete;
use crate::data::{Data, Observed, Scaling};
use crate::linear::continuous;
use crate::structure::{Entries, Entry};

/// Rows of the observability matrix that depend on those before to this degree aren't taken.
const DEPENDENT: f64 = 1e-6;

/// A model in companion form, time in samples, signals scaled.
#[derive(Debug, Clone)]
pub(crate) struct Companion {
    pub a: DMatrix<f64>,
    pub b: DMatrix<f64>,
    /// Outputs of the states.
    pub c: DMatrix<f64>,
    /// Output and order of its derivative of each state.
    pub states: Vec<(usize, usize)>,
}

impl Companion {
    /// The companion form of a sampled model.
    pub fn new(model: &Discrete) -> Option<Self> {
        let (a, b) = continuous(&model.f, &model.g)?;
        let n = a.nrows();
        let states = states(&a, &model.c)?;
        let mut transformation = DMatrix::zeros(n, n);
        for (row, (output, order)) in states.iter().enumerate() {
            let mut derivative = model.c.row(*output).into_owned();
            (0..*order).for_each(|_| derivative = &derivative * &a);
            transformation.row_mut(row).copy_from(&derivative);
        }
        let inverse = transformation.clone().try_inverse()?;
        let (mut a, b) = (&transformation * a * &inverse, &transformation * b);
        let mut c = &model.c * inverse;
        // What is 0 or 1 by construction.
        for (row, (output, order)) in states.iter().enumerate() {
            if let Some(next) = states.iter().position(|state| *state == (*output, order + 1)) {
                a.row_mut(row).fill(0.0);
                a[(row, next)] = 1.0;
            }
            if *order == 0 {
                c.row_mut(*output).fill(0.0);
                c[(*output, row)] = 1.0;
            }
        }
        let is_finite = a.iter().chain(b.iter()).chain(c.iter()).all(|entry| entry.is_finite());
        is_finite.then_some(Companion { a, b, c, states })
    }

    /// True for a state whose derivative is the next state.
    fn is_chain(&self, row: usize) -> bool {
        let (output, order) = self.states[row];
        self.states.contains(&(output, order + 1))
    }

    /// Its structure, in units of the data.
    pub fn entries(&self) -> Entries {
        let (n, m) = self.b.shape();
        let row = |i: usize| {
            let next = |j: usize| self.states[j] == (self.states[i].0, self.states[i].1 + 1);
            let known = |j: usize| Entry::Known(f64::from(next(j)));
            (0..n).map(|j| if self.is_chain(i) { known(j) } else { Entry::Free }).collect()
        };
        Entries { a: (0..n).map(row).collect(), b: vec![vec![Entry::Free; m]; n], d: vec![Entry::Known(0.0); n] }
    }

    /// Units in which states are estimated: derivatives over powers of a frequency of the model.
    pub fn scaling(&self, outputs: &Scaling, frequency: f64) -> Scaling {
        let x =
            self.states.iter().map(|(output, order)| outputs.x[*output] * (frequency / outputs.h).powi(*order as i32));
        Scaling { x: x.collect(), u: outputs.u.clone(), h: outputs.h }
    }

    /// Data in which its states show in the outputs.
    pub fn data(&self, outputs: &Data, scaling: &Scaling) -> Data {
        let (p, n) = self.c.shape();
        // From states in units of scaled outputs and samples.
        let size =
            |j: usize| scaling.x[j] / outputs.scaling.x[self.states[j].0] * scaling.h.powi(self.states[j].1 as i32);
        let c = DMatrix::from_fn(p, n, |i, j| self.c[(i, j)] * size(j));
        Data { observed: Some(Observed { c, scaling: scaling.clone(), has_constants: true }), ..outputs.clone() }
    }

    /// Outputs of the states in units of the data.
    pub fn outputs(&self, data: &Data) -> DMatrix<f64> {
        let (p, n) = self.c.shape();
        let Scaling { x, h, .. } = &data.scaling;
        DMatrix::from_fn(p, n, |i, j| {
            let (output, order) = self.states[j];
            self.c[(i, j)] * x[i] / x[output] * h.powi(order as i32)
        })
    }
}

/// The states of a companion form, by output: of the derivatives of all outputs in growing order, those that don't depend on
/// ones before.
fn states(a: &DMatrix<f64>, c: &DMatrix<f64>) -> Option<Vec<(usize, usize)>> {
    let (n, p) = (a.nrows(), c.nrows());
    let size = a.norm().max(f64::MIN_POSITIVE);
    let mut rows: Vec<_> = c.row_iter().map(|row| row.into_owned()).collect();
    let mut is_open = vec![true; p];
    let mut basis: Vec<nalgebra::RowDVector<f64>> = Vec::new();
    let mut states = Vec::new();
    for order in 0..n {
        for output in 0..p {
            if !is_open[output] || states.len() == n {
                continue;
            }
            let whole = rows[output].norm();
            let mut rest = rows[output].clone();
            for _ in 0..2 {
                for direction in &basis {
                    let part = rest.dot(direction);
                    rest -= direction * part;
                }
            }
            if rest.norm() > DEPENDENT * whole {
                basis.push(&rest / rest.norm());
                states.push((output, order));
            } else {
                is_open[output] = false;
            }
        }
        rows.iter_mut().for_each(|row| *row = &*row * a / size);
    }
    states.sort_unstable();
    (states.len() == n).then_some(states)
}
