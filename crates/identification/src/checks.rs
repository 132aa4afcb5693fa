//! Findings about an estimate.

use nalgebra::{DMatrix, DVector};

use crate::data::Data;
use crate::faults::Names;
use crate::finding::{Cause, Finding, Kind, Refusal};
use crate::held_out::HeldOut;
use crate::layout::{Layout, Place};
use crate::linear::{chi_squared, eigenvalues};
use crate::poles::Pole;
use crate::residuals::{LAGS, Residuals};
use crate::starts::further_delay;
use crate::text::{combination, number};
use crate::uncertainty::Uncertainty;

/// An entry isn't seen where its standard error is above this part of it …
const UNSEEN: f64 = 0.3;
/// … and above this part of the largest pole.
const UNSEEN_OF_POLES: f64 = 0.03;
/// The most of these entries with a finding each.
const MOST_UNSEEN: usize = 6;
/// Share of an entry's variance above which one direction is named.
const MOSTLY: f64 = 0.9;
/// Largest condition number of good records, with reserve.
pub(crate) const CONDITION: f64 = 1e8;
/// The same in companion form, where the coordinates make it large.
pub(crate) const CONDITION_OF_COMPANION: f64 = 1e12;
/// A pole faster than this over a sample isn't seen.
const FAST: f64 = 1.5;
/// Factor from which residuals are called coloured.
const COLOURED: f64 = 2.0;
/// Largest relative error of an unstable pole.
const UNSTABLE: f64 = 0.05;
/// Length that a record should have, in slowest time constants.
const TIME_CONSTANTS: f64 = 3.0;
/// Probability with which a correlation of residuals and an input is reported where there is none.
const BY_CHANCE: f64 = 0.001;
/// A model must explain this part of the motion that it is estimated from, %.
const LEAST_EXPLAINED: f64 = 50.0;
/// Standard error of entries of a kinematic row, at most.
const KINEMATIC: f64 = 0.05;

/// The unknowns of an estimate with their names and units of the data.
pub(crate) struct Estimates<'a> {
    pub layout: &'a Layout,
    pub names: &'a Names<'a>,
    /// Scaled.
    pub unknowns: &'a [f64],
    pub uncertainty: &'a Uncertainty,
    /// Factors to units of the data.
    pub factors: Vec<f64>,
}

