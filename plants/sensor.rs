//! A sensor between a plant and a controller.

use super::channels::{Channels, Clock, DelayLine, Lag};
use super::template::{channels, write_channels, write_sizes};
use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus};
use crate::pages::{self, Page};
use crate::recording::Opaque;
use crate::system::{
    Declaration, Discrete, Input, IntegerOf, Invalid, Parameter, Point, Prepared, Rates, Scalar, ScalarOf, Signal,
    Signals, System, Values, VectorOf, any, integer, scalar, vector,
};
use crate::template::{Begun, Request, Sizes, Template, all, named, write_names};

/// Each channel: lag, delay, bias, noise and quantisation, in this order.
#[derive(Debug)]
pub struct Sensor {
    time_constant: VectorOf<Parameter>,
    bias: VectorOf<Parameter>,
    noise_deviation: VectorOf<Parameter>,
    resolution: VectorOf<Parameter>,
    seed: IntegerOf<Parameter>,
    clock: Clock,
    lag: Lag,
    line: DelayLine,
    /// 1 where anything is sampled.
    samples: ScalarOf<Prepared>,
    /// Noise of standard deviation 1, constant between samples.
    noise: VectorOf<Discrete>,
    /// The quantised value, constant between samples.
    quantised: VectorOf<Discrete>,
    u: VectorOf<Input>,
    y: VectorOf<Signal>,
}

impl System for Sensor {
    type Structure = Channels;
    const NAME: &'static str = "sensor";
    const DOCUMENTATION: &'static str = pages::SENSOR.text;

    fn declare(structure: Channels, d: &mut Declaration) -> Result<Self, Invalid> {
        let units = structure.units()?;
        let (m, quantities) = (units.len(), structure.quantities()?);
        let clock = Clock::declare(d, "delay, noise and quantisation");
        let seed = "which noise it is: another one with each seed, in each channel";
        Ok(Sensor {
            time_constant: d
                .parameter(vector("time_constant", m, "time constant of the lag; 0: none").unit("s").min(0.0)),
            line: DelayLine::declare(d, clock, &structure),
            bias: d.parameter(vector("bias", m, "constant error").units(&units)),
            noise_deviation: d.parameter(
                vector("noise_deviation", m, "standard deviation of the noise; 0: none").units(&units).min(0.0),
            ),
            seed: d.parameter(integer("seed", seed).start(1).fixed()),
            resolution: d.parameter(
                vector("resolution", m, "step between distinguishable values; 0: none").units(&units).min(0.0),
            ),
            clock,
            lag: Lag::declare(d, &units),
            samples: d.prepared(scalar("#samples", "").hidden()),
            noise: d.discrete(vector("#noise", m, "").hidden()),
            quantised: d.discrete(vector("#held", m, "").hidden()),
            u: d.input(vector("u", m, "measured signal").about(&quantities, "{} that is measured").units(&units)),
            y: d.output(vector("y", m, "measured value").about(&quantities, "measured {}").units(&units)),
        })
    }

    fn relate<S: Scalar>(&self, v: &mut Point<S>) {
        self.line.relate(v);
        let acts = |handle: VectorOf<Parameter>| any::<S>(v[handle].iter().map(|value| value.above(S::from(0.0))));
        let samples = self.line.is_used(&v.values()) | acts(self.noise_deviation) | acts(self.resolution);
        v[self.samples] = S::from_flag(samples);
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.clock.start(t, v);
        for i in 0..self.u.len() {
            let (acts, u) = (v[self.time_constant][i].above(S::from(0.0)), v[self.u][i]);
            self.lag.start(i, acts, u, v);
            self.line.fill(i, u, v);
        }
        self.sample(t, v);
    }

