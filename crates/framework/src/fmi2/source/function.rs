//! C of a recording: an operation used once is written in place, one used more often has a name, and selections are
//! branches.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::mem::{replace, take};

use super::blocks::{Block, Blocks, Placed, ROOT, Wanted, arm, placed};
use super::expression::{Binding, Expression, Kind};
use super::loops::Loops;
use super::names::Names;
use super::operation;
use super::written::Targets;
use crate::recording::{Node, Operation};

/// Expressions of more operations get a name, so that a person can follow them.
const LARGEST: usize = 12;
/// Lines are broken before this column.
const WIDTH: usize = 118;

/// Lines of C that compute some operations.
#[derive(Debug)]
pub struct Function<'a> {
    pub(super) names: &'a mut Names,
    /// Names of values from elsewhere and their lines, which come first where they are used.
    pub(super) declared: Vec<(String, String)>,
    used: BTreeSet<String>,
    pub(super) lines: String,
    pub(super) indent: usize,
    /// The type of conditions in C.
    conditions: &'static str,
    /// Loops over lanes among the operations.
    pub loops: Loops,
    /// Selections that are written to a place of their own, not to a variable.
    pub targets: Targets,
    /// Selections that nothing reads but as whole numbers.
    pub whole: BTreeSet<usize>,
}

/// Operations of a tape, or of an iteration's body, and their expressions so far.
pub(super) struct Scope<'a> {
    pub(super) operations: &'a [Operation],
    /// Number of uses of each, and their blocks.
    uses: Vec<u32>,
    blocks: Blocks,
    /// Blocks that are being written, from the function itself inwards, and the lines of those that wait.
    pub(super) open: Vec<Open>,
    /// Index of the block that the function's lines belong to.
    pub(super) current: usize,
    pub(super) found: Vec<Option<Expression>>,
    /// True for operations that are being computed.
    is_open: Vec<bool>,
    pub(super) named: &'a dyn Fn(Node) -> Option<String>,
    given: &'a dyn Fn(&Operation) -> Expression,
}

/// A block that is being written.
pub(super) struct Open {
    block: Block,
    lines: String,
    indent: usize,
}

impl Scope<'_> {
    pub(super) fn of(&self, node: Node) -> &Expression {
        self.found[node.index()].as_ref().expect("operands are computed before what they are operands of")
    }
}

impl<'a> Function<'a> {
    /// Empty lines, where conditions have this type.
    pub fn new(names: &'a mut Names, conditions: &'static str) -> Self {
        Function {
            names,
            declared: Vec::new(),
            used: BTreeSet::new(),
            lines: String::new(),
            indent: 1,
            conditions,
            loops: Loops::new(),
            targets: BTreeMap::new(),
            whole: BTreeSet::new(),
        }
    }

    /// The lines.
    pub fn lines(self) -> String {
        // What is read where it is written needs no name.
        let is_named = |name: &String| self.used.contains(name) && has_word(&self.lines, name);
        let used = self.declared.iter().filter(|(name, _)| is_named(name)).cloned().collect::<Vec<_>>().into_iter();
        used.map(|(_, line)| line).chain([self.lines]).collect()
    }

    /// Adds a line as it is.
    pub fn whole_line(&mut self, text: &str) {
        let _ = writeln!(self.lines, "{}{text}", "    ".repeat(self.indent));
    }

    /// Adds a line with which a block begins, and one with which it ends.
    pub fn begin(&mut self, text: &str) {
        self.line(text);
        self.indent += 1;
    }

    /// See [`Function::begin`].
    pub fn end(&mut self, text: &str) {
        self.indent -= 1;
        self.line(text);
    }

    /// Adds a line, broken where it is too long.
    pub fn line(&mut self, text: &str) {
        let indent = "    ".repeat(self.indent);
        let mut column = indent.len();
        self.lines.push_str(&indent);
        for (k, word) in text.split(' ').enumerate() {
            if k > 0 && column + 1 + word.len() > WIDTH {
                let _ = write!(self.lines, "\n{indent}    ");
                column = indent.len() + 4;
            } else if k > 0 {
                self.lines.push(' ');
                column += 1;
            }
            self.lines.push_str(word);
            column += word.len();
        }
        self.lines.push('\n');
    }

    /// Adds a comment behind the last line.
    pub fn comment(&mut self, text: &str) {
        self.lines.truncate(self.lines.trim_end().len());
        let _ = writeln!(self.lines, " /* {text} */");
    }

