//! Loops whose FMUs are loaded and fit each other. Any number of instances can be created from one.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::changes::{Change, Place};
use super::closed_loop::ClosedLoop;
use super::port::signals;
use super::recording::Recording;
use crate::error::{Error, Invalid};
use crate::fmu::{Common, Fmu, Hosting, Value, own_start, typed, why_fixed, within_limits};
use crate::model_description::{Affine, ModelDescription, Variable};
use crate::near;
use crate::structure::{AlgebraicLoops, Component, Event, Link, Order, Settings, Structure, check};

/// A loop that is ready for instantiation.
#[derive(Debug)]
pub struct LoadedLoop {
    units: Vec<LoadedUnit>,
    links: Vec<Link>,
    notes: Vec<String>,
    circular: bool,
    changes: Vec<Change>,
    order: Order,
}

#[derive(Debug)]
pub(crate) struct LoadedUnit {
    pub fmu: Arc<Fmu>,
    pub name: String,
    /// Prefix of its variables' names in the loop.
    prefix: String,
    /// Start values: places of variables.
    pub values: Vec<(usize, Value)>,
    /// Recorded variables: places of its outputs, and of others that are asked for.
    recorded: Vec<usize>,
}

/// Refuses changes during a run of all variables but tunable parameters, and inputs without another source.
pub(super) fn may_change(variable: &Variable, other_source: Option<&str>) -> Result<(), String> {
    match (&*variable.causality, &*variable.variability) {
        ("parameter", "tunable") => Ok(()),
        ("input", _) => other_source.map_or(Ok(()), |source| Err(source.to_owned())),
        ("parameter", _) => Err("it is a fixed parameter, which is set before a run (--set)".to_owned()),
        (causality, variability) => Err(format!("it is a {variability} {causality}")),
    }
}

impl LoadedUnit {
    fn new(fmu: Arc<Fmu>, name: &str, prefix: String, values: Vec<(usize, Value)>) -> Self {
        let recorded = signals(&fmu.description).map(|(place, _)| place).collect();
        LoadedUnit { fmu, name: name.to_owned(), prefix, values, recorded }
    }

    /// The start value of a variable in this loop.
    pub fn value(&self, place: usize) -> Option<Value> {
        let given = self.values.iter().rfind(|(other, _)| *other == place).map(|(_, value)| value.clone());
        given.or_else(|| own_start(&self.fmu.description.variables[place]))
    }
}

impl LoadedLoop {
    /// The fewest runs that pay for equations that are compiled for their common parameters.
    pub const FEWEST_FOLDED: usize = 8;

    /// Loads the FMUs of a loop from a folder.
    ///
    /// # Errors
    /// When an FMU can't be loaded, or a connection or value doesn't fit.
    pub fn new(structure: &Structure, fmus: &Path, hosting: &Hosting) -> Result<Self, Error> {
        // An FMU of several components is opened once.
        let mut known: HashMap<PathBuf, Arc<Fmu>> = HashMap::new();
        Self::of(structure, |component| {
            let file = component.path_in(fmus);
            if let Some(fmu) = known.get(&file) {
                return Ok(Arc::clone(fmu));
            }
            let fmu = Arc::new(Fmu::open(&file, hosting)?);
            known.insert(file, Arc::clone(&fmu));
            Ok(fmu)
        })
    }

    /// A loop of opened FMUs, one for each component.
    ///
    /// # Errors
    /// When one can't be opened, or a connection or value doesn't fit.
    pub fn of(structure: &Structure, open: impl FnMut(&Component) -> Result<Arc<Fmu>, Error>) -> Result<Self, Error> {
        structure.check_separate()?;
        let opened = structure.components.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        let descriptions: Vec<&ModelDescription> = opened.iter().map(|fmu| &fmu.description).collect();
        let wiring = check(structure, &descriptions, AlgebraicLoops::Exchanged)?;
        let parts = structure.components.iter().zip(opened).zip(wiring.values);
        let units = parts.map(|((component, fmu), values)| {
            LoadedUnit::new(fmu, &component.name, format!("{}.", component.name), values)
        });
        let (links, notes, circular) = (wiring.links, wiring.notes, wiring.circular);
        let (units, changes, order) = (units.collect(), Vec::new(), structure.order);
        LoadedLoop { units, links, notes, circular, changes, order }.in_order(structure.asked_order)
    }

    /// A loop as a single FMU, whose variables have their names in the loop, with start values.
    ///
    /// # Errors
    /// When a variable doesn't exist.
    pub fn whole(name: &str, fmu: Arc<Fmu>, values: &[(String, Value)], notes: Vec<String>) -> Result<Self, Error> {
        let place = |(name, value): &(String, Value)| {
            let refuse =
                || Error::Archive { file: fmu.file().to_owned(), reason: format!("it has no variable `{name}`") };
            Ok((fmu.description.place(name).ok_or_else(refuse)?, value.clone()))
        };
        let values = values.iter().map(place).collect::<Result<_, Error>>()?;
        let unit = LoadedUnit::new(fmu, name, String::new(), values);
        let order = Order::GaussSeidel;
        Ok(LoadedLoop { units: vec![unit], links: Vec::new(), notes, circular: false, changes: Vec::new(), order })
    }

