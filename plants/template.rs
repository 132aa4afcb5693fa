//! Parts of the texts of new plants, references, sensors and actuators.

use crate::error::Invalid;
use crate::template::{Magnitudes, Plant, Request, Signals, Text, Values, texts, write_magnitudes};

/// Number of channels, and their signals where a plant has them.
pub fn channels(request: &Request, size: Option<usize>, of: fn(&Plant) -> (usize, &Signals)) -> (usize, Signals) {
    let own = request.plant.as_ref().map(of);
    own.map_or((size.unwrap_or(1), Signals::default()), |(len, signals)| (len, signals.clone()))
}

/// Number of channels, with their units and quantities.
pub fn write_channels(text: &mut Text, m: usize, signals: &Signals) {
    text.table("structure");
    text.set("channels", m, "how many");
    if signals.units.is_empty() {
        text.suggest("units", texts(&vec!["rad/s".to_owned(); m]), "of the channels; 1 where none are given");
    } else {
        text.set("units", texts(&signals.units), "of the channels");
    }
    if !signals.quantities().is_empty() {
        text.set("quantities", texts(&signals.quantities()), "quantities, for descriptions of variables");
    }
}

/// Usual magnitudes of variables by those of the plant's signals and its bandwidth, rad/s, where that is known.
///
/// # Errors
/// References that aren't as many as outputs.
pub fn write_sizes(
    text: &mut Text,
    request: &Request,
    of: impl FnOnce(&Magnitudes, f64) -> Vec<(&'static str, Values)>,
) -> Result<(), Invalid> {
    let Some(plant) = &request.plant else { return Ok(()) };
    let Ok(bandwidth) = request.speed(plant) else { return Ok(()) };
    let references = request.references(plant.sizes().2)?;
    write_magnitudes(text, Some(plant), (&references, bandwidth), |sizes| of(sizes, bandwidth));
    Ok(())
}
