//! The present integration method and the eigenvalue that decided it, which an FMU logs on request.

use std::fmt;

use super::stability::Mode;
use crate::report::number;

/// Integration methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Integrates {
    /// The system's own step.
    OwnStep,
    /// An explicit method, of order 5 or 8.
    Explicit,
    /// Rosenbrock's method.
    Stiff,
    /// Steps of fixed length.
    Fixed,
}

impl Integrates {
    const COUNT: usize = 4;

    /// True if it is a method for any system.
    fn is_general(self) -> bool {
        self != Integrates::OwnStep
    }
}

/// A choice between methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chosen {
    /// Method in force.
    pub by: Integrates,
    /// True if a user asked for it.
    pub is_asked_for: bool,
    /// The mode that holds the explicit method to the shortest substeps that stability asks for, and these, s; none where no
    /// mode does, or none was looked at.
    pub holds: Option<(Mode, f64)>,
    /// Start of its use, s.
    pub from: f64,
    /// True if no further change is reported.
    pub is_last: bool,
}

impl fmt::Display for Chosen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let method = match self.by {
            Integrates::OwnStep => "the closed-form step of the adaptive law",
            Integrates::Explicit => "the explicit method",
            Integrates::Stiff => "the stiff method",
            Integrates::Fixed => "steps of fixed length",
        };
        write!(f, "integrated by {method} from t = {} s", number(self.from))?;
        if self.is_asked_for {
            return f.write_str(", as integration_method asks");
        }
        let Some((Mode { growth, frequency }, substep)) = self.holds.filter(|_| self.by.is_general()) else {
            return Ok(());
        };
        let eigenvalue = match frequency {
            0.0 => format!("{growth:.2e} 1/s"),
            frequency => format!("{growth:.2e} ± {frequency:.2e}i 1/s"),
        };
        match self.by {
            Integrates::Stiff => {
                write!(f, ": the eigenvalue {eigenvalue} limits the explicit method of order 5 to {substep:.2e} s")
            }
            _ => write!(f, ": the eigenvalue {eigenvalue} allows substeps of {substep:.2e} s at order 5"),
        }?;
        f.write_str(if self.is_last { "; further changes are not logged" } else { "" })
    }
}

/// Largest number of reported changes between general methods: some systems change for ever.
const MOST_CHANGES: u32 = 5;

/// Choices so far, and the one that wasn't reported yet.
#[derive(Debug, Default)]
pub(super) struct Choices {
    seen: [bool; Integrates::COUNT],
    /// General method in force, and the one reported last.
    general: Option<Integrates>,
    reported: Option<Integrates>,
    changes: u32,
    news: Option<Chosen>,
}

impl Choices {
    /// Notes what integrates. News is what integrates for the first time, and a change between general methods: a system's
    /// own step comes and goes.
    pub fn note(&mut self, chosen: Chosen) {
        let is_first = !std::mem::replace(&mut self.seen[chosen.by as usize], true);
        let is_other = chosen.by.is_general() && self.general.replace(chosen.by).is_some_and(|by| by != chosen.by);
        if is_first || (is_other && self.changes < MOST_CHANGES) {
            self.news = Some(chosen);
        }
    }

    /// Takes the latest news; none where it has gone there and back.
    pub fn take(&mut self) -> Option<Chosen> {
        let mut news = self.news.take()?;
        if !news.by.is_general() {
            return Some(news);
        }
        if self.reported == Some(news.by) {
            return None;
        }
        self.changes += u32::from(self.reported.replace(news.by).is_some());
        news.is_last = self.changes == MOST_CHANGES;
        Some(news)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(by: Integrates, from: f64) -> Chosen {
        let mode = Mode { growth: -1234.5, frequency: 0.0 };
        Chosen { by, is_asked_for: false, holds: Some((mode, 2.357e-3)), from, is_last: false }
    }

    #[test]
    fn a_choice_names_the_eigenvalue_that_decided() {
        let text = chosen(Integrates::Stiff, 0.5).to_string();
        assert_eq!(
            text,
            "integrated by the stiff method from t = 0.5 s: the eigenvalue -1.23e3 1/s limits the explicit method of order 5 to 2.36e-3 s"
        );
        let asked = Chosen { is_asked_for: true, ..chosen(Integrates::Fixed, 0.0) };
        assert_eq!(asked.to_string(), "integrated by steps of fixed length from t = 0 s, as integration_method asks");
    }

    #[test]
    fn what_comes_and_goes_is_logged_once_and_a_change_of_the_general_method_each_time() {
        let mut choices = Choices::default();
        let mut reports = |by: Integrates, from: f64| {
            choices.note(chosen(by, from));
            choices.take().is_some()
        };
        use Integrates::{Explicit, OwnStep, Stiff};
        let order = [OwnStep, Explicit, OwnStep, Explicit, Stiff, Stiff, Explicit];
        let news: Vec<bool> = order.into_iter().zip(0..).map(|(by, k)| reports(by, f64::from(k))).collect();
        assert_eq!(news, [true, true, false, false, true, false, true]);
    }

    #[test]
    fn what_went_there_and_back_is_no_news_and_endless_changes_are_logged_up_to_a_number() {
        use Integrates::{Explicit, Stiff};
        let mut choices = Choices::default();
        choices.note(chosen(Explicit, 0.0));
        assert!(choices.take().is_some());
        choices.note(chosen(Stiff, 1.0));
        assert!(choices.take().is_some());
        [Explicit, Stiff].into_iter().for_each(|by| choices.note(chosen(by, 2.0)));
        assert_eq!(choices.take(), None);
        let mut reported = Vec::new();
        for k in 0..20 {
            choices.note(chosen(if k % 2 == 0 { Explicit } else { Stiff }, f64::from(k)));
            reported.extend(choices.take());
        }
        assert_eq!(reported.len(), MOST_CHANGES as usize - 1);
        let last = reported.pop().unwrap().to_string();
        assert!(
            last.ends_with("; further changes are not logged") && !reported.iter().any(|chosen| chosen.is_last),
            "{last}"
        );
    }
}