impl Estimates<'_> {
    fn name(&self, k: usize) -> String {
        self.names.entry(self.layout.unknowns[k].place)
    }

    /// Entries that the record doesn't show: the least certain ones each, then the names of the others.
    pub fn unseen(&self, a: &DMatrix<f64>, rows: usize, findings: &mut Vec<Finding>) {
        // Where nothing is certain, its reason is a finding of its own.
        if self.uncertainty.condition > CONDITION {
            return;
        }
        let largest = eigenvalues(a).unwrap_or_default().iter().map(|pole| pole.norm()).fold(0.0, f64::max);
        // Where no pole can be distinguished from 0, all are of integrators.
        let integrates = 1.0 / rows as f64;
        let limit = if largest > integrates { UNSEEN_OF_POLES * largest } else { integrates };
        let mut unseen: Vec<(f64, usize)> = Vec::new();
        for (k, error) in self.uncertainty.errors().into_iter().enumerate() {
            let share = error / self.unknowns[k].abs().max(f64::MIN_POSITIVE);
            let is_constant = matches!(self.layout.unknowns[k].place, Place::D(..));
            if !is_constant && share > UNSEEN && error > limit {
                unseen.push((share, k));
            }
        }
        unseen.sort_by(|p, q| q.0.total_cmp(&p.0));
        for &(share, k) in unseen.iter().take(MOST_UNSEEN) {
            findings.push(Finding::not_sound(Kind::Unseen, self.unseen_text(share, k)));
        }
        if unseen.len() > MOST_UNSEEN {
            let names: Vec<String> = unseen[MOST_UNSEEN..].iter().map(|(_, k)| self.name(*k)).collect();
            let text = format!("nor are these shown: {}. Known entries make the others certain", names.join(", "));
            findings.push(Finding::not_sound(Kind::Unseen, text));
        }
    }

    fn unseen_text(&self, share: f64, k: usize) -> String {
        let mut text = format!("{}: {} % (1 σ): this record doesn't show it", self.name(k), number(100.0 * share));
        if let Some(terms) = self.uncertainty.combination(k, MOSTLY) {
            let named: Vec<(f64, String)> = terms
                .iter()
                .map(|(part, place)| (part * self.factors[*place] / self.factors[k], self.name(*place)))
                .collect();
            let named: Vec<(f64, &str)> = named.iter().map(|(part, name)| (*part, name.as_str())).collect();
            text += &format!(", nor any other model along {}", combination(&named, 0.0));
        }
        text + ". Fix it in the structure, or excite more"
    }

    /// Rows that are kinematics by what is estimated.
    pub fn kinematics(&self, findings: &mut Vec<Finding>) {
        let (n, m) = (self.layout.n, self.layout.m);
        for i in 0..n {
            let row: Vec<usize> = (0..self.layout.count()).filter(|k| self.is_of_row(*k, i)).collect();
            if row.len() != n + m {
                continue;
            }
            let Some((best, distance)) = self.nearest_kinematic(i, &row) else { continue };
            let names = self.names.signals.measured.iter().chain(&self.names.signals.inputs);
            let terms: Vec<(f64, &str)> = best.iter().copied().zip(names.map(String::as_str)).collect();
            let before = self.layout.count();
            let constants =
                self.layout.unknowns.iter().filter(|unknown| matches!(unknown.place, Place::D(of, _) if of == i));
            let text = format!(
                "row {} is {}' = {} within {} %: add it to the structure, and {before} unknowns become {}",
                i + 1,
                self.names.signals.measured[i],
                combination(&terms, 0.0),
                number(100.0 * distance),
                before - row.len() - constants.count()
            );
            findings.push(Finding::note(Kind::Kinematics, text));
        }
    }

    fn is_of_row(&self, k: usize, row: usize) -> bool {
        matches!(self.layout.unknowns[k].place, Place::A(i, _) | Place::B(i, _) if i == row)
    }

    /// The row of 0, 1 and −1, one or two of them not 0, that agrees best with an estimated one, if any does; and by how much its
    /// entries of 1 differ.
    fn nearest_kinematic(&self, i: usize, row: &[usize]) -> Option<(Vec<f64>, f64)> {
        let size = row.len();
        let scale = |k: usize| self.factors[row[k]];
        let estimate = DVector::from_fn(size, |k, _| self.unknowns[row[k]] * scale(k));
        let covariance = &self.uncertainty.covariance;
        let covariance = DMatrix::from_fn(size, size, |k, l| covariance[(row[k], row[l])] * scale(k) * scale(l));
        // Unit diagonal, since units of entries differ.
        let error = covariance.diagonal().map(|variance| variance.max(f64::MIN_POSITIVE).sqrt());
        let unit = DMatrix::from_fn(size, size, |k, l| covariance[(k, l)] / (error[k] * error[l]));
        let inverse = unit.try_inverse()?;
        let limit = chi_squared(0.99, size);
        let fits = |candidate: &[f64]| {
            let is_sure = candidate.iter().zip(error.iter()).all(|(entry, error)| *entry == 0.0 || *error < KINEMATIC);
            let off = DVector::from_fn(size, |k, _| (estimate[k] - candidate[k]) / error[k]);
            let distance = off.dot(&(&inverse * &off));
            (is_sure && distance < limit).then_some(distance)
        };
        let all = candidates(size, i).into_iter().filter_map(|candidate| Some((fits(&candidate)?, candidate)));
        let (_, best) = all.min_by(|p, q| p.0.total_cmp(&q.0))?;
        let off = (0..size).filter(|k| best[*k] != 0.0).map(|k| (estimate[k] - best[k]).abs());
        let off = off.fold(0.0, f64::max);
        Some((best, off))
    }

    /// Findings of the information and of the factors for coloured residuals.
    pub fn information(&self, poles: &[Pole], h: f64, most: f64, findings: &mut Vec<Finding>) {
        if self.uncertainty.condition > most {
            let fast = poles.iter().filter(|pole| pole.imaginary >= 0.0 && pole.frequency() > FAST / h);
            let fast: Vec<String> =
                fast.map(|pole| format!("pole {} is faster than this record shows", pole_text(pole))).collect();
            let why = if fast.is_empty() { "the unknowns can't be distinguished".to_owned() } else { fast.join("; ") };
            let condition = number(self.uncertainty.condition);
            let text = format!("the information of the record has the condition number {condition}: {why}");
            findings.push(Finding::not_sound(Kind::IllConditioned, text));
        }
        let largest = self.uncertainty.kappa.iter().copied().fold(1.0, f64::max);
        if largest > COLOURED {
            let text = format!("coloured residuals: standard errors are enlarged up to {} times", number(largest));
            findings.push(Finding::note(Kind::ColouredResiduals, text));
        }
    }
}

