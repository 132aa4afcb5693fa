//! Robust model reference adaptive control with prescribed performance, for uncertainty that the controls don't reach: chapter 6
//! of the thesis, carried on by the recursion of approximation-free prescribed performance.
//!
//! C. P. Bechlioulis and G. A. Rovithakis, A low-complexity global approximation-free control scheme with prescribed performance
//! for unknown pure feedback systems, Automatica 50 (2014) 1217–1226. The estimates in the virtual control, the reference model
//! and the take-over are this package's.
#![allow(non_snake_case)] // matrices have the names of the thesis

mod report;
mod structure;
mod supervision;
mod template;
mod turning;

use super::angles::Jumps;
use super::at_limit::{Guarantee, Limited, REOPENED_OR_AT_LIMIT, manual, unlimited};
use super::funnel::{Funnel, Inside};
use super::in_command::InCommand;
use super::l1::{SETTLED, dot, product};
use super::origins::{Origins, Turning as _};
use super::supervised::Supervised;
use super::units::of_matrix;
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits::{self, within};
use crate::mathematics::projection::projection;
use crate::mathematics::{feedforward, lyapunov};
use crate::pages::{self, Page};
use crate::system::{
    Choice, ChoiceOf, Declaration, DesignReport, Discrete, Input, IntegerOf, Invalid, MatrixOf, Parameter, Point,
    Prepared, Rates, Scalar, ScalarOf, Signal, Signals, State, System, Unit, Values, VectorOf, Warning, choice,
    integer, matrix, scalar, vector,
};
use crate::template::{Sizes, Template};
pub use structure::UnmatchedStructure;
use structure::{Driven, PlantMatrices};

/// Start of the reference model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ModelStart {
    Measured,
    Given,
}

impl Choice for ModelStart {
    const TYPE: &'static str = "ModelStart";
    const ITEMS: &'static [(Self, &'static str, &'static str)] = &[
        (Self::Measured, "measured", "where the plant is: every error starts at 0"),
        (Self::Given, "given", "with x_m0"),
    ];
}

/// u = B_a⁻¹ w, w_i = x_m,i' − A_i x − θ̂_iᵀx − σ̂_i + b_i in the rows that the controls reach, b_i = −K_ε,i R_i ε_i + z_i ρ_i';
/// a state that drives an unmatched row follows the α by which that row would do the same.
#[derive(Debug)]
pub struct MracPpfUnmatched {
    plant: PlantMatrices,
    A_m: MatrixOf<Parameter>,
    gamma: VectorOf<Parameter>,
    upsilon: VectorOf<Parameter>,
    K_epsilon: VectorOf<Parameter>,
    theta_bound: VectorOf<Parameter>,
    sigma_bound: VectorOf<Parameter>,
    projection_tolerance: ScalarOf<Parameter>,
    /// υ_θ
    theta_leakage: VectorOf<Parameter>,
    x_m_start: ChoiceOf<Parameter, ModelStart>,
    x_m0: VectorOf<Parameter>,
    takeover_rate: ScalarOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    K_g: MatrixOf<Prepared>,
    /// B K_g
    command: MatrixOf<Prepared>,
    settling_time: ScalarOf<Prepared>,
    r: VectorOf<Input>,
    x: VectorOf<Input>,
    in_command: InCommand,
    funnel: Funnel,
    x_m: VectorOf<State>,
    /// A column a row of the plant.
    theta_hat: MatrixOf<State>,
    sigma_hat: VectorOf<State>,
    u_b: VectorOf<State>,
    /// Desired value of each state that drives an unmatched row, as the description lists them; none without these.
    alpha: Option<VectorOf<Signal>>,
    /// Desired contribution of the controls to the rows that they reach.
    wanted: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    projection_active: IntegerOf<Discrete>,
    supervised: Supervised,
    guarantee: Guarantee,
    at_bounds: Warning,
    origins: Option<Origins>,
    jumps: Option<Jumps>,
}

