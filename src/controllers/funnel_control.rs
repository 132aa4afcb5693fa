//! Funnel control for relative degree 1, 2 and 3.
//!
//! T. Berger, A. Ilchmann, E. P. Ryan, Funnel control of nonlinear systems, Mathematics of Control, Signals, and Systems 33
//! (2021) 151–194. T. Berger, H. H. Lê, T. Reis, Funnel control for nonlinear systems with known strict relative degree,
//! Automatica 87 (2018) 345–357.
#![allow(non_snake_case)] // matrices have the names of the field

mod leaving;
mod report;
mod template;

use serde::{Deserialize, Serialize};

use super::angles::{Angles, Jumps, require_below_half_a_turn};
use super::at_limit::{Guarantee, Limited, REOPENED_OR_AT_LIMIT, manual, unlimited};
use super::funnel::OnExit;
use super::in_command::InCommand;
use super::supervised::Supervised;
use super::units::{OutputUnits, Quantities, check_channels, of_matrix, with_derivatives};
use crate::catalogue::{Catalogued, Role, Trial};
use crate::mathematics::limits::{self, within};
use crate::mathematics::performance::Performance;
use crate::pages::{self, Page};
use crate::system::{
    BooleanOf, ChoiceOf, Declaration, DesignReport, Discrete, Input, IntegerOf, Invalid, MatrixOf, Parameter, Point,
    Rates, Scalar, ScalarOf, Signal, Signals, State, System, Values, VectorOf, Warning, boolean, integer, matrix,
    scalar, vector,
};
use crate::template::{Needs, Sizes, Template};

/// Largest relative degree.
const MOST_DEGREE: usize = 3;

/// Form of the errors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// One funnel, and a filter of the error and its derivatives (Berger, Ilchmann, Ryan 2021).
    #[default]
    FilteredError,
    /// A funnel for the error and one for its derivative (Berger, Lê, Reis 2018), for relative degree 2.
    TwoFunnels,
}

/// The description of the structure of a funnel controller.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FunnelStructure {
    /// Number of tracked variables, each with a control of its own.
    channels: usize,
    /// After how many derivatives of a tracked variable the control shows: 1, 2 or 3.
    #[schemars(range(min = 1, max = MOST_DEGREE))]
    relative_degree: usize,
    /// Form of the errors.
    #[serde(default)]
    form: Form,
    /// Channels whose output is an angle, counted from 1: values that differ by whole turns are the same. Their unit is rad.
    #[serde(default)]
    angles: Vec<usize>,
    /// Units of the signals.
    #[serde(default)]
    units: OutputUnits,
    /// Quantities of the signals in words, as "yaw rate": used in descriptions of variables.
    #[serde(default)]
    quantities: Quantities,
}

/// Bounds ψ(t) = (ψ_0 − ψ_∞) e^(−l t) + ψ_∞ of an error, a channel each.
#[derive(Debug)]
struct Bounds {
    start: VectorOf<Parameter>,
    end: VectorOf<Parameter>,
    decay_rate: VectorOf<Parameter>,
    psi: VectorOf<Signal>,
    /// ψ at the time when it opened, and that time, s.
    opened_to: VectorOf<Discrete>,
    opened_at: VectorOf<Discrete>,
}

