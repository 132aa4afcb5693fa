//! Reference signals with exact first and second derivatives.

use serde::Deserialize;

use super::template::{channels, write_channels};
use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus, Trial};
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Discrete, IntegerOf, Invalid, MatrixOf, Parameter, Point, Scalar, Signal, Signals, System, Unit,
    Values, VectorOf, any, matrix, quantities, selection, smaller, vector,
};
use crate::template::{Begun, Plant, Request, Sizes, Template, all, experiment, list, named, number, write_names};

/// Steps that each channel can have.
const STEPS: usize = 4;

/// The parts of a reference that can be chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Part {
    Cosine,
    Sine,
    Square,
    Steps,
}

impl Part {
    /// All of them, in the order of their numbers.
    const ALL: [Part; 4] = [Part::Cosine, Part::Sine, Part::Square, Part::Steps];
}

/// A named choice of parts.
#[derive(Debug, Clone, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct NamedSignal {
    /// Item of the parameter `signal`.
    name: String,
    /// Description in a line.
    description: String,
    /// The parts that it consists of, in addition to offset and ramp.
    parts: Vec<Part>,
}

/// Number of channels, their units (1 where none are given), and names for choices of parts (a parameter `signal`), where
/// there are several.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReferenceStructure {
    /// Number of channels, 1 … 1000.
    channels: usize,
    /// Units of the reference, one a channel; 1 where none are given.
    #[serde(default)]
    units: Vec<String>,
    /// Quantities of the channels in words, one each, as "yaw angle"; descriptions count channels where none are given.
    #[serde(default)]
    quantities: Vec<String>,
    /// Named choices of parts, the items of a parameter `signal`.
    #[serde(default)]
    signals: Vec<NamedSignal>,
}

/// Each channel: r = s(t) (offset + slope t + cosine + sine + square) + steps, with a smooth start s(t).
#[derive(Debug)]
pub struct Reference {
    /// Parts of each named signal, by their numbers.
    parts: Vec<[bool; Part::ALL.len()]>,
    signal: Option<IntegerOf<Parameter>>,
    offset: VectorOf<Parameter>,
    slope: VectorOf<Parameter>,
    /// Amplitude, angular frequency and phase.
    cosine: [VectorOf<Parameter>; 3],
    sine: [VectorOf<Parameter>; 3],
    /// Amplitude, frequency in Hz and phase.
    square: [VectorOf<Parameter>; 3],
    step_time: MatrixOf<Parameter>,
    step_height: MatrixOf<Parameter>,
    /// Rate, and weight of the term that makes the second derivative start at zero too.
    smooth_start: [VectorOf<Parameter>; 2],
    /// Half periods of the square wave that have passed.
    half_periods: VectorOf<Discrete>,
    /// 1 for a step that has been taken.
    taken: MatrixOf<Discrete>,
    r: VectorOf<Signal>,
    dr: VectorOf<Signal>,
    ddr: VectorOf<Signal>,
}

/// A value with its first and second time derivatives.
type Jet<S> = [S; 3];

impl System for Reference {
    type Structure = ReferenceStructure;
    const NAME: &'static str = "reference";
    const DOCUMENTATION: &'static str = pages::REFERENCE.text;

    fn declare(structure: ReferenceStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let ReferenceStructure { channels: m, units, quantities: given, signals } = structure;
        if m == 0 || m > 1000 {
            return Err(Invalid::new("channels", m, "must be within 1 … 1000"));
        }
        let (units, of_r) = (Unit::symbols("r", &units, m)?, quantities("r", &given, m)?);
        let rates: Vec<_> = units.iter().map(|unit| Unit::per_second(unit)).collect();
        let second_rates: Vec<_> = rates.iter().map(|unit| Unit::per_second(unit)).collect();
        let items = signals.iter().map(|signal| (signal.name.clone(), signal.description.clone())).collect::<Vec<_>>();
        let signal = (!items.is_empty())
            .then(|| d.parameter(selection("signal", "which parts the reference consists of", "Signal", items)));
        let described = |name: &str, text: &str| vector(name, m, text).about(&of_r, &format!("{text} of {{}}"));
        let mut parameter = |name: &str, text: &str, unit| {
            let spec = vector(name, m, text).about(&of_r, &format!("{text}, of {{}}"));
            d.parameter(match unit {
                "r" => spec.units(&units),
                "r/s" => spec.units(&rates),
                // Phases and angular frequencies of waves.
                "rad" | "rad/s" => spec.unit(unit).in_own_unit(),
                other => spec.unit(other),
            })
        };
        Ok(Reference {
            parts: signals.iter().map(|signal| Part::ALL.map(|part| signal.parts.contains(&part))).collect(),
            signal,
            offset: parameter("offset", "constant part", "r"),
            slope: parameter("slope", "ramp", "r/s"),
            cosine: [
                parameter("cosine_amplitude", "amplitude of the cosine", "r"),
                parameter("cosine_frequency", "angular frequency of the cosine", "rad/s"),
                parameter("cosine_phase", "phase of the cosine", "rad"),
            ],
            sine: [
                parameter("sine_amplitude", "amplitude of the sine", "r"),
                parameter("sine_frequency", "angular frequency of the sine", "rad/s"),
                parameter("sine_phase", "phase of the sine", "rad"),
            ],
            square: [
                parameter("square_amplitude", "amplitude of the square wave, which begins with +1", "r"),
                d.parameter(vector("square_frequency", m, "frequency of the square wave").unit("Hz").min(0.0)),
                d.parameter(vector("square_phase", m, "phase of the square wave").unit("rad").in_own_unit()),
            ],
            step_time: d.parameter(matrix("step_time", m, STEPS, "when the step is taken").unit("s")),
            step_height: d.parameter(matrix("step_height", m, STEPS, "height of the step").units(&units.repeat(STEPS))),
            smooth_start: [
                d.parameter(vector("smooth_start_rate", m, "rate a of the smooth start; 0: none").unit("1/s").min(0.0)),
                d.parameter(
                    vector(
                        "smooth_start_curvature",
                        m,
                        "1: the second derivative starts at zero, too; 0: only the first",
                    )
                    .start(1.0)
                    .min(0.0)
                    .max(1.0),
                ),
            ],
            half_periods: d.discrete(vector("half_periods", m, "half periods of the square wave that have passed")),
            taken: d.discrete(matrix("step_taken", m, STEPS, "1 once the step was taken")),
            r: d.output(described("r", "reference").units(&units)),
            dr: d.output(described("dr", "first time derivative of the reference").units(&rates)),
            ddr: d.output(described("ddr", "second time derivative of the reference").units(&second_rates)),
        })
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        self.parameters_changed(t, v);
    }

