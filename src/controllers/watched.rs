//! A funnel about any controller's tracking error that is watched and not enforced: it tells when the error is outside, and
//! changes nothing in the law.

use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer};

use crate::control::performance::{self, Performance};
use crate::report::number;
use crate::system::{
    BooleanOf, Declaration, DesignReport, Discrete, ErrorEstimate, Handle, IntegerOf, Invalid, Number, Parameter,
    Point, Rates, Scalar, ScalarOf, Signal, Signals, Stride, System, Values, VectorOf, Warning, boolean, integer,
    scalar, vector,
};

/// A controller that knows the errors that it is to keep small.
pub trait Tracking: System {
    /// Their units, one a channel.
    fn error_units(&self) -> Vec<&'static str>;
    /// The error e = r − y of a channel.
    fn tracking_error<S: Scalar>(&self, channel: usize, v: &Values<S>) -> S;
    /// The inputs that they follow from.
    fn errors_follow_from(&self) -> Vec<&dyn Handle>;
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

#[cfg(feature = "cli")]
impl<T: schemars::JsonSchema> schemars::JsonSchema for WatchedStructure<T> {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        format!("Watched{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        let mut schema = T::json_schema(generator);
        if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
            let text = "Whether the tracking error is watched against a funnel, the law unchanged.";
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
    funnel: Option<Funnel>,
}

/// −ρ < e < ρ in each channel.
#[derive(Debug)]
struct Funnel {
    rho_0: VectorOf<Parameter>,
    rho_inf: VectorOf<Parameter>,
    decay_rate: VectorOf<Parameter>,
    opened_at: ScalarOf<Discrete>,
    /// Whether the error of a channel is outside, between events.
    is_outside: Vec<BooleanOf<Discrete>>,
    exits: IntegerOf<Discrete>,
    left: BooleanOf<Discrete>,
    e: VectorOf<Signal>,
    rho: VectorOf<Signal>,
    warning: Warning,
}

impl Funnel {
    fn declare<C: Tracking>(controller: &C, d: &mut Declaration) -> Self {
        let units = controller.error_units();
        let m = units.len();
        let signal = |name: &str, text: &str| vector(name, m, text).units(&units);
        let outside = |i: usize| boolean(&format!("#is_outside[{}]", i + 1), "").hidden();
        let funnel = Funnel {
            rho_0: d
                .parameter(signal("rho_0", "bound of the error at the start, watched").start(1.0).positive().fixed()),
            rho_inf: d.parameter(signal("rho_inf", "bound of the error in the end, watched").start(0.1).positive()),
            decay_rate: d.parameter(
                vector("decay_rate", m, "rate at which the bound of the error decays").unit("1/s").start(1.0).min(0.0),
            ),
            opened_at: d.discrete(scalar("#opened_at", "").hidden()),
            is_outside: (0..m).map(|i| d.discrete(outside(i))).collect(),
            exits: d.discrete(
                integer("funnel_exits", "how often an error left its funnel; one that is outside at the start counts")
                    .output(),
            ),
            left: d.discrete(boolean("funnel_left", "whether an error is outside of its funnel").output()),
            e: d.local(signal("e", "tracking error, r - y")),
            rho: d.local(signal("rho", "performance function: the funnel is -rho < e < rho")),
            warning: d.warning("logFunnel", "an error that left its funnel"),
        };
        d.depends(funnel.e, &controller.errors_follow_from());
        d.depends(funnel.rho, &[]);
        funnel
    }

    fn prepare(&self, v: &Point) -> Invalid {
        let mut invalid = Invalid::none();
        for (i, (rho_0, rho_inf)) in v[self.rho_0].iter().zip(&v[self.rho_inf]).enumerate() {
            if rho_inf > rho_0 {
                let allowed = format!("must not be above rho_0[{}] = {}", i + 1, Number(*rho_0));
                invalid.and(Invalid::new(format!("rho_inf[{}]", i + 1), Number(*rho_inf), allowed));
            }
        }
        invalid
    }

    fn rho<S: Scalar>(&self, i: usize, t: S, v: &Values<S>) -> S {
        Performance::at(t - v[self.opened_at], v[self.rho_0][i], v[self.rho_inf][i], v[self.decay_rate][i]).rho
    }

    /// Positive inside, negative outside, never zero.
    fn margin(&self, i: usize, t: f64, e: f64, v: &Values<f64>) -> f64 {
        let margin = self.rho(i, t, v) - e.abs();
        if margin > 0.0 { margin } else { margin.min(-f64::MIN_POSITIVE) }
    }

