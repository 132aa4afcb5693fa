//! What is set and read: variables by name and type, and the tables that they come from.

use fmi::fmi2::import::Fmi2Import;
use fmi::fmi2::instance::Common;
use fmi::fmi2::schema::{Causality, ScalarVariable, ScalarVariableElement};
use fmi::traits::FmiImport;

use crate::Answer;

/// One communication step and the inputs that are set before it.
pub struct Row {
    pub time: f64,
    pub step: f64,
    pub inputs: Vec<f64>,
}

/// All steps.
pub struct Points {
    pub inputs: Vec<String>,
    pub rows: Vec<Row>,
}

impl Points {
    pub fn read(text: &str) -> Answer<Self> {
        let mut lines = text.lines();
        let inputs = lines.next().ok_or("POINTS is empty")?.split('\t').skip(2).map(String::from).collect();
        let rows = lines.map(Self::row).collect::<Answer<Vec<_>>>()?;
        if rows.is_empty() { Err("POINTS has no step".into()) } else { Ok(Self { inputs, rows }) }
    }

    fn row(line: &str) -> Answer<Row> {
        let numbers = line.split('\t').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        let [time, step, inputs @ ..] = &numbers[..] else { return Err("a step without time and length".into()) };
        Ok(Row { time: *time, step: *step, inputs: inputs.to_vec() })
    }
}

/// Names and numbers of start values.
pub fn start_values(text: &str) -> Answer<Vec<(String, f64)>> {
    let pair = |line: &str| {
        let (name, value) = line.split_once('\t').ok_or("a start value without a number")?;
        Ok((name.to_string(), value.parse()?))
    };
    text.lines().map(pair).collect()
}

#[derive(Clone, Copy)]
enum Kind {
    Real,
    Integer,
    Boolean,
}

/// Some variables of a unit, of any types.
pub struct Variables(Vec<(String, u32, Kind)>);

impl Variables {
    /// Those with these names.
    pub fn named(import: &Fmi2Import, names: &[String]) -> Answer<Self> {
        let found = |name: &String| {
            let mut all = import.model_description().get_model_variables();
            let variable = all.find(|variable| variable.name == *name);
            Self::entry(variable.ok_or_else(|| format!("no variable `{name}`"))?)
        };
        Ok(Self(names.iter().map(found).collect::<Answer<_>>()?))
    }

    /// All with this causality.
    pub fn of(import: &Fmi2Import, causality: Causality) -> Answer<Self> {
        let all = import.model_description().get_model_variables();
        Ok(Self(all.filter(|variable| variable.causality == causality).map(Self::entry).collect::<Answer<_>>()?))
    }

    fn entry(variable: &ScalarVariable) -> Answer<(String, u32, Kind)> {
        let kind = match variable.elem {
            ScalarVariableElement::Real(_) => Kind::Real,
            ScalarVariableElement::Integer(_) | ScalarVariableElement::Enumeration => Kind::Integer,
            ScalarVariableElement::Boolean(_) => Kind::Boolean,
            ScalarVariableElement::String => return Err(format!("`{}` is a text", variable.name).into()),
        };
        Ok((variable.name.clone(), variable.value_reference, kind))
    }

    pub fn set(&self, unit: &mut impl Common, values: &[f64]) -> Answer<()> {
        for ((_, reference, kind), value) in self.0.iter().zip(values) {
            match kind {
                Kind::Real => unit.set_real(&[*reference], &[*value])?,
                Kind::Integer => unit.set_integer(&[*reference], &[*value as i32])?,
                Kind::Boolean => unit.set_boolean(&[*reference], &[*value as i32])?,
            };
        }
        Ok(())
    }

    fn get(&self, unit: &mut impl Common) -> Answer<Vec<f64>> {
        let one = |(_, reference, kind): &(String, u32, Kind)| {
            let (mut real, mut whole) = ([0.0], [0]);
            match kind {
                Kind::Real => unit.get_real(&[*reference], &mut real)?,
                Kind::Integer => unit.get_integer(&[*reference], &mut whole)?,
                Kind::Boolean => unit.get_boolean(&[*reference], &mut whole)?,
            };
            Ok(if matches!(kind, Kind::Real) { real[0] } else { f64::from(whole[0]) })
        };
        self.0.iter().map(one).collect()
    }

    pub fn print_names(&self) {
        let names: Vec<&str> = self.0.iter().map(|(name, ..)| name.as_str()).collect();
        println!("{}", names.join("\t"));
    }

    /// A line of their values now.
    pub fn print(&self, unit: &mut impl Common) -> Answer<()> {
        let values: Vec<String> = self.get(unit)?.iter().map(|value| format!("{value:?}")).collect();
        println!("{}", values.join("\t"));
        Ok(())
    }
}
