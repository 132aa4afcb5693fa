//! An actuator between a controller's command and a plant.

use super::channels::{Channels, Clock, DelayLine, Lag};
use super::template::{channels, write_channels, write_sizes};
use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus};
use crate::mathematics::limits::{self, UNLIMITED, within};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Input, Invalid, Parameter, Point, Prepared, Rates, Scalar, ScalarOf, Signal, Signals, System, Unit,
    Values, VectorOf, scalar, vector,
};
use crate::template::{Begun, Request, Sizes, Template, all, named, write_limits, write_names};

/// Event indicators of a channel: two of each piecewise linear effect.
const KINKS: usize = 6;

/// Each channel: dead zone, delay, limits, rate limit and lag, in this order; then a gain and a bias.
#[derive(Debug)]
pub struct Actuator {
    gain: VectorOf<Parameter>,
    bias: VectorOf<Parameter>,
    dead_zone: VectorOf<Parameter>,
    u_min: VectorOf<Parameter>,
    u_max: VectorOf<Parameter>,
    rate_limit: VectorOf<Parameter>,
    time_constant: VectorOf<Parameter>,
    clock: Clock,
    line: DelayLine,
    lag: Lag,
    /// Time constants that the lag works with; 0 where there is neither a lag nor a rate limit.
    working_time_constant: VectorOf<Prepared>,
    /// 1 where anything is sampled.
    samples: ScalarOf<Prepared>,
    u: VectorOf<Input>,
    y: VectorOf<Signal>,
}

impl System for Actuator {
    type Structure = Channels;
    const NAME: &'static str = "actuator";
    const DOCUMENTATION: &'static str = pages::ACTUATOR.text;

    fn declare(structure: Channels, d: &mut Declaration) -> Result<Self, Invalid> {
        let units = structure.units()?;
        let rates: Vec<_> = units.iter().map(|unit| Unit::per_second(unit)).collect();
        let (m, quantities) = (units.len(), structure.quantities()?);
        let clock = Clock::declare(d, "the delay; time constant of a rate limit that has no lag behind it");
        let parameter = |name: &str, text: &str, start: f64| vector(name, m, text).start(start).units(&units);
        d.indicators(std::iter::repeat_n("", KINKS * m));
        Ok(Actuator {
            dead_zone: d.parameter(parameter("dead_zone", "commands up to this magnitude do nothing", 0.0).min(0.0)),
            line: DelayLine::declare(d, clock, &structure),
            u_min: d.parameter(parameter("u_min", "smallest output", 0.0).no_lower_limit()),
            u_max: d.parameter(parameter("u_max", "largest output", 0.0).no_upper_limit()),
            rate_limit: d.parameter(
                parameter("rate_limit", "fastest change of the output", 0.0).no_upper_limit().units(&rates).positive(),
            ),
            time_constant: d
                .parameter(vector("time_constant", m, "time constant of the lag; 0: none").unit("s").min(0.0)),
            gain: d.parameter(vector("gain", m, "part of it that takes effect; 1: all of it").start(1.0)),
            bias: d.parameter(parameter("bias", "constant that is added to the output", 0.0)),
            clock,
            lag: Lag::declare(d, &units),
            working_time_constant: d.prepared(vector("#working time constant", m, "").hidden()),
            samples: d.prepared(scalar("#samples", "").hidden()),
            u: d.input(vector("u", m, "command").about(&quantities, "commanded {}").units(&units)),
            y: d.output(
                vector("y", m, "output of the actuator").about(&quantities, "{} that the actuator gives").units(&units),
            ),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        limits::require_room(self.u_min, self.u_max, v);
        self.line.relate(v);
        v[self.samples] = S::from_flag(self.line.is_used(&v.values()));
        for i in 0..self.u.len() {
            let (own, limited) = (v[self.time_constant][i], v[self.rate_limit][i].below(S::from(UNLIMITED)));
            let has_none = own.equals(S::from(0.0)) & limited;
            v[self.working_time_constant][i] = S::select(has_none, v[self.clock.sample_time], own);
        }
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.clock.start(t, v);
        for i in 0..self.u.len() {
            let command = self.noticed(i, &v.values());
            self.line.fill(i, command, v);
            let (acts, command) = (self.lags(i, v), self.possible(t, i, &v.values()));
            self.lag.start(i, acts, command, v);
        }
    }

    fn parameters_changed<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        for i in 0..self.u.len() {
            let (acts, command) = (self.lags(i, v), self.possible(t, i, &v.values()));
            self.lag.change(i, acts, command, v);
        }
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.u.len() {
            y[self.y][i] = v[self.gain][i] * self.lag.lagged(i, self.possible(t, i, v), v) + v[self.bias][i];
        }
    }

    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        for i in 0..self.u.len() {
            let limit = v[self.rate_limit][i];
            let wanted = || (self.possible(t, i, v) - v[self.lag.x][i]) / v[self.working_time_constant][i];
            dx[self.lag.x][i] = S::branch(self.lag.acts(i, v), || within(wanted(), -limit, limit), || S::from(0.0));
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        S::branch(v[self.samples].equals(S::from(0.0)), || S::from(f64::INFINITY), || self.clock.next(v))
    }

    /// Kinks of the equations: no step leads across one, or its error would not be known. What is not set has none.
    fn event_indicators<S: Scalar>(&self, t: S, v: &Values<S>, z: &mut [S]) {
        for (i, z) in z.chunks_exact_mut(KINKS).enumerate() {
            let (u, dead_zone) = (v[self.u][i], v[self.dead_zone][i]);
            let command = self.line.delayed(t, i, self.noticed(i, v), v);
            let ahead = within(command, v[self.u_min][i], v[self.u_max][i]) - v[self.lag.x][i];
            let most = v[self.rate_limit][i] * v[self.working_time_constant][i];
            let none = [S::from(1.0); 2];
            let has_zone = dead_zone.above(S::from(0.0));
            let is_limited = v[self.rate_limit][i].below(S::from(UNLIMITED));
            z[..2].copy_from_slice(&S::branch(has_zone, || [u - dead_zone, u + dead_zone], || none));
            z[2..4].copy_from_slice(&[command - v[self.u_min][i], command - v[self.u_max][i]]);
            z[4..].copy_from_slice(&S::branch(is_limited, || [ahead - most, ahead + most], || none));
        }
    }

    /// A sample is taken where one is due; a kink changes nothing.
    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        v.when(self.next_time_event(&v.values()).at_most(t), |v| {
            self.clock.tick(v);
            for i in 0..self.u.len() {
                let command = self.noticed(i, &v.values());
                self.line.push(i, command, v);
            }
        });
    }
}

