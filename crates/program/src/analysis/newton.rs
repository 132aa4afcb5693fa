//! Newton's method for any number of equations in any number of unknowns, which may have bounds. Each step is the
//! shortest one that solves the linear equations best.

#[cfg(test)]
mod tests;

use std::cmp::Ordering;

use fastrand::Rng;
use nalgebra::{DMatrix, DVector};

const STEPS: usize = 100;
/// Further starts if a search from the start values finds nothing.
const NEW_STARTS: usize = 5;
/// Largest distance of a new start from the first one, in parts of an unknown's scale.
const AWAY: f64 = 0.1;
const SEED: u64 = 1;
/// Largest residual of a solution, relative to its equation's scale.
const TOLERANCE: f64 = 1e-10;
/// Singular values below this part of the largest count as zero.
const RANK: f64 = 1e-9;
/// A step is never shortened below this part in the line search.
const SHORTEST: f64 = 1e-6;
/// A step must lessen the sum of squares by at least this part of its slope.
const LESSENED: f64 = 1e-4;
/// A step whose slope is below this part of the sum of squares doesn't lessen it: the minimum is reached.
const NO_SLOPE: f64 = 1e-14;
/// An equation's scale never falls below this part of its largest one, or rounding would be taken for a residual.
const LEAST_SCALE: f64 = 1e-3;
/// An unknown is at its bound within this part of its scale.
const AT_BOUND: f64 = 1e-9;
/// An unknown can move if a combination of unknowns that changes no equation has more of it than this.
const MOVABLE: f64 = 1e-6;

/// Equations r(z) = 0.
pub(super) trait Equations {
    /// Reason why they have no residuals somewhere.
    type Error;

    /// Residuals at the unknowns, which an event may change.
    fn residuals(&mut self, unknowns: &mut DVector<f64>) -> Result<DVector<f64>, Self::Error>;

    /// Derivatives of the residuals by the unknowns, where the residuals were last computed.
    fn jacobian(&mut self) -> Result<DMatrix<f64>, Self::Error>;

    /// True if the search may go on with other unknowns after this error.
    fn may_go_on(&self, error: &Self::Error) -> bool;
}

/// An unknown.
#[derive(Debug, Clone, Copy)]
pub(super) struct Unknown {
    /// Usual magnitude: its scale, unless its value is larger.
    pub usual: f64,
    /// Longest change in one step.
    pub longest: f64,
    /// Smallest and largest value.
    pub bounds: (f64, f64),
    /// True if new starts change it.
    pub starts_anew: bool,
}

/// The end of a search.
#[derive(Debug, Clone)]
pub(super) struct End {
    /// True if all equations hold there.
    pub is_solution: bool,
    pub unknowns: DVector<f64>,
    pub residuals: DVector<f64>,
    /// Derivatives of the residuals by the unknowns.
    pub jacobian: DMatrix<f64>,
    /// Residuals relative to their equations' scales.
    pub relative: DVector<f64>,
    /// Number of Newton steps.
    pub steps: usize,
    /// Number of new starts.
    pub new_starts: usize,
    /// Rank of the Jacobian.
    pub rank: usize,
    /// True for each unknown that can change while all equations still hold.
    pub can_move: Vec<bool>,
    /// The bound of each unknown that is at one: `Less` for the smallest value, `Greater` for the largest.
    pub at_bound: Vec<Option<Ordering>>,
}

impl Unknown {
    fn scale(&self, value: f64) -> f64 {
        value.abs().max(self.usual)
    }

    fn within(&self, value: f64) -> f64 {
        let (least, most) = self.bounds;
        value.min(most).max(least)
    }

    /// The bound that a value has reached.
    fn bound(&self, value: f64) -> Option<Ordering> {
        let near = AT_BOUND * self.scale(value);
        let (least, most) = self.bounds;
        match () {
            () if value - least <= near => Some(Ordering::Less),
            () if most - value <= near => Some(Ordering::Greater),
            () => None,
        }
    }

    /// Length of a step from a bound to values beyond it; 0 for other steps.
    fn outward(&self, value: f64, step: f64) -> f64 {
        let near = AT_BOUND * self.scale(value);
        let (least, most) = self.bounds;
        let is_outward = step < 0.0 && value - least <= near || step > 0.0 && most - value <= near;
        if is_outward { step.abs() } else { 0.0 }
    }

