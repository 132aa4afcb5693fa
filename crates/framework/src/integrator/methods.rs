//! The methods for a system, and the choice between them.

use std::sync::Arc;

use super::chosen::{Choices, Chosen, Integrates};
use super::dop853::Dop853;
use super::dormand_prince::DormandPrince;
use super::own_step::OwnStep;
use super::rosenbrock::Rosenbrock;
use super::stability::{ExplicitLimits, Limits, Mode};
use super::watch::Watch;
use super::work::Work;
use super::{OneStepMethod, Problem, Sparsity, Start};
use crate::kernel::Kernel;
use crate::system::{Choice, DynSystem, Variables};

/// The stiff method is dense: beyond this number of states its matrices have no place in an instance.
const MOST_STATES: usize = 2000;
/// A substep above this part of what stability allows counts as limited by it.
const LIMITED: f64 = 0.5;
/// Surplus of substeps in favour of the explicit method at which it is taken.
const EVIDENCE: i32 = 15;
/// Evidence isn't counted beyond this, where the method is one that was asked for.
pub const MOST_EVIDENCE: i32 = 1_000_000_000;
/// Factor on the evidence for the next trial after a change back to the explicit method.
const PATIENCE: i32 = 4;

/// General method that integrates a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntegrationMethod {
    /// The system's own step, where it has one; else the explicit one, and the stiff one while that takes less work.
    Automatic,
    /// Dormand and Prince's, of order 5.
    Explicit,
    /// Rosenbrock's.
    Stiff,
    /// The classical Runge–Kutta method, by steps of fixed length.
    Fixed,
}

impl Choice for IntegrationMethod {
    const TYPE: &'static str = "IntegrationMethod";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (
            Self::Automatic,
            "automatic",
            "the closed-form step of an adaptive law where there is one; else explicit, of order 5 or 8 by what takes \
             less work, and stiff while the explicit methods would need many more steps",
        ),
        (
            Self::Explicit,
            "explicit",
            "explicit Runge-Kutta method of order 5: cheap steps, for systems that are not stiff",
        ),
        (
            Self::Stiff,
            "stiff",
            "L-stable Rosenbrock method of order 5 with exact Jacobians: long steps of stiff systems",
        ),
        (
            Self::Fixed,
            "fixed",
            "Runge-Kutta method of order 4 with fixed_steps steps and no error control: for targets",
        ),
    ];
}

impl IntegrationMethod {
    /// True if there is a choice: not without states, or with too many for the stiff method.
    pub fn offered(states: usize) -> bool {
        (1..=MOST_STATES).contains(&states)
    }
}

/// Integration's state between steps, stored in the instance's block.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pace {
    /// The substep to begin with, of a general method; 0 where none is known yet.
    pub substep: f64,
    /// The same of the explicit method of order 8.
    pub substep_8: f64,
    /// The same of the system's own step.
    pub own_substep: f64,
    /// True if the stiff method is in force.
    pub stiff: bool,
    /// Substeps that spoke for the other method, less those that didn't.
    pub evidence: i32,
    /// Limits set by the eigenvalues.
    pub limits: Limits,
    /// Size of the Jacobian at the stiff method's last look at its eigenvalues, 1/s.
    pub jacobian_size: f64,
    /// Work until the next look.
    pub until_look: f64,
    /// Work between the last looks of the stiff method.
    pub interval: f64,
}

/// The explicit method of order 8 is taken where it gets along with this part of the work of that of order 5.
const PAYS: f64 = 0.8;
/// Assumed length of its substeps before the first trial, in those of order 5.
const TIMES_AS_LONG: f64 = 2.0;
/// Factor by which the length expected of the other explicit method grows with each suggestion, in addition to the
/// change of the suggestion itself; the two lengths differ at most by the factor `APART`.
const EXPECTED: f64 = 1.02;
const APART: f64 = 8.0;
/// Factor on the expected length of the system's own step for each communication step in which it isn't tried.
const HOPE: f64 = 1.2;

