//! Parameter sets (.ssv), their bindings, and start values given by name.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use roxmltree::Node;

use super::files::{LoopFiles, is_inside};
use super::reader::{Reader, parse};
use super::source::UnitFile;
use super::{Component, Origin, StartValue, Structure};
use crate::error::Error;
use crate::model_description::UnitDefinition;
use crate::model_description::{attribute, child, elements};
use crate::{near, text_file};

const PARAMETER_SET: &str = "application/x-ssp-parameter-set";

/// Reads a parameter set.
///
/// # Errors
/// If something is wrong, with its line.
fn read_set(text: &str, file: &Path) -> Result<Vec<StartValue>, Error> {
    let document = parse(text, file)?;
    Reader::new(&document, file).parameter_set(document.root_element(), &[])
}

impl Component {
    /// A standalone FMU with the values of a parameter set.
    ///
    /// # Errors
    /// If the set can't be read.
    pub fn alone(fmu: &str, parameters: &Path) -> Result<Self, Error> {
        let text = text_file::read(parameters).map_err(Error::file(parameters))?;
        let (name, values) = (fmu.to_owned(), read_set(&text, parameters)?);
        Ok(Component {
            source: String::new(),
            fmu: name.clone(),
            file: UnitFile::Named,
            name,
            connectors: Vec::new(),
            values,
        })
    }
}

impl Reader<'_> {
    /// The values that are bound to a component or a system, in the order in which they are given.
    pub fn bindings(
        &self,
        element: Node,
        units: &[UnitDefinition],
        files: &LoopFiles,
    ) -> Result<Vec<StartValue>, Error> {
        let mut values = Vec::new();
        let bindings = child(element, "ParameterBindings").into_iter();
        for node in bindings.flat_map(|node| elements(node, "ParameterBinding")) {
            let kind = attribute(node, "type").unwrap_or_else(|| PARAMETER_SET.to_owned());
            if kind != PARAMETER_SET {
                return Err(self.refuse(node, &format!("type = {kind}: must be {PARAMETER_SET}")));
            }
            let mut bound = match node.attribute("source") {
                Some(source) => self.bound_file(node, source, files)?,
                None => {
                    let inline = self.inside(self.inside(node, "ParameterValues")?, "ParameterSet")?;
                    self.parameter_set(inline, units)?
                }
            };
            let prefix = node.attribute("prefix").unwrap_or_default();
            if let Some(mapping) = child(node, "ParameterMapping") {
                if !prefix.is_empty() {
                    return Err(self.refuse(node, "a prefix together with a ParameterMapping can't be read"));
                }
                bound = self.mapped(mapping, bound, files)?;
            }
            bound.iter_mut().for_each(|value| value.name.insert_str(0, prefix));
            values.extend(bound);
        }
        Ok(values)
    }

    /// Values under the names that a mapping gives them, without those that it doesn't name.
    fn mapped(&self, node: Node, values: Vec<StartValue>, files: &LoopFiles) -> Result<Vec<StartValue>, Error> {
        let Some(source) = node.attribute("source") else {
            return self.entries(self.inside(node, "ParameterMapping")?, &values);
        };
        let (text, file) = self.text_of(node, source, files)?;
        let document = parse(&text, &file)?;
        Reader::new(&document, &file).entries(document.root_element(), &values)
    }

    fn entries(&self, mapping: Node, values: &[StartValue]) -> Result<Vec<StartValue>, Error> {
        let entry = |node: Node| {
            let (source, target) = (self.required(node, "source")?, self.required(node, "target")?);
            let value = values.iter().find(|value| value.name == source);
            let value = value.ok_or_else(|| {
                self.refuse(node, &format!("source = {source}: must be a value of this parameter set"))
            })?;
            let mut value = StartValue { name: target, ..value.clone() };
            let transformation = node.children().find(|child| child.tag_name().name().ends_with("Transformation"));
            if let Some(node) = transformation {
                let affine = self.linear(node)?;
                let number: f64 = value.text.trim().parse().map_err(|_| {
                    self.refuse(node, &format!("`{source}` = {}: only numbers can be transformed", value.text))
                })?;
                value.text = affine.of(number).to_string();
            }
            Ok(value)
        };
        elements(mapping, "MappingEntry").map(entry).collect()
    }

    fn bound_file(&self, node: Node, source: &str, files: &LoopFiles) -> Result<Vec<StartValue>, Error> {
        let (text, file) = self.text_of(node, source, files)?;
        read_set(&text, &file)
    }

    /// The text of a file in the folder of the loop, and its path.
    fn text_of(&self, node: Node, source: &str, files: &LoopFiles) -> Result<(String, PathBuf), Error> {
        if node.attribute("sourceBase").is_some_and(|base| base != "SSD") {
            return Err(self.refuse(node, "sourceBase: must be SSD, because files within an FMU can't be read"));
        }
        if !is_inside(source) {
            return Err(self.refuse(node, &format!("source = {source}: must be a file in the folder of the loop")));
        }
        let text = files.read(source).map_err(|error| self.refuse(node, &format!("source = {source}: {error}")))?;
        Ok((text, files.path(source)))
    }

    fn parameter_set(&self, set: Node, units: &[UnitDefinition]) -> Result<Vec<StartValue>, Error> {
        if set.tag_name().name() != "ParameterSet" {
            return Err(self.refuse(set, "this is not a ParameterSet"));
        }
        let mut known = self.units(set)?;
        known.extend_from_slice(units);
        let (mut values, mut names) = (Vec::new(), HashSet::new());
        for node in elements(self.inside(set, "Parameters")?, "Parameter") {
            let value = self.parameter(node, &known)?;
            if !names.insert(value.name.clone()) {
                return Err(self.refuse(node, &format!("`{}` is given twice", value.name)));
            }
            values.push(value);
        }
        Ok(values)
    }

    fn parameter(&self, node: Node, units: &[UnitDefinition]) -> Result<StartValue, Error> {
        let name = self.required(node, "name")?;
        let value = node.children().find(Node::is_element);
        let value = value.ok_or_else(|| self.refuse(node, &format!("Parameter `{name}` has no value")))?;
        let (kind, text) = (value.tag_name().name(), self.required(value, "value")?);
        if !["Real", "Integer", "Boolean", "String", "Enumeration"].contains(&kind) {
            return Err(self.refuse(value, &format!("Parameter `{name}`: values of type {kind} can't be read")));
        }
        let (data_type, unit) = (Some(kind.to_owned()), self.unit(value, units));
        Ok(StartValue { name, data_type, text, unit, origin: self.origin(node) })
    }
}

