//! L1 control with its own sample time: the unknown part is estimated at each sample, and constant until the next.
//!
//! N. Hovakimyan, C. Cao, L1 adaptive control theory: guaranteed robustness with fast adaptation, SIAM 2010, section
//! 3.3, for the piecewise constant adaptation; the exact estimate, the nominal input gain, the pole placement for
//! sampled controls and the dead time are this package's.
#![allow(non_snake_case)] // matrices have the names of the thesis

mod design;
mod filter;
mod nominal;
mod report;
mod sample;
mod structure;
mod template;
mod turning;

use super::angles::Jumps;
use super::at_limit::{AtLimit, Limited, manual};
use super::clock::{Clock, SHORTEST};
use super::in_command::InCommand;
use super::l1::{Dynamics, PlantMatrices, SETTLED, Symbols, dot};
use super::origins::Origins;
use super::watched::Tracking;
use crate::catalogue::{Catalogued, Role};
use crate::mathematics::limits::{self, within};
use crate::mathematics::lyapunov;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, Choice, ChoiceOf, Declaration, DesignReport, Discrete, Input, IntegerOf, Invalid, Many, MatrixOf,
    Parameter, Point, Prepared, Rates, Scalar, ScalarOf, Signal, Signals, Spec, System, Unit, Values, VectorOf,
    Warning, boolean, choice, integer, matrix, scalar, vector,
};
use crate::template::{Needs, Sizes, Template};
use filter::SampledFilter;
pub use structure::{Estimate, L1SampledStructure};

/// The longest dead time, in samples.
const MOST_DELAY: usize = 5;
/// Parameters of an L1 controller that nothing is left of here.
const OF_ADAPTATION: [&str; 13] = [
    "adaptation_gain",
    "Q",
    "omega_min",
    "omega_max",
    "theta_bound",
    "sigma_bound",
    "theta_bound_unmatched",
    "sigma_bound_unmatched",
    "projection_tolerance",
    "adaptation_tolerance",
    "closed_form_phase",
    "step_phase_limit",
    "tracking_time",
];

/// Start of the filtered control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SampledStart {
    Zero,
    Bumpless,
}

impl Choice for SampledStart {
    const TYPE: &'static str = "SampledStart";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Zero, "zero", "the filter starts at zero"),
        (Self::Bumpless, "bumpless", "the filter starts such that the control starts at u_manual"),
    ];
}

/// u = W_0⁻¹ (ζ − K_d x_p) for x' = A x + B W_0 (u + σ_1) + B_um σ_2, with σ of the last interval, ζ behind the filter, and x_p
/// where the control will act. What no control reaches and isn't in B_um counts as well, behind it.
#[derive(Debug)]
pub struct L1Sampled {
    plant: PlantMatrices,
    dynamics: Dynamics,
    filter: SampledFilter,
    W_0: MatrixOf<Parameter>,
    W_0_inverse: MatrixOf<Prepared>,
    sample_time: ScalarOf<Parameter>,
    delay_steps: IntegerOf<Parameter>,
    start: ChoiceOf<Parameter, SampledStart>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    /// The nominal plant over a sample time, with the control and σ constant.
    A_d: MatrixOf<Prepared>,
    B_d: MatrixOf<Prepared>,
    L_d: MatrixOf<Prepared>,
    L_inverse: MatrixOf<Prepared>,
    K_d: MatrixOf<Prepared>,
    K_gd: MatrixOf<Prepared>,
    settling_time: ScalarOf<Prepared>,
    predictor: Option<Predictor>,
    r: VectorOf<Input>,
    dr: VectorOf<Input>,
    units_of_r: Vec<&'static str>,
    of_r: Vec<String>,
    x: VectorOf<Input>,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
    in_command: InCommand,
    clock: Clock,
    zeta: VectorOf<Discrete>,
    sigma_hat: VectorOf<Discrete>,
    /// Uncertainty in the state that the controls don't reach.
    sigma_other: Option<VectorOf<Discrete>>,
    /// x at the last sample, and where the control will act.
    x_before: VectorOf<Discrete>,
    x_ahead: VectorOf<Discrete>,
    between: VectorOf<Discrete>,
    /// The controls of the last intervals, the latest first.
    past: VectorOf<Discrete>,
    /// The control until the next sample.
    sampled_control: VectorOf<Discrete>,
    u: VectorOf<Signal>,
    u_ad: VectorOf<Signal>,
    /// True if the next sample begins from the present control.
    takes_over: BooleanOf<Discrete>,
    is_stepped: BooleanOf<crate::system::Memory>,
    at_limit: AtLimit,
    step_too_long: BooleanOf<Discrete>,
    long_step: Warning,
}

/// x̂ = E x̂ + Φ (B (W_0 u + K_m x) + B̄ σ̂), and σ̂ = S (x̂ − x).
#[derive(Debug)]
struct Predictor {
    E: MatrixOf<Prepared>,
    /// Φ B W_0, Φ B K_m and Φ B̄
    of_u: MatrixOf<Prepared>,
    of_x: MatrixOf<Prepared>,
    of_sigma: MatrixOf<Prepared>,
    S: MatrixOf<Prepared>,
    x_hat: VectorOf<Discrete>,
}

