//! Signals of an experiment, added to a plant's inputs so that a record shows its dynamics.

mod signal;
mod template;

use std::f64::consts::TAU;

use signal::{ExcitationStructure, Periodic, Shape};

use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus};
use crate::pages::{self, Page};
use crate::recording::Opaque;
use crate::system::{
    Declaration, Discrete, Input, IntegerOf, Invalid, Parameter, Point, Scalar, ScalarOf, Signal, Signals, System,
    Unit, Values, VectorOf, integer, quantities, scalar, smaller, vector,
};
use crate::template::{Sizes, Template};

/// The fewest samples of a level.
const SHORTEST_LEVEL: f64 = 2.0;
/// Waves that a picture shows clearly, and curves in it.
const WAVES: f64 = 40.0;
const CURVES: f64 = 4.0;

/// u = command + offset + amplitude s, with s within −1 … 1 constant from one sample to the next.
#[derive(Debug)]
pub struct Excitation {
    sample_time: f64,
    amplitude: VectorOf<Parameter>,
    offset: VectorOf<Parameter>,
    course: Course,
    /// Time of sample 0, and the number of the latest one; of levels, that of the latest change.
    start: ScalarOf<Discrete>,
    sample: ScalarOf<Discrete>,
    /// s.
    signal: VectorOf<Discrete>,
    command: VectorOf<Input>,
    u: VectorOf<Signal>,
}

/// The course of s.
#[derive(Debug)]
enum Course {
    Levels(Levels),
    Periodic(Periodic),
}

/// Levels of random heights and lengths.
#[derive(Debug)]
struct Levels {
    /// The most samples of one.
    longest: f64,
    seed: IntegerOf<Parameter>,
    /// The number of levels so far, and the sample at which the next one begins, of each channel.
    count: VectorOf<Discrete>,
    next: VectorOf<Discrete>,
}

impl System for Excitation {
    type Structure = ExcitationStructure;
    const NAME: &'static str = "excitation";
    const DOCUMENTATION: &'static str = pages::EXCITATION.text;

    fn declare(structure: ExcitationStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let shape = Shape::of(&structure)?;
        let m = structure.channels;
        let (units, of_u) = (Unit::symbols("u", &structure.units, m)?, quantities("u", &structure.quantities, m)?);
        let about = |name: &str, plain: &str, text: &str| vector(name, m, plain).about(&of_u, text).units(&units);
        let largest = "largest deviation from command and offset";
        Ok(Excitation {
            amplitude: d.parameter(about("amplitude", largest, &format!("{largest}, of {{}}")).start(1.0).min(0.0)),
            offset: d.parameter(about("offset", "operating point of the experiment", "operating point of {}")),
            course: match shape {
                Shape::Levels { longest } => Course::Levels(Levels::declare(d, m, longest)),
                Shape::Periodic(periodic) => Course::Periodic(periodic),
            },
            start: d.discrete(scalar("#start", "").hidden()),
            sample: d.discrete(scalar("#sample", "").hidden()),
            signal: d.discrete(vector("#signal", m, "").hidden()),
            command: d.input(about("command", "control that the signal is added to", "commanded {}")),
            u: d.output(about("u", "input of the plant", "{} with the signal added")),
            sample_time: structure.sample_time,
        })
    }

    fn initialise<S: Scalar>(&self, t: S, v: &mut Point<S>) {
        v[self.start] = t;
        v[self.sample] = S::from(0.0);
        self.take(v);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.u.len() {
            y[self.u][i] = v[self.command][i] + v[self.offset][i] + v[self.amplitude][i] * v[self.signal][i];
        }
    }

    fn next_time_event<S: Scalar>(&self, v: &Values<S>) -> S {
        v[self.start] + self.next_sample(v) * self.sample_time
    }

    fn event<S: Scalar>(&self, _t: S, _crossed: &[S::Flag], v: &mut Point<S>) {
        v[self.sample] = self.next_sample(&v.values());
        self.take(v);
    }
}

impl Excitation {
    /// The sample at which something changes next.
    fn next_sample<S: Scalar>(&self, v: &Values<S>) -> S {
        match &self.course {
            Course::Levels(levels) => v[levels.next].iter().copied().fold(S::from(f64::INFINITY), smaller),
            Course::Periodic(_) => v[self.sample] + 1.0,
        }
    }

    /// The signals at the latest sample.
    fn take<S: Scalar>(&self, v: &mut Point<S>) {
        let k = v[self.sample];
        for i in 0..self.signal.len() {
            match &self.course {
                Course::Levels(levels) => {
                    let is_due = v[levels.next][i].at_most(k);
                    v.when(is_due, |v| v[self.signal][i] = levels.begin(i, v));
                }
                Course::Periodic(periodic) => v[self.signal][i] = periodic.at(i, k),
            }
        }
    }
}

impl Levels {
    fn declare(d: &mut Declaration, m: usize, longest: f64) -> Self {
        Levels {
            longest,
            seed: d.parameter(integer("seed", "selects the levels, which differ for each seed").start(1).fixed()),
            count: d.discrete(vector("#levels", m, "").hidden()),
            next: d.discrete(vector("#next level", m, "").hidden()),
        }
    }

    /// Begins the next level of a channel, and gives its height. Height and length follow from the seed, the channel and the number
    /// of the level.
    fn begin<S: Scalar>(&self, i: usize, v: &mut Point<S>) -> S {
        let (seed, number) = (S::from_integer(v.get(self.seed)), v[self.count][i]);
        let drawn = |which: f64| S::opaque(Opaque::Uniform, &[seed, S::from(i as f64), number * 2.0 + which]);
        let lengths = self.longest - SHORTEST_LEVEL + 1.0;
        let length = ((-drawn(1.0) + 1.0) * lengths).floor() + SHORTEST_LEVEL;
        v[self.next][i] += smaller(length, S::from(self.longest));
        v[self.count][i] += 1.0;
        drawn(0.0) * 2.0 - 1.0
    }
}

/// The part of a period in which a chirp, from 1 to κ waves a period, has few enough of them in each of some channels to be seen.
fn sweep(ratio: f64, channels: f64) -> f64 {
    // The last channel begins nearly a period ahead, so it is the fastest.
    let fastest = |part: f64| ratio.powf((part + (channels - 1.0) / channels).min(1.0));
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..50 {
        let part = 0.5 * (low + high);
        *(if part * fastest(part) > WAVES { &mut high } else { &mut low }) = part;
    }
    low
}

impl Catalogued for Excitation {
    const PAGE: Page = pages::EXCITATION;
    const ROLE: Role = Role::Excitation;
    const TEMPLATE: Option<Template> = Some(Template {
        write: template::template,
        is_uncertain: false,
        needs: None,
        tried: &[Sizes::inputs(1), Sizes::inputs(3)],
    });
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "",
        stimulus: Stimulus::Nothing,
        constant_inputs: &["command"],
        output: "u",
        shows_all: true,
        // Long enough for some levels, and short enough to distinguish the samples of a wave.
        scale: |of, stop_time| {
            let (levels, highest, period) = (5.0 * of("longest_level"), of("highest_frequency"), of("period"));
            let waves = match of("signal = chirp") > 0.0 {
                true => period * sweep(highest * period / TAU, of("channels").min(CURVES)),
                false if highest > 0.0 => WAVES * TAU / highest,
                false => 0.0,
            };
            let duration = (100.0 * of("sample_time")).max(levels).max(waves).min(stop_time);
            Some(Scale { about: 0.0, size: 0.0, duration })
        },
        example: "",
    });
}
