//! Arguments of `compare`: a loop, a loop with parameter sets, with values, or the results of an earlier run.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::results::Recorded;
use adaptive_fmu::structure::LoopFiles;

use super::loop_options::LoopOptions;
use super::names::Names;
use super::ready;

/// A run for a comparison, with a label.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Labelled {
    /// Its name in tables and diagrams.
    pub label: Option<String>,
    /// The run.
    pub run: Specification,
}

impl FromStr for Labelled {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // A path may hold the sign, too.
        let found = text.split_once('=').filter(|(label, _)| !label.contains(NO_LABEL) && !Path::new(text).exists());
        let (label, run) = found.map_or((None, text), |(label, run)| (Some(label.trim()), run.trim()));
        if label.is_some_and(|label| label.is_empty() || label.chars().any(char::is_control)) {
            return Err(format!("the label before = must not be empty; {FORM}"));
        }
        Ok(Labelled { label: label.map(str::to_owned), run: run.parse()? })
    }
}

impl Labelled {
    /// Tag of the folder of its results: its label, or what the run has in addition to its loop.
    pub fn tag(&self) -> Option<String> {
        self.label.as_deref().map(plain).or_else(|| self.run.tag())
    }
}

/// Characters that no label has.
const NO_LABEL: [char; 4] = [':', '@', '/', '\\'];

/// A text as a part of a folder's name.
fn plain(text: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "_-.,=+".contains(c) { c } else { '_' };
    text.chars().map(plain).collect::<String>().trim_start_matches('.').to_owned()
}

/// One of what is compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Specification {
    /// A folder of results.
    Results(PathBuf),
    /// A loop, with parameter sets and values, `name=value`.
    Loop { name: String, cases: Vec<String>, values: Vec<String> },
}

const FORM: &str =
    "must be [LABEL=]LOOP, [LABEL=]LOOP@FILE.ssv, [LABEL=]LOOP:name=value,name=value or [LABEL=] a folder of results";

impl FromStr for Specification {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.is_empty() {
            return Err(FORM.to_owned());
        }
        if Recorded::is_at(Path::new(text)) {
            return Ok(Specification::Results(text.into()));
        }
        // A colon before the first `=`: a path may hold others.
        let colon = text.find('=').and_then(|sign| text[..sign].rfind(':'));
        let (base, values) = colon.map_or((text, None), |colon| (&text[..colon], Some(&text[colon + 1..])));
        let values = values.map_or(Ok(Vec::new()), assignments)?;
        let (name, cases) = name_and_cases(base)?;
        Ok(Specification::Loop { name, cases, values })
    }
}

fn assignments(text: &str) -> Result<Vec<String>, String> {
    let Names(values) = text.parse().map_err(|_| FORM.to_owned())?;
    let has_both =
        |value: &&String| value.split_once('=').is_none_or(|(name, value)| name.trim().is_empty() || value.is_empty());
    match values.iter().find(has_both) {
        Some(wrong) => Err(format!("`{wrong}`: must be name=value")),
        None => Ok(values),
    }
}

/// The loop, and the parameter sets behind it; a path may hold the sign, too.
fn name_and_cases(base: &str) -> Result<(String, Vec<String>), String> {
    let is_loop = |name: &str| exporter::loops().iter().any(|(known, _)| *known == name) || Path::new(name).exists();
    if base.is_empty() {
        return Err(FORM.to_owned());
    }
    if is_loop(base) {
        return Ok((base.to_owned(), Vec::new()));
    }
    let signs = || base.match_indices('@').map(|(place, _)| place);
    let sign = signs().rev().find(|&place| is_loop(&base[..place])).or_else(|| signs().next());
    let Some(sign) = sign else { return Ok((base.to_owned(), Vec::new())) };
    let cases: Vec<String> = base[sign + 1..].split('@').map(str::to_owned).collect();
    if sign == 0 || cases.iter().any(String::is_empty) {
        return Err(FORM.to_owned());
    }
    Ok((base[..sign].to_owned(), cases))
}

impl Specification {
    /// The loop; none of results.
    pub fn name(&self) -> Option<&str> {
        match self {
            Specification::Loop { name, .. } => Some(name),
            Specification::Results(_) => None,
        }
    }