impl Predictor {
    fn declare(d: &mut Declaration, n: usize, m: usize, units: &Symbols) -> Self {
        let mut hidden = |name: &str, columns: usize| d.prepared(matrix(name, n, columns, "").hidden());
        Predictor {
            E: hidden("#E", n),
            of_u: hidden("#Phi B W_0", m),
            of_x: hidden("#Phi B K_m", n),
            of_sigma: hidden("#Phi B_all", n),
            S: hidden("#S", n),
            x_hat: d.discrete(
                vector("x_hat", n, "state of the predictor").about(&units.of_x, "predicted {}").units(&units.x),
            ),
        }
    }
}

impl Tracking for L1Sampled {
    fn error_units(&self) -> Vec<&'static str> {
        self.units_of_r.clone()
    }

    fn error_quantities(&self) -> Vec<String> {
        self.of_r.clone()
    }

    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S {
        let error = v[self.r][channel] - self.plant.output(channel, &v[self.x]);
        if self.is_angle(channel) { error.wrap() } else { error }
    }
}

impl System for L1Sampled {
    type Structure = L1SampledStructure;
    const NAME: &'static str = "l1-sampled";
    const DOCUMENTATION: &'static str = pages::L1_SAMPLED.text;

    fn declare(structure: L1SampledStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let plant = structure.plant()?;
        let (n, m) = plant.B.shape();
        let units = structure.of_l1.units((n, m))?;
        let (angles, turning) = structure.of_l1.angles(&plant, &units.x)?;
        let dynamics = Dynamics::declare(d, &plant, &structure.of_l1);
        d.without_effect(OF_ADAPTATION);
        let Symbols { r, x, u, of_r, of_x, of_u, .. } = &units;
        let limited = Limited::declare(d, (u, of_u), "that the actuator can give; the estimate knows of it", "");
        let rates: Vec<_> = r.iter().map(|unit| Unit::per_second(unit)).collect();
        let mut hidden = |name: &str, columns: usize| d.prepared(matrix(name, n, columns, "").hidden());
        let [A_d, B_d, L_d, L_inverse] = [("#A_d", n), ("#B_d", m), ("#L_d", n), ("#inverse of L_d", n)]
            .map(|(name, columns)| hidden(name, columns));
        let predictor = (structure.estimate == Estimate::Published).then(|| Predictor::declare(d, n, m, &units));
        let late = "samples from a measurement until its control acts: 0 if a master steps the plant before the controller, \
                    and in a composite; 1 if it steps both simultaneously";
        Ok(L1Sampled {
            filter: SampledFilter::declare(d, &structure.of_l1, &plant)?,
            W_0: d.parameter(
                matrix(
                    "nominal_input_gain",
                    m,
                    m,
                    "nominal input gain W_0: effect of the controls, in columns of B; must have an inverse",
                )
                .identity(),
            ),
            W_0_inverse: d.prepared(matrix("#inverse of W_0", m, m, "").hidden()),
            sample_time: d.parameter(
                scalar("sample_time", "time from sample to sample: the communication step, or a multiple of it")
                    .unit("s")
                    .start(0.01)
                    .min(SHORTEST)
                    .nominal(0.01)
                    .fixed(),
            ),
            delay_steps: d.parameter(integer("delay_steps", late).start(0).within(0, MOST_DELAY as i32).fixed()),
            start: d.parameter(choice::<SampledStart>("u_ad_start", "start of the filtered control").fixed()),
            K_d: d.prepared(matrix("K_d", m, n, "gain of the baseline, for a sampled control")),
            K_gd: d.prepared(matrix("K_g", m, m, "feedforward gain for unit steady-state gain")),
            settling_time: d.prepared(scalar("#settling time", "").hidden()),
            r: d.input(vector("r", m, "reference").about(of_r, "reference of {}").units(r)),
            dr: d.input(
                vector("dr", m, "rate of the reference, which predicts it until the control acts")
                    .about(of_r, "rate of the reference of {}")
                    .units(&rates),
            ),
            x: d.input(vector("x", n, "measured state of the plant").about(of_x, "measured {}").units(x)),
            origins: Origins::sampled(d, turning, "a reference"),
            jumps: None,
            in_command: InCommand::declare(d, "it takes over without a jump", manual(u, of_u)),
            clock: {
                let period = d.discrete(scalar("#sample period", "").hidden());
                Clock::declare(d, period)
            },
            zeta: d.discrete(vector("#zeta", m, "").hidden()),
            sigma_hat: d.discrete(
                vector("sigma_hat", m, "uncertainty in the last interval, as an equivalent control")
                    .about(of_u, "uncertainty in the last interval, as an equivalent {}")
                    .units(u),
            ),
            sigma_other: (n > m).then(|| d.discrete(outside_controls(n - m, plant.B_um.ncols()))),
            x_before: d.discrete(vector("#x before", n, "").hidden()),
            x_ahead: d.discrete(
                vector("x_ahead", n, "state where the control begins to act, of the nominal plant with the estimates")
                    .about(of_x, "{} where the control begins to act")
                    .units(x),
            ),
            between: d.discrete(vector("#between", n, "").hidden()),
            past: d.discrete(vector("#past u", m * (MOST_DELAY + 1), "").hidden()),
            sampled_control: d.discrete(vector("#held", m, "").hidden()),
            u_ad: d.local(
                vector("u_ad", m, "control that the filter gives")
                    .source("Hovakimyan and Cao, section 3.3")
                    .about(of_u, "control for the {} that the filter gives")
                    .units(u),
            ),
            takes_over: d.discrete(boolean("#takes over", "").hidden()),
            is_stepped: d.is_stepped(),
            at_limit: AtLimit::declare(d, limited),
            step_too_long: d.discrete(
                boolean("step_too_long", "whether the communication step is longer than the sample time").output(),
            ),
            long_step: d.warning("logStepTooLong", "communication step longer than the sample time"),
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            units_of_r: units.r,
            of_r: units.of_r,
            A_d,
            B_d,
            L_d,
            L_inverse,
            predictor,
            plant,
            dynamics,
        }
        .watching(&units.x, &angles, d))
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.dynamics.prepare(&self.plant, v)?;
        let (name, A_m) = (self.dynamics.name_of_A_m(&v.values()), self.dynamics.A_m(&v.values()).into_owned());
        v[self.settling_time] = (SETTLED / lyapunov::slowest_decay(&name, &A_m)?).min(f64::MAX);
        self.prepare_design(&name, &A_m, v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.filter.relate(self, v);
    }

    /// σ̂ = 0, ζ = 0, and the controls before the start as at it.
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let enabled = self.in_command.begin(v);
        v.put(self.takes_over, false.into());
        v[self.clock.start] = t;
        v[self.clock.period] = v[self.sample_time];
        self.begin(!enabled | v.get(self.start).is(SampledStart::Bumpless), v);
    }

