//! Quantities of a plant in words, of which the descriptions of a system's variables are made ([`super::Spec::about`]).

use std::collections::BTreeSet;

use nalgebra::DMatrix;

use crate::error::Invalid;

/// The longest text, in characters.
const LONGEST: usize = 100;

/// Quantities of a description, one an element of the `name`d signals; none where none are given.
///
/// # Errors
/// Which text can't be one, or how many there must be.
pub fn quantities(name: &str, given: &[String], len: usize) -> Result<Vec<String>, Invalid> {
    if given.is_empty() {
        return Ok(Vec::new());
    }
    if given.len() != len {
        return Err(Invalid::new(format!("quantities of {name}"), given.len(), format!("must be {len}")));
    }
    let mut known = BTreeSet::new();
    for text in given {
        let is_line = !text.contains(char::is_control) && text.trim() == text && !text.is_empty();
        if !is_line || text.chars().count() > LONGEST {
            let shown: String = text.escape_debug().take(LONGEST).collect();
            let allowed = format!("must be 1 … {LONGEST} characters in one line, without spaces around");
            return Err(Invalid::new(format!("quantity of {name}"), format!("`{shown}`"), allowed));
        }
        if !known.insert(text) {
            let allowed = "must be given once: each element is another quantity";
            return Err(Invalid::new(format!("quantity of {name}"), format!("`{text}`"), allowed));
        }
    }
    Ok(given.to_vec())
}

/// The quantities that the outputs y = C x are, where each of them is one state.
#[allow(non_snake_case)] // matrices have the names of the field
pub fn of_outputs(C: &DMatrix<f64>, states: &[String]) -> Vec<String> {
    let one = |row: usize| {
        let mut places = (0..C.ncols()).filter(|&column| C[(row, column)] != 0.0);
        let place = places.next().filter(|_| places.next().is_none())?;
        states.get(place).cloned()
    };
    (0..C.nrows()).map(one).collect::<Option<Vec<_>>>().unwrap_or_default()
}
