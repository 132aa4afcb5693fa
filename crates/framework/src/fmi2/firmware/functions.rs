//! C functions of recordings: what they read, straight lines, and what they write.

use std::collections::{BTreeMap, HashMap};

use super::common;
use super::lanes::{self, Known, Rolled};
use super::law::{ENABLED, LIMITS, Law, leaves};
use super::members::{Members, ascii};
use super::repeated::{Run, runs};
use super::targets;
use crate::fmi2::source::expression::{Expression, Kind, number};
use crate::fmi2::source::function::{Function, framed};
use crate::fmi2::source::names::Names;
use crate::recording::{Leaf, Node, Operation, Recording};
use crate::system::{Data, Element, Section, Variable, Variables};

/// Names of parameters of functions.
pub(super) const PARAMETERS: [&str; 11] = ["self", "x", "d", "in", "y", "p", "r", "c", "dx", common::VALUES, "bool"];

/// The structs of a law.
#[derive(Debug)]
pub(super) struct Structs {
    pub inputs: Members,
    pub outputs: Members,
    pub manual: Members,
    pub parameters: Members,
    pub prepared: Members,
    pub states: Members,
    pub discrete: Members,
    pub signals: Members,
}

/// A computed value: its place in C, its node and type.
pub(super) struct Written {
    pub to: String,
    pub node: Node,
    pub kind: Kind,
    /// The name of its variable, and the source of its equation.
    pub name: Option<String>,
    pub source: &'static str,
}

/// A function: a comment, its declaration, its parameters' names, and where parameters are.
pub(super) struct Head<'a> {
    pub what: &'a str,
    pub declaration: String,
    pub parameters: &'a str,
    /// Values that are written, too, where a pointer to their struct is given: its name.
    pub asked: Option<(&'a str, &'a [Written])>,
}

impl Structs {
    pub fn of(law: &Law, name: &str) -> Self {
        let variables = law.variables();
        let kind = |what: &str| format!("{name}_{what}");
        let live = |sections: &[Section]| -> Vec<Element> {
            let is_one = |v: &&Variable| sections.contains(&v.section);
            let elements = variables.iter().filter(is_one).flat_map(|v| v.elements());
            let is_live = |e: &Element| {
                let place = variables.index(*e);
                if e.variable.is_real() {
                    law.live.reals[place] && !law.counts_samples(place)
                } else {
                    law.live.integers[place]
                }
            };
            elements.filter(is_live).collect()
        };
        let manual: Vec<Element> =
            variables.visible().filter(|u| law.is_manual(u.variable) && u.variable.name != ENABLED).collect();
        let prepared: Vec<Element> =
            law.prepared().iter().filter_map(|(place, _)| element(variables, *place)).collect();
        let of = |what: &str, text, elements: &[Element]| Members::of(kind(what), text, elements, variables);
        Structs {
            inputs: of("inputs", "What a step reads, at its begin.", &law.inputs()),
            outputs: of("outputs", "What a step gives: valid when it returns, to be applied then.", &law.outputs()),
            manual: of("manual", "The manual control.", &manual),
            parameters: of("parameters", "Parameters that can change at run time.", &law.parameters()),
            prepared: of("prepared", "What follows from these.", &prepared),
            states: of("states", "Continuous states.", &live(&[Section::State])),
            discrete: of(
                "discrete",
                "Discrete values: they change from step to step only.",
                &live(&[Section::Discrete, Section::Memory]),
            ),
            signals: of("signals", "Signals.", &live(&[Section::Connected, Section::Signal, Section::Derivative])),
        }
    }
}

/// The C expression of a value of the block.
pub(super) fn access(structs: &Structs, place: usize, is_real: bool, parameters: &str) -> Option<String> {
    let within =
        |members: &Members, before: &str| members.access(place, is_real).map(|access| format!("{before}{access}"));
    let (p, r) = if parameters.is_empty() { ("self->p.", "self->r.") } else { ("p->", "r->") };
    within(&structs.parameters, p)
        .or_else(|| within(&structs.prepared, r))
        .or_else(|| within(&structs.inputs, "in->"))
        .or_else(|| within(&structs.manual, "self->manual."))
        .or_else(|| within(&structs.states, "x->"))
        .or_else(|| within(&structs.discrete, "d->"))
        .or_else(|| within(&structs.signals, "y->"))
}