impl System for MracPpfUnmatched {
    type Structure = UnmatchedStructure;
    const NAME: &'static str = "mrac-ppf-unmatched";
    const DOCUMENTATION: &'static str = pages::MRAC_PPF_UNMATCHED.text;

    fn declare(structure: UnmatchedStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let plant = structure.plant()?;
        let (n, m) = plant.B.shape();
        let [r_units, x_units, u_units] = structure.units.symbols((n, m))?;
        let [of_r, of_x, of_u] = structure.quantities.of_signals((n, m), &plant.C)?;
        let (angles, turning) = structure.angles(&plant, &x_units)?;
        let rates: Vec<_> = x_units.iter().map(|unit| Unit::per_second(unit)).collect();
        let gain = |name: &str, text: &str, start: f64| vector(name, n, text).start(start).min(0.0);
        let hidden = |name: &str, len: usize| vector(name, len, "").hidden();
        let limited =
            Limited::declare(d, (&u_units, &of_u), "that the actuator can give, on which the guarantee ends", "");
        let unlimited = unlimited(d, m);
        let takes_over = "it takes over without a jump, and begins anew: from the measured state, without estimates";
        let of_state = |name: &str, text: &str, about: &str| vector(name, n, text).about(&of_x, about).units(&x_units);
        let law = MracPpfUnmatched {
            A_m: d.parameter(
                matrix("A_m", n, n, "state matrix of the reference model; its unmatched rows are those of A")
                    .starts(plant.A.as_slice())
                    .units(&of_matrix(&rates, &x_units)?),
            ),
            gamma: d.parameter(gain("gamma", "adaptation gain of a row's estimates", 1.0)),
            upsilon: d.parameter(gain("upsilon", "leakage of sigma_hat", 0.05)),
            K_epsilon: d.parameter(vector("K_epsilon", n, "gain of the barrier").start(0.1).positive()),
            theta_bound: d.parameter(gain("theta_bound", "bound of the estimates theta_hat of a row", 40.0)),
            sigma_bound: d.parameter(gain("sigma_bound", "bound of the estimate sigma_hat of a row", 5.0)),
            projection_tolerance: d.parameter(
                scalar("projection_tolerance", "width of the layer at the bounds of estimates, in parts of them")
                    .start(0.1)
                    .positive(),
            ),
            x_m_start: d.parameter(choice::<ModelStart>("x_m_start", "start of the reference model").fixed()),
            x_m0: d.parameter(
                of_state(
                    "x_m0",
                    "state that the reference model is given at the start",
                    "{} that the reference model is given at the start",
                )
                .fixed(),
            ),
            takeover_rate: {
                let text = "decay rate of the control's offset after a take-over without a jump";
                d.parameter(scalar("takeover_rate", text).unit("1/s").start(1.0).min(0.0))
            },
            K_g: d.prepared(
                matrix("K_g", m, m, "feedforward gain -(C A_m^-1 B)^-1 for unit steady-state gain")
                    .units(&of_matrix(&u_units, &r_units)?),
            ),
            command: d.prepared(matrix("#B K_g", n, m, "").hidden()),
            settling_time: d.prepared(scalar("#settling time", "").hidden()),
            r: d.input(vector("r", m, "reference").about(&of_r, "reference of {}").units(&r_units)),
            x: d.input(of_state("x", "measured state of the plant", "measured {}")),
            in_command: InCommand::declare(d, takes_over, manual(&u_units, &of_u)),
            guarantee: Guarantee::declare(d, limited, REOPENED_OR_AT_LIMIT),
            funnel: Funnel::declare(d, (&x_units, &of_x), [0.5, 0.05, 1.0]).of_angles(angles.clone()),
            x_m: d.state(
                of_state("x_m", "state of the reference model", "{} of the reference model").source("Hashim (6.2)"),
            ),
            theta_hat: d.state(matrix("theta_hat", n, n, "estimate of theta, a column for each row of the plant")),
            sigma_hat: d.state(vector("sigma_hat", n, "estimate of the disturbance of each row").units(&rates)),
            u_b: d.state(vector("u_b", m, "the control's offset after a take-over without a jump").units(&u_units)),
            alpha: (!plant.unmatched.is_empty()).then(|| {
                let units: Vec<_> = plant.unmatched.iter().map(|driven| x_units[driven.by]).collect();
                let text = "virtual control: what the state that drives an unmatched row is to be";
                d.local(vector("alpha", units.len(), text).units(&units).source("Bechlioulis and Rovithakis (2014)"))
            }),
            wanted: d.local(hidden("#wanted", m)),
            projection_active: d.discrete(
                integer("projection_active", "number of estimates limited to their bounds by projection").output(),
            ),
            unlimited,
            supervised: Supervised::declare(d, limited),
            at_bounds: d.warning("logProjection", "estimates at their bounds"),
            theta_leakage: {
                let text =
                    "leakage of theta_hat, which vanishes with the error: it keeps noise from driving the estimates";
                d.parameter(gain("theta_leakage", text, 0.0))
            },
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            plant,
            origins: None,
            jumps: None,
        };
        Ok(law.turning((turning, angles), &x_units, d))
    }

