//! Structure of a model: entries that are known, free, or free with a sign.

use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};

use crate::finding::{Cause, Refusal};
use crate::record::Signals;

/// An entry of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Entry {
    /// Estimated.
    #[default]
    Free,
    /// Estimated, not below 0.
    Positive,
    /// Estimated, not above 0.
    Negative,
    /// Known, in units of the data.
    Known(f64),
}

impl Entry {
    /// True if it is to be estimated.
    pub fn is_free(self) -> bool {
        !matches!(self, Entry::Known(_))
    }
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Written {
    Number(f64),
    Mark(String),
}

impl Serialize for Entry {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mark = |text: &str| Written::Mark(text.to_owned());
        match self {
            Entry::Free => mark("?"),
            Entry::Positive => mark("?>0"),
            Entry::Negative => mark("?<0"),
            Entry::Known(value) => Written::Number(*value),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Entry {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let refuse = |what: &str| {
            Err(serde::de::Error::custom(format!("{what}: an entry must be a number, \"?\", \"?<0\" or \"?>0\"")))
        };
        match Written::deserialize(deserializer)? {
            Written::Number(value) if value.is_finite() => Ok(Entry::Known(value)),
            Written::Number(value) => refuse(&value.to_string()),
            Written::Mark(mark) => match mark.replace(' ', "").as_str() {
                "?" => Ok(Entry::Free),
                "?>0" => Ok(Entry::Positive),
                "?<0" => Ok(Entry::Negative),
                _ => refuse(&format!("\"{mark}\"")),
            },
        }
    }
}

/// A row of A: its entries, or an equation in words that gives the rows of A and B, `twist' = motor_speed - load_speed`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "a row must be a list of numbers, \"?\", \"?<0\" and \"?>0\", or an equation as \"twist' = motor_speed - load_speed\""
)]
pub enum Row {
    /// An entry for each state.
    Entries(Vec<Entry>),
    /// The derivative of the row's state.
    Words(String),
}

/// Structure of a model x' = A x + B u + d as a file has it. What isn't given is free.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Structure {
    /// Rows of A.
    #[serde(rename = "A", default, skip_serializing_if = "Option::is_none")]
    pub a: Option<Vec<Row>>,
    /// Rows of B.
    #[serde(rename = "B", default, skip_serializing_if = "Option::is_none")]
    pub b: Option<Vec<Vec<Entry>>>,
    /// Entries of the constant d.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub d: Option<Vec<Entry>>,
    /// Equations in words, for the states that they name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rows: Vec<String>,
}

/// All entries of A, B and d.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entries {
    /// Rows of A.
    pub a: Vec<Vec<Entry>>,
    /// Rows of B.
    pub b: Vec<Vec<Entry>>,
    /// The constant.
    pub d: Vec<Entry>,
}

impl Structure {
    /// All entries, for these signals; without offsets, d is 0.
    pub(crate) fn entries(&self, signals: &Signals, offsets: bool) -> Result<Entries, Refusal> {
        let (n, m) = (signals.measured.len(), signals.inputs.len());
        let refuse = |text: String| Err(Refusal::new(Cause::Request, text));
        let free = if offsets { Entry::Free } else { Entry::Known(0.0) };
        let mut entries =
            Entries { a: vec![vec![Entry::Free; n]; n], b: vec![vec![Entry::Free; m]; n], d: vec![free; n] };
        if let Some(b) = &self.b {
            if b.len() != n || b.iter().any(|row| row.len() != m) {
                return refuse(format!("structure: B must have {n} rows of {m} entries"));
            }
            entries.b.clone_from(b);
        }
        if let Some(d) = &self.d {
            if d.len() != n {
                return refuse(format!("structure: d must have {n} entries"));
            }
            entries.d.clone_from(d);
        }
        let rows = self.a.as_deref().unwrap_or_default();
        if !rows.is_empty() && rows.len() != n {
            return refuse(format!("structure: A must have {n} rows, one for each state"));
        }
        for (i, row) in rows.iter().enumerate() {
            match row {
                Row::Entries(row) if row.len() == n => entries.a[i].clone_from(row),
                Row::Entries(_) => return refuse(format!("structure: row {} of A must have {n} entries", i + 1)),
                Row::Words(words) => entries.set(words, signals, Some(i))?,
            }
        }
        self.rows.iter().try_for_each(|words| entries.set(words, signals, None))?;
        Ok(entries)
    }
}

impl Entries {
    /// Writes the known entries into matrices in units of the data: in scaled ones they are rounded.
    pub(crate) fn restore(&self, a: &mut DMatrix<f64>, b: &mut DMatrix<f64>) {
        for (rows, matrix) in [(&self.a, a), (&self.b, b)] {
            for (i, row) in rows.iter().enumerate() {
                for (j, entry) in row.iter().enumerate() {
                    if let Entry::Known(value) = entry {
                        matrix[(i, j)] = *value;
                    }
                }
            }
        }
    }

