//! The linear system behind experiments: the sampled one by least squares, and the continuous one that it samples.

use nalgebra::{Complex, DMatrix, DVector};

use crate::eigenvalues::complex;
use crate::mathematics::logarithm::logarithm;

/// Singular values of the answers below this part of the largest are rounding errors.
const RANK: f64 = 1e-12;
/// A contribution of a signal below this part of the largest counts as zero.
const NOTHING: f64 = 1e-6;
/// Eigenvalues below this part of the largest entry of A may all be zero: those of integrators in a row.
const ZERO: f64 = 0.1;

/// Change that an experiment makes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moved {
    /// The start value of a state.
    Start(usize),
    /// An input, changed for the first half of the communication steps.
    Input(usize),
}

/// Answers of an experiment: half the difference between a change up and one down.
#[derive(Debug)]
pub(super) struct Experiment {
    pub moved: Moved,
    /// Half the difference between the two values of the changed variable.
    pub change: f64,
    /// States at the communication points, and outputs; a column a point.
    pub states: DMatrix<f64>,
    pub outputs: DMatrix<f64>,
}

impl Experiment {
    fn steps(&self) -> usize {
        self.states.ncols() - 1
    }

    /// The change of an input within a communication step.
    fn input(&self, input: usize, step: usize) -> f64 {
        if self.moved == Moved::Input(input) && step < self.steps() / 2 { self.change } else { 0.0 }
    }
}

/// Sizes of a system, and which of its outputs are states.
#[derive(Debug, Clone)]
pub(super) struct Shape {
    pub states: usize,
    pub inputs: usize,
    /// State that each output equals, if any.
    pub outputs: Vec<Option<usize>>,
}

/// A fit to experiments of one size.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// A and B, side by side.
    pub rates: DMatrix<f64>,
    /// C and D, side by side.
    pub shown: DMatrix<f64>,
    /// States after a communication step by states and inputs at its beginning.
    pub sampled: DMatrix<f64>,
    /// Largest magnitudes of states and of inputs in the experiments.
    pub sizes: DVector<f64>,
    /// The largest difference between the answers and the linear system's own, relative to the largest of each state.
    pub misfit: f64,
    /// Factor by which the fastest growing mode grows in a communication step.
    pub growth: f64,
    /// Condition number of the least squares, of signals scaled to one size.
    pub condition: f64,
}

/// Difference between two fits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Difference {
    /// The largest difference of an entry of A, of B, and of C and D for scaled signals, relative to the largest.
    pub matrices: f64,
    /// The largest distance of an eigenvalue of A from the other's, relative to the largest.
    pub eigenvalues: f64,
}

/// Reason why there is no fit.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Unfit {
    /// No experiment moves a state.
    StillState(usize),
    /// The signals depend on each other; this many are independent.
    Dependent(usize),
    /// The sampled system belongs to no continuous one.
    NoLogarithm,
}

/// Data of experiments, one row a communication step.
struct Rows {
    /// States and inputs at its beginning.
    known: DMatrix<f64>,
    /// States at its end.
    next: DMatrix<f64>,
    /// States at its end, and inputs until then, which outputs follow.
    seen: DMatrix<f64>,
    /// Outputs at its end.
    outputs: DMatrix<f64>,
}

impl Rows {
    fn new(shape: &Shape, experiments: &[Experiment]) -> Self {
        let (n, m, p) = (shape.states, shape.inputs, shape.outputs.len());
        let points = experiments.iter().map(Experiment::steps).sum();
        let (mut known, mut next) = (DMatrix::zeros(points, n + m), DMatrix::zeros(points, n));
        let (mut seen, mut outputs) = (DMatrix::zeros(points, n + m), DMatrix::zeros(points, p));
        let rows = experiments.iter().flat_map(|experiment| (0..experiment.steps()).map(move |k| (experiment, k)));
        for (row, (experiment, k)) in rows.enumerate() {
            known.view_mut((row, 0), (1, n)).copy_from(&experiment.states.column(k).transpose());
            seen.view_mut((row, 0), (1, n)).copy_from(&experiment.states.column(k + 1).transpose());
            next.row_mut(row).copy_from(&experiment.states.column(k + 1).transpose());
            outputs.row_mut(row).copy_from(&experiment.outputs.column(k + 1).transpose());
            for input in 0..m {
                known[(row, n + input)] = experiment.input(input, k);
                seen[(row, n + input)] = known[(row, n + input)];
            }
        }
        Rows { known, next, seen, outputs }
    }
}

