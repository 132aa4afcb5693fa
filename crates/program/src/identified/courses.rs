//! Diagrams over time: measured and simulated signals, and the disturbance.

use std::borrow::Cow;

use adaptive_fmu_identification::SimulatedCourse;

use super::Report;
use crate::figures::{Diagram, Given, Part, Shown, time_label};
use crate::structure::Scale;

/// Values over time.
type Points = (Vec<f64>, Vec<f64>);

impl Report<'_> {
    /// Each signal of each record.
    pub(super) fn diagrams(&self) -> Vec<Diagram<'static>> {
        let mut records: Vec<&str> = self.courses.iter().map(|course| course.record.as_str()).collect();
        records.dedup();
        let mut names: Vec<&str> = Vec::new();
        records.into_iter().for_each(|name| {
            if !names.contains(&name) {
                names.push(name)
            }
        });
        let of_record = |record: &str| {
            let courses: Vec<_> = self.courses.iter().filter(|course| course.record == record).collect();
            let each = self.signals.iter().enumerate();
            each.map(|(i, (name, unit))| of_signal(&format!("{name}, {record}"), unit, i, &courses)).collect::<Vec<_>>()
        };
        names.into_iter().flat_map(of_record).collect()
    }

    /// The disturbance in the held-out part, as inputs.
    pub(super) fn disturbances(&self) -> Option<Diagram<'static>> {
        let model = self.model.filter(|_| self.disturbance.len() > 1)?;
        let unit = |j: usize| model.units.as_ref().and_then(|units| units.u.get(j)).cloned().unwrap_or_default();
        let given = model.inputs.iter().enumerate().map(|(j, name)| {
            let points =
                self.disturbance.iter().map(|(time, values)| (*time, values.get(j).copied().unwrap_or(f64::NAN)));
            curve(&format!("as {name}"), &unit(j), Part::Own, points.unzip())
        });
        Some(Diagram::new("Beyond the model, held-out part", &time_label(), Scale::Linear, given.collect()))
    }
}

fn of_signal(title: &str, unit: &str, i: usize, courses: &[&SimulatedCourse]) -> Diagram<'static> {
    let of = |take: &dyn Fn(&SimulatedCourse) -> bool, simulated: bool| {
        joined(courses.iter().filter(|course| take(course)), i, simulated)
    };
    let mut given = vec![curve("simulated", unit, Part::Own, of(&|course| !course.is_held_out, true))];
    if courses.iter().any(|course| course.is_held_out) {
        given.push(curve("simulated, held out", unit, Part::Own, of(&|course| course.is_held_out, true)));
    }
    given.push(curve("measured", unit, Part::Reference, of(&|_| true, false)));
    given.retain(|given| !given.times.is_empty());
    Diagram::new(title, &time_label(), Scale::Linear, given)
}

/// A signal of courses one after another, with a gap between them.
fn joined<'a>(courses: impl Iterator<Item = &'a &'a SimulatedCourse>, i: usize, simulated: bool) -> Points {
    let (mut times, mut values) = Points::default();
    for course in courses {
        if let Some(last) = times.last().copied() {
            times.push(last);
            values.push(f64::NAN);
        }
        times.extend_from_slice(&course.time);
        let of = if simulated { &course.simulated } else { &course.measured };
        values.extend(of.row(i).iter());
    }
    (times, values)
}

fn curve(name: &str, unit: &str, part: Part, (times, values): Points) -> Given<'static> {
    let (times, values) = (Cow::Owned(times), Cow::Owned(values));
    Given { name: name.to_owned(), unit: unit.to_owned(), part, shown: Shown::signal(name), times, values }
}
