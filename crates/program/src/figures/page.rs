//! Pages with diagrams that a reader can zoom, in one file that loads nothing.

use std::fmt::Write;

use super::diagram::{Diagram, groups};
use crate::drawing::escaped;

/// Policy with which a browser loads nothing.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:";
/// Policy with which a browser loads nothing, and runs nothing.
const STILL: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:";
/// Style of pages.
pub const STYLE: &str = "
  body { font: 16px/1.5 system-ui, sans-serif; max-width: 75em; margin: 1.5em auto; padding: 0 1em; color: #1b1b1b; }
  h1 { font-size: 1.5em; margin-bottom: 0; }
  h2 { font-size: 1.1em; margin: 1.5em 0 0.3em; }
  table { border-collapse: collapse; }
  td, th { border-bottom: 1px solid #ddd; padding: 0.25em 1.2em 0.25em 0; text-align: left; vertical-align: top; }
  .number { text-align: right; font-variant-numeric: tabular-nums; }
  .scroll { overflow-x: auto; }
  .bad { color: #b00020; font-weight: bold; }
  @media print { body { margin: 0; font-size: 12px; } .diagram, table { break-inside: avoid; } }
";
/// Style of diagrams.
pub const DIAGRAMS: &str = "
  .diagram { display: flex; gap: 0.8em; }
  .plot { position: relative; flex: 1; min-width: 0; }
  .plot svg { display: block; overflow: hidden; user-select: none; touch-action: pan-y; cursor: crosshair; }
  .plot text { font-size: 12px; fill: #444; }
  .plot path { fill: none; }
  .plot .grid { stroke: #e4e4e4; }
  .plot .curve { stroke-width: 1.5; stroke-linejoin: round; }
  .plot .ghost { stroke-width: 1.5; stroke-opacity: 0.35; }
  .plot .beneath { stroke-width: 3.2; stroke-opacity: 0.55; }
  .plot .mark { stroke: #888; }
  .plot .event { stroke: #b00020; stroke-dasharray: 2 3; }
  .plot .zoomed { fill: #0002; }
  .legend { flex: 0 0 15em; margin: 0.4em 0 0; display: flex; flex-direction: column; align-items: start; }
  .legend button, .peak { border: 0; padding: 0.15em 0; background: none; font: inherit; font-size: 0.85em; text-align: left;
    cursor: pointer; overflow-wrap: anywhere; }
  .legend svg { vertical-align: middle; margin-right: 0.5em; }
  .legend .hidden { opacity: 0.4; text-decoration: line-through; }
  .peak { display: block; margin-left: 76px; color: #0b5394; text-decoration: underline; }
  .peak[hidden] { display: none; }
  .readout { position: absolute; top: 14px; padding: 0.1em 0.5em; background: #fffd; border: 1px solid #ccc; font-size: 0.8em;
    pointer-events: none; z-index: 1; max-width: 100%; box-sizing: border-box; overflow-wrap: anywhere; }
  .readout div::before { content: '\\25ac '; color: var(--colour); }
  @media (max-width: 50em) { .diagram { display: block; }
    .legend { flex-flow: row wrap; gap: 0 1.2em; margin: 0.2em 0 0 1em; } }
  #metrics td:first-child, #metrics .label, h1, p { overflow-wrap: anywhere; }
  #metrics td:first-child, #metrics .label { min-width: 5em; max-width: 20em; }
  @media (max-width: 50em) { #metrics { font-size: 0.8em; } #metrics td, #metrics th { padding-right: 0.6em; } }
  @media print { .diagram { display: block; } .legend { flex-flow: row wrap; gap: 0 1.2em; } }
  @media screen { :root { color-scheme: light dark; } }
  @media screen and (prefers-color-scheme: dark) {
    body { color: #e8e8e8; background: #15181d; }
    td, th { border-color: #444; }
    .bad { color: #ff8a8a; }
    .plot text { fill: #bbb; }
    .plot .grid { stroke: #333a42; }
    .plot .event { stroke: #ff8a8a; }
    .plot .zoomed { fill: #fff2; }
    .plot path[stroke='#000000'], .legend path[stroke='#000000'] { stroke: #ddd; }
    .plot path[stroke='#0072B2'], .legend path[stroke='#0072B2'] { stroke: #4da6e0; }
    .readout { background: #22272eee; border-color: #555; }
    div[style*='#000000']::before { color: #ddd; }
    .legend button, .peak { color: inherit; }
    .chart { background: #f4f4f4; }
  }
";
/// Script that draws the diagrams, and lets a reader zoom them.
pub const SCRIPT: &str = include_str!("page.js");

/// The beginning of a page that needs no script and loads nothing: title, subject, and style in addition to that of
/// every page.
pub fn still(title: &str, about: &str, style: &str) -> String {
    let (title, about) = (escaped(title), escaped(about));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{STILL}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n<style>{STYLE}{style}</style>\n</head>\n\
         <body>\n<h1>{title}</h1>\n<p>{about}</p>\n"
    )
}

/// The end of such a page.
pub fn still_ending() -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("<p>Made by adaptive-fmu {version}, from runs of FMUs.</p>\n</body>\n</html>\n")
}

/// Adds diagrams to a page, each as data that [`SCRIPT`] draws.
pub(crate) fn push_diagrams(page: &mut String, diagrams: &[Diagram]) {
    let groups = groups(diagrams.iter().map(|diagram| diagram.curves.len()).sum());
    for diagram in diagrams {
        // No text of a name can end the script.
        let numbers = diagram.with_points(groups).to_string().replace('<', "\\u003c");
        let _ = writeln!(
            page,
            "<h2>{}</h2>\n<div class=\"diagram\"><script type=\"application/json\">{numbers}</script></div>",
            escaped(&diagram.title)
        );
    }
}

/// A page up to its title and its subject.
pub(crate) fn beginning(name: &str, description: &str) -> String {
    let (name, description) = (escaped(name), escaped(description));
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{POLICY}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<link rel=\"icon\" href=\"data:,\">\n\
         <title>{name}</title>\n<style>{STYLE}{DIAGRAMS}</style>\n</head>\n<body>\n<h1>{name}</h1>\n<p>{description}</p>\n"
    )
}

/// Adds the script that draws the diagrams of a page, and its end.
pub(crate) fn ending(page: &mut String) {
    let _ = writeln!(page, "<script>\n{SCRIPT}</script>\n</body>\n</html>");
}