impl Fit {
    /// The fit to experiments with a communication step in s.
    pub fn new(shape: &Shape, experiments: &[Experiment], step: f64) -> Result<Self, Unfit> {
        let (n, m) = (shape.states, shape.inputs);
        let Rows { known, next, seen, outputs } = Rows::new(shape, experiments);
        if let Some(state) = (0..n).find(|&state| known.column(state).amax().max(next.column(state).amax()) == 0.0) {
            return Err(Unfit::StillState(state));
        }
        let (sampled, condition) = solved(&known, &next)?;
        let mut exponential = DMatrix::identity(n + m, n + m);
        exponential.view_mut((0, 0), (n, n + m)).copy_from(&sampled);
        let rates = logarithm(&exponential).ok_or(Unfit::NoLogarithm)? / step;
        let (mut shown, _) = solved(&seen, &outputs)?;
        for (row, state) in shape.outputs.iter().enumerate() {
            if let Some(state) = state {
                shown.row_mut(row).fill(0.0);
                shown[(row, *state)] = 1.0;
            }
        }
        let sizes = DVector::from_fn(n + m, |column, _| known.column(column).amax());
        let rates = cleaned(rates.rows(0, n).into_owned(), &sizes);
        let eigenvalues = complex(&sampled.columns(0, n).into_owned()).ok_or(Unfit::NoLogarithm)?;
        Ok(Fit {
            rates,
            shown: cleaned(shown, &sizes),
            sizes,
            misfit: misfit(&sampled, experiments),
            sampled,
            growth: eigenvalues.iter().map(|value| value.norm()).fold(0.0, f64::max),
            condition,
        })
    }

    /// Returns the limit of ever smaller changes: the error of a central difference goes with the square of the change.
    pub fn extrapolated(&self, half: &Fit) -> Fit {
        let limit = |whole: &DMatrix<f64>, half: &DMatrix<f64>| (half * 4.0 - whole) / 3.0;
        let rates = cleaned(limit(&self.rates, &half.rates), &half.sizes);
        let shown = cleaned(limit(&self.shown, &half.shown), &half.sizes);
        Fit { rates, shown, ..half.clone() }
    }

    /// A, B, C and D.
    pub fn matrices(&self) -> [DMatrix<f64>; 4] {
        let n = self.rates.nrows();
        let split = |matrix: &DMatrix<f64>| {
            (matrix.columns(0, n).into_owned(), matrix.columns(n, matrix.ncols() - n).into_owned())
        };
        let ((a, b), (c, d)) = (split(&self.rates), split(&self.shown));
        [a, b, c, d]
    }

    /// Returns the difference of another fit from this one.
    pub fn difference(&self, other: &Fit) -> Difference {
        let n = self.rates.nrows();
        // Both are scaled to one size: the one that signals have in the experiments.
        let of_rates = |fit: &Fit| {
            let by_signals = self.scaled(&fit.rates);
            DMatrix::from_fn(n, by_signals.ncols(), |i, j| by_signals[(i, j)] / self.size(i))
        };
        let (rates, others) = (of_rates(self), of_rates(other));
        let (apart, (of_states, of_inputs)) = (&others - &rates, (0..n, n..rates.ncols()));
        let a = |rates: &DMatrix<f64>| rates.columns_range(of_states.clone()).into_owned();
        let (one, other_one) = (a(&rates), a(&others));
        let entry = one.amax();
        let eigenvalues = eigenvalues_apart(&one, &other_one, entry);
        let (shown, others) = (self.scaled(&self.shown), self.scaled(&other.shown));
        let row = |row: usize| relative((others.row(row) - shown.row(row)).amax(), shown.row(row).amax());
        let matrices = (0..shown.nrows()).map(row).chain([
            relative(a(&apart).amax(), entry),
            relative(apart.columns_range(of_inputs.clone()).amax(), rates.columns_range(of_inputs).amax()),
        ]);
        Difference { matrices: largest(matrices), eigenvalues }
    }

