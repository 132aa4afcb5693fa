//! Diagrams of a run as an SVG file.

use plotters::prelude::*;

use super::closed_loop::Recording;
use super::ssp::Plot;
use super::thinned::thinned;

const WIDTH: u32 = 900;
const HEIGHT_OF_ONE: u32 = 300;
/// Colours that people with any colour vision tell apart (M. Okabe and K. Ito), in the order of use.
pub const COLOURS: [RGBColor; 5] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
];
/// More groups of points than this in a curve can't be told apart.
const GROUPS: usize = 600;

/// Smallest and largest of some values, a little apart.
pub fn padded_range<'a>(values: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let finite = values.filter(|value| value.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)));
    if low > high {
        return (-1.0, 1.0);
    }
    let margin = if high > low { 0.06 * (high - low) } else { low.abs().max(1.0) * 0.1 };
    (low - margin, high + margin)
}

/// The diagrams, one below the other.
///
/// # Errors
/// When a diagram names a signal that isn't there, or can't be drawn.
pub fn svg(title: &str, plots: &[Plot], recording: &Recording) -> Result<String, String> {
    svg_over("t in s", title, plots, recording)
}

/// The same over something else than time.
///
/// # Errors
/// When a diagram names a signal that isn't there, or can't be drawn.
pub fn svg_over(x: &str, title: &str, plots: &[Plot], recording: &Recording) -> Result<String, String> {
    let mut text = String::new();
    let size = (WIDTH, HEIGHT_OF_ONE * plots.len().max(1) as u32 + 40);
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&root, (x, title), plots, recording).map_err(|error| error.to_string())?;
        root.present().map_err(|error| error.to_string())?;
    }
    Ok(text)
}

fn draw<B: DrawingBackend>(
    root: &DrawingArea<B, plotters::coord::Shift>,
    (x, title): (&str, &str),
    plots: &[Plot],
    recording: &Recording,
) -> Result<(), Box<dyn std::error::Error>>
where
    B::ErrorType: 'static,
{
    root.fill(&WHITE)?;
    let root = root.titled(title, ("sans-serif", 22))?;
    for (area, plot) in root.split_evenly((plots.len().max(1), 1)).iter().zip(plots) {
        let columns: Vec<(&str, &[f64])> = plot
            .signals
            .iter()
            .map(|name| {
                recording.column(name).map(|column| (name.as_str(), column)).ok_or(format!("no signal `{name}`"))
            })
            .collect::<Result<_, _>>()?;
        let (low, high) = padded_range(columns.iter().flat_map(|(_, column)| column.iter()));
        let (start, end) =
            (recording.times.first().copied().unwrap_or(0.0), recording.times.last().copied().unwrap_or(1.0));
        let mut chart = ChartBuilder::on(area)
            .caption(&plot.title, ("sans-serif", 17))
            .margin(8)
            .margin_right(24)
            .x_label_area_size(32)
            .y_label_area_size(58)
            .build_cartesian_2d(start..end, low..high)?;
        chart.configure_mesh().light_line_style(WHITE).x_desc(x).label_style(("sans-serif", 14)).draw()?;
        for (k, (name, column)) in columns.iter().enumerate() {
            let style = COLOURS[k % COLOURS.len()].stroke_width(if k == 0 { 2 } else { 1 });
            let series = LineSeries::new(thinned(&recording.times, column, GROUPS), style);
            chart
                .draw_series(series)?
                .label(*name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 18, y)], style));
        }
        chart
            .configure_series_labels()
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.2))
            .position(SeriesLabelPosition::UpperRight)
            .label_font(("sans-serif", 14))
            .draw()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> Recording {
        let times: Vec<f64> = (0..10_000).map(|k| f64::from(k) * 1e-3).collect();
        let column = times.iter().map(|t| t.sin()).collect();
        Recording { names: vec!["a.y".into()], times, columns: vec![column], ..Recording::default() }
    }

    #[test]
    fn a_diagram_shows_its_curve_and_names_it() {
        let plot = Plot { title: "output".into(), signals: vec!["a.y".into()] };
        let svg = svg("loop", &[plot], &recording()).unwrap();
        assert!(svg.contains("a.y") && svg.contains("output") && svg.contains("<polyline"), "{svg}");
    }

    #[test]
    fn a_diagram_of_a_signal_that_is_not_there_is_refused() {
        let plot = Plot { title: "output".into(), signals: vec!["a.z".into()] };
        assert!(svg("loop", std::slice::from_ref(&plot), &recording()).unwrap_err().contains("a.z"));
        assert!(super::super::terminal(&plot, &recording()).unwrap_err().contains("a.z"));
    }
}
