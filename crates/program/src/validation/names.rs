//! The naming conventions of variables.

use roxmltree::Node;

use super::findings::Findings;
use super::variables::Variable;

const SECTION: &str = "2.2.9";

/// Checks the names by the convention of the description.
pub(super) fn check(root: Node, variables: &[Variable], findings: &mut Findings) {
    let structured = root.attribute("variableNamingConvention") == Some("structured");
    for variable in variables {
        if variable.name.contains(['\r', '\n', '\t']) {
            let advice = "remove line breaks and tabs from the name";
            findings.error(variable.at(), "the name contains a line break or a tab", SECTION, advice);
        } else if structured && !is_structured(variable.name) && !variable.name.is_empty() {
            let what = "the name does not follow the convention `structured`";
            let advice =
                "write it like a.b[1,2] or der(x), quote it like 'u/v', or set variableNamingConvention=\"flat\"";
            findings.error(variable.at(), what, SECTION, advice);
        }
    }
}

/// True if a name is an identifier, or the derivative of one.
fn is_structured(name: &str) -> bool {
    match name.strip_prefix("der(").and_then(|rest| rest.strip_suffix(')')) {
        Some(inner) => match inner.rsplit_once(',') {
            // The order of the derivative; but indices may also contain a comma.
            Some((of, order)) if is_number(order.trim()) => is_identifier(of),
            _ => is_identifier(inner),
        },
        None => is_identifier(name),
    }
}

fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}

/// True for parts with dots between, each with indices or without.
fn is_identifier(text: &str) -> bool {
    let mut rest = text;
    loop {
        let Some(after) = part(rest) else { return false };
        let Some(after) = indices(after) else { return false };
        match after.strip_prefix('.') {
            Some(next) => rest = next,
            None => return after.is_empty(),
        }
    }
}

/// Returns the rest after a name, plain or quoted.
fn part(text: &str) -> Option<&str> {
    if let Some(quoted) = text.strip_prefix('\'') {
        let mut escaped = false;
        let end = quoted.find(|c: char| {
            let ends = c == '\'' && !escaped;
            escaped = c == '\\' && !escaped;
            ends
        })?;
        return (end > 0).then(|| &quoted[end + 1..]);
    }
    let letter = |c: char| c.is_ascii_alphabetic() || c == '_';
    text.starts_with(letter).then(|| text.trim_start_matches(|c: char| letter(c) || c.is_ascii_digit()))
}

/// Returns the rest after indices, if there are any.
fn indices(text: &str) -> Option<&str> {
    let Some(inner) = text.strip_prefix('[') else { return Some(text) };
    let (list, rest) = inner.split_once(']')?;
    list.split(',').all(|index| is_number(index.trim())).then_some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structured_names_are_those_of_the_standard() {
        for name in
            ["x", "_a1", "a.b[1,2].c", "der(x)", "der(a.b[1],2)", "der(x[1,2])", "'any thing/else'.b", "'it\\'s'"]
        {
            assert!(is_structured(name), "{name}");
        }
        for name in
            ["", "1x", "a..b", "a.", "a b", "x[", "x[]", "x[a]", "''", "'a", "der(x", "der()", "x)", "ä", "x[1]y"]
        {
            assert!(!is_structured(name), "{name}");
        }
    }
}