/// The methods for a system.
///
/// A system's own step is taken where it pays, and given up for the rest of a communication step where it finds itself
/// impossible, or would have to be so short that it doesn't pay.
///
/// There are two explicit methods, of order 5 and 8. Each substep uses the one that is expected to reach the end with
/// less work, by the substeps that error control and the eigenvalues allow each.
///
/// Between general methods the eigenvalues of the exact Jacobian choose, and work. A substep of an explicit method
/// speaks for the stiff one where its stability limits it, for one mode or another that is damped, and the stiff method
/// need not follow a mode that isn't. One that goes the whole way can't be beaten. A substep of the stiff method speaks
/// for the explicit one where that would take less work within its own limits. The stiff method is tried when the
/// explicit one has worked as long as a trial takes, so that a trial never costs more than what it may save.
pub struct Methods {
    explicit: DormandPrince,
    order_8: Dop853,
    stiff: Option<Box<Rosenbrock>>,
    own: Option<OwnStep>,
    watch: Option<Watch>,
    /// Choices so far, for messages only.
    choices: Choices,
    nominals: Vec<f64>,
    /// True if the system's own step is in force, and whether it was given up for the rest of a communication step.
    /// Both are decided anew in each.
    by_itself: bool,
    given_up: bool,
    /// True if an explicit substep uses the method of order 8. Decided anew in each.
    by_order_8: bool,
    work: Work,
    /// Work of a typical system with this number of states, on which choices depend.
    typical: Work,
    /// Work of a stiff substep in explicit ones.
    relative_work: f64,
    /// Surplus of substeps in favour of the stiff method at which it is tried: they take as long as a trial that ends
    /// with the evidence for the explicit method.
    trial: i32,
}

impl Methods {
    /// The methods for a system whose states have these magnitudes.
    pub fn new(system: &dyn DynSystem, variables: &Variables, sparsity: &Arc<Sparsity>, nominals: Vec<f64>) -> Self {
        let (states, work) = (variables.states(), Work::of(variables));
        let stiff = IntegrationMethod::offered(states).then(|| Box::new(Rosenbrock::new(variables, sparsity)));
        let own = system.own_step().map(|own| OwnStep::new(own, variables));
        let typical = Work::of_states(states);
        let relative_work = (typical.stiff + typical.jacobian) / typical.explicit;
        Methods {
            explicit: DormandPrince::new(variables),
            order_8: Dop853::new(states),
            stiff,
            own,
            watch: Watch::new(variables),
            choices: Choices::default(),
            typical,
            nominals,
            by_itself: false,
            given_up: false,
            by_order_8: false,
            work,
            relative_work,
            trial: (relative_work * f64::from(EVIDENCE)) as i32,
        }
    }

    /// Takes what steps of a problem need, before the first.
    pub fn prepare(&mut self, problem: &Problem) {
        if let Some(stiff) = &mut self.stiff {
            stiff.prepare(problem);
        }
    }

    /// Takes storage for a kernel.
    pub fn take_kernel(&mut self, kernel: &Kernel) {
        if let Some(stiff) = &mut self.stiff {
            stiff.take_kernel(kernel);
        }
    }

    /// The explicit method.
    pub fn explicit(&mut self) -> &mut dyn OneStepMethod {
        &mut self.explicit
    }

    /// True if the system's own step is in force.
    pub fn by_itself(&self) -> bool {
        self.by_itself
    }

    /// Begins a communication step.
    pub fn restart(&mut self) {
        self.given_up = false;
    }

    /// Notes the integration method from a time on, for reports.
    pub fn note(&mut self, asked: IntegrationMethod, from: f64, pace: &Pace) {
        let by = match asked {
            IntegrationMethod::Fixed => Integrates::Fixed,
            _ if self.by_itself => Integrates::OwnStep,
            _ if pace.stiff => Integrates::Stiff,
            _ => Integrates::Explicit,
        };
        let is_asked_for = asked != IntegrationMethod::Automatic;
        let holds = self.watch.as_ref().and_then(|watch| watch.holds(pace));
        self.choices.note(Chosen { by, is_asked_for, holds, from, is_last: false });
    }

    /// The latest choice that wasn't reported yet.
    pub fn news(&mut self) -> Option<Chosen> {
        self.choices.take()
    }

    /// Forgets all choices, so that reports restart.
    pub fn forget_choices(&mut self) {
        self.choices = Choices::default();
    }

    /// Leaves the rest of a communication step to a general method.
    pub fn give_up_own_step(&mut self) {
        (self.by_itself, self.given_up) = (false, true);
    }