    /// Computes nodes of a tape or of an iteration's body from leaves and carried numbers, which are given; the expressions that they
    /// are. Those that are to have a name are given it.
    pub fn compute(
        &mut self,
        operations: &[Operation],
        wanted: &[Wanted],
        named: &dyn Fn(Node) -> Option<String>,
        given: &dyn Fn(&Operation) -> Expression,
    ) -> Vec<Expression> {
        let Placed { operations, uses, blocks } = placed(operations, wanted);
        let mut scope = Scope {
            operations: &operations,
            uses,
            blocks,
            open: vec![Open { block: ROOT, lines: String::new(), indent: self.indent }],
            current: 0,
            found: vec![None; operations.len()],
            is_open: vec![false; operations.len()],
            named,
            given,
        };
        for place in scope.blocks.places(ROOT) {
            self.computed(place, &mut scope);
        }
        wanted.iter().map(|wanted| scope.of(wanted.0).clone()).collect()
    }

    /// Computes an operation after its operands, in its block, unless that is done or under way. Returns true if it is
    /// done.
    fn computed(&mut self, place: usize, scope: &mut Scope) -> bool {
        if scope.found[place].is_some() || scope.is_open[place] {
            return scope.found[place].is_some();
        }
        let block = scope.blocks.block(place);
        let Some(number) = scope.open.iter().position(|open| open.block == block) else { return false };
        let outer = self.go_to(number, scope);
        scope.is_open[place] = true;
        let done = self.computed_here(place, scope);
        scope.is_open[place] = false;
        self.go_to(outer, scope);
        done
    }

    fn computed_here(&mut self, place: usize, scope: &mut Scope) -> bool {
        let operation = &scope.operations[place];
        if let (Operation::Select(_, yes, no), Some(holds)) = (operation, scope.blocks.decided(place)) {
            let taken = if holds { yes } else { no };
            if !self.computed(taken.index(), scope) {
                return false;
            }
            scope.found[place] = Some(self.named_or_inline(place, scope.of(*taken).clone(), scope));
            return true;
        }
        if let Operation::Select(condition, ..) = operation
            && scope.blocks.has_arms(place)
        {
            return self.computed(condition.index(), scope) && self.group(place, scope);
        }
        if !operation.operands().all(|operand| self.computed(operand.index(), scope)) {
            return false;
        }
        let found = match operation {
            Operation::Leaf(_) | Operation::Carried(_) => {
                let given = (scope.given)(operation);
                self.used.insert(given.text.clone());
                given
            }
            Operation::Iterate { body, most, start, captured } => {
                self.iteration(body, *most, (start, captured), place, scope)
            }
            Operation::Select(condition, yes, no) => {
                let of = |node: &Node| scope.of(*node);
                let found = self.selection(place, of(condition), of(yes), of(no));
                self.named_or_inline(place, found, scope)
            }
            Operation::Part(from, number) if self.loops.contains_key(&from.index()) => self.part(*from, *number, scope),
            Operation::Part(from, number) => self.named_or_inline(place, self.part(*from, *number, scope), scope),
            _ => self.named_or_inline(place, operation::expression(operation, scope), scope),
        };
        scope.found[place] = Some(found);
        true
    }

    /// Goes on in another block that is being written; the number of the one before.
    fn go_to(&mut self, number: usize, scope: &mut Scope) -> usize {
        let before = replace(&mut scope.current, number);
        scope.open[before].lines = take(&mut self.lines);
        self.lines = take(&mut scope.open[number].lines);
        self.indent = scope.open[number].indent;
        before
    }

    /// Computes a selection with all that share its arms. Returns true if that is done.
    fn group(&mut self, place: usize, scope: &mut Scope) -> bool {
        let (group, last) = (scope.blocks.group(place), scope.blocks.shared(place));
        group.iter().for_each(|&member| scope.is_open[member] = true);
        let arms = [true, false].map(|holds| {
            let value = |&member: &usize| match scope.operations[member] {
                Operation::Select(_, yes, no) => {
                    if holds {
                        yes
                    } else {
                        no
                    }
                }
                _ => unreachable!("it is a selection"),
            };
            let values: Vec<_> = group.iter().map(value).collect();
            self.arm(arm(last, holds), &values, scope)
        });
        group.iter().for_each(|&member| scope.is_open[member] = member == place);
        let [Some(taken), Some(other)] = arms else { return false };
        self.selected(&group, taken, other, scope);
        true
    }

    /// Lines of an arm that aren't needed outside of it, and its values.
    fn arm(&mut self, block: Block, values: &[Node], scope: &mut Scope) -> Option<(String, Vec<Expression>)> {
        scope.open.push(Open { block, lines: String::new(), indent: self.indent + 1 });
        let outer = self.go_to(scope.open.len() - 1, scope);
        for place in scope.blocks.places(block) {
            self.computed(place, scope);
        }
        let is_done = values.iter().all(|value| self.computed(value.index(), scope));
        self.go_to(outer, scope);
        let lines = scope.open.pop().expect("it was opened here").lines;
        is_done.then(|| (lines, values.iter().map(|value| scope.of(*value).clone()).collect()))
    }

