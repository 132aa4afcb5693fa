//! Loops whose FMUs are loaded and fit each other: what instances are made of, as many as are wanted.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::check::{Circles, Link, check};
use super::closed_loop::ClosedLoop;
use super::fmu::{Fmu, Hosting, Value};
use super::port::signals;
use super::ssp::{Component, Structure};
use crate::error::Error;
use crate::model_description::{ModelDescription, Variable};

/// A loop that is ready to be instantiated.
#[derive(Debug)]
pub struct LoadedLoop {
    units: Vec<LoadedUnit>,
    links: Vec<Link>,
    notes: Vec<String>,
    circular: bool,
}

#[derive(Debug)]
struct LoadedUnit {
    fmu: Arc<Fmu>,
    name: String,
    /// What stands before its variables' names in the loop's.
    prefix: String,
    /// Start values: places of variables.
    values: Vec<(usize, Value)>,
    /// What is recorded of it: places of its outputs, and of what else is asked for.
    recorded: Vec<usize>,
}

impl LoadedUnit {
    fn new(fmu: Arc<Fmu>, name: &str, prefix: String, values: Vec<(usize, Value)>) -> Self {
        let recorded = signals(&fmu.description).map(|(place, _)| place).collect();
        LoadedUnit { fmu, name: name.to_owned(), prefix, values, recorded }
    }
}

/// A variable of a unit, by places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    unit: usize,
    variable: usize,
}

impl LoadedLoop {
    /// Loads the units of a loop from the FMUs in a folder.
    ///
    /// # Errors
    /// When an FMU can't be loaded, or a connection or value doesn't fit.
    pub fn new(structure: &Structure, fmus: &Path, hosting: &Hosting) -> Result<Self, Error> {
        // However many components are of an FMU, it is opened once.
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

    /// A loop of FMUs that are opened, one a component.
    ///
    /// # Errors
    /// When one can't be opened, or a connection or value doesn't fit.
    pub fn of(structure: &Structure, open: impl FnMut(&Component) -> Result<Arc<Fmu>, Error>) -> Result<Self, Error> {
        structure.check_separate()?;
        let opened = structure.components.iter().map(open).collect::<Result<Vec<_>, _>>()?;
        let descriptions: Vec<&ModelDescription> = opened.iter().map(|fmu| &fmu.description).collect();
        let wiring = check(structure, &descriptions, Circles::Exchanged)?;
        let parts = structure.components.iter().zip(opened).zip(wiring.values);
        let units = parts.map(|((component, fmu), values)| {
            LoadedUnit::new(fmu, &component.name, format!("{}.", component.name), values)
        });
        let (links, notes, circular) = (wiring.links, wiring.notes, wiring.circular);
        Ok(LoadedLoop { units: units.collect(), links, notes, circular })
    }

    /// A loop that is one FMU, whose variables have the names that they have in the loop, with start values.
    ///
    /// # Errors
    /// When there is no variable of a name.
    pub fn whole(name: &str, fmu: Arc<Fmu>, values: &[(String, Value)], notes: Vec<String>) -> Result<Self, Error> {
        let place = |(name, value): &(String, Value)| {
            let refuse =
                || Error::Archive { file: fmu.file().to_owned(), reason: format!("it has no variable `{name}`") };
            Ok((fmu.description.place(name).ok_or_else(refuse)?, value.clone()))
        };
        let values = values.iter().map(place).collect::<Result<_, Error>>()?;
        let unit = LoadedUnit::new(fmu, name, String::new(), values);
        Ok(LoadedLoop { units: vec![unit], links: Vec::new(), notes, circular: false })
    }

    /// A variable by its name in the loop.
    pub fn variable(&self, name: &str) -> Option<(Place, &Variable)> {
        self.units.iter().enumerate().find_map(|(unit, LoadedUnit { fmu, prefix, .. })| {
            let variable = fmu.description.place(name.strip_prefix(prefix)?)?;
            Some((Place { unit, variable }, &fmu.description.variables[variable]))
        })
    }

    /// Records these signals too, where units have variables of these names: they need not be outputs.
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

    /// All variables of the units, with their names in the loop.
    pub fn variables(&self) -> impl Iterator<Item = (String, Place, &Variable)> {
        self.units.iter().enumerate().flat_map(|(unit, LoadedUnit { fmu, prefix, .. })| {
            let variables = fmu.description.variables.iter().enumerate();
            variables.map(move |(variable, it)| (format!("{prefix}{}", it.name), Place { unit, variable }, it))
        })
    }

    /// The start value that the loop gives a variable; none where the FMU's own stays.
    pub fn given(&self, Place { unit, variable }: Place) -> Option<&Value> {
        self.units[unit].values.iter().find(|(place, _)| *place == variable).map(|(_, value)| value)
    }

    /// What the loop may lack.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The value that a Real variable starts with in this loop.
    pub fn start_of(&self, Place { unit, variable }: Place) -> Option<f64> {
        let LoadedUnit { fmu, values, .. } = &self.units[unit];
        match values.iter().find(|(place, _)| *place == variable) {
            Some((_, Value::Real(value))) => Some(*value),
            Some(_) => None,
            None => fmu.description.variables[variable].start.as_ref()?.parse().ok(),
        }
    }

    /// Whether several instances can be there at a time.
    pub fn can_be_multiplied(&self) -> bool {
        let only_once = |name: &str| name == "canBeInstantiatedOnlyOncePerProcess";
        let is_single = |fmu: &Fmu| fmu.description.capabilities.iter().any(|(name, _)| only_once(name));
        !self.units.iter().any(|unit| !unit.fmu.has_own_processes() && is_single(&unit.fmu))
    }

    /// Instantiates and connects the units, with further start values of Real variables.
    ///
    /// # Errors
    /// When a unit refuses.
    pub fn instantiate(&self, further: &[(Place, f64)]) -> Result<ClosedLoop, Error> {
        let mut closed = ClosedLoop::empty(self.notes.clone(), self.circular);
        // The place of each signal's value in the row.
        let mut places = HashMap::new();
        for (k, LoadedUnit { fmu, name, prefix, values, recorded }) in self.units.iter().enumerate() {
            let instance = fmu.instantiate(name)?;
            let set = |variable: usize, value: &Value| {
                instance.set_start(fmu.description.variables[variable].reference, value)
            };
            values.iter().try_for_each(|(variable, value)| set(*variable, value))?;
            let own = further.iter().filter(|(place, _)| place.unit == k);
            own.clone().try_for_each(|(place, value)| set(place.variable, &Value::Real(*value)))?;
            places.extend(recorded.iter().map(|&place| (k, place)).zip(closed.width()..));
            closed.add(instance, prefix, recorded);
        }
        for Link { from, to: (unit, input), conversion } in &self.links {
            let variable = &self.units[*unit].fmu.description.variables[*input];
            closed.connect(*unit, variable, places[from], *conversion);
        }
        Ok(closed)
    }
}
