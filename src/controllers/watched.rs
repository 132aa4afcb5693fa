//! Watch on the tracking error of any controller: a funnel that warns when the error is outside, and doesn't change the
//! control.

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};

use crate::catalogue::{Catalogued, Demonstration, Role, Trial};
use crate::mathematics::performance::{self, Performance};
use crate::pages::Page;
use crate::system::{
    BooleanOf, Declaration, DesignReport, Discrete, IntegerOf, Invalid, OwnStep, Parameter, Point, Rates, Scalar,
    ScalarOf, Signal, Signals, Size, System, Values, VectorOf, Warning, boolean, integer, scalar, smaller, vector,
};
use crate::template::Template;

/// A controller that knows the errors that it is to keep small.
pub trait Tracking: System {
    /// Their units, one a channel.
    fn error_units(&self) -> Vec<&'static str>;
    /// The quantities that they are errors of, in words; none where these aren't known.
    fn error_quantities(&self) -> Vec<String>;
    /// The error e = r − y of a channel.
    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S;
}

/// A controller's structure, with the key `funnel`.
#[derive(Debug)]
pub struct WatchedStructure<T> {
    funnel: bool,
    controller: T,
}

impl<'de, T: DeserializeOwned> Deserialize<'de> for WatchedStructure<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut table = toml::Table::deserialize(deserializer)?;
        let funnel = table.remove("funnel").map(toml::Value::try_into).transpose();
        let funnel = funnel.map_err(|error| D::Error::custom(format!("funnel: {error}")))?;
        let controller = toml::Value::Table(table).try_into().map_err(D::Error::custom)?;
        Ok(WatchedStructure { funnel: funnel.unwrap_or(false), controller })
    }
}

impl<T: schemars::JsonSchema> schemars::JsonSchema for WatchedStructure<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("Watched{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = T::json_schema(generator);
        if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
            let text = "True if the tracking error is watched against a funnel, with the control law unchanged.";
            let funnel = serde_json::json!({ "description": text, "type": "boolean", "default": false });
            properties.insert("funnel".to_owned(), funnel);
        }
        schema
    }
}

/// A controller, with its funnel where the description asks for one.
#[derive(Debug)]
pub struct Watched<C> {
    controller: C,
    funnel: Option<WatchedFunnel>,
}

/// −ρ < e < ρ in each channel.
#[derive(Debug)]
struct WatchedFunnel {
    rho_0: VectorOf<Parameter>,
    rho_inf: VectorOf<Parameter>,
    decay_rate: VectorOf<Parameter>,
    opened_at: ScalarOf<Discrete>,
    /// True if the error of a channel is outside, between events.
    is_outside: Vec<BooleanOf<Discrete>>,
    /// The place of the first event indicator.
    indicators: usize,
    exits: IntegerOf<Discrete>,
    left: BooleanOf<Discrete>,
    e: VectorOf<Signal>,
    rho: VectorOf<Signal>,
    warning: Warning,
}

impl WatchedFunnel {
    fn declare<C: Tracking>(controller: &C, d: &mut Declaration) -> Self {
        let units = controller.error_units();
        let m = units.len();
        let quantities = controller.error_quantities();
        let signal =
            |name: &str, text: &str, about: &str| vector(name, m, text).about(&quantities, about).units(&units);
        let outside = |i: usize| boolean(&format!("#is_outside[{}]", i + 1), "").hidden();
        WatchedFunnel {
            rho_0: d.parameter(
                signal(
                    "rho_0",
                    "bound of the error at the start, watched",
                    "bound of the error of {} at the start, watched",
                )
                .start(1.0)
                .positive()
                .fixed(),
            ),
            rho_inf: d.parameter(
                signal(
                    "rho_inf",
                    "bound of the error in the end, watched",
                    "bound of the error of {} in the end, watched",
                )
                .start(0.1)
                .positive(),
            ),
            decay_rate: d.parameter(
                vector("decay_rate", m, "rate at which the bound of the error decays").unit("1/s").start(1.0).min(0.0),
            ),
            opened_at: d.discrete(scalar("#opened_at", "").hidden()),
            is_outside: (0..m).map(|i| d.discrete(outside(i))).collect(),
            indicators: d.indicators((1..=m).map(|i| format!("funnel of channel {i}"))),
            exits: d.discrete(
                integer("funnel_exits", "how often an error left its funnel; one that is outside at the start counts")
                    .output(),
            ),
            left: d.discrete(boolean("funnel_left", "whether an error is outside of its funnel").output()),
            e: d.local(signal("e", "tracking error, r - y", "tracking error of {}")),
            rho: d.local(
                signal(
                    "rho",
                    "performance function: the funnel is -rho < e < rho",
                    "performance function of {}: the funnel is -rho < e < rho",
                )
                .source("Hashim (6.7)"),
            ),
            warning: d.warning("logFunnel", "an error that left its funnel"),
        }
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        (0..self.rho_0.len()).for_each(|i| v.require_at_most(self.rho_inf.at(i), self.rho_0.at(i)));
    }

    fn rho<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> S {
        Performance::at(t - v[self.opened_at], v[self.rho_0][i], v[self.rho_inf][i], v[self.decay_rate][i]).rho
    }

