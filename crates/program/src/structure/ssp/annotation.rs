//! Our annotation of a loop: settings of the run, metrics and plots.

use roxmltree::Node;

use super::reader::Reader;
use crate::error::Error;
use crate::model_description::attribute;
use crate::structure::Order;

/// Type of our annotation.
pub(super) const ANNOTATION: &str = "adaptive-fmu.closed-loop";

/// Largest ratio of coefficients to the leading one: the exponential of larger ones overflows.
const LARGEST_RATIO: f64 = 1e100;

/// A linear model (numerator · input + initial)/denominator of an input signal; those of one name are added.
#[derive(Debug, Clone, PartialEq)]
pub struct IdealModel {
    /// Name of its output.
    pub name: String,
    /// Its input, `component.variable`.
    pub input: String,
    /// Coefficients, highest power first.
    pub numerator: Vec<f64>,
    /// Coefficients, highest power first.
    pub denominator: Vec<f64>,
    /// Coefficients of the initial state's part, added to numerator · input, highest power first; none from rest.
    pub initial: Vec<f64>,
}

/// A performance function ρ(t) = (ρ_0 − ρ_∞) e^(−l t) + ρ_∞.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerformanceFunction {
    /// ρ_0
    pub start: f64,
    /// ρ_∞
    pub end: f64,
    /// l, 1/s
    pub rate: f64,
}

impl PerformanceFunction {
    /// ρ(t)
    pub fn at(&self, t: f64) -> f64 {
        (self.start - self.end) * (-self.rate * t).exp() + self.end
    }
}

/// Statistic of a signal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Statistic {
    /// Largest magnitude.
    Max,
    /// Root of the mean square.
    Rms,
}

/// A number that judges a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Metric {
    /// Name with unit, as reports show it.
    pub label: String,
    /// The statistic.
    pub statistic: Statistic,
    /// The signal.
    pub of: String,
    /// Signal that is subtracted from it.
    pub minus: Option<String>,
    /// Divisor of the difference, a function of the time from the start.
    pub funnel: Option<PerformanceFunction>,
    /// Start of the evaluation, s.
    pub from: f64,
    /// Largest value that passes, if one is given.
    pub limit: Option<f64>,
}

impl Metric {
    /// True if it is the largest magnitude of a signal in the whole run.
    pub fn is_peak_of(&self, name: &str) -> bool {
        let Metric { statistic, of, minus, funnel, from, .. } = self;
        *statistic == Statistic::Max && of == name && minus.is_none() && funnel.is_none() && *from == f64::NEG_INFINITY
    }
}

/// A diagram.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plot {
    /// Title.
    pub title: String,
    /// Signals.
    pub signals: Vec<String>,
    /// Signals among them that are references, in addition to those that follow from the loop.
    pub references: Vec<String>,
    /// The axis of values.
    pub scale: Scale,
}

/// The axis of values of a diagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// Equal lengths mean equal differences.
    #[default]
    Linear,
    /// Equal lengths mean equal ratios; only values above 0 are shown.
    Logarithmic,
    /// Logarithmic if all values are above 0 and span decades, else linear.
    ByValues,
}

/// A failure that the loop is meant to show, for example that of a plant which can't be stabilized.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExpectedFailure {
    /// Earliest time, s.
    pub from: f64,
    /// Latest time, s.
    pub until: f64,
    /// True if only separate components fail, but not the composite.
    pub separate_only: bool,
}

