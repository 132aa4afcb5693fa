//! The nominal plant on an FMU's page.

use std::fmt::Write;

use super::escaped;
use crate::nominal::{Identified, NominalPlant, Uncertainty};
use crate::report::{Value, number};

/// Name, value, unit and note.
type Row = (&'static str, Value, &'static str, String);

/// Appends the plant that a controller was designed for; nothing if its description has none.
pub fn push(page: &mut String, nominal: Option<&NominalPlant>) {
    let Some(plant) = nominal else { return };
    let delayed = if plant.is_delayed() { "u(t − delay)" } else { "u" };
    let _ = writeln!(
        page,
        "<h2 id=\"nominal\">Nominal plant</h2>\n<p>The controller was designed for the plant x' = A x + B {delayed}, y = C x, in the \
         units of measurement of its signals.</p>\n<div class=\"scroll report\"><table>"
    );
    for (name, value, unit, note) in rows(plant) {
        let value = escaped(&value.lines().join("\n"));
        let _ = writeln!(page, "<tr><td>{name}<td>{value}<td>{unit}<td>{}", escaped(&note));
    }
    page.push_str("</table></div>\n");
}

fn rows(plant: &NominalPlant) -> Vec<Row> {
    let owned = |text: &str| text.to_owned();
    let mut rows: Vec<Row> =
        [("A", &plant.A, "state matrix"), ("B", &plant.B, "input matrix"), ("C", &plant.C, "output matrix")]
            .map(|(name, matrix, note)| (name, matrix.into(), "", owned(note)))
            .into();
    if plant.is_delayed() {
        rows.push(("delay", each(&plant.delay), "s", owned("dead time of the inputs")));
    }
    if let Some(bandwidth) = plant.bandwidth {
        rows.push(("bandwidth", bandwidth.into(), "rad/s", owned("requested bandwidth of the design")));
    }
    if let Some(reference) = &plant.reference {
        rows.push(("reference", each(reference), "", owned("usual magnitude of the reference")));
    }
    rows.extend(uncertainty(&plant.uncertainty));
    rows
}

fn uncertainty(uncertainty: &Uncertainty) -> Vec<Row> {
    let deviation = |of: &str| format!("largest deviation of each entry of {of}");
    match uncertainty {
        Uncertainty::Unknown => Vec::new(),
        Uncertainty::Part(part) => {
            let note = "relative uncertainty of each entry of A and B";
            vec![("uncertainty", (100.0 * part).into(), "%", note.to_owned())]
        }
        Uncertainty::Elements { A, B } => {
            vec![("uncertainty_A", A.into(), "", deviation("A")), ("uncertainty_B", B.into(), "", deviation("B"))]
        }
        Uncertainty::Model(Identified { file, sha256, level, margin, .. }) => {
            let level = level.map(|level| format!("confidence level {} %", number(100.0 * level)));
            let margin = margin.map(|margin| format!("region enlarged {} times", number(margin)));
            let sum = sha256.as_ref().map(|sum| format!("SHA-256 {sum}"));
            let words: Vec<_> =
                [Some("identified model".to_owned()), level, margin, sum].into_iter().flatten().collect();
            vec![("model", file.clone().into(), "", words.join(", "))]
        }
    }
}

/// One number if all are equal, else all of them.
fn each(values: &[f64]) -> Value {
    match values {
        [first, rest @ ..] if rest.iter().all(|value| value == first) => (*first).into(),
        _ => Value::Matrix(vec![values.to_vec()]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Description;

    fn page(more: &str) -> String {
        let text = format!(
            "name = \"a\"\nmodel = \"pid\"\ndescription = \"\"\n[nominal]\nA = [[0, 1], [-2, -3]]\nB = [[0], [1]]\nC = [[1, 0]]\n{more}"
        );
        let mut page = String::new();
        push(&mut page, Description::read(&text).unwrap().nominal.as_ref());
        page
    }

    #[test]
    fn a_page_prints_the_nominal_plant() {
        let shown = page("bandwidth = 5\nreference = 10\nuncertainty = 0.07");
        assert!(shown.contains("x' = A x + B u, y") && shown.contains("<td>A<td>0, 1\n-2, -3<td>"), "{shown}");
        for row in ["<td>bandwidth<td>5<td>rad/s<td>", "<td>reference<td>10<td><td>", "<td>uncertainty<td>7<td>%<td>"] {
            assert!(shown.contains(row), "{row}: {shown}");
        }
        let shown = page("delay = 0.1\nuncertainty_B = [[0], [0.5]]");
        assert!(shown.contains("B u(t − delay)") && shown.contains("<td>delay<td>0.1<td>s<td>"), "{shown}");
        assert!(shown.contains("<td>uncertainty_B<td>0\n0.5<td>") && !shown.contains("bandwidth"), "{shown}");
        let shown = page("model = \"<m>.json\"\nlevel = 0.95");
        assert!(
            shown.contains("<td>model<td>&lt;m&gt;.json<td><td>identified model, confidence level 95 %"),
            "{shown}"
        );
    }

    #[test]
    fn a_page_without_one_has_no_such_section() {
        let mut page = String::new();
        push(&mut page, None);
        assert_eq!(page, "");
    }
}