/// The C expressions of the limits of an element of the control, where it has any.
pub(super) fn limits_of_control(law: &Law, structs: &Structs, k: usize) -> [Option<String>; 2] {
    let variables = law.variables();
    LIMITS.map(|which| {
        let place = variables.iter().find(|v| v.name == which && k < v.len()).map(|v| variables.index(v.element(k)))?;
        access(structs, place, true, "").or_else(|| law.constant(place).map(number))
    })
}

/// A function that computes what is written, and answers whether it refuses where there are refusals.
pub(super) fn function(
    law: &Law,
    structs: &Structs,
    head: &Head,
    recording: &Recording,
    written: &[Written],
    refusals: &[(Node, String)],
) -> String {
    let mut names = Names::other_than(&PARAMETERS);
    let mut function = Function::new(&mut names, "bool");
    let conditions = refusals.iter().map(|(node, _)| *node);
    let (asked, others) = head.asked.unwrap_or_default();
    let all = written.iter().chain(others);
    let wanted: Vec<Node> = all.clone().map(|one| one.node).chain(conditions).collect();
    let given = read(law, structs, head, recording, &wanted, &mut function);
    let of_step = law.constants.iter();
    let constants: Vec<Expression> =
        of_step.map(|one| function.named(&one.name, one.kind, &format!("c->{}", one.name), "")).collect();
    let variables = named(law, recording, all.clone());
    let of = |operation: &Operation| match operation {
        Operation::Leaf(leaf) => given[leaf].clone(),
        Operation::Carried(number) => constants[*number as usize].clone(),
        _ => Expression::number(f64::NAN),
    };
    let rolled = rolled(law, structs, head.parameters, recording, (&wanted, &all.clone().collect::<Vec<_>>()));
    let places = rolled.moved.clone();
    let moved = |node: Node| places[node.index()];
    let names_of: HashMap<Node, &String> =
        variables.iter().filter_map(|(node, name)| Some((moved(*node)?, name))).collect();
    let name = |node: Node| names_of.get(&node).map(|name| (*name).clone());
    let nodes: Vec<_> = wanted.iter().filter_map(|&node| Some((moved(node)?, None))).collect();
    // Where a step is refused, nothing is written.
    let (operations, loops, targets) = match refusals {
        [] => targets::of(rolled, &wanted, written),
        _ => (rolled.operations, rolled.loops, BTreeMap::new()),
    };
    let whole = written.iter().filter(|one| one.kind == Kind::Whole).filter_map(|one| moved(one.node));
    function.whole = targets::whole(&operations, whole, nodes.iter().map(|wanted| wanted.0));
    (function.loops, function.targets) = (loops, targets);
    let found = function.compute(&operations, &nodes, &name, &of);
    refuse(&mut function, &found[all.clone().count()..], refusals);
    for (k, (one, found)) in all.zip(&found).enumerate() {
        if k == written.len() {
            function.begin(&format!("if ({asked} != NULL) {{"));
        }
        if found.text == one.to {
            continue;
        }
        let value = match one.kind {
            Kind::Real => found.real(),
            // Whole numbers without a name are conditions.
            Kind::Whole if one.name.is_none() => found.condition(),
            Kind::Whole => found.whole(),
        };
        function.line(&format!("{} = {};", one.to, value.text));
        if !one.source.is_empty() {
            function.comment(&ascii(one.source));
        }
    }
    if !others.is_empty() {
        function.end("}");
    }
    if head.declaration.starts_with("static int") {
        function.line("return 0;");
    }
    framed((head.what, &head.declaration), &function.lines())
}

/// Lines that end a function with the number of the first refusal whose condition holds.
fn refuse(function: &mut Function, conditions: &[Expression], refusals: &[(Node, String)]) {
    let conditions: Vec<String> = conditions.iter().map(|one| function.tested(one)).collect();
    let mut number = 1;
    for Run { text, elements } in runs(&conditions) {
        let (first, end) = elements.unwrap_or((0, 1));
        for (_, reason) in &refusals[number - 1..number - 1 + end - first] {
            function.whole_line(&format!("/* {} */", ascii(reason)));
        }
        let back = match elements {
            Some((0, _)) => format!("{number} + i"),
            Some((first, _)) => format!("{number} + i - {first}"),
            None => number.to_string(),
        };
        if elements.is_some() {
            function.begin(&format!("for (int i = {first}; i < {end}; i++) {{"));
        }
        function.begin(&format!("if ({text}) {{"));
        function.whole_line(&format!("return {back};"));
        function.end("}");
        if elements.is_some() {
            function.end("}");
        }
        number += end - first;
    }
}

