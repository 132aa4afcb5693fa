//! The description of a loop as a single FMU, generated from its structure and its components' descriptions.

use std::collections::BTreeSet;
use std::path::Path;

use toml::{Table, Value};

use super::check;
use super::check::{AlgebraicLoops, start_values};
use super::ssp::{Component, StartValue, Structure, UnitFile};
use crate::error::{Error, Invalid};
use crate::exporter::{Library, Source, describe, name_of_whole};
use crate::fmu::{self, is_designed};
use crate::model;
use crate::model_description::{ABOUT, Affine, ModelDescription, Variable};
use crate::system::Kind;

/// Parameters about communication steps, which a composite doesn't have inside.
pub(crate) const ABOUT_STEPS: [&str; 6] =
    ["input_handling", "relative_tolerance", "on_step_failure", "integration_method", "fixed_steps", "work_limit"];

/// The name of a loop as one FMU: `Loop_3_2_1_cosine`.
pub fn composite_name(structure: &Structure) -> String {
    name_of_whole(&structure.name)
}

/// A loop as one FMU that is the same for any start values, since it takes them when it is instantiated.
#[derive(Debug)]
pub struct Whole {
    /// Its description, with the start values of the components' descriptions.
    pub source: Source,
    /// The loop's start values, by the names of the composite's variables.
    pub values: Vec<(String, fmu::Value)>,
    /// Notes on what a user may have forgotten or will miss.
    pub notes: Vec<String>,
}

impl Whole {
    /// Composes a loop after the same checks as for separate components.
    ///
    /// # Errors
    /// As [`composite`].
    pub fn new(structure: &Structure, library: &Library) -> Result<Self, Error> {
        let mut units = Units::of(structure, library)?;
        let mut values = Vec::new();
        for PreparedUnit { component, described, start, .. } in &mut units.of {
            let name = |place: usize| format!("{}.{}", component.name, described.variables[place].name);
            values.extend(start.drain(..).map(|(place, value)| (name(place), value)));
        }
        Ok(Whole { source: units.whole(structure)?, values, notes: units.notes })
    }
}

/// The description of a loop as one FMU, and notes for the user, after the same checks as for separate components.
///
/// # Errors
/// If one of its FMUs isn't of this package, or a connection or value doesn't fit.
pub fn composite(structure: &Structure, library: &Library) -> Result<(Source, Vec<String>), Error> {
    let units = Units::of(structure, library)?;
    Ok((units.whole(structure)?, units.notes))
}

/// The components of a loop that becomes a single FMU.
struct Units<'a> {
    of: Vec<PreparedUnit<'a>>,
    notes: Vec<String>,
}

struct PreparedUnit<'a> {
    component: &'a Component,
    source: Source,
    described: ModelDescription,
    /// The loop's start values: places of variables.
    start: Vec<(usize, fmu::Value)>,
}

impl<'a> Units<'a> {
    fn of(structure: &'a Structure, library: &Library) -> Result<Self, Error> {
        let is_elsewhere = |unit: &&Component| matches!(unit.file, UnitFile::Archive { elsewhere: true, .. });
        if let Some(unit) = structure.components.iter().find(is_elsewhere) {
            let reason = format!(
                "`{}` is an FMU archive. Only FMUs generated from descriptions can be simulated as a single FMU",
                unit.name
            );
            return Err(Error::Loop { file: structure.file.clone(), reason });
        }
        let components = structure.components.iter();
        let sources = components.map(|unit| structure.description_of(&unit.fmu)).collect::<Result<Vec<_>, _>>()?;
        let described = sources.iter().map(|source| fmu_description(source, library)).collect::<Result<Vec<_>, _>>()?;
        let wiring = check(structure, &described.iter().collect::<Vec<_>>(), AlgebraicLoops::Refused)?;
        let mut links = structure.connections.iter().zip(&wiring.links);
        if let Some((connection, _)) = links.find(|(_, link)| link.conversion != Affine::IDENTITY) {
            return Err(structure.refuse(
                connection.line,
                "a connection inside a single FMU can't convert values. Use equal units of measurement and no \
                 transformation",
            ));
        }
        let parts = structure.components.iter().zip(sources).zip(described).zip(wiring.values);
        let of =
            parts.map(|(((component, source), described), start)| PreparedUnit { component, source, described, start });
        let mut units = Units { of: of.collect(), notes: wiring.notes };
        units.leave_out_steps();
        Ok(units)
    }

