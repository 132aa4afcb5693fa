//! The thesis' cases that an FMU of this package has, as parameter sets that apply as they are.

use std::path::Path;

use crate::error::Error;
use crate::exporter::{Source, find_description, loops, name_of_whole};
use crate::fmu::Value;
use crate::model::Description;
use crate::model_description::ModelDescription;
use crate::structure::{Component, LoopFiles, Structure, start_values};
use crate::tuning::typed_set;

/// A parameter set: the name of its file, what it is, and its text.
pub struct Case {
    pub file: String,
    pub about: String,
    /// Names of the variables that it sets.
    pub names: Vec<String>,
    pub text: String,
}

/// The cases of an FMU: what each loop of this package sets in it, and the further sets that lie with the loop.
///
/// # Errors
/// When a loop of this package can't be read.
pub fn cases(source: &Source, unit: &ModelDescription) -> Result<Vec<Case>, Error> {
    if let Some((name, _)) = loops().iter().find(|(name, _)| name_of_whole(name) == unit.name) {
        return of_whole(name, unit);
    }
    if !is_shipped(source, &unit.name) {
        return Ok(Vec::new());
    }
    let place = format!("resources/{}.fmu", unit.name);
    let has_it = |texts: &[(&str, &str)]| texts.iter().any(|(_, text)| text.contains(&place));
    let mut cases = Vec::new();
    for (name, _) in loops().iter().filter(|(_, texts)| has_it(texts)) {
        let files = LoopFiles::find(name)?;
        let structure = files.structure()?;
        let has_unit = |component: &&Component| component.fmu == unit.name;
        let count = structure.components.iter().filter(has_unit).count();
        let label =
            |component: &Component| if count == 1 { (*name).to_owned() } else { format!("{name}-{}", component.name) };
        for component in structure.components.iter().filter(has_unit) {
            cases.extend(case(&label(component), &format!("Values of the loop {name}"), component, unit));
        }
        for (set, changed) in further(&files, &structure)? {
            let pairs = changed.components.iter().zip(&structure.components);
            for (component, before) in
                pairs.filter(|(component, before)| has_unit(component) && component.values != before.values)
            {
                let about = format!("Values of the loop {name} with its parameter set {set}");
                cases.extend(case(&format!("{}-{set}", label(before)), &about, component, unit));
            }
        }
    }
    Ok(cases)
}

/// True if a description is that of this package under its name, but for start values.
fn is_shipped(source: &Source, name: &str) -> bool {
    let read = |text: &str| Description::read(text).ok();
    let (own, known) = (read(&source.text), find_description(name).ok().and_then(|known| read(&known.text)));
    let kind = |it: &Description| (it.model.clone(), it.structure.clone(), it.names.clone());
    own.zip(known).is_some_and(|(own, known)| kind(&own) == kind(&known))
}

/// The parameter sets that lie with a loop which doesn't name them itself, and the loop with each of them.
fn further(files: &LoopFiles, structure: &Structure) -> Result<Vec<(String, Structure)>, Error> {
    let named = |file: &String| structure.parameter_files.contains(file);
    let with = |file: String| {
        let mut changed = structure.clone();
        changed.apply_case(Path::new(&file), files)?;
        Ok((file.trim_end_matches(".ssv").to_owned(), changed))
    };
    files.parameter_files().into_iter().filter(|file| !named(file)).map(with).collect()
}

/// The cases of a loop as one FMU: the further sets that lie with the loop.
fn of_whole(name: &str, unit: &ModelDescription) -> Result<Vec<Case>, Error> {
    let files = LoopFiles::find(name)?;
    let structure = files.structure()?;
    let mut cases = Vec::new();
    for (set, changed) in further(&files, &structure)? {
        let named = |component: &Component| {
            let name = component.name.clone();
            component.values.clone().into_iter().map(move |mut value| {
                value.name = format!("{name}.{}", value.name);
                value
            })
        };
        let values = changed.components.iter().flat_map(named).collect();
        let whole = changed.components.first().map(|first| Component { values, ..first.clone() });
        cases.extend(whole.and_then(|whole| case(&set, &format!("Parameter set {set} of the loop"), &whole, unit)));
    }
    Ok(cases)
}

/// The values of a component as a parameter set; none where there are none, or the FMU doesn't take them.
fn case(name: &str, about: &str, component: &Component, unit: &ModelDescription) -> Option<Case> {
    let values = start_values(component, unit, |_| false).ok().filter(|values| !values.is_empty())?;
    let value = |(place, value): &(usize, Value)| {
        let variable = &unit.variables[*place];
        let text = match value {
            Value::Real(number) => number.to_string(),
            Value::Integer(number) => {
                let item = variable.items.iter().find(|(_, known)| known == number);
                item.map_or_else(|| number.to_string(), |(item, _)| item.clone())
            }
            Value::Boolean(value) => value.to_string(),
            Value::String(text) => text.clone(),
        };
        (variable.name.as_str(), variable.kind.as_str(), text)
    };
    let values: Vec<_> = values.iter().map(value).collect();
    let text = typed_set(name, about, &values).ok()?;
    let names = values.iter().map(|(name, ..)| (*name).to_owned()).collect();
    Some(Case { file: format!("{name}.ssv"), about: about.to_owned(), names, text })
}