    /// Takes a row over from words, with a constant of 0.
    fn set(&mut self, words: &str, signals: &Signals, expected: Option<usize>) -> Result<(), Refusal> {
        let refuse = |text: String| Refusal::new(Cause::Request, format!("structure: `{words}`: {text}"));
        let form = || refuse("must be an equation such as `theta' = omega`".to_owned());
        let (left, right) = words.split_once('=').ok_or_else(form)?;
        let state = left.trim().strip_suffix('\'').ok_or_else(form)?.trim();
        let states = signals.measured.join(", ");
        let row = signals.measured.iter().position(|name| name == state);
        let row = row.ok_or_else(|| refuse(format!("there is no state `{state}`; there are: {states}")))?;
        if expected.is_some_and(|expected| expected != row) {
            return Err(refuse(format!("is in another row than that of `{state}`")));
        }
        self.a[row].fill(Entry::Known(0.0));
        self.b[row].fill(Entry::Known(0.0));
        self.d[row] = Entry::Known(0.0);
        for (factor, name) in terms(right).ok_or_else(form)? {
            let place = |names: &[String]| names.iter().position(|known| *known == name);
            let entry = match (place(&signals.measured), place(&signals.inputs)) {
                (Some(j), _) => &mut self.a[row][j],
                (None, Some(j)) => &mut self.b[row][j],
                (None, None) => {
                    let inputs = signals.inputs.join(", ");
                    return Err(refuse(format!("there is no signal `{name}`; there are: {states}, {inputs}")));
                }
            };
            let before = if let Entry::Known(before) = entry { *before } else { 0.0 };
            *entry = Entry::Known(before + factor);
        }
        Ok(())
    }
}

/// Terms of a sum: `2 v - omega`, `-1.5*u + x[1]`, `0`.
fn terms(text: &str) -> Option<Vec<(f64, String)>> {
    let text = text.trim();
    if text == "0" {
        return Some(Vec::new());
    }
    let mut words = Vec::new();
    for word in text.replace('*', " ").split_whitespace() {
        // A sign may stand before its word without a space.
        let sign = word.chars().take_while(|c| matches!(c, '+' | '-')).count();
        words.extend(word[..sign].chars().map(|c| c.to_string()));
        if sign < word.len() {
            words.push(word[sign..].to_owned());
        }
    }
    let (mut terms, mut sign, mut factor) = (Vec::new(), None, None);
    for word in words {
        match word.as_str() {
            "+" | "-" if factor.is_none() && sign.is_none() => sign = Some(if word == "-" { -1.0 } else { 1.0 }),
            word => match word.parse::<f64>() {
                Ok(value) if factor.is_none() && value.is_finite() => factor = Some(value),
                Ok(_) => return None,
                // Terms after the first are separated by a sign.
                Err(_) if !terms.is_empty() && sign.is_none() => return None,
                Err(_) => {
                    terms.push((sign.take().unwrap_or(1.0) * factor.take().unwrap_or(1.0), word.to_owned()));
                }
            },
        }
    }
    (sign.is_none() && factor.is_none() && !terms.is_empty()).then_some(terms)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn signals() -> Signals {
        Signals::new(&["u"], &["motor_speed", "twist", "x[1]"])
    }

    #[test]
    fn words_give_rows_of_both_matrices() {
        let structure = Structure {
            rows: vec!["twist' = motor_speed - 2*x[1]".to_owned(), "x[1]' = -1.5 u + 0.5 twist".to_owned()],
            ..Structure::default()
        };
        let entries = structure.entries(&signals(), true).unwrap();
        let known = |values: &[f64]| values.iter().map(|value| Entry::Known(*value)).collect::<Vec<_>>();
        assert_eq!(entries.a, [vec![Entry::Free; 3], known(&[1.0, 0.0, -2.0]), known(&[0.0, 0.5, 0.0])]);
        assert_eq!(entries.b, [vec![Entry::Free], known(&[0.0]), known(&[-1.5])]);
        assert_eq!(entries.d, [Entry::Free, Entry::Known(0.0), Entry::Known(0.0)]);
    }

    #[test]
    fn a_file_has_numbers_marks_and_words() {
        let text = r#"{ "A": [["?<0", 0, "?"], "twist' = motor_speed - x[1]", ["?", "? >0", 1.5]], "d": ["?", 0, 0] }"#;
        let structure: Structure = serde_json::from_str(text).unwrap();
        let entries = structure.entries(&signals(), true).unwrap();
        assert_eq!(entries.a[0], [Entry::Negative, Entry::Known(0.0), Entry::Free]);
        assert_eq!(entries.a[2], [Entry::Free, Entry::Positive, Entry::Known(1.5)]);
        let again: Structure = serde_json::from_str(&serde_json::to_string(&structure).unwrap()).unwrap();
        assert_eq!(again, structure);
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let refusal = |rows: &str| {
            let structure = Structure { rows: vec![rows.to_owned()], ..Structure::default() };
            structure.entries(&signals(), true).unwrap_err().text
        };
        let form = "must be an equation such as `theta' = omega`";
        for wrong in
            ["twist = u", "twist'", "twist' = motor_speed x[1]", "twist' = 2", "twist' = 2 3 u", "twist' = u +"]
        {
            assert_eq!(refusal(wrong), format!("structure: `{wrong}`: {form}"));
        }
        assert!(refusal("y' = u").contains("there is no state `y`; there are: motor_speed, twist, x[1]"));
        assert!(refusal("twist' = v").contains("there is no signal `v`"));
        let unknown = serde_json::from_str::<Structure>(r#"{ "E": [] }"#).unwrap_err().to_string();
        assert!(unknown.starts_with("unknown field `E`, expected one of `A`, `B`, `d`, `rows`"), "{unknown}");
        assert!(serde_json::from_str::<Structure>(r#"{ "d": ["x"] }"#).is_err());
        let rows = Structure { b: Some(vec![vec![Entry::Free]; 2]), ..Structure::default() };
        assert_eq!(rows.entries(&signals(), true).unwrap_err().text, "structure: B must have 3 rows of 1 entries");
    }
}
