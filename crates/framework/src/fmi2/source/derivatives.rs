//! Derivatives of a unit's equations as C functions.

use super::Unit;
use super::equations::{Head, Target, function};
use super::expression::Kind;
use crate::differentiation::{self, Adjoints, Directional, LARGEST_IN_C};
use crate::model::Standard;
use crate::recording::{Method, Node};

/// All of them.
pub(super) fn write(unit: &Unit) -> String {
    let variables = unit.model.variables();
    let head = Head {
        what: "Changes of signals and rates in a direction: d holds changes of inputs and states, dt is that of time.",
        declaration: "static void unit_directional(real t, real dt, const real *v, const int *n, real *d)",
    };
    let mut text = directional(unit, &head, differentiation::directional(variables, unit.record(Method::Evaluate)));
    let head = Head {
        what: "Changes of all that follows from the start in a direction: d holds changes of inputs.",
        declaration: "static void unit_start_directional(real t, const real *v, const int *n, real *d)",
    };
    text += &directional(unit, &head, differentiation::start_directional(variables, unit.record(Method::Start)));
    text += &jacobian(unit);
    match unit.model.description().standard() {
        Standard::Fmi2 => text,
        Standard::Fmi3 => text + &adjoint(unit).unwrap_or_default(),
    }
}

const ADJOINT: Head = Head {
    what: "Adjoints: seeds d of signals and rates times their derivatives by inputs, by states and by time.",
    declaration: "static void unit_adjoint(real t, const real *v, const int *n, const real *d, real *z)",
};

/// The adjoint derivatives, where they aren't too many operations and no iteration is in them.
fn adjoint(unit: &Unit) -> Option<String> {
    let (variables, time) = (unit.model.variables(), unit.model.time_place());
    let Adjoints { tape, nodes, .. } = differentiation::adjoints(variables, time, unit.record(Method::Evaluate))?;
    if tape.needed(&nodes).into_iter().filter(|needed| *needed).count() > LARGEST_IN_C {
        return None;
    }
    let target = |(k, &node): (usize, &Node)| Target::result(format!("z[{k}] ="), node);
    let targets: Vec<Target> = nodes.iter().enumerate().map(target).collect();
    Some(format!("#define UNIT_HAS_ADJOINT\n{}", function(unit, &ADJOINT, &tape, &targets, &[])))
}

fn directional(unit: &Unit, head: &Head, Directional { mut tape, changes }: Directional) -> String {
    let zero = tape.number(0.0);
    let target = |(place, change): (usize, Option<Node>)| {
        let variable = change.map(|_| format!("d_{}", unit.real_name(place)));
        Target::of(format!("d[{place}] ="), change.unwrap_or(zero), Kind::Real, variable)
    };
    let targets: Vec<Target> = changes.into_iter().map(target).collect();
    function(unit, head, &tape, &targets, &[])
}

const JACOBIAN: Head = Head {
    what: "The Jacobian: derivatives of the rates by the states, column by column, and by time along the inputs' slopes.",
    declaration: "static void unit_jacobian(real t, const real *v, const int *n, const real *slopes, real *jacobian, \
                  real *by_time)",
};

/// ∂f/∂x by its pattern, and ∂f/∂t with inputs that move.
fn jacobian(unit: &Unit) -> String {
    if unit.model.variables().states() == 0 {
        return String::new();
    }
    written_out(unit).unwrap_or_else(|| jacobian_by_directions(unit, &JACOBIAN))
}

/// The Jacobian of a unit with states, operation by operation, where these aren't too many.
fn written_out(unit: &Unit) -> Option<String> {
    let variables = unit.model.variables();
    if variables.states() == 0 {
        return None;
    }
    let (columns, evaluate) = (unit.model.sparsity().columns(), unit.record(Method::Evaluate));
    let jacobian = differentiation::jacobian(variables, columns, evaluate, LARGEST_IN_C)?;
    let numbered = |name: &'static str, nodes: &[Node]| {
        let target = |(k, &node): (usize, &Node)| Target::result(format!("{name}[{k}] ="), node);
        nodes.iter().enumerate().map(target).collect::<Vec<_>>()
    };
    let mut targets = numbered("jacobian", &jacobian.entries);
    targets.extend(numbered("by_time", &jacobian.by_time));
    Some(function(unit, &JACOBIAN, &jacobian.tape, &targets, &[]))
}

/// The Jacobian direction by direction: several columns in each, of which no two move the same rate.
fn jacobian_by_directions(unit: &Unit, head: &Head) -> String {
    let sparsity = unit.model.sparsity();
    let mut group_of = vec![0; sparsity.columns().len()];
    for (group, columns) in sparsity.groups().iter().enumerate() {
        columns.iter().for_each(|&column| group_of[column as usize] = group);
    }
    let table = super::tables::list("int unit_group_of[UNIT_STATES]", group_of.iter().map(ToString::to_string));
    let (what, declaration, groups) = (head.what, head.declaration, sparsity.groups().len());
    let body = format!(
        "    for (int group = 0; group <= {groups}; ++group) {{
        const int of_time = group == {groups};
        real d[UNIT_REALS] = {{ R(0.0) }};
        for (int i = 0; of_time && slopes != NULL && i < UNIT_INPUTS; ++i) {{
            d[FIRST_INPUT + i] = slopes[i];
        }}
        for (int j = 0; j < UNIT_STATES; ++j) {{
            d[FIRST_STATE + j] = unit_group_of[j] == group ? R(1.0) : R(0.0);
        }}
        unit_directional(t, of_time ? R(1.0) : R(0.0), v, n, d);
        for (int j = 0; j < UNIT_STATES; ++j) {{
            for (int k = unit_columns[j]; unit_group_of[j] == group && k < unit_columns[j + 1]; ++k) {{
                jacobian[k] = d[FIRST_RATE + unit_rows[k]];
            }}
            if (of_time) {{
                by_time[j] = d[FIRST_RATE + j];
            }}
        }}
    }}
"
    );
    format!("{table}/* {what} */\n{declaration}\n{{\n{body}}}\n")
}
