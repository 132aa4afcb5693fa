//! Messages of equations while they run, and reasons why they refuse.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use crate::error::Invalid;

/// A message of a system, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Log category.
    pub category: &'static str,
    /// The text.
    pub text: String,
}

/// Marks of the begin and the end of a reference to a variable in a text: characters that no text of a model contains.
pub(crate) const REFERENCE: [char; 2] = ['\u{e000}', '\u{e001}'];

/// Messages that wait to be logged, and why what was asked for is refused. Empty, it holds no memory.
#[derive(Debug, Default, PartialEq)]
pub struct MessageLog {
    messages: Vec<Message>,
    refused: Invalid,
    /// The part of a composite that sends messages and refusals.
    part: Option<Arc<str>>,
    /// True if nobody reads messages and refusals.
    unheard: bool,
}

impl MessageLog {
    /// An empty one.
    pub fn new() -> Self {
        MessageLog::default()
    }

    /// One for a part of a composite.
    pub(crate) fn of_part(name: &Arc<str>, around: &MessageLog) -> Self {
        MessageLog { part: Some(Arc::clone(name)), unheard: around.unheard, ..MessageLog::default() }
    }

    /// One that nobody reads.
    pub(crate) fn unheard() -> Self {
        MessageLog { unheard: true, ..MessageLog::default() }
    }

    /// A text with the name of its part.
    pub(crate) fn worded(&self, text: String) -> String {
        match &self.part {
            Some(name) => of_part(text, name),
            None => text,
        }
    }

    /// True if nobody reads messages and refusals.
    pub(crate) fn is_unheard(&self) -> bool {
        self.unheard
    }

    pub(crate) fn add(&mut self, category: &'static str, text: String) {
        self.messages.push(Message { category, text });
    }

    pub(crate) fn refuse(&mut self, reason: Invalid) {
        self.refused.and(reason);
    }

    /// Takes over messages and refusals of a composite's part, with the part's name.
    pub(crate) fn take_over(&mut self, other: MessageLog) {
        let MessageLog { messages, refused, part, .. } = other;
        // At every point of a run; there is hardly ever anything.
        let Some(name) = part.filter(|_| !messages.is_empty() || !refused.reasons().is_empty()) else { return };
        let reworded = |message: Message| Message { text: of_part(message.text, &name), ..message };
        self.messages.extend(messages.into_iter().map(reworded));
        self.refused.and(refused.reworded(|text| of_part(text, &name)));
    }

    /// Takes the reasons out for which what was asked for is refused.
    ///
    /// # Errors
    /// These, where there are any.
    pub(crate) fn accepted(&mut self) -> Result<(), Invalid> {
        std::mem::take(&mut self.refused).into_result()
    }
}

/// A text of a composite's part: variables are named with the part's name, other texts begin with it.
pub(crate) fn of_part(text: String, part: &str) -> String {
    if text.contains(REFERENCE[0]) { text } else { format!("{part}: {text}") }
}

impl Deref for MessageLog {
    type Target = Vec<Message>;
    fn deref(&self) -> &Vec<Message> {
        &self.messages
    }
}

impl DerefMut for MessageLog {
    fn deref_mut(&mut self) -> &mut Vec<Message> {
        &mut self.messages
    }
}
