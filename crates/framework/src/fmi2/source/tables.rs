//! Tables of a unit: its variables, its start values, what of its outputs is watched, the pattern of its Jacobian.

use std::fmt::Write;

use super::Unit;
use super::expression::number;
use super::fmi3::Tables;
use super::message::quoted;
use crate::fmi2::access::{Access, References, Type};
use crate::model::{Model, Standard};
use crate::system::{Data, Section};

/// Entries in a line.
const IN_A_LINE: usize = 8;

/// All of them.
pub fn write(unit: &Unit) -> String {
    let (model, variables) = (unit.model, unit.model.variables());
    let description = model.description();
    let mut text =
        format!("/* {}: {}. Generated from its recorded equations. */\n\n", description.name, description.description);
    text = text.replace("*/ */", "*/");
    text += "#include \"runtime.h\"\n\n";
    text += &real_variables(unit);
    text += &integer_variables(unit);
    text += &list("real unit_start_reals[UNIT_REALS]", unit.start.reals.iter().map(|value| number(*value)));
    let integers = unit.start.integers.iter().map(ToString::to_string);
    text += &list("int unit_start_integers[AT_LEAST_ONE(UNIT_INTEGERS)]", integers);
    let nominals = (0..variables.states()).map(|k| variables.real_at(Section::State, k).map_or(1.0, |e| e.nominal()));
    text += &list("real unit_nominals[AT_LEAST_ONE(UNIT_STATES)]", nominals.map(number));
    let outputs = variables.controlled();
    let outputs = outputs.map(|(place, output, nominal)| format!("{{ {place}, {output}, {} }}", number(nominal)));
    text += &list("Output unit_watched[AT_LEAST_ONE(UNIT_OUTPUTS)]", outputs);
    let names = variables.indicators().iter().map(|name| quoted(name));
    text += &list("char *const unit_indicator_names[AT_LEAST_ONE(UNIT_INDICATORS)]", names);
    let categories = unit.categories.iter().map(|name| quoted(name));
    text += &list("char *const unit_categories[UNIT_CATEGORIES]", categories);
    let columns = model.sparsity().columns();
    let ends = columns.iter().scan(0, |sum, rows| {
        *sum += rows.len();
        Some(*sum)
    });
    let ends = std::iter::once(0).chain(ends).map(|end| end.to_string());
    text += &list("int unit_columns[UNIT_STATES + 1]", ends);
    text += &list("int unit_rows[AT_LEAST_ONE(UNIT_NONZEROS)]", columns.iter().flatten().map(ToString::to_string));
    text += &elimination(model);
    match description.standard() {
        Standard::Fmi2 => text,
        Standard::Fmi3 => text + &Tables::of(unit).write(unit),
    }
}

/// The pattern of the elimination, if it is worth it: the order of rows and columns, the places in each row that fill
/// in off the diagonal, the begin of each row's places, and the begin of those right of the diagonal.
fn elimination(model: &Model) -> String {
    let Some(pattern) = model.sparsity().pattern() else { return String::new() };
    let (mut begin, mut right_begin, mut filled) = (vec![0], Vec::new(), Vec::<u32>::new());
    for (left, right) in pattern.rows() {
        filled.extend(left);
        right_begin.push(filled.len());
        filled.extend(right);
        begin.push(filled.len());
    }
    let order = list("int unit_order[UNIT_STATES]", pattern.order().iter().map(ToString::to_string));
    let begin = list("int unit_filled_rows[UNIT_STATES + 1]", begin.iter().map(ToString::to_string));
    let right = list("int unit_filled_right[UNIT_STATES]", right_begin.iter().map(ToString::to_string));
    let filled = list("int unit_filled[AT_LEAST_ONE(UNIT_FILLED)]", filled.iter().map(ToString::to_string));
    [order, begin, right, filled].concat()
}

/// A constant array. One without elements has a zero in C, in all members.
pub fn list(declaration: &str, entries: impl Iterator<Item = String>) -> String {
    let entries: Vec<String> = entries.collect();
    let mut text = format!("static const {declaration} = {{");
    for (k, entry) in entries.iter().enumerate() {
        let _ = write!(text, "{}{entry},", if k % IN_A_LINE == 0 { "\n    " } else { " " });
    }
    if entries.is_empty() {
        let nothing = match declaration.split_once(' ') {
            Some(("Output" | "Array" | "Dependent", _)) => "{ 0 }",
            _ => "0",
        };
        let _ = write!(text, "\n    {nothing}");
    }
    text + "\n};\n\n"
}

