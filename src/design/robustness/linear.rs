//! Linear laws, and the loops that they close about a plant.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::respond::{Course, step};
use super::uncertain::Uncertain;
use crate::design::controller::Controller;
use crate::design::nominal::{PADE, PADE_COEFFICIENTS};
use crate::design::step::{Entry, exponential};

/// Steps of dead time at most that are looked at.
const MOST_LATE: f64 = 64.0;

/// A linear law in the coordinates of an uncertain plant.
pub trait LinearLaw {
    /// The loop with time running on.
    fn parts(&self) -> Parts;

    /// The loop sampled with a step H in which the plant's state and the control are constant to each other, and one step of
    /// dead time in addition to the plant's. `None` where the numbers are too large, or the dead time is too long.
    fn sampled(&self, plant: &Uncertain, A_t: &DMatrix<f64>, B_t: &DMatrix<f64>, H: f64) -> Option<DMatrix<f64>>;
}

/// Steps until a control acts, of a plant with a dead time: one, and those of the dead time. `None` beyond what is looked at.
pub fn late(delay: f64, H: f64) -> Option<usize> {
    let late = 1.0 + (delay / H - 1e-9).ceil().max(0.0);
    (late <= MOST_LATE).then_some(late as usize)
}

/// A loop: the rate of its state q is `own q + entry (A_t x + B_t u) + reference r` with `u = control q + direct r`, where x,
/// the state of the plant, is the first part of q.
#[derive(Debug, Clone)]
pub struct Parts {
    /// N × N, without the plant's own rate.
    pub own: DMatrix<f64>,
    /// N × n.
    pub entry: DMatrix<f64>,
    /// m × N.
    pub control: DMatrix<f64>,
    /// N × m.
    pub reference: DMatrix<f64>,
    /// m × m.
    pub direct: DMatrix<f64>,
}

impl Parts {
    /// The loop of a plant.
    pub fn closed(&self, A_t: &DMatrix<f64>, B_t: &DMatrix<f64>) -> DMatrix<f64> {
        let n = A_t.nrows();
        let mut rate = B_t * &self.control;
        let mut of_x = rate.columns_mut(0, n);
        of_x += A_t;
        &self.own + &self.entry * rate
    }

    /// Entry of the references.
    pub fn driven(&self, B_t: &DMatrix<f64>) -> DMatrix<f64> {
        &self.reference + &self.entry * B_t * &self.direct
    }

    /// With dead times of the controls, each by Padé's approximation, which has gain 1 everywhere.
    #[must_use]
    pub fn delayed(&self, delays: &[f64]) -> Self {
        let [denominator, difference] = PADE_COEFFICIENTS;
        let late: Vec<_> = (0..delays.len()).filter(|&j| delays[j] > 0.0).collect();
        let (N, more, m) = (self.own.nrows(), PADE * late.len(), self.control.nrows());
        let grown = N + more;
        let mut all = Parts {
            own: self.own.clone().resize(grown, grown, 0.0),
            entry: self.entry.clone().resize_vertically(grown, 0.0),
            control: self.control.clone().resize_horizontally(grown, 0.0),
            reference: self.reference.clone().resize_vertically(grown, 0.0),
            direct: self.direct.clone(),
        };
        for (place, &j) in late.iter().enumerate() {
            let (first, tau) = (N + PADE * place, delays[j]);
            for k in 0..PADE {
                all.own[(first + PADE - 1, first + k)] = -denominator[k] / tau;
                all.control[(j, first + k)] = difference[k];
                if k + 1 < PADE {
                    all.own[(first + k, first + k + 1)] = 1.0 / tau;
                }
            }
            let last = first + PADE - 1;
            (0..N).for_each(|k| all.own[(last, k)] = self.control[(j, k)] / tau);
            (0..m).for_each(|i| all.reference[(last, i)] = self.direct[(j, i)] / tau);
        }
        all
    }

    /// With references in parts of these sizes.
    #[must_use]
    pub fn for_references(mut self, sizes: &[f64]) -> Self {
        self.reference.column_iter_mut().zip(sizes).for_each(|(mut column, size)| column *= *size);
        self.direct.column_iter_mut().zip(sizes).for_each(|(mut column, size)| column *= *size);
        self
    }