    /// Sets the order that is asked for. The default is Event Mode if all components with feedthrough have it and the
    /// loop's own order isn't Jacobi, otherwise the loop's own. Refuses Event Mode if no component has it.
    fn in_order(mut self, asked: Option<Order>) -> Result<Self, Error> {
        let own = self.order;
        let by_default = if own == Order::GaussSeidel && self.prefers_event_mode() { Order::EventMode } else { own };
        self.order = asked.unwrap_or(by_default);
        let has_any = self.units.iter().any(|unit| unit.fmu.description.has_event_mode());
        if self.order == Order::EventMode && !has_any {
            let reason =
                "--order event-mode: no component has Event Mode. Export FMUs by `adaptive-fmu export --fmi 3`";
            return Err(Error::Argument(Invalid::because(reason.to_owned())));
        }
        Ok(self)
    }

    /// The order in which its units are stepped.
    pub fn order(&self) -> Order {
        self.order
    }

    /// True if some components have Event Mode, including all with feedthrough.
    fn prefers_event_mode(&self) -> bool {
        let has = |unit: usize| self.units[unit].fmu.description.has_event_mode();
        let passes = |unit: usize| {
            let leaving = |input: usize| {
                let outputs = self.links.iter().filter(move |link| link.from.0 == unit).map(|link| link.from.1);
                outputs.map(move |output| self.units[unit].fmu.description.is_fed_through(input, output))
            };
            let into = self.links.iter().filter(|link| link.to.0 == unit).map(|link| link.to.1);
            into.flat_map(leaving).any(|through| through != Some(false))
        };
        (0..self.units.len()).any(has) && (0..self.units.len()).all(|unit| has(unit) || !passes(unit))
    }

    /// Its components, in the order in which they are stepped.
    pub(crate) fn units(&self) -> &[LoadedUnit] {
        &self.units
    }

    /// A variable by its name in the loop.
    pub fn variable(&self, name: &str) -> Option<(Place, &Variable)> {
        self.units.iter().enumerate().find_map(|(unit, LoadedUnit { fmu, prefix, .. })| {
            let variable = fmu.description.place(name.strip_prefix(prefix)?)?;
            Some((Place { unit, variable }, &fmu.description.variables[variable]))
        })
    }

    /// The connected Real inputs of a component: names, their signals, and the conversions of these.
    pub fn sources(&self, name: &str) -> Vec<(String, String, Affine)> {
        let variable = |(unit, variable): (usize, usize)| &self.units[unit].fmu.description.variables[variable];
        let into =
            self.links.iter().filter(|link| self.units[link.to.0].name == name && variable(link.to).kind == "Real");
        let signal = |from: (usize, usize)| format!("{}{}", self.units[from.0].prefix, variable(from).name);
        into.map(|link| (variable(link.to).name.clone(), signal(link.from), link.conversion)).collect()
    }

    /// Origins of its components, and how they run: one line each.
    pub fn origins(&self) -> Vec<String> {
        self.units.iter().map(|unit| format!("{}: {}", unit.name, unit.fmu.origin())).collect()
    }

    /// The names of the Real parameters of its components, which a search may tune.
    pub fn tunable(&self) -> Vec<String> {
        let is_tunable = |v: &Variable| v.causality == "parameter" && v.kind == "Real";
        self.variables().filter(|(_, _, variable)| is_tunable(variable)).map(|(name, _, _)| name).collect()
    }

    /// The full name and the place of a variable that can have a start value. The component may be left out of a name
    /// that only one has.
    ///
    /// # Errors
    /// When there is none, there are several, or it can't be set.
    pub fn settable(&self, name: &str) -> Result<(String, Place), String> {
        if let Some((place, _)) = self.variable(name) {
            let reason = self.fixed(place);
            return reason
                .map_or(Ok((name.to_owned(), place)), |reason| Err(format!("`{name}` can't be set: {reason}")));
        }
        let settable = || {
            let variables = self.variables().map(|(full, place, _)| (full, place));
            variables.filter(|(_, place)| self.fixed(*place).is_none())
        };
        let ends = |full: &str| full.strip_suffix(name).is_some_and(|unit| unit.ends_with('.'));
        let mut named: Vec<_> = settable().filter(|(full, _)| ends(full)).collect();
        if named.len() == 1 {
            return Ok(named.remove(0));
        }
        let names =
            |found: Vec<(String, Place)>| found.into_iter().map(|(full, _)| full).collect::<Vec<_>>().join(", ");
        if !named.is_empty() {
            return Err(format!("`{name}` is a parameter of several components. Use one of {}", names(named)));
        }
        let known: Vec<_> = settable().map(|(full, _)| full).collect();
        Err(format!("there is no parameter `{name}`; {}", near::choice(name, &known, "")))
    }

