//! Random plants from known uncertainty: the covariance of records, or the bounds of a description.
#![allow(non_snake_case)] // matrices have the names of the field

use std::path::Path;

use nalgebra::DMatrix;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::design::robustness::assumed::Assumed;
use crate::design::robustness::bounds::Bounds;
use crate::error::Error;
use crate::model::Description;
use crate::nominal::{Identified, Uncertainty};
use crate::simulation::{LoadedLoop, Place};
use crate::template::Plant;
use crate::text_file;

/// A component and a file, as `COMPONENT=FILE`.
#[derive(Debug, Clone, PartialEq)]
pub struct VaryFrom {
    /// Name of the component.
    pub component: String,
    /// The file.
    pub file: std::path::PathBuf,
}

impl std::str::FromStr for VaryFrom {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (component, file) = text.split_once('=').ok_or("must be COMPONENT=FILE")?;
        let (component, file) = (component.trim(), file.trim());
        if component.is_empty() || file.is_empty() {
            return Err("must be COMPONENT=FILE".to_owned());
        }
        Ok(VaryFrom { component: component.to_owned(), file: file.into() })
    }
}

/// Random matrices of a plant, and their places in a loop.
#[derive(Debug)]
pub(super) struct DrawnPlant {
    text: String,
    A: DMatrix<f64>,
    B: DMatrix<f64>,
    bounds: Bounds,
    /// Uncertain entries: number, name and place.
    names: Vec<String>,
    entries: Vec<(usize, Place)>,
    /// The others.
    constants: Vec<(String, Place, f64)>,
}

impl DrawnPlant {
    /// The plant of a component, from a file of an identified model or a description with `[nominal]`.
    ///
    /// # Errors
    /// When the file can't be read or has no uncertainty, or the component lacks entries of the matrices.
    pub fn new(of: &VaryFrom, loaded: &LoadedLoop) -> Result<Self, Error> {
        let VaryFrom { component, file } = of;
        let refuse = |reason: String| Error::Description { file: file.clone(), reason };
        let (A, B, bounds) = read(file)?;
        if bounds.dimensions() == 0 {
            return Err(refuse("has no uncertain entry of A or B, so there is nothing to vary".to_owned()));
        }
        let ((n, m), of) = (B.shape(), format!("--vary-from {component}={}", file.display()));
        let refuse = |reason: String| Error::Loop { file: of.clone().into(), reason };
        let place = |name: String| {
            let found = loaded.variable(&name).is_some_and(|(_, variable)| variable.kind == "Real");
            let reason =
                || format!("`{component}` has no parameters A[i,j] and B[i,j] of a plant of {n} states and {m} inputs");
            if !found {
                return Err(refuse(reason()));
            }
            loaded.settable(&name).map_err(refuse)
        };
        for beyond in [format!("{component}.A[{},{0}]", n + 1), format!("{component}.B[1,{}]", m + 1)] {
            if loaded.variable(&beyond).is_some() {
                return Err(refuse(format!(
                    "`{component}` has more than {n} states and {m} inputs: there is `{beyond}`"
                )));
            }
        }
        let uncertain = bounds.entries();
        let (mut names, mut entries, mut constants) = (Vec::new(), Vec::new(), Vec::new());
        for entry in 0..n * (n + m) {
            let (matrix, of) = if entry < n * n { ("A", entry) } else { ("B", entry - n * n) };
            let (name, place) = place(format!("{component}.{matrix}[{},{}]", of % n + 1, of / n + 1))?;
            if uncertain.contains(&entry) {
                names.push(name);
                entries.push((entry, place));
            } else {
                let value = if entry < n * n { A[of] } else { B[of] };
                constants.push((name, place, value));
            }
        }
        let text = format!("from {}", file.display());
        Ok(DrawnPlant { text, A, B, bounds, names, entries, constants })
    }

    /// Names of the random entries.
    pub fn names(&self) -> impl Iterator<Item = &String> {
        self.names.iter()
    }

    /// Their source, in words.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Places of these entries.
    pub fn places(&self) -> impl Iterator<Item = Place> {
        self.entries.iter().map(|(_, place)| *place)
    }

    /// Entries that are certain.
    pub fn constants(&self) -> impl Iterator<Item = (&str, f64)> {
        self.constants.iter().map(|(name, _, value)| (name.as_str(), *value))
    }

    /// Their places.
    pub fn constant_places(&self) -> impl Iterator<Item = (Place, f64)> {
        self.constants.iter().map(|(_, place, value)| (*place, *value))
    }

    /// The values of a sample from numbers between 0 and 1, one for each name.
    pub fn values(&self, numbers: &[f64]) -> Vec<f64> {
        let normal = Normal::standard();
        let parts: Vec<_> = numbers.iter().map(|number| 2.0 * number - 1.0).collect();
        let mut numbers = numbers.iter().copied();
        let of_records = self.bounds.of_normal(false, || normal.inverse_cdf(numbers.next().unwrap_or(0.5)));
        let place = of_records.unwrap_or_else(|| self.bounds.place(&parts));
        let (A, B) = (&self.A + self.bounds.A.component_mul(&place.A), &self.B + self.bounds.B.component_mul(&place.B));
        let value =
            |(entry, _): &(usize, Place)| entry.checked_sub(A.len()).map_or_else(|| A[*entry], |entry| B[entry]);
        self.entries.iter().map(value).collect()
    }
}

/// Matrices of a plant, and their bounds.
fn read(file: &Path) -> Result<(DMatrix<f64>, DMatrix<f64>, Bounds), Error> {
    let refuse = |reason: &str| Error::Description { file: file.to_owned(), reason: reason.to_owned() };
    if file.extension().is_some_and(|extension| extension == "json") {
        let Plant { A, B, records, .. } = Plant::read(file, [None, None])?;
        let records = records.ok_or_else(|| {
            refuse(
                "there is no covariance. Give a model.json of `adaptive-fmu identify`, or a description with [nominal]",
            )
        })?;
        // The uncertainty of the records only, without a margin.
        let model = Identified { margin: Some(1.0), ..records.model };
        let bounds = Assumed::new(&A, &B, &Uncertainty::Model(model)).bounds;
        return Ok((A, B, bounds));
    }
    let text = text_file::read(file).map_err(Error::file(file))?;
    let description = Description::read(&text).map_err(|invalid| refuse(&invalid.to_string()))?;
    let nominal = description.nominal.ok_or_else(|| refuse("there is no table [nominal] with the plant"))?;
    let bounds = Assumed::new(&nominal.A, &nominal.B, &nominal.uncertainty).bounds;
    Ok((nominal.A, nominal.B, bounds))
}
