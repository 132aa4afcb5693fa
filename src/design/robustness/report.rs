//! Design report of a law with the plant that it was designed for.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::DMatrix;

use super::assumed::Assumed;
use super::linear::LinearLaw;
use super::pictures::Shown;
use super::place::Place;
use super::region::Region;
use super::uncertain::Uncertain;
use super::worst::Stepped;
use crate::design::{digits, limits, percent};
use crate::eigenvalues;
use crate::mathematics::limits::UNLIMITED;
use crate::nominal::{NominalPlant, WorstPlant};
use crate::system::{DesignReport, Verdict};
use crate::template::three_digits;

/// Outputs that end farther from their references, in parts of these, are worth a word.
const FAR: f64 = 0.01;

/// A plant that a description has, as a design report looks at it.
#[derive(Debug)]
pub struct Described {
    /// Its entries and their bounds.
    pub plant: Uncertain,
    /// Their assumed uncertainty.
    pub assumed: Assumed,
    /// Sizes of the references.
    pub reference: Vec<f64>,
    /// Number of plants to be drawn, and the seed.
    pub drawn: (usize, u64),
}

/// Controls of a unit, and its step.
#[derive(Debug)]
pub struct Unit<'a> {
    /// Names of the controls.
    pub controls: Vec<String>,
    /// Limits of the controls.
    pub limits: [&'a [f64]; 2],
    /// Communication step, s.
    pub step: f64,
}

impl Unit<'_> {
    /// ", peak of voltage 10.2 of 24"
    pub fn peaks(&self, ranges: &[[f64; 2]]) -> String {
        let peaks = ranges.iter().enumerate().map(|(j, &[low, high])| {
            let (peak, limit) = if high >= -low { (high, self.limits[1][j]) } else { (low, self.limits[0][j]) };
            let of = if limit.abs() < UNLIMITED { format!(" of {}", digits(limit)) } else { String::new() };
            format!(", peak of {} {}{of}", self.controls[j], digits(peak))
        });
        peaks.collect()
    }
}

impl Described {
    /// The plant of a description for a law of so many references; `None` where it has other sizes, or numbers that differ by too
    /// many powers of ten.
    pub fn new(nominal: &NominalPlant, channels: usize) -> Option<Self> {
        let NominalPlant { A, B, C, delay, bandwidth, reference, uncertainty, plants, seed } = nominal;
        if C.nrows() != channels || B.ncols() != channels {
            return None;
        }
        let assumed = Assumed::new(A, B, uncertainty);
        let fastest = || {
            let poles = eigenvalues::complex(A)?;
            let fastest = poles.iter().map(|pole| pole.norm()).fold(0.0, f64::max);
            Some(if fastest > 0.0 { fastest } else { 1.0 })
        };
        let bandwidth = bandwidth.or_else(fastest)?;
        let plant = Uncertain::new([A, B, C], &assumed.bounds, delay, bandwidth)?;
        let reference = reference.clone().unwrap_or_else(|| vec![1.0; channels]);
        Some(Described { plant, assumed, reference, drawn: (*plants, *seed) })
    }

    /// Reports steps of the references, for the nominal plant and the worst of the region, and sums it up. Where a loop
    /// isn't stable it is judged so.
    pub fn report(&self, law: &impl LinearLaw, region: &Region, unit: &Unit, report: &mut DesignReport) {
        let W = self.plant.bandwidth;
        report.section("Nominal loop");
        let closed = law.parts().delayed(&self.plant.delays).closed(&self.plant.A, &self.plant.B) * W;
        report.eigenvalues("poles", &closed, true);
        let plant = self.plant.with_later_controls(unit.step * W);
        let Some(nominal) = Stepped::nominal(law, &plant, &self.reference) else {
            return report.summarise("the loop isn't stable".to_owned());
        };
        self.report_steps(&nominal, Verdict::Warning, unit, report);
        let (summary, worst) = self.report_region(&nominal, law, (region, &plant), unit, report);
        report.summarise(summary);
        let settling = worst.iter().map(|(stepped, _)| stepped.settling).fold(nominal.settling, f64::max);
        let mut places = worst.map_or_else(Vec::new, |(_, places)| places);
        places.dedup();
        Shown { described: self, parts: law.parts(), unit, worst: places, settling }.add(report);
    }

    /// The steps of uncertain plants, where they are known: the summary, and the worst with their numbers.
    fn report_region(
        &self,
        nominal: &Stepped,
        law: &impl LinearLaw,
        (region, plant): (&Region, &Uncertain),
        unit: &Unit,
        report: &mut DesignReport,
    ) -> (String, Option<(Stepped, Vec<Place>)>) {
        let of_nominal = self.words(nominal, unit);
        if !self.assumed.is_known() {
            return (of_nominal, None);
        }
        report_number(region.places(), report);
        let Some((worst, places)) = Stepped::worst(law, plant, region.places(), &self.reference) else {
            return (format!("{of_nominal}; some plants within the uncertainty are not stable"), None);
        };
        self.report_steps(&worst, Verdict::Ok, unit, report);
        report.worst = self.worst_plants(&places, &["settling time", "overshoot"], unit);
        let more = self.words(&worst, unit);
        (format!("{of_nominal}; worst of {} plants: {more}", region.places().len()), Some((worst, places)))
    }

