//! Pictures of design reports.

use std::fmt::Write;

use super::chart::{Chart, Line};
use super::colours;
use super::escaped;
use crate::picture::{Curve, CurveOf, Picture};

/// Colours of the signals of a picture, in their order.
const COLOURS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#b4568f", "#3f9fd0", "#a67c00"];
/// Opacity of a pale one.
const PALE: &str = "66";

/// Meaning of the lines of pictures.
pub const KEY: &str = "<p>Full colours: the nominal plant. Pale: the worst plants within the uncertainty. Dashed: references and limits.</p>\n";

/// Adds pictures to a page.
pub fn push_pictures(page: &mut String, pictures: &[Picture]) {
    for picture in pictures {
        let Picture { title, x, y, logarithmic, .. } = picture;
        let lines = lines(&picture.curves);
        let drawing = Chart { title, x, y, logarithmic: *logarithmic, lines }.drawing();
        let _ = writeln!(page, "<figure><figcaption>{}</figcaption>\n{drawing}</figure>", escaped(title));
    }
}

/// Curves of one name have one colour.
fn lines(curves: &[Curve]) -> Vec<Line> {
    let mut names: Vec<&str> = Vec::new();
    let mut lines = Vec::new();
    for Curve { name, of, points } in curves {
        let known = names.iter().position(|known| known == name);
        let place = known.unwrap_or_else(|| {
            names.push(name);
            names.len() - 1
        });
        let colour = COLOURS[place % COLOURS.len()];
        let colour = match of {
            CurveOf::Nominal => colour.to_owned(),
            CurveOf::Marks => COLOURS[0].to_owned(),
            CurveOf::Worst => format!("{colour}{PALE}"),
            CurveOf::WorstMarks => format!("{}{PALE}", COLOURS[0]),
            CurveOf::Bound => colours::COMPARED.to_owned(),
        };
        let line = |points: Vec<(f64, Option<f64>)>, marked: bool| Line {
            name: name.clone(),
            colour: colour.clone(),
            points,
            marked,
            dashed: *of == CurveOf::Bound,
        };
        let points = points.iter().map(|[x, y]| (*x, Some(*y)));
        match of {
            CurveOf::Marks | CurveOf::WorstMarks => lines.extend(points.map(|point| line(vec![point], true))),
            _ => lines.push(line(points.collect(), false)),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_of_one_signal_share_a_colour_and_marks_have_no_line() {
        let curve = |name: &str, of, points| Curve { name: name.to_owned(), of, points };
        let some = vec![[0.0, 0.0], [1.0, 1.0]];
        let curves = vec![
            curve("y", CurveOf::Worst, some.clone()),
            curve("y", CurveOf::Nominal, some.clone()),
            curve("a < b", CurveOf::Bound, some.clone()),
            curve("poles", CurveOf::Marks, some),
        ];
        let (title, x, y) = ("Step".to_owned(), "time in s".to_owned(), "outputs".to_owned());
        let mut page = String::new();
        push_pictures(&mut page, &[Picture { title, x, y, logarithmic: false, curves }]);
        assert_eq!(page.matches("#0072b266").count(), 1);
        assert!(page.contains("<title>a &lt; b</title>") && page.contains("stroke-dasharray"));
        assert_eq!(page.matches("<circle").count(), 2);
        let mut nothing = String::new();
        push_pictures(&mut nothing, &[]);
        assert!(nothing.is_empty());
    }
}
