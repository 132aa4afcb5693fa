//! Pictures of a linear loop: steps of the references, controls with their limits, the loop gain, and poles.
#![allow(non_snake_case)] // matrices have the names of the field

use nalgebra::{Complex, DMatrix};

use super::linear::Parts;
use super::place::Place;
use super::report::{Described, Unit};
use crate::design::nominal::poles_of;
use crate::design::response::{Response, logarithmic};
use crate::design::step::exponential;
use crate::mathematics::limits::UNLIMITED;
use crate::picture::{Curve, CurveOf, Picture};
use crate::report::DesignReport;

/// Points of a step, and of a frequency response.
const POINTS: usize = 240;
/// Steps are shown for so many settling times.
const SHOWN: f64 = 1.25;
/// References of which steps are shown.
const MOST_REFERENCES: usize = 3;
/// Frequencies: so far below the slowest pole and above the fastest, but not farther from W than this.
const BEYOND: f64 = 10.0;
const FARTHEST: f64 = 1e3;

/// A loop that is shown.
pub struct Shown<'a> {
    /// The plant, and what is asked for.
    pub described: &'a Described,
    /// The loop without dead times.
    pub parts: Parts,
    /// Controls and their limits.
    pub unit: &'a Unit<'a>,
    /// Plants within the uncertainty that are shown with the nominal one.
    pub worst: Vec<Place>,
    /// Longest settling time, in 1/W.
    pub settling: f64,
}