/// The runtime's name for the use of a value.
fn access(access: Access) -> &'static str {
    match access {
        Access::Hidden => "ACCESS_HIDDEN",
        Access::Designed => "ACCESS_DESIGNED",
        Access::Fixed => "ACCESS_FIXED",
        Access::Tunable => "ACCESS_TUNABLE",
        Access::Input => "ACCESS_INPUT",
        Access::Calculated { output: false } => "ACCESS_LOCAL",
        Access::Calculated { output: true } => "ACCESS_OUTPUT",
    }
}

/// Limits as the runtime has them: which there are, and the numbers.
fn limits(min: Option<f64>, above_min: bool, max: Option<f64>) -> String {
    let which =
        [(min.is_some(), "LIMIT_MIN"), (min.is_some() && above_min, "LIMIT_ABOVE_MIN"), (max.is_some(), "LIMIT_MAX")];
    let which: Vec<&str> = which.into_iter().filter(|(is, _)| *is).map(|(_, name)| name).collect();
    let which = if which.is_empty() { "0".to_owned() } else { which.join(" | ") };
    format!("{which}, {}, {}", number(min.unwrap_or(0.0)), number(max.unwrap_or(0.0)))
}

fn real_variables(unit: &Unit) -> String {
    let variables = unit.model.variables();
    let references = References::new(variables);
    let hidden = "{ NULL, ACCESS_HIDDEN, 0, R(0.0), R(0.0) }".to_owned();
    let mut rows = vec![hidden; unit.start.reals.len()];
    for element in variables.visible().filter(|element| element.variable.is_real()) {
        let place = variables.index(element);
        let found = references.find(References::of(variables, element), Type::Real);
        let (Ok((_, can)), Data::Real { min, above_min, max, .. }) = (found, &element.variable.data) else { continue };
        let can = access(can);
        rows[place] = format!("{{ {}, {can}, {} }}", quoted(&element.name()), limits(*min, *above_min, *max));
    }
    if unit.model.description().standard() == Standard::Fmi3 {
        let can = access(Access::Calculated { output: false });
        rows[unit.model.time_place()] = format!("{{ \"time\", {can}, {} }}", limits(None, false, None));
    }
    table("RealVariable unit_real_variables[UNIT_REALS]", rows)
}

fn integer_variables(unit: &Unit) -> String {
    let variables = unit.model.variables();
    let references = References::new(variables);
    let ranges = unit.model.integer_ranges();
    let range = |(least, most): (i32, i32)| {
        if (least, most) == (i32::MIN, i32::MAX) { "0, 0, 0".to_owned() } else { format!("1, {least}, {most}") }
    };
    let hidden = |limits: &(i32, i32)| format!("{{ NULL, ACCESS_HIDDEN, TYPE_INTEGER, {}, NULL }}", range(*limits));
    let mut rows: Vec<String> = ranges.iter().map(hidden).collect();
    for element in variables.visible().filter(|element| !element.variable.is_real()) {
        let place = variables.index(element);
        let reference = References::of(variables, element);
        let is = if matches!(element.variable.data, Data::Boolean { .. }) { Type::Boolean } else { Type::Integer };
        let Ok((_, can)) = references.find(reference, is) else { continue };
        let can = access(can);
        let kind = if is == Type::Boolean { "TYPE_BOOLEAN" } else { "TYPE_INTEGER" };
        let items = match &element.variable.data {
            Data::Choice { items, .. } => {
                let named = items.iter().enumerate().map(|(k, (name, _))| format!("{} {name}", k + 1));
                quoted(&named.collect::<Vec<_>>().join(", "))
            }
            _ => "NULL".to_owned(),
        };
        let limits = range(ranges[place]);
        rows[place] = format!("{{ {}, {can}, {kind}, {limits}, {items} }}", quoted(&element.name()));
    }
    if rows.is_empty() {
        rows.push("{ NULL, ACCESS_HIDDEN, TYPE_INTEGER, 0, 0, 0, NULL }".to_owned());
    }
    table("IntegerVariable unit_integer_variables[AT_LEAST_ONE(UNIT_INTEGERS)]", rows)
}

/// A table, with the place before each row.
fn table(declaration: &str, rows: Vec<String>) -> String {
    let mut text = format!("static const {declaration} = {{\n");
    for (place, row) in rows.iter().enumerate() {
        let _ = writeln!(text, "    /* {place} */ {row},");
    }
    text + "};\n\n"
}