    fn parameters_changed<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        for i in 0..self.r.len() {
            v[self.half_periods.at(i)] = self.half_periods_until(t, i, &v.values());
            for j in 0..STEPS {
                v[self.taken.at(i, j)] = S::from_flag(v[self.step_time.at(i, j)].at_most(t));
            }
        }
    }

    fn outputs<S: Scalar>(&self, t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.r.len() {
            let s = self.smooth_start(t, v, i);
            let g = self.shape(t, v, i);
            let steps = S::branch(self.has(Part::Steps, v), || self.steps(v, i), || S::from(0.0));
            y[self.r.at(i)] = s[0] * g[0] + steps;
            y[self.dr.at(i)] = s[1] * g[0] + s[0] * g[1];
            y[self.ddr.at(i)] = s[2] * g[0] + s[1] * g[1] * 2.0 + s[0] * g[2];
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        let none = S::from(f64::INFINITY);
        let edges = (0..self.r.len()).map(|i| self.next_edge(i, v)).fold(none, smaller);
        let has_steps = self.has(Part::Steps, v);
        let first = self.each_step().map(|(i, j)| self.next_step((i, j), has_steps, v)).fold(edges, smaller);
        S::select(first.is_finite(), first, none)
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        let now = self.next_time_event(&v.values());
        let is_one = now.is_finite();
        for i in 0..self.r.len() {
            let is_due = is_one & self.next_edge(i, &v.values()).at_most(now);
            let passed = v[self.half_periods.at(i)];
            v[self.half_periods.at(i)] = S::select(is_due, passed + 1.0, passed);
        }
        for (i, j) in self.each_step() {
            let is_due = is_one & v[self.step_time.at(i, j)].at_most(now);
            v[self.taken.at(i, j)] = S::select(is_due, S::from(1.0), v[self.taken.at(i, j)]);
        }
    }
}

impl Reference {
    fn has<S: Scalar>(&self, part: Part, v: &Values<S>) -> S::Flag {
        let Some(signal) = self.signal else { return true.into() };
        let chosen = v.get(signal);
        let with_part = (1..).zip(&self.parts).filter(|(_, parts)| parts[part as usize]);
        any::<S>(with_part.map(|(item, _)| S::same(chosen, S::integer(item))))
    }

    /// s = 1 − e^(−τ) (1 + τ + κ τ²/2), τ = a t.
    fn smooth_start<S: Scalar>(&self, t: S, v: &Values<S>, i: usize) -> Jet<S> {
        let [a, curvature] = self.smooth_start.map(|parameter| v[parameter][i]);
        let smooth = || {
            let tau = a * t;
            let decay = (-tau).exp();
            let curved = curvature * tau * tau * 0.5;
            let straight = (-curvature + 1.0) * tau;
            [
                -decay * (tau + curved + 1.0) + 1.0,
                a * decay * (straight + curved),
                a * a * decay * (-curvature + 1.0 + curvature * tau - straight - curved),
            ]
        };
        S::branch(a.equals(S::from(0.0)), || [S::from(1.0), S::from(0.0), S::from(0.0)], smooth)
    }

