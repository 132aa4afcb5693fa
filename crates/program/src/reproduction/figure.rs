//! Figures: curves over time, also in their funnel, lines by numbers, and paths in space.

use std::borrow::Cow;

use serde::Deserialize;

use super::outcome::{Outcome, Samples};
use super::{Curve, Example, Run};
use crate::figures::{Diagram, Given, Part, Path, Shown, bound, figure, labelled, space, time_label};
use crate::structure::{PerformanceFunction, Plot, Scale, Structure};
use crate::text_file::csv_field;

/// Default names of the axes of paths.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Points of a drawn funnel.
const STEPS: usize = 400;

/// A figure as described in a study.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// The same figures in the thesis, as `3.2`; empty if there are none.
    pub thesis: String,
    /// Curves over time.
    pub curves: Vec<Curve>,
    /// ρ_0, ρ_∞ and the rate of decay of the funnel around 0. With it, magnitudes are shown on a logarithmic axis.
    pub funnel: Option<[f64; 3]>,
    /// Paths in space: the three coordinates of each.
    pub paths: Vec<[Curve; 3]>,
    /// Names of the axes of paths.
    pub axes: Option<[String; 3]>,
    /// True if the third axis of paths points down.
    pub down: bool,
    /// Lines through points.
    pub lines: Vec<Line>,
    /// Words at the axes of lines.
    pub x: String,
    /// Words at the axes of lines.
    pub y: String,
    /// Parts of its curves or paths; none before a structure is known.
    #[serde(skip)]
    parts: Vec<Part>,
    #[serde(skip)]
    scale: Scale,
}

/// A line through points.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// Abscissas of its points [default: 1, 2, …].
    #[serde(default)]
    pub x: Vec<Coordinate>,
    /// Their values.
    pub y: Vec<f64>,
}

/// A number, or the start value of a variable of a run.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Coordinate {
    /// A number.
    Number(f64),
    /// A variable.
    Of(Curve),
}

/// A figure, drawn.
#[derive(Debug)]
pub struct Drawing {
    /// Name of its files.
    pub name: String,
    /// Title.
    pub title: String,
    /// The same figures in the thesis.
    pub thesis: String,
    /// The picture.
    pub svg: String,
    /// Its curves: name, time in s, value.
    pub csv: String,
}

impl Figure {
    /// The figures of an example: those of its loops, with the structures of its runs, then its own.
    pub fn all(example: &Example, structures: &[Structure]) -> Vec<Self> {
        let runs = || example.run.iter().zip(structures);
        let of_loops = runs().flat_map(|(run, structure)| {
            let plots = structure.plots.iter();
            plots.map(|plot| Figure::of_plot(run, structure, plot, example.run.len() == 1)).collect::<Vec<_>>()
        });
        let own = example.figure.iter().map(|figure| {
            let structure = |key: &str| runs().find(|(run, _)| run.key() == key).map(|(_, structure)| structure);
            Figure { parts: figure.parts_by(structure), ..figure.clone() }
        });
        let mut figures: Vec<Figure> = of_loops.chain(own).collect();
        for figure in &mut figures {
            if let Some(thesis) = example.thesis_figures.get(&figure.title) {
                figure.thesis.clone_from(thesis);
            }
        }
        figures
    }

    fn of_plot(run: &Run, structure: &Structure, plot: &Plot, alone: bool) -> Self {
        let key = run.key();
        Figure {
            title: if alone { plot.title.clone() } else { format!("{key}: {}", plot.title) },
            curves: plot.signals.iter().map(|of| Curve { run: key.clone(), of: of.clone(), minus: None }).collect(),
            parts: structure.parts(plot),
            scale: plot.scale,
            ..Figure::default()
        }
    }

