//! The linear system of an FMU in co-simulation without derivatives. It follows from the responses of its states, which
//! it shows at communication points, to small changes of its inputs, and of start values of its states.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::experiments::{Bench, CHANGE, Subject};
use super::operating_point::{Method, OperatingPoint, STEPS};
use super::plan::Plan;
use super::sampled::{Difference, Fit, Moved, Unfit, misfit};
use crate::error::Error;
use crate::fmu::Fmu;

/// Largest misfit of a linear system, relative to the answers.
const WORST_MISFIT: f64 = 0.1;
/// Largest difference of two extrapolations that count as certain, relative to the largest entry.
const WORST_DIFFERENCE: f64 = 1e-2;
/// The same of eigenvalues, relative to the largest.
const WORST_EIGENVALUES: f64 = 5e-4;
/// Part of the allowed difference of two extrapolations at which they are good enough.
const ENOUGH: f64 = 0.02;
/// Growth of an answer beyond which it hides what doesn't grow.
const GROWTH: f64 = 100.0;
/// Sizes of experiments with inputs that are tried; fewer are tried after experiments with start values.
const TRIES: usize = 12;
const FEW_TRIES: usize = 3;
/// Number of failures after which the size of the change can't be their cause.
const MOST_FAILURES: usize = 4;
/// Factor of the change in the next try after one that failed.
const SMALLER: f64 = 0.125;
/// Experiments with start values: communication steps of half of each, and part of the usual change.
const STARTS: [(usize, f64); 8] =
    [(1, 1.0), (1, 1e-1), (8, 1.0), (1, 1e-2), (64, 1.0), (1, 1e-3), (64, 1e-1), (1, 1e-4)];
/// Growth in a communication step above which a shorter step helps.
const FAST: f64 = 1.2;
/// Condition number above which the answers are too short to identify the system.
const ILL: f64 = 1e6;

/// Experiments of one size and their results: the fits to them and to experiments half as large and half as long,
/// extrapolated to no change at all.
#[derive(Debug, Clone)]
struct Tried {
    fit: Fit,
    part: f64,
    difference: Difference,
}

/// Reason why there is no linear system.
#[derive(Debug)]
enum Trouble {
    Unit(Error),
    Unfit(Unfit),
    /// The misfit and its fit.
    Misfit(f64, Box<Fit>),
    Uncertain(Box<Tried>),
}

impl Tried {
    /// Difference of the extrapolations, relative to what is allowed.
    fn excess(&self) -> f64 {
        let Difference { matrices, eigenvalues } = self.difference;
        (matrices / WORST_DIFFERENCE).max(eigenvalues / WORST_EIGENVALUES)
    }

    /// The same, compared with the result of other experiments.
    fn with(&self, other: &Tried) -> Tried {
        Tried { difference: self.fit.difference(&other.fit), ..self.clone() }
    }

    /// Number of steps of an experiment with inputs, and part of the usual change with which its answer is as large as
    /// here.
    fn size_for_inputs(&self) -> (usize, f64) {
        let (n, steps) = (self.fit.sampled.nrows(), longest(self.fit.growth).max(1));
        let mut most: f64 = 1.0;
        for input in n..self.fit.sampled.ncols() {
            let mut x = DVector::zeros(n);
            for k in 0..2 * steps {
                let u = if k < steps { self.fit.sizes[input] } else { 0.0 };
                x = self.fit.sampled.columns(0, n) * x + self.fit.sampled.column(input) * u;
                let size = |(x, size): (&f64, &f64)| if *size > 0.0 { x.abs() / size } else { 0.0 };
                most = x.iter().zip(&self.fit.sizes).map(size).fold(most, f64::max);
            }
        }
        (steps, self.part / most)
    }

    /// True if inputs have the effect over many steps that the linear system predicts.
    fn foretells(
        &self,
        subject: &impl Subject,
        inputs: &[Moved],
        (steps, part): (usize, f64),
    ) -> Result<bool, Trouble> {
        let experiments = inputs.iter().map(|moved| subject.experiment(*moved, part, 2 * steps));
        let experiments = experiments.collect::<Result<Vec<_>, _>>().map_err(Trouble::Unit)?;
        Ok(misfit(&self.fit.sampled, &experiments) <= WORST_DIFFERENCE)
    }
}

