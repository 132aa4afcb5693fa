//! Changes of variables during a run, from a page.

use serde::Deserialize;

use crate::simulation::{Change, LoadedLoop};
use crate::structure::{Event, Origin, Settings, within_run};

/// An event of a page.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Step {
    /// Time, s.
    pub time: f64,
    /// The variable, by its name in the loop.
    pub name: String,
    /// The value, as it is typed.
    pub value: String,
}

/// The events of a run, for its report and for its instances.
#[derive(Debug, Default)]
pub(crate) struct Steps {
    pub events: Vec<Event>,
    pub changes: Vec<Change>,
}

impl Steps {
    /// Converts the events of a page.
    ///
    /// # Errors
    /// The place of an event that is refused, and the reason.
    pub fn new(loaded: &LoadedLoop, asked: &[Step], settings: Settings) -> Result<Self, (usize, String)> {
        const ARGUMENT: &str = "--event";
        let mut steps = Self::default();
        for (place, Step { time, name, value }) in asked.iter().enumerate() {
            let origin = Origin { file: ARGUMENT.into(), line: None };
            let event = [Event { time: *time, name: name.clone(), text: value.clone(), origin }];
            let changes = within_run(&event, settings).and_then(|()| loaded.changes_of(&event));
            // The page has no options.
            let reason = |text: String| text.replace(&format!("{ARGUMENT}: "), "").replace(" (--set)", "");
            steps.changes.extend(changes.map_err(|error| (place, reason(error.to_string())))?);
            steps.events.extend(event);
        }
        Ok(steps)
    }
}
