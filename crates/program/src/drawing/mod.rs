//! Pictures as text that needs no script: charts, their colours, and markup.

mod chart;
pub(crate) mod colours;
mod pictures;

pub(crate) use chart::{CHARTS, Chart, Line};
pub use pictures::{KEY, push_pictures};

/// Escapes text for HTML.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_from_a_description_is_no_markup() {
        assert_eq!(escaped("a<b>&\"c\""), "a&lt;b&gt;&amp;&quot;c&quot;");
    }
}
