//! Steps of the reference in a nominal loop.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{DMatrix, DVector};

use super::controller::Controller;
use super::nominal::Nominal;

/// Points of a step.
const POINTS: usize = 4000;
/// Length of a step response, in times of that rate.
const TIMES: f64 = 8.0;
/// A step has settled within this part of its height.
const SETTLED: f64 = 0.02;

/// Response to a step of one reference.
#[derive(Debug, Clone)]
pub struct Step {
    /// Overshoot of its output, in parts of the step.
    pub overshoot: f64,
    /// Time from which its output stays within 2 % of the step, in 1/W; `None` if it doesn't within the time.
    pub settling: Option<f64>,
    /// The lowest and the highest value of each control, for a step of 1.
    pub control: Vec<[f64; 2]>,
}

/// Entry of the reference into a controller: x' += B r, u += D r.
#[derive(Debug)]
pub struct Entry {
    /// Rates of the controller's states, k × m.
    pub B: DMatrix<f64>,
    /// Direct part in the controls, m × m.
    pub D: DMatrix<f64>,
}

/// The step of one reference in a loop that is over at this rate, in W; `None` where numbers are too large for it.
pub fn step(plant: &Nominal, controller: &Controller, entry: &Entry, i: usize, rate: f64) -> Option<Step> {
    let (n, k) = (plant.A.nrows(), controller.A.nrows());
    let M = controller.closed(&plant.A, &plant.B, &plant.C);
    let h = TIMES / rate / POINTS as f64;
    let mut whole = DMatrix::zeros(n + k + 1, n + k + 1);
    whole.view_mut((0, 0), (n + k, n + k)).copy_from(&M);
    whole.view_mut((0, n + k), (n, 1)).copy_from(&(&plant.B * entry.D.column(i)));
    whole.view_mut((n, n + k), (k, 1)).copy_from(&entry.B.column(i));
    let over_h = exponential(whole * h)?;
    // u of the state and the reference.
    let mut of_u = DMatrix::zeros(plant.channels(), n + k + 1);
    of_u.view_mut((0, 0), (plant.channels(), n)).copy_from(&(-(&controller.D * &plant.C)));
    of_u.view_mut((0, n), (plant.channels(), k)).copy_from(&(-&controller.C));
    of_u.column_mut(n + k).copy_from(&entry.D.column(i));
    let mut state = DVector::zeros(n + k + 1);
    state[n + k] = 1.0;
    let mut control = vec![[0.0_f64; 2]; plant.channels()];
    let mut look = |state: &DVector<f64>| {
        for ([lowest, highest], &u) in control.iter_mut().zip((&of_u * state).iter()) {
            (*lowest, *highest) = (lowest.min(u), highest.max(u));
        }
    };
    look(&state);
    let (mut highest, mut settled) = (0.0, Some(0.0));
    for point in 1..=POINTS {
        state = &over_h * state;
        look(&state);
        let y = plant.C.row(i).transpose().dot(&state.rows(0, n));
        highest = f64::max(highest, y);
        match ((y - 1.0).abs() <= SETTLED, settled) {
            (true, None) => settled = Some(point as f64 * h),
            (false, _) => settled = None,
            _ => {}
        }
    }
    Some(Step { overshoot: highest - 1.0, settling: settled, control })
}

/// The matrix exponential; `None` where its sixth power, which is needed, isn't finite.
pub fn exponential(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size = matrix.norm();
    (size <= 1e50).then(|| matrix.exp())
}
