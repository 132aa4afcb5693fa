//! The funnel of a prescribed-performance law: how it is given, where an error stands in it, and what happens when one
//! leaves it (thesis, sections 5.2 and 6.2).

#![allow(non_snake_case)] // R is the thesis' name

use crate::control::performance::{self, Bounds, Performance};
use crate::error::Number;
use crate::report::number;
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, DesignReport, Discrete, IntegerOf, Invalid, Parameter, Point, Scalar,
    Signal, Signals, Values, VectorOf, Warning, boolean, choice, integer, vector,
};

/// Where the funnel re-opens, in parts of the distance of its bounds.
const EDGE: f64 = 1e-6;
/// How wide it re-opens, in parts of the error.
const WIDER: f64 = 1.25;

/// Which bounds an error has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Shape {
    Symmetric,
    NoOvershoot,
}

impl Choice for Shape {
    const TYPE: &'static str = "Funnel";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Symmetric, "symmetric", "-rho < e < rho"),
        (
            Self::NoOvershoot,
            "no_overshoot",
            "-overshoot rho < e < rho where e is positive at the start, else -rho < e < overshoot rho",
        ),
    ];
}

/// What happens when an error leaves its funnel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum OnExit {
    Error,
    Reopen,
}

impl Choice for OnExit {
    const TYPE: &'static str = "OnFunnelExit";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Error, "error", "the step is an error: the law is not defined outside"),
        (Self::Reopen, "reopen", "the channel's funnel opens to 1.25 times the error, and closes again at its rate"),
    ];
}

/// One funnel a channel.
#[derive(Debug)]
pub(super) struct Funnel {
    rho_0: VectorOf<Parameter>,
    rho_inf: VectorOf<Parameter>,
    decay_rate: VectorOf<Parameter>,
    shape: ChoiceOf<Parameter, Shape>,
    overshoot: VectorOf<Parameter>,
    on_exit: ChoiceOf<Parameter, OnExit>,
    /// What ρ was when the funnel opened, and when that was, s.
    opened_to: VectorOf<Discrete>,
    opened_at: VectorOf<Discrete>,
    /// Whether e was positive then.
    is_positive: Vec<BooleanOf<Discrete>>,
    /// Whether every error was inside at the start.
    began_inside: BooleanOf<Discrete>,
    reopened: IntegerOf<Discrete>,
    e: VectorOf<Signal>,
    rho: VectorOf<Signal>,
    epsilon: VectorOf<Signal>,
    lower: VectorOf<Signal>,
    upper: VectorOf<Signal>,
    left: Warning,
}

/// An error within its funnel at a time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inside<S> {
    pub e: S,
    pub performance: Performance<S>,
    pub bounds: Bounds<S>,
    /// z = e/ρ
    pub z: S,
    /// ε
    pub epsilon: S,
    /// R = dε/dz / ρ
    pub R: S,
}

