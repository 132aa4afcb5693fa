//! Start values from a description.

use super::variable::{Causality, Data, Naming, Section, Variable, Variables};

impl Variables {
    /// Sets the start value of a whole variable.
    ///
    /// # Errors
    /// What is allowed, when the variable doesn't exist, can't have a start value, or the value doesn't fit.
    pub(crate) fn set_start(&mut self, name: &str, value: &toml::Value) -> Result<(), String> {
        let settable = |v: &&mut Variable| {
            matches!(v.section, Section::Parameter | Section::Input) && v.causality != Causality::Hidden
        };
        let Some(variable) = self.list.iter_mut().filter(settable).find(|variable| variable.name == name) else {
            let known: Vec<_> =
                self.list.iter().filter(|v| v.causality == Causality::Parameter).map(|v| &*v.name).collect();
            return Err(format!("there is no such parameter; there are {}", known.join(", ")));
        };
        let naming = variable.naming;
        match &mut variable.data {
            Data::Real { start, .. } => *start = reals(naming, value)?,
            Data::Integer { start, .. } => *start = integer(value)?,
            Data::Boolean { start } => *start = value.as_bool().ok_or("must be true or false")?,
            Data::Choice { items, start, .. } => {
                let names: Vec<_> = items.iter().map(|(name, _)| name.as_str()).collect();
                let found = value.as_str().and_then(|text| names.iter().position(|name| *name == text));
                *start = 1 + found.ok_or_else(|| format!("must be one of {}", names.join(", ")))? as i32;
            }
        }
        Ok(())
    }
}

fn integer(value: &toml::Value) -> Result<i32, String> {
    value.as_integer().and_then(|value| i32::try_from(value).ok()).ok_or_else(|| "must be an integer".to_owned())
}

fn number(value: &toml::Value) -> Result<f64, String> {
    let number = value.as_float().or_else(|| value.as_integer().map(|integer| integer as f64));
    number.filter(|number| number.is_finite()).ok_or_else(|| "must be a finite number".to_owned())
}

fn numbers(value: &toml::Value, len: usize) -> Result<Vec<f64>, String> {
    let expected = || format!("must be a list of {len} numbers");
    let list = value.as_array().filter(|list| list.len() == len).ok_or_else(expected)?;
    list.iter().map(number).collect()
}

/// Numbers in the order of storage: matrices by columns.
fn reals(naming: Naming, value: &toml::Value) -> Result<Vec<f64>, String> {
    match naming {
        Naming::Scalar => Ok(vec![number(value)?]),
        Naming::Vector(len) | Naming::Diagonal(len) => numbers(value, len),
        Naming::Matrix(rows, columns) => {
            let expected = || format!("must be {rows} rows of {columns} numbers");
            let list = value.as_array().filter(|list| list.len() == rows).ok_or_else(expected)?;
            let by_rows: Vec<_> = list.iter().map(|row| numbers(row, columns)).collect::<Result<_, _>>()?;
            Ok((0..rows * columns).map(|k| by_rows[k % rows][k / rows]).collect())
        }
    }
}