    /// The method in force.
    pub fn in_force(&mut self, pace: &Pace) -> &mut dyn OneStepMethod {
        match (&mut self.own, &mut self.stiff) {
            (Some(own), _) if self.by_itself => own,
            (_, Some(stiff)) if pace.stiff => stiff.as_mut(),
            _ if self.by_order_8 => &mut self.order_8,
            _ => &mut self.explicit,
        }
    }

    /// The substep that is suggested to the method in force; 0 where none is known yet.
    pub fn suggested(&self, pace: &Pace) -> f64 {
        match () {
            () if self.by_itself => pace.own_substep,
            () if self.by_order_8 && !pace.stiff => pace.substep_8,
            () => pace.substep,
        }
    }

    /// Suggests a substep to the method in force. What the solution asks of one explicit method, it asks of the other.
    pub fn suggest(&self, h: f64, pace: &mut Pace) {
        if self.by_itself {
            pace.own_substep = h;
            return;
        }
        let by_8 = self.by_order_8 && !pace.stiff;
        let (suggested, other) =
            if by_8 { (&mut pace.substep_8, &mut pace.substep) } else { (&mut pace.substep, &mut pace.substep_8) };
        if *suggested > 0.0 && *other > 0.0 {
            *other = (EXPECTED * *other * (h / *suggested)).clamp(h / APART, h * APART);
        }
        *suggested = h;
    }

    /// The longest substep that the eigenvalues allow the method in force, s.
    pub fn longest(&self, pace: &Pace) -> f64 {
        let limit = match () {
            () if self.by_itself => 0.0,
            () if pace.stiff => pace.limits.stiff,
            () => self.explicit_limits(pace).both(),
        };
        if limit > 0.0 { limit.recip() } else { f64::INFINITY }
    }

    /// Limits of the explicit method in force, from the eigenvalues.
    fn explicit_limits(&self, pace: &Pace) -> ExplicitLimits {
        if self.by_order_8 { pace.limits.order_8 } else { pace.limits.order_5 }
    }

    /// The mode whose growth limits the method in force, if one does.
    pub fn followed(&self, pace: &Pace) -> Option<Mode> {
        let explicit = self.explicit_limits(pace);
        let limited = if pace.stiff { pace.limits.stiff > 0.0 } else { explicit.growing > explicit.stable };
        (limited && !self.by_itself).then_some(pace.limits.mode)
    }

    /// Work of an evaluation.
    pub fn evaluation(&self) -> f64 {
        self.work.evaluation
    }

    /// The same as counted until the next look at eigenvalues.
    pub fn typical_work(&self, pace: &Pace) -> f64 {
        match () {
            () if self.by_itself || pace.stiff => self.typical.stiff + self.typical.jacobian,
            () if self.by_order_8 => self.typical.order_8,
            () => self.typical.explicit,
        }
    }

    /// Work of an attempt by the method in force; that of a system's own counts as a stiff one's.
    pub fn work(&self, pace: &Pace) -> f64 {
        match () {
            () if self.by_itself || pace.stiff => self.work.stiff,
            () if self.by_order_8 => self.work.order_8,
            () => self.work.explicit,
        }
    }

    /// Chooses the method of the substep from the problem's present point, with this length left and this relative
    /// tolerance, and prepares it. Returns the work of that.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number, if the stiff method was asked for.
    pub fn begin(
        &mut self,
        problem: &Problem,
        start: &Start,
        (asked, way, tolerance): (IntegrationMethod, f64, f64),
        pace: &mut Pace,
    ) -> Result<f64, usize> {
        self.by_itself = asked == IntegrationMethod::Automatic
            && self.own.is_some()
            && !self.given_up
            && self.own_step_pays(problem, way, tolerance, pace);
        match asked {
            IntegrationMethod::Automatic if self.by_itself => return Ok(0.0),
            IntegrationMethod::Explicit | IntegrationMethod::Fixed => pace.stiff = false,
            IntegrationMethod::Stiff => pace.stiff = self.stiff.is_some(),
            IntegrationMethod::Automatic if pace.evidence < if pace.stiff { EVIDENCE } else { self.trial } => {}
            IntegrationMethod::Automatic => self.change(pace),
        }
        if pace.stiff {
            match self.begin_stiff(problem, start, way, pace) {
                Err(_) if asked == IntegrationMethod::Automatic => self.change(pace),
                result => return result,
            }
        }
        let work = self.begin_explicit(problem, start, way, pace);
        self.by_order_8 = asked == IntegrationMethod::Automatic && self.order_8_pays(way, pace);
        if self.by_order_8 && pace.substep_8 == 0.0 {
            pace.substep_8 = TIMES_AS_LONG * pace.substep;
        }
        Ok(work)
    }

