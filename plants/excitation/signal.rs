//! The signals of an experiment, as a description gives them.

use std::f64::consts::{PI, TAU};

use serde::Deserialize;

use crate::error::{Invalid, Number};
use crate::system::Scalar;

/// Samples that a level may have, and a signal until it repeats.
pub(super) const MOST_SAMPLES: f64 = 1e6;
/// Terms that a multisine may add up in a whole period.
pub(super) const MOST_TERMS: f64 = 3e7;
/// Steps of signals, s.
pub(super) const SAMPLE_TIMES: std::ops::RangeInclusive<f64> = 1e-9..=1e9;
/// Whole numbers are met up to this part of them.
const ROUNDING: f64 = 1e-9;

/// A signal that shows a plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Levels,
    Multisine,
    Chirp,
}

/// Number of channels, and the signal with its times.
#[derive(Debug, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExcitationStructure {
    /// Number of inputs of the plant, 1 … 1000.
    pub channels: usize,
    /// Units of the inputs, one each; 1 where none are given.
    #[serde(default)]
    pub units: Vec<String>,
    /// Quantities of the inputs in words, one each, as "voltage"; descriptions count channels where none are given.
    #[serde(default)]
    pub quantities: Vec<String>,
    /// The signal: levels of random heights and lengths, a multisine, or a chirp.
    signal: Kind,
    /// Step of the signal, s: the signal is constant from one sample to the next.
    pub sample_time: f64,
    /// Longest level, s, with signal = "levels".
    longest_level: Option<f64>,
    /// Time after which the signal repeats, s, a multiple of sample_time, with signal = "multisine" or "chirp".
    period: Option<f64>,
    /// Highest angular frequency of the signal, rad/s, with signal = "multisine" or "chirp".
    highest_frequency: Option<f64>,
}

/// A signal in samples.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// Each level is at most so many samples long.
    Levels { longest: f64 },
    /// It repeats.
    Periodic(Periodic),
}

/// A signal that repeats, for each of m channels.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Periodic {
    channels: usize,
    /// Samples of a period, N.
    samples: usize,
    form: Form,
}

#[derive(Debug, Clone, PartialEq)]
enum Form {
    /// The highest harmonic, and the largest amount of each channel's sum.
    Multisine { harmonics: usize, peaks: Vec<f64> },
    /// The highest frequency in parts of the lowest, κ.
    Chirp { ratio: f64 },
}

impl Shape {
    /// The signal of a description.
    ///
    /// # Errors
    /// A key that is missing or belongs to another signal, and a number beyond what is allowed.
    pub fn of(structure: &ExcitationStructure) -> Result<Self, Invalid> {
        let ExcitationStructure { channels, signal, sample_time, longest_level, period, highest_frequency, .. } =
            structure;
        if !(1..=1000).contains(channels) {
            return Err(Invalid::new("channels", channels, "must be within 1 … 1000"));
        }
        if !SAMPLE_TIMES.contains(sample_time) {
            return Err(Invalid::new("sample_time", Number(*sample_time), "must be within 1e-9 … 1e9, in s"));
        }
        let has_levels = *signal == Kind::Levels;
        let only = |key: &str, given: &Option<f64>, is_needed: bool| match given {
            Some(value) if !is_needed => Err(Invalid::new(key, Number(*value), "belongs to another signal")),
            None if is_needed => Err(Invalid::because(format!("`{key}` is missing: this signal needs it"))),
            given => Ok(given.unwrap_or_default()),
        };
        let longest_level = only("longest_level", longest_level, has_levels)?;
        let period = only("period", period, !has_levels)?;
        let highest = only("highest_frequency", highest_frequency, !has_levels)?;
        if has_levels {
            return levels(longest_level, *sample_time);
        }
        let samples = samples(period, *sample_time)?;
        let least = if *signal == Kind::Chirp { 1 } else { *channels };
        let in_periods = highest_in_periods(highest, (period, *sample_time), least)?;
        let form = match signal {
            Kind::Chirp => Form::Chirp { ratio: in_periods },
            _ => multisine(*channels, samples, in_periods)?,
        };
        Ok(Shape::Periodic(Periodic { channels: *channels, samples, form }))
    }
}

/// The whole number of samples of the longest level.
pub(super) fn of_level(longest: f64, sample_time: f64) -> f64 {
    (longest / sample_time * (1.0 + ROUNDING)).floor()
}

fn levels(longest: f64, sample_time: f64) -> Result<Shape, Invalid> {
    let samples = of_level(longest, sample_time);
    if (super::SHORTEST_LEVEL..=MOST_SAMPLES).contains(&samples) {
        return Ok(Shape::Levels { longest: samples });
    }
    let [least, most] = [super::SHORTEST_LEVEL, MOST_SAMPLES].map(|samples| Number(samples * sample_time));
    Err(Invalid::new("longest_level", Number(longest), format!("must be within {least} … {most}, in s")))
}