impl Actuator {
    /// True if a channel has a lag, of its own or to limit its rate.
    fn lags<S: Scalar>(&self, i: usize, v: &Point<S>) -> S::Flag {
        v[self.working_time_constant][i].above(S::from(0.0))
    }

    /// The command behind the dead zone.
    fn noticed<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let (u, dead_zone) = (v[self.u][i], v[self.dead_zone][i]);
        // At its edge, and everywhere without one, the command is passed on.
        let below = || S::branch(u.at_most(-dead_zone), || u + dead_zone, || S::from(0.0));
        S::branch(u.at_least(dead_zone), || u - dead_zone, below)
    }

    /// The delayed command within the limits.
    fn possible<S: Scalar>(&self, t: S, i: usize, v: &Values<S>) -> S {
        let command = self.line.delayed(t, i, self.noticed(i, v), v);
        within(command, v[self.u_min][i], v[self.u_max][i])
    }
}

impl Catalogued for Actuator {
    const PAGE: Page = pages::ACTUATOR;
    const ROLE: Role = Role::Actuator;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template,
        is_uncertain: false,
        needs: None,
        tried: &[Sizes::inputs(1), Sizes::inputs(7)],
    });
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "u",
        stimulus: Stimulus::Steps,
        constant_inputs: &[],
        output: "y",
        shows_all: false,
        scale: |of, _| {
            let (most, zone, rate) = (of("u_max").min(-of("u_min")), of("dead_zone"), of("rate_limit"));
            let has_limit = most > 0.0 && most < UNLIMITED;
            let size = if has_limit { 1.5 * most } else { 1.0_f64.max(5.0 * zone) };
            let on_the_way = if rate < UNLIMITED { 2.0 * size / rate } else { 0.0 };
            let late = of("time_constant") + of("delay") + on_the_way;
            let acts = has_limit || zone > 0.0 || late > 0.0;
            acts.then_some(Scale { about: 0.0, size, duration: if late > 0.0 { 8.0 * late } else { 1.0 } })
        },
        example: "u_min = -1.0\nu_max = 1.0\nrate_limit = 5.0\ntime_constant = 0.05\ndelay = 0.05",
    });
}

/// An actuator with the plant's limits, or without any.
fn template(request: &Request) -> Result<Begun, Invalid> {
    request.only(&["inputs"])?;
    let (m, signals) = channels(request, request.sizes.inputs, |plant| (plant.sizes().1, &plant.u));
    let mut text = request.begin(&Actuator::PAGE, 10.0, 1e-3);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("u", named(&signals, "_command")), ("y", named(&signals, ""))]);
    text.table("start");
    write_limits(&mut text, request.plant.as_ref(), m);
    text.set("rate_limit", all(1e15, m), "fastest change of the output, its unit a second; 1e15 is no limit");
    text.set("time_constant", all(0.0, m), "s, lag; 0 is none");
    text.set("dead_zone", all(0.0, m), "commands up to this magnitude do nothing");
    text.set("delay", all(0.0, m), "s, a multiple of sample_time");
    text.set("sample_time", "0.001", "s, of the delay");
    write_sizes(&mut text, request, |of, _| vec![("x", (&of.u).into()), ("y", (&of.u).into())])?;
    Ok(text.finish())
}
