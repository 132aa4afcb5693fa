//! Assessment of an L1 design for the plants within the bounds of their entries.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::closed::Law;
use super::lambda::{MOST_LAMBDA, lambda};
use crate::design::robustness::assumed::Assumed;
use crate::design::robustness::linear::LinearLaw;
use crate::design::robustness::region::{Region, largest};
use crate::design::robustness::respond::{Course, SETTLED};
use crate::design::robustness::uncertain::Uncertain;
use crate::design::step::Step;
use crate::design::{digits, percent};
use crate::system::Verdict;

/// The part of the plants of a region that rests nearer to the reference than what is reported.
const MOST_PLANTS: f64 = 0.95;
/// Plants that rest farther from the reference are worth a remark.
const MOST_OFF: f64 = 0.05;

/// Assessment for the plants within the bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// λ*; `None` where it isn't computed, for so many states.
    pub lambda: Option<f64>,
    /// The share of the bounds up to which λ* proves stability.
    pub proved: Option<f64>,
    /// True if each plant that was tried is stable.
    pub is_stable: bool,
    /// The share of the bounds up to which each is.
    pub stable: f64,
    /// Number of plants that were tried, and of those drawn by their density.
    pub plants: usize,
    /// See `plants`.
    pub likely: usize,
    /// Distance from the reference at rest of nearly all plants, in parts of it.
    pub off_at_rest: f64,
    /// True if the sign of the plant's gain differs within the bounds.
    pub is_turned: bool,
}

/// Assessment for a region with a step H, in 1/W. `excess` is Ē, what of the rates the states are uncertain in, and `most` the
/// largest share of the bounds that is looked at.
pub fn assess(plant: &Uncertain, law: &Law, region: &Region, excess: &DMatrix<f64>, H: f64, most: f64) -> Found {
    let of_bounds = |share: f64| lambda(&plant.with_bounds_times(share), law, &(excess * share));
    let parts = law.parts();
    let (mut off, mut signs) = (Vec::new(), Vec::new());
    for place in region.places() {
        let [A_t, B_t] = plant.at(place);
        let rest = parts.closed(&A_t, &B_t).lu().solve(&parts.reference);
        let of_channel = |rest: &DMatrix<f64>| {
            let y = -(&plant.C * rest.rows(0, A_t.nrows()));
            (0..y.nrows()).map(|i| (y[(i, i)] - 1.0).abs()).fold(0.0, f64::max)
        };
        off.push(rest.as_ref().map_or(f64::INFINITY, of_channel));
        signs.push(sign_at_rest(&A_t, &B_t, &plant.C));
    }
    let is_turned = signs.iter().any(|sign| *sign != signs[0]);
    off.sort_by(f64::total_cmp);
    let lambda = of_bounds(1.0);
    let is_proved = |share: f64| of_bounds(share).is_none_or(|lambda| lambda <= MOST_LAMBDA);
    Found {
        lambda,
        proved: lambda.map(|_| largest(most, is_proved)),
        is_stable: region.is_stable(plant, law, H),
        stable: region.largest_share(plant, law, H, most),
        plants: region.places().len(),
        likely: region.likely(),
        off_at_rest: off[((off.len() - 1) as f64 * MOST_PLANTS) as usize],
        is_turned,
    }
}

/// The sign of det [A, B; C, 0]: with the other one no integral control is stable.
fn sign_at_rest(A: &DMatrix<f64>, B: &DMatrix<f64>, C: &DMatrix<f64>) -> f64 {
    let (n, m) = B.shape();
    let mut whole = DMatrix::zeros(n + m, n + m);
    whole.view_mut((0, 0), (n, n)).copy_from(A);
    whole.view_mut((0, n), (n, m)).copy_from(B);
    whole.view_mut((n, 0), (m, n)).copy_from(C);
    let lu = whole.lu();
    // Pivot by pivot: their product may overflow.
    lu.u().diagonal().iter().fold(lu.p().determinant::<f64>(), |sign, pivot| sign * pivot.signum())
}

/// Steps of all references of the nominal loop; `None` where it isn't stable.
pub fn steps(plant: &Uncertain, law: &Law) -> Option<Vec<Step>> {
    let parts = law.parts();
    let nominal = [plant.A.clone(), plant.B.clone()];
    let m = plant.B.ncols();
    let courses = parts.delayed(&plant.delays).steps(&nominal, &plant.C, &parts, SETTLED)?;
    let one = |(i, courses): (usize, Vec<Course>)| {
        let control = courses[m..].iter().map(|course| course.range).collect();
        let output = &courses[i];
        Step { overshoot: output.range[1] - output.end, settling: Some(output.settling), control }
    };
    Some(courses.into_iter().enumerate().map(one).collect())
}

impl Found {
    /// Verdict on the design for what was assumed, and its reason.
    pub fn verdict(&self, assumed: &Assumed) -> (Verdict, String) {
        let asked = assumed.whole();
        if self.plants == 1 {
            return if self.is_stable {
                (Verdict::Ok, "nothing is uncertain, and the nominal loop is stable".to_owned())
            } else {
                (Verdict::NotSound, "the nominal loop isn't stable".to_owned())
            };
        }
        let turned = if self.is_turned {
            " Within these bounds the sign of the plant's gain at rest changes: no controller with an integral part (`pid` and \
             `ladrc` neither) is stable for all of them."
        } else {
            ""
        };
        if !self.is_stable {
            let smaller = match self.stable {
                0.0 => "no smaller uncertainty was found with which all are".to_owned(),
                stable => format!("with {} all of them are", assumed.share(stable)),
            };
            let text = format!(
                "with {asked} some plants are not stable; {smaller}: give {}, or a plant that is better known.{turned}",
                assumed.option()
            );
            return (Verdict::NotSound, text);
        }
        let tried = format!("stable for each of {} plants tried with {asked}", self.plants);
        let others = assumed.others(self.likely);
        let Some((lambda, proved)) = self.lambda.zip(self.proved) else {
            return (Verdict::Warning, format!("{tried}.{others} Nothing is proved for so many states.{turned}"));
        };
        if lambda <= MOST_LAMBDA {
            let proved = assumed.share(proved);
            let text = format!("{tried}, and proved to stay so while the plant changes within {proved}.{others}");
            return (Verdict::Ok, text);
        }
        let text = format!(
            "{tried}, as they stand (λ* = {}).{others} Proved while the plant changes within {}.{turned}",
            digits(lambda),
            assumed.share(proved)
        );
        (Verdict::Warning, text)
    }

    /// A limit of L1 control: it doesn't bring plants to rest at the reference that differ from the nominal one where no input acts.
    pub fn at_rest(&self) -> Option<String> {
        (self.is_stable && self.off_at_rest > MOST_OFF).then(|| {
            format!(
                "L1 control cancels what enters at the inputs. Where the plant differs elsewhere the output at rest may differ by up to \
                 {} % of the reference, for 95 % of the plants: `pid` or `ladrc` bring it back, or estimates of unmatched uncertainty",
                percent(100.0 * self.off_at_rest)
            )
        })
    }
}
