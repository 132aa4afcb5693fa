//! Axes of diagrams: their labels, ranges and ticks.

use std::collections::BTreeSet;

/// Quantities by the units that identify them.
const QUANTITIES: &[(&str, &[&str])] = &[
    ("position", &["m", "mm", "cm", "km"]),
    ("angle", &["rad", "mrad", "deg", "rev"]),
    ("speed", &["m/s", "km/h"]),
    ("angular speed", &["rad/s", "deg/s", "rpm", "rev/min", "rev/s"]),
    ("acceleration", &["m/s2"]),
    ("angular acceleration", &["rad/s2", "deg/s2"]),
    ("force", &["N", "kN"]),
    ("torque", &["N.m", "kN.m"]),
    ("voltage", &["V", "mV", "kV"]),
    ("current", &["A", "mA"]),
    ("power", &["W", "kW"]),
    ("energy", &["J", "kJ"]),
    ("temperature", &["K", "degC"]),
    ("pressure", &["Pa", "kPa", "bar"]),
    ("mass", &["kg", "g"]),
    ("time", &["s", "ms", "min", "h"]),
    ("frequency", &["Hz", "kHz"]),
];
/// The most units at one axis: more can't be read.
const MOST_UNITS: usize = 2;
/// Least lower end of an axis of magnitudes, in parts of its upper end.
const LEAST_PART: f64 = 1e-9;
/// Factor by which it exceeds its largest value.
const ABOVE: f64 = 1.5;

/// A unit as it is printed: `N m`, `m/s²`.
pub fn printed_unit(unit: &str) -> String {
    let mut printed = String::new();
    for c in unit.chars() {
        let raised = printed.chars().last().is_some_and(char::is_alphabetic);
        printed.push(match c {
            '.' | '*' => ' ',
            '2' if raised => '²',
            '3' if raised => '³',
            other => other,
        });
    }
    printed
}

/// A quantity with its unit in parentheses: a dash for a plain number, nothing for an unknown unit.
pub fn labelled(quantity: &str, unit: &str) -> String {
    match unit {
        "" => quantity.to_owned(),
        "1" => format!("{quantity} (–)"),
        unit => format!("{quantity} ({})", printed_unit(unit)),
    }
}

/// The label of the axis of values: the quantities of the units, or the beginning of the title.
pub fn value_label(title: &str, units: &BTreeSet<&str>, errors: bool) -> String {
    let known: Vec<&str> = units.iter().copied().filter(|unit| !unit.is_empty()).collect();
    let title = title.rsplit(": ").next().unwrap_or(title);
    let of_title = [", ", " and ", " in "].iter().fold(title, |title, end| title.split(end).next().unwrap_or(title));
    let quantity = |unit: &str| {
        let of_unit = QUANTITIES.iter().find(|(_, units)| units.contains(&unit)).map(|(quantity, _)| *quantity);
        if errors { "error" } else { of_unit.unwrap_or(if of_title.is_empty() { "value" } else { of_title }) }
    };
    match known[..] {
        [] => quantity("").to_owned(),
        _ if known.len() > MOST_UNITS => "values, each in its unit".to_owned(),
        _ => known.iter().map(|unit| labelled(quantity(unit), unit)).collect::<Vec<_>>().join(", "),
    }
}

/// Smallest and largest of some values, with a margin.
pub fn padded_range<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    if low > high {
        return (-1.0, 1.0);
    }
    let margin = if high > low { 0.06 * (high - low) } else { low.abs().max(1.0) * 0.1 };
    (low - margin, high + margin)
}

/// The range of an axis of magnitudes: from the decade of the lowest values above 0, without a hundredth of them, to a
/// little above the largest.
pub fn decades<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let mut above: Vec<f64> = values.copied().filter(|value| value.is_finite() && *value > 0.0).collect();
    let Some(largest) = above.iter().copied().max_by(f64::total_cmp) else { return (0.1, 1.0) };
    let place = above.len() / 100;
    let (_, &mut least, _) = above.select_nth_unstable_by(place, f64::total_cmp);
    let (low, high) = (10_f64.powf(least.log10().floor()), largest * ABOVE);
    (low.max(high * LEAST_PART), high)
}

/// An axis: its range and spacing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// Lower end; above 0 on a logarithmic axis.
    pub low: f64,
    /// Upper end, above `low`.
    pub high: f64,
    /// True if equal lengths are equal ratios.
    pub logarithmic: bool,
}

