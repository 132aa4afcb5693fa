//! How long a control has stood at its limit: where that lasts, the plant needs more than there is, and no law helps.

use crate::report::number;
use crate::system::{Declaration, Discrete, Parameter, Point, ScalarOf, Signal, VectorOf, Warning, scalar, vector};

/// A control, and the limits that keep it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limited {
    pub u: VectorOf<Signal>,
    pub u_min: VectorOf<Parameter>,
    pub u_max: VectorOf<Parameter>,
}

/// Looks at a control when a step is completed.
#[derive(Debug)]
pub(super) struct AtLimit {
    limited: Limited,
    /// At which limit each channel stands: −1 at the lower, 1 at the upper, 0 at none.
    side: VectorOf<Discrete>,
    /// Since when, s.
    since: VectorOf<Discrete>,
    /// For how long, of the channel that does so longest, s.
    longest: ScalarOf<Discrete>,
    warning: Warning,
}

impl AtLimit {
    /// Of a control.
    pub fn declare(d: &mut Declaration, limited: Limited) -> Self {
        let m = limited.u.len();
        let text = "how long a control has stood at its limit without leaving it, the longest of all channels; 0 while none \
                    does";
        AtLimit {
            limited,
            side: d.discrete(vector("#limit", m, "").hidden()),
            since: d.discrete(vector("#at the limit since", m, "").hidden()),
            longest: d.discrete(scalar("time_at_limit", text).unit("s").output()),
            warning: d.warning("logLimit", "a control at its limit for as long as the desired dynamics take to settle"),
        }
    }

    /// Looks at the control at t, and warns once where one has stood at its limit for so long.
    pub fn look(&self, t: f64, settling_time: f64, v: &mut Point) {
        let Limited { u, u_min, u_max } = self.limited;
        let (mut longest, mut channel) = (0.0, None);
        for i in 0..u.len() {
            let side = if v[u][i] >= v[u_max][i] {
                1.0
            } else if v[u][i] <= v[u_min][i] {
                -1.0
            } else {
                0.0
            };
            if side != v[self.side][i] {
                (v[self.side][i], v[self.since][i]) = (side, t);
            }
            let time = if side == 0.0 { 0.0 } else { t - v[self.since][i] };
            if time > longest {
                (longest, channel) = (time, Some(i));
            }
        }
        v[self.longest] = longest;
        let Some(i) = channel.filter(|_| longest >= settling_time) else { return };
        let limit = if v[self.side][i] > 0.0 { "u_max" } else { "u_min" };
        v.warn(self.warning, || {
            format!(
                "u[{0}] has stood at its limit {limit}[{0}] for {1} s, as long as the desired dynamics take to settle: where \
                 that lasts, the plant needs more than there is. time_at_limit tells how long; let the reference ask for \
                 less at a time, or take slower poles",
                i + 1,
                number(longest)
            )
        });
    }
}