impl Reader<'_> {
    /// Communication step in s, order, and true if algebraic loops are accepted.
    pub fn master(&self, node: Node) -> Result<(f64, Order, bool), Error> {
        let step = self.number(node, "step")?;
        if step <= 0.0 {
            return Err(self.refuse(node, &format!("step = {step}: must be above 0")));
        }
        let order = self.required(node, "order")?;
        let order = order.parse().map_err(|reason: String| self.refuse(node, &reason))?;
        let accepted = match node.attribute("algebraic-loops") {
            None | Some("refuse") => false,
            Some("accept") => true,
            Some(other) => {
                return Err(self.refuse(node, &format!("algebraic-loops = {other}: must be refuse or accept")));
            }
        };
        Ok((step, order, accepted))
    }

    pub fn model(&self, node: Node) -> Result<IdealModel, Error> {
        let (numerator, denominator) = (self.numbers(node, "numerator")?, self.numbers(node, "denominator")?);
        let proper = numerator.len() < denominator.len() && denominator.first().is_some_and(|&first| first != 0.0);
        if !proper || denominator.len() > 30 {
            return Err(self
                .refuse(node, "an IdealModel must be strictly proper, with a nonzero first denominator coefficient"));
        }
        if denominator.iter().chain(&numerator).any(|number| (number / denominator[0]).abs() > LARGEST_RATIO) {
            let reason =
                format!("an IdealModel's coefficients must be within {LARGEST_RATIO:e} times the denominator's first");
            return Err(self.refuse(node, &reason));
        }
        let initial = node.attribute("initial").map_or(Ok(vec![]), |_| self.numbers(node, "initial"))?;
        if initial.len() >= denominator.len() {
            return Err(self.refuse(node, "initial must have fewer coefficients than the denominator"));
        }
        let (name, input) = (self.required(node, "name")?, self.required(node, "input")?);
        Ok(IdealModel { name, input, numerator, denominator, initial })
    }

    pub fn metric(&self, node: Node) -> Result<Metric, Error> {
        let statistic = match self.required(node, "statistic")?.as_str() {
            "max" => Statistic::Max,
            "rms" => Statistic::Rms,
            other => return Err(self.refuse(node, &format!("statistic = {other}: must be max or rms"))),
        };
        Ok(Metric {
            label: self.required(node, "label")?,
            statistic,
            of: self.required(node, "of")?,
            minus: attribute(node, "minus"),
            funnel: node.attribute("funnel").map(|_| self.funnel(node)).transpose()?,
            from: self.number_or(node, "from", f64::NEG_INFINITY)?,
            limit: node.attribute("limit").map(|_| self.number(node, "limit")).transpose()?,
        })
    }

    fn funnel(&self, node: Node) -> Result<PerformanceFunction, Error> {
        match self.numbers(node, "funnel")?[..] {
            [start, end, rate] if end > 0.0 && start >= end && rate >= 0.0 => {
                Ok(PerformanceFunction { start, end, rate })
            }
            _ => Err(self.refuse(node, "funnel must be three numbers rho_0 >= rho_inf > 0 and a rate of decay >= 0")),
        }
    }

    pub fn expected_failure(&self, node: Node) -> Result<ExpectedFailure, Error> {
        let (from, until) = (self.number(node, "from")?, self.number(node, "until")?);
        if until < from {
            return Err(self.refuse(node, &format!("until = {until}: must not be before from, {from}")));
        }
        let separate_only = match node.attribute("of") {
            None => false,
            Some("separate") => true,
            Some(other) => return Err(self.refuse(node, &format!("of = {other}: must be separate, or left out"))),
        };
        Ok(ExpectedFailure { from, until, separate_only })
    }

    pub fn plot(&self, node: Node) -> Result<Plot, Error> {
        let words = |text: &str| text.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
        let signals = words(&self.required(node, "signals")?);
        let references = node.attribute("references").map_or_else(Vec::new, words);
        if let Some(other) = references.iter().find(|name| !signals.contains(name)) {
            return Err(self.refuse(node, &format!("references = {other}: must be one of the plot's signals")));
        }
        let scale = match node.attribute("scale") {
            None | Some("linear") => Scale::Linear,
            Some("log") => Scale::Logarithmic,
            Some("auto") => Scale::ByValues,
            Some(other) => return Err(self.refuse(node, &format!("scale = {other}: must be linear, log or auto"))),
        };
        Ok(Plot { title: self.required(node, "title")?, signals, references, scale })
    }
}