impl Axis {
    /// A linear one.
    pub fn linear((low, high): (f64, f64)) -> Self {
        Axis { low, high: if high > low { high } else { low + 1.0 }, logarithmic: false }
    }

    /// The part of its length at which a value is; values without a logarithm are far below.
    pub fn place(&self, value: f64) -> f64 {
        self.places()(value)
    }

    /// The same of many values.
    pub fn places(&self) -> impl Fn(f64) -> f64 + use<> {
        let Axis { low, high, logarithmic } = *self;
        let length = if logarithmic { (high / low).log10() } else { high - low };
        move |value| match logarithmic {
            false => (value - low) / length,
            true if value > 0.0 => ((value / low).log10() / length).max(-1.0),
            true => -1.0,
        }
    }

    /// About so many round numbers within it, with their texts.
    pub fn ticks(&self, count: f64) -> Vec<(f64, String)> {
        let Axis { low, high, logarithmic } = *self;
        if logarithmic {
            let (first, last) = (low.log10().ceil() as i32, high.log10().floor() as i32);
            let every = (f64::from(last - first) / count).ceil().max(1.0) as usize;
            return (first..=last).step_by(every).map(|power| (10_f64.powi(power), power_of_ten(power))).collect();
        }
        let rough = (high - low) / count;
        let ten = 10_f64.powf(rough.log10().floor());
        let factor = [1.0, 2.0, 5.0, 10.0].into_iter().find(|factor| factor * ten >= rough * (1.0 - 1e-9));
        let step = ten * factor.unwrap_or(10.0);
        let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
        let values = (first..=last).map(|k| k as f64 * step);
        values.map(|value| (value, written(value, step, low.abs().max(high.abs())))).collect()
    }
}

/// A multiple of a step, with as many digits as the step.
fn written(value: f64, step: f64, largest: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let places = (step.log10() + 1e-9).floor() as i32;
    if !(1e-3..1e5).contains(&largest) {
        let digits = ((value.abs().log10() + 1e-9).floor() as i32 - places).max(0) as usize;
        return format!("{value:.digits$e}").replace('-', "−");
    }
    format!("{value:.digits$}", digits = (-places).max(0) as usize).replace('-', "−")
}

fn power_of_ten(power: i32) -> String {
    match power {
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        _ => {
            let raised = |c: char| {
                c.to_digit(10).map_or('⁻', |digit| ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit as usize])
            };
            format!("10{}", power.to_string().chars().map(raised).collect::<String>())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_is_labelled_by_a_quantity_with_its_unit_in_parentheses() {
        let label = |title: &str, units: &[&str]| value_label(title, &units.iter().copied().collect(), false);
        assert_eq!(label("joints and references", &["rad"]), "angle (rad)");
        assert_eq!(label("moments", &["N.m"]), "torque (N m)");
        assert_eq!(label("4-case1: output and reference", &["", "1"]), "output (–)");
        assert_eq!(label("fuzzy gain", &["1/s"]), "fuzzy gain (1/s)");
        assert_eq!(label("states and the ideal model", &[]), "states");
        assert_eq!(label("control", &["N", "N.m"]), "force (N), torque (N m)");
        assert_eq!(value_label("errors", &["m/s2"].into(), true), "error (m/s²)");
    }

    #[test]
    fn ticks_are_round_and_powers_of_ten_where_the_axis_is_logarithmic() {
        let written = |axis: Axis| axis.ticks(5.0).into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(written(Axis::linear((-1.1, 2.2))), ["−1", "0", "1", "2"]);
        assert_eq!(written(Axis::linear((0.0, 0.05))), ["0", "0.01", "0.02", "0.03", "0.04", "0.05"]);
        let (low, high) = decades([2e-3, 3.0, -1.0, 0.0].iter());
        assert_eq!(written(Axis { low, high, logarithmic: true }), ["10⁻³", "10⁻²", "10⁻¹", "1"]);
    }

    #[test]
    fn equal_ratios_are_equal_lengths_of_a_logarithmic_axis() {
        let axis = Axis { low: 1e-3, high: 1e3, logarithmic: true };
        assert!((axis.place(1.0) - 0.5).abs() < 1e-12 && (axis.place(10.0) - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!((axis.place(0.0), axis.place(-1.0)), (-1.0, -1.0));
    }
}