/// The last value of each name, in the order in which they were given.
pub(super) fn latest(values: Vec<StartValue>) -> Vec<StartValue> {
    let mut names = HashSet::new();
    let mut latest: Vec<_> = values.into_iter().rev().filter(|value| names.insert(value.name.clone())).collect();
    latest.reverse();
    latest
}

/// Replaces an earlier value of the same name.
fn put(values: &mut Vec<StartValue>, value: StartValue) {
    values.retain(|earlier| earlier.name != value.name);
    values.push(value);
}

impl Structure {
    /// Takes over values that are named `component.variable`; they replace a component's own ones.
    ///
    /// # Errors
    /// For a name that begins with no component of the loop.
    pub fn apply(&mut self, values: Vec<StartValue>) -> Result<(), Error> {
        for mut value in values {
            let (place, name) = self.split(&value.name, |_| None).map_err(|reason| value.origin.refuse(&reason))?;
            value.name = name;
            self.components[place].values.push(value);
        }
        for component in &mut self.components {
            component.values = latest(std::mem::take(&mut component.values));
        }
        Ok(())
    }

    /// Applies a parameter set: a file, or one of those next to the structure.
    ///
    /// # Errors
    /// If it can't be read, or names what isn't there.
    pub fn apply_case(&mut self, case: &Path, files: &LoopFiles) -> Result<(), Error> {
        let (text, file) = files.case(case)?;
        self.apply(read_set(&text, &file)?)
    }

    /// Sets a start value from `UNIT.variable=value`, where UNIT is a component, or an FMU that only one has. A name
    /// without a dot is a parameter of the composite.
    ///
    /// # Errors
    /// If the text has another form, or UNIT isn't there.
    pub fn set(&mut self, assignment: &str) -> Result<(), Error> {
        let origin = Origin { file: format!("--set {assignment}").into(), line: None };
        let Some((target, text)) = assignment.split_once('=') else {
            return Err(origin.refuse("must be UNIT.variable=value"));
        };
        let (target, text) = (target.trim(), text.trim().to_owned());
        if !target.contains('.') {
            put(&mut self.whole, StartValue { name: target.to_owned(), data_type: None, text, unit: None, origin });
            return Ok(());
        }
        let (place, name) = self.target(target).map_err(|reason| origin.refuse(&reason))?;
        put(&mut self.components[place].values, StartValue { name, data_type: None, text, unit: None, origin });
        Ok(())
    }

    /// The full name of the variable that such an assignment sets; none of a parameter of the composite.
    pub fn set_by(&self, assignment: &str) -> Option<String> {
        let (target, _) = assignment.split_once('=')?;
        let (place, name) = self.target(target.trim()).ok()?;
        Some(format!("{}.{name}", self.components[place].name))
    }

    /// The component and the variable of a name, whose component may be named by an FMU that only one has.
    fn target(&self, name: &str) -> Result<(usize, String), String> {
        self.split(name, |unit: &str| {
            let users: Vec<usize> = (0..self.components.len()).filter(|&k| self.components[k].fmu == unit).collect();
            (!users.is_empty()).then_some(users)
        })
    }

    /// # Errors
    /// For a value that names no component: separate components share none.
    pub(crate) fn check_separate(&self) -> Result<(), Error> {
        let Some(value) = self.whole.first() else { return Ok(()) };
        let reason = self.split(&value.name, |_| None).err().unwrap_or_default();
        Err(value.origin.refuse(&format!(
            "{reason}; a name without a component is a parameter of the loop as a single FMU (--composite)"
        )))
    }

    /// The component that a name begins with, and the variable; names of both may contain dots.
    fn split(&self, name: &str, others: impl Fn(&str) -> Option<Vec<usize>>) -> Result<(usize, String), String> {
        let parts = name.match_indices('.').map(|(dot, _)| (&name[..dot], &name[dot + 1..]));
        for (unit, variable) in parts {
            if let Some(place) = self.components.iter().position(|component| component.name == unit) {
                return Ok((place, variable.to_owned()));
            }
            match others(unit).as_deref() {
                None => {}
                Some([place]) => return Ok((*place, variable.to_owned())),
                Some(places) => {
                    let names: Vec<_> = places.iter().map(|&place| self.components[place].name.as_str()).collect();
                    return Err(format!(
                        "`{unit}` is the FMU of several components. Name one of them: {}",
                        names.join(", ")
                    ));
                }
            }
        }
        let names: Vec<_> = self.components.iter().map(|component| component.name.as_str()).collect();
        let unit = name.split_once('.').map_or(name, |(unit, _)| unit);
        let choice = near::choice(unit, &names, "");
        Err(format!("`{name}` must be UNIT.variable, where UNIT is a component of this loop; {choice}"))
    }
}
