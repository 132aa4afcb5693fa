//! Start values and usual magnitudes from a description.

use super::declaration::Declaration;
use super::variable::{Causality, Data, Naming, Section, Variable, Variables};
use crate::near;

impl Declaration {
    /// One for a description with this `[start]`, whose values are set when everything is declared.
    pub(crate) fn of(start: &toml::Table) -> Self {
        let mut declaration = Declaration::default();
        declaration.note_shapes("", start);
        declaration
    }

    /// Notes which variables a `[start]` gives as matrices; their names have the prefix of a part.
    pub(super) fn note_shapes(&mut self, prefix: &str, start: &toml::Table) {
        let matrix = |(name, value): (&String, &toml::Value)| {
            let (array, indices) = name.split_once('[').unwrap_or((name, ""));
            let has_rows = value.as_array().is_some_and(|rows| rows.iter().any(toml::Value::is_array));
            (has_rows || indices.contains(',')).then(|| format!("{prefix}{array}"))
        };
        self.matrices.extend(start.iter().filter_map(matrix));
    }

    /// True if the description gives the start value of this variable as a matrix, by rows or by elements `name[i,j]`. A
    /// system asks where a parameter may be a vector or a matrix, and declares it so.
    pub fn starts_as_matrix(&self, name: &str) -> bool {
        let (_, part) = self.declared();
        self.matrices.contains(&part.map_or(name.to_owned(), |part| format!("{part}.{name}")))
    }
}

