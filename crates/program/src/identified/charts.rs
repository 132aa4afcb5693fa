//! Charts of an identification: poles, frequency responses, correlations.

use std::f64::consts::TAU;

use adaptive_fmu_identification::{Correlations, Model, Pole, Response, chi_squared};

use crate::drawing::{Chart, Line, colours};
use crate::figures::labelled;

/// Points of an ellipse.
const POINTS: usize = 72;
/// Standard deviations that contain 99 % of normal numbers.
const NORMAL: f64 = 2.576;
/// Free space on both sides of poles, as a part of the range.
const MARGIN: f64 = 0.06;

fn line(name: &str, points: Vec<(f64, Option<f64>)>) -> Line {
    Line { name: name.to_owned(), colour: colours::LINE.to_owned(), points, marked: false, dashed: false }
}

fn dashed(name: &str, points: Vec<(f64, Option<f64>)>) -> Line {
    Line { colour: colours::COMPARED.to_owned(), dashed: true, ..line(name, points) }
}

/// A chart with its words.
pub struct Figure {
    pub title: String,
    x: String,
    y: String,
    logarithmic: bool,
    lines: Vec<Line>,
}

impl Figure {
    fn new(title: String, x: &str, y: &str, lines: Vec<Line>) -> Self {
        Figure { title, x: x.to_owned(), y: y.to_owned(), logarithmic: false, lines }
    }

    /// The picture without its title.
    pub fn drawing(self) -> String {
        let Figure { title, x, y, logarithmic, lines } = self;
        Chart { title: &title, x: &x, y: &y, logarithmic, lines }.drawing()
    }
}

/// Poles with the ellipses that contain them with a confidence; real ones have intervals.
pub fn poles(poles: &[Pole], level: f64) -> Figure {
    let [interval, plane] = [1, 2].map(|freedom| chi_squared(level, freedom).sqrt());
    let mut lines = Vec::new();
    for pole in poles {
        let name = format!("{} {:+} j", crate::report::number(pole.real), pole.imaginary);
        let is_known = pole.covariance.iter().all(|entry| entry.is_finite());
        if is_known && pole.imaginary == 0.0 {
            let half = interval * pole.covariance[0].max(0.0).sqrt();
            let ends = [pole.real - half, pole.real + half].map(|end| (end, Some(0.0)));
            lines.push(Line { marked: true, ..dashed(&name, ends.to_vec()) });
        } else if is_known {
            lines.push(line(&name, ellipse(pole, plane)));
        }
        lines.push(Line { marked: true, ..line(&name, vec![(pole.real, Some(pole.imaginary))]) });
    }
    let places = || lines.iter().flat_map(|line| &line.points).map(|(real, _)| *real);
    let (low, high) = (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
    // Nothing is drawn on the frame.
    let apart = if high > low { MARGIN * (high - low) } else { low.abs().max(1.0) };
    lines.push(line("", vec![(low - apart, None), (high + apart, None)]));
    Figure::new("Poles".to_owned(), &labelled("real part", "1/s"), &labelled("imaginary part", "rad/s"), lines)
}

/// Ellipse of a pole at so many standard deviations. A Cholesky factor of its covariance maps unit vectors to it.
fn ellipse(pole: &Pole, size: f64) -> Vec<(f64, Option<f64>)> {
    let [along, across, both] = pole.covariance;
    let first = along.max(0.0).sqrt();
    let slope = if first > 0.0 { both / first } else { 0.0 };
    let rest = (across - slope * slope).max(0.0).sqrt();
    let at = |k: usize| {
        let (sine, cosine) = (TAU * k as f64 / POINTS as f64).sin_cos();
        (pole.real + size * first * cosine, Some(pole.imaginary + size * (slope * cosine + rest * sine)))
    };
    (0..=POINTS).map(at).collect()
}

/// Magnitude and phase, with bounds of so many standard errors.
pub fn bode(response: &Response, model: &Model, errors: f64) -> [Figure; 2] {
    let name = |names: &[String], symbol: &str, k: usize| {
        names.get(k).cloned().unwrap_or_else(|| format!("{symbol}[{}]", k + 1))
    };
    let names = (name(&model.inputs, "u", response.input), name(&model.outputs, "y", response.output));
    let of = |what: &str, y: &str, values: &[f64], deviations: &[f64]| {
        let points = |by: f64| {
            let bound = |(value, error): (&f64, &f64)| Some(value + by * error).filter(|bound| bound.is_finite());
            let bounds = values.iter().zip(deviations).map(bound);
            response.frequencies.iter().copied().zip(bounds).collect::<Vec<_>>()
        };
        let lines = vec![dashed("bound", points(-errors)), dashed("bound", points(errors)), line(what, points(0.0))];
        let title = format!("{} to {}: {what}", names.0, names.1);
        Figure { logarithmic: true, ..Figure::new(title, "frequency in rad/s", y, lines) }
    };
    [
        of("magnitude", "magnitude in dB", &response.magnitude, &response.magnitude_error),
        of("phase", "phase in degrees", &response.phase, &response.phase_error),
    ]
}

/// Autocorrelations of the residuals, and their correlations with the inputs.
pub fn correlations(found: &Correlations, signals: &[&str], inputs: &[String]) -> Vec<Figure> {
    let of = |title: String, first: i64, values: &[f64]| {
        let last = first + values.len() as i64 - 1;
        let bound = |value: f64| dashed("99 %", vec![(first.min(0) as f64, Some(value)), (last as f64, Some(value))]);
        let stems = values.iter().enumerate().map(|(k, value)| {
            let lag = (first + k as i64) as f64;
            let stem = |points| line(&format!("{lag}"), points);
            [
                stem(vec![(lag, Some(0.0)), (lag, Some(*value))]),
                Line { marked: true, ..stem(vec![(lag, Some(*value))]) },
            ]
        });
        let lines = [bound(-NORMAL), bound(NORMAL)].into_iter().chain(stems.flatten()).collect();
        Figure::new(title, "rows later", "correlation in standard errors", lines)
    };
    let mut all = Vec::new();
    for (i, signal) in signals.iter().enumerate() {
        all.extend(found.own.get(i).map(|own| of(format!("{signal} and itself"), 1, own)));
        for (values, input) in found.with_inputs.get(i).into_iter().flatten().zip(inputs) {
            all.push(of(format!("{signal} and {input}"), -(values.len() as i64 / 2), values));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ellipses_have_the_same_density_all_the_way_and_real_poles_have_an_interval() {
        let [along, across, both] = [0.04, 0.09, -0.03];
        let pole = Pole { real: -1.0, imaginary: 2.0, covariance: [along, across, both] };
        for (real, imaginary) in ellipse(&pole, 9.21_f64.sqrt()) {
            let [x, y] = [real + 1.0, imaginary.unwrap() - 2.0];
            let distance = (across * x * x - 2.0 * both * x * y + along * y * y) / (along * across - both * both);
            assert!((distance - 9.21).abs() < 1e-9, "{distance}");
        }
        let real = Pole { imaginary: 0.0, covariance: [along, 1e-20, 1e-20], ..pole };
        let interval = &poles(&[real], 0.99).lines[0].points;
        assert_eq!(interval.len(), 2);
        for ((end, imaginary), sign) in interval.iter().zip([-1.0, 1.0]) {
            assert!(*imaginary == Some(0.0) && (end + 1.0 - sign * NORMAL * 0.2).abs() < 1e-3, "{end}");
        }
    }
}