    /// Reason why a variable can't have a start value; none if it can.
    fn fixed(&self, Place { unit, variable }: Place) -> Option<String> {
        let found = &self.units[unit].fmu.description.variables[variable];
        if self.links.iter().any(|link| link.to == (unit, variable)) {
            return Some("it is connected".to_owned());
        }
        let is_fixed = found.start.is_none() || found.variability == "constant" || found.causality == "output";
        is_fixed.then(|| why_fixed(found))
    }

    /// A start value of a variable, from a text, within the bounds of its FMU.
    ///
    /// # Errors
    /// Values that are allowed.
    pub fn start_value(&self, Place { unit, variable }: Place, text: &str) -> Result<Value, String> {
        let variable = &self.units[unit].fmu.description.variables[variable];
        within_limits(typed(text, variable)?, variable)
    }

    /// Changes of variables during each run.
    pub(crate) fn changes(&self) -> &[Change] {
        &self.changes
    }

    /// Adds events that change variables during the run.
    ///
    /// # Errors
    /// An event of a variable that doesn't exist, can't change during a run, or can't have the value.
    pub fn with_events(mut self, events: &[Event]) -> Result<Self, Error> {
        self.changes = self.changes_of(events)?;
        Ok(self)
    }

    /// Changes of variables by events.
    ///
    /// # Errors
    /// See [`LoadedLoop::with_events`].
    pub fn changes_of(&self, events: &[Event]) -> Result<Vec<Change>, Error> {
        let change = |event: &Event| {
            let refuse = |reason: String| event.origin.refuse(&reason);
            let place = self.changeable(&event.name).map_err(refuse)?;
            let value = self.start_value(place, &event.text);
            let value = value.map_err(|reason| refuse(format!("`{}` = {}: {reason}", event.name, event.text)))?;
            Ok(Change { at: event.time, place, value })
        };
        events.iter().map(change).collect()
    }

    /// The variables that may change during a run: tunable parameters, and unconnected inputs.
    pub fn changeables(&self) -> impl Iterator<Item = (String, Place, &Variable)> {
        self.variables().filter(|(_, place, variable)| self.check_changeable(*place, variable).is_ok())
    }

    fn check_changeable(&self, place: Place, variable: &Variable) -> Result<(), String> {
        let is_connected = self.links.iter().any(|link| link.to == (place.unit, place.variable));
        may_change(variable, is_connected.then_some("it is connected"))
    }

    /// The place of one of them.
    fn changeable(&self, name: &str) -> Result<Place, String> {
        if let Some((place, variable)) = self.variable(name) {
            let reason = |reason: String| format!("`{name}` can't change during a run: {reason}");
            return self.check_changeable(place, variable).map(|()| place).map_err(reason);
        }
        let known: Vec<_> = self.changeables().map(|(full, _, _)| full).collect();
        Err(format!("there is no `{name}` that may change during a run; {}", near::choice(name, &known, "")))
    }