impl Variables {
    /// Sets the start value of a whole variable, or of one element of real numbers.
    ///
    /// # Errors
    /// What is allowed, when the variable doesn't exist, can't have a start value, or the value doesn't fit.
    pub(crate) fn set_start(&mut self, name: &str, value: &toml::Value) -> Result<(), String> {
        let settable = |v: &&mut Variable| {
            matches!(v.section, Section::Parameter | Section::Input) && v.causality != Causality::Hidden
        };
        if let Some((variable, offset)) = self.list.iter_mut().filter(settable).find_map(|v| element(v, name)) {
            let (len, value) = (variable.len(), number(value)?);
            if let Data::Real { start, .. } = &mut variable.data {
                set_element(start, len, offset, value);
            }
            return Ok(());
        }
        let Some(variable) = self.list.iter_mut().filter(settable).find(|v| goes_by(v, name)) else {
            if self.without_effect.iter().any(|known| is_of(known, name)) {
                return Ok(());
            }
            return Err(format!("there is no such parameter; {}", near::choice(name, &self.parameters_near(name), "")));
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

    /// Sets the usual magnitude of a whole variable of real numbers, or of one element: FMI's nominal value.
    ///
    /// # Errors
    /// What is allowed, when there is no such variable of real numbers, or the value doesn't fit.
    pub(crate) fn set_magnitude(&mut self, name: &str, value: &toml::Value) -> Result<(), String> {
        let has_one = |v: &&mut Variable| v.is_real() && v.causality != Causality::Hidden;
        if let Some((variable, offset)) = self.list.iter_mut().filter(has_one).find_map(|v| element(v, name)) {
            let (len, value) = (variable.len(), positive(number(value)?)?);
            if let Data::Real { nominal, .. } = &mut variable.data {
                set_element(nominal, len, offset, value);
            }
            return Ok(());
        }
        let Some(variable) = self.list.iter_mut().filter(has_one).find(|v| goes_by(v, name)) else {
            let reals = self.list.iter().filter(|v| v.is_real() && v.causality != Causality::Hidden);
            let known: Vec<_> = reals.map(|v| v.name.clone()).collect();
            return Err(format!("there is no such variable of real numbers; {}", near::choice(name, &known, "")));
        };
        let given = reals(variable.naming, value)?;
        given.iter().try_for_each(|&value| positive(value).map(drop))?;
        if let Data::Real { nominal, .. } = &mut variable.data {
            *nominal = given;
        }
        Ok(())
    }

    /// Takes the start values and magnitudes that a description gives the same variables of other sizes, where they differ from
    /// those that these were declared with.
    pub(crate) fn take_starts(&mut self, given: &Variables, declared: &Variables) {
        for ((own, given), declared) in self.list.iter_mut().zip(&given.list).zip(&declared.list) {
            let shapes = [given.naming, own.naming];
            match (&mut own.data, &given.data, &declared.data) {
                (
                    Data::Real { start, nominal, .. },
                    Data::Real { start: given_start, nominal: given_nominal, .. },
                    Data::Real { start: own_start, nominal: own_nominal, .. },
                ) => {
                    if given_start != own_start {
                        *start = resized(given_start, shapes, Beyond::Diagonal);
                    }
                    if given_nominal != own_nominal {
                        *nominal = resized(given_nominal, shapes, Beyond::Nearest);
                    }
                }
                (own, given, _) => own.clone_from(given),
            }
        }
    }

    /// The names by which parameters can be set: of whole ones, a user's own, and of the elements of one whose name it begins
    /// with.
    fn parameters_near(&self, name: &str) -> Vec<String> {
        let array = name.split_once('[').map(|(array, _)| array);
        let parameters = self.list.iter().filter(|v| v.causality == Causality::Parameter);
        let names = parameters.flat_map(|v| {
            let elements = v.elements().filter(|_| v.naming != Naming::Scalar && array == Some(&v.name));
            let elements: Vec<_> = elements.map(|element| element.name()).collect();
            [v.name.clone()].into_iter().chain(v.given.iter().flatten().cloned()).chain(elements)
        });
        names.collect()
    }
}

/// Value of an element of a matrix that was smaller.
#[derive(Clone, Copy, PartialEq)]
enum Beyond {
    /// The last one of the diagonal there, 0 elsewhere.
    Diagonal,
    /// The nearest one.
    Nearest,
}

/// Values of an array that has another shape now, as they are stored; new elements of a vector have the last one's.
fn resized(values: &[f64], [from, to]: [Naming; 2], beyond: Beyond) -> Vec<f64> {
    let (Naming::Matrix(rows, columns), Naming::Matrix(new_rows, new_columns)) = (from, to) else {
        let (Naming::Vector(len) | Naming::Diagonal(len)) = to else { return values.to_vec() };
        let last = values.last().copied().unwrap_or_default();
        let all = values.iter().copied().chain(std::iter::repeat(last)).take(len);
        return if values.len() == 1 { values.to_vec() } else { all.collect() };
    };
    // One value for all elements, if there are several.
    if values.len() < rows * columns {
        return values.to_vec();
    }
    let value = |i: usize, j: usize| values[i.min(rows - 1) + j.min(columns - 1) * rows];
    let last = rows.min(columns) - 1;
    let element = |k: usize| match (k % new_rows, k / new_rows) {
        (i, j) if i < rows && j < columns || beyond == Beyond::Nearest => value(i, j),
        (i, j) if i == j => value(last, last),
        _ => 0.0,
    };
    (0..new_rows * new_columns).map(element).collect()
}

/// The variable with the place of an element, if it has one of this name in addition to its own.
fn element<'a>(variable: &'a mut Variable, name: &str) -> Option<(&'a mut Variable, usize)> {
    let is_users = variable.given.iter().any(|given| given.as_deref() == Some(name));
    let has_indices = name.strip_prefix(variable.name.as_str()).is_some_and(|indices| indices.starts_with('['));
    // Checked before all names are built, of which there may be many.
    if variable.naming == Naming::Scalar || !(is_users || has_indices) {
        return None;
    }
    let found = variable.elements().find(|element| element.name() == name)?.offset;
    Some((variable, found))
}

/// True if a name is this one, or that of an element of it.
fn is_of(known: &str, name: &str) -> bool {
    name.strip_prefix(known).is_some_and(|indices| indices.is_empty() || indices.starts_with('['))
}

/// True if this is the variable's own name; a scalar goes by the user's, too.
fn goes_by(variable: &Variable, name: &str) -> bool {
    variable.name == name || variable.naming == Naming::Scalar && variable.element(0).name() == name
}

/// Sets one of as many values as the variable has elements, where there may be one for all.
fn set_element(values: &mut Vec<f64>, len: usize, offset: usize, value: f64) {
    if values.len() == 1 {
        *values = vec![values[0]; len];
    }
    values[offset] = value;
}

fn positive(value: f64) -> Result<f64, String> {
    if value > 0.0 && value.is_normal() { Ok(value) } else { Err("must be above 0".to_owned()) }
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
            let is_row = |row: &toml::Value| row.as_array().is_some_and(|row| row.len() == columns);
            let fits = |list: &&Vec<toml::Value>| list.len() == rows && list.iter().all(is_row);
            let list = value.as_array().filter(fits).ok_or_else(expected)?;
            let by_rows: Vec<_> = list.iter().map(|row| numbers(row, columns)).collect::<Result<_, _>>()?;
            Ok((0..rows * columns).map(|k| by_rows[k % rows][k / rows]).collect())
        }
    }
}