    /// The plants at these places, each once: the worst in these respects, and in those of the controls.
    pub fn worst_plants(&self, places: &[Place], respects: &[&str], unit: &Unit) -> Vec<WorstPlant> {
        let of_controls =
            unit.controls.iter().flat_map(|control| ["largest", "smallest"].map(|size| format!("{size} {control}")));
        let respects = respects.iter().map(|respect| (*respect).to_owned()).chain(of_controls);
        let mut plants: Vec<(&Place, WorstPlant)> = Vec::new();
        for (respect, place) in respects.zip(places) {
            if let Some((_, plant)) = plants.iter_mut().find(|(other, _)| *other == place) {
                plant.respects.push(respect);
                continue;
            }
            let [A, B] = self.plant.in_file(place).map(|matrix| lists(&matrix));
            plants.push((place, WorstPlant { respects: vec![respect], A, B }));
        }
        plants.into_iter().map(|(_, plant)| plant).collect()
    }

    /// "settles in 0.12 s, overshoot 4 %, peak of voltage 10.2 of 24"
    fn words(&self, stepped: &Stepped, unit: &Unit) -> String {
        let settling = stepped.settling / self.plant.bandwidth;
        let rests = if stepped.off > FAR {
            format!(", ends {} % from the reference", percent(100.0 * stepped.off))
        } else {
            String::new()
        };
        format!(
            "settles in {} s, overshoot {} %{rests}{}",
            digits(settling),
            percent(100.0 * stepped.overshoot.max(0.0)),
            unit.peaks(&stepped.control)
        )
    }

    /// The figures of steps; what the nominal plant has is judged, the worst of others is what it is.
    fn report_steps(&self, stepped: &Stepped, if_wrong: Verdict, unit: &Unit, report: &mut DesignReport) {
        let W = self.plant.bandwidth;
        let each = if unit.controls.len() > 1 { ", one reference at a time" } else { "" };
        let note = format!("of a step of the reference{each}: from 10 % to 90 %");
        report.add("rise time", three_digits(stepped.rise / W), "s", &note);
        let settling = three_digits(stepped.settling / W);
        let note = format!("until within {} % of the step about its end", digits(100.0 * stepped.band));
        report.add("settling time", settling, "s", &note);
        // What rounding leaves is none.
        let overshoot = if stepped.overshoot > 1e-6 { three_digits(100.0 * stepped.overshoot) } else { 0.0 };
        report.add("overshoot", overshoot, "%", "beyond the reference");
        if stepped.undershoot > 1e-3 {
            report.add("undershoot", three_digits(100.0 * stepped.undershoot), "%", "the wrong way first");
        }
        if stepped.off > 1e-3 {
            let (verdict, note) = match if_wrong {
                Verdict::Warning if stepped.off > FAR => {
                    (Verdict::Warning, "distance from the reference: without an integral part an error stays")
                }
                _ => (Verdict::Ok, "distance from the reference"),
            };
            report.judge("at rest", three_digits(100.0 * stepped.off), "%", verdict, note);
        }
        self.report_ranges(&stepped.control, if_wrong, unit, report);
    }

    /// The range of each control, judged where it is beyond the limits.
    pub fn report_ranges(&self, ranges: &[[f64; 2]], if_wrong: Verdict, unit: &Unit, report: &mut DesignReport) {
        ranges.iter().enumerate().for_each(|(j, range)| self.report_range(j, *range, if_wrong, unit, report));
    }

    fn report_range(&self, j: usize, range: [f64; 2], if_wrong: Verdict, unit: &Unit, report: &mut DesignReport) {
        let limit = unit.limits.map(|limit| limit[j]);
        let [low, high] = limits::without_rounding(range).map(three_digits);
        let (name, value) = (format!("range of {}", unit.controls[j]), DMatrix::from_row_slice(1, 2, &[low, high]));
        let sizes = self.reference.iter().copied().map(digits).collect::<Vec<_>>().join(", ");
        if !limits::is_beyond(range, limit) {
            return report.add(&name, &value, "", &format!("for a step of {sizes}"));
        }
        let allowed = 0.995 * limits::allowed(range, limit);
        let smaller = self.reference.iter().map(|size| digits(size * allowed)).collect::<Vec<_>>().join(", ");
        let stays = if allowed > 0.0 {
            format!("A step of {smaller} stays within")
        } else {
            "Use a lower bandwidth".to_owned()
        };
        let note = format!(
            "for a step of {sizes}, beyond the limits {} … {}: the loop is then slower than reported here, and an unstable plant may \
             run away. {stays}",
            digits(limit[0]),
            digits(limit[1])
        );
        report.judge(&name, &value, "", if_wrong, note);
    }
}

/// Rows of numbers.
fn lists(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

/// Begins what is found of uncertain plants.
pub fn report_number(places: &[Place], report: &mut DesignReport) {
    report.section("Uncertain plants");
    let note = "the nominal one, extreme ones of the uncertainty, and others within it";
    report.add("plants tried", places.len() as f64, "", note);
}
