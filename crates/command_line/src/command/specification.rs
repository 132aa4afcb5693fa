//! What `compare` takes: a loop, a loop with parameter sets, with values, or the results of an earlier run.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use adaptive_fmu::error::Error;
use adaptive_fmu::exporter;
use adaptive_fmu::results::Recorded;
use adaptive_fmu::structure::LoopFiles;

use super::loop_options::LoopOptions;
use super::names::Names;
use super::ready;

/// One of what is compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Specification {
    /// A folder of results.
    Results(PathBuf),
    /// A loop, with parameter sets and values, `name=value`.
    Loop { name: String, cases: Vec<String>, values: Vec<String> },
}

const FORM: &str = "must be LOOP, LOOP@FILE.ssv, LOOP:name=value,name=value or a folder of results";

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

    /// What the results of such a run are kept under: what it has beside the loop.
    pub fn tag(&self) -> Option<String> {
        let Specification::Loop { cases, values, .. } = self else { return None };
        let stem = |case: &String| Path::new(case).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let parts: Vec<String> = cases.iter().map(stem).chain(values.iter().cloned()).collect();
        let plain = |c: char| if c.is_alphanumeric() || "_-.,=+".contains(c) { c } else { '_' };
        let tag: String = parts.join(",").chars().map(plain).collect();
        (!tag.is_empty()).then(|| tag.trim_start_matches('.').to_owned())
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
            let told = |allowed| wrong(format!("`{full}` = {text}: {allowed}"));
            loaded.start_value(place, text).map_err(told)?;
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
    fn what_is_none_says_what_one_is() {
        for text in ["", "@a.ssv", "3.2.1-cosine@", "3.2.1-cosine:=1", "3.2.1-cosine:x=", "3.2.1-cosine:x=1,", ":x=1"] {
            assert!(text.parse::<Specification>().is_err(), "{text}");
        }
    }

    #[test]
    fn results_are_kept_under_what_a_run_has_beside_its_loop() {
        assert_eq!(of("x", &[], &[]).tag(), None);
        assert_eq!(of("x", &["a/fast.ssv"], &["m[1,2]=3"]).tag().as_deref(), Some("fast,m_1,2_=3"));
    }
}
