//! The model of records with all states measured: both predictors, and the choice between them.

use nalgebra::DMatrix;

use crate::data::Data;
use crate::finding::{Cause, Refusal};
use crate::layout::Layout;
use crate::linear::{exponential, spectral_radius};
use crate::marquardt::{Fit, MOST_GROWTH, Objective, search};
use crate::problem::Problem;
use crate::sampled::Hold;
use crate::starts::starts;

/// Steps of each start, and of each search that goes on.
const FIRST_STEPS: usize = 5;
const MORE_STEPS: usize = 25;
/// Starts that go on.
const GO_ON: usize = 2;
/// First windows of output error, rows.
const FIRST_WINDOW: usize = 200;

/// The method of an estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Method {
    /// Output error: only sensors are noisy.
    OutputError,
    /// A predictor with a gain, the innovation form: also what acts on the plant.
    Innovation,
}

/// Both fits of a record, and which of them counts.
#[derive(Debug, Clone)]
pub(crate) struct Estimate {
    pub output_error: Option<Fit>,
    /// Longest window of output error.
    pub longest: usize,
    pub innovation: Fit,
    pub method: Method,
}

impl Estimate {
    /// The fit that counts.
    pub fn fit(&self) -> &Fit {
        match (&self.output_error, self.method) {
            (Some(fit), Method::OutputError) => fit,
            _ => &self.innovation,
        }
    }

    /// The problem that it solves.
    pub fn problem<'a>(&self, data: &'a Data, layout: &'a Layout, hold: Hold) -> Problem<'a> {
        match self.method {
            Method::OutputError => Problem::new(data, layout, hold, self.longest, false),
            Method::Innovation => Problem::new(data, layout, hold, usize::MAX, true),
        }
    }
}

/// F of one sample.
pub(crate) fn transition(layout: &Layout, unknowns: &[f64]) -> Option<DMatrix<f64>> {
    Some(exponential(&layout.matrices(&unknowns[..layout.count()]).a, &[])?.0)
}

/// The longest window in which errors of an initial state don't grow too much.
fn longest_window(layout: &Layout, unknowns: &[f64], wanted: usize) -> usize {
    let radius = transition(layout, unknowns).map_or(1.0, |f| spectral_radius(&f));
    // A little less: the search must be able to move.
    let bound = if radius > 1.0 { 0.95 * MOST_GROWTH.ln() / radius.ln() } else { f64::INFINITY };
    if bound < wanted as f64 { bound as usize } else { wanted }
}

/// Estimates the unknowns of a layout.
pub(crate) fn estimate(data: &Data, layout: &Layout, hold: Hold, longest: usize) -> Result<Estimate, Refusal> {
    let innovation = Problem::new(data, layout, hold, usize::MAX, true);
    let first = from_starts(&innovation).ok_or_else(|| {
        let text = "no model of these states follows the record: no start of the search has a stable predictor";
        Refusal::new(Cause::NoModel, format!("{text}; is a state missing?"))
    })?;
    let (output_error, longest) = output_error(data, layout, hold, longest, &first.unknowns);
    let again = output_error.as_ref().and_then(|fit| {
        let start = [&fit.unknowns[..], &vec![0.0; data.n * data.n]].concat();
        search(&innovation, &start, MORE_STEPS)
    });
    let innovation = again.filter(|again| again.value.loss < first.value.loss).unwrap_or(first);
    let method = choose(data, layout, hold, (output_error.as_ref(), longest), &innovation);
    Ok(Estimate { output_error, longest, innovation, method })
}

/// The best fit of the innovation form from the starts.
fn from_starts(problem: &Problem) -> Option<Fit> {
    let n = problem.data.n;
    let begun = |unknowns: Vec<f64>| {
        let f = transition(problem.layout, &unknowns)?;
        let gain = (f * 0.5).transpose();
        search(problem, &[&unknowns[..], gain.as_slice()].concat(), FIRST_STEPS)
    };
    let mut fits: Vec<Fit> = starts(problem.data, problem.layout).into_iter().filter_map(begun).collect();
    fits.retain(|fit| fit.unknowns.len() == problem.layout.count() + n * n);
    fits.sort_by(|p, q| p.value.loss.total_cmp(&q.value.loss));
    let go_on = fits.iter().take(GO_ON).filter_map(|fit| search(problem, &fit.unknowns, MORE_STEPS));
    go_on.min_by(|p, q| p.value.loss.total_cmp(&q.value.loss))
}

/// Output error by growing windows, from a point; and its longest window.
fn output_error(data: &Data, layout: &Layout, hold: Hold, longest: usize, start: &[f64]) -> (Option<Fit>, usize) {
    let start = &start[..layout.count()];
    let window = longest_window(layout, start, FIRST_WINDOW.min(longest));
    let Some(first) = search(&Problem::new(data, layout, hold, window, false), start, MORE_STEPS) else {
        return (None, window);
    };
    let whole = longest_window(layout, &first.unknowns, longest);
    match search(&Problem::new(data, layout, hold, whole, false), &first.unknowns, MORE_STEPS) {
        Some(fit) => (Some(fit), whole),
        None => (Some(first), window),
    }
}

/// The choice: the innovation form where the plant is unstable, or where it explains more than its further unknowns do by
/// chance.
fn choose(
    data: &Data,
    layout: &Layout,
    hold: Hold,
    (output_error, longest): (Option<&Fit>, usize),
    innovation: &Fit,
) -> Method {
    let Some(fit) = output_error else { return Method::Innovation };
    let is_unstable = transition(layout, &innovation.unknowns).is_none_or(|f| spectral_radius(&f) > 1.0);
    if is_unstable {
        return Method::Innovation;
    }
    // Both over the same windows.
    let same = Problem { free_gain: true, ..Problem::new(data, layout, hold, longest, false) };
    let loss = same.value(&innovation.unknowns, &innovation.value.weights()).map_or(f64::INFINITY, |value| value.loss);
    let further = (data.n * data.n) as f64;
    if fit.value.loss - loss > 4.0 * further + 8.0 { Method::Innovation } else { Method::OutputError }
}
