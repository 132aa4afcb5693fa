//! Choice between automatic and manual control.

use crate::system::{BooleanOf, Declaration, Discrete, Input, Many, Point, Scalar, Spec, Values, VectorOf, boolean};

/// `enabled`, the control by hand, and what follows where `enabled` changes.
#[derive(Debug, Clone, Copy)]
pub(super) struct InCommand {
    enabled: BooleanOf<Input>,
    /// The control while the controller is not enabled.
    pub u_manual: VectorOf<Input>,
    /// `enabled` as of the last event.
    active: BooleanOf<Discrete>,
    indicator: usize,
}

impl InCommand {
    /// Declares the inputs of a standalone controller; the text describes how it takes over.
    pub fn declare(d: &mut Declaration, takes_over: &str, u_manual: Spec<Many>) -> Self {
        let text = format!("whether the controller is in command; {takes_over}");
        let enabled = d.input(boolean("enabled", &text).start(true));
        let u_manual = d.input(u_manual);
        Self::by(d, enabled, u_manual)
    }

    /// Uses inputs that exist already.
    pub fn by(d: &mut Declaration, enabled: BooleanOf<Input>, u_manual: VectorOf<Input>) -> Self {
        InCommand {
            enabled,
            u_manual,
            active: d.discrete(boolean("#active", "").start(true).hidden()),
            indicator: d.indicators(["who is in command"]),
        }
    }

    /// Reads `enabled` at the start; returns true if the controller is in command.
    pub fn begin<S: Scalar>(&self, v: &mut Point<S>) -> S::Flag {
        let enabled = v.get(self.enabled);
        v.put(self.active, enabled);
        enabled
    }

    /// True if the controller is in command.
    pub fn is_active<S: Scalar>(&self, v: &Values<S>) -> S::Flag {
        v.get(self.active)
    }

    /// Negative when `enabled` has changed.
    pub fn event_indicators<S: Scalar>(&self, v: &Values<S>, z: &mut [S]) {
        let (enabled, active) = (v.get(self.enabled), self.is_active(v));
        let is_same = (enabled & active) | (!enabled & !active);
        z[self.indicator] = S::select(is_same, S::from(1.0), S::from(-1.0));
    }

    /// Hands over to manual control, or has the controller take over, if `enabled` has changed.
    pub fn event<S: Scalar>(&self, v: &mut Point<S>, take_over: impl FnOnce(&mut Point<S>)) {
        let enabled = v.get(self.enabled);
        let takes_over = enabled & !self.is_active(&v.values());
        v.when(takes_over, take_over);
        v.put(self.active, enabled);
    }
}
