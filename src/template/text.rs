//! The text of a description: settings with a comment each.

use std::fmt::Display;

use nalgebra::DMatrix;

/// Widest line.
const WIDTH: usize = 110;
/// From so many characters on a comment is broken.
const WIDEST: usize = 116;

/// A description that is being written.
#[derive(Debug, Default)]
pub struct Text {
    text: String,
    notes: Vec<String>,
}

/// A new description.
#[derive(Debug, Clone, PartialEq)]
pub struct Begun {
    /// The file.
    pub text: String,
    /// Remarks for the user; the file has them too.
    pub notes: Vec<String>,
}

impl Begun {
    /// With a further remark, at the end of the file.
    #[must_use]
    pub fn with_note(mut self, note: String) -> Self {
        let mut more = Text::default();
        more.wrap(&note);
        self.text.push_str(&more.text);
        self.notes.push(note);
        self
    }
}

impl Text {
    /// A comment of its own, in several lines where it is long.
    pub fn comment(&mut self, text: &str) {
        if text.chars().count() < WIDEST {
            self.text.push_str(&format!("# {text}\n"));
        } else {
            self.wrap(text);
        }
    }

    /// A table, with a line before it.
    pub fn table(&mut self, name: &str) {
        self.text.push_str(&format!("\n[{name}]\n"));
    }

    /// Writes a setting with its comment after or before it.
    pub fn set(&mut self, key: &str, value: impl Display, comment: &str) {
        let setting = format!("{key} = {value}");
        let narrow = !setting.contains('\n') && setting.chars().count() + comment.chars().count() + 4 <= WIDTH;
        match (comment.is_empty(), narrow) {
            (true, _) => self.text.push_str(&format!("{setting}\n")),
            (false, true) => self.text.push_str(&format!("{setting}  # {comment}\n")),
            (false, false) => self.text.push_str(&format!("# {comment}\n{setting}\n")),
        }
    }

    /// A setting that is left to the user, with what it is: each of its lines is a comment.
    pub fn suggest(&mut self, key: &str, value: impl Display, comment: &str) {
        self.set(&format!("# {key}"), value.to_string().replace('\n', "\n# "), comment);
    }

    /// A comment of several lines that is reported too.
    pub fn note(&mut self, text: &str) {
        self.wrap(text);
        self.notes.push(text.to_owned());
    }

    fn wrap(&mut self, text: &str) {
        let mut line = String::from("#");
        for word in text.split(' ') {
            if line.chars().count() + word.chars().count() >= WIDTH {
                self.text.push_str(&format!("{line}\n"));
                line = String::from("#");
            }
            line.push_str(&format!(" {word}"));
        }
        self.text.push_str(&format!("{line}\n"));
    }

    /// The whole.
    pub fn finish(self) -> Begun {
        Begun { text: self.text, notes: self.notes }
    }
}

/// "1 state", "2 states"
pub fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// A number that stays a real one, as short as it can be.
pub fn number(value: f64) -> String {
    let [plain, powers] = [format!("{:?}", if value == 0.0 { 0.0 } else { value }), format!("{value:e}")];
    if powers.len() + 2 < plain.len() { powers } else { plain }
}

/// A list of numbers.
pub fn list(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(|&value| number(value)).collect::<Vec<_>>().join(", "))
}

/// The same number in each place.
pub fn all(value: f64, len: usize) -> String {
    list(&vec![value; len])
}

/// A text in quotation marks.
pub fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A list of texts.
pub fn texts(texts: &[String]) -> String {
    format!("[{}]", texts.iter().map(|text| quoted(text)).collect::<Vec<_>>().join(", "))
}

/// Rows of a matrix, in one line where they fit.
pub fn rows(matrix: &DMatrix<f64>) -> String {
    let rows: Vec<_> = matrix.row_iter().map(|row| list(&row.iter().copied().collect::<Vec<_>>())).collect();
    let line = format!("[{}]", rows.join(", "));
    if line.len() <= 80 { line } else { format!("[\n    {},\n]", rows.join(",\n    ")) }
}

/// A diagonal matrix.
pub fn diagonal(value: f64, n: usize) -> String {
    rows(&DMatrix::from_diagonal_element(n, n, value))
}

/// The nearest number above that is 1, 2 or 5 times a power of ten.
pub fn round_up(value: f64) -> f64 {
    steps(value).find(|step| *step >= value * (1.0 - 1e-9)).unwrap_or(value)
}

/// The nearest such number below.
pub fn round_down(value: f64) -> f64 {
    steps(value).take_while(|step| *step <= value * (1.0 + 1e-9)).last().unwrap_or(value)
}

/// Such numbers about a value, in ascending order: by their texts, so that they are those that a person would write.
fn steps(value: f64) -> impl Iterator<Item = f64> {
    let decade = value.log10().floor() as i32;
    let texts = [(1, 0), (2, 0), (5, 0), (1, 1), (2, 1)].map(|(step, more)| format!("{step}e{}", decade + more));
    texts.into_iter().filter_map(|text| text.parse().ok())
}

/// Rounded to three digits.
pub fn three_digits(value: f64) -> f64 {
    rounded(value, 3)
}

/// Without the rounding errors of a few operations: 0.3 in place of 0.30000000000000004.
pub fn as_written(value: f64) -> f64 {
    rounded(value, 13)
}

fn rounded(value: f64, digits: usize) -> f64 {
    let behind = digits - 1;
    format!("{value:.behind$e}").parse().unwrap_or(value)
}
