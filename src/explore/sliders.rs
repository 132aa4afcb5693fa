//! Which parameters of a loop have a slider, and over which range.

use serde::Serialize;

use crate::catalogue::Role;
use crate::library;
use crate::model::Description;
use crate::model_description::Variable;
use crate::simulation::{LoadedLoop, Place, Structure};
use crate::system::NO_LIMIT;

/// So many sliders of a unit are shown at first.
const FIRST_OF_CONTROLLER: usize = 8;
const FIRST_OF_OTHERS: usize = 3;
/// A range over more than this is logarithmic.
const DECADES: f64 = 1e3;
/// How many times smaller or larger than its start value a parameter gets that has no limits.
const APART: f64 = 100.0;
/// Words of parameters that are about how equations are solved, not about what they say.
const ABOUT_NUMBERS: [&str; 6] = ["tolerance", "_limit", "phase", "fixed_steps", "nominal", "tracking_time"];
/// Words of parameters that are turned first.
const FIRST: [&str; 7] = ["gain", "pole", "bandwidth", "rate", "frequency", "amplitude", "mass"];

/// A parameter with its slider.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Slider {
    /// Name in the loop, `unit.variable`.
    pub name: String,
    /// Name of the unit.
    pub unit: String,
    /// What it is.
    pub description: String,
    /// Its unit of measurement.
    pub measure: String,
    /// What the loop starts with.
    pub start: f64,
    /// Smallest and largest value that its FMU allows.
    pub limits: (Option<f64>, Option<f64>),
    /// Ends of the slider; none where a number says that there is no limit.
    pub range: Option<(f64, f64)>,
    /// Whether the slider is logarithmic.
    pub logarithmic: bool,
    /// Whether it is shown at first.
    pub first: bool,
    #[serde(skip)]
    pub(super) place: Place,
}

impl Slider {
    /// Those of all Real parameters of a loop, in the order of its units.
    pub fn of(structure: &Structure, loaded: &LoadedLoop) -> Vec<Self> {
        let mut sliders: Vec<Self> = loaded
            .variables()
            .filter(|(_, _, variable)| variable.kind == "Real" && variable.causality == "parameter")
            .filter_map(|(name, place, variable)| Self::new(structure, loaded, name, place, variable))
            .collect();
        choose(structure, &mut sliders);
        sliders
    }

    fn new(
        structure: &Structure,
        loaded: &LoadedLoop,
        name: String,
        place: Place,
        variable: &Variable,
    ) -> Option<Self> {
        // What has no unit is of the loop as one unit, which other forms of it don't know.
        let unit = structure.unit_of(&name)?.name.clone();
        let start = loaded.start_of(place)?;
        let number = |text: &Option<String>| text.as_ref().and_then(|text| text.parse().ok());
        let limits = (number(&variable.min), number(&variable.max));
        let tuned = structure.tuning.iter().flat_map(|tuning| &tuning.parameters);
        let tuned = tuned.into_iter().find(|parameter| parameter.name == name);
        let told = tuned.and_then(|parameter| parameter.low.zip(parameter.high));
        let (range, logarithmic) = range(start, limits, told);
        let (description, measure) = (variable.description.clone(), variable.unit.clone().unwrap_or_default());
        Some(Slider { name, unit, description, measure, start, limits, range, logarithmic, first: false, place })
    }
}

