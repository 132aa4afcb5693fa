//! Figures as SVG: curves over time, with the funnel that they are to stay in, and paths in space.

use plotters::coord::Shift;
use plotters::coord::ranged3d::{ProjectionMatrix, ProjectionMatrixBuilder};
use plotters::prelude::*;
use serde::Deserialize;

use super::outcome::{Outcome, Samples};
use super::{Curve, Example};
use crate::simulation::{COLOURS, Funnel, Structure, padded_range};
use crate::text_file::csv_field;

/// Twice as large as it is shown on a wide screen: coordinates are whole numbers.
const SIZE: (u32, u32) = (1280, 800);
const TEXT: u32 = 30;
const WIDTH: u32 = 3;
/// Points of a drawn funnel.
const STEPS: usize = 200;
/// Every so many rows of a path are drawn.
const SPARSE: usize = 5;
/// Projected paths, as seen from above at an angle.
const PITCH: f64 = 0.35;

/// A figure, as it is asked for.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// Title.
    pub title: String,
    /// Curves over time.
    #[serde(default)]
    pub curves: Vec<Curve>,
    /// ρ_0, ρ_∞ and the rate of decay of the funnel around 0.
    pub funnel: Option<[f64; 3]>,
    /// Paths in space: the three coordinates of each.
    #[serde(default)]
    pub paths: Vec<[Curve; 3]>,
}

/// A figure, drawn.
#[derive(Debug)]
pub struct Drawing {
    /// Name of its files.
    pub name: String,
    /// Title.
    pub title: String,
    /// The picture.
    pub svg: String,
    /// Its curves: name, time in s, value.
    pub csv: String,
}

impl Figure {
    /// The figures of an example: those of its loops, with the structures of its runs, then its own.
    pub fn all(example: &Example, structures: &[Structure]) -> Vec<Self> {
        let alone = example.run.len() == 1;
        let of_run = |(run, structure): (&super::Run, &Structure)| {
            let key = run.key();
            let plots = structure.plots.iter().map(|plot| Figure {
                title: if alone { plot.title.clone() } else { format!("{key}: {}", plot.title) },
                curves: plot.signals.iter().map(|of| Curve { run: key.clone(), of: of.clone(), minus: None }).collect(),
                funnel: None,
                paths: Vec::new(),
            });
            plots.collect::<Vec<_>>()
        };
        example.run.iter().zip(structures).flat_map(of_run).chain(example.figure.clone()).collect()
    }

    /// All curves that it needs.
    pub fn needs(&self) -> impl Iterator<Item = &Curve> {
        self.curves.iter().chain(self.paths.iter().flatten())
    }

    /// Draws it, under a name.
    ///
    /// # Errors
    /// When a run lacks a curve, or it can't be drawn.
    pub fn draw(&self, name: String, outcomes: &[Outcome]) -> Result<Drawing, String> {
        let lines = self.curves.iter().map(|curve| Line::of(curve, outcomes, self.several_runs()));
        let lines = lines.collect::<Result<Vec<_>, _>>()?;
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
            root.fill(&WHITE).map_err(|error| error.to_string())?;
            let drawn = if self.paths.is_empty() {
                self.draw_lines(&root, &lines)
            } else {
                draw_paths(&root, &self.points(outcomes)?)
            };
            drawn.and_then(|()| Ok(root.present()?)).map_err(|error| format!("{}: {error}", self.title))?;
        }
        Ok(Drawing { name, title: self.title.clone(), svg: scalable(&svg), csv: self.csv(outcomes)? })
    }

    fn several_runs(&self) -> bool {
        self.curves.iter().any(|curve| curve.run != self.curves[0].run)
    }

    fn draw_lines(&self, root: &Area, lines: &[Line]) -> Drawn {
        let funnel = self.funnel.map(|[start, end, rate]| Funnel { start, end, rate });
        let times = lines.iter().flat_map(|line| line.samples.drawn.iter().map(|(time, _)| *time));
        let (start, end) = times.fold((f64::MAX, f64::MIN), |(low, high), time| (low.min(time), high.max(time)));
        let time_of = |k: usize| start + (end - start) * k as f64 / STEPS as f64;
        let bounds: Vec<Vec<(f64, f64)>> = [1.0, -1.0]
            .iter()
            .filter_map(|sign| funnel.map(|funnel| (sign, funnel)))
            .map(|(sign, funnel)| (0..=STEPS).map(|k| (time_of(k), sign * funnel.at(time_of(k) - start))).collect())
            .collect();
        let all = lines.iter().map(|line| &line.samples.drawn).chain(&bounds);
        let (low, high) = padded_range(all.flatten().map(|(_, value)| value));
        let mut chart = ChartBuilder::on(root)
            .margin(16)
            .margin_right(40)
            .x_label_area_size(76)
            .y_label_area_size(150)
            .build_cartesian_2d(start..end.max(start + f64::MIN_POSITIVE), low..high)?;
        let mut mesh = chart.configure_mesh();
        mesh.light_line_style(WHITE).x_labels(8).y_labels(7).label_style(("sans-serif", TEXT));
        mesh.x_desc("t in s").y_desc(units(lines)).draw()?;
        for bound in bounds {
            chart.draw_series(DashedLineSeries::new(bound, 12, 8, BLACK.mix(0.6).stroke_width(2)))?;
        }
        for (line, colour) in lines.iter().zip(COLOURS.iter().cycle()) {
            let style = colour.stroke_width(WIDTH);
            let series = chart.draw_series(LineSeries::new(line.samples.drawn.iter().copied(), style))?;
            series.label(&line.label).legend(move |(x, y)| PathElement::new([(x, y), (x + 36, y)], style));
        }
        let mut legend = chart.configure_series_labels();
        legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.2)).label_font(("sans-serif", TEXT));
        legend.legend_area_size(48).position(SeriesLabelPosition::UpperRight).draw()?;
        Ok(())
    }

    /// The paths, each with its name.
    fn points(&self, outcomes: &[Outcome]) -> Result<Vec<Path>, String> {
        let path = |[x, y, z]: &[Curve; 3]| {
            let rows = |curve| Line::of(curve, outcomes, false).map(|line| &line.samples.rows);
            let (x_rows, y_rows, z_rows) = (rows(x)?, rows(y)?, rows(z)?);
            let points = x_rows.iter().zip(y_rows).zip(z_rows).map(|((x, y), z)| (x.1, y.1, z.1));
            // Nearer points than the grid that they are drawn on look like teeth.
            let points = points.step_by(SPARSE);
            let name = x.of.split('.').next().unwrap_or_default().to_owned();
            Ok((name, points.collect()))
        };
        self.paths.iter().map(path).collect()
    }

    fn csv(&self, outcomes: &[Outcome]) -> Result<String, String> {
        let mut csv = "curve,t,value\n".to_owned();
        for curve in self.needs() {
            let line = Line::of(curve, outcomes, self.several_runs())?;
            let name = csv_field(&line.label);
            line.samples.rows.iter().for_each(|(time, value)| csv.push_str(&format!("{name},{time},{value}\n")));
        }
        Ok(csv)
    }
}

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Drawn = Result<(), Box<dyn std::error::Error>>;
type Path = (String, Vec<(f64, f64, f64)>);