    /// Part of a step within its longest length and its bound.
    fn part(&self, value: f64, step: f64) -> f64 {
        let (least, most) = self.bounds;
        let room = if step < 0.0 { value - least } else { most - value };
        if step == 0.0 { 1.0 } else { (self.longest.min(room) / step.abs()).min(1.0) }
    }
}

/// Searches from a start, and from some others near it if that finds no solution. Returns the solution, otherwise the
/// end with the least residuals.
///
/// # Errors
/// When the equations have no residuals at the start.
pub(super) fn solve<E: Equations>(
    equations: &mut E,
    unknowns: &[Unknown],
    start: &DVector<f64>,
) -> Result<End, E::Error> {
    let mut search = Search { equations, unknowns, largest: DVector::zeros(0) };
    let mut best = search.from(start.clone())?;
    let mut random = Rng::with_seed(SEED);
    // If nothing can move, each start ends as the first.
    let starts = if unknowns.iter().any(|unknown| unknown.starts_anew) { NEW_STARTS } else { 0 };
    for new_starts in 1..=starts {
        if best.is_solution {
            break;
        }
        let near = DVector::from_fn(start.len(), |k, _| {
            let away = AWAY * unknowns[k].scale(start[k]) * (2.0 * random.f64() - 1.0);
            if unknowns[k].starts_anew { start[k] + away } else { start[k] }
        });
        match search.from(near) {
            Ok(end) if end.is_solution || end.relative.norm() < best.relative.norm() => best = end,
            Err(error) if !search.equations.may_go_on(&error) => return Err(error),
            _ => {}
        }
        best.new_starts = new_starts;
    }
    Ok(best)
}

struct Search<'a, E> {
    equations: &'a mut E,
    unknowns: &'a [Unknown],
    /// Largest scale that each equation has had.
    largest: DVector<f64>,
}

/// Unknowns, and residuals there.
type Next = (DVector<f64>, DVector<f64>);

/// The equations about some values of the unknowns.
struct Local<'a> {
    unknowns: &'a [Unknown],
    values: DVector<f64>,
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    /// Scales of the unknowns.
    columns: DVector<f64>,
    /// Scales of the equations.
    rows: DVector<f64>,
}

impl<'a, E: Equations> Search<'a, E> {
    fn from(&mut self, start: DVector<f64>) -> Result<End, E::Error> {
        let mut values = start.map_with_location(|k, _, value| self.unknowns[k].within(value));
        let mut residuals = self.equations.residuals(&mut values)?;
        let mut steps = 0;
        loop {
            let local = self.local(values, residuals)?;
            let goes_on = steps < STEPS && local.is_finite() && !local.is_solution();
            match if goes_on { self.along(&local)? } else { None } {
                Some(next) => (values, residuals, steps) = (next.0, next.1, steps + 1),
                None => return Ok(local.end(steps)),
            }
        }
    }

    fn local(&mut self, values: DVector<f64>, residuals: DVector<f64>) -> Result<Local<'a>, E::Error> {
        let jacobian = self.equations.jacobian()?;
        let unknowns = self.unknowns;
        let columns = values.map_with_location(|k, _, value| unknowns[k].scale(value));
        let sizes = DVector::from_fn(residuals.len(), |row, _| {
            jacobian.row(row).iter().zip(&columns).map(|(entry, scale)| (entry * scale).abs()).fold(0.0, f64::max)
        });
        self.largest = if self.largest.is_empty() { sizes.clone() } else { self.largest.sup(&sizes) };
        let rows = sizes.zip_map(
            &self.largest,
            |size, largest| {
                if largest > 0.0 { size.max(LEAST_SCALE * largest) } else { 1.0 }
            },
        );
        Ok(Local { unknowns, values, residuals, jacobian, columns, rows })
    }

    /// Unknowns along the step that lessen the residuals, with these: after the whole step, or a part of it.
    fn along(&mut self, local: &Local) -> Result<Option<Next>, E::Error> {
        let step = local.step();
        let longest = local.part(&step);
        let (before, slope) = (local.relative(&local.residuals).norm_squared(), local.slope(&step) * longest);
        let mut part = if slope > NO_SLOPE * longest * before { 1.0 } else { 0.0 };
        while part >= SHORTEST {
            let mut next = local.moved(&step, part * longest);
            match self.equations.residuals(&mut next) {
                Ok(residuals) if local.relative(&residuals).norm_squared() <= before - LESSENED * part * slope => {
                    return Ok(Some((next, residuals)));
                }
                Err(error) if !self.equations.may_go_on(&error) => return Err(error),
                _ => part *= 0.5,
            }
        }
        Ok(None)
    }
}