    fn parameters_changed<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        // A delay line holds every sample, so that none was missed.
        v.when(!self.line.is_used(&v.values()), |v| self.clock.catch_up(t, v));
        for i in 0..self.u.len() {
            let (acts, u) = (v[self.time_constant][i].above(S::from(0.0)), v[self.u][i]);
            self.lag.change(i, acts, u, v);
        }
        self.sample(t, v);
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.u.len() {
            let quantised = v[self.resolution][i].above(S::from(0.0));
            y[self.y][i] = S::branch(quantised, || v[self.quantised][i], || self.analogue(t, i, v));
        }
    }

    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        for i in 0..self.u.len() {
            let acts = self.lag.acts(i, v);
            let rate = || (v[self.u][i] - v[self.lag.x][i]) / v[self.time_constant][i];
            dx[self.lag.x][i] = S::branch(acts, rate, || S::from(0.0));
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        S::branch(v[self.samples].equals(S::from(0.0)), || S::from(f64::INFINITY), || self.clock.next(v))
    }

    fn event<S: Scalar>(&self, t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        self.clock.tick(v);
        for i in 0..self.u.len() {
            let lagged = self.lag.lagged(i, v[self.u][i], &v.values());
            self.line.push(i, lagged, v);
        }
        self.sample(t, v);
    }
}

impl Sensor {
    /// The value before quantisation.
    fn analogue<S: Scalar>(&self, t: S, i: usize, v: &Values<S>) -> S {
        let lagged = self.lag.lagged(i, v[self.u][i], v);
        self.line.delayed(t, i, lagged, v) + v[self.bias][i] + v[self.noise_deviation][i] * v[self.noise][i]
    }

    /// Draws the noise of the latest sample, and quantises.
    fn sample<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        let (seed, sample) = (S::from_integer(v.get(self.seed)), v[self.clock.sample]);
        for i in 0..self.u.len() {
            v[self.noise][i] = S::opaque(Opaque::Noise, &[seed, S::from(i as f64), sample]);
            v[self.quantised][i] = quantised(self.analogue(t, i, &v.values()), v[self.resolution][i]);
        }
    }
}

/// The nearest multiple of the resolution, where there is one.
fn quantised<S: Scalar>(value: S, resolution: S) -> S {
    let nearest = || {
        let steps = value / resolution;
        // Steps finer than the number itself change nothing.
        S::branch(steps.is_finite(), || steps.round() * resolution, || value)
    };
    S::branch(resolution.equals(S::from(0.0)), || value, nearest)
}

impl Catalogued for Sensor {
    const PAGE: Page = pages::SENSOR;
    const ROLE: Role = Role::Sensor;
    const TEMPLATE: Option<Template> =
        Some(Template { write: template, is_uncertain: false, needs: None, tried: &[Sizes::NONE] });
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "u",
        stimulus: Stimulus::Sine,
        constant_inputs: &[],
        output: "y",
        shows_all: false,
        scale: |of, _| {
            let size = of("resolution").max(of("noise_deviation")).max(of("bias").abs());
            let late = of("time_constant") + of("delay");
            let duration = if late > 0.0 { 40.0 * late } else { 400.0 * of("sample_time") };
            let acts = size > 0.0 || late > 0.0;
            acts.then_some(Scale { about: 0.0, size: if size > 0.0 { 15.0 * size } else { 1.0 }, duration })
        },
        example: "resolution = 0.1\nnoise_deviation = 0.05\ntime_constant = 0.05\nsample_time = 0.02\ndelay = 0.04",
    });
}

/// A sensor without any effect, until it is set.
fn template(request: &Request) -> Result<Begun, Invalid> {
    request.only(&["outputs"])?;
    let (m, signals) = channels(request, request.sizes.outputs, |plant| (plant.sizes().0, &plant.x));
    let mut text = request.begin(&Sensor::PAGE, 10.0, 1e-3);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("y", named(&signals, "_measured")), ("u", named(&signals, ""))]);
    text.table("start");
    text.set("time_constant", all(0.0, m), "s, lag; 0 is none");
    text.set("noise_deviation", all(0.0, m), "standard deviation of the noise; 0 is none");
    text.set("resolution", all(0.0, m), "step between distinguishable values; 0 is none");
    text.set("bias", all(0.0, m), "constant error");
    text.set("delay", all(0.0, m), "s, a multiple of sample_time");
    text.set("sample_time", "0.001", "s, of noise, delay and resolution");
    text.set("seed", "1", "which noise it is");
    write_sizes(&mut text, request, |of, _| vec![("x", (&of.x).into()), ("y", (&of.x).into())])?;
    Ok(text.finish())
}