    /// K_g, and how long the reference model takes to settle.
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        let (name, A_m) = (v.name(self.A_m), v.matrix(self.A_m).into_owned());
        v[self.settling_time] = (SETTLED / lyapunov::slowest_decay(&name, &A_m)?).min(f64::MAX);
        let size = self.plant.A.amax().max(A_m.amax());
        for (row, column) in self.plant.unmatched.iter().flat_map(|of| (0..A_m.ncols()).map(|column| (of.row, column)))
        {
            let (entry, own) = (A_m[(row, column)], self.plant.A[(row, column)]);
            if (entry - own).abs() > 1e-9 * size {
                let allowed = format!("must be {own}, as in A: the controls don't reach this row");
                return Err(Invalid::new(v.name(self.A_m.at(row, column)), entry, allowed));
            }
        }
        let K_g = feedforward::gain(&A_m, &self.plant.B, &self.plant.C, &name)?;
        v.matrix_mut(self.command).copy_from(&(&self.plant.B * &K_g));
        v.matrix_mut(self.K_g).copy_from(&K_g);
        Ok(())
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.funnel.relate(v);
    }

    /// Starts the reference model at the plant's state or a given one, and the estimates at 0.
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let enabled = self.in_command.begin(v);
        self.start_model(v);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
        self.begin(v);
        let is_given = v.get(self.x_m_start).is(ModelStart::Given);
        v.when(is_given, |v| self.give_model(v));
        self.open(t, enabled, v);
    }

    /// u = B_a⁻¹ w + u_b, or the manual control, within the limits.
    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        let active = self.in_command.is_active(v);
        for i in 0..self.x.len() {
            self.funnel.show(i, &self.inside(i, t, active, v), y);
        }
        for (place, &driven) in self.plant.unmatched.iter().enumerate() {
            let virtual_control = || self.alpha(driven, &self.inside(driven.row, t, active, v), v);
            if let Some(alpha) = self.alpha {
                y[alpha.at(place)] = S::branch(active, virtual_control, || v[self.x][driven.by]);
            }
        }
        for q in 0..self.u.len() {
            y[self.wanted.at(q)] = self.wanted(q, t, active, v);
        }
        for k in 0..self.u.len() {
            let law = || self.law(k, |q| y[self.wanted.at(q)]) + v[self.u_b][k];
            let wanted = S::branch(active, law, || v[self.in_command.u_manual][k]);
            y[self.unlimited.at(k)] = wanted;
            y[self.u.at(k)] = within(wanted, v[self.u_min][k], v[self.u_max][k]);
        }
    }

    /// x_m' = A_m x_m + B K_g r; θ̂_i' = Proj(γ_i R_i (ε_i x − υ_θ,i |ε_i| θ̂_i)), σ̂_i' = Proj(γ_i R_i (ε_i − υ_i |ε_i| σ̂_i)).
    /// Under manual control the model follows the plant, and the estimates rest.
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let (active, tolerance) = (self.in_command.is_active(v), v[self.projection_tolerance]);
        for i in 0..self.x.len() {
            dx[self.x_m.at(i)] = S::branch(active, || self.model_rate(i, v), || self.following(i, v));
            let Inside { epsilon, R, .. } = self.inside(i, t, active, v);
            let projected = |estimate: S, rate: S, bound: S| {
                S::branch(active, || projection(estimate, rate, -bound, bound, tolerance), || S::from(0.0))
            };
            let gain = v[self.gamma][i] * R;
            let leaks = gain * v[self.theta_leakage][i] * epsilon.abs();
            for j in 0..self.x.len() {
                let theta_hat = v[self.theta_hat.at(j, i)];
                let rate = gain * epsilon * self.state(j, v) - leaks * theta_hat;
                dx[self.theta_hat.at(j, i)] = projected(theta_hat, rate, v[self.theta_bound][i]);
            }
            let sigma_hat = v[self.sigma_hat][i];
            let rate = gain * (epsilon - v[self.upsilon][i] * epsilon.abs() * sigma_hat);
            dx[self.sigma_hat.at(i)] = projected(sigma_hat, rate, v[self.sigma_bound][i]);
        }
        for k in 0..self.u.len() {
            dx[self.u_b.at(k)] = -v[self.takeover_rate] * v[self.u_b][k];
        }
    }

    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let active = self.in_command.is_active(&v.values());
        v.when(active, |v| self.funnel.check(t, |i, v| self.error(i, t, active, v), v));
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        let active = self.in_command.is_active(v);
        self.in_command.event_indicators(v, z);
        self.origin_indicators(v, z);
        self.funnel.event_indicators(t, |i, v| self.error(i, t, active, v), v, z);
    }

    /// Takes over, or hands over, where `enabled` has changed; moves origins; re-opens funnels.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| self.take_over(t, v));
        self.move_origins(v);
        let active = self.in_command.is_active(&v.values());
        // The second time for a state that follows another α as the funnel of the row that it drives re-opens.
        for _ in 0..2 {
            self.funnel.event(t, |i, v| self.error(i, t, active, v), v);
        }
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.supervise((t, step), v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

impl MracPpfUnmatched {
    /// The model where the plant is, and nothing estimated.
    fn begin<S: Scalar>(&self, v: &mut Point<S>) {
        self.put_model(v);
        for states in [self.theta_hat.elements(), self.sigma_hat, self.u_b] {
            v[states].fill(S::from(0.0));
        }
    }

    /// Opens the funnels.
    fn open<S: Scalar>(&self, t: S, active: S::Flag, v: &mut Point<S>) {
        // The second time for a state whose α depends on the side on which the error of the row that it drives begins.
        for _ in 0..2 {
            self.funnel.open(t, |i, v| self.error(i, t, active, v), v);
        }
    }

    /// Restarts with u_b := u_manual − u: the control stays at the manual one, within the limits.
    fn take_over<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.begin(v);
        self.open(t, true.into(), v);
        for k in 0..self.u.len() {
            let values = v.values();
            let law = self.law(k, |q| self.wanted(q, t, true.into(), &values));
            v[self.u_b][k] = within(v[self.in_command.u_manual][k], v[self.u_min][k], v[self.u_max][k]) - law;
        }
    }

    /// The error of a row: x − x_m, or x − α of a state that drives an unmatched row. It is 0 while that row's own
    /// error is outside, and under manual control.
    fn error<S: Scalar>(&self, i: usize, t: S, active: S::Flag, v: &Values<S>) -> S {
        let nothing = || S::from(0.0);
        let of_model = || self.state(i, v) - v[self.x_m][i];
        let Some(&driven) = self.plant.unmatched.iter().find(|driven| driven.by == i) else {
            return S::branch(active, of_model, nothing);
        };
        let row = driven.row;
        let upper = self.funnel.of_error(row, t, self.error(row, t, active, v), v);
        let is_inside = upper.bounds.hold(upper.z);
        S::branch(active & is_inside, || v[self.x][i] - self.alpha(driven, &upper, v), nothing)
    }

    fn inside<S: Scalar>(&self, i: usize, t: S, active: S::Flag, v: &Values<S>) -> Inside<S> {
        self.funnel.inside(i, t, self.error(i, t, active, v), v)
    }

    /// α: what makes an unmatched row follow its model, by what is estimated of it and its barrier.
    fn alpha<S: Scalar>(&self, Driven { row, by }: Driven, upper: &Inside<S>, v: &Values<S>) -> S {
        let entry = self.plant.A[(row, by)];
        let own = self.nominal(row, v) - v[self.x][by] * entry;
        (self.model_rate(row, v) - own - self.estimate(row, v) + self.barrier(row, upper, v)) / entry
    }

    /// w of a reached row: what the controls are to bring to it.
    fn wanted<S: Scalar>(&self, q: usize, t: S, active: S::Flag, v: &Values<S>) -> S {
        let i = self.plant.reached[q];
        let barrier = self.barrier(i, &self.inside(i, t, active, v), v);
        self.model_rate(i, v) - self.nominal(i, v) - self.estimate(i, v) + barrier
    }

    /// B_a⁻¹ w of a control.
    fn law<S: Scalar>(&self, k: usize, wanted: impl Fn(usize) -> S) -> S {
        (0..self.u.len()).fold(S::from(0.0), |sum, q| sum + wanted(q) * self.plant.inverse[(k, q)])
    }

    /// b = −K_ε R ε + z ρ'
    fn barrier<S: Scalar>(&self, i: usize, inside: &Inside<S>, v: &Values<S>) -> S {
        let Inside { performance, z, epsilon, R, .. } = *inside;
        z * performance.rate - v[self.K_epsilon][i] * R * epsilon
    }

    /// A x of a row.
    fn nominal<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        self.states(v).enumerate().fold(S::from(0.0), |sum, (j, x)| sum + x * self.plant.A[(i, j)])
    }

    /// A_m x_m + B K_g r of a row.
    fn model_rate<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let of_model = dot(v.matrix(self.A_m).row(i).iter(), &v[self.x_m]);
        if self.plant.reached.contains(&i) {
            return of_model + product(v.matrix(self.command).row(i).iter(), self.references(v));
        }
        of_model
    }

    /// A_m (x_m − x) of a row.
    fn following<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let A_m = v.matrix(self.A_m);
        dot(A_m.row(i).iter(), &v[self.x_m]) - product(A_m.row(i).iter(), self.states(v))
    }

    /// θ̂ᵀx + σ̂ of a row.
    fn estimate<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        product(v.matrix(self.theta_hat).column(i).iter(), self.states(v)) + v[self.sigma_hat][i]
    }
}

impl Catalogued for MracPpfUnmatched {
    const PAGE: Page = pages::MRAC_PPF_UNMATCHED;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: None,
        tried: &[Sizes::plant(1, 1), Sizes::plant(2, 1), Sizes::plant(3, 2), Sizes::plant(6, 3)],
    });
    const TRIAL: Trial = Trial {
        alone: "rho_0 = 1e4\nrho_inf = 9e3\ndecay_rate = 0.0\nfunnel = 'symmetric'\novershoot = 1.0\n",
        steady: "x = 0.0",
        ..Trial::NONE
    };
}