    /// Records these signals too, if components have such variables: they need not be outputs.
    #[must_use]
    pub fn recording<'a>(mut self, names: impl IntoIterator<Item = &'a str>) -> Self {
        for name in names {
            let found = self.variable(name).filter(|(_, variable)| variable.kind != "String");
            if let Some(Place { unit, variable }) = found.map(|(place, _)| place)
                && !self.units[unit].recorded.contains(&variable)
            {
                self.units[unit].recorded.push(variable);
            }
        }
        self
    }

    /// An empty recording of the loop's signals.
    pub fn signals(&self) -> Recording {
        let recorded = self.units.iter().flat_map(|LoadedUnit { fmu, prefix, recorded, .. }| {
            let variables = recorded.iter().map(|&place| &fmu.description.variables[place]);
            variables.map(move |it| (format!("{prefix}{}", it.name), it.unit.clone().unwrap_or_default()))
        });
        let (names, measures): (Vec<_>, Vec<_>) = recorded.unzip();
        Recording { columns: vec![Vec::new(); names.len()], names, measures, ..Recording::default() }
    }

    /// All variables of the components, with their names in the loop.
    pub fn variables(&self) -> impl Iterator<Item = (String, Place, &Variable)> {
        self.units.iter().enumerate().flat_map(|(unit, LoadedUnit { fmu, prefix, .. })| {
            let variables = fmu.description.variables.iter().enumerate();
            variables.map(move |(variable, it)| (format!("{prefix}{}", it.name), Place { unit, variable }, it))
        })
    }

    /// The start value that the loop sets; none if that of the FMU stays.
    pub fn given(&self, Place { unit, variable }: Place) -> Option<&Value> {
        self.units[unit].values.iter().find(|(place, _)| *place == variable).map(|(_, value)| value)
    }

    /// Notes on what the loop may lack.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The value of a variable at the start of this loop.
    pub fn value_of(&self, Place { unit, variable }: Place) -> Option<Value> {
        self.units[unit].value(variable)
    }

    /// The value of a Real variable at the start of this loop.
    pub fn start_of(&self, place: Place) -> Option<f64> {
        if let Value::Real(value) = self.value_of(place)? { Some(value) } else { None }
    }

    /// True if several instances may exist at a time.
    pub fn can_be_multiplied(&self) -> bool {
        let only_once = |name: &str| name == "canBeInstantiatedOnlyOncePerProcess";
        let is_single = |fmu: &Fmu| fmu.description.capabilities.iter().any(|(name, _)| only_once(name));
        !self.units.iter().any(|unit| !unit.fmu.has_own_processes() && is_single(&unit.fmu))
    }

    /// Compiles the equations of loops of one FMU, which are loaded alike, for the parameters that runs with such start
    /// values and changes have in common with the loop's own. Further instances use them. Returns false if a component
    /// refuses these values.
    pub fn fold(loops: &[Self], further: &[(Place, Value)], changes: &[Change], settings: Settings) -> bool {
        let Some(first) = loops.first().filter(|first| first.can_be_folded()) else { return true };
        let Ok(common) = first.compile_common(further, changes, settings) else { return false };
        if let Some(common) = &common {
            loops.iter().flat_map(|loaded| &loaded.units).for_each(|unit| unit.fmu.share(common));
        }
        true
    }

    /// True if it is one FMU of this program, of which several instances are possible.
    fn can_be_folded(&self) -> bool {
        self.can_be_multiplied() && matches!(&self.units[..], [unit] if unit.fmu.is_compiled())
    }

    fn compile_common(
        &self,
        further: &[(Place, Value)],
        changes: &[Change],
        Settings { start_time, stop_time, .. }: Settings,
    ) -> Result<Option<Common>, Error> {
        // Values that change during the run are different from the start; the first change of each counts.
        let changed = self.changes.iter().chain(changes).rev().map(|change| (change.place, change.value.clone()));
        let further: Vec<_> = further.iter().cloned().chain(changed).collect();
        let (own, other) = (self.instantiate_with(&[])?, self.instantiate_with(&further)?);
        Ok(own.compile_common(other, (start_time, stop_time)))
    }

    /// Instantiates and connects the components, with further start values of Real variables.
    ///
    /// # Errors
    /// When a component refuses.
    pub fn instantiate(&self, further: &[(Place, f64)]) -> Result<ClosedLoop, Error> {
        let further: Vec<_> = further.iter().map(|(place, value)| (*place, Value::Real(*value))).collect();
        self.instantiate_with(&further)
    }

    /// The same with further start values of any type.
    ///
    /// # Errors
    /// When a component refuses.
    pub fn instantiate_with(&self, further: &[(Place, Value)]) -> Result<ClosedLoop, Error> {
        self.instantiate_changing(further, &[])
    }

    /// The same with further changes during the run.
    ///
    /// # Errors
    /// When a component refuses.
    pub fn instantiate_changing(&self, further: &[(Place, Value)], changes: &[Change]) -> Result<ClosedLoop, Error> {
        let changes = [&self.changes[..], changes].concat();
        let mut closed = ClosedLoop::empty(self.notes.clone(), self.circular, changes, self.order);
        // The place of each signal's value in the row.
        let mut places = HashMap::new();
        for (k, LoadedUnit { fmu, name, prefix, values, recorded }) in self.units.iter().enumerate() {
            let by_events = self.order == Order::EventMode && fmu.description.has_event_mode();
            let instance = if by_events { fmu.instantiate_with_events(name)? } else { fmu.instantiate(name)? };
            let set = |variable: usize, value: &Value| {
                instance.set_start(fmu.description.variables[variable].reference, value)
            };
            values.iter().try_for_each(|(variable, value)| set(*variable, value))?;
            let own = further.iter().filter(|(place, _)| place.unit == k);
            own.clone().try_for_each(|(place, value)| set(place.variable, value))?;
            places.extend(recorded.iter().map(|&place| (k, place)).zip(closed.width()..));
            closed.add(instance, prefix, recorded, by_events);
        }
        for Link { from, to: (unit, input), conversion } in &self.links {
            let variable = &self.units[*unit].fmu.description.variables[*input];
            closed.connect(*unit, variable, places[from], *conversion);
        }
        Ok(closed)
    }
}