impl Bounds {
    /// Those of an error, with names that end so.
    fn declare(d: &mut Declaration, error: &str, end: &str, (units, of_y): (&[&'static str], &[String])) -> Self {
        let m = units.len();
        let bound = |name: &str, when: &str| {
            let (text, about) = (format!("bound of {error} {when}"), format!("bound of {error} of {{}} {when}"));
            vector(&format!("{name}{end}"), m, &text).about(of_y, &about).units(units)
        };
        let rate = format!("rate at which the bound of {error} decays");
        Bounds {
            start: d.parameter(bound("psi_0", "at the start").start(1.0).positive().fixed()),
            end: d.parameter(bound("psi_inf", "in the end").start(0.1).positive()),
            decay_rate: d.parameter(vector(&format!("decay_rate{end}"), m, &rate).unit("1/s").start(1.0).min(0.0)),
            psi: d.local(bound("psi", "in force")),
            opened_to: d.discrete(vector(&format!("#opened_to{end}"), m, "").hidden()),
            opened_at: d.discrete(vector(&format!("#opened_at{end}"), m, "").hidden()),
        }
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        (0..self.start.len()).for_each(|i| v.require_at_most(self.end.at(i), self.start.at(i)));
    }

    /// They open at a time.
    fn open<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v.copy(self.start, self.opened_to);
        v[self.opened_at].fill(t);
    }

    fn at<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> S {
        let since = t - v[self.opened_at][i];
        Performance::at(since, v[self.opened_to][i], v[self.end][i], v[self.decay_rate][i]).rho
    }
}

/// The errors of a form.
#[derive(Debug)]
enum Errors {
    /// e_1 = e/ψ, e_{i+1} = τ^i e^(i)/ψ + e_i/(1 − e_i²)
    Filtered { tau: Option<VectorOf<Parameter>> },
    /// e_1 = e' + g_0 e/(1 − (e/ψ)²), within ψ_1
    TwoFunnels { g_0: VectorOf<Parameter>, second: Bounds },
}

/// u = −G g e_ρ/(1 − e_ρ²) within its limits, with the last e_ρ of the errors, each in parts of its bound.
#[derive(Debug)]
pub struct FunnelControl {
    bounds: Bounds,
    errors: Errors,
    g: VectorOf<Parameter>,
    G: MatrixOf<Parameter>,
    takeover_rate: ScalarOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    /// r and y with their derivatives.
    r: Vec<VectorOf<Input>>,
    y: Vec<VectorOf<Input>>,
    angles: Angles,
    jumps: Option<Jumps>,
    in_command: InCommand,
    u_b: VectorOf<State>,
    /// e = y − r
    e: VectorOf<Signal>,
    /// Errors in parts of their bounds, a row a channel.
    parts: MatrixOf<Signal>,
    /// Control asked for by each channel.
    asked: VectorOf<Signal>,
    /// u before its limits.
    unlimited: VectorOf<Signal>,
    u: VectorOf<Signal>,
    /// True if every error was inside when the bounds opened.
    began_inside: BooleanOf<Discrete>,
    supervised: Supervised,
    guarantee: Guarantee,
    on_exit: ChoiceOf<Parameter, OnExit>,
    reopened: IntegerOf<Discrete>,
    left: Warning,
    /// The first of its event indicators, one a channel.
    indicator: usize,
}

impl System for FunnelControl {
    type Structure = FunnelStructure;
    const NAME: &'static str = "funnel";
    const DOCUMENTATION: &'static str = pages::FUNNEL.text;

