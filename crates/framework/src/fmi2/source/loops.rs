//! Loops in C: iterations, and what is the same for some lanes, as the axes of a vehicle are.

use std::collections::BTreeMap;
use std::mem::take;

use super::blocks::Wanted;
use super::expression::{Expression, Kind};
use super::function::{Function, Scope};
use crate::recording::{Body, Node, Operation};

/// Numbers that a loop over lanes reads, one a lane.
#[derive(Debug, Clone, PartialEq)]
pub enum Input {
    /// One for all: the next of what is captured.
    Same,
    /// One each: the next of what is captured.
    Each,
    /// Elements of an array: its text, the element of the first lane, and those from lane to lane; their type.
    Elements((String, usize, usize), Kind),
    /// Known numbers.
    Numbers(Vec<f64>),
}

/// A loop over lanes: an iteration without a state. Its results are those of the first lane, of the second, and so on, of each that its
/// body computes.
#[derive(Debug, Clone)]
pub struct Lanes {
    /// Their number.
    pub count: usize,
    /// Numbers that the body reads, in their order.
    pub inputs: Vec<Input>,
    /// Arrays in C that results are written to, and nothing else: the element of the first lane, and those from lane to lane. Others have
    /// an array of the loop.
    pub targets: Vec<Option<(String, usize, usize)>>,
    /// The function that computes the results of a single lane, where there is one.
    pub call: Option<Call>,
}

/// A call of a function that writes numbers to an array.
#[derive(Debug, Clone)]
pub struct Call {
    /// Its name.
    pub function: String,
    /// Its arguments before the array.
    pub arguments: String,
}

impl Lanes {
    /// The place of a result in the loop's own array, without its lane.
    fn slot(&self, result: usize) -> usize {
        self.targets[..result].iter().filter(|target| target.is_none()).count() * self.count
    }
}

/// Loops by the places of their iterations.
pub type Loops = BTreeMap<usize, Lanes>;

/// The array and the number of an element.
pub fn element(text: &str) -> Option<(&str, usize)> {
    let (array, number) = text.strip_suffix(']')?.rsplit_once('[')?;
    Some((array, number.parse().ok()?))
}

/// The array that some texts are elements of, the first one's number, and the numbers from one to the next.
pub fn elements<'a>(texts: impl IntoIterator<Item = &'a str>) -> Option<(String, usize, usize)> {
    let all: Vec<(&str, usize)> = texts.into_iter().map(element).collect::<Option<_>>()?;
    let [(array, first), (_, second), ..] = all[..] else { return None };
    let step = second.checked_sub(first).filter(|step| *step > 0)?;
    let is_next = |(k, (other, number)): (usize, &(&str, usize))| *other == array && *number == first + k * step;
    all.iter().enumerate().all(is_next).then(|| (array.to_owned(), first, step))
}

/// The text of an element whose number follows from a counter.
fn counted((array, first, step): &(String, usize, usize), counter: &str) -> String {
    let times = if *step == 1 { counter.to_owned() } else { format!("{step} * {counter}") };
    if *first == 0 { format!("{array}[{times}]") } else { format!("{array}[{times} + {first}]") }
}