    /// Drops start values about a component's own steps, which have no meaning in a composite.
    fn leave_out_steps(&mut self) {
        for PreparedUnit { component, described, start, .. } in &mut self.of {
            start.retain(|(place, _)| {
                let variable = &described.variables[*place].name;
                let stays = !ABOUT_STEPS.contains(&variable.as_str());
                if !stays {
                    let name = format!("{}.{variable}", component.name);
                    self.notes.push(format!(
                        "`{name}` is ignored: it sets the integration of one component, but a single FMU integrates \
                         all components together"
                    ));
                }
                stays
            });
        }
    }

    /// Author, version, license and copyright, each if all components agree.
    fn about(&self) -> Table {
        let shared = |key: &str| {
            let mut texts = self.of.iter().map(|unit| unit.described.about.iter().find(|(known, _)| *known == key));
            let first = texts.next()??;
            texts.all(|text| text == Some(first)).then(|| (key.to_owned(), Value::String(first.1.clone())))
        };
        ABOUT.into_iter().filter_map(shared).collect()
    }

    /// The description of the composite.
    fn whole(&self, structure: &Structure) -> Result<Source, Error> {
        let parts = self.of.iter().map(|unit| Ok(Value::Table(unit.part(structure)?)));
        let mut whole = source(structure, parts.collect::<Result<_, Error>>()?, (own_start(structure)?, self.about()));
        whole.text.insert_str(0, &as_comments(self.of.iter().map(|unit| &unit.source)));
        Ok(whole)
    }
}

/// The components' descriptions, each once, as comments: the composite has their content, but not their text.
fn as_comments<'a>(sources: impl Iterator<Item = &'a Source>) -> String {
    let mut files = BTreeSet::new();
    let sources = sources.filter(|source| files.insert(&source.file));
    let commented = |source: &Source| {
        let name = source.file.file_name().unwrap_or_default().to_string_lossy();
        let lines: String = source.text.lines().map(|line| format!("# {line}").trim_end().to_owned() + "\n").collect();
        format!("# From {name}:\n#\n{lines}\n")
    };
    sources.map(commented).collect()
}

/// The user's start values for the composite's own parameters.
fn own_start(structure: &Structure) -> Result<Table, Error> {
    let entry = |value: &StartValue| {
        let StartValue { name, text, origin, .. } = value;
        if !ABOUT_STEPS.contains(&name.as_str()) {
            let known = ABOUT_STEPS.join(", ");
            return Err(
                origin.refuse(&format!("`{name}` must be UNIT.variable, or a parameter of the single FMU: {known}"))
            );
        }
        let number = text.parse().map(Value::Integer).or_else(|_| text.parse().map(Value::Float));
        Ok((name.clone(), number.unwrap_or_else(|_| Value::String(text.clone()))))
    };
    structure.whole.iter().map(entry).collect()
}

/// The description of an FMU that starts with the values of a parameter set.
///
/// # Errors
/// If the set can't be read, or a value doesn't fit.
pub fn with_values(source: Source, parameters: &Path, library: &Library) -> Result<Source, Error> {
    let described = fmu_description(&source, library)?;
    starting(&source, &described, &Component::alone(&described.name, parameters)?, library)
}

