//! The funnel of prescribed-performance control: its parameters, the place of an error in it, and the behaviour when an
//! error leaves it (thesis, sections 5.2 and 6.2).

#![allow(non_snake_case)] // R is the thesis' name

use super::angles::{Angles, require_below_half_a_turn};
use crate::mathematics::performance::{self, Bounds, Performance};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, DesignReport, Discrete, DiscreteSpec, IntegerOf, Invalid, Parameter,
    Point, Scalar, Signal, Signals, Values, VectorOf, Warning, boolean, choice, integer, larger, vector,
};

/// Place where the funnel re-opens, in parts of the distance of its bounds.
pub(super) const EDGE: f64 = 1e-6;
/// Width at which it re-opens, in parts of the error.
pub(super) const WIDER: f64 = 1.25;

/// Start values of a funnel that is wide, to both sides, and stays so.
pub(super) const OPEN: &str = "rho_0 = 10.0\nrho_inf = 9.0\ndecay_rate = 0.0\nfunnel = 'symmetric'\novershoot = 1.0\n";

/// Shape of the bounds.
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

/// Behaviour when an error leaves its funnel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OnExit {
    Error,
    Reopen,
}

impl Choice for OnExit {
    const TYPE: &'static str = "OnFunnelExit";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Error, "error", "the step is an error: the control law is not defined outside"),
        (Self::Reopen, "reopen", "the channel's funnel opens to 1.25 times the error, and closes again at its rate"),
    ];
}

impl OnExit {
    /// The parameter of that.
    pub fn parameter() -> DiscreteSpec<Self> {
        choice("on_funnel_exit", "answer to an error that leaves its funnel")
    }
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
    /// ρ at the time when the funnel opened, and that time, s.
    opened_to: VectorOf<Discrete>,
    opened_at: VectorOf<Discrete>,
    /// True if e was positive then.
    is_positive: Vec<BooleanOf<Discrete>>,
    /// True if every error was inside at the start.
    began_inside: BooleanOf<Discrete>,
    reopened: IntegerOf<Discrete>,
    e: VectorOf<Signal>,
    rho: VectorOf<Signal>,
    epsilon: VectorOf<Signal>,
    lower: VectorOf<Signal>,
    upper: VectorOf<Signal>,
    left: Warning,
    /// Channels whose errors are those of angles.
    angles: Angles,
    /// The first of its event indicators, one a channel.
    indicator: usize,
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
    /// Declares funnels for errors of these units and quantities, with the funnel of an example.
    pub fn declare(
        d: &mut Declaration,
        (units, of_r): (&[&'static str], &[String]),
        [rho_0, rho_inf, decay_rate]: [f64; 3],
    ) -> Self {
        let m = units.len();
        let signal = |name: &str, text: &str| {
            // "bound of the error in the end", "bound of the error of depth in the end"
            let about = text.replacen("error", "error of {}", 1);
            vector(name, m, text).about(of_r, &about).units(units)
        };
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
            on_exit: d.parameter(OnExit::parameter()),
            opened_to: d.discrete(vector("#opened_to", m, "").hidden()),
            opened_at: d.discrete(vector("#opened_at", m, "").hidden()),
            is_positive: (0..m)
                .map(|i| d.discrete(boolean(&format!("#is_positive[{}]", i + 1), "").hidden()))
                .collect(),
            began_inside: d.discrete(boolean("#began_inside", "").hidden()),
            reopened: d.discrete(integer("funnel_reopened", "how often a funnel was re-opened").output()),
            e: d.local(signal("e", "error within the funnel")),
            rho: d.local(signal("rho", "performance function, which bounds the error").source("Hashim (5.3), (6.7)")),
            epsilon: d.local(
                vector("epsilon", m, "transformed error, which is infinite at the funnel's bounds")
                    .source("Hashim (5.6), (6.10), of e/rho"),
            ),
            lower: d.local(signal("funnel_lower", "lower bound of the error").source("Hashim (5.4), (5.5)")),
            upper: d.local(signal("funnel_upper", "upper bound of the error").source("Hashim (5.4), (5.5)")),
            left: d.warning("logFunnel", "an error that left its funnel, which re-opened"),
            angles: Angles::default(),
            indicator: d.indicators(vec![""; m]),
        }
    }

    /// The same where the errors of these channels are those of angles, within half a turn.
    pub fn of_angles(self, angles: Angles) -> Self {
        Funnel { angles, ..self }
    }

    /// Refuses bounds that widen, and those of an angle that are no bounds.
    pub fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        (0..self.rho_0.len()).for_each(|i| v.require_below(self.rho_inf.at(i), self.rho_0.at(i)));
        for i in self.angles.each() {
            let start = self.rho_0.at(i);
            require_below_half_a_turn(v[start], |v| v.name(start), v);
        }
    }