    /// Parts of its curves or paths, from the loop of the first run.
    fn parts_by<'a>(&self, structure: impl Fn(&str) -> Option<&'a Structure>) -> Vec<Part> {
        let shown: Vec<&Curve> = if self.paths.is_empty() {
            self.curves.iter().collect()
        } else {
            self.paths.iter().map(|[x, ..]| x).collect()
        };
        let own = vec![Part::Own; shown.len()];
        let Some(structure) = shown.first().and_then(|curve| structure(&curve.run)) else { return own };
        if shown.iter().any(|curve| curve.run != shown[0].run || curve.minus.is_some()) {
            return own;
        }
        structure.parts(&Plot { signals: shown.iter().map(|curve| curve.of.clone()).collect(), ..Plot::default() })
    }

    /// All curves that it needs.
    pub fn needs(&self) -> impl Iterator<Item = &Curve> {
        let coordinates = self.lines.iter().flat_map(|line| &line.x).filter_map(|coordinate| match coordinate {
            Coordinate::Of(curve) => Some(curve),
            Coordinate::Number(_) => None,
        });
        self.curves.iter().chain(self.paths.iter().flatten()).chain(coordinates)
    }

    /// Draws it, under a name.
    ///
    /// # Errors
    /// When a run lacks a curve.
    pub fn draw(&self, name: String, outcomes: &[Outcome]) -> Result<Drawing, String> {
        let svg = if self.paths.is_empty() { figure(&self.diagram(outcomes)?) } else { self.space(outcomes)? };
        let (title, thesis) = (self.title.clone(), self.thesis.clone());
        Ok(Drawing { name, title, thesis, svg, csv: self.csv(outcomes)? })
    }

    /// Converts it to a diagram.
    ///
    /// # Errors
    /// When a run lacks a curve.
    pub fn diagram<'a>(&self, outcomes: &'a [Outcome]) -> Result<Diagram<'a>, String> {
        if !self.lines.is_empty() {
            return self.diagram_of_lines(outcomes);
        }
        let mut given = Vec::new();
        for (place, curve) in self.curves.iter().enumerate() {
            let Samples { drawn, unit, .. } = samples(curve, outcomes)?;
            let (times, values): (Vec<f64>, Vec<f64>) = drawn.iter().copied().unzip();
            let magnitude = self.funnel.is_some();
            let label = self.label(curve);
            given.push(Given {
                name: if magnitude { format!("|{label}|") } else { label },
                unit: unit.clone().unwrap_or_default(),
                part: self.parts.get(place).copied().unwrap_or(Part::Own),
                shown: Shown { minus: curve.minus.clone(), magnitude, ..Shown::signal(&curve.of) },
                times: times.into(),
                values: values.into_iter().map(|value| if magnitude { value.abs() } else { value }).collect(),
            });
        }
        let Some([start, end, rate]) = self.funnel else {
            return Ok(Diagram::new(&self.title, &time_label(), self.scale, given));
        };
        let ends = given.iter().filter_map(|curve| curve.times.last()).copied().fold(0.0, f64::max);
        let times: Vec<f64> = (0..=STEPS).map(|k| ends * k as f64 / STEPS as f64).collect();
        let Given { name, unit, part, shown, values, .. } = bound(PerformanceFunction { start, end, rate }, &times);
        let values = Cow::Owned(values.into_owned());
        given.push(Given { name, unit, part, shown, values, times: times.into() });
        Ok(Diagram::new(&self.title, &time_label(), Scale::Logarithmic, given))
    }

    fn diagram_of_lines<'a>(&self, outcomes: &'a [Outcome]) -> Result<Diagram<'a>, String> {
        let mut given = Vec::new();
        for line in &self.lines {
            given.push(Given {
                name: line.name.clone(),
                unit: String::new(),
                part: Part::Own,
                shown: Shown::signal(&line.name),
                times: line.places(outcomes)?.into(),
                values: line.y.clone().into(),
            });
        }
        let diagram = Diagram::new(&self.title, &self.x, Scale::ByValues, given);
        Ok(Diagram { y: self.y.clone(), ..diagram })
    }

    /// The name of a curve, with its run if there are several.
    fn label(&self, curve: &Curve) -> String {
        let several = self.curves.iter().any(|other| other.run != curve.run);
        if several { format!("{}: {}", curve.run, curve.signal()) } else { curve.signal() }
    }

    fn space(&self, outcomes: &[Outcome]) -> Result<String, String> {
        let mut paths = Vec::new();
        let mut units = [const { String::new() }; 3];
        for (place, path) in self.paths.iter().enumerate() {
            let mut rows = Vec::new();
            for (curve, unit) in path.iter().zip(&mut units) {
                let samples = samples(curve, outcomes)?;
                if let Some(found) = &samples.unit {
                    unit.clone_from(found);
                }
                rows.push(&samples.rows);
            }
            let points = (0..rows[0].len()).map(|k| [0, 1, 2].map(|axis: usize| rows[axis][k].1));
            let name = path[0].of.split('.').next().unwrap_or_default().to_owned();
            let part = self.parts.get(place).copied().unwrap_or(Part::Own);
            paths.push(Path { name, part, points: points.collect() });
        }
        let names = self.axes.clone().unwrap_or_else(|| AXES.map(str::to_owned));
        let axes = [0, 1, 2].map(|axis| labelled(&names[axis], &units[axis]));
        Ok(space(&paths, &axes, self.down))
    }

    fn csv(&self, outcomes: &[Outcome]) -> Result<String, String> {
        let mut csv = "curve,t,value\n".to_owned();
        let mut push = |name: &str, rows: &mut dyn Iterator<Item = (f64, f64)>| {
            let name = csv_field(name);
            rows.for_each(|(time, value)| csv.push_str(&format!("{name},{time},{value}\n")));
        };
        for curve in self.curves.iter().chain(self.paths.iter().flatten()) {
            push(&self.label(curve), &mut samples(curve, outcomes)?.rows.iter().copied());
        }
        for line in &self.lines {
            push(&line.name, &mut line.places(outcomes)?.into_iter().zip(line.y.iter().copied()));
        }
        Ok(csv)
    }
}

impl Line {
    /// Abscissas of its points.
    fn places(&self, outcomes: &[Outcome]) -> Result<Vec<f64>, String> {
        if self.x.is_empty() {
            return Ok((1..=self.y.len()).map(|place| place as f64).collect());
        }
        let start = |curve: &Curve| {
            let first = samples(curve, outcomes)?.rows.first().map(|(_, value)| *value);
            first.ok_or_else(|| format!("`{}` of `{}` has no value", curve.of, curve.run))
        };
        let place = |coordinate: &Coordinate| match coordinate {
            Coordinate::Number(number) => Ok(*number),
            Coordinate::Of(curve) => start(curve),
        };
        if self.x.len() != self.y.len() {
            return Err(format!("the line `{}` must have as many x as y", self.name));
        }
        self.x.iter().map(place).collect()
    }
}

fn samples<'a>(curve: &Curve, outcomes: &'a [Outcome]) -> Result<&'a Samples, String> {
    let outcome = outcomes.iter().find(|outcome| outcome.run == curve.run);
    let samples = outcome.and_then(|outcome| outcome.curve(curve));
    samples.ok_or_else(|| format!("there is no `{}` of a run `{}`", curve.signal(), curve.run))
}