    /// A matrix for signals that are scaled to one size.
    fn scaled(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * self.size(j))
    }

    /// The size of a signal, a state or an input; 1 if it never moves.
    fn size(&self, signal: usize) -> f64 {
        if self.sizes[signal] > 0.0 { self.sizes[signal] } else { 1.0 }
    }
}

/// A matrix without entries that are only rounding errors of their rows.
fn cleaned(mut matrix: DMatrix<f64>, sizes: &DVector<f64>) -> DMatrix<f64> {
    for mut row in matrix.row_iter_mut() {
        let largest = row.iter().zip(sizes).map(|(entry, size)| entry.abs() * size).fold(0.0, f64::max);
        for (entry, size) in row.iter_mut().zip(sizes) {
            if entry.abs() * size < NOTHING * largest {
                *entry = 0.0;
            }
        }
    }
    matrix
}

/// A difference relative to the largest value; 0 if all values are 0.
fn relative(difference: f64, largest: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference / largest }
}

/// The largest of some numbers; NaN counts as larger than all.
fn largest(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers.into_iter().fold(0.0, |most: f64, next| if next.is_nan() { f64::INFINITY } else { most.max(next) })
}

/// The largest distance of an eigenvalue of either matrix from the other's. It is relative to the largest one, or to
/// the largest entry if all are zero up to rounding.
fn eigenvalues_apart(one: &DMatrix<f64>, other: &DMatrix<f64>, entry: f64) -> f64 {
    if !(one.norm_squared() + other.norm_squared()).is_finite() {
        return f64::INFINITY;
    }
    let (Some(one), Some(other)) = (complex(one), complex(other)) else { return f64::INFINITY };
    let largest = one.iter().chain(&other).map(|value| value.norm()).fold(ZERO * entry, f64::max);
    let nearest = |value: Complex<f64>, others: &[Complex<f64>]| {
        others.iter().map(|other| (other - value).norm()).fold(f64::INFINITY, f64::min)
    };
    let there = one.iter().map(|value| nearest(*value, &other));
    let back = other.iter().map(|value| nearest(*value, &one));
    let apart = there.chain(back).fold(0.0, f64::max);
    relative(apart, largest)
}

/// The matrix whose product with each row of `known` is the row of `wanted`, and the condition number.
fn solved(known: &DMatrix<f64>, wanted: &DMatrix<f64>) -> Result<(DMatrix<f64>, f64), Unfit> {
    // Sizes of signals may differ by far.
    let sizes = DVector::from_fn(known.ncols(), |column, _| known.column(column).amax().max(f64::MIN_POSITIVE));
    let scaled = DMatrix::from_fn(known.nrows(), known.ncols(), |i, j| known[(i, j)] / sizes[j]);
    let singular = scaled.svd(true, true);
    let (largest, least) = (singular.singular_values.max(), singular.singular_values.min());
    let (rank, count) = (singular.rank(RANK * largest), known.ncols());
    if rank < count || known.nrows() < count {
        return Err(Unfit::Dependent(rank));
    }
    let solution = singular.solve(wanted, 0.0).map_err(|_| Unfit::Dependent(rank))?;
    Ok((DMatrix::from_fn(wanted.ncols(), count, |i, j| solution[(j, i)] / sizes[j]), largest / least))
}

/// Returns the error of the sampled system's own answers, relative to the largest of each state.
pub(super) fn misfit(sampled: &DMatrix<f64>, experiments: &[Experiment]) -> f64 {
    let (n, m) = (sampled.nrows(), sampled.ncols() - sampled.nrows());
    let mut worst: f64 = 0.0;
    for state in 0..n {
        let largest = experiments.iter().map(|e| e.states.row(state).amax()).fold(0.0, f64::max);
        for experiment in experiments {
            let mut x = experiment.states.column(0).into_owned();
            for k in 0..experiment.steps() {
                let u = DVector::from_fn(m, |input, _| experiment.input(input, k));
                x = sampled.columns(0, n) * x + sampled.columns(n, m) * u;
                let difference = relative((x[state] - experiment.states[(state, k + 1)]).abs(), largest);
                // NaN is the worst of all.
                worst = if difference > worst || difference.is_nan() { difference } else { worst };
            }
        }
    }
    worst
}