    /// offset + slope t + cosine + sine + square.
    fn shape<S: Scalar>(&self, t: S, v: &Values<S>, i: usize) -> Jet<S> {
        let slope = v[self.slope][i];
        let mut g = [v[self.offset][i] + slope * t, slope, S::from(0.0)];
        let waves = [(Part::Cosine, self.cosine, std::f64::consts::FRAC_PI_2), (Part::Sine, self.sine, 0.0)];
        for (part, wave, lead) in waves {
            let [amplitude, omega, phase] = wave.map(|parameter| v[parameter][i]);
            let with_wave = || {
                let angle = omega * t + phase + lead;
                let (sin, cos) = (angle.sin(), angle.cos());
                [g[0] + amplitude * sin, g[1] + amplitude * omega * cos, g[2] - amplitude * omega * omega * sin]
            };
            g = S::branch(!amplitude.equals(S::from(0.0)) & self.has(part, v), with_wave, || g);
        }
        let with_square = || {
            let passed = v[self.half_periods][i];
            let is_even = passed.equals((passed / 2.0).floor() * 2.0);
            g[0] + v[self.square[0]][i] * S::select(is_even, S::from(1.0), S::from(-1.0))
        };
        g[0] = S::branch(self.has(Part::Square, v), with_square, || g[0]);
        g
    }

    fn steps<S: Scalar>(&self, v: &Values<S>, i: usize) -> S {
        (0..STEPS).map(|j| v[self.step_height.at(i, j)] * v[self.taken.at(i, j)]).fold(S::from(0.0), |sum, h| sum + h)
    }

    /// The square wave's phase, in periods.
    fn square_phase<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        v[self.square[2]][i] / std::f64::consts::TAU
    }

    fn half_periods_until<S: Scalar>(&self, t: S, i: usize, v: &Values<S>) -> S {
        // An edge that t meets up to rounding counts as passed.
        ((v[self.square[1]][i] * t + self.square_phase(i, v)) * 2.0 + 1e-9).floor()
    }

    /// Time of the next edge of the square wave; infinity if there is none.
    fn next_edge<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        let (frequency, zero) = (v[self.square[1]][i], S::from(0.0));
        let has_none = frequency.equals(zero) | v[self.square[0]][i].equals(zero) | !self.has(Part::Square, v);
        let edge = || ((v[self.half_periods][i] + 1.0) / 2.0 - self.square_phase(i, v)) / frequency;
        S::branch(has_none, || S::from(f64::INFINITY), edge)
    }

    /// The channel and the number of each step.
    fn each_step(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        (0..self.r.len()).flat_map(|i| (0..STEPS).map(move |j| (i, j)))
    }

    /// Time at which a step is to be taken; infinity if it was taken.
    fn next_step<S: Scalar>(&self, (i, j): (usize, usize), has_steps: S::Flag, v: &Values<S>) -> S {
        let is_pending = has_steps & v[self.taken.at(i, j)].equals(S::from(0.0));
        S::select(is_pending, v[self.step_time.at(i, j)], S::from(f64::INFINITY))
    }
}

impl Catalogued for Reference {
    const PAGE: Page = pages::REFERENCE;
    const ROLE: Role = Role::Reference;
    const TEMPLATE: Option<Template> =
        Some(Template { write: template, is_uncertain: false, needs: None, tried: &[Sizes::NONE] });
    const TRIAL: Trial = Trial {
        moving: "'offset[1]' = 1.0\n'slope[1]' = 0.5\n'cosine_amplitude[1]' = 2.0\n'cosine_frequency[1]' = 3.0",
        ..Trial::NONE
    };
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "",
        stimulus: Stimulus::Nothing,
        constant_inputs: &[],
        output: "r",
        shows_all: true,
        scale: |_, stop_time| Some(Scale { about: 0.0, size: 0.0, duration: stop_time }),
        example: "cosine_amplitude = 1.0\ncosine_frequency = 1.0\nsmooth_start_rate = 1.0\n'step_time[1,1]' = 6.0\n\
                  'step_height[1,1]' = 1.0",
    });
}

/// Each channel steps to the usual magnitude at 1 s.
fn template(request: &Request) -> Result<Begun, Invalid> {
    request.only(&["outputs"])?;
    let (m, mut signals) = channels(request, request.sizes.outputs, |plant| (plant.sizes().2, &plant.y));
    signals.texts = request.plant.as_ref().map_or(Vec::new(), Plant::output_quantities);
    let (stop_time, step) = experiment(request);
    let mut text = request.begin(&Reference::PAGE, stop_time, step);
    write_channels(&mut text, m, &signals);
    write_names(&mut text, &[("r", named(&signals, "_reference"))]);
    text.table("start");
    text.comment("r = s(t) (offset + slope t + cosine + sine + square) + steps; parameters that aren't set are 0.");
    let heights = request.references(m)?;
    for (i, height) in (1..).zip(&heights) {
        text.set(&format!("\"step_time[{i},1]\""), "1.0", "s, when the first of four steps is taken");
        text.set(&format!("\"step_height[{i},1]\""), number(*height), "its height");
    }
    text.suggest("offset", all(0.0, m), "constant part");
    text.suggest("sine_amplitude", list(&heights), "with sine_frequency (rad/s) and sine_phase (rad)");
    text.suggest("square_amplitude", list(&heights), "with square_frequency (Hz) and square_phase (rad)");
    text.suggest("smooth_start_rate", all(1.0, m), "1/s, rate of the smooth start s(t); 0 is none");
    Ok(text.finish())
}