impl Funnel {
    /// Of channels whose errors have these units, and the funnel of an example.
    pub fn declare(d: &mut Declaration, units: &[&'static str], [rho_0, rho_inf, decay_rate]: [f64; 3]) -> Self {
        let m = units.len();
        let signal = |name: &str, text: &str| vector(name, m, text).units(units);
        Funnel {
            rho_0: d.parameter(signal("rho_0", "bound of the error at the start").start(rho_0).positive().fixed()),
            rho_inf: d.parameter(signal("rho_inf", "bound of the error in the end").start(rho_inf).positive()),
            decay_rate: d.parameter(
                vector("decay_rate", m, "rate at which the bound of the error decays")
                    .unit("1/s")
                    .start(decay_rate)
                    .min(0.0),
            ),
            shape: d.parameter(choice::<Shape>("funnel", "which bounds the error has, from rho").fixed()),
            overshoot: d.parameter(
                vector(
                    "overshoot",
                    m,
                    "bound on the other side than the error's at the start, in parts of rho, with no_overshoot",
                )
                .min(0.0)
                .max(1.0)
                .fixed(),
            ),
            on_exit: d.parameter(choice::<OnExit>("on_funnel_exit", "answer to an error that leaves its funnel")),
            opened_to: d.discrete(vector("#opened_to", m, "").hidden()),
            opened_at: d.discrete(vector("#opened_at", m, "").hidden()),
            is_positive: (0..m)
                .map(|i| d.discrete(boolean(&format!("#is_positive[{}]", i + 1), "").hidden()))
                .collect(),
            began_inside: d.discrete(boolean("#began_inside", "").hidden()),
            reopened: d.discrete(integer("funnel_reopened", "how often a funnel was re-opened").output()),
            e: d.local(signal("e", "error that is kept within the funnel")),
            rho: d.local(signal("rho", "performance function")),
            epsilon: d.local(vector("epsilon", m, "transformed error, which is infinite at the funnel's bounds")),
            lower: d.local(signal("funnel_lower", "lower bound of the error")),
            upper: d.local(signal("funnel_upper", "upper bound of the error")),
            left: d.warning("logFunnel", "an error that left its funnel, which re-opened"),
        }
    }

    /// Signals of the funnel, for the declaration of what they depend on; those of the first kind depend on e.
    pub fn signals_of_error(&self) -> [VectorOf<Signal>; 2] {
        [self.e, self.epsilon]
    }

    /// Signals that depend on time alone.
    pub fn signals_of_time(&self) -> [VectorOf<Signal>; 3] {
        [self.rho, self.lower, self.upper]
    }

    /// # Errors
    /// [`Invalid`] for bounds that widen.
    pub fn prepare(&self, v: &Point) -> Invalid {
        let mut invalid = Invalid::none();
        for (i, (rho_0, rho_inf)) in v[self.rho_0].iter().zip(&v[self.rho_inf]).enumerate() {
            if rho_inf >= rho_0 {
                let allowed = format!("must be below rho_0[{}] = {}", i + 1, Number(*rho_0));
                invalid.and(Invalid::new(format!("rho_inf[{}]", i + 1), Number(*rho_inf), allowed));
            }
        }
        invalid
    }

    /// Tells of the funnels.
    pub fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        performance::report(&v[self.rho_0], &v[self.rho_inf], &v[self.decay_rate], report);
        let overshoot = v[self.overshoot].iter().copied().fold(f64::INFINITY, f64::min);
        match v.get(self.shape) {
            Shape::Symmetric => report.tell("shape", "symmetric", "", "-rho < e < rho"),
            Shape::NoOvershoot if overshoot > 0.0 => report.tell("shape", "no_overshoot", "", ""),
            Shape::NoOvershoot => {
                let note = "with overshoot = 0 an error that starts at 0 starts at a bound: it is refused there";
                report.tell("shape", "no_overshoot", "", note);
            }
        }
    }

    /// Opens the funnels at the start.
    pub fn open(&self, t: f64, e: impl Fn(usize, &Values<f64>) -> f64, v: &mut Point) {
        v.copy(self.rho_0, self.opened_to);
        v[self.opened_at].fill(t);
        v.put(self.began_inside, true);
        v.put(self.reopened, 0);
        for (i, &is_positive) in self.is_positive.iter().enumerate() {
            let e = e(i, &v.values());
            v.put(is_positive, e >= 0.0);
            let inside = self.bounds(i, &v.values()).hold(e / v[self.rho_0][i]);
            let all = v.get(self.began_inside) && inside;
            v.put(self.began_inside, all);
        }
    }

    /// Bounds of z in a channel.
    pub fn bounds<S: Scalar>(&self, i: usize, v: &Values<S>) -> Bounds<S> {
        let (full, other) = (S::from(1.0), v[self.overshoot][i]);
        match (v.get(self.shape), v.get(self.is_positive[i])) {
            (Shape::Symmetric, _) => Bounds { lower: full, upper: full },
            (Shape::NoOvershoot, true) => Bounds { lower: other, upper: full },
            (Shape::NoOvershoot, false) => Bounds { lower: full, upper: other },
        }
    }

    /// ρ of a channel at a time.
    pub fn performance<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> Performance<S> {
        let since = t - v[self.opened_at][i];
        Performance::at(since, v[self.opened_to][i], v[self.rho_inf][i], v[self.decay_rate][i])
    }

    /// A channel's error within its funnel. Before the simulation, where a master may not have set its inputs, an error
    /// that is outside counts as one in the middle; the start is refused then.
    pub fn inside<S: Scalar>(&self, i: usize, t: S, e: S, v: &Values<S>) -> Inside<S> {
        let (performance, bounds) = (self.performance(i, t, v), self.bounds(i, v));
        let z = if v.get(self.began_inside) { e / performance.rho } else { (bounds.upper - bounds.lower) * 0.5 };
        let (epsilon, R) = (bounds.transformed(z), bounds.slope(z) / performance.rho);
        Inside { e, performance, bounds, z, epsilon, R }
    }

