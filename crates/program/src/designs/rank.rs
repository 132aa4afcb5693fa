//! The order in which candidates are recommended.

use super::candidate::{Candidate, Task};
use crate::system::NO_LIMIT;

/// The worst corner may settle in so many of the times that are asked for.
const LATER: f64 = 1.5;
/// And its output may end so far from the reference, in parts of it.
const FAR: f64 = 0.05;

/// The numbers of the candidates, the recommended one first: sound ones, of these those whose worst corner settles within 1.5
/// of the time that is asked for within 5 % of the reference, of these the one with the smallest peak of the controls with the worst corner, in parts of
/// their limits or of the largest peak of any candidate.
pub fn ranked(task: &Task, candidates: &[Candidate]) -> Vec<usize> {
    let worst: Vec<_> =
        candidates.iter().map(|one| one.outcome.as_ref().ok().and_then(|design| design.worst())).collect();
    let controls = task.plant.sizes().1;
    let scale = |j: usize| {
        let limit = task.plant.limits.as_ref().map(|[min, max]| min[j].abs().max(max[j].abs()));
        let largest = worst.iter().flatten().map(|followed| followed.peaks[j]).fold(0.0, f64::max);
        limit.filter(|limit| *limit < NO_LIMIT && *limit > 0.0).unwrap_or(if largest > 0.0 { largest } else { 1.0 })
    };
    let scales: Vec<_> = (0..controls).map(scale).collect();
    let key = |number: &usize| {
        let is_sound = candidates[*number].outcome.as_ref().is_ok_and(|design| design.is_sound());
        let is_in_time = || {
            let followed = worst[*number].as_ref().filter(|followed| followed.off <= FAR)?;
            let settles = followed.settling?;
            Some(task.settling_time.is_none_or(|time| settles <= LATER * time))
        };
        let peak = |followed: &super::Followed| {
            followed.peaks.iter().zip(&scales).map(|(u, scale)| u / scale).fold(0.0, f64::max)
        };
        let has_design = candidates[*number].outcome.is_ok();
        let peak = worst[*number].as_ref().map_or(f64::INFINITY, peak);
        (!has_design, !is_sound, !is_in_time().unwrap_or(false), peak)
    };
    let mut order: Vec<_> = (0..candidates.len()).collect();
    order.sort_by(|one, other| {
        let (one, other) = (key(one), key(other));
        (one.0, one.1, one.2).cmp(&(other.0, other.1, other.2)).then(one.3.total_cmp(&other.3))
    });
    order
}