/// A curve with its name.
struct Line<'a> {
    label: String,
    samples: &'a Samples,
}

impl<'a> Line<'a> {
    fn of(curve: &Curve, outcomes: &'a [Outcome], with_run: bool) -> Result<Self, String> {
        let signal = curve.signal();
        let outcome = outcomes.iter().find(|outcome| outcome.run == curve.run);
        let samples = outcome.and_then(|outcome| outcome.curve(curve));
        let samples = samples.ok_or_else(|| format!("there is no `{signal}` of a run `{}`", curve.run))?;
        Ok(Line { label: if with_run { format!("{}: {signal}", curve.run) } else { signal }, samples })
    }
}

/// What the values of all lines are in.
fn units(lines: &[Line]) -> String {
    let mut units: Vec<&str> = lines.iter().filter_map(|line| line.samples.unit.as_deref()).collect();
    units.sort_unstable();
    units.dedup();
    match units[..] {
        [] => String::new(),
        ["1"] => "no unit".to_owned(),
        _ => format!("in {}", units.join(", ")),
    }
}

fn draw_paths(root: &Area, paths: &[Path]) -> Drawn {
    let range = |coordinate: fn(&(f64, f64, f64)) -> &f64| {
        let (low, high) = padded_range(paths.iter().flat_map(|(_, points)| points).map(coordinate));
        low..high
    };
    let mut builder = ChartBuilder::on(root);
    // The second axis of this projection is the one that points up.
    let mut chart = builder.margin(24).build_cartesian_3d(range(|p| &p.0), range(|p| &p.2), range(|p| &p.1))?;
    let view = |mut projection: ProjectionMatrixBuilder| -> ProjectionMatrix {
        (projection.pitch, projection.scale) = (PITCH, 0.85);
        projection.into_matrix()
    };
    chart.with_projection(view);
    let axes = ("sans-serif", TEXT);
    chart.configure_axes().light_grid_style(BLACK.mix(0.08)).max_light_lines(3).label_style(axes).draw()?;
    for ((name, points), colour) in paths.iter().zip(COLOURS.iter().cycle()) {
        let style = colour.stroke_width(WIDTH);
        let series = chart.draw_series(LineSeries::new(points.iter().map(|(x, y, z)| (*x, *z, *y)), style))?;
        series.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 36, y)], style));
    }
    let mut legend = chart.configure_series_labels();
    legend.background_style(WHITE.mix(0.8)).border_style(BLACK.mix(0.2)).label_font(("sans-serif", TEXT));
    legend.legend_area_size(48).position(SeriesLabelPosition::UpperRight).draw()?;
    Ok(())
}

/// As wide as the place that it is shown in.
fn scalable(svg: &str) -> String {
    let fixed = format!("width=\"{}\" height=\"{}\"", SIZE.0, SIZE.1);
    svg.replacen(&fixed, "width=\"100%\"", 1)
}
