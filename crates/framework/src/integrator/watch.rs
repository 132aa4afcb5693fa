//! Looks at the eigenvalues of the exact Jacobian now and then, and stores the limits that they set.
//!
//! The intervals depend on work only, so that a restored instance looks at the same substeps: the explicit method pays
//! a small part of its work for it. The stiff method has the Jacobian anyway, takes long substeps, and is the one that
//! could pass over growth or a pole, so it looks more often: whenever the Jacobian has changed its size, and after a
//! few substeps.

use super::Pace;
use super::jacobian::Jacobian;
use super::spectrum::Spectrum;
use super::stability::{Limits, Mode};
use super::work::Work;
use crate::system::Variables;

/// Eigenvalues of larger systems take too long; these stay with the explicit method, unless a user asks otherwise.
pub const MOST_STATES: usize = 250;
/// Work of the explicit method between looks, in what a look takes. Far from any limit it may wait longer.
const EXPLICIT_WORK: f64 = 20.0;
const FAR: f64 = 10.0;
const PATIENCE: f64 = 4.0;
/// The same of the stiff method, whose substeps are long.
const STIFF_WORK: f64 = 3.0;
/// The shortest wait, as a part of that.
const LEAST_INTERVAL: f64 = 1e-3;
/// Change of the Jacobian's size, as a factor, after which it is looked at, whatever it takes.
const CHANGE: f64 = 1.25;

/// Looks at eigenvalues.
#[derive(Debug)]
pub struct Watch {
    spectrum: Spectrum,
    /// Work of finding eigenvalues, and of a Jacobian.
    work: [f64; 2],
    /// True if the system is a part of a loop that isn't known.
    open: bool,
    /// The damped mode that set the explicit method's limit at the last look, for messages only.
    damped: Mode,
}

impl Watch {
    /// Watch for a system with these variables; none if it has too many states.
    pub fn new(variables: &Variables) -> Option<Self> {
        let states = variables.states();
        let work = Work::of_states(states);
        let (work, open) = ([work.eigenvalues, work.jacobian], variables.is_open());
        let watch = || Watch { spectrum: Spectrum::new(states), work, open, damped: Mode::default() };
        (1..=MOST_STATES).contains(&states).then(watch)
    }

    /// True if the explicit method has to look.
    pub fn is_due(&self, pace: &Pace) -> bool {
        pace.until_look <= 0.0
    }

    /// Looks at a Jacobian that was computed for that, for the explicit method.
    pub fn look_for_explicit(&mut self, jacobian: &Jacobian, way: f64, pace: &mut Pace) {
        self.look(jacobian, pace);
        let work = self.work[0] + self.work[1];
        let far = way * pace.limits.order_5.both() * FAR < 1.0;
        pace.until_look = EXPLICIT_WORK * work * if far { PATIENCE } else { 1.0 };
    }

    /// Looks at the Jacobian of the stiff method's substep, if that is due or it has changed. Returns true if it did.
    pub fn look_for_stiff(&mut self, jacobian: &mut Jacobian, nominals: &[f64], way: f64, pace: &mut Pace) -> bool {
        let size = jacobian.size(nominals);
        let changed = size > CHANGE * pace.jacobian_size || pace.jacobian_size > CHANGE * size;
        if pace.until_look > 0.0 && !changed {
            return false;
        }
        let before = pace.limits;
        self.look(jacobian, pace);
        pace.limits.remember(&before);
        pace.jacobian_size = size;
        // Growth that has to be followed may come and go: it is looked for in each substep, then ever more rarely.
        let most = STIFF_WORK * self.work[0];
        let follows = pace.limits.stiff * way > 1.0;
        pace.interval = if follows { 0.0 } else { (2.0 * pace.interval).clamp(LEAST_INTERVAL * most, most) };
        pace.until_look = pace.interval;
        true
    }

    /// There are no eigenvalues now; the explicit method will look again.
    pub fn nothing_seen(&self, pace: &mut Pace) {
        pace.limits = Limits::default();
        pace.until_look = EXPLICIT_WORK * (self.work[0] + self.work[1]);
    }

    /// The damped mode that holds the explicit method to the shortest substeps, and these, s, where one does.
    pub fn holds(&self, pace: &Pace) -> Option<(Mode, f64)> {
        let stable = pace.limits.order_5.stable;
        (stable > 0.0 && self.damped != Mode::default()).then(|| (self.damped, stable.recip()))
    }

    fn look(&mut self, jacobian: &Jacobian, pace: &mut Pace) {
        let carried = pace.limits.carried;
        (pace.limits, self.damped) = if self.spectrum.find(jacobian.by_states()) {
            Limits::with_damped(&self.spectrum, self.open)
        } else {
            Default::default()
        };
        pace.limits.keep_carrying(carried);
    }
}
