//! Members of the structs in generated C: a variable each, or an element each where a user gave elements names.

use std::collections::HashMap;
use std::fmt::Write;

use crate::fmi2::source::names::Names;
use crate::system::{Element, TELLS_NO_LIMIT, Variable, Variables};

/// A member of a struct.
#[derive(Debug)]
pub(super) struct Member {
    /// Its name in C, and that in capitals.
    pub name: String,
    pub capitals: String,
    /// Its elements, as they are stored.
    pub elements: Vec<String>,
    /// Their places among the reals or integers of the block.
    places: Vec<usize>,
    is_array: bool,
    /// `NAME_real`, or `int32_t` and `bool`.
    pub is_real: bool,
    is_boolean: bool,
    units: Vec<&'static str>,
    description: String,
}

/// A struct.
#[derive(Debug)]
pub(super) struct Members {
    /// The type's name.
    pub kind: String,
    /// Its comment.
    what: &'static str,
    pub list: Vec<Member>,
    reals: HashMap<usize, String>,
    integers: HashMap<usize, String>,
}

impl Members {
    /// The struct of these elements.
    pub fn of(kind: String, what: &'static str, elements: &[Element], variables: &Variables) -> Self {
        let mut members = Members { kind, what, list: Vec::new(), reals: HashMap::new(), integers: HashMap::new() };
        let mut names = Names::other_than(&["int32_t", "uint32_t", "uint64_t"]);
        let mut of_variable: Vec<(&Variable, Vec<Element>)> = Vec::new();
        for element in elements {
            match of_variable.iter_mut().find(|(variable, _)| std::ptr::eq(*variable, element.variable)) {
                Some((_, all)) => all.push(*element),
                None => of_variable.push((element.variable, vec![*element])),
            }
        }
        for (variable, mut all) in of_variable {
            all.sort_by_key(|element| element.offset);
            let is_named = variable.given.iter().any(Option::is_some);
            if is_named {
                all.iter().for_each(|one| members.add(&[*one], &one.name(), false, &mut names, variables));
            } else {
                // A member has all elements, so that a place is what it is in the FMU.
                let whole: Vec<Element> = (0..variable.len()).map(|offset| variable.element(offset)).collect();
                members.add(&whole, &variable.name, variable.len() > 1, &mut names, variables);
            }
        }
        members
    }

    fn add(&mut self, elements: &[Element], name: &str, is_array: bool, names: &mut Names, variables: &Variables) {
        let variable = elements[0].variable;
        let name = names.of(name);
        let places: Vec<usize> = elements.iter().map(|element| variables.index(*element)).collect();
        let access = if variable.is_real() { &mut self.reals } else { &mut self.integers };
        for (k, &place) in places.iter().enumerate() {
            access.insert(place, if is_array { format!("{name}[{k}]") } else { name.clone() });
        }
        let mut capitals = name.to_ascii_uppercase();
        while self.list.iter().any(|member| member.capitals == capitals) {
            capitals.push('_');
        }
        self.list.push(Member {
            name,
            capitals,
            elements: elements.iter().map(|element| element.name().trim_start_matches('#').to_owned()).collect(),
            places,
            is_array,
            is_real: variable.is_real(),
            is_boolean: matches!(variable.data, crate::system::Data::Boolean { .. }),
            units: elements.iter().map(|element| element.unit()).collect(),
            description: described(elements),
        });
    }

    /// Access to a value, behind the struct.
    pub fn access(&self, place: usize, is_real: bool) -> Option<&String> {
        if is_real { self.reals.get(&place) } else { self.integers.get(&place) }
    }

    /// All places of real members, with how each is reached.
    pub fn reals(&self) -> impl Iterator<Item = (&String, usize)> {
        let of = |member: &'_ Member| if member.is_real { member.places.clone() } else { Vec::new() };
        self.list.iter().flat_map(of).map(|place| (&self.reals[&place], place))
    }

    /// Members that are no reals, with the values that they have there.
    pub fn integers_at(&self, values: &[i32]) -> Vec<(&String, i32)> {
        let whole = self.list.iter().filter(|member| !member.is_real).flat_map(|member| &member.places);
        whole.map(|place| (&self.integers[place], values[*place])).collect()
    }

    /// The declaration in C; nothing where there are no members, as C has no empty struct.
    pub fn declaration(&self, extra: &[String], real: &str) -> String {
        if self.is_empty() && extra.is_empty() {
            return String::new();
        }
        let mut text = format!("/* {} */\ntypedef struct {{\n", self.what);
        for member in &self.list {
            let kind = if member.is_real {
                real
            } else if member.is_boolean {
                "bool"
            } else {
                "int32_t"
            };
            let size = if member.is_array { format!("[{}]", member.elements.len()) } else { String::new() };
            let about = member.about();
            let about = if about.is_empty() { about } else { format!(" /* {about} */") };
            let _ = writeln!(text, "    {kind} {}{size};{about}", member.name);
        }
        extra.iter().for_each(|line| _ = writeln!(text, "    {line}"));
        let _ = write!(text, "}} {};\n\n", self.kind);
        text
    }

