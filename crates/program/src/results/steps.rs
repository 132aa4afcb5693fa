//! Metrics of a loop whose references step: tracking by its signals, and effort of its controls.

use super::measured::Measured;
use super::step_response::{StepFigures, StepResponse};
use crate::simulation::Recording;
use crate::structure::Structure;

/// Smallest initial difference from the reference that counts as a step, relative to the reference.
const NEAR: f64 = 0.1;
/// Smallest relative change of a reference; smaller ones are rounding.
const ROUNDING: f64 = 1e-9;
/// Smallest number of points of a response that is judged.
const LEAST_POINTS: usize = 3;
/// Output of a controller: time for which a control has been at its limit.
const AT_LIMIT: &str = "time_at_limit";

/// Measures the steps of a run.
#[derive(Debug)]
pub struct Steps {
    followers: Vec<Follower>,
    controls: Vec<Control>,
    controllers: Vec<Controller>,
}

impl Steps {
    /// Returns the measurement for recorded signals that follow references.
    pub fn new(structure: &Structure, recording: &Recording) -> Self {
        let place = |name: &str| recording.names.iter().position(|known| known == name);
        let unit = |column: usize| recording.measures.get(column).map_or("", String::as_str);
        let (mut followers, mut controls, mut controllers) = (Vec::new(), Vec::<Control>::new(), Vec::new());
        for tracked in structure.tracked() {
            let Some((signal, reference)) = place(&tracked.signal).zip(place(&tracked.reference)) else { continue };
            let owner = followers.len();
            followers.push(Follower::new(&tracked.signal, unit(signal), [signal, reference]));
            for name in &tracked.controls {
                let Some(column) = place(name) else { continue };
                let owners = match controls.iter_mut().find(|control| control.column == column) {
                    Some(known) => &mut known.owners,
                    None => {
                        let is_max_known = structure.metrics.iter().any(|metric| metric.is_peak_of(name));
                        controls.push(Control::new(name, unit(column), column, !is_max_known));
                        &mut controls.last_mut().expect("it was added").owners
                    }
                };
                owners.push(owner);
            }
            let known = |other: &Controller| other.name == tracked.controller;
            match (place(&format!("{}.{AT_LIMIT}", tracked.controller)), controllers.iter_mut().find(|it| known(it))) {
                (Some(_), Some(controller)) => controller.owners.push(owner),
                (Some(column), None) => {
                    let (name, owners) = (tracked.controller, vec![owner]);
                    controllers.push(Controller { name, column, owners, last: None, time: 0.0 });
                }
                (None, _) => {}
            }
        }
        Steps { followers, controls, controllers }
    }

    /// Measures further points.
    pub fn add(&mut self, points: &Recording) {
        for (row, &time) in points.times.iter().enumerate() {
            let value = |column: usize| points.columns[column][row];
            self.followers.iter_mut().for_each(|it| it.add(time, it.columns.map(value)));
            self.controls.iter_mut().for_each(|it| it.add(value(it.column)));
            self.controllers.iter_mut().for_each(|it| it.add(time, value(it.column)));
        }
    }

    /// The labels of all possible metrics, before it is known which references step.
    pub fn labels(&self) -> impl Iterator<Item = String> {
        let metrics = self.followers.iter().flat_map(Follower::metrics);
        let metrics = metrics.chain(self.controls.iter().flat_map(Control::metrics));
        metrics.chain(self.controllers.iter().map(Controller::metric)).map(|metric| metric.label)
    }

    /// The metrics of references that stepped. A figure has no value if it doesn't exist, for example without settling.
    pub fn measured(mut self) -> Vec<Measured> {
        self.followers.iter_mut().for_each(Follower::end);
        let steps = |owners: &[usize]| owners.iter().any(|owner| self.followers[*owner].steps());
        let of_signals = self.followers.iter().filter(|it| it.steps()).flat_map(Follower::metrics);
        let of_controls = self.controls.iter().filter(|it| steps(&it.owners)).flat_map(Control::metrics);
        let of_limits = self.controllers.iter().filter(|it| steps(&it.owners)).map(Controller::metric);
        of_signals.chain(of_controls).chain(of_limits).collect()
    }
}

fn metric(what: &str, of: &str, unit: &str, value: Option<f64>) -> Measured {
    let unit = if unit.is_empty() || unit == "1" { String::new() } else { format!(", {unit}") };
    Measured { label: format!("{what} of {of}{unit}"), value, limit: None }
}

/// A signal that follows a reference.
#[derive(Debug)]
struct Follower {
    name: String,
    unit: String,
    /// Places of signal and reference.
    columns: [usize; 2],
    last: Option<(f64, [f64; 2])>,
    /// True if the reference changed at the last point.
    has_changed: bool,
    /// True if the reference changes from point to point, so that it doesn't step.
    moves: bool,
    /// The current step, its size, and number of points since.
    current: Option<(StepResponse, f64, usize)>,
    /// The worst figures of the steps before it.
    worst: Option<Worst>,
    /// Integral of the error's magnitude.
    iae: f64,
}

/// The worst figures of several steps, and the largest final error in the signal's unit.
#[derive(Debug, Clone, Copy)]
struct Worst {
    figures: StepFigures,
    error: f64,
}

impl Follower {
    fn new(name: &str, unit: &str, columns: [usize; 2]) -> Self {
        let (name, unit) = (name.to_owned(), unit.to_owned());
        let (last, current, worst) = (None, None, None);
        Follower { name, unit, columns, last, has_changed: false, moves: false, current, worst, iae: 0.0 }
    }

