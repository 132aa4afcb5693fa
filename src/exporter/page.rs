//! documentation/index.html: what an FMU is, its equations and its variables; readable without a network.

use std::fmt::Write;

use pulldown_cmark::{CowStr, Event, Options, Parser};
use pulldown_latex::{RenderConfig, Storage, config::DisplayMode, push_mathml};

use super::report;
use crate::fmi2::build::Build;
use crate::fmi2::describe::Unit;
use crate::model_description::ModelDescription;

const STYLE: &str = "
  body { font: 16px/1.5 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #1b1b1b; }
  table { border-collapse: collapse; width: 100%; font-size: .9em; }
  td, th { border-bottom: 1px solid #ddd; padding: .25em .6em; text-align: left; vertical-align: top; }
  code { font-family: ui-monospace, monospace; }
  .scroll { overflow-x: auto; }
  .report td { white-space: pre-line; }
  math[display=block] { margin: .7em 0; padding: .3em 0; overflow-x: auto; overflow-y: hidden; }
  @media (prefers-color-scheme: dark) { body { background: #161616; color: #e6e6e6; } td, th { border-color: #444; } }
  footer { margin-top: 3em; font-size: .85em; opacity: .7; }
";

/// The page of a unit.
pub fn html(unit: &Unit, build: &Build) -> String {
    let name = escaped(&unit.name);
    let description = ModelDescription::read(&unit.model_description).ok();
    let summary = description.as_ref().map_or(String::new(), |description| escaped(&description.description));
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{name}</title>\n<style>{STYLE}</style>\n</head>\n\
         <body>\n<h1>{name}</h1>\n<p>{summary}.</p>\n{}{}",
        description.as_ref().map_or(String::new(), about),
        rendered(&unit.documentation)
    );
    report::push(&mut page, &unit.report);
    if let Some(description) = &description {
        push_variables(&mut page, description);
    }
    let Build { version, target, compiler, .. } = build;
    let _ = writeln!(
        page,
        "<footer>FMI 2.0 unit for co-simulation and model exchange, made by adaptive-fmu {version} ({target}, {compiler}). \
         It reads nothing but its own resources, writes nothing, and needs no network.</footer>\n</body>\n</html>"
    );
    page
}

/// Whose the unit is, in a line.
fn about(description: &ModelDescription) -> String {
    let texts = description.about.iter().map(|(key, text)| match *key {
        "author" => format!("By {}", escaped(text)),
        "copyright" => escaped(text),
        key => format!("{key} {}", escaped(text)),
    });
    let texts = texts.collect::<Vec<_>>().join(", ");
    if texts.is_empty() { texts } else { format!("<p>{texts}.</p>\n") }
}

fn push_variables(page: &mut String, description: &ModelDescription) {
    for (causality, title) in
        [("input", "Inputs"), ("output", "Outputs"), ("parameter", "Parameters"), ("local", "Local variables")]
    {
        let mut variables = description.variables.iter().filter(|variable| variable.causality == causality).peekable();
        if variables.peek().is_none() {
            continue;
        }
        let _ = writeln!(
            page,
            "<h2>{title}</h2>\n<div class=\"scroll\"><table>\n<tr><th>name<th>what it is<th>unit<th>start<th>allowed<th>changes"
        );
        for variable in variables {
            let shown = |value: &Option<String>| value.as_ref().map(|value| variable.shown(value));
            let limits = match (shown(&variable.min), shown(&variable.max)) {
                (Some(min), Some(max)) => format!("{min} … {max}"),
                (Some(min), None) => format!("≥ {min}"),
                (None, Some(max)) => format!("≤ {max}"),
                (None, None) => String::new(),
            };
            let cells = [
                &variable.description,
                variable.unit.as_ref().unwrap_or(&String::new()),
                &shown(&variable.start).unwrap_or_default(),
                &limits,
                &variable.variability,
            ]
            .map(|text| format!("<td>{}", escaped(text)));
            let _ = writeln!(page, "<tr><td><code>{}</code>{}", escaped(&variable.name), cells.concat());
        }
        page.push_str("</table></div>\n");
    }
}

/// Markdown with mathematics as HTML with MathML.
fn rendered(markdown: &str) -> String {
    let options = Options::ENABLE_MATH | Options::ENABLE_TABLES;
    let events = Parser::new_ext(markdown, options).map(|event| match event {
        Event::InlineMath(latex) => Event::InlineHtml(mathml(&latex, DisplayMode::Inline)),
        Event::DisplayMath(latex) => Event::InlineHtml(mathml(&latex, DisplayMode::Block)),
        other => other,
    });
    let mut html = String::new();
    pulldown_cmark::html::push_html(&mut html, events);
    html
}

fn mathml(latex: &str, display_mode: DisplayMode) -> CowStr<'static> {
    let storage = Storage::new();
    let parser = pulldown_latex::Parser::new(latex, &storage);
    let config = RenderConfig { display_mode, ..RenderConfig::default() };
    let mut text = String::new();
    match push_mathml(&mut text, parser, config) {
        Ok(()) if !text.contains("<merror") => text.into(),
        _ => format!("<code>{}</code>", escaped(latex)).into(),
    }
}

/// Text that is no markup in HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::REGISTRY;

    #[test]
    fn every_equation_of_the_documentation_becomes_mathml() {
        for kind in REGISTRY {
            let page = rendered(kind.documentation);
            let dollars = kind.documentation.matches('$').count();
            assert!(dollars > 0 && page.contains("<math"), "{} has no equation", kind.name);
            assert!(!page.contains("<code>\\") && !page.contains('$'), "{}: {page}", kind.name);
        }
    }

    #[test]
    fn text_from_a_description_is_no_markup() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
    }
}