/// The ends of a slider, and whether it is logarithmic.
fn range(start: f64, (min, max): (Option<f64>, Option<f64>), told: Option<(f64, f64)>) -> (Option<(f64, f64)>, bool) {
    let spans_decades = |low: f64, high: f64| low > 0.0 && high / low >= DECADES;
    if let Some((low, high)) = told {
        return (Some((low, high)), spans_decades(low, high));
    }
    if start.abs() >= NO_LIMIT {
        return (None, false);
    }
    let min = min.filter(|min| min.abs() < NO_LIMIT);
    let max = max.filter(|max| max.abs() < NO_LIMIT);
    if let (Some(min), Some(max)) = (min, max)
        && (min > 0.0 || start == 0.0 || max.abs().max(min.abs()) <= APART * start.abs())
    {
        return (Some((min, max)), spans_decades(min, max));
    }
    let (low, high) = match start {
        0.0 => (-1.0, 1.0),
        start if start > 0.0 => (start / APART, start * APART),
        start => (3.0 * start, -start),
    };
    let inside = |value: f64| value.max(min.unwrap_or(f64::NEG_INFINITY)).min(max.unwrap_or(f64::INFINITY));
    let (low, high) = (inside(low), inside(high));
    if low < high { (Some((low, high)), spans_decades(low, high)) } else { (None, false) }
}

/// Chooses which are shown at first: those that the loop is tuned by, and of each unit a few that matter.
fn choose(structure: &Structure, sliders: &mut [Slider]) {
    let tuned: Vec<&String> = structure.tuning.iter().flat_map(|it| &it.parameters).map(|it| &it.name).collect();
    sliders.iter_mut().for_each(|slider| slider.first = tuned.contains(&&slider.name));
    for component in &structure.components {
        let role = role(structure, &component.fmu);
        let most = match role {
            Some(Role::Controller | Role::Observer) => FIRST_OF_CONTROLLER,
            Some(Role::Reference | Role::Sensor) => 2,
            _ => FIRST_OF_OTHERS,
        };
        let given = |name: &str| component.values.iter().any(|value| value.name == name);
        let variable = |slider: &Slider| slider.name[component.name.len() + 1..].to_owned();
        let worth = |slider: &Slider| {
            let name = variable(slider);
            let is_word = |words: &[&str]| words.iter().any(|word| name.contains(word));
            let is_turned = given(&name) || is_word(&FIRST);
            let matters = slider.range.is_some() && slider.start != 0.0 && !is_word(&ABOUT_NUMBERS);
            matters.then_some(!is_turned)
        };
        let of_unit = (0..sliders.len()).filter(|&k| sliders[k].unit == component.name);
        let mut best: Vec<usize> = of_unit.filter(|&k| worth(&sliders[k]).is_some()).collect();
        best.sort_by_key(|&k| worth(&sliders[k]));
        best.into_iter().take(most).for_each(|k| sliders[k].first = true);
    }
}

/// What a unit does in its loop, where it is of a kind of this package.
pub(super) fn role(structure: &Structure, fmu: &str) -> Option<Role> {
    let description = Description::read(&structure.description_of(fmu).ok()?.text).ok()?;
    Some(library::find(&description.model)?.role)
}

#[cfg(test)]
mod tests {
    use super::range;

    #[test]
    fn a_slider_goes_over_what_its_fmu_allows_and_over_decades_by_logarithms() {
        assert_eq!(range(0.5, (Some(0.0), Some(1.0)), None), (Some((0.0, 1.0)), false));
        assert_eq!(range(1.0, (Some(1e-3), Some(1e3)), None), (Some((1e-3, 1e3)), true));
        // The bounds of a search prevail.
        assert_eq!(range(1.0, (Some(0.0), None), Some((2.0, 3.0))), (Some((2.0, 3.0)), false));
    }

    #[test]
    fn a_slider_without_limits_lies_about_the_start_value_and_keeps_to_the_limit_that_there_is() {
        assert_eq!(range(2.0, (None, None), None), (Some((0.02, 200.0)), true));
        assert_eq!(range(2.0, (Some(1.0), None), None), (Some((1.0, 200.0)), false));
        assert_eq!(range(-2.0, (None, None), None), (Some((-6.0, 2.0)), false));
        assert_eq!(range(0.0, (Some(0.0), None), None), (Some((0.0, 1.0)), false));
    }

    #[test]
    fn a_number_that_stands_for_no_limit_has_no_slider() {
        assert_eq!(range(-1e15, (None, None), None), (None, false));
    }
}