impl Function<'_> {
    /// True if loops may write to a place in C.
    pub(super) fn is_written_by_loops(&self, place: &str) -> bool {
        let array = element(place).map(|(array, _)| array);
        self.loops.values().flat_map(|lanes| lanes.targets.iter().flatten()).any(|(target, ..)| array == Some(target))
    }

    /// A loop over lanes; its results are in an array, whose name is the expression.
    pub(super) fn lanes(
        &mut self,
        (body, lanes): (&Body, &Lanes),
        captured: &[Node],
        place: usize,
        scope: &mut Scope,
    ) -> Expression {
        if let Some(call) = &lanes.call {
            return self.call(call, lanes.targets.len(), place, scope);
        }
        let guard = self.guard(place, scope).map_or(String::new(), |guard| format!("({}) && ", guard.text));
        let [array, counter] = ["s", "i"].map(|of| self.names.numbered(of, place));
        let mut captured = captured.iter();
        let mut inputs = Vec::new();
        for input in &lanes.inputs {
            let count = if *input == Input::Each { lanes.count } else { usize::from(*input == Input::Same) };
            let taken: Vec<Expression> = captured.by_ref().take(count).map(|&node| self.unnamed(node, scope)).collect();
            inputs.push(self.read_by_lanes(input, taken, (place, &counter)));
        }
        let start = if guard.is_empty() { "" } else { " = { R(0.0) }" };
        let own = lanes.slot(lanes.targets.len());
        if own > 0 {
            self.line(&format!("real {array}[{own}]{start};"));
        }
        self.begin(&format!("for (int {counter} = 0; {guard}{counter} < {}; ++{counter}) {{", lanes.count));
        let carried = |operation: &Operation| match operation {
            Operation::Carried(number) => inputs[*number as usize].clone(),
            _ => Expression::number(f64::NAN),
        };
        let found = self.part_of_body(body, &body.next, &|_| None, &carried);
        self.results(lanes, found, (&array, &counter), place);
        self.end("}");
        Expression::atom(array, Kind::Real)
    }

    /// A call of a function; its results are in an array, whose name is the expression.
    fn call(&mut self, call: &Call, results: usize, place: usize, scope: &mut Scope) -> Expression {
        let guard = self.guard(place, scope);
        let array = self.names.numbered("s", place);
        let start = if guard.is_some() { " = { R(0.0) }" } else { "" };
        self.line(&format!("real {array}[{results}]{start};"));
        let line = format!("{}({}, {array});", call.function, call.arguments);
        match guard {
            Some(guard) => {
                self.begin(&format!("if ({}) {{", guard.text));
                self.line(&line);
                self.end("}");
            }
            None => self.line(&line),
        }
        Expression::atom(array, Kind::Real)
    }

    /// Lines that write what a loop computes. What is written where other lines of a body read comes behind these.
    fn results(&mut self, lanes: &Lanes, found: Vec<Expression>, (array, counter): (&str, &str), place: usize) {
        let is_read = |target: &(String, usize, usize)| target.0.starts_with("x->") || target.0.starts_with("d->");
        let are_read = lanes.targets.iter().flatten().any(is_read);
        let mut lines = Vec::new();
        for (k, value) in found.into_iter().enumerate() {
            let to = lanes.targets[k].clone().unwrap_or((array.to_owned(), lanes.slot(k), 1));
            let value = if lanes.targets[k].is_none() { value.real() } else { value };
            let text = if are_read && value.size > 0 {
                let name = self.names.numbered("v", place);
                let of = if value.kind == Kind::Real { "real" } else { "int" };
                self.line(&format!("const {of} {name} = {};", value.text));
                name
            } else {
                value.text
            };
            lines.push(format!("{} = {text};", counted(&to, counter)));
        }
        lines.iter().for_each(|line| self.line(line));
    }

    /// A number, not by its name where it is a result of a loop: others have names of their own.
    fn unnamed(&self, node: Node, scope: &Scope) -> Expression {
        match scope.operations[node.index()] {
            Operation::Part(from, number) => self.part(from, number, scope),
            _ => scope.of(node).clone(),
        }
    }

    /// A result of an iteration.
    pub(super) fn part(&self, from: Node, number: u32, scope: &Scope) -> Expression {
        let (array, number) = (&scope.of(from).text, number as usize);
        let text = match self.loops.get(&from.index()) {
            Some(lanes) => match &lanes.targets[number / lanes.count] {
                Some((array, first, step)) => format!("{array}[{}]", first + number % lanes.count * step),
                None => format!("{array}[{}]", lanes.slot(number / lanes.count) + number % lanes.count),
            },
            None => format!("{array}[{number}]"),
        };
        Expression::atom(text, Kind::Real)
    }

    /// A number of each lane as the body of a loop reads it.
    fn read_by_lanes(
        &mut self,
        input: &Input,
        captured: Vec<Expression>,
        (place, counter): (usize, &str),
    ) -> Expression {
        let gathered = |function: &mut Self, of: &str, numbers: &[Expression], how: &str| {
            let kind = if numbers.iter().all(|one| one.kind == Kind::Whole) { Kind::Whole } else { Kind::Real };
            let texts = numbers.iter().map(|one| if kind == Kind::Real { one.real().text } else { one.text.clone() });
            let texts: Vec<String> = texts.collect();
            let name = function.names.numbered(of, place);
            let of = if kind == Kind::Real { "real" } else { "int" };
            function.line(&format!("{how} {of} {name}[{}] = {{ {} }};", numbers.len(), texts.join(", ")));
            Expression::atom(format!("{name}[{counter}]"), kind)
        };
        match input {
            Input::Same => captured[0].clone(),
            Input::Each => match elements(captured.iter().map(|one| one.text.as_str())) {
                Some(all) => Expression::atom(counted(&all, counter), captured[0].kind),
                None => gathered(self, "g", &captured, "const"),
            },
            Input::Elements(all, kind) => Expression::atom(counted(all, counter), *kind),
            Input::Numbers(numbers) if numbers.iter().all(|one| one.to_bits() == numbers[0].to_bits()) => {
                Expression::number(numbers[0])
            }
            Input::Numbers(numbers) => {
                let numbers: Vec<Expression> = numbers.iter().map(|&one| Expression::number(one)).collect();
                gathered(self, "n", &numbers, "static const")
            }
        }
    }

    /// A loop; its results are in an array, whose name is the expression.
    pub(super) fn iteration(
        &mut self,
        body: &Body,
        most: usize,
        (start, captured): (&[Node], &[Node]),
        place: usize,
        scope: &mut Scope,
    ) -> Expression {
        if let (true, Some(lanes)) = (start.is_empty(), self.loops.get(&place).cloned()) {
            return self.lanes((body, &lanes), captured, place, scope);
        }
        let guard = self.guard(place, scope).map_or(String::new(), |guard| format!("({}) && ", guard.text));
        let array = self.names.numbered("s", place);
        let counter = self.names.numbered("k", place);
        let start: Vec<String> = start.iter().map(|&node| scope.of(node).real().text).collect();
        let captured: Vec<Expression> = captured.iter().map(|&node| scope.of(node).clone()).collect();
        self.line(&format!("real {array}[{}] = {{ {} }};", start.len(), start.join(", ")));
        self.begin(&format!("for (int {counter} = 0; {guard}{counter} < {most}; ++{counter}) {{"));
        let carried = |operation: &Operation| match operation {
            Operation::Carried(number) if (*number as usize) < start.len() => {
                Expression::atom(format!("{array}[{number}]"), Kind::Real)
            }
            Operation::Carried(number) => captured[*number as usize - start.len()].clone(),
            _ => Expression::number(f64::NAN),
        };
        let unnamed = |_| None;
        let condition = self.part_of_body(body, &[body.goes_on], &unnamed, &carried);
        let condition = self.tested(&condition[0]);
        self.line(&format!("if (!({condition})) break;"));
        let next = self.part_of_body(body, &body.next, &unnamed, &carried);
        let next: Vec<String> = next.iter().map(|value| value.real().text).collect();
        // All of the new state follows from the old one.
        let new = self.names.numbered("next", place);
        self.line(&format!("const real {new}[{}] = {{ {} }};", next.len(), next.join(", ")));
        for k in 0..next.len() {
            self.line(&format!("{array}[{k}] = {new}[{k}];"));
        }
        self.end("}");
        Expression::atom(array, Kind::Real)
    }

    /// A part of what an iteration does: its condition, or its step.
    fn part_of_body(
        &mut self,
        body: &Body,
        wanted: &[Node],
        named: &dyn Fn(Node) -> Option<String>,
        given: &dyn Fn(&Operation) -> Expression,
    ) -> Vec<Expression> {
        let wanted: Vec<Wanted> = wanted.iter().map(|&node| (node, None)).collect();
        // Places are those of the body's operations there.
        let (loops, targets, whole) = (take(&mut self.loops), take(&mut self.targets), take(&mut self.whole));
        let found = self.compute(&body.operations, &wanted, named, given);
        (self.loops, self.targets, self.whole) = (loops, targets, whole);
        found
    }
}