    /// Reports the funnels.
    pub fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        performance::report([self.rho_0, self.rho_inf, self.decay_rate], v, report);
        let overshoot = v[self.overshoot].iter().copied().fold(f64::INFINITY, f64::min);
        match v.get(self.shape).item() {
            Shape::Symmetric => report.add("shape", "symmetric", "", "-rho < e < rho"),
            Shape::NoOvershoot if overshoot > 0.0 => report.add("shape", "no_overshoot", "", ""),
            Shape::NoOvershoot => {
                let overshoot = v.name(self.overshoot);
                let note = format!("with {overshoot} = 0 an error that starts at 0 starts at a bound and is rejected");
                report.add("shape", "no_overshoot", "", &note);
            }
        }
    }

    /// Opens the funnels at the start.
    pub fn open<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        v.put(self.reopened, S::integer(0));
        self.open_anew(t, e, v);
    }

    /// Opens the funnels where a law takes over.
    pub fn open_anew<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        v.copy(self.rho_0, self.opened_to);
        v[self.opened_at].fill(t);
        v.put(self.began_inside, true.into());
        for (i, &is_positive) in self.is_positive.iter().enumerate() {
            let e = e(i, &v.values());
            v.put(is_positive, e.at_least(S::from(0.0)));
            let inside = self.bounds(i, &v.values()).hold(e / v[self.rho_0][i]);
            let all = v.get(self.began_inside) & inside;
            v.put(self.began_inside, all);
        }
    }

    /// Takes the errors as inside, whatever they were at the start: a sampled law begins to look at its first sample.
    pub fn look_from_now_on<S: Scalar>(&self, v: &mut Point<S>) {
        v.put(self.began_inside, true.into());
    }

    /// True if a funnel opens to an error that leaves it.
    pub fn reopens<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.on_exit).is(OnExit::Reopen)
    }

    /// No funnel is open: an error may be anywhere.
    pub fn close<S: Scalar>(&self, v: &mut Point<S>) {
        v.put(self.began_inside, false.into());
    }

    /// Bounds of z in a channel.
    pub fn bounds<S: Scalar>(&self, i: usize, v: &Values<S>) -> Bounds<S> {
        let (full, other) = (S::from(1.0), v[self.overshoot][i]);
        let (is_symmetric, is_positive) = (v.get(self.shape).is(Shape::Symmetric), v.get(self.is_positive[i]));
        Bounds {
            lower: S::select(is_symmetric | !is_positive, full, other),
            upper: S::select(is_symmetric | is_positive, full, other),
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
        let middle = || (bounds.upper - bounds.lower) * 0.5;
        let z = S::branch(v.get(self.began_inside), || e / performance.rho, middle);
        Self::of_part(e, z, performance, bounds)
    }

    /// The same for a controller that samples the error: an error that is outside between samples counts as one in the
    /// middle.
    pub fn inside_between_samples<S: Scalar>(&self, i: usize, t: S, e: S, v: &Values<S>) -> Inside<S> {
        let (performance, bounds) = (self.performance(i, t, v), self.bounds(i, v));
        let z = e / performance.rho;
        let z = S::select(bounds.hold(z), z, (bounds.upper - bounds.lower) * 0.5);
        Self::of_part(e, z, performance, bounds)
    }

    /// The same of an error that isn't taken for another before the simulation either: outside, ε is no number.
    pub fn of_error<S: Scalar>(&self, i: usize, t: S, e: S, v: &Values<S>) -> Inside<S> {
        let (performance, bounds) = (self.performance(i, t, v), self.bounds(i, v));
        Self::of_part(e, e / performance.rho, performance, bounds)
    }

    /// An error, that is z in parts of ρ.
    fn of_part<S: Scalar>(e: S, z: S, performance: Performance<S>, bounds: Bounds<S>) -> Inside<S> {
        let (epsilon, R) = (bounds.transformed(z), bounds.slope(z) / performance.rho);
        Inside { e, performance, bounds, z, epsilon, R }
    }

    /// The smallest distance of a channel's bounds that is to come, halved.
    pub fn narrowest<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        v[self.rho_inf][i]
    }

    /// The name of what [`Funnel::narrowest`] gives, of all channels.
    pub fn name_of_end(&self, v: &Values<f64>) -> String {
        v.name(self.rho_inf)
    }

    /// The errors as they are shown.
    pub fn error(&self) -> VectorOf<Signal> {
        self.e
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

    /// Refuses a funnel of an angle that has opened to half a turn.
    pub fn check_angles<S: Scalar>(&self, v: &mut Point<S>) {
        for i in self.angles.each() {
            let (opened_to, rho) = (v[self.opened_to][i], self.rho.at(i));
            require_below_half_a_turn(opened_to, |v| v.name(rho), v);
        }
    }

    /// Refuses errors that are outside, and advises what helps.
    pub fn check<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        self.check_angles(v);
        for i in 0..self.e.len() {
            let values = v.values();
            let (e, rho, bounds) = (e(i, &values), self.performance(i, t, &values).rho, self.bounds(i, &values));
            v.when(!bounds.hold(e / rho), |v| self.refuse(i, t, (e, rho, bounds), v));
        }
    }

    /// Refuses the error of a channel that is outside.
    fn refuse<S: Scalar>(&self, i: usize, t: S, (e, rho, bounds): (S, S, Bounds<S>), v: &mut Point<S>) {
        let zero = S::from(0.0);
        let (low, high) = (zero - bounds.lower * rho, bounds.upper * rho);
        let by = S::branch(e.above(zero), || e - high, || low - e);
        let begins = v[self.opened_at][i].equals(t) & !v.get(self.began_inside);
        let is_on_other_side = bounds.margin(e.signum()).below(zero) | e.equals(zero);
        let [overshoot, rho_0, rho_inf] = [self.overshoot, self.rho_0, self.rho_inf].map(|it| v.name(it.at(i)));
        let (on_exit, rho_now) = (v.name(self.on_exit), v.name(self.rho.at(i)));
        let (of_rho, of_e) = ((e.abs() / rho).rounded_at_least(), e.abs().rounded_at_least());
        let left = format!(
            "it has left its funnel ({rho_now} = {}). A smaller communication step helps where it is sampled too rarely, a \
             larger {rho_0} or {rho_inf} where it is too narrow; {on_exit} = reopen goes on",
            rho.rounded()
        );
        let answers = [
            (begins & is_on_other_side, format!("{overshoot} above {of_rho} would do")),
            (begins & !is_on_other_side, format!("{rho_0} above {of_e} would do")),
            (!begins, left),
        ];
        let is_at_bound = by.equals(zero);
        let places =
            [(is_at_bound, "is at a bound".to_owned()), (!is_at_bound, format!("is beyond by {}", by.rounded()))];
        for (answers_it, helps) in &answers {
            for (stands_so, place) in &places {
                v.refuse(*answers_it & *stands_so, |v| {
                    let (low, high) = (low.rounded_at_most(), high.rounded_at_most());
                    let allowed = format!("must lie between {low} and {high}, and {place}: {helps}");
                    Invalid::new(v.name(self.e.at(i)), e.to_text(), allowed)
                });
            }
        }
    }

    /// The places of its event indicators.
    pub fn indicators(&self) -> std::ops::Range<usize> {
        self.indicator..self.indicator + self.e.len()
    }

    /// Distance of each error from the place where its funnel re-opens, if it does.
    pub fn event_indicators<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &Values<S>, z: &mut [S]) {
        let reopens = self.reopens(v);
        for i in 0..self.e.len() {
            z[self.indicator + i] = S::branch(reopens, || self.distance(i, t, e(i, v), v), || S::from(1.0));
        }
    }

    fn distance<S: Scalar>(&self, i: usize, t: S, e: S, v: &Values<S>) -> S {
        let bounds = self.bounds(i, v);
        let margin = bounds.margin(e / self.performance(i, t, v).rho) - (bounds.lower + bounds.upper) * EDGE;
        S::select(margin.equals(S::from(0.0)), S::from(-f64::MIN_POSITIVE), margin)
    }

    /// Re-opens the funnels that errors have left.
    pub fn event<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        let reopens = self.reopens(&v.values()) & v.get(self.began_inside);
        v.when(reopens, |v| {
            for i in 0..self.e.len() {
                let error = e(i, &v.values());
                let is_inside = self.distance(i, t, error, &v.values()).above(S::from(0.0));
                v.when(!is_inside, |v| self.reopen(i, t, error, v));
            }
        });
    }

    /// Re-opens the funnel of a channel.
    fn reopen<S: Scalar>(&self, i: usize, t: S, error: S, v: &mut Point<S>) {
        let rho = self.performance(i, t, &v.values()).rho;
        let opened_to = larger(v[self.rho_inf][i], error.abs() * WIDER);
        v[self.opened_to][i] = opened_to;
        v[self.opened_at][i] = t;
        v.put(self.is_positive[i], error.at_least(S::from(0.0)));
        let count = (S::from_integer(v.get(self.reopened)) + 1.0).to_integer();
        v.put(self.reopened, count);
        v.warn(self.left, |v| {
            format!(
                "{} = {} has left its funnel of {} = {} at t = {} s; it was re-opened to {}. {} counts how often that happens",
                v.name(self.e.at(i)),
                error.rounded(),
                v.name(self.rho.at(i)),
                rho.rounded(),
                t.to_text(),
                opened_to.rounded(),
                v.name(self.reopened)
            )
        });
    }
}