impl Local<'_> {
    fn is_finite(&self) -> bool {
        self.residuals.iter().chain(&self.jacobian).all(|value| value.is_finite())
    }

    fn relative(&self, residuals: &DVector<f64>) -> DVector<f64> {
        residuals.component_div(&self.rows)
    }

    fn is_solution(&self) -> bool {
        self.relative(&self.residuals).iter().all(|residual| residual.abs() <= TOLERANCE)
    }

    fn scaled_jacobian(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.rows.len(), self.columns.len(), |row, column| {
            self.jacobian[(row, column)] * self.columns[column] / self.rows[row]
        })
    }

    /// Rate of decrease of the sum of squares of relative residuals along a step: twice that sum if the linear
    /// equations have a solution.
    fn slope(&self, step: &DVector<f64>) -> f64 {
        -2.0 * self.relative(&self.residuals).dot(&self.relative(&(&self.jacobian * step)))
    }

    fn at_bound(&self) -> Vec<Option<Ordering>> {
        self.unknowns.iter().zip(&self.values).map(|(unknown, value)| unknown.bound(*value)).collect()
    }

    /// Newton step in which no unknown goes beyond its bound: one that would stays where it is, and the step is
    /// computed without it.
    fn step(&self) -> DVector<f64> {
        let mut jacobian = self.scaled_jacobian();
        let mut stays = vec![false; self.unknowns.len()];
        loop {
            let step = least_squares(&jacobian, &-self.relative(&self.residuals));
            let outward = |k: usize| self.unknowns[k].outward(self.values[k], step[k]);
            let first = (0..stays.len()).filter(|&k| !stays[k] && outward(k) > 0.0);
            let Some(first) = first.max_by(|&one, &other| outward(one).total_cmp(&outward(other))) else {
                let moves = |k: usize| if stays[k] { 0.0 } else { step[k] * self.columns[k] };
                return DVector::from_fn(step.len(), |k, _| moves(k));
            };
            stays[first] = true;
            jacobian.column_mut(first).fill(0.0);
        }
    }

    /// Part of a step that respects each unknown's longest step and bounds.
    fn part(&self, step: &DVector<f64>) -> f64 {
        let parts = self.unknowns.iter().enumerate().map(|(k, unknown)| unknown.part(self.values[k], step[k]));
        parts.fold(1.0, f64::min)
    }

    fn moved(&self, step: &DVector<f64>, part: f64) -> DVector<f64> {
        DVector::from_fn(step.len(), |k, _| self.unknowns[k].within(self.values[k] + part * step[k]))
    }

    fn end(self, steps: usize) -> End {
        let (rank, can_move) = rank(&self.scaled_jacobian());
        End {
            is_solution: self.is_finite() && self.is_solution(),
            relative: self.relative(&self.residuals),
            at_bound: self.at_bound(),
            unknowns: self.values,
            residuals: self.residuals,
            jacobian: self.jacobian,
            steps,
            new_starts: 0,
            rank,
            can_move,
        }
    }
}

/// The shortest of the vectors x for which A x is nearest to b.
fn least_squares(a: &DMatrix<f64>, b: &DVector<f64>) -> DVector<f64> {
    let nothing = || DVector::zeros(a.ncols());
    if a.is_empty() {
        return nothing();
    }
    let singular = a.clone().svd(true, true);
    let smallest = RANK * singular.singular_values.max();
    // This never fails: both matrices were asked for, and the threshold is not negative.
    singular.solve(b, smallest).unwrap_or_else(|_| nothing())
}

/// The rank of a matrix, and the unknowns in combinations that it maps to zero.
fn rank(matrix: &DMatrix<f64>) -> (usize, Vec<bool>) {
    if matrix.is_empty() || !matrix.iter().all(|entry| entry.is_finite()) {
        return (0, vec![true; matrix.ncols()]);
    }
    let singular = matrix.clone().svd(false, true);
    let smallest = RANK * singular.singular_values.max();
    let directions: Vec<_> = singular.v_t.iter().flat_map(|rows| rows.row_iter()).collect();
    let used = || directions.iter().zip(&singular.singular_values).filter(|(_, value)| **value > smallest);
    // Remainder of each unit vector without the directions that the matrix distinguishes.
    let left = |k: usize| 1.0 - used().map(|(direction, _)| direction[k].powi(2)).sum::<f64>();
    (used().count(), (0..matrix.ncols()).map(|k| left(k).max(0.0).sqrt() > MOVABLE).collect())
}
