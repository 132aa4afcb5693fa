//! The order in which candidates are recommended.

use super::candidate::{Candidate, Design, Judged, Task};
use super::series::Followed;
use crate::report::number;
use crate::system::NO_LIMIT;
use crate::template::three_digits;

/// Longest settling time of the worst corner, in parts of the time that is asked for.
const LATER: f64 = 1.5;
/// Largest steady-state error of an output that counts as controlled, in parts of its reference.
const FAR: f64 = 0.05;

/// Deficiency of a sound candidate with the worst plant, in words; none if it is as asked for.
pub fn shortfall(task: &Task, design: &Design) -> Option<String> {
    let worst = design.worst()?;
    if !is_near(&worst) {
        let off = number(three_digits(100.0 * worst.off));
        return Some(format!("its output ends {off} % from the reference with the worst plant"));
    }
    let settles = number(three_digits(worst.settling?));
    (!is_in_time(task, &worst)).then(|| format!("it settles in {settles} s with the worst plant"))
}

fn is_near(worst: &Followed) -> bool {
    worst.off <= FAR
}

fn is_in_time(task: &Task, worst: &Followed) -> bool {
    let settles = |settles: f64| task.settling_time.is_none_or(|time| settles <= LATER * time);
    worst.settling.is_some_and(settles)
}

/// The candidates in order of recommendation, by these criteria: a sound design, then one whose
/// loops weren't all simulated; outputs that end within 5 % of their
/// references with the worst corner; settling there within 1.5 of the time asked for; the smallest peak of the controls
/// there, in parts of their limits or of the largest peak of any candidate.
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
        let verdict = candidates[*number].outcome.as_ref().ok().map_or(Judged::NotSound, Design::verdict);
        let worst = worst[*number].as_ref();
        let (is_near, is_in_time) = (worst.is_some_and(is_near), worst.is_some_and(|worst| is_in_time(task, worst)));
        let peak =
            |followed: &Followed| followed.peaks.iter().zip(&scales).map(|(u, scale)| u / scale).fold(0.0, f64::max);
        let has_design = candidates[*number].outcome.is_ok();
        let peak = worst.map_or(f64::INFINITY, peak);
        ((!has_design, verdict, !is_near, !is_in_time), peak)
    };
    let mut order: Vec<_> = (0..candidates.len()).collect();
    order.sort_by(|one, other| {
        let (one, other) = (key(one), key(other));
        one.0.cmp(&other.0).then(one.1.total_cmp(&other.1))
    });
    order
}
