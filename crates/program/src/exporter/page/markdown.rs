//! Markdown with mathematics as HTML with MathML.

use pulldown_cmark::{CowStr, Event, Options, Parser};
use pulldown_latex::{RenderConfig, Storage, config::DisplayMode, push_mathml};

use super::escaped;

/// Markdown as HTML. Its headings are below those of the page; tables that are too wide scroll.
pub fn rendered(markdown: &str) -> String {
    let options = Options::ENABLE_MATH | Options::ENABLE_TABLES;
    let events = Parser::new_ext(markdown, options).map(|event| match event {
        Event::InlineMath(latex) => Event::InlineHtml(mathml(&latex, DisplayMode::Inline)),
        Event::DisplayMath(latex) => Event::InlineHtml(mathml(&latex, DisplayMode::Block)),
        other => other,
    });
    let mut html = String::new();
    pulldown_cmark::html::push_html(&mut html, events);
    let below = [("<h1>", "<h3>"), ("</h1>", "</h3>"), ("<h2>", "<h3>"), ("</h2>", "</h3>")];
    let scrolls = [("<table>", "<div class=\"scroll\"><table>"), ("</table>", "</table></div>")];
    below.iter().chain(&scrolls).fold(html, |html, (old, new)| html.replace(old, new))
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
}