/// Finds the linear system about the states of a simulation from `start` until `time`.
///
/// # Errors
/// When the FMU fails, the changes don't move all states, the response isn't that of a linear system with these states,
/// or the result is uncertain.
pub(super) fn find(
    fmu: &Arc<Fmu>,
    plan: &Plan,
    point: &OperatingPoint,
    span: (f64, f64),
) -> Result<(Method, [DMatrix<f64>; 4]), Error> {
    let refuse = |reason: String| Error::Archive { file: fmu.file().to_owned(), reason };
    if plan.states.is_empty() || plan.inputs.is_empty() {
        return Err(refuse("has no states or no inputs, so there is nothing to linearise".to_owned()));
    }
    let bench = Bench::new(fmu, plan, point, span)?;
    let (Tried { fit, part, difference }, starts) = found(&bench).map_err(|trouble| match trouble {
        Trouble::Unit(error) => error,
        trouble => refuse(trouble_text(&trouble, plan, bench.step())),
    })?;
    let (step, misfit) = (bench.step(), fit.misfit);
    let method = Method::Responses { part: part * CHANGE, starts, step, misfit, difference: difference.matrices };
    Ok((method, fit.matrices()))
}

/// The linear system, and the number of states whose start values were changed for it.
fn found(subject: &impl Subject) -> Result<(Tried, usize), Trouble> {
    let inputs: Vec<Moved> = (0..subject.shape().inputs).map(Moved::Input).collect();
    let starts: Vec<Moved> = subject.starts().into_iter().map(Moved::Start).collect();
    let alone = || Ok((by_inputs(subject, &inputs, (STEPS, 1.0), TRIES)?, 0));
    if starts.is_empty() {
        return alone();
    }
    let Ok(by_starts) = by_starts(subject, &[&starts[..], &inputs].concat()) else { return alone() };
    // A start value may affect more than its state, e.g. a load in equilibrium. Experiments with inputs show that.
    let size = by_starts.size_for_inputs();
    match by_inputs(subject, &inputs, size, FEW_TRIES) {
        Ok(by_inputs) if by_starts.with(&by_inputs).excess() > 1.0 || by_inputs.excess() < by_starts.excess() => {
            Ok((by_inputs, 0))
        }
        Ok(_) => Ok((by_starts, starts.len())),
        Err(_) if by_starts.foretells(subject, &inputs, size)? => Ok((by_starts, starts.len())),
        // If the operating point moves, predictions of a linear system hold for a shorter time.
        Err(_) => match alone() {
            Err(_) if by_starts.foretells(subject, &inputs, (size.0.div_ceil(8), size.1))? => {
                Ok((by_starts, starts.len()))
            }
            found => found,
        },
    }
}

/// Finds the linear system from start values of states, and inputs. One communication step shows how they move the
/// states; more steps average out the FMU's own tolerance.
fn by_starts(subject: &impl Subject, moved: &[Moved]) -> Result<Tried, Trouble> {
    let mut best = Best::default();
    for (steps, part) in STARTS {
        if best.takes(extrapolated(subject, moved, part, steps)) {
            break;
        }
    }
    best.found()
}

/// Finds the linear system from inputs only. If the answer grows, long experiments show only what grows, and large ones
/// the limits of the linear system.
fn by_inputs(subject: &impl Subject, moved: &[Moved], size: (usize, f64), tries: usize) -> Result<Tried, Trouble> {
    let (mut best, (mut steps, mut part)) = (Best::default(), size);
    let shortest = 4 * (subject.shape().states + subject.shape().inputs);
    for _ in 0..tries {
        let tried = extrapolated(subject, moved, part, steps);
        let fit = tried.as_ref().ok().map(|tried| &tried.fit);
        // A misfit shows only that smaller changes may be linear.
        let growth = fit.filter(|fit| fit.misfit <= WORST_MISFIT).map(|fit| fit.growth);
        if best.takes(tried) {
            break;
        }
        let longest = growth.map_or(steps / 2, longest).max(shortest);
        if growth.is_none() || steps <= longest {
            part *= SMALLER;
        }
        steps = steps.min(longest);
    }
    best.found()
}

/// The number of steps of half an experiment in which the answer grows as much as allowed.
fn longest(growth: f64) -> usize {
    let steps = 0.5 * GROWTH.ln() / growth.ln();
    if growth > 1.0 && steps < STEPS as f64 { steps as usize } else { STEPS }
}

/// Fits so far.
#[derive(Default)]
struct Best {
    tried: Vec<Tried>,
    trouble: Option<Trouble>,
    failures: usize,
}

impl Best {
    /// Takes a try. Returns true if further ones are useless.
    fn takes(&mut self, tried: Result<Tried, Trouble>) -> bool {
        match tried {
            Ok(tried) if tried.fit.misfit <= WORST_MISFIT => {
                let is_enough = tried.excess() <= ENOUGH;
                self.tried.push(tried);
                is_enough
            }
            Ok(tried) => {
                self.trouble = Some(Trouble::Misfit(tried.fit.misfit, Box::new(tried.fit)));
                false
            }
            Err(trouble) => {
                // A change may be too large for an FMU.
                self.failures += usize::from(matches!(trouble, Trouble::Unit(_)));
                let is_final =
                    self.failures >= MOST_FAILURES || matches!(trouble, Trouble::Unfit(Unfit::StillState(_)));
                self.trouble = Some(trouble);
                is_final
            }
        }
    }