    /// The smallest distance of a channel's bounds that is to come, halved.
    pub fn narrowest(&self, i: usize, v: &Values<f64>) -> f64 {
        v[self.rho_inf][i]
    }

    /// Shows a channel.
    pub fn show<S: Scalar>(&self, i: usize, inside: &Inside<S>, y: &mut Signals<S>) {
        let Inside { e, performance: Performance { rho, .. }, bounds, epsilon, .. } = *inside;
        y[self.e.at(i)] = e;
        y[self.rho.at(i)] = rho;
        y[self.epsilon.at(i)] = epsilon;
        y[self.lower.at(i)] = -bounds.lower * rho;
        y[self.upper.at(i)] = bounds.upper * rho;
    }

    /// # Errors
    /// [`Invalid`] for errors that are outside, and what helps.
    pub fn check(&self, t: f64, e: impl Fn(usize) -> f64, v: &Values<f64>) -> Result<(), Invalid> {
        let mut invalid = Invalid::none();
        for i in 0..self.e.len() {
            let (e, rho, bounds) = (e(i), self.performance(i, t, v).rho, self.bounds(i, v));
            if bounds.hold(e / rho) {
                continue;
            }
            let (low, high, channel) = (0.0 - bounds.lower * rho, bounds.upper * rho, i + 1);
            let by = if e > 0.0 { e - high } else { low - e };
            let helps = if v[self.opened_at][i] == t && !v.get(self.began_inside) {
                if bounds.margin(e.signum()) < 0.0 || e == 0.0 {
                    format!("overshoot[{channel}] above {} would do", number(e.abs() / rho))
                } else {
                    format!("rho_0[{channel}] above {} would do", number(e.abs()))
                }
            } else {
                format!(
                    "it has left its funnel (rho = {}). A smaller communication step helps where it is sampled too \
                     rarely, a larger rho_0[{channel}] or rho_inf[{channel}] where it is too narrow; on_funnel_exit = \
                     reopen goes on",
                    number(rho)
                )
            };
            let where_it_is =
                if by == 0.0 { "is at a bound".to_owned() } else { format!("is beyond by {}", number(by)) };
            let allowed = format!("must lie between {} and {}, and {where_it_is}: {helps}", number(low), number(high));
            invalid.and(Invalid::new(format!("e[{channel}]"), Number(e), allowed));
        }
        invalid.into_result()
    }

    /// How far each error is from where its funnel re-opens, if it does.
    pub fn event_indicators(&self, t: f64, e: impl Fn(usize) -> f64, v: &Values<f64>, z: &mut [f64]) {
        for (i, z) in z.iter_mut().enumerate() {
            *z = match v.get(self.on_exit) {
                OnExit::Error => 1.0,
                OnExit::Reopen => self.distance(i, t, e(i), v),
            };
        }
    }

    fn distance(&self, i: usize, t: f64, e: f64, v: &Values<f64>) -> f64 {
        let bounds = self.bounds(i, v);
        let margin = bounds.margin(e / self.performance(i, t, v).rho) - EDGE * (bounds.lower + bounds.upper);
        if margin == 0.0 { -f64::MIN_POSITIVE } else { margin }
    }

    /// Re-opens the funnels that errors have left.
    pub fn event(&self, t: f64, e: impl Fn(usize, &Values<f64>) -> f64, v: &mut Point) {
        if v.get(self.on_exit) == OnExit::Error || !v.get(self.began_inside) {
            return;
        }
        for i in 0..self.e.len() {
            let error = e(i, &v.values());
            if self.distance(i, t, error, &v.values()) > 0.0 {
                continue;
            }
            let rho = self.performance(i, t, &v.values()).rho;
            v[self.opened_to][i] = (WIDER * error.abs()).max(v[self.rho_inf][i]);
            v[self.opened_at][i] = t;
            v.put(self.is_positive[i], error >= 0.0);
            let count = v.get(self.reopened) + 1;
            v.put(self.reopened, count);
            let opened_to = v[self.opened_to][i];
            v.warn(self.left, || {
                format!(
                    "e[{}] = {} has left its funnel of rho = {} at t = {t} s; it was re-opened to {}. funnel_reopened counts \
                     how often that happens",
                    i + 1,
                    number(error),
                    number(rho),
                    number(opened_to)
                )
            });
        }
    }
}
