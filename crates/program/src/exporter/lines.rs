//! Lines of a description in which its library refuses something.

use std::collections::HashMap;

use toml::de::{DeTable, DeValue};

/// Adds lines to the reasons of a refusal, joined by semicolons: each gets the line of the key that it begins with.
pub(super) fn placed(text: &str, reasons: &str) -> String {
    let Ok(table) = DeTable::parse(text) else { return reasons.to_owned() };
    let mut places = HashMap::new();
    collect(table.get_ref(), "", &mut places);
    let with_line = |reason: &str| match place(reason, &places) {
        Some(place) => format!("line {}: {reason}", text[..place].matches('\n').count() + 1),
        None => reason.to_owned(),
    };
    reasons.split("; ").map(with_line).collect::<Vec<_>>().join("; ")
}

/// Collects the places of a table's keys, by their full names.
fn collect(table: &DeTable, prefix: &str, places: &mut HashMap<String, usize>) {
    for (key, value) in table {
        let name = format!("{prefix}{}", key.get_ref());
        let within = format!("{name}.");
        match value.get_ref() {
            DeValue::Table(table) => collect(table, &within, places),
            // An unknown item is found by its own name.
            DeValue::String(item) => _ = places.entry(format!("{within}{item}")).or_insert(key.span().start),
            DeValue::Array(list) => {
                list.iter().filter_map(|value| value.get_ref().as_table()).for_each(|t| collect(t, &within, places));
            }
            _ => {}
        }
        places.entry(name).or_insert(key.span().start);
    }
}

/// The place of the key that a reason begins with.
fn place(reason: &str, places: &HashMap<String, usize>) -> Option<usize> {
    let find = |name: String| places.get(&name).copied();
    if let Some(rest) = reason.strip_prefix("[start] ") {
        return find(format!("start.{}", rest.split_once(" = ")?.0));
    }
    if let Some(rest) = reason.strip_prefix("[names] ") {
        return find(format!("names.{}", rest.split_once(": ")?.0));
    }
    if reason.starts_with("[structure]: ") {
        // The first quoted word names a key, which may be in a nested table, or an item.
        let about = reason.split('`').nth(1).unwrap_or_default();
        let within = || {
            let ends = |name: &&String| name.starts_with("structure.") && name.ends_with(&format!(".{about}"));
            places.keys().filter(ends).min().cloned().and_then(find)
        };
        return find(format!("structure.{about}")).or_else(within).or_else(|| find("structure".to_owned()));
    }
    let (name, _) = reason.split_once(" = ")?;
    let array = name.split_once('[').map_or(name, |(array, _)| array);
    [format!("start.{name}"), format!("start.{array}"), name.to_owned(), format!("structure.{name}")]
        .into_iter()
        .find_map(find)
}

#[cfg(test)]
mod tests {
    use super::placed;

    const TEXT: &str = "\
name = \"A\"
model = \"l2\"
[structure]
inputs = 1
filter = { order = 2 }
form = \"round\"
[start]
omega = -1.0
\"x0[2]\" = 3

feedback_gain = [
    [1.0]]
";

    #[test]
    fn each_reason_has_the_line_of_its_key() {
        for (reason, message) in [
            ("[start] omega = -1.0: must be above 0", "line 8: [start] omega = -1.0: must be above 0"),
            ("omega = -1: must be above 0", "line 8: omega = -1: must be above 0"),
            ("feedback_gain[1,1] = 1: is too small", "line 11: feedback_gain[1,1] = 1: is too small"),
            ("x0[2] = 3: a; model = `l2`: b", "line 9: x0[2] = 3: a; line 2: model = `l2`: b"),
            ("[structure]: there is no key `inputs`; none", "line 4: [structure]: there is no key `inputs`; none"),
            ("[structure]: there is no key `order`; none", "line 5: [structure]: there is no key `order`; none"),
            ("[structure]: there is no item `round`; none", "line 6: [structure]: there is no item `round`; none"),
            ("[structure]: missing field `gain`", "line 3: [structure]: missing field `gain`"),
            ("something else", "something else"),
        ] {
            assert_eq!(placed(TEXT, reason), message);
        }
        assert_eq!(placed("no TOML", "name = a"), "name = a");
    }
}