    /// Returns the fit whose extrapolations differ least. Of many uncertain ones, two may agree by chance, so another
    /// fit must confirm it.
    fn found(mut self) -> Result<Tried, Trouble> {
        self.tried.sort_by(|one, other| one.excess().total_cmp(&other.excess()));
        let mut tried = self.tried.into_iter();
        match (tried.next(), self.trouble) {
            (Some(best), _) if best.excess() <= ENOUGH => Ok(best),
            (Some(best), _) if best.excess() <= 1.0 && tried.any(|other| best.with(&other).excess() <= 1.0) => Ok(best),
            (Some(best), _) => Err(Trouble::Uncertain(Box::new(best))),
            // Each try led either to a fit, or to a reason why it didn't.
            (None, trouble) => Err(trouble.unwrap_or(Trouble::Unfit(Unfit::NoLogarithm))),
        }
    }
}

/// Experiments of a size, and of half of it once or twice.
fn extrapolated(subject: &impl Subject, moved: &[Moved], part: f64, steps: usize) -> Result<Tried, Trouble> {
    let fit = |times: i32| {
        let part = part / f64::from(times);
        let steps = 2 * (steps / times as usize).max(1);
        let experiments = moved.iter().map(|moved| subject.experiment(*moved, part, steps));
        let experiments = experiments.collect::<Result<Vec<_>, _>>().map_err(Trouble::Unit)?;
        Fit::new(&subject.shape(), &experiments, subject.step()).map_err(Trouble::Unfit)
    };
    let (whole, half) = (fit(1)?, fit(2)?);
    let first = Tried { difference: half.difference(&whole), part: 0.5 * part, fit: whole.extrapolated(&half) };
    if first.excess() <= ENOUGH {
        return Ok(first);
    }
    let second = half.extrapolated(&fit(4)?);
    Ok(Tried { difference: second.difference(&first.fit), part: 0.25 * part, fit: second })
}

fn trouble_text(trouble: &Trouble, plan: &Plan, step: f64) -> String {
    let states = || plan.states.iter().map(|state| state.name.as_str()).collect::<Vec<_>>().join(", ");
    match trouble {
        Trouble::Unit(error) => error.to_string(),
        Trouble::Unfit(Unfit::StillState(state)) => {
            format!("its inputs do not affect `{}`, so it can't be linearised from responses", plan.states[*state].name)
        }
        Trouble::Unfit(Unfit::Dependent(rank)) => format!(
            "shows only {rank} of {} independent signals (states and inputs) in its responses to small changes of \
             its inputs. Use --states to leave out states that depend on each other or that no input affects",
            plan.states.len() + plan.inputs.len()
        ),
        Trouble::Unfit(Unfit::NoLogarithm) => format!(
            "changes too much within its communication step, {step} s, to determine its derivatives. Choose a \
             shorter step with --step"
        ),
        Trouble::Misfit(misfit, fit) => format!(
            "responds to small changes of its inputs differently from a linear system with the states {} (difference \
             {:.1} % of the largest response). {}: name all of its states with --states, choose another operating \
             point with --at or --set, or choose a shorter step with --step",
            states(),
            100.0 * misfit,
            quality(fit, step)
        ),
        Trouble::Uncertain(tried) => uncertain(tried, &states(), step),
    }
}

/// Quality of a fit in words.
fn quality(fit: &Fit, step: f64) -> String {
    format!(
        "In a communication step of {step} s its response grows by a factor of {:.4}, and the condition number of \
         the fit is {:.1e}",
        fit.growth, fit.condition
    )
}

fn uncertain(tried: &Tried, states: &str, step: f64) -> String {
    let Tried { fit, difference, .. } = tried;
    let advice = if fit.growth > FAST {
        "choose a shorter step with --step"
    } else if fit.condition > ILL {
        "choose a longer step with --step, or an FMU whose states have start values that can be set \
         (initial=\"exact\") or that supports model exchange"
    } else {
        "choose an operating point at rest with --at or --set, or an FMU that supports model exchange"
    };
    format!(
        "can't be linearised accurately: two extrapolations of its matrices differ by {:.2} % of the largest entry \
         (allowed: 1 %), and their eigenvalues by {:.3} % of the largest (allowed: 0.05 %). {}: {advice}. If \
         {states} are not all of its states, name all of them with --states",
        100.0 * difference.matrices,
        100.0 * difference.eigenvalues,
        quality(fit, step)
    )
}

#[cfg(test)]
mod tests;