/// The description of a loop's component with the loop's start values.
///
/// # Errors
/// If there is no description of it, or a value doesn't fit.
pub fn started(structure: &Structure, unit: &Component, library: &Library) -> Result<Source, Error> {
    let source = structure.description_of(&unit.fmu)?;
    let described = fmu_description(&source, library)?;
    starting(&source, &described, unit, library)
}

/// The description of a loop's FMU with C sources, whose design is fixed at export: it starts with those of the
/// loop's values that the design reads.
///
/// # Errors
/// As [`started`], and if components that share the FMU have different values of its design.
pub fn designed(structure: &Structure, fmu: &str, library: &Library) -> Result<Source, Error> {
    let source = structure.description_of(fmu)?;
    let units: Vec<_> = structure.components.iter().filter(|unit| unit.fmu == fmu).collect();
    if units.iter().all(|unit| unit.values.is_empty()) {
        return Ok(source);
    }
    let xml = library.source(&source)?.unit.model_description;
    let compiled =
        ModelDescription::read(&xml).map_err(|reason| Error::Description { file: source.file.clone(), reason })?;
    let is_read =
        |start: &&StartValue| compiled.place(&start.name).is_some_and(|place| is_designed(&compiled.variables[place]));
    let of_design = |unit: &&Component| Component {
        values: unit.values.iter().filter(is_read).cloned().collect(),
        ..(*unit).clone()
    };
    let described = fmu_description(&source, library)?;
    let units = units.iter().map(of_design).collect::<Vec<_>>();
    let first = start_values(&units[0], &described, |_| false)?;
    for unit in &units[1..] {
        let other = start_values(unit, &described, |_| false)?;
        let differs = first.iter().find(|value| !other.contains(value));
        if let Some((place, _)) = differs.or_else(|| other.iter().find(|value| !first.contains(value))) {
            let (one, another, name) = (&units[0].name, &unit.name, &described.variables[*place].name);
            let reason = format!(
                "`{one}` and `{another}` are components of the same FMU, {fmu}, but differ in `{name}`, which its \
                 design reads. With C sources the design is fixed at export. Give both the same value, or export \
                 without --source and --compile"
            );
            return Err(Error::Loop { file: structure.file.clone(), reason });
        }
    }
    starting(&source, &described, &units[0], library)
}

/// A description with the values of a component.
fn starting(
    source: &Source,
    described: &ModelDescription,
    unit: &Component,
    library: &Library,
) -> Result<Source, Error> {
    let values = start_values(unit, described, |_| false)?;
    let started = source.with_start(values.iter().map(|(place, value)| {
        let variable = &described.variables[*place];
        (variable.name.as_str(), in_description::<toml_edit::Value>(variable, value))
    }))?;
    // A value that the description refuses comes from the parameter set.
    describe(&started, library).map_err(|error| {
        let Error::Description { reason, .. } = &error else { return error };
        let of = |value: &&StartValue| reason.split_whitespace().any(|word| word == value.name);
        let refused = unit.values.iter().find(of).map(|value| value.origin.refuse(reason));
        refused.unwrap_or(error)
    })?;
    Ok(started)
}

/// Refuses start values that components with descriptions don't take.
///
/// # Errors
/// As [`start_values`], and for a description that is refused.
pub fn check_values(structure: &Structure, library: &Library) -> Result<(), Error> {
    structure.components.iter().filter(|component| component.is_exported()).try_for_each(|component| {
        let described = fmu_description(&structure.description_of(&component.fmu)?, library)?;
        start_values(component, &described, |_| false).map(drop)
    })
}

/// The model description of an FMU, as a master would read it.
fn fmu_description(source: &Source, library: &Library) -> Result<ModelDescription, Error> {
    let xml = describe(source, library)?.0.model_description;
    ModelDescription::read(&xml).map_err(|reason| Error::Description { file: source.file.clone(), reason })
}