/// Rows with one or two entries of 1 or −1, none of them on the diagonal.
fn candidates(size: usize, diagonal: usize) -> Vec<Vec<f64>> {
    let places: Vec<usize> = (0..size).filter(|k| *k != diagonal).collect();
    let mut all = Vec::new();
    for (at, &k) in places.iter().enumerate() {
        for sign in [1.0, -1.0] {
            let mut row = vec![0.0; size];
            row[k] = sign;
            for &l in &places[at + 1..] {
                for other in [1.0, -1.0] {
                    let mut two = row.clone();
                    two[l] = other;
                    all.push(two);
                }
            }
            all.push(row);
        }
    }
    all
}

/// A pole for people.
pub(crate) fn pole_text(pole: &Pole) -> String {
    if pole.imaginary == 0.0 {
        return number(pole.real);
    }
    format!("{} ± {}j", number(pole.real), number(pole.imaginary.abs()))
}

/// Unstable poles that aren't sure: by their standard errors, or by the other predictor.
pub(crate) fn unstable(poles: &[Pole], others: Option<&[Pole]>, duration: f64, findings: &mut Vec<Finding>) {
    // A pole that can't be distinguished from 0 is an integrator.
    let counts = |pole: &&Pole| pole.real > 0.0 && pole.imaginary >= 0.0 && pole.frequency() * duration > 1.0;
    for pole in poles.iter().filter(counts) {
        let amount = pole.frequency();
        let error = pole.covariance[0].max(pole.covariance[1]).max(0.0).sqrt();
        let apart = others.map(|others| {
            let distance = |other: &Pole| (other.real - pole.real).hypot(other.imaginary - pole.imaginary);
            others.iter().map(distance).fold(f64::INFINITY, f64::min)
        });
        let text = if error > UNSTABLE * amount {
            format!("unstable pole {}: its standard error is {} %", pole_text(pole), number(100.0 * error / amount))
        } else if let Some(apart) = apart.filter(|apart| *apart > UNSTABLE * amount) {
            let share = number(100.0 * apart / amount);
            format!("unstable pole {}: output error and innovation form differ by {share} %", pole_text(pole))
        } else {
            continue;
        };
        let text = format!("{text}; at most 5 % are needed. Record longer, or add more to the input");
        findings.push(Finding::not_sound(Kind::UnstablePole, text));
    }
}