    fn add(&mut self, time: f64, [y, r]: [f64; 2]) {
        if self.moves {
            return;
        }
        match self.last.replace((time, [y, r])) {
            None if (r - y).abs() >= NEAR * r.abs() && r != 0.0 => self.begin(y, r, time),
            None => {}
            Some((before, [y_before, r_before])) => {
                // The reference is constant until it steps.
                self.iae += 0.5 * (time - before) * ((r_before - y_before).abs() + (r_before - y).abs());
                let changes = (r - r_before).abs() > ROUNDING * r.abs().max(r_before.abs());
                self.moves = changes && self.has_changed;
                self.has_changed = changes;
                if changes {
                    self.end();
                    self.begin(r_before, r, time);
                }
            }
        }
        if let Some((response, _, points)) = &mut self.current {
            response.add(time, y);
            *points += 1;
        }
    }

    fn begin(&mut self, from: f64, to: f64, time: f64) {
        self.current = Some((StepResponse::new(from, to - from, time), to - from, 0));
    }

    /// Ends a step, at the next one or with the run.
    fn end(&mut self) {
        let Some((response, size, points)) = self.current.take() else { return };
        if let Some(figures) = response.figures().filter(|_| points >= LEAST_POINTS) {
            let one = Worst { figures, error: ((1.0 - figures.end) * size).abs() };
            self.worst = Some(self.worst.map_or(one, |worst| worst.or_worse(one)));
        }
    }

    fn steps(&self) -> bool {
        !self.moves && self.worst.is_some()
    }

    fn metrics(&self) -> [Measured; 5] {
        let worst = self.worst.filter(|_| !self.moves);
        let figures = worst.map(|worst| worst.figures);
        let of = |what: &str, unit: &str, value| metric(what, &self.name, unit, value);
        let of_time =
            if self.unit.is_empty() || self.unit == "1" { "s".to_owned() } else { format!("{}·s", self.unit) };
        [
            of("rise time", "s", figures.and_then(|it| it.rise)),
            of("settling time", "s", figures.and_then(|it| it.settling)),
            of("overshoot", "%", figures.map(|it| 100.0 * it.overshoot)),
            of("steady-state error", &self.unit, worst.map(|it| it.error)),
            of("IAE", &of_time, worst.map(|_| self.iae)),
        ]
    }
}

impl Worst {
    fn or_worse(self, other: Self) -> Self {
        let (mine, theirs) = (self.figures, other.figures);
        let larger = |one: Option<f64>, other: Option<f64>| Some(one?.max(other?));
        let figures = StepFigures {
            rise: larger(mine.rise, theirs.rise),
            settling: larger(mine.settling, theirs.settling),
            overshoot: mine.overshoot.max(theirs.overshoot),
            end: theirs.end,
        };
        Worst { figures, error: self.error.max(other.error) }
    }
}

/// Output of a controller to other components.
#[derive(Debug)]
struct Control {
    name: String,
    unit: String,
    column: usize,
    /// Places of the signals that it controls.
    owners: Vec<usize>,
    /// True if the loop doesn't have its own metric of the peak.
    has_peak: bool,
    last: Option<f64>,
    variation: f64,
    peak: f64,
}

impl Control {
    fn new(name: &str, unit: &str, column: usize, has_peak: bool) -> Self {
        let (name, unit, owners) = (name.to_owned(), unit.to_owned(), Vec::new());
        Control { name, unit, column, owners, has_peak, last: None, variation: 0.0, peak: 0.0 }
    }

    fn add(&mut self, value: f64) {
        self.variation += self.last.replace(value).map_or(0.0, |last| (value - last).abs());
        self.peak = if value.is_nan() { value } else { self.peak.max(value.abs()) };
    }

    fn metrics(&self) -> impl Iterator<Item = Measured> {
        let of = |what: &str, value| metric(what, &self.name, &self.unit, Some(value));
        let peak = self.has_peak.then(|| of("peak", self.peak));
        peak.into_iter().chain([of("total variation", self.variation)])
    }
}

/// A controller that reports how long its control has been at a limit.
#[derive(Debug)]
struct Controller {
    name: String,
    column: usize,
    owners: Vec<usize>,
    last: Option<f64>,
    time: f64,
}

impl Controller {
    fn add(&mut self, time: f64, at_limit: f64) {
        let since = time - self.last.replace(time).unwrap_or(time);
        if at_limit > 0.0 {
            self.time += since;
        }
    }

    fn metric(&self) -> Measured {
        metric("time at a limit", &self.name, "s", Some(self.time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn followed(reference: impl Fn(u32) -> f64) -> Follower {
        let mut follower = Follower::new("plant.y", "m", [0, 1]);
        (0..1000).for_each(|k| follower.add(0.01 * f64::from(k), [0.0, reference(k)]));
        follower.end();
        follower
    }

    #[test]
    fn a_reference_steps_if_it_is_constant_but_for_rounding() {
        let step = |k: u32| if k < 500 { 1.0 } else { -2.0 };
        let rounded = |k: u32| step(k) * (1.0 + 1e-13 * f64::from(k % 3));
        let [exact, rounded] = [followed(step), followed(rounded)];
        assert!(exact.steps() && rounded.steps());
        // 1 for 5 s, then 2.
        assert!((exact.iae - (5.0 + 2.0 * 4.99)).abs() < 1e-9 && (rounded.iae - exact.iae).abs() < 1e-9);
        assert_eq!(exact.worst.unwrap().error, 2.0);
        assert!(!followed(|k| (0.01 * f64::from(k)).sin()).steps() && !followed(|_| 0.0).steps());
        assert!(!followed(|k| if k < 2 { 1.0 } else { 2.0 + f64::from(k) }).steps());
    }
}