    /// Results of selections: expressions or, if an arm has lines of its own, names that both arms give values.
    fn selected(
        &mut self,
        group: &[usize],
        taken: (String, Vec<Expression>),
        other: (String, Vec<Expression>),
        scope: &mut Scope,
    ) {
        let Operation::Select(condition, ..) = scope.operations[group[0]] else { unreachable!("it is a selection") };
        let condition = scope.of(condition).condition();
        let both = group.iter().zip(taken.1.iter().zip(&other.1));
        let selections: Vec<_> = both.map(|(&place, (yes, no))| self.selection(place, &condition, yes, no)).collect();
        if taken.0.is_empty() && other.0.is_empty() {
            for (&place, selection) in group.iter().zip(selections) {
                scope.found[place] = Some(self.named_or_inline(place, selection, scope));
            }
            return;
        }
        let mut names = Vec::new();
        for (&place, selection) in group.iter().zip(&selections) {
            if let (Some(target), Kind::Real) = (self.target(place, scope), selection.kind) {
                names.push((target, Kind::Real));
                continue;
            }
            let (name, of) = self.new_name(place, (scope.named)(Node::at(place)), selection.kind, scope);
            self.line(&format!("{of} {name};"));
            names.push((name, selection.kind));
        }
        let arms = [taken, other].map(|(lines, values)| lines + &self.given(&names, &values));
        let condition = self.tested(&condition);
        self.line(&format!("if ({condition}) {{"));
        self.lines.push_str(&arms[0]);
        if !arms[1].is_empty() {
            self.line("} else {");
            self.lines.push_str(&arms[1]);
        }
        self.line("}");
        for (&place, (name, kind)) in group.iter().zip(names) {
            scope.found[place] = Some(Expression::atom(name, kind));
        }
    }

    /// Text of the condition of an `if`: a whole number with a name is compared, as MISRA C:2012 14.4 asks.
    pub fn tested(&self, expression: &Expression) -> String {
        let condition = expression.condition();
        let is_number = condition.binding == Binding::Atom && self.conditions == "int";
        if is_number { format!("{} != 0", condition.text) } else { condition.text }
    }

    /// One of two, as a whole number where it is wanted so.
    fn selection(&self, place: usize, condition: &Expression, yes: &Expression, no: &Expression) -> Expression {
        let whole = self.whole.contains(&place).then(|| Expression::whole_selection(condition, yes, no)).flatten();
        whole.unwrap_or_else(|| Expression::select(condition, yes, no))
    }

    /// An expression as it is, or by the name that it gets.
    fn named_or_inline(&mut self, place: usize, found: Expression, scope: &mut Scope) -> Expression {
        let own = (scope.named)(Node::at(place));
        let is_short = scope.uses[place] <= 1 && found.size <= LARGEST;
        if found.known.is_some() || own.is_none() && (found.size == 0 || is_short) {
            return found;
        }
        self.by_name(place, own, found, scope)
    }

    /// A line that computes an expression; the name that it gets. What isn't defined for every number is computed where it is
    /// needed only.
    fn by_name(&mut self, place: usize, own: Option<String>, found: Expression, scope: &mut Scope) -> Expression {
        let guard = if found.is_partial { self.guard(place, scope) } else { None };
        let found = guard.map_or(found.clone(), |guard| Expression::select(&guard, &found, &Expression::number(0.0)));
        let (name, of) = self.new_name(place, own, found.kind, scope);
        self.line(&format!("const {of} {name} = {};", found.text));
        Expression::atom(name, found.kind)
    }

    /// A name for an operation, and its type in C.
    fn new_name(&mut self, place: usize, own: Option<String>, kind: Kind, scope: &Scope) -> (String, &'static str) {
        let name = match own {
            Some(variable) => self.names.of(&variable),
            None => self.names.numbered(if kind == Kind::Real { "a" } else { "c" }, place),
        };
        let is_condition = matches!(
            scope.operations[place],
            Operation::Compare(..) | Operation::Not(_) | Operation::And(..) | Operation::Or(..)
        );
        let of = match kind {
            Kind::Real => "real",
            Kind::Whole if is_condition => self.conditions,
            Kind::Whole => "int",
        };
        (name, of)
    }

    /// Condition under which an operation is needed; none if it always is.
    pub(super) fn guard(&mut self, place: usize, scope: &mut Scope) -> Option<Expression> {
        let guard = scope.blocks.guard(place);
        // Conditions get names only if all operations of the guard are known.
        if guard.terms().any(|term| term.iter().all(|literal| waits(literal.0.index(), scope))) {
            return None;
        }
        let (mut any, mut terms): (Option<Expression>, _) = (None, BTreeSet::new());
        for term in guard.terms() {
            let mut all: Option<Expression> = None;
            for &(node, holds) in term {
                let Some(condition) = self.condition(node, scope) else { continue };
                let literal = if holds { condition.condition() } else { Expression::not(&condition) };
                all = Some(all.map_or(literal.clone(), |all| Expression::and(&all, &literal)));
            }
            let all = all?;
            if !terms.insert(all.text.clone()) {
                continue;
            }
            any = Some(any.map_or(all.clone(), |any| Expression::or(&any, &all)));
        }
        any
    }