    /// u, constant between samples, or the manual control within the limits; u_ad = W_0⁻¹ ζ.
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.u.len() {
            y[self.u][i] = self.in_force(i, v);
            y[self.u_ad][i] = dot(v.matrix(self.W_0_inverse).row(i).iter(), &v[self.zeta]);
        }
    }

    /// Nothing moves between samples.
    fn derivatives<S: Scalar>(&self, _t: S, _v: &Values<S>, _dx: &mut Rates<S>) {}

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.clock.next(v)
    }

    fn event_indicators<S: Scalar>(&self, _t: S, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed; takes a sample that is due.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| {
            for i in 0..self.u.len() {
                v[self.sampled_control][i] = self.in_force(i, &v.values());
            }
            v.put(self.takes_over, true.into());
        });
        let is_due = self.clock.next(&v.values()).at_most(t);
        v.when(is_due, |v| self.sample(v));
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        let settling_time = v[self.settling_time];
        let active = self.in_command.is_active(&v.values());
        self.at_limit.look(t, settling_time, active, v);
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
        v.when(v.get(self.is_stepped), |v| {
            self.clock.follow(t, step, v);
            let too_long = self.clock.is_overrun(step, &v.values());
            v.put(self.step_too_long, too_long);
            v.when(too_long, |v| {
                v.warn(self.long_step, |v| self.clock.overrun_warning(step, v, &v.name(self.sample_time)));
            });
        });
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

/// σ̂_2 along the columns of B_um, so many of all directions that no control reaches.
fn outside_controls(all: usize, along: usize) -> Spec<Many> {
    let text = "uncertainty in the last interval that no control reaches";
    let spec = vector("sigma_hat_unmatched", all, text);
    if along == 0 {
        return spec;
    }
    let each = |k: usize| match k {
        k if k < along => format!("{text}, along column {} of B_um: it is cancelled", k + 1),
        _ => format!("{text}, outside B_um: it isn't cancelled"),
    };
    let texts: Vec<_> = (0..all).map(each).collect();
    spec.each(&texts.iter().map(String::as_str).collect::<Vec<_>>())
}

impl L1Sampled {
    /// Control that the plant gets: the sampled one within the limits of its sample, constant over its whole interval,
    /// as the estimate assumes; or the manual one, within the limits.
    fn in_force<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let by_hand = within(v[self.in_command.u_manual][i], v[self.u_min][i], v[self.u_max][i]);
        S::select(self.in_command.is_active(v), v[self.sampled_control][i], by_hand)
    }
}

impl Catalogued for L1Sampled {
    const PAGE: Page = pages::L1_SAMPLED;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: Some(Needs::States),
        tried: &[Sizes::inputs(3), Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(4, 2), Sizes::plant(6, 3)],
    });
}
