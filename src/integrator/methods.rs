//! The methods for a system, and the choice between them.

use super::dormand_prince::DormandPrince;
use super::own_step::OwnStep;
use super::rosenbrock::Rosenbrock;
use super::{OneStepMethod, Problem, Start};
use crate::system::{Choice, DynSystem, Variables};

/// The stiff method is dense: beyond this number of states its matrices have no place in an instance.
const MOST_STATES: usize = 2000;
/// Where stability limits the explicit method, step-size control keeps h |λ| at about this. (The limit itself is 3.3.)
const LIMIT: f64 = 2.8;
/// A substep above this part of [`LIMIT`] counts as limited by stability.
const LIMITED: f64 = 0.9;
/// How many more substeps must speak for the explicit method than against it before it is taken.
const EVIDENCE: i32 = 15;
/// After a change back to the explicit method, the next trial takes so many times the evidence more.
const PATIENCE: i32 = 4;

/// Which general method integrates a system.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntegrationMethod {
    /// The system's own step, where it has one; else the explicit one, and the stiff one while that takes less work.
    Automatic,
    /// Dormand and Prince's.
    Explicit,
    /// Rosenbrock's.
    Stiff,
}

impl Choice for IntegrationMethod {
    const TYPE: &'static str = "IntegrationMethod";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (
            Self::Automatic,
            "automatic",
            "the closed-form step of an adaptive law where there is one; else explicit, and stiff while the explicit \
             method would need many more steps",
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
    ];
}

impl IntegrationMethod {
    /// Whether there is a choice: not without states, or with too many for the stiff method.
    pub fn offered(states: usize) -> bool {
        (1..=MOST_STATES).contains(&states)
    }
}

/// What a continuation goes on with. It lies in the instance's block between steps.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pace {
    /// The substep to begin with, of a general method; 0 where none is known yet.
    pub substep: f64,
    /// The same of the system's own step.
    pub own_substep: f64,
    /// Whether the stiff method is in force.
    pub stiff: bool,
    /// Substeps that spoke for the other method, less those that didn't.
    pub evidence: i32,
}

impl Pace {
    /// The substep of the system's own step, or of a general method.
    pub fn substep_of(&mut self, own: bool) -> &mut f64 {
        if own { &mut self.own_substep } else { &mut self.substep }
    }
}

/// The methods for a system.
///
/// A system's own step is taken where it pays, and given up for the rest of a communication step where it finds itself
/// impossible, or would have to be so short that it doesn't pay. Between general methods the choice follows Hairer and Wanner (Solving Ordinary Differential Equations II, IV.2), with the work in it.
/// A substep h of the explicit method speaks for the stiff one where its stability limits it, as h |λ| tells, λ being
/// the eigenvalue of the largest magnitude. One that goes the whole way can't be beaten. A substep of the stiff method
/// speaks for the explicit one where that would take less work within its stability. The stiff method is tried
/// when the explicit one has worked as long as a trial takes, so that a trial never costs more than what it may save.
/// Fast oscillations that are hardly damped limit the explicit method before h |λ| tells: for those a user may ask
/// for the stiff method.
pub struct Methods {
    explicit: DormandPrince,
    stiff: Option<Box<Rosenbrock>>,
    own: Option<OwnStep>,
    /// Whether the system's own step is in force, and whether it was given up for the rest of a communication step.
    /// Both are decided anew in each.
    by_itself: bool,
    given_up: bool,
    /// Work of a stiff substep in explicit ones.
    work: f64,
    /// How many more substeps must speak for the stiff method than against it before it is tried: they take as long
    /// as a trial that ends with the evidence for the explicit method.
    trial: i32,
}

impl Methods {
    /// The methods for a system.
    pub fn new(system: &dyn DynSystem, variables: &Variables) -> Self {
        let states = variables.states();
        let stiff = IntegrationMethod::offered(states).then(|| Box::new(Rosenbrock::new(variables)));
        let own = system.steps_itself().then(|| OwnStep::new(system, variables));
        let work = relative_work(states as f64);
        let (explicit, trial) = (DormandPrince::new(variables), (work * f64::from(EVIDENCE)) as i32);
        Methods { explicit, stiff, own, by_itself: false, given_up: false, work, trial }
    }

    /// The explicit method.
    pub fn explicit(&mut self) -> &mut dyn OneStepMethod {
        &mut self.explicit
    }

    /// Whether the system's own step is in force.
    pub fn by_itself(&self) -> bool {
        self.by_itself
    }

    /// Begins a communication step.
    pub fn restart(&mut self) {
        self.given_up = false;
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
            _ => &mut self.explicit,
        }
    }

    /// Work of a substep by the method in force, in explicit ones; that of a system's own counts as a stiff one's.
    pub fn work(&self, pace: &Pace) -> f64 {
        if self.by_itself || pace.stiff { self.work } else { 1.0 }
    }

    /// Decides by which method the substep goes that begins where the problem stands, with so long a way to go, and
    /// prepares it.
    ///
    /// # Errors
    /// The state whose rate has a derivative that is no number, if the stiff method was asked for.
    pub fn begin(
        &mut self,
        problem: &Problem,
        start: &Start,
        (asked, way): (IntegrationMethod, f64),
        pace: &mut Pace,
    ) -> Result<(), usize> {
        self.by_itself = asked == IntegrationMethod::Automatic
            && self.own.is_some()
            && !self.given_up
            && problem.system.own_step_pays(way, &problem.values());
        match asked {
            IntegrationMethod::Automatic if self.by_itself => return Ok(()),
            IntegrationMethod::Explicit => pace.stiff = false,
            IntegrationMethod::Stiff => pace.stiff = self.stiff.is_some(),
            IntegrationMethod::Automatic if pace.evidence < if pace.stiff { EVIDENCE } else { self.trial } => {}
            IntegrationMethod::Automatic => self.change(pace),
        }
        match self.in_force(pace).begin(problem, start) {
            Err(_) if asked == IntegrationMethod::Automatic => {
                self.change(pace);
                Ok(())
            }
            result => result,
        }
    }

    fn change(&self, pace: &mut Pace) {
        pace.evidence = if pace.stiff { -PATIENCE * self.trial } else { 0 };
        pace.stiff = !pace.stiff;
    }

    /// Counts the accepted substep h, after its attempt, for or against the method in force. `whole`: it went all the
    /// way to where it had to end.
    pub fn judge(
        &mut self,
        problem: &Problem,
        start: &Start,
        (h, whole): (f64, bool),
        nominals: &[f64],
        pace: &mut Pace,
    ) {
        if self.stiff.is_none() || self.by_itself {
            return;
        }
        let mut limits = || h * self.in_force(pace).fastest_rate(problem, start, h, nominals) / LIMIT;
        let against = if pace.stiff {
            // Half the work: a system at the border stays with what it has.
            limits() < 0.5 * self.work
        } else {
            !whole && limits() > LIMITED
        };
        if against {
            pace.evidence += 1;
        } else if pace.evidence > 0 {
            pace.evidence -= 1;
        }
    }
}

/// Work of a stiff substep of n states in explicit ones, counted in evaluations of the equations. A pass with dual
/// numbers counts as two. Of linear algebra, an evaluation is worth twenty operations a state.
fn relative_work(n: f64) -> f64 {
    let (explicit, stages, derivatives) = (6.0, 8.0, 2.0 * (n + 1.0));
    let algebra = (n.powi(3) / 3.0 + 9.0 * n.powi(2)) / (20.0 * n);
    (stages + derivatives + algebra) / explicit
}