/// Operations of a recording with loops.
pub(super) fn rolled(
    law: &Law,
    structs: &Structs,
    parameters: &str,
    recording: &Recording,
    (wanted, written): (&[Node], &[&Written]),
) -> Rolled {
    let element = |operation: &Operation| match operation {
        Operation::Leaf(Leaf::Real(place)) if law.constant(*place as usize).is_none() => {
            Some((access(structs, *place as usize, true, parameters)?, Kind::Real))
        }
        Operation::Carried(number) => {
            let constant = &law.constants[*number as usize];
            Some((format!("c->{}", constant.name), constant.kind))
        }
        _ => None,
    };
    let number = |operation: &Operation| match operation {
        Operation::Constant(bits) => Some(f64::from_bits(*bits)),
        Operation::Leaf(Leaf::Real(place)) => law.constant(*place as usize),
        _ => None,
    };
    let least = |operation: &Operation| match operation {
        Operation::Leaf(Leaf::Real(place)) => match self::element(law.variables(), *place as usize)?.variable {
            Variable { section: Section::Parameter, data: Data::Real { min, .. }, .. } => *min,
            _ => None,
        },
        _ => None,
    };
    let least = |operation: &Operation| number(operation).or_else(|| least(operation));
    let is_repeated = std::ptr::eq(recording, &law.recorded.rates);
    let known = Known { number: &number, element: &element, is_repeated, least: &least };
    let mut rolled = lanes::rolled(recording.tape.operations(), wanted, written, &known);
    if let Some(common) = &law.common {
        common.calls(
            &rolled.operations,
            if structs.inputs.is_empty() { "self" } else { "self, in" },
            &mut rolled.loops,
        );
    }
    rolled
}

/// The names of nodes that are variables: of those that are written, and of signals that aren't.
fn named<'a>(law: &Law, recording: &Recording, written: impl Iterator<Item = &'a Written>) -> HashMap<Node, String> {
    let variables = law.variables();
    let mut names = HashMap::new();
    if [&law.recorded.signals, &law.recorded.constants, &law.recorded.rates]
        .into_iter()
        .any(|one| std::ptr::eq(recording, one))
    {
        let signals = variables.reals(Section::Signal);
        names.extend(signals.map(|place| (recording.reals[place], law.real_names[place].clone())));
    }
    let own = written.filter_map(|one| Some((one.node, one.name.clone()?)));
    names.extend(own);
    names
}

/// Reads the leaves of the wanted nodes into names.
fn read(
    law: &Law,
    structs: &Structs,
    head: &Head,
    recording: &Recording,
    wanted: &[Node],
    function: &mut Function,
) -> HashMap<Leaf, Expression> {
    let variables = law.variables();
    let mut given = HashMap::new();
    for leaf in leaves(recording, wanted) {
        let expression = match leaf {
            Leaf::Time => Expression::atom("t", Kind::Real),
            Leaf::Step => Expression::number(law.period),
            Leaf::Real(place) => {
                let place = place as usize;
                let name = &law.real_names[place];
                match (law.constant(place), access(structs, place, true, head.parameters)) {
                    (Some(value), _) => {
                        let unit = element(variables, place).map(|e| e.unit()).filter(|unit| *unit != "1");
                        function.named_number(name, value, &ascii(unit.unwrap_or_default()))
                    }
                    _ if law.counts_samples(place) => function.named(name, Kind::Real, "(real)d->samples_taken", ""),
                    (None, Some(access)) => function.named(name, Kind::Real, &access, ""),
                    (None, None) => Expression::number(law.start.reals[place]),
                }
            }
            Leaf::Integer(place) => {
                let place = place as usize;
                let name = &law.integer_names[place];
                match access(structs, place, false, head.parameters) {
                    Some(access) => function.named(name, Kind::Whole, &access, ""),
                    None if name == ENABLED => function.named(name, Kind::Whole, "self->enabled", ""),
                    None => Expression::number(f64::from(law.start.integers[place])),
                }
            }
            _ => Expression::number(f64::NAN),
        };
        given.insert(leaf, expression);
    }
    given
}

/// The element that a real value of the block is.
fn element(variables: &Variables, place: usize) -> Option<Element<'_>> {
    let is_it = |v: &&Variable| {
        let first = variables.index(v.element(0));
        v.is_real() && (first..first + v.len()).contains(&place)
    };
    let variable = variables.iter().find(is_it)?;
    Some(variable.element(place - variables.index(variable.element(0))))
}