    fn declare(structure: FunnelStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let FunnelStructure { channels: m, relative_degree, form, angles, units, quantities } = structure;
        check_channels(m)?;
        if !(1..=MOST_DEGREE).contains(&relative_degree) {
            let allowed = format!("must be within 1 … {MOST_DEGREE}");
            return Err(Invalid::new("relative_degree", relative_degree, allowed));
        }
        if form == Form::TwoFunnels && relative_degree != 2 {
            let allowed = "must be 2 where form = \"two_funnels\"";
            return Err(Invalid::new("relative_degree", relative_degree, allowed));
        }
        let ([y_units, u_units], [of_y, of_u]) = (units.symbols(m)?, quantities.of_signals(m)?);
        let angles = Angles::of(&angles, "y", &y_units)?;
        let derivatives = with_derivatives(&y_units, relative_degree);
        let limit = "that the actuator can give, on which the guarantee ends";
        let takes_over = "it takes over without a jump, and its funnel opens anew";
        let limited = Limited::declare(d, (&u_units, &of_u), limit, "Berger et al. (2021), (2018)");
        let unlimited = unlimited(d, m);
        let mut known = |names: [&str; 3], (what, about): (&str, &str)| {
            let orders = ["", "rate of the ", "second derivative of the "];
            let inputs = names.into_iter().zip(orders).zip(&derivatives).take(relative_degree);
            let input = |((name, order), units): ((&str, &str), &Vec<_>)| {
                let (text, about) = (format!("{order}{what}"), format!("{order}{about}"));
                d.input(vector(name, m, &text).about(&of_y, &about).units(units))
            };
            inputs.map(input).collect::<Vec<_>>()
        };
        let r = known(["r", "dr", "ddr"], ("reference", "reference of {}"));
        let y = known(["y", "dy", "ddy"], ("measured output of the plant", "measured {}"));
        let text = "decay rate of the control's offset after a take-over without a jump";
        let direction = "direction: from demands to controls. With the plant's input gain it must be positive definite";
        Ok(FunnelControl {
            bounds: Bounds::declare(d, "the error", "", (&y_units, &of_y)),
            errors: match form {
                Form::FilteredError => Errors::Filtered {
                    tau: (relative_degree > 1).then(|| {
                        d.parameter(
                            vector("tau", m, "time constant of the error's filter").unit("s").start(1.0).positive(),
                        )
                    }),
                },
                Form::TwoFunnels => Errors::TwoFunnels {
                    g_0: d.parameter(
                        vector("g_0", m, "gain of the error in the second error").unit("1/s").start(1.0).min(0.0),
                    ),
                    second: Bounds::declare(d, "the second error", "_second", (&derivatives[1], &of_y)),
                },
            },
            g: d.parameter(vector("g", m, "gain").start(1.0).positive()),
            G: d.parameter(
                matrix("G", m, m, direction).identity().units(&of_matrix(&u_units, &derivatives[relative_degree])?),
            ),
            takeover_rate: d.parameter(scalar("takeover_rate", text).unit("1/s").start(1.0).min(0.0)),
            u_b: d.state(vector("u_b", m, "the control's offset after a take-over without a jump").units(&u_units)),
            e: d.local(vector("e", m, "error, y - r").about(&of_y, "error of {}, y - r").units(&y_units)),
            parts: d.local(
                matrix(
                    "e_part",
                    m,
                    if form == Form::TwoFunnels { 2 } else { relative_degree },
                    "error of each level in parts of its bound: below 1 inside",
                )
                .source("Berger et al. (2021), (2018)"),
            ),
            in_command: InCommand::declare(d, takes_over, manual(&u_units, &of_u)),
            asked: d.local(vector("#asked", m, "").hidden()),
            began_inside: d.discrete(boolean("#began_inside", "").hidden()),
            unlimited,
            supervised: Supervised::declare(d, limited),
            guarantee: Guarantee::declare(d, limited, REOPENED_OR_AT_LIMIT),
            on_exit: d.parameter(OnExit::parameter()),
            reopened: d.discrete(integer("funnel_reopened", "how often a funnel was re-opened").output()),
            left: d.warning("logFunnel", REOPENED_OR_AT_LIMIT),
            indicator: d.indicators(vec![""; m]),
            u: limited.u,
            u_min: limited.u_min,
            u_max: limited.u_max,
            jumps: Jumps::declare(d, y[0], &y_units, &angles),
            angles,
            r,
            y,
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.bounds.relate(v);
        if let Errors::TwoFunnels { second, .. } = &self.errors {
            second.relate(v);
        }
        for i in self.angles.each() {
            let start = self.bounds.start.at(i);
            require_below_half_a_turn(v[start], |v| v.name(start), v);
        }
    }

    /// The bounds open.
    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let enabled = self.in_command.begin(v);
        v.put(self.reopened, S::integer(0));
        self.open(t, v);
        v[self.u_b].fill(S::from(0.0));
        let inside = self.all_inside(t, &v.values());
        v.put(self.began_inside, inside | !enabled);
        self.jumps.iter().for_each(|jumps| jumps.begin(v));
    }

    /// u = −G g e_ρ/(1 − e_ρ²) + u_b, or the manual control, within the limits.
    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        let active = self.in_command.is_active(v);
        let acts = active & v.get(self.began_inside);
        for i in 0..self.u.len() {
            y[self.e][i] = self.error(0, i, v);
            y[self.bounds.psi][i] = self.bounds.at(i, t, v);
            if let Errors::TwoFunnels { second, .. } = &self.errors {
                y[second.psi][i] = second.at(i, t, v);
            }
            let levels = self.levels(i, t, v);
            y[self.asked][i] = S::branch(acts, || self.asked(i, &levels, t, v), || S::from(0.0));
            for (level, part) in levels.into_iter().enumerate().take(self.parts.shape().1) {
                // Outside, where the control law isn't in force, values that follow from the first are no numbers.
                y[self.parts.at(i, level)] = if level == 0 { part } else { S::select(acts, part, S::from(0.0)) };
            }
        }
        for j in 0..self.u.len() {
            let law = || self.law(j, |i| y[self.asked][i], v) + v[self.u_b][j];
            let wanted = S::branch(acts, law, || S::select(active, S::from(0.0), v[self.in_command.u_manual][j]));
            (y[self.unlimited][j], y[self.u][j]) = (wanted, within(wanted, v[self.u_min][j], v[self.u_max][j]));
        }
    }

