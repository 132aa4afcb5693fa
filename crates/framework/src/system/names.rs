//! A user's own names and descriptions of variables, in place of a model's: given in a description, decided in this
//! module only.
//!
//! Handles, places and value references know no names, so nothing else changes. Messages refer to variables by their
//! handles ([`super::Values::name`]); this module puts in the names in force when a text leaves.

use std::collections::{BTreeMap, HashSet};

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::declaration::Declaration;
use super::values::{BooleanOf, ChoiceOf, Class, DiscreteHandle, IntegerOf, MatrixOf, Offsets, ScalarOf, VectorOf};
use super::variable::{Causality, Naming, Section, Variable, Variables};
use crate::error::Invalid;
use crate::near;
use crate::scalar::REFERENCE;

/// The reason for which a name of another variable is refused.
pub const TAKEN: &str = "is the name of another variable already";
/// Longest name.
const LONGEST: usize = 100;

/// The user's words for variables, by the model's names of them: of a whole variable, or of one element (`x[2]`).
pub type Names = BTreeMap<String, Words>;

/// The words for one variable: for itself where it is a scalar or an element, or for each of its elements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "must be a name, { name, description }, or a list of these, one an element")]
pub enum Words {
    /// Words for each element, rows first.
    Each(Vec<Word>),
    /// Words for a scalar or an element.
    One(Word),
}

/// A name, or a name with a description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged, expecting = "must be a name or { name, description }")]
pub enum Word {
    /// The name.
    Name(String),
    /// Name and description; what is left out stays the model's.
    #[serde(deserialize_with = "of_table")]
    Described(Described),
}

/// A derived reader would take a list for a table, too.
fn of_table<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Described, D::Error> {
    toml::Value::Table(toml::Table::deserialize(deserializer)?).try_into().map_err(D::Error::custom)
}

/// A name with a description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Described {
    /// Name: letters, digits and _, with dots and indices as in `motor.speed` and `joint[1]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    /// Description of the signal, in a line.
    #[serde(skip_serializing_if = "Option::is_none")]
    description: Option<String>,
}

impl Word {
    /// Its name, where it has one.
    pub fn name(&self) -> Option<&str> {
        match self {
            Word::Name(name) => Some(name),
            Word::Described(described) => described.name.as_deref(),
        }
    }

    /// Its description, if it has one.
    pub(crate) fn description(&self) -> Option<&str> {
        match self {
            Word::Name(_) => None,
            Word::Described(described) => described.description.as_deref(),
        }
    }
}

impl Words {
    /// The words, one for each element or one for all.
    pub fn each(&self) -> &[Word] {
        match self {
            Words::One(word) => std::slice::from_ref(word),
            Words::Each(words) => words,
        }
    }
}

/// Gives names to the variables that were declared from the `first` on, whose own names have a part's in front.
///
/// # Errors
/// Every name that has no variable, is none, or is taken.
pub(super) fn apply(names: &Names, first: usize, part: Option<&str>, d: &mut Declaration) -> Result<(), Invalid> {
    if names.is_empty() {
        return Ok(());
    }
    let prefix = part.map_or(String::new(), |part| format!("{part}."));
    let mut invalid = Invalid::none();
    let list = &mut d.variables.list[first..];
    // All are looked for before any has a new name, which may be the name of another until then.
    let found: Vec<_> = names.keys().map(|key| find(&format!("{prefix}{key}"), list)).collect();
    for (key, other) in given_twice(names, &found) {
        invalid.and(Invalid::because(format!(
            "[names] {key}: `{other}` gives this variable a name, too; keep one of both"
        )));
    }
    for ((key, words), found) in names.iter().zip(found) {
        if let Err(reason) = give(key, words, &prefix, found, list) {
            invalid.and(Invalid::because(format!("[names] {key}: {reason}")));
        }
    }
    for name in taken(&d.variables.list).into_iter().map(|name| name.strip_prefix(&prefix).unwrap_or(&name).to_owned())
    {
        invalid.and(Invalid::because(format!("[names] `{name}` {TAKEN}; each needs one of its own")));
    }
    invalid.into_result()
}

/// A variable by its place, and which of its elements.
type Place = (usize, Vec<usize>);