    /// Notes which errors are outside.
    fn look(&self, t: f64, e: impl Fn(usize, &Values<f64>) -> f64, v: &mut Point) {
        let mut any = false;
        for (i, &is_outside) in self.is_outside.iter().enumerate() {
            let error = e(i, &v.values());
            let outside = self.margin(i, t, error, &v.values()) < 0.0;
            any |= outside;
            if outside && !v.get(is_outside) {
                let count = v.get(self.exits) + 1;
                v.put(self.exits, count);
                let rho = self.rho(i, t, &v.values());
                v.warn(self.warning, || {
                    let [error, rho] = [error, rho].map(number);
                    format!(
                        "e[{}] = {error} is outside of its funnel of rho = {rho} at t = {} s. funnel_exits counts how often \
                         that happens",
                        i + 1,
                        Number(t)
                    )
                });
            }
            v.put(is_outside, outside);
        }
        v.put(self.left, any);
    }
}

impl<C: Tracking> System for Watched<C> {
    type Structure = WatchedStructure<C::Structure>;
    const NAME: &'static str = C::NAME;
    const DOCUMENTATION: &'static str = C::DOCUMENTATION;

    fn indicators(&self) -> usize {
        self.controller.indicators() + self.funnel.as_ref().map_or(0, |funnel| funnel.is_outside.len())
    }

    fn declare(structure: Self::Structure, d: &mut Declaration) -> Result<Self, Invalid> {
        let controller = C::declare(structure.controller, d)?;
        let funnel = structure.funnel.then(|| Funnel::declare(&controller, d));
        Ok(Watched { controller, funnel })
    }

    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        let mut invalid = self.funnel.as_ref().map_or(Invalid::none(), |funnel| funnel.prepare(v));
        self.controller.prepare(v).unwrap_or_else(|reasons| invalid.and(reasons));
        invalid.into_result()
    }

    fn initialise(&self, t: f64, v: &mut Point) -> Result<(), Invalid> {
        if let Some(funnel) = &self.funnel {
            v[funnel.opened_at] = t;
            funnel.look(t, |i, v| self.controller.tracking_error(i, v), v);
        }
        self.controller.initialise(t, v)
    }

    fn parameters_changed(&self, t: f64, v: &mut Point) {
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

    fn check(&self, t: f64, v: &Values<f64>) -> Result<(), Invalid> {
        self.controller.check(t, v)
    }

    fn next_time_event(&self, v: &Values<f64>) -> Option<f64> {
        self.controller.next_time_event(v)
    }

    fn event_indicators(&self, t: f64, v: &Values<f64>, z: &mut [f64]) {
        let (own, watched) = z.split_at_mut(self.controller.indicators());
        self.controller.event_indicators(t, v, own);
        let Some(funnel) = &self.funnel else { return };
        for (i, z) in watched.iter_mut().enumerate() {
            *z = funnel.margin(i, t, self.controller.tracking_error(i, v), v);
        }
    }

    fn event(&self, t: f64, crossed: &[bool], v: &mut Point) {
        self.controller.event(t, &crossed[..self.controller.indicators()], v);
        if let Some(funnel) = &self.funnel {
            funnel.look(t, |i, v| self.controller.tracking_error(i, v), v);
        }
    }

    fn step_completed(&self, t: f64, step: f64, v: &mut Point) {
        self.controller.step_completed(t, step, v);
    }

    fn report(&self, v: &Values<f64>, report: &mut DesignReport) {
        self.controller.report(v, report);
        let Some(funnel) = &self.funnel else { return };
        report.section("Watched funnel");
        let (rho_0, rho_inf, decay_rate) = (&v[funnel.rho_0], &v[funnel.rho_inf], &v[funnel.decay_rate]);
        performance::report(rho_0, rho_inf, decay_rate, report);
    }

    fn steps_itself(&self) -> bool {
        self.controller.steps_itself()
    }

    fn workspace(&self) -> usize {
        self.controller.workspace()
    }

    fn own_step_pays(&self, h: f64, relative_tolerance: f64, v: &Values<f64>) -> bool {
        self.controller.own_step_pays(h, relative_tolerance, v)
    }

    fn advance(&self, stride: Stride, v: &mut Point) -> bool {
        self.controller.advance(stride, v)
    }

    fn conclude(&self, whole: &Values<f64>, tolerance: (&[f64], f64), v: &mut Point) -> ErrorEstimate {
        self.controller.conclude(whole, tolerance, v)
    }
}