    /// A condition by its name; nothing where it follows from what is being computed.
    fn condition(&mut self, node: Node, scope: &mut Scope) -> Option<Expression> {
        let place = node.index();
        if waits(place, scope) || !self.computed(place, scope) {
            return None;
        }
        let found = scope.of(node).clone();
        if found.size == 0 {
            return Some(found);
        }
        // Where all that use it see it.
        let block = scope.blocks.block(place);
        let number = scope.open.iter().position(|open| open.block == block)?;
        let inner = self.go_to(number, scope);
        scope.is_open[place] = true;
        let named = self.by_name(place, None, found, scope);
        scope.is_open[place] = false;
        self.go_to(inner, scope);
        scope.found[place] = Some(named.clone());
        Some(named)
    }
}

/// True if an operation follows from one that is being computed: it is not begun then.
fn waits(place: usize, scope: &Scope) -> bool {
    let (mut left, mut seen) = (vec![place], BTreeSet::new());
    while let Some(place) = left.pop() {
        if scope.found[place].is_some() || !seen.insert(place) {
            continue;
        }
        if scope.is_open[place] {
            return true;
        }
        match (&scope.operations[place], scope.blocks.decided(place)) {
            (Operation::Select(_, yes, no), Some(holds)) => left.push(if holds { yes } else { no }.index()),
            // All that share its arms are computed with it.
            (Operation::Select(..), None) if scope.blocks.has_arms(place) => {
                let group = scope.blocks.group(place);
                left.extend(group.iter().flat_map(|&member| scope.operations[member].operands()).map(Node::index));
            }
            (operation, _) => left.extend(operation.operands().map(Node::index)),
        }
    }
    false
}

impl Function<'_> {
    /// A constant by the name of what it is, with a comment.
    pub fn named_number(&mut self, variable: &str, value: f64, comment: &str) -> Expression {
        let number = Expression::number(value);
        let named = self.named(variable, Kind::Real, &number.text, comment);
        Expression { known: Some(value), ..named }
    }

    /// A value from elsewhere, under its variable's name.
    pub fn named(&mut self, variable: &str, kind: Kind, text: &str, comment: &str) -> Expression {
        let name = self.names.of(variable);
        let of = if kind == Kind::Real { "real" } else { "int" };
        let comment = if comment.is_empty() { String::new() } else { format!(" /* {comment} */") };
        self.declared.push((name.clone(), format!("    const {of} {name} = {text};{comment}\n")));
        Expression::atom(name, kind)
    }

    /// A value at a place of an array, under a name of its own, in a line with its description.
    pub fn read(&mut self, array: &str, place: usize, kind: Kind, variable: &str) -> Expression {
        let name = self.names.of(variable);
        let of = if kind == Kind::Real { "real" } else { "int" };
        let comment = if name == variable { String::new() } else { format!(" /* {variable} */") };
        self.declared.push((name.clone(), format!("    const {of} {name} = {array}[{place}];{comment}\n")));
        Expression::atom(name, kind)
    }
}

/// A function, with a comment and its declaration; parameters that it doesn't use are marked.
pub fn framed((what, declaration): (&str, &str), lines: &str) -> String {
    let parameters = declaration.split_once('(').map_or("", |(_, parameters)| parameters.trim_end_matches(')'));
    let names = parameters.split(", ").map(|parameter| parameter.rsplit([' ', '*']).next().unwrap_or_default());
    // Texts within quotes are every other piece.
    let code = lines.lines().flat_map(|line| line.split("/*").next().unwrap_or_default().split('"').step_by(2));
    let code: Vec<&str> = code.collect();
    let is_used = |name: &&str| code.iter().any(|piece| has_word(piece, name));
    let unused: String = names.filter(|name| !is_used(name)).map(|name| format!("    (void){name};\n")).collect();
    format!("/* {what} */\n{declaration}\n{{\n{unused}{lines}}}\n\n")
}

/// True if a piece of C has a word that isn't a member of a struct.
fn has_word(code: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_';
    code.match_indices(word).any(|(at, _)| {
        let (before, behind) = (&code[..at], &code[at + word.len()..]);
        let is_member = before.ends_with("->") || before.ends_with('.');
        !is_member && !before.ends_with(is_part) && !behind.starts_with(is_part)
    })
}