/// Keys that name an element which an earlier key names, too, with that key.
fn given_twice<'a>(names: &'a Names, found: &[Option<Place>]) -> Vec<(&'a str, &'a str)> {
    let mut named: BTreeMap<(usize, usize), &str> = BTreeMap::new();
    let mut twice = Vec::new();
    for ((key, words), found) in names.iter().zip(found) {
        let Some((index, offsets)) = found else { continue };
        let places = offsets.iter().zip(words.each()).filter(|(_, word)| word.name().is_some());
        let earlier = places.filter_map(|(&offset, _)| named.insert((*index, offset), key)).next();
        twice.extend(earlier.map(|earlier| (key.as_str(), earlier)));
    }
    twice
}

/// Gives the words for one key to the variable or element that it names.
fn give(key: &str, words: &Words, prefix: &str, found: Option<Place>, list: &mut [Variable]) -> Result<(), String> {
    let (index, offsets) = found.ok_or_else(|| {
        let shown = list.iter().filter(|v| is_nameable(v)).map(|v| v.name.strip_prefix(prefix).unwrap_or(&v.name));
        format!("there is no such variable; {}", near::choice(key, &shown.collect::<Vec<_>>(), ""))
    })?;
    let given = words.each();
    if given.len() != offsets.len() || matches!(words, Words::Each(_)) && list[index].naming == Naming::Scalar {
        let of = if offsets.len() == 1 { "one name".to_owned() } else { format!("a list of {} names", offsets.len()) };
        return Err(format!("{} given: it must be {of}", given.len()));
    }
    let (name, section) = (list[index].name.clone(), list[index].section);
    for (&offset, word) in offsets.iter().zip(given) {
        if let Some(own) = word.name() {
            check(own)?;
        }
        // A derivative has the name of its state.
        let goes_with = |v: &&mut Variable| v.section == Section::Derivative && section == Section::State;
        for variable in list.iter_mut().filter(|v| v.name == name && (v.section == section || goes_with(v))) {
            set_words(variable, offset, prefix, word);
        }
    }
    Ok(())
}

/// Puts words in place of a variable's own.
fn set_words(variable: &mut Variable, offset: usize, prefix: &str, word: &Word) {
    let len = variable.len();
    if let Some(own) = word.name() {
        variable.given.resize(len, None);
        variable.given[offset] = Some(format!("{prefix}{own}"));
    }
    if let Some(text) = word.description() {
        if variable.description.len() == 1 {
            variable.description = (0..len).map(|offset| variable.element(offset).own_text()).collect();
        }
        let rate = variable.section == Section::Derivative;
        variable.description[offset] = if rate { format!("time derivative of: {text}") } else { text.to_owned() };
    }
}

fn is_nameable(variable: &Variable) -> bool {
    variable.causality != Causality::Hidden && variable.section != Section::Derivative
}

/// The variable of a name with all its elements, rows first, or the one element of the name.
fn find(name: &str, list: &[Variable]) -> Option<Place> {
    let nameable = || list.iter().enumerate().filter(|(_, v)| is_nameable(v));
    let whole = nameable().find(|(_, v)| v.name == name);
    if let Some((index, variable)) = whole {
        return Some((index, variable.elements().map(|element| element.offset).collect()));
    }
    nameable().find_map(|(index, v)| Some((index, vec![v.elements().find(|e| e.name() == name)?.offset])))
}

/// A name of FMI's structured convention: identifiers with indices, joined by dots.
fn check(name: &str) -> Result<(), String> {
    let identifier = |text: &str| {
        text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
            && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    };
    let index = |text: &str| !text.is_empty() && text.len() < 10 && text.chars().all(|c| c.is_ascii_digit());
    let piece = |text: &str| match text.split_once('[') {
        None => identifier(text),
        Some((name, rest)) => identifier(name) && rest.strip_suffix(']').is_some_and(|i| i.split(',').all(index)),
    };
    if name.len() <= LONGEST && name.split('.').all(piece) {
        return Ok(());
    }
    let shown: String = name.escape_debug().take(LONGEST).collect();
    Err(format!(
        "`{shown}` must be at most {LONGEST} letters, digits and _, not begin with a digit, and may have dots and \
         indices, as in motor.speed or joint[1]"
    ))
}