    /// u_b decays.
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        for j in 0..self.u.len() {
            dx[self.u_b][j] = -v[self.takeover_rate] * v[self.u_b][j];
        }
    }

    /// Reports an error that is outside: the control law is not defined there.
    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let active = self.in_command.is_active(&v.values());
        v.when(active, |v| {
            for i in 0..self.u.len() {
                self.check_channel(i, t, v);
            }
        });
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        self.in_command.event_indicators(v, z);
        let reopens = self.reopens(v);
        for i in 0..self.u.len() {
            z[self.indicator + i] = S::branch(reopens, || self.distance(i, t, v), || S::from(1.0));
        }
    }

    /// Takes over, or hands over, where `enabled` has changed; re-opens what errors have left.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.in_command.event(v, |v| self.take_over(t, v));
        self.reopen_left(t, v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        // Without desired dynamics there is no settling time: the time at the limit is reported, without a warning.
        let active = self.in_command.is_active(&v.values());
        self.supervised.look((t, step), S::from(f64::INFINITY), active, v);
        v.when(active, |v| self.guarantee.look(t, self.e, v));
        self.jumps.iter().for_each(|jumps| jumps.look(t, v));
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.report_design(v, report);
    }
}

impl FunnelControl {
    /// The error y − r of a channel, within half a turn where that is an angle, or a derivative of it.
    fn error<S: Scalar>(&self, derivative: usize, i: usize, v: &Values<S>) -> S {
        let error = v[self.y[derivative]][i] - v[self.r[derivative]][i];
        if derivative == 0 { self.angles.difference(i, error) } else { error }
    }

