//! An angle without jumps from one that wraps.

use std::f64::consts::PI;

use serde::Deserialize;

use crate::catalogue::{Catalogued, Demonstration, Role, Scale, Stimulus};
use crate::mathematics::angle;
use crate::pages::{self, Page};
use crate::system::{
    Declaration, Discrete, Input, Invalid, Point, Scalar, Signal, Signals, System, Values, VectorOf, quantities, vector,
};

/// Largest number of channels.
const MOST_CHANNELS: usize = 1000;

/// Number of angles, and what they are.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Angles {
    /// Number of angles, 1 … 1000. Their unit is rad.
    channels: usize,
    /// Quantities of the channels in words, one each, as "yaw angle"; descriptions count channels where none are given.
    #[serde(default)]
    quantities: Vec<String>,
}

/// y = last + wrap(u − last) in each channel: the angle nearest to the last one.
#[derive(Debug)]
pub struct Unwrap {
    u: VectorOf<Input>,
    y: VectorOf<Signal>,
    /// y at the last communication point or completed step.
    last: VectorOf<Discrete>,
}

impl System for Unwrap {
    type Structure = Angles;
    const NAME: &'static str = "unwrap";
    const DOCUMENTATION: &'static str = pages::UNWRAP.text;

    fn declare(structure: Angles, d: &mut Declaration) -> Result<Self, Invalid> {
        let m = structure.channels;
        if !(1..=MOST_CHANNELS).contains(&m) {
            return Err(Invalid::new("channels", m, format!("must be within 1 … {MOST_CHANNELS}")));
        }
        let of_u = quantities("u", &structure.quantities, m)?;
        Ok(Unwrap {
            u: d.input(vector("u", m, "measured angle, which may wrap").about(&of_u, "{} that may wrap").unit("rad")),
            y: d.output(vector("y", m, "angle without jumps").about(&of_u, "{} without jumps").unit("rad")),
            last: d.discrete(vector("#last", m, "").hidden()),
        })
    }

    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.u, self.last);
    }

    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        for i in 0..self.y.len() {
            y[self.y][i] = self.unwrapped(i, v);
        }
    }

    /// last := y
    fn step_completed<S: Scalar>(&self, _t: S, _step: S, v: &mut Point<S>) {
        for i in 0..self.last.len() {
            v[self.last][i] = self.unwrapped(i, &v.values());
        }
    }
}

impl Unwrap {
    fn unwrapped<S: Scalar>(&self, i: usize, v: &Values<S>) -> S {
        angle::nearest(v[self.u][i], v[self.last][i])
    }
}

impl Catalogued for Unwrap {
    const PAGE: Page = pages::UNWRAP;
    const ROLE: Role = Role::Sensor;
    const DEMONSTRATION: Option<Demonstration> = Some(Demonstration {
        input: "u",
        stimulus: Stimulus::Turns,
        constant_inputs: &[],
        output: "y",
        shows_all: false,
        scale: |_, stop_time| Some(Scale { about: 0.0, size: PI, duration: stop_time }),
        example: "",
    });
}