/// Names that several elements have, or that are a whole variable's and a user's for something else.
fn taken(list: &[Variable]) -> Vec<String> {
    let visible = || list.iter().filter(|v| v.causality != Causality::Hidden);
    let whole: HashSet<&str> = visible().map(|v| v.name.as_str()).collect();
    let (mut seen, mut taken) = (HashSet::new(), Vec::new());
    for variable in visible() {
        for element in variable.elements() {
            let own = variable.given.get(element.offset).is_some_and(Option::is_some);
            let name = element.name();
            let of_another = own && variable.name != name && whole.contains(name.as_str());
            if of_another || !seen.insert(name.clone()) {
                taken.push(name);
            }
        }
    }
    taken
}

/// Anything that messages may name: a variable, or one element of it.
pub trait Named {
    /// True if it is real, whether it is a whole variable, its section, and its first place there.
    fn named(&self) -> (bool, bool, Section, usize);
}

impl<C: Class> Named for ScalarOf<C> {
    fn named(&self) -> (bool, bool, Section, usize) {
        (true, false, C::SECTION, self.start)
    }
}

impl<C: Class> Named for VectorOf<C> {
    fn named(&self) -> (bool, bool, Section, usize) {
        (true, true, C::SECTION, self.start)
    }
}

impl<C: Class> Named for MatrixOf<C> {
    fn named(&self) -> (bool, bool, Section, usize) {
        (true, true, C::SECTION, self.start)
    }
}

macro_rules! named_discrete {
    ($($name:ident<$($parameter:ident),*>),*) => {$(
        impl<$($parameter),*> Named for $name<$($parameter),*>
        where
            Self: DiscreteHandle,
        {
            fn named(&self) -> (bool, bool, Section, usize) {
                let (section, place) = self.place();
                (false, true, section, place)
            }
        }
    )*};
}
named_discrete!(IntegerOf<C>, BooleanOf<C>, ChoiceOf<C, E>);

impl Offsets {
    /// A reference to a variable, for texts that users read.
    pub fn name(&self, handle: &impl Named) -> String {
        let (is_real, is_whole, section, place) = handle.named();
        let sections = if is_real { &self.real } else { &self.integer };
        reference(is_real, is_whole, sections[section as usize] + place)
    }
}

const BEGIN: char = REFERENCE[0];
const END: char = REFERENCE[1];

/// A reference to a variable, for texts: of an element, or of a whole variable that begins at this place of the block.
pub(super) fn reference(is_real: bool, is_whole: bool, index: usize) -> String {
    let kind = if is_real { 'r' } else { 'i' };
    let extent = if is_whole { 'w' } else { 'e' };
    format!("{BEGIN}{kind}{extent}{index}{END}")
}

impl Variables {
    /// A system's text for users: references to variables become the names in force.
    pub(crate) fn named(&self, text: &str) -> String {
        let mut pieces = text.split(BEGIN);
        let mut result = pieces.next().unwrap_or_default().to_owned();
        for piece in pieces {
            let (reference, rest) = piece.split_once(END).unwrap_or((piece, ""));
            result.push_str(&self.referred(reference));
            result.push_str(rest);
        }
        result
    }

    /// Reasons of a refusal for users, with the names of variables that are in force.
    pub(crate) fn named_refusal(&self, invalid: Invalid) -> Invalid {
        invalid.reworded(|reason| self.named(&reason))
    }

    fn referred(&self, reference: &str) -> String {
        let is_real = reference.starts_with('r');
        let Some(index) = reference.get(2..).and_then(|index| index.parse::<usize>().ok()) else {
            return String::new();
        };
        let first = |v: &Variable| self.index(v.element(0));
        let is_it = |v: &&Variable| v.is_real() == is_real && (first(v)..first(v) + v.len()).contains(&index);
        let Some(variable) = self.iter().find(is_it) else { return String::new() };
        let name = |offset: usize| variable.element(offset).name().trim_start_matches('#').to_owned();
        if reference[1..].starts_with('e') {
            return name(index - first(variable));
        }
        if variable.given.iter().any(Option::is_some) {
            return variable.elements().map(|element| name(element.offset)).collect::<Vec<_>>().join(", ");
        }
        variable.name.trim_start_matches('#').to_owned()
    }
}
