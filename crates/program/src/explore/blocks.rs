//! The block diagram of a loop: its components as blocks, its connections as arrows.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::parameters::role;
use crate::catalogue::Role;
use crate::drawing::escaped;
use crate::structure::{Component, Structure};

/// Sizes in pixels.
const BLOCK: (f64, f64) = (132.0, 52.0);
const GAP: f64 = 92.0;
const LANE: f64 = 26.0;
/// The longest label of an arrow, in characters.
const LONGEST: usize = 14;

/// An arrow between two components, by their places in the row, with its signals.
struct Arrow {
    from: usize,
    to: usize,
    label: String,
}

/// The block diagram as SVG. The components form a row in the order of the signals; arrows that skip a component lead
/// over the row, those that lead back lie beneath it.
pub(super) fn svg(structure: &Structure) -> String {
    let units = row(structure);
    let arrows = arrows(structure, &units);
    let (mut over, mut beneath) = (lanes(&arrows, true), lanes(&arrows, false));
    let top = 14.0 + LANE * over.len() as f64;
    let width = units.len() as f64 * (BLOCK.0 + GAP) - GAP + 24.0;
    let height = top + BLOCK.1 + 18.0 + LANE * beneath.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
         role=\"img\" aria-label=\"{}\"><defs><marker id=\"tip\" viewBox=\"0 0 8 8\" refX=\"7.5\" refY=\"4\" \
         markerWidth=\"8\" markerHeight=\"8\" orient=\"auto\"><path class=\"tip\" d=\"M0,0L8,4L0,8z\"/></marker></defs>",
        escaped(&spoken(&units, &arrows))
    );
    for (place, unit) in units.iter().enumerate() {
        let (x, y) = (left(place), top);
        let _ = write!(
            svg,
            "<g class=\"block\" data-unit=\"{name}\"><rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" rx=\"6\"/>\
             <text class=\"unit\" x=\"{middle}\" y=\"{}\">{name}</text><text class=\"fmu\" x=\"{middle}\" y=\"{}\">{}</text></g>",
            BLOCK.0,
            BLOCK.1,
            y + 22.0,
            y + 40.0,
            escaped(&shortened(&unit.fmu, 18)),
            name = escaped(&shortened(&unit.name, 16)),
            middle = x + BLOCK.0 / 2.0,
        );
    }
    for (number, arrow) in arrows.iter().enumerate() {
        let lane = |lanes: &mut Vec<Vec<usize>>| lanes.iter().position(|lane| lane.contains(&number)).unwrap_or(0);
        let (path, (x, y)) = way(arrow, top, lane(&mut over), lane(&mut beneath));
        let label = escaped(&arrow.label);
        let _ = write!(
            svg,
            "<path class=\"arrow\" marker-end=\"url(#tip)\" d=\"{path}\"/><text class=\"signal\" x=\"{x}\" y=\"{y}\">{label}</text>"
        );
    }
    svg.push_str("</svg>");
    svg
}

fn left(place: usize) -> f64 {
    12.0 + place as f64 * (BLOCK.0 + GAP)
}

/// The components from references over controllers to plants and sensors; those of other tools in the loop's order.
fn row(structure: &Structure) -> Vec<&Component> {
    let mut units: Vec<&Component> = structure.components.iter().collect();
    let rank = |unit: &&Component| match role(structure, &unit.fmu) {
        Some(Role::Reference) => 0,
        Some(Role::Controller) => 2,
        Some(Role::Actuator | Role::Excitation) => 3,
        Some(Role::Plant | Role::Composite) => 4,
        Some(Role::Sensor) => 5,
        Some(Role::Observer) => 6,
        None => match structure.connections.iter().any(|connection| connection.to.0 == unit.name) {
            true => 4,
            false => 1,
        },
    };
    units.sort_by_key(rank);
    units
}

fn arrows(structure: &Structure, units: &[&Component]) -> Vec<Arrow> {
    let place = |name: &str| units.iter().position(|unit| unit.name == name);
    let links = structure.connections.iter().filter_map(|link| Some((place(&link.from.0)?, place(&link.to.0)?)));
    let pairs: BTreeSet<(usize, usize)> = links.collect();
    let arrow = |(from, to): (usize, usize)| {
        let between = structure
            .connections
            .iter()
            .filter(|link| place(&link.from.0) == Some(from) && place(&link.to.0) == Some(to));
        let signal = |name: &str| name.split('[').next().unwrap_or_default().to_owned();
        let mut names: Vec<String> = between.map(|link| signal(&link.from.1)).collect();
        names.dedup();
        Arrow { from, to, label: shortened(&names.join(", "), LONGEST) }
    };
    pairs.into_iter().map(arrow).collect()
}

impl Arrow {
    /// True if it leads over the row; none if it goes straight from a block to the next.
    fn is_over(&self) -> Option<bool> {
        if self.to == self.from + 1 { None } else { Some(self.to > self.from) }
    }

    fn span(&self) -> (usize, usize) {
        (self.from.min(self.to), self.from.max(self.to))
    }
}

/// Arrows, by their places, over or beneath the row, in lanes without crossings.
fn lanes(arrows: &[Arrow], over: bool) -> Vec<Vec<usize>> {
    let mut chosen: Vec<usize> = (0..arrows.len()).filter(|&k| arrows[k].is_over() == Some(over)).collect();
    chosen.sort_by_key(|&k| arrows[k].span().1 - arrows[k].span().0);
    let mut lanes: Vec<Vec<usize>> = Vec::new();
    for k in chosen {
        let (low, high) = arrows[k].span();
        let is_free =
            |lane: &Vec<usize>| lane.iter().all(|&other| arrows[other].span().1 < low || high < arrows[other].span().0);
        match lanes.iter_mut().find(|lane| is_free(lane)) {
            Some(lane) => lane.push(k),
            None => lanes.push(vec![k]),
        }
    }
    lanes
}

/// The path of an arrow, and the place of its label.
fn way(arrow: &Arrow, top: f64, over: usize, beneath: usize) -> (String, (f64, f64)) {
    let (x1, x2, middle) = (left(arrow.from), left(arrow.to), top + BLOCK.1 / 2.0);
    match arrow.is_over() {
        None => {
            let (from, to) = (x1 + BLOCK.0, x2 - 1.0);
            (format!("M{from},{middle}H{to}"), ((from + to) / 2.0, middle - 7.0))
        }
        Some(is_over) => {
            // Each lane starts and ends at its own place of a block.
            let lane = if is_over { over } else { beneath } as f64;
            let (from, to) = (x1 + BLOCK.0 * 0.62 + 9.0 * lane, x2 + BLOCK.0 * 0.38 - 9.0 * lane);
            let edge = if is_over { top } else { top + BLOCK.1 };
            let level = if is_over { top - 12.0 - LANE * lane } else { top + BLOCK.1 + 16.0 + LANE * lane };
            let text = ((from + to) / 2.0, level + if is_over { -4.0 } else { 13.0 });
            (format!("M{from},{edge}V{level}H{to}V{edge}"), text)
        }
    }
}

fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}

/// The picture in words.
fn spoken(units: &[&Component], arrows: &[Arrow]) -> String {
    let labels = arrows
        .iter()
        .map(|Arrow { from, to, label }| format!("{} passes {label} to {}", units[*from].name, units[*to].name));
    labels.collect::<Vec<_>>().join("; ")
}