impl Shown<'_> {
    /// Adds its pictures to a report.
    pub fn add(&self, report: &mut DesignReport) {
        for i in 0..self.described.reference.len().min(MOST_REFERENCES) {
            report.pictures.extend(self.step(i).into_iter().flatten());
        }
        report.pictures.extend(self.gain().into_iter().flatten());
        report.pictures.extend(self.poles());
    }

    fn several(&self) -> bool {
        self.described.reference.len() > 1
    }

    /// "output 2" of several.
    fn numbered(&self, what: &str, i: usize) -> String {
        if self.several() { format!("{what} {}", i + 1) } else { what.to_owned() }
    }

    /// Outputs and controls while a reference steps.
    fn step(&self, i: usize) -> Option<[Picture; 2]> {
        let (m, W) = (self.unit.controls.len(), self.described.plant.bandwidth);
        let duration = if self.settling > 0.0 { SHOWN * self.settling } else { 1.0 };
        let places = self.worst.iter().map(|place| (place, CurveOf::Worst));
        let nominal = Place::nominal(self.described.plant.size());
        let (mut outputs, mut controls) = (Vec::new(), Vec::new());
        for (place, of) in places.chain([(&nominal, CurveOf::Nominal)]) {
            let signals = self.course(i, place, duration)?;
            for (k, points) in signals.into_iter().enumerate() {
                let name = if k < m { self.numbered("output", k) } else { self.unit.controls[k - m].clone() };
                let curve = Curve { name, of, points };
                if k < m { &mut outputs } else { &mut controls }.push(curve);
            }
        }
        let end = duration / W;
        let level =
            |name: String, value: f64| Curve { name, of: CurveOf::Bound, points: vec![[0.0, value], [end, value]] };
        outputs.push(level(self.numbered("reference", i), self.described.reference[i]));
        let limits = self.unit.limits.iter().flat_map(|limits| limits.iter().zip(&self.unit.controls));
        let near = limits.filter(|(limit, _)| limit.abs() < UNLIMITED);
        controls.extend(near.map(|(limit, control)| level(format!("limit of {control}"), *limit)));
        let x = "time in s".to_owned();
        let title = format!("Step of {}", self.numbered("the reference", i).replace("the reference ", "reference "));
        let picture = |title: String, y: &str, curves| Picture {
            title,
            x: x.clone(),
            y: y.to_owned(),
            logarithmic: false,
            curves,
        };
        Some([picture(title.clone(), "outputs", outputs), picture(format!("{title}: controls"), "controls", controls)])
    }

    /// All outputs and controls over time, s, of a step of a reference with a plant; `None` where the loop isn't stable.
    fn course(&self, i: usize, place: &Place, duration: f64) -> Option<Vec<Vec<[f64; 2]>>> {
        let (plant, sizes) = (&self.described.plant, &self.described.reference);
        let [A_t, B_t] = plant.at(place);
        let parts = self.parts.delayed(&plant.delays).for_references(sizes);
        let (closed, driven) = (parts.closed(&A_t, &B_t), parts.driven(&B_t).column(i).into_owned());
        let rest = -closed.clone().lu().solve(&driven)?;
        let step = exponential(&closed * (duration / POINTS as f64))?;
        // Before dead times, whose states are the last ones.
        let own = self.parts.control.ncols();
        let direct = self.parts.direct.column(i) * sizes[i];
        let mut left = -&rest;
        let mut signals = vec![Vec::with_capacity(POINTS + 1); plant.C.nrows() + direct.len()];
        for k in 0..=POINTS {
            let now = &rest + &left;
            let time = k as f64 / POINTS as f64 * duration / plant.bandwidth;
            let u = &self.parts.control * now.rows(0, own) + &direct;
            let y = &plant.C * now.rows(0, plant.C.ncols());
            for (points, value) in signals.iter_mut().zip(y.iter().chain(u.iter())) {
                points.push([short(time), short(*value)]);
            }
            left = &step * left;
        }
        signals.iter().flatten().all(|[_, value]| value.is_finite()).then_some(signals)
    }

    /// The gain of the loop that is open at a control, the others closed: size and phase.
    fn gain(&self) -> Option<[Picture; 2]> {
        let plant = &self.described.plant;
        let own = poles_of(&self.parts.closed(&plant.A, &plant.B))?;
        let all: Vec<_> = own.iter().chain(&poles_of(&plant.A)?).map(|pole| pole.norm()).collect();
        let slowest = all.iter().copied().filter(|size| *size > 0.0).fold(1.0, f64::min) / BEYOND;
        let fastest = all.iter().copied().fold(1.0, f64::max) * BEYOND;
        let frequencies = logarithmic(slowest.max(1.0 / FARTHEST), fastest.min(FARTHEST), POINTS);
        let open = Parts { control: DMatrix::zeros(plant.B.ncols(), self.parts.control.ncols()), ..self.parts.clone() };
        let A = open.closed(&plant.A, &plant.B);
        let loop_ = Response::new(&A, &(&self.parts.entry * &plant.B), &-&self.parts.control, &plant.delays);
        let mut sizes = vec![Vec::new(); self.unit.controls.len()];
        let mut phases = vec![Vec::<[f64; 2]>::new(); sizes.len()];
        for omega in frequencies {
            let Some(alone) = alone(loop_.at(omega)) else { continue };
            for (j, gain) in alone.into_iter().enumerate() {
                let last = phases[j].last().map_or(-180.0, |[_, phase]| *phase);
                let phase = last + (gain.arg().to_degrees() - last + 180.0).rem_euclid(360.0) - 180.0;
                sizes[j].push([short(omega * plant.bandwidth), short(20.0 * gain.norm().log10())]);
                phases[j].push([short(omega * plant.bandwidth), short(phase)]);
            }
        }
        let picture = |title: &str, y: &str, level: f64, curves: Vec<Vec<[f64; 2]>>| {
            let ends = curves.first().and_then(|points| Some([points.first()?[0], points.last()?[0]]));
            let named = curves.into_iter().zip(&self.unit.controls);
            let curve = |(points, name): (_, &String)| Curve { name: name.clone(), of: CurveOf::Nominal, points };
            let bound = ends.map(|ends| Curve {
                name: format!("{level} {y}"),
                of: CurveOf::Bound,
                points: ends.iter().map(|&at| [at, level]).collect(),
            });
            let curves = named.map(curve).chain(bound).collect();
            Picture {
                title: title.to_owned(),
                x: "frequency in rad/s".to_owned(),
                y: y.to_owned(),
                logarithmic: true,
                curves,
            }
        };
        Some([
            picture("Loop gain, open at a control", "dB", 0.0, sizes),
            picture("Phase of the loop gain", "deg", -180.0, phases),
        ])
    }

    /// Poles of the loop, above the real axis.
    fn poles(&self) -> Option<Picture> {
        let plant = &self.described.plant;
        let parts = self.parts.delayed(&plant.delays);
        let of = |place: &Place| {
            let [A_t, B_t] = plant.at(place);
            let poles = poles_of(&parts.closed(&A_t, &B_t))?;
            let upper = poles.into_iter().filter(|pole| pole.im >= 0.0).map(|pole| pole * plant.bandwidth);
            Some(upper.map(|pole| [short(pole.re), short(pole.im)]).collect())
        };
        let marks = |name: &str, of, points| Curve { name: name.to_owned(), of, points };
        let worst = self.worst.iter().map(|place| Some(marks("worst plant", CurveOf::WorstMarks, of(place)?)));
        let mut curves = worst.collect::<Option<Vec<_>>>()?;
        curves.push(marks("nominal plant", CurveOf::Marks, of(&Place::nominal(plant.size()))?));
        let (x, y) = ("real part in 1/s".to_owned(), "imaginary part in rad/s".to_owned());
        Some(Picture { title: "Poles of the loop".to_owned(), x, y, logarithmic: false, curves })
    }
}

/// The gain of each loop by itself, the others closed: 1/[(I + L)⁻¹]ᵢᵢ − 1.
fn alone(gain: DMatrix<Complex<f64>>) -> Option<Vec<Complex<f64>>> {
    let m = gain.nrows();
    let S = (gain + DMatrix::identity(m, m)).try_inverse()?;
    let all: Vec<_> = S.diagonal().iter().map(|own| own.inv() - 1.0).collect();
    all.iter().all(|gain| gain.re.is_finite() && gain.im.is_finite() && gain.norm() > 0.0).then_some(all)
}

/// A number of a picture needs no more digits.
fn short(value: f64) -> f64 {
    format!("{:.*e}", 4, value).parse().unwrap_or(value)
}