    /// Bytes of the struct with real numbers of `real` bytes, and its alignment, where each number is aligned to its
    /// size.
    pub fn bytes(&self, extra: &[String], real: usize) -> (usize, usize) {
        let size = |member: &Member| {
            if member.is_real {
                real
            } else if member.is_boolean {
                1
            } else {
                4
            }
        };
        let own = self.list.iter().map(|member| (size(member) * member.elements.len(), size(member)));
        let counters = extra.iter().map(|line| if line.starts_with("uint64_t") { (8, 8) } else { (4, 4) });
        aligned(own.chain(counters))
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}

impl Member {
    /// Its comment: elements, units, description.
    fn about(&self) -> String {
        let mut parts = Vec::new();
        if self.is_array || self.elements.first().is_some_and(|element| *element != self.name) {
            parts.push(match &self.elements[..] {
                [one] => one.clone(),
                [first, .., last] if self.elements.len() > 4 && !first.contains(',') => format!("{first} … {last}"),
                all => all.join(" "),
            });
        }
        if let Some(unit) = self.unit() {
            parts.push(unit);
        }
        if !self.description.is_empty() {
            parts.push(self.description.clone());
        }
        ascii(&parts.join("; "))
    }

    fn unit(&self) -> Option<String> {
        let [first, rest @ ..] = &self.units[..] else { return None };
        if rest.iter().all(|unit| unit == first) {
            return (!first.is_empty() && *first != "1").then(|| (*first).to_owned());
        }
        let all = self.units.iter().map(|unit| if unit.is_empty() { "1" } else { unit });
        Some(all.collect::<Vec<_>>().join(", "))
    }

    pub fn is_array(&self) -> bool {
        self.is_array
    }

    /// Lines of C that do something with each of its numbers: `text` has `@` where a number is.
    pub fn each(&self, text: &str) -> String {
        if self.is_array {
            let line = text.replace('@', &format!("{}[i]", self.name));
            format!("    for (int i = 0; i < {}; i++) {{\n        {line}\n    }}\n", self.elements.len())
        } else {
            format!("    {}\n", text.replace('@', &self.name))
        }
    }
}

/// Lines of C that do something with each number of these members, `@` in a text. Members of one length share a loop: counting takes
/// as long as what is done.
pub(super) fn each<'a>(members: impl IntoIterator<Item = &'a Member>, lines: &[&str]) -> String {
    let mut loops: Vec<(Option<usize>, String)> = Vec::new();
    for member in members {
        let size = member.is_array.then_some(member.elements.len());
        let (indent, place) = if member.is_array { ("        ", "[i]") } else { ("    ", "") };
        let number = format!("{}{place}", member.name);
        let text: String = lines.iter().map(|line| format!("{indent}{}\n", line.replace('@', &number))).collect();
        match loops.iter_mut().find(|(other, _)| *other == size) {
            Some((_, body)) => body.push_str(&text),
            None => loops.push((size, text)),
        }
    }
    let whole = |(size, body): (Option<usize>, String)| match size {
        Some(size) => format!("    for (int i = 0; i < {size}; i++) {{\n{body}    }}\n"),
        None => body,
    };
    loops.into_iter().map(whole).collect()
}

/// Bytes and alignment of a struct of members with these.
pub(super) fn aligned(members: impl Iterator<Item = (usize, usize)>) -> (usize, usize) {
    let next = |(end, most): (usize, usize), (size, align): (usize, usize)| {
        (end.next_multiple_of(align) + size, most.max(align))
    };
    let (end, align) = members.fold((0, 1), next);
    (end.next_multiple_of(align), align)
}

/// The description of elements: one text, or one each.
fn described(elements: &[Element]) -> String {
    let of = |element: &Element| {
        let texts = &element.variable.description;
        texts.get(element.offset).or_else(|| texts.first()).cloned().unwrap_or_default()
    };
    let mut texts: Vec<String> = elements.iter().map(of).collect();
    texts.dedup();
    let has_no_limit = elements.iter().any(|element| element.variable.shown.no_limit);
    texts.join(" | ") + if has_no_limit { TELLS_NO_LIMIT } else { "" }
}

/// A text in a comment, in characters that every compiler reads.
pub(super) fn ascii(text: &str) -> String {
    let replaced = text.replace("*/", "* /").replace("/*", "/ *").replace('…', "...").replace('−', "-");
    replaced.replace('°', "deg").replace('²', "2").replace('Ω', "ohm").chars().map(plain).collect()
}

fn plain(c: char) -> char {
    match c {
        ' '..='~' => c,
        '·' | '×' => '*',
        '‖' => '|',
        '’' => '\'',
        _ => '?',
    }
}
