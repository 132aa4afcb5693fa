//! Parts of a kind's page that apply only to some structures.
//!
//! They are between two lines, `<!-- only: CONDITION -->` and `<!-- end -->`, and may be nested. A condition is one of
//! these, or several joined by ` or `: `key` (it is given, and isn't false), `no key`, `key = value`, `key != value`
//! (also if it isn't given). A key of a table within the structure has a dot: `network.rule`. Parts about all FMUs
//! have the condition `site`: they are on no FMU's page.

use toml::{Table, Value};

const BEGIN: &str = "<!-- only:";
const SITE: &str = "site";
const CLOSE: &str = "-->";
const END: &str = "<!-- end -->";

/// The text without the parts that apply to none of some structures, and without the lines that mark parts.
pub fn having(markdown: &str, structures: &[&Table]) -> String {
    let (mut text, mut within) = (String::new(), Vec::new());
    for line in markdown.lines() {
        if let Some(condition) = condition(line) {
            within.push(structures.iter().any(|structure| holds(condition, structure)));
        } else if line.trim() == END && within.pop().is_some() {
        } else if within.iter().all(|holds| *holds) {
            text.push_str(line);
            text.push('\n');
        }
    }
    text
}

/// The condition in a line that begins a part.
fn condition(line: &str) -> Option<&str> {
    Some(line.trim().strip_prefix(BEGIN)?.strip_suffix(CLOSE)?.trim())
}

fn holds(condition: &str, structure: &Table) -> bool {
    condition != SITE
        && condition.split(" or ").map(str::trim).any(|term| {
            if let Some((key, value)) = term.split_once("!=") {
                return !find(structure, key.trim()).is_some_and(|found| is(found, value.trim()));
            }
            if let Some((key, value)) = term.split_once('=') {
                return find(structure, key.trim()).is_some_and(|found| is(found, value.trim()));
            }
            let (key, wanted) = term.strip_prefix("no ").map_or((term, true), |key| (key, false));
            let given = find(structure, key.trim()).is_some_and(|value| *value != Value::Boolean(false));
            given == wanted
        })
}

fn find<'a>(structure: &'a Table, key: &str) -> Option<&'a Value> {
    match key.split_once('.') {
        None => structure.get(key),
        Some((table, rest)) => find(structure.get(table)?.as_table()?, rest),
    }
}

fn is(value: &Value, text: &str) -> bool {
    value.as_str().map_or_else(|| value.to_string() == text, |found| found == text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Entry;
    use crate::library::CATALOGUE;

    fn structure(text: &str) -> Table {
        text.parse().unwrap()
    }

    #[test]
    fn what_a_unit_does_not_have_is_left_out() {
        let page = "a\n<!-- only: baseline = inside or baseline = outside -->\nb\n<!-- only: filter -->\nc\n<!-- end -->\n\
                    <!-- end -->\n<!-- only: no unmatched -->\nd\n<!-- end -->\ne";
        let shown = |text: &str| having(page, &[&structure(text)]).replace('\n', "");
        assert_eq!(shown(""), "ade");
        assert_eq!(shown("baseline = 'none'\nunmatched = true"), "ae");
        assert_eq!(shown("baseline = 'inside'\nunmatched = false"), "abde");
        assert_eq!(shown("baseline = 'outside'\nfilter = { poles = [1.0] }"), "abcde");
    }

    #[test]
    fn what_is_for_the_site_alone_is_in_no_unit() {
        let page = "a\n<!-- only: site -->\nb\n<!-- end -->\n<!-- only: rule != given -->\nc\n<!-- end -->";
        assert_eq!(having(page, &[&structure("")]), "a\nc\n");
        assert_eq!(having(page, &[&structure("rule = 'given'")]), "a\n");
    }

    #[test]
    fn a_key_within_a_table_is_found() {
        let page = "<!-- only: network.rule = given -->\na\n<!-- end -->";
        assert_eq!(having(page, &[&structure("network = { rule = 'given' }")]), "a\n");
        assert_eq!(having(page, &[&structure("network = { rule = 'other' }"), &structure("")]), "");
    }

    #[test]
    fn parts_of_pages_depend_on_keys_that_their_kinds_have_and_are_closed() {
        let mut count = 0;
        for entry in CATALOGUE {
            // A page may contain another's, parts of which are then never shown.
            let contained =
                CATALOGUE.iter().filter(|other| entry.kind.documentation.contains(other.kind.documentation));
            let schema =
                |contained: &Entry| (contained.schema)(schemars::SchemaGenerator::default()).to_value().to_string();
            let schema: String = contained.map(schema).collect();
            let text = [entry.kind.documentation, entry.guide.purpose, entry.guide.limits].join("\n");
            let conditions: Vec<&str> = text.lines().filter_map(condition).collect();
            for term in
                conditions.iter().filter(|condition| **condition != SITE).flat_map(|condition| condition.split(" or "))
            {
                let key = term.trim().trim_start_matches("no ").split(['=', '!']).next().unwrap().trim();
                for key in key.split('.') {
                    assert!(schema.contains(&format!("\"{key}\":")), "{}: no key `{key}`", entry.kind.name);
                }
                if let Some((_, value)) = term.split_once('=') {
                    let value = value.trim();
                    let known = schema.contains(&format!("\"{value}\""))
                        || value.parse::<i64>().is_ok()
                        || value.parse::<bool>().is_ok();
                    assert!(known, "{}: no value `{value}`", entry.kind.name);
                }
            }
            let ends = text.lines().filter(|line| line.trim() == END).count();
            assert_eq!(ends, conditions.len(), "{}", entry.kind.name);
            count += conditions.len();
        }
        assert!(count > 20, "{count} parts");
    }
}