    /// The steps of all references of a plant: for each, the courses of all outputs, and of all controls before dead times,
    /// settled within a band. `None` where the loop isn't stable.
    pub fn steps(
        &self,
        [A_t, B_t]: &[DMatrix<f64>; 2],
        C: &DMatrix<f64>,
        asked: &Parts,
        band: f64,
    ) -> Option<Vec<Vec<Course>>> {
        let ((m, N), p) = (self.control.shape(), C.nrows());
        let (closed, driven) = (self.closed(A_t, B_t), self.driven(B_t));
        let mut signals = DMatrix::zeros(p + m, N);
        signals.view_mut((0, 0), C.shape()).copy_from(C);
        signals.view_mut((p, 0), asked.control.shape()).copy_from(&asked.control);
        let one = |i: usize| {
            let mut direct = DVector::zeros(p + m);
            direct.rows_mut(p, m).copy_from(&asked.direct.column(i));
            step(&closed, &driven.column(i).into_owned(), &signals, &direct, band)
        };
        (0..driven.ncols()).map(one).collect()
    }
}

/// Feedback of the outputs by a linear controller, which the references enter.
#[derive(Debug)]
pub struct OutputFeedback {
    /// With time in 1/W.
    pub controller: Controller,
    /// Entry of the references.
    pub entry: Entry,
    /// Output matrix of the plant.
    pub C: DMatrix<f64>,
}

impl LinearLaw for OutputFeedback {
    fn parts(&self) -> Parts {
        let Controller { A, B, C, D } = &self.controller;
        let (n, k, m) = (self.C.ncols(), A.nrows(), C.nrows());
        let mut parts = Parts {
            own: DMatrix::zeros(n + k, n + k),
            entry: DMatrix::zeros(n + k, n),
            control: DMatrix::zeros(m, n + k),
            reference: DMatrix::zeros(n + k, self.entry.B.ncols()),
            direct: self.entry.D.clone(),
        };
        parts.entry.view_mut((0, 0), (n, n)).fill_with_identity();
        parts.control.view_mut((0, 0), (m, n)).copy_from(&-(D * &self.C));
        // Proportional control has no states.
        if k > 0 {
            parts.own.view_mut((n, 0), (k, n)).copy_from(&(B * &self.C));
            parts.own.view_mut((n, n), (k, k)).copy_from(A);
            parts.control.view_mut((0, n), (m, k)).copy_from(&-C);
            parts.reference.rows_mut(n, k).copy_from(&self.entry.B);
        }
        parts
    }

    fn sampled(&self, plant: &Uncertain, A_t: &DMatrix<f64>, B_t: &DMatrix<f64>, H: f64) -> Option<DMatrix<f64>> {
        let Controller { A, B, C, D } = &self.controller;
        let (n, k, m) = (self.C.ncols(), A.nrows(), C.nrows());
        let registers = late(plant.delay, H)? * m;
        let of_plant = zero_order_hold(A_t, B_t, H)?;
        let (N, waiting) = (n + k + registers, n + k);
        let mut step = DMatrix::zeros(N, N);
        step.view_mut((0, 0), (n, n)).copy_from(&of_plant[0]);
        step.view_mut((0, waiting), (n, m)).copy_from(&of_plant[1]);
        (0..registers - m).for_each(|k| step[(waiting + k, waiting + k + m)] = 1.0);
        if k > 0 {
            let of_law = zero_order_hold(A, B, H)?;
            step.view_mut((n, 0), (k, n)).copy_from(&(&of_law[1] * &self.C));
            step.view_mut((n, n), (k, k)).copy_from(&of_law[0]);
            // At the end of the step, of what was measured at its beginning.
            let u = -(C * step.rows(n, k));
            step.rows_mut(N - m, m).copy_from(&u);
        }
        let mut of_x = step.view_mut((N - m, 0), (m, n));
        of_x -= D * &self.C;
        Some(step)
    }
}

/// e^(A H), and ∫ e^(A s) ds B from 0 to H.
pub fn zero_order_hold(A: &DMatrix<f64>, B: &DMatrix<f64>, H: f64) -> Option<[DMatrix<f64>; 2]> {
    let (n, m) = B.shape();
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(&(A * H));
    whole.view_mut((0, n), (n, m)).copy_from(&(B * H));
    let whole = exponential(whole)?;
    Some([whole.view((0, 0), (n, n)).into_owned(), whole.view((0, n), (n, m)).into_owned()])
}