    /// True if the explicit method of order 8 is expected to go so far with less work than that of order 5.
    fn order_8_pays(&self, way: f64, pace: &Pace) -> bool {
        let substeps = |limits: ExplicitLimits, suggested: f64| {
            let most = if suggested > 0.0 { limits.both().max(suggested.recip()) } else { limits.both() };
            (way * most).ceil().max(1.0)
        };
        let suggested = if pace.substep_8 > 0.0 { pace.substep_8 } else { TIMES_AS_LONG * pace.substep };
        let work = self.typical.order_8 * substeps(pace.limits.order_8, suggested);
        work < PAYS * self.typical.explicit * substeps(pace.limits.order_5, pace.substep)
    }

    /// Prepares a substep of the stiff method.
    fn begin_stiff(&mut self, problem: &Problem, start: &Start, way: f64, pace: &mut Pace) -> Result<f64, usize> {
        let Some(stiff) = &mut self.stiff else { return Ok(0.0) };
        stiff.begin(problem, start)?;
        let looked = |watch: &mut Watch| watch.look_for_stiff(stiff.jacobian(), &self.nominals, way, pace);
        let looked = self.watch.as_mut().is_some_and(looked);
        Ok(self.work.jacobian + if looked { self.work.eigenvalues } else { 0.0 })
    }

    /// Prepares a substep of the explicit method, which needs the Jacobian for its eigenvalues only.
    fn begin_explicit(&mut self, problem: &Problem, start: &Start, way: f64, pace: &mut Pace) -> f64 {
        let (Some(watch), Some(stiff)) = (&mut self.watch, &mut self.stiff) else { return 0.0 };
        if !watch.is_due(pace) {
            return 0.0;
        }
        if stiff.begin(problem, start).is_err() {
            watch.nothing_seen(pace);
            return self.work.jacobian;
        }
        watch.look_for_explicit(stiff.jacobian(), way, pace);
        self.work.jacobian + self.work.eigenvalues
    }

    /// True if the system's own step pays with the length that it is expected to have. Where that is too short it isn't
    /// tried in this communication step, and expected to be longer in the next, so that it is tried now and then.
    fn own_step_pays(&mut self, problem: &Problem, way: f64, tolerance: f64, pace: &mut Pace) -> bool {
        let pays = |h: f64| problem.system.own_step().is_some_and(|own| own.pays(h, tolerance, &problem.values()));
        if pace.own_substep == 0.0 || pace.own_substep >= way {
            return pays(way);
        }
        if pays(pace.own_substep) {
            return true;
        }
        if pays(way) {
            pace.own_substep *= HOPE;
            self.given_up = true;
        }
        false
    }

    fn change(&self, pace: &mut Pace) {
        pace.evidence = if pace.stiff { -PATIENCE * self.trial } else { 0 };
        pace.stiff = !pace.stiff;
        // The other method's limits are looked at before it goes anywhere.
        pace.until_look = 0.0;
    }

    /// Counts the accepted substep h, after its attempt, for or against the method in force. `whole`: it went all the
    /// way to where it had to end.
    pub fn judge(&mut self, (h, whole): (f64, bool), pace: &mut Pace) {
        if self.watch.is_none() || self.by_itself {
            return;
        }
        let (stable, stiff) = (self.explicit_limits(pace).stable, pace.limits.stiff);
        // In substeps of order 5 that take as much work as those of order 8, where these pay.
        let of_8 = pace.limits.order_8.both() * (self.typical.order_8 / (PAYS * self.typical.explicit));
        let explicit = pace.limits.order_5.both().min(of_8);
        let against = if pace.stiff {
            // Half the work: a system at the border stays with what it has.
            h * explicit < 0.5 * self.relative_work
        } else {
            !whole && h * stable > LIMITED && stiff * self.relative_work < explicit
        };
        if against {
            pace.evidence += i32::from(pace.evidence < MOST_EVIDENCE);
        } else if pace.evidence > 0 {
            pace.evidence -= 1;
        }
    }
}
