//! Numbers of the inference that channels share, or that each has of its own.

use serde::{Deserialize, Serialize};

use crate::system::{Declaration, Parameter, ScalarOf, Shape, Spec, scalar, vector};

/// True if channels share a number, or each has its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Held {
    /// One for all channels.
    #[default]
    Shared,
    /// One for each channel.
    Own,
}

/// Sharing of numbers among channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sharing {
    /// The weights k_p, k_d and k_e. Channels that have their own have a scale of the gain, too.
    pub weights: Held,
    /// The corners of the output sets.
    pub sets: Held,
}

/// The channels of a law.
#[derive(Debug, Clone, Copy)]
pub struct Channels<'a> {
    /// Units of what follows the reference, one a channel.
    pub units: &'a [&'static str],
    /// Quantities in words; none if unknown.
    pub quantities: &'a [String],
    /// True if the rate of it is known.
    pub has_rate: &'a [bool],
}

impl Channels<'_> {
    /// Number of channels.
    pub fn count(&self) -> usize {
        self.units.len()
    }
}

/// A number to be declared.
#[derive(Debug, Clone, Copy)]
pub struct Number<'a> {
    pub name: &'a str,
    pub text: &'a str,
    pub unit: NumberUnit,
    pub start: f64,
    pub limits: Limits,
}

/// The unit of a number.
#[derive(Debug, Clone, Copy)]
pub enum NumberUnit {
    Is(&'static str),
    /// That of what follows the reference, where each channel has its own number.
    OfError,
}

/// Allowed values of a number.
#[derive(Debug, Clone, Copy)]
pub enum Limits {
    /// At least 0.
    NotNegative,
    /// Above 0.
    Positive,
    Within(f64, f64),
}

impl Number<'_> {
    /// Its handle in each channel. A single channel's name has no index.
    pub fn declare(self, held: Held, channels: Channels, d: &mut Declaration) -> Vec<ScalarOf<Parameter>> {
        let (m, starts) = (channels.count(), vec![self.start; channels.count()]);
        self.starting(&starts[..if held == Held::Own { m } else { 1 }], held, channels, d)
    }

    /// The same with starts of each channel's number.
    pub fn starting(
        self,
        starts: &[f64],
        held: Held,
        channels: Channels,
        d: &mut Declaration,
    ) -> Vec<ScalarOf<Parameter>> {
        let m = channels.count();
        match held {
            Held::Own if m > 1 => {
                let text = format!("{}, of the channel of {{}}", self.text);
                let spec = vector(self.name, m, self.text).about(channels.quantities, &text).starts(starts);
                let all = d.parameter(match self.unit {
                    NumberUnit::OfError => self.limited(spec).units(channels.units),
                    NumberUnit::Is(unit) => self.limited(spec).unit(unit),
                });
                (0..m).map(|i| all.at(i)).collect()
            }
            Held::Own => {
                let spec = self.limited(scalar(self.name, self.text)).starts(starts);
                let unit = if let NumberUnit::Is(unit) = self.unit { unit } else { channels.units[0] };
                vec![d.parameter(spec.unit(unit))]
            }
            Held::Shared => {
                let spec = self.limited(scalar(self.name, self.text)).starts(starts);
                let unit = if let NumberUnit::Is(unit) = self.unit { unit } else { "1" };
                vec![d.parameter(spec.unit(unit)); m]
            }
        }
    }

    fn limited<D: Shape>(&self, spec: Spec<D>) -> Spec<D> {
        match self.limits {
            Limits::NotNegative => spec.min(0.0),
            Limits::Positive => spec.positive(),
            Limits::Within(min, max) => spec.min(min).max(max),
        }
    }
}
