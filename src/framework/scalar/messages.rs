//! What equations tell while they run, and why they refuse.

use std::ops::{Deref, DerefMut};

use crate::error::Invalid;

/// A message of a system, for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Log category.
    pub category: &'static str,
    /// The text.
    pub text: String,
}

/// Messages that wait to be logged, and why what was asked for is refused. Empty, it holds no memory.
#[derive(Debug, Default)]
pub struct MessageLog {
    messages: Vec<Message>,
    refused: Invalid,
}

impl MessageLog {
    /// An empty one.
    pub fn new() -> Self {
        MessageLog::default()
    }

    pub(crate) fn tell(&mut self, category: &'static str, text: String) {
        self.messages.push(Message { category, text });
    }

    pub(crate) fn refuse(&mut self, reason: Invalid) {
        self.refused.and(reason);
    }

    /// Takes over what was told and refused to a part of a composite, in other words.
    pub(crate) fn take_over(&mut self, other: MessageLog, word: impl Fn(String) -> String) {
        let reworded = |message: Message| Message { text: word(message.text), ..message };
        self.messages.extend(other.messages.into_iter().map(reworded));
        self.refused.and(other.refused.reworded(&word));
    }

    /// Takes the reasons out for which what was asked for is refused.
    ///
    /// # Errors
    /// These, where there are any.
    pub(crate) fn accepted(&mut self) -> Result<(), Invalid> {
        std::mem::take(&mut self.refused).into_result()
    }
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