    /// Tag of the results of such a run: its parameter sets and values.
    pub fn tag(&self) -> Option<String> {
        let Specification::Loop { cases, values, .. } = self else { return None };
        let stem = |case: &String| Path::new(case).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let parts: Vec<String> = cases.iter().map(stem).chain(values.iter().cloned()).collect();
        (!parts.is_empty()).then(|| plain(&parts.join(",")))
    }

    /// The options of such a run, from those of all: its parameter sets come behind theirs, and so do its values.
    ///
    /// # Errors
    /// When a name isn't there or is that of several parameters, a value isn't allowed, or a file can't be read.
    pub fn options(&self, of_all: &LoopOptions) -> Result<LoopOptions, Error> {
        let mut options = of_all.clone();
        let Specification::Loop { name, cases, values } = self else { return Ok(options) };
        options.parameters.case.extend(cases.iter().map(PathBuf::from));
        if values.is_empty() {
            return Ok(options);
        }
        let files = LoopFiles::find(name)?;
        let structure = options.structure(&files)?;
        let units = if options.composite || options.fmus.is_some() {
            options.units(&structure)?
        } else {
            super::loop_options::Units::Ready(ready::units()?)
        };
        let loaded = units.load(&structure, &options.hosting.hosting()?)?;
        let wrong = |reason| Error::Loop { file: format!("{name}:{}", values.join(",")).into(), reason };
        for value in values {
            let (given, text) = value.split_once('=').unwrap_or((value, ""));
            let (full, place) = loaded.settable(given.trim()).map_err(wrong)?;
            let refuse = |allowed| wrong(format!("`{full}` = {text}: {allowed}"));
            loaded.start_value(place, text).map_err(refuse)?;
            options.parameters.set.push(format!("{full}={}", text.trim()));
        }
        Ok(options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(name: &str, cases: &[&str], values: &[&str]) -> Specification {
        let owned = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect();
        Specification::Loop { name: name.to_owned(), cases: owned(cases), values: owned(values) }
    }

    #[test]
    fn a_loop_may_have_sets_and_values() {
        let known = "3.2.1-cosine";
        let read = |text: &str| text.parse::<Specification>().unwrap();
        assert_eq!(read(known), of(known, &[], &[]));
        assert_eq!(read("3.2.1-cosine@fast.ssv"), of(known, &["fast.ssv"], &[]));
        assert_eq!(read("3.2.1-cosine@a/fast.ssv@b.ssv:x=1"), of(known, &["a/fast.ssv", "b.ssv"], &["x=1"]));
        let values = "3.2.1-cosine:theta[1,2]=3,controller.adaptation_gain = 1e5";
        assert_eq!(read(values), of(known, &[], &["theta[1,2]=3", "controller.adaptation_gain = 1e5"]));
        assert_eq!(read("c:/loops/mine:x=1"), of("c:/loops/mine", &[], &["x=1"]));
    }

    #[test]
    fn a_label_is_before_the_first_sign() {
        let read = |text: &str| text.parse::<Labelled>().unwrap();
        let warm = read("warm = 3.2.1-cosine:theta[1,2]=3,x=-1");
        assert_eq!((warm.label.as_deref(), warm.tag().as_deref()), (Some("warm"), Some("warm")));
        assert_eq!(warm.run, of("3.2.1-cosine", &[], &["theta[1,2]=3", "x=-1"]));
        assert_eq!(read("20 °C=3.2.1-cosine@a/fast.ssv").tag().as_deref(), Some("20__C"));
        let bare = read("3.2.1-cosine:x=1");
        assert_eq!((bare.label.as_deref(), bare.tag().as_deref()), (None, Some("x=1")));
        assert_eq!(read("c:/loops/mine:x=1").label, None);
        for text in ["=3.2.1-cosine", "warm=", "a\nb=3.2.1-cosine"] {
            assert!(text.parse::<Labelled>().is_err(), "{text}");
        }
    }

    #[test]
    fn what_is_none_is_refused_with_what_one_is() {
        for text in ["", "@a.ssv", "3.2.1-cosine@", "3.2.1-cosine:=1", "3.2.1-cosine:x=", "3.2.1-cosine:x=1,", ":x=1"] {
            assert!(text.parse::<Specification>().is_err(), "{text}");
        }
    }

    #[test]
    fn results_are_stored_under_what_a_run_has_in_addition_to_its_loop() {
        assert_eq!(of("x", &[], &[]).tag(), None);
        assert_eq!(of("x", &["a/fast.ssv"], &["m[1,2]=3"]).tag().as_deref(), Some("fast,m_1,2_=3"));
    }
}
