//! Events of a run: values that variables get at a time.

use roxmltree::Node;

use super::Origin;
use super::reader::Reader;
use crate::error::Error;
use crate::report::number;
use crate::structure::settings::Settings;

/// A value that a variable gets while the loop runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Time, s.
    pub time: f64,
    /// The variable, by its name in the loop.
    pub name: String,
    /// The value, as it is written.
    pub text: String,
    /// Its source, for messages.
    pub origin: Origin,
}

impl Event {
    /// Reads `TIME: NAME=VALUE`, as the option has it.
    ///
    /// # Errors
    /// If the text has another form.
    pub fn read(text: &str) -> Result<Self, Error> {
        let origin = Origin { file: format!("--event {text}").into(), line: None };
        let parts = text.split_once(':').and_then(|(time, rest)| Some((time.trim(), rest.split_once('=')?)));
        let time = parts.and_then(|(time, _)| time.parse().ok()).filter(|time: &f64| time.is_finite());
        let Some((time, (_, (name, value)))) = time.zip(parts) else {
            return Err(origin.refuse("must be TIME: NAME=VALUE, with the time in s, such as '5: plant.mass=2'"));
        };
        Ok(Event { time, name: name.trim().to_owned(), text: value.trim().to_owned(), origin })
    }

    /// The event as the option has it.
    pub fn written(&self) -> String {
        format!("{}: {}={}", number(self.time), self.name, self.text)
    }
}

impl Reader<'_> {
    /// An event of the annotation.
    pub fn event(&self, node: Node) -> Result<Event, Error> {
        let (time, name, text) =
            (self.number(node, "time")?, self.required(node, "name")?, self.required(node, "value")?);
        Ok(Event { time, name, text, origin: self.origin(node) })
    }
}

/// Refuses events of the user that are outside the run. The loop's own ones may come after the end of a shorter run.
///
/// # Errors
/// The event.
pub fn within_run(events: &[Event], Settings { start_time, stop_time, .. }: Settings) -> Result<(), Error> {
    let is_outside = |event: &&Event| !(start_time..stop_time).contains(&event.time);
    let asked = events.iter().find(|event| event.origin.is_argument() && is_outside(event));
    let [from, to] = [start_time, stop_time].map(number);
    asked.map_or(Ok(()), |event| {
        let time = number(event.time);
        Err(event.origin.refuse(&format!("time = {time} s: must be within the run, from {from} s to before {to} s")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_read_as_they_are_written() {
        let event = Event::read(" 2.5 : plant.a[1,2] = -3e-1 ").unwrap();
        assert_eq!((event.time, &*event.name, &*event.text), (2.5, "plant.a[1,2]", "-3e-1"));
        assert_eq!(Event::read(&event.written()).unwrap().written(), event.written());
        for wrong in ["", "5", "5: x", "x: y=1", "plant.a=1", "nan: x=1", "inf: x=1"] {
            let error = Event::read(wrong).unwrap_err().to_string();
            assert!(error.contains("must be TIME: NAME=VALUE"), "{error}");
        }
    }
}