    /// Positive inside, negative outside, never zero.
    fn margin<S: Scalar>(&self, i: usize, t: S, e: S, v: &Values<S>) -> S {
        let margin = self.rho(i, t, v) - e.abs();
        S::branch(margin.above(S::from(0.0)), || margin, || smaller(S::from(-f64::MIN_POSITIVE), margin))
    }

    /// Notes which errors are outside.
    fn look<S: Scalar>(&self, t: S, e: impl Fn(usize, &Values<S>) -> S, v: &mut Point<S>) {
        let mut any = S::Flag::from(false);
        for (i, &is_outside) in self.is_outside.iter().enumerate() {
            let error = e(i, &v.values());
            let outside = self.margin(i, t, error, &v.values()).below(S::from(0.0));
            any = any | outside;
            v.when(outside & !v.get(is_outside), |v| self.warn(i, t, error, v));
            v.put(is_outside, outside);
        }
        v.put(self.left, any);
    }

    /// Counts an error that has left its funnel, and warns of it.
    fn warn<S: Scalar>(&self, i: usize, t: S, error: S, v: &mut Point<S>) {
        let count = S::from_integer(v.get(self.exits)) + 1.0;
        v.put(self.exits, count.to_integer());
        let rho = self.rho(i, t, &v.values());
        v.warn(self.warning, |v| {
            let [of_error, of_rho, of_exits] = [v.name(self.e.at(i)), v.name(self.rho.at(i)), v.name(self.exits)];
            format!(
                "{of_error} = {} is outside of its funnel of {of_rho} = {} at t = {} s. {of_exits} counts how often that \
                 happens",
                error.rounded(),
                rho.rounded(),
                t.to_text()
            )
        });
    }
}

impl<C: Tracking> System for Watched<C> {
    type Structure = WatchedStructure<C::Structure>;
    const NAME: &'static str = C::NAME;
    const DOCUMENTATION: &'static str = C::DOCUMENTATION;

    fn declare(structure: Self::Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let controller = C::declare(structure.controller, d)?;
        let funnel = structure.funnel.then(|| WatchedFunnel::declare(&controller, d));
        Ok(Watched { controller, funnel })
    }

    fn sizes(structure: &Self::Structure) -> Vec<Size> {
        C::sizes(&structure.controller)
    }

    fn resize(structure: &mut Self::Structure, sizes: &[usize]) -> toml::Table {
        C::resize(&mut structure.controller, sizes)
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        self.controller.prepare(v)
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        if let Some(funnel) = &self.funnel {
            funnel.relate(v);
        }
        self.controller.relate(v);
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        if let Some(funnel) = &self.funnel {
            v[funnel.opened_at] = t;
            funnel.look(t, |i, v| self.controller.tracking_error(i, v), v);
        }
        self.controller.initialise(t, v);
    }

    fn parameters_changed<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.controller.parameters_changed(t, v);
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        self.controller.outputs(t, v, y);
        let Some(funnel) = &self.funnel else { return };
        for i in 0..funnel.is_outside.len() {
            y[funnel.e.at(i)] = self.controller.tracking_error(i, v);
            y[funnel.rho.at(i)] = funnel.rho(i, t, v);
        }
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        self.controller.derivatives(t, v, dx);
    }

    fn check<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.controller.check(t, v);
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        self.controller.next_time_event(v)
    }

    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        let Some(funnel) = &self.funnel else { return self.controller.event_indicators(t, v, z) };
        let (own, watched) = z.split_at_mut(funnel.indicators);
        self.controller.event_indicators(t, v, own);
        for (i, z) in watched.iter_mut().enumerate() {
            *z = funnel.margin(i, t, self.controller.tracking_error(i, v), v);
        }
    }

    fn event<S: Scalar>(&self, t: S, crossed: &[S::Flag], v: &mut Point<S>) {
        let Some(funnel) = &self.funnel else { return self.controller.event(t, crossed, v) };
        self.controller.event(t, &crossed[..funnel.indicators], v);
        funnel.look(t, |i, v| self.controller.tracking_error(i, v), v);
    }

    fn step_completed<S: Scalar>(&self, t: S, step: S, v: &mut Point<S>) {
        self.controller.step_completed(t, step, v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.controller.report(v, report);
        let Some(funnel) = &self.funnel else { return };
        report.section("Watched funnel");
        performance::report([funnel.rho_0, funnel.rho_inf, funnel.decay_rate], v, report);
    }

    fn own_step(&self) -> Option<&dyn OwnStep> {
        self.controller.own_step()
    }
}

impl<C: Tracking + Catalogued> Catalogued for Watched<C> {
    const TITLE: &'static str = C::TITLE;
    const PAGE: Page = C::PAGE;
    const ROLE: Role = C::ROLE;
    const TEMPLATE: Option<Template> = C::TEMPLATE;
    const TRIAL: Trial = C::TRIAL;
    const DEMONSTRATION: Option<Demonstration> = C::DEMONSTRATION;
    const LIMIT_OF: Option<&'static str> = C::LIMIT_OF;
}