    /// The bounds open.
    fn open<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.bounds.open(t, v);
        if let Errors::TwoFunnels { second, .. } = &self.errors {
            second.open(t, v);
        }
    }

    /// The errors of a channel in parts of their bounds, level by level; as many as there are, then zeros.
    fn levels<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> [S; MOST_DEGREE] {
        self.levels_within(self.bounds.at(i, t, v), i, t, v)
    }

    /// The same with ψ as if it were this.
    fn levels_within<S: Scalar>(&self, psi: S, i: usize, t: S, v: &Values<S>) -> [S; MOST_DEGREE] {
        let mut levels = [S::from(0.0); MOST_DEGREE];
        levels[0] = self.error(0, i, v) / psi;
        match &self.errors {
            // e_{i+1} = τ^i e^(i)/ψ + e_i/(1 − e_i²)
            Errors::Filtered { tau } => {
                let (tau, mut power) = (tau.map_or(S::from(0.0), |tau| v[tau][i]), S::from(1.0));
                for level in 1..self.r.len() {
                    power *= tau;
                    levels[level] = power * self.error(level, i, v) / psi + barrier(levels[level - 1]);
                }
            }
            // e_1 = e' + g_0 e/(1 − (e/ψ)²)
            Errors::TwoFunnels { g_0, second } => {
                levels[1] = self.second_error(*g_0, psi, i, v) / second.at(i, t, v);
            }
        }
        levels
    }

    /// e_1 = e' + g_0 e/(1 − (e/ψ)²)
    fn second_error<S: Scalar>(&self, g_0: VectorOf<Parameter>, psi: S, i: usize, v: &Values<S>) -> S {
        self.error(1, i, v) + v[g_0][i] * psi * barrier(self.error(0, i, v) / psi)
    }

    /// Control asked for by a channel: g times the last error, over 1 less its square in parts of its bound.
    fn asked<S: Scalar>(&self, i: usize, levels: &[S; MOST_DEGREE], t: S, v: &Values<S>) -> S {
        let last = barrier(levels[self.parts.shape().1 - 1]);
        match &self.errors {
            Errors::Filtered { .. } => v[self.g][i] * last,
            Errors::TwoFunnels { second, .. } => v[self.g][i] * second.at(i, t, v) * last,
        }
    }

    /// −G g e_ρ/(1 − e_ρ²) of a control.
    fn law<S: Scalar>(&self, control: usize, asked: impl Fn(usize) -> S, v: &Values<S>) -> S {
        (0..self.u.len()).fold(S::from(0.0), |sum, i| sum - v[self.G.at(control, i)] * asked(i))
    }

    fn all_inside<S: Scalar>(&self, t: S, v: &Values<S>) -> S::Flag {
        let mut inside = S::Flag::from(true);
        for i in 0..self.u.len() {
            for part in self.levels(i, t, v).into_iter().take(self.parts.shape().1) {
                inside = inside & part.abs().below(S::from(1.0));
            }
        }
        inside
    }

    /// Opens the funnel anew, with u_b := u_manual − u: the control stays at the manual one, within the limits.
    fn take_over<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.open(t, v);
        let inside = self.all_inside(t, &v.values());
        v.put(self.began_inside, inside);
        for j in 0..self.u.len() {
            let manual = within(v[self.in_command.u_manual][j], v[self.u_min][j], v[self.u_max][j]);
            let (values, start) = (v.values(), S::from(0.0));
            let asked = |i: usize| self.asked(i, &self.levels(i, t, &values), t, &values);
            let law = S::branch(inside, || self.law(j, asked, &values), || start);
            v[self.u_b][j] = manual - law;
        }
    }
}

/// e/(1 − e²); no number outside of −1 … 1.
fn barrier<S: Scalar>(e: S) -> S {
    let root = (-e * e + 1.0).sqrt();
    e / (root * root)
}

impl Catalogued for FunnelControl {
    const PAGE: Page = pages::FUNNEL;
    const ROLE: Role = Role::Controller;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::write,
        is_uncertain: true,
        needs: Some(Needs::Derivatives),
        tried: &[
            Sizes::inputs(3),
            Sizes::plant(1, 1),
            Sizes::plant(2, 1),
            Sizes::plant(3, 1),
            Sizes::plant(6, 3),
            Sizes::plant(6, 2),
        ],
    });
    const TRIAL: Trial = Trial {
        alone: "psi_0 = 1e4\npsi_inf = 1e4\ndecay_rate = 0.0\n",
        smooth: "psi_0 = 1e4\npsi_inf = 1e4\ndecay_rate = 0.0\n",
        steady: "decay_rate = 0.0\n",
        ..Trial::NONE
    };
}
