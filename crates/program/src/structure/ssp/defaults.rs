//! Settings of a loop without our annotation: as its components and other tools' annotations propose them.

use std::collections::{HashMap, HashSet};

use roxmltree::Node;

use super::annotation::ANNOTATION;
use super::source::UnitFile;
use super::{Component, Connection, Plot, Structure};
use crate::exporter::read_entry;
use crate::model;
use crate::model_description::ModelDescription;
use crate::structure::Order;
use crate::text_file;

/// Default communication step and stop time, s, if neither the structure nor a component proposes them.
const STEP: f64 = 1e-3;
const STOP_TIME: f64 = 10.0;
/// Largest number of components that the note on the order names one by one.
const MOST_NAMES: usize = 20;

/// Communication step and stop time that a component proposes, s.
type Experiment = (Option<f64>, Option<f64>);

impl Structure {
    /// The smallest communication step and the latest stop time that components propose.
    pub(super) fn proposed(&self) -> Experiment {
        let experiments: Vec<Experiment> = self.components.iter().map(|component| self.experiment(component)).collect();
        let proper = |number: &f64| number.is_finite() && *number > 0.0;
        let step = experiments.iter().filter_map(|(step, _)| *step).filter(proper).reduce(f64::min);
        let stop = experiments.iter().filter_map(|(_, stop)| *stop).filter(proper).reduce(f64::max);
        (step, stop)
    }

    /// Proposal of a component; a file that can't be read is reported when it is loaded.
    fn experiment(&self, component: &Component) -> Experiment {
        if let UnitFile::Archive { path, .. } = &component.file {
            let description =
                read_entry(path, "modelDescription.xml").ok().and_then(|xml| ModelDescription::read(&xml).ok());
            return description.map_or((None, None), |description| (description.step, description.stop_time));
        }
        let text = match &component.file {
            UnitFile::Description(path) => text_file::read(path).ok(),
            _ => self.description_of(&component.fmu).ok().map(|source| source.text),
        };
        let experiment = text.and_then(|text| model::Description::read(&text).ok()).map(|it| it.experiment);
        experiment.map_or((None, None), |experiment| (Some(experiment.step), Some(experiment.stop_time)))
    }

    /// Completes a structure that has no settings of a run and adds the choices to its notes, in one line. Other tools
    /// have annotations of their own for the communication step.
    pub(super) fn choose_defaults(&mut self, root: Node) {
        let (of_units, _) = self.proposed();
        let (step, from) = match (step_of_others(root), of_units) {
            (Some(step), _) => (step, "from another tool's annotation"),
            (None, Some(step)) => (step, "the shortest of its components"),
            (None, None) => (STEP, "because no component proposes one"),
        };
        (self.step, self.order) = (step, Order::GaussSeidel);
        self.put_in_order();
        self.plots = self.plots_of_units();
        self.leave_out_connected_values();
        let names: Vec<_> = self.components.iter().map(|component| component.name.as_str()).collect();
        let order = match names.split_at_checked(MOST_NAMES) {
            Some((first, [_, .., last])) => format!("{}, …, {last} ({} components)", first.join(", "), names.len()),
            _ => names.join(", "),
        };
        self.notes.push(format!(
            "there is no annotation {ANNOTATION}. Using communication step {step} s ({from}), stop time {} s, and \
             gauss-seidel in the order {order}",
            self.stop_time,
        ));
    }

    /// The stop time that components propose.
    pub(super) fn proposed_stop_time(&self) -> f64 {
        self.proposed().1.unwrap_or(STOP_TIME)
    }

    /// Puts each component after those that feed its inputs, as far as there is such an order; else as in the file.
    fn put_in_order(&mut self) {
        let places: HashMap<&str, usize> = self.components.iter().map(|unit| unit.name.as_str()).zip(0..).collect();
        let mut sources = vec![Vec::new(); self.components.len()];
        for Connection { from, to, .. } in &self.connections {
            if let (Some(&from), Some(&to)) = (places.get(from.0.as_str()), places.get(to.0.as_str()))
                && from != to
            {
                sources[to].push(from);
            }
        }
        let (mut taken, mut order) = (vec![false; sources.len()], Vec::new());
        while order.len() < sources.len() {
            let free = |&unit: &usize| !taken[unit];
            let ready = |unit: &usize| sources[*unit].iter().all(|&source| taken[source]);
            let next = (0..sources.len()).filter(free).find(ready).or_else(|| (0..sources.len()).find(free));
            order.extend(next);
            next.into_iter().for_each(|unit| taken[unit] = true);
        }
        let mut units: Vec<_> = std::mem::take(&mut self.components).into_iter().map(Some).collect();
        self.components = order.into_iter().filter_map(|place| units[place].take()).collect();
    }

    /// A diagram for each component of its signals that follow references, with these; then one of its other signals.
    pub fn plots_of_units(&self) -> Vec<Plot> {
        let signal = |(unit, name): &(String, String)| format!("{unit}.{name}");
        let followed = self.followed();
        let tracking = |unit: &Component| {
            let pairs: Vec<_> = followed.iter().filter(|[_, own]| own.0 == unit.name).collect();
            let mut sources: Vec<&str> = pairs.iter().map(|[reference, _]| reference.0.as_str()).collect();
            sources.dedup();
            let title = format!("{} and {}", unit.name, sources.join(", "));
            let signals: Vec<_> = pairs.iter().flat_map(|[reference, own]| [signal(own), signal(reference)]).collect();
            (!signals.is_empty()).then(|| Plot { title, signals, ..Plot::default() })
        };
        let mut plots: Vec<Plot> = self.components.iter().filter_map(tracking).collect();
        let seen: HashSet<String> = plots.iter().flat_map(|plot| plot.signals.clone()).collect();
        let further = |unit: &Component| {
            let handed_on = self.connections.iter().filter(|connection| connection.from.0 == unit.name);
            let mut signals: Vec<_> = handed_on.map(|connection| signal(&connection.from)).collect();
            signals.retain(|signal| !seen.contains(signal));
            signals.sort();
            signals.dedup();
            (!signals.is_empty()).then(|| Plot { title: unit.name.clone(), signals, ..Plot::default() })
        };
        plots.extend(self.components.iter().filter_map(further));
        plots
    }

    /// Drops start values of connected inputs, which other tools also write.
    fn leave_out_connected_values(&mut self) {
        for component in &mut self.components {
            let is_connected = |name: &str| {
                self.connections.iter().any(|Connection { to, .. }| to.0 == component.name && to.1 == name)
            };
            component.values.retain(|value| !is_connected(&value.name));
        }
    }
}

/// The communication step that OMSimulator or the Open Simulation Platform wrote.
fn step_of_others(root: Node) -> Option<f64> {
    let places = [("FixedStepMaster", "stepSize"), ("FixedStepAlgorithm", "baseStepSize")];
    let step = |(element, name): (&str, &str)| {
        let node = root.descendants().find(|node| node.tag_name().name() == element)?;
        node.attribute(name)?.trim().parse().ok().filter(|step: &f64| step.is_finite() && *step > 0.0)
    };
    places.into_iter().find_map(step)
}
