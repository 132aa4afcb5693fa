//! Subset simulation of a study.

use std::sync::PoisonError;

use super::outcome::{Outcome, Tally};
use super::plan::Plan;
use super::study::{Batch, Ended, ROW, Study, hand_out};
use super::subset::{Drawn, End, Sizes, Subset};
use crate::error::Error;
use crate::workers::Workers;

impl Study {
    /// Makes the samples of a subset simulation; outcomes that are known already are taken as they are.
    ///
    /// # Errors
    /// When too many samples are refused, or the margin doesn't vary near a limit.
    pub(super) fn run_rare(
        &self,
        (plan, sizes): (&Plan, Sizes),
        outcomes: &mut Vec<Outcome>,
        workers: Option<&dyn Workers>,
        mut done: impl FnMut(&[Outcome], &Tally) -> Result<(), Error>,
        is_interrupted: impl Fn() -> bool + Sync,
    ) -> Result<Ended, Error> {
        let (names, mut tally, mut asked) = (self.names(), Tally::default(), 0);
        let mut ask = |drawn: &[Drawn]| {
            self.drawn.write().unwrap_or_else(PoisonError::into_inner).extend_from_slice(drawn);
            let (first, at_a_time) = (asked, self.at_a_time(workers) as usize);
            asked += drawn.len();
            while outcomes.len() < asked {
                let (from, to) = (outcomes.len(), asked.min(outcomes.len() + at_a_time));
                let made = self.outcomes_of(&drawn[from - first..to - first], workers, &is_interrupted);
                let is_whole = made.len() == to - from;
                outcomes.extend(made);
                done(outcomes, &tally)?;
                if !is_whole {
                    return Ok(None);
                }
            }
            let found = &outcomes[first..asked];
            found.iter().for_each(|outcome| tally.add(outcome, self.limits()));
            self.check_refused(sizes.runs(), &tally, &outcomes[..asked])?;
            let excess = |outcome: &Outcome| match outcome {
                Outcome::Refused(_) => None,
                outcome => Some(self.limits().excess(outcome)),
            };
            Ok(Some(found.iter().map(excess).collect()))
        };
        let (end, drawn) = Subset::new(sizes, self.seed, &names, &mut ask).simulate()?;
        match end {
            End::Interrupted => {
                let mut tally = Tally::default();
                outcomes.iter().for_each(|outcome| tally.add(outcome, self.limits()));
                Ok(Ended { tally, verdict: None, interrupted: true, rare: None })
            }
            End::Alike(share) => Err(self.alike(share)),
            End::Found(found) => {
                outcomes.truncate(drawn.len());
                let verdict = plan.verdict_on(&found);
                Ok(Ended { tally, verdict, interrupted: false, rare: Some(found) })
            }
        }
    }

    /// Outcomes of samples; fewer if the user stops it.
    fn outcomes_of(
        &self,
        drawn: &[Drawn],
        workers: Option<&dyn Workers>,
        is_interrupted: &(impl Fn() -> bool + Sync),
    ) -> Vec<Outcome> {
        match workers {
            Some(workers) => hand_out(workers, drawn.chunks(ROW as usize).map(|row| Batch::Drawn(row.to_vec()))),
            None => self.batch(&Batch::Drawn(drawn.to_vec()), is_interrupted),
        }
    }

    fn alike(&self, share: f64) -> Error {
        let reason = format!(
            "{:.0} % of the samples are equally far from their limits, so --rare can't get nearer to a failure. Require \
             a metric that varies with the parameters, or leave --rare out",
            100.0 * share
        );
        Error::Loop { file: self.structure().file.clone(), reason }
    }
}
