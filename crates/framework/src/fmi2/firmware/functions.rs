//! C functions of recordings: what they read, straight lines, and what they write.

use std::collections::HashMap;
use std::fmt::Write;

use super::law::{ENABLED, Law, leaves};
use super::members::{Members, ascii};
use crate::fmi2::source::expression::{Expression, Kind, number};
use crate::fmi2::source::function::Function;
use crate::fmi2::source::names::Names;
use crate::recording::{Leaf, Node, Recording};
use crate::system::{Element, Section, Variables};

/// Names of parameters of functions.
const PARAMETERS: [&str; 9] = ["self", "x", "d", "in", "y", "p", "r", "dx", "bool"];

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

/// Where a computed value goes.
pub(super) struct Written {
    pub to: String,
    pub node: Node,
    pub kind: Kind,
    /// Its variable's name, and where its equation is from.
    pub name: Option<String>,
    pub source: &'static str,
}

/// A function: a comment, its declaration, its parameters' names, and where parameters are.
pub(super) struct Head<'a> {
    pub what: &'a str,
    pub declaration: String,
    pub parameters: &'a str,
}

impl Structs {
    pub fn of(law: &Law, name: &str) -> Self {
        let variables = law.variables();
        let kind = |what: &str| format!("{name}_{what}");
        let live = |sections: &[Section]| -> Vec<Element> {
            let is_one = |v: &&crate::system::Variable| sections.contains(&v.section);
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
            law.prepared().iter().filter_map(|(place, _)| element_at(variables, Section::Prepared, *place)).collect();
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

/// The element that lies at a place of the block.
fn element_at(variables: &Variables, section: Section, place: usize) -> Option<Element<'_>> {
    variables.real_at(section, place - variables.reals(section).start)
}

/// How a value of the block is reached in C.
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

/// A function that computes what is written, and answers whether it refuses where there are refusals.
pub(super) fn function(
    law: &Law,
    structs: &Structs,
    head: &Head,
    recording: &Recording,
    written: &[Written],
    refusals: &[(Node, String)],
) -> String {
    let mut names = Names::beside(&PARAMETERS);
    let mut function = Function::new(&mut names);
    let conditions = refusals.iter().map(|(node, _)| *node);
    let wanted: Vec<Node> = written.iter().map(|one| one.node).chain(conditions).collect();
    let given = read(law, structs, head, recording, &wanted, &mut function);
    let variables = named(law, recording, written);
    let name = |node: Node| variables.get(&node).cloned();
    let all: Vec<_> = wanted.iter().map(|&node| (node, None)).collect();
    let found = function.compute(&recording.tape, &all, name, &|leaf| given[&leaf].clone());
    for (k, (one, (_, reason))) in found[written.len()..].iter().zip(refusals).enumerate() {
        function.whole_line(&format!("/* {} */", ascii(reason)));
        function.line(&format!("if ({}) {{", one.condition().text));
        function.whole_line(&format!("    return {};", k + 1));
        function.line("}");
    }
    for (one, found) in written.iter().zip(&found) {
        let value = if one.kind == Kind::Real { found.real() } else { found.whole() };
        function.line(&format!("{} = {};", one.to, value.text));
        if !one.source.is_empty() {
            function.comment(&ascii(one.source));
        }
    }
    if head.declaration.starts_with("static int") {
        function.line("return 0;");
    }
    framed(head, &function.lines())
}

/// The names of nodes that are variables: of those that are written, and of signals that aren't.
fn named(law: &Law, recording: &Recording, written: &[Written]) -> HashMap<Node, String> {
    let variables = law.variables();
    let mut names = HashMap::new();
    if std::ptr::eq(recording, &law.recorded.evaluate) {
        for variable in variables.iter().filter(|v| v.section == Section::Signal && v.is_real()) {
            for element in variable.elements() {
                let node = recording.reals[variables.index(element)];
                names.insert(node, element.name().trim_start_matches('#').to_owned());
            }
        }
    }
    let own = written.iter().filter_map(|one| Some((one.node, one.name.clone()?)));
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
                let name = real_name(variables, place);
                let unit = unit(variables, place);
                match (law.constant(place), access(structs, place, true, head.parameters)) {
                    (Some(value), _) => function.named_number(&name, value, &ascii(&unit)),
                    _ if law.counts_samples(place) => function.named(&name, Kind::Real, "(real)d->samples", ""),
                    (None, Some(access)) => function.named(&name, Kind::Real, &access, ""),
                    (None, None) => Expression::number(law.start.reals[place]),
                }
            }
            Leaf::Integer(place) => {
                let place = place as usize;
                let name = integer_name(variables, place);
                match access(structs, place, false, head.parameters) {
                    Some(access) => function.named(&name, Kind::Whole, &access, ""),
                    None if name == ENABLED => function.named(&name, Kind::Whole, "self->enabled", ""),
                    None => Expression::number(f64::from(law.start.integers[place])),
                }
            }
            _ => Expression::number(f64::NAN),
        };
        given.insert(leaf, expression);
    }
    given
}

/// The name of a real value of the block.
pub(super) fn real_name(variables: &Variables, place: usize) -> String {
    let is_it = |e: &Element| e.variable.is_real() && variables.index(*e) == place;
    let found = variables.iter().flat_map(|v| v.elements()).find(is_it);
    found.map_or_else(|| format!("value[{place}]"), |e| e.name().trim_start_matches('#').to_owned())
}

/// That of an integer.
pub(super) fn integer_name(variables: &Variables, place: usize) -> String {
    let is_it = |e: &Element| !e.variable.is_real() && variables.index(*e) == place;
    let found = variables.iter().flat_map(|v| v.elements()).find(is_it);
    found.map_or_else(|| format!("value[{place}]"), |e| e.name().trim_start_matches('#').to_owned())
}

fn unit(variables: &Variables, place: usize) -> String {
    let is_it = |e: &Element| e.variable.is_real() && variables.index(*e) == place;
    let found = variables.iter().flat_map(|v| v.elements()).find(is_it);
    found.map(|e| e.unit()).filter(|unit| *unit != "1").unwrap_or_default().to_owned()
}

/// A function with its declaration; parameters that it doesn't use are marked.
fn framed(head: &Head, lines: &str) -> String {
    let parameters = head.declaration.split_once('(').map_or("", |(_, parameters)| parameters.trim_end_matches(')'));
    let names = parameters.split(", ").map(|parameter| parameter.rsplit([' ', '*']).next().unwrap_or_default());
    let code: Vec<&str> = lines.lines().map(|line| line.split("/*").next().unwrap_or_default()).collect();
    let is_used = |name: &&str| code.iter().any(|line| has_word(line, name));
    let mut text = format!("/* {} */\n{}\n{{\n", head.what, head.declaration);
    names.filter(|name| !is_used(name)).for_each(|name| _ = writeln!(text, "    (void){name};"));
    format!("{text}{lines}}}\n\n")
}

/// True if a line of C has a word that isn't a member of a struct.
fn has_word(line: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    line.match_indices(word).any(|(at, _)| {
        let (before, behind) = (&line[..at], &line[at + word.len()..]);
        !before.ends_with(|c: char| is_part(c) || c == '>' || c == '.') && !behind.starts_with(is_part)
    })
}

/// A number as C writes it.
pub(super) fn written_number(value: f64) -> String {
    number(value)
}