/// A record that is short for the slowest pole.
pub(crate) fn duration(poles: &[Pole], duration: f64, findings: &mut Vec<Finding>) {
    let is_sure = |pole: &&Pole| pole.real < 0.0 && -pole.real > 2.0 * pole.error();
    let Some(slowest) = poles.iter().filter(is_sure).map(|pole| -pole.real).min_by(f64::total_cmp) else { return };
    if duration * slowest < TIME_CONSTANTS {
        let text = format!(
            "{} s of record are {} of the slowest time constant, {} s; at least 3 are needed",
            number(duration),
            number(duration * slowest),
            number(1.0 / slowest)
        );
        findings.push(Finding::warning(Kind::ShortRecord, text));
    }
}

/// Refuses a model that doesn't follow the held-out part though its residuals aren't noise.
pub(crate) fn refuse_not_followed(
    fits: Option<&HeldOut>,
    (noise, whiteness): (&[f64], &[f64]),
    names: &Names,
    what: &str,
    question: &str,
) -> Result<(), Refusal> {
    let Some((signal, best)) = fits.and_then(|fits| fits.not_followed(noise, whiteness)) else { return Ok(()) };
    let text = format!(
        "no model of these {what} follows the record (best: {} % of the held-out motion of {}): {question}",
        number(best),
        names.signals.measured[signal]
    );
    Err(Refusal::new(Cause::NoModel, text))
}

/// Fits of the part that was estimated from below half of its motion, and of the held-out part below half of what noise leaves.
pub(crate) fn fits(held_out: Option<&HeldOut>, own: Option<&HeldOut>, names: &Names, findings: &mut Vec<Finding>) {
    for (i, name) in names.signals.measured.iter().enumerate() {
        let explained = own.map_or(100.0, |own| own.fit(i));
        if explained < LEAST_EXPLAINED {
            let text = format!("{name}: the model explains {} % of its motion", number(explained));
            findings.push(Finding::not_sound(Kind::HeldOutFit, text));
            continue;
        }
        let Some(held_out) = held_out else { continue };
        let fit = held_out.fit(i);
        if !held_out.is_judged[i] {
            let why =
                if held_out.deviation[i].is_nan() { "has no values" } else { "moves by less than twice its noise" };
            let text = format!("{name} {why} in the held-out part: its fit isn't judged");
            findings.push(Finding::note(Kind::HeldOutStill, text));
        } else if fit < 0.5 * held_out.ceiling[i] {
            let text = format!(
                "{name}: the model follows {} % of its held-out motion; the noise would allow {} %",
                number(fit),
                number(held_out.ceiling[i])
            );
            findings.push(Finding::not_sound(Kind::HeldOutFit, text));
        }
    }
}

/// An input that acts later than it is recorded: the innovation form's residuals follow it at later lags only.
pub(crate) fn delays(
    residuals: &Residuals,
    data: &Data,
    (names, given): (&Names, &[f64]),
    findings: &mut Vec<Finding>,
) {
    let limit = chi_squared(1.0 - BY_CHANCE / (LAGS * data.n) as f64, 1).sqrt();
    for j in 0..data.m {
        let most = |sign: i64| {
            let at = |lag: i64| {
                let all = (0..data.n).map(|i| residuals.correlation(data, i, j, sign * lag).abs());
                (all.fold(0.0, f64::max), lag)
            };
            (1..=LAGS as i64).map(at).max_by(|p, q| p.0.total_cmp(&q.0)).unwrap_or_default()
        };
        let ((correlation, lag), (before, _)) = (most(1), most(-1));
        if correlation <= limit || before >= limit {
            continue;
        }
        // What follows an input goes on for long: the lag itself isn't the delay.
        let further = further_delay(data, j, LAGS) as f64 * data.scaling.h;
        let advice = if further > 0.0 {
            format!("Try a delay of {} s", number(given.get(j).unwrap_or(&0.0) + further))
        } else {
            "It is less than a step".to_owned()
        };
        let text = format!(
            "{} shows in the residuals {lag} rows later ({} σ): does it act later than recorded? {advice}",
            names.signals.inputs[j],
            number(correlation)
        );
        findings.push(Finding::warning(Kind::Delay, text));
    }
}
