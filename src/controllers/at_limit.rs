//! Time that a control has been at its limit. If it lasts, the actuator is too weak, and no controller helps.

use crate::design::robustness::report::Unit;
use crate::system::{
    Declaration, Discrete, Input, Many, Parameter, Point, Scalar, ScalarOf, Signal, Spec, Values, VectorOf, Warning,
    larger, scalar, vector,
};

/// A control, and the limits that keep it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limited {
    pub u: VectorOf<Signal>,
    pub u_min: VectorOf<Parameter>,
    pub u_max: VectorOf<Parameter>,
}

impl Limited {
    /// A control of these units and quantities, its limits with the end of their description, and its source.
    pub fn declare(
        d: &mut Declaration,
        (units, of_u): (&[&'static str], &[String]),
        limit: &str,
        source: &'static str,
    ) -> Self {
        let limited = |name: &str, size: &str| {
            let (text, about) = (format!("{size} control {limit}"), format!("{size} {{}} {limit}"));
            vector(name, units.len(), &text).about(of_u, &about).units(units)
        };
        let u = vector("u", units.len(), "control").about(of_u, "commanded {}").units(units).source(source);
        Limited {
            u: d.output(u),
            u_min: d.parameter(limited("u_min", "smallest").no_lower_limit()),
            u_max: d.parameter(limited("u_max", "largest").no_upper_limit()),
        }
    }
}

/// The control of so many channels that was declared last, before its limits cut it.
pub(super) fn unlimited(d: &mut Declaration, channels: usize) -> VectorOf<Signal> {
    d.behind_output(vector("#u without limits", channels, ""))
}

/// The achieved control, of these units and quantities, if something behind the controller limits it further: an input
/// of a controller that accounts for it.
pub(super) fn achieved(
    d: &mut Declaration,
    is_known: bool,
    (units, of_u): (&[&'static str], &[String]),
) -> Option<VectorOf<Input>> {
    let text = "control that the actuators achieve of u";
    let spec =
        || vector("u_achieved", units.len(), text).about(of_u, "{} that the actuators achieve of u").units(units);
    is_known.then(|| d.input(spec()))
}

/// The control by hand, of these units and quantities.
pub(super) fn manual(units: &[&'static str], of_u: &[String]) -> Spec<Many> {
    let text = "control while the controller is not enabled";
    vector("u_manual", units.len(), text).about(of_u, "{} while the controller is not enabled").units(units)
}

/// Warning of a controller that guarantees errors within funnels only while no control is at a limit.
#[derive(Debug)]
pub(super) struct Guarantee {
    limited: Limited,
    warning: Warning,
}

impl Guarantee {
    /// The guarantee of a control. The text describes the category, unless it has been declared before.
    pub fn declare(d: &mut Declaration, limited: Limited, category: &'static str) -> Self {
        Guarantee { limited, warning: d.warning("logFunnel", category) }
    }

    /// Warns once if a control is at its limit at t. Otherwise these errors stay in their funnels.
    pub fn look<S: Scalar>(&self, t: S, errors: VectorOf<Signal>, v: &mut Point<S>) {
        let Limited { u, u_min, u_max } = self.limited;
        for k in 0..u.len() {
            let is_at_limit = v[u][k].at_most(v[u_min][k]) | v[u][k].at_least(v[u_max][k]);
            v.when(is_at_limit, |v| {
                v.warn(self.warning, |v| {
                    format!(
                        "{} is at its limit at t = {} s: meanwhile it isn't guaranteed that {} stays in its funnel",
                        v.name(u.at(k)),
                        t.to_text(),
                        v.name(errors)
                    )
                });
            });
        }
    }
}

/// Description of the category if funnels re-open, too.
pub(super) const REOPENED_OR_AT_LIMIT: &str =
    "an error that left its funnel, which re-opened; a control at its limit, where the funnel isn't guaranteed";

/// Looks at a control when a step is completed.
#[derive(Debug)]
pub(super) struct AtLimit {
    limited: Limited,
    /// Limit at which each channel is: −1 the lower, 1 the upper, 0 none.
    side: VectorOf<Discrete>,
    /// Since when, s.
    since: VectorOf<Discrete>,
    /// For how long, of the channel that does so longest, s.
    longest: ScalarOf<Discrete>,
    warning: Warning,
}

impl AtLimit {
    /// Declares the watch on a control.
    pub fn declare(d: &mut Declaration, limited: Limited) -> Self {
        let m = limited.u.len();
        let text = "time for which a control has been at its limit, the longest of all channels; 0 if none is";
        AtLimit {
            limited,
            side: d.discrete(vector("#limit", m, "").hidden()),
            since: d.discrete(vector("#at the limit since", m, "").hidden()),
            longest: d.discrete(scalar("time_at_limit", text).unit("s").output()),
            warning: d.warning("logLimit", "a control at its limit for a settling time"),
        }
    }

    /// Checks the control at t, and warns once if one has been at its limit for so long. Under manual control, a limit
    /// shows nothing about the design, and there is no warning.
    pub fn look<S: Scalar>(&self, t: S, settling_time: S, is_active: S::Flag, v: &mut Point<S>) {
        let Limited { u, u_min, u_max } = self.limited;
        let none = S::from(0.0);
        let mut longest = none;
        for i in 0..u.len() {
            let (is_above, is_below) = (v[u][i].at_least(v[u_max][i]), v[u][i].at_most(v[u_min][i]));
            let side = S::select(is_above, S::from(1.0), S::select(is_below, S::from(-1.0), none));
            v[self.since][i] = S::select(side.equals(v[self.side][i]), v[self.since][i], t);
            v[self.side][i] = side;
            longest = larger(longest, self.time(i, t, v));
        }
        v[self.longest] = longest;
        let lasts = is_active & longest.above(none) & longest.at_least(settling_time);
        v.when(lasts, |v| (0..u.len()).for_each(|i| self.warn(i, t, v)));
    }

    /// Time that a channel has been at its limit.
    fn time<S: Scalar>(&self, channel: usize, t: S, v: &Point<S>) -> S {
        let none = S::from(0.0);
        S::select(v[self.side][channel].equals(none), none, t - v[self.since][channel])
    }

    /// Warns of a channel if it has been at its limit longest.
    fn warn<S: Scalar>(&self, channel: usize, t: S, v: &mut Point<S>) {
        let Limited { u, u_min, u_max } = self.limited;
        let longest = v[self.longest];
        let is_it = self.time(channel, t, v).equals(longest);
        let is_upper = v[self.side][channel].above(S::from(0.0));
        for (which, limit) in [(is_upper, u_max), (!is_upper, u_min)] {
            v.when(is_it & which, |v| {
                v.warn(self.warning, |v| {
                    let [u, limit, time] = [v.name(u.at(channel)), v.name(limit.at(channel)), v.name(self.longest)];
                    format!(
                        "{u} has been at its limit {limit} for {} s (one settling time): the actuator may be too weak for \
                         this reference. {time} shows for how long. Let the reference change more slowly, or choose \
                         slower poles",
                        longest.rounded()
                    )
                });
            });
        }
    }
}

/// Controls, their limits and a communication step, s, for a design report.
pub fn unit<'a>(u: VectorOf<Signal>, limits: [VectorOf<Parameter>; 2], v: &'a Values<f64>, step: f64) -> Unit<'a> {
    Unit { controls: (0..u.len()).map(|j| v.name(u.at(j))).collect(), limits: limits.map(|limit| &v[limit]), step }
}