fn samples(period: f64, sample_time: f64) -> Result<usize, Invalid> {
    let samples = (period / sample_time).round();
    let is_whole = (period / sample_time - samples).abs() <= samples * ROUNDING;
    if is_whole && (4.0..=MOST_SAMPLES).contains(&samples) {
        return Ok(samples as usize);
    }
    let [least, most] = [4.0, MOST_SAMPLES].map(|samples| Number(samples * sample_time));
    let allowed = format!("must be a multiple of sample_time within {least} … {most}, in s");
    Err(Invalid::new("period", Number(period), allowed))
}

/// The highest frequency as a multiple of that of the period, of which there must be so many.
fn highest_in_periods(highest: f64, (period, sample_time): (f64, f64), least: usize) -> Result<f64, Invalid> {
    let (lowest, nyquist) = (TAU / period * least as f64, PI / sample_time);
    let is_within = highest >= lowest * (1.0 - ROUNDING) && highest <= nyquist * (1.0 + ROUNDING);
    // A sweep goes from one frequency to another.
    if is_within && highest > TAU / period * (1.0 + ROUNDING) {
        return Ok(highest * period / TAU);
    }
    let [lowest, nyquist] = [lowest, nyquist].map(crate::report::number);
    let turns = 2 * least;
    let allowed = format!("must be within {lowest} … {nyquist}, in rad/s: from {turns} pi/period to pi/sample_time");
    Err(Invalid::new("highest_frequency", Number(highest), allowed))
}

fn multisine(channels: usize, samples: usize, highest: f64) -> Result<Form, Invalid> {
    let harmonics = (highest * (1.0 + ROUNDING)).floor() as usize;
    let terms = harmonics as f64 * samples as f64;
    if terms > MOST_TERMS {
        let allowed = format!(
            "must be at most {}, where harmonics times samples are {}: shorten the period or lower highest_frequency",
            Number(MOST_TERMS),
            Number(terms)
        );
        return Err(Invalid::new("size", Number(terms), allowed));
    }
    let waves: Vec<[f64; 2]> = (0..samples)
        .map(|k| {
            let (sin, cos) = (TAU * k as f64 / samples as f64).sin_cos();
            [cos, sin]
        })
        .collect();
    let peaks = (0..channels).map(|i| peak(i, channels, harmonics, &waves)).collect();
    Ok(Form::Multisine { harmonics, peaks })
}

impl Periodic {
    /// The signal of a channel at sample k.
    // A function of its own: within its caller, compilers divide by the period before they know that there is one, 0/0.
    #[inline(never)]
    pub fn at<S: Scalar>(&self, i: usize, k: S) -> S {
        match &self.form {
            Form::Multisine { harmonics, peaks } => self.multisine(i, k, *harmonics) / peaks[i],
            Form::Chirp { ratio } => self.chirp(i, k, *ratio),
        }
    }

    /// Σ cos(2π h_l k / N + φ_l) over every m-th harmonic h_l, with Schroeder's phases φ_l = −π l (l − 1) / L.
    fn multisine<S: Scalar>(&self, i: usize, k: S, harmonics: usize) -> S {
        let (m, n, lines) = (self.channels, self.samples as f64, lines(i, self.channels, harmonics));
        let k = rest(k, n);
        // How many lines were added, and their sum.
        let mut sum = [S::from(0.0), S::from(0.0)];
        let is_left = |sum: &[S]| sum[0].below(S::from(lines as f64));
        S::iterate(&mut sum, lines, is_left, |sum| {
            let l = sum[0];
            let harmonic = l * m as f64 + (i + 1) as f64;
            let turns = rest(harmonic * k, n) / n;
            let phase = rest(l * (l + 1.0), 2.0 * lines as f64) / lines as f64;
            sum[1] += ((turns * 2.0 - phase) * PI).cos();
            sum[0] += 1.0;
        });
        sum[1]
    }

    /// sin(2π (κ^p − 1) / ln κ) at the part p of a sweep, each channel an m-th of it ahead of the one before.
    fn chirp<S: Scalar>(&self, i: usize, k: S, ratio: f64) -> S {
        let n = self.samples as f64;
        let ahead = (i as f64 * n / self.channels as f64).round();
        let part = rest(k + ahead, n) / n;
        (((part * ratio.ln()).exp() - 1.0) * (TAU / ratio.ln())).sin()
    }
}

/// The remainder of a whole number by another: exact below 2^53.
fn rest<S: Scalar>(number: S, of: f64) -> S {
    number - (number / of).floor() * of
}

/// The number of lines of a channel: every m-th harmonic is its own, so that no two channels share one.
fn lines(i: usize, m: usize, harmonics: usize) -> usize {
    (harmonics - i - 1) / m + 1
}

/// The largest amount of a channel's sum, at a sample of a period.
fn peak(i: usize, m: usize, harmonics: usize, waves: &[[f64; 2]]) -> f64 {
    let (count, samples) = (lines(i, m, harmonics), waves.len());
    let mut sums = vec![0.0; samples];
    for l in 0..count {
        let phase = -PI * ((l * (l + 1)) % (2 * count)) as f64 / count as f64;
        let (sin, cos) = phase.sin_cos();
        let (harmonic, mut place) = (l * m + i + 1, 0);
        for sum in &mut sums {
            *sum += waves[place][0] * cos - waves[place][1] * sin;
            place = (place + harmonic) % samples;
        }
    }
    sums.into_iter().map(f64::abs).fold(0.0, f64::max)
}