/// The text of the composite's description.
fn source(structure: &Structure, parts: Vec<Value>, (start, about): (Table, Table)) -> Source {
    let link = |(unit, connector): &(String, String)| Value::String(format!("{unit}.{connector}"));
    let links = structure.connections.iter().map(|c| Value::Array(vec![link(&c.from), link(&c.to)]));
    let mut inside = Table::new();
    inside.insert("connections".to_owned(), Value::Array(links.collect()));
    inside.insert("parts".to_owned(), Value::Array(parts));
    let experiment = [("stop_time", structure.stop_time), ("step", structure.step)];
    let experiment = experiment.map(|(key, value)| (key.to_owned(), Value::Float(value)));
    let name = composite_name(structure);
    let mut description = about;
    description.insert("name".to_owned(), Value::String(name.clone()));
    description.insert("model".to_owned(), Value::String(Kind::COMPOSITE.name.to_owned()));
    description.insert("description".to_owned(), Value::String(format!("{}, as a single FMU", structure.description)));
    description.insert("experiment".to_owned(), Value::Table(experiment.into_iter().collect()));
    description.insert("structure".to_owned(), Value::Table(inside));
    description.insert("start".to_owned(), Value::Table(start));
    Source { file: Path::new(&format!("{name}.toml")).to_owned(), text: description.to_string(), as_written: false }
}

impl PreparedUnit<'_> {
    /// Part of the composite: its description, with the loop's start values except those of connected inputs.
    fn part(&self, structure: &Structure) -> Result<Table, Error> {
        let PreparedUnit { component, source, described, start: values } = self;
        let refuse = |reason: Invalid| Error::Description { file: source.file.clone(), reason: reason.to_string() };
        let into = structure.connections.iter().filter(|connection| connection.to.0 == component.name);
        let connected: BTreeSet<&str> = into.map(|connection| connection.to.1.as_str()).collect();
        let description = model::Description::read(&source.text).map_err(refuse)?;
        let mut start = description.start;
        start.retain(|name, _| !ABOUT_STEPS.contains(&name));
        start = start.into_iter().flat_map(|(name, value)| unconnected(name, value, &connected)).collect();
        start.extend(values.iter().map(|(place, value)| {
            let variable = &described.variables[*place];
            (variable.name.clone(), in_description(variable, value))
        }));
        let mut part = Table::new();
        part.insert("name".to_owned(), Value::String(component.name.clone()));
        part.insert("model".to_owned(), Value::String(description.model));
        part.insert("structure".to_owned(), Value::Table(description.structure));
        let names = Value::try_from(&description.names).map_err(|error| refuse(Invalid::because(error)))?;
        part.insert("names".to_owned(), names);
        part.insert("start".to_owned(), Value::Table(start));
        part.insert("magnitudes".to_owned(), Value::Table(description.magnitudes));
        Ok(part)
    }
}

/// A start value without its elements for connected inputs.
fn unconnected(name: String, value: Value, connected: &BTreeSet<&str>) -> Vec<(String, Value)> {
    let element = |k: usize| format!("{name}[{}]", k + 1);
    match value {
        _ if connected.contains(name.as_str()) => Vec::new(),
        Value::Array(values) if (0..values.len()).any(|k| connected.contains(element(k).as_str())) => {
            let elements = values.into_iter().enumerate().map(|(k, value)| (element(k), value));
            elements.filter(|(name, _)| !connected.contains(name.as_str())).collect()
        }
        value => vec![(name, value)],
    }
}

/// A value as a description has it: an enumeration's is the name of the item.
fn in_description<V: From<f64> + From<i64> + From<bool> + From<String>>(variable: &Variable, value: &fmu::Value) -> V {
    match value {
        fmu::Value::Real(number) => (*number).into(),
        fmu::Value::Integer(number) => {
            let item = variable.items.iter().find(|(_, item)| item == number);
            item.map_or_else(|| i64::from(*number).into(), |(name, _)| name.clone().into())
        }
        fmu::Value::Boolean(value) => (*value).into(),
        fmu::Value::String(text) => text.clone().into(),
    }
}
