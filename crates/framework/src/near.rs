//! Names similar to one that doesn't exist. Only this module decides what a user may have meant, and how many names a
//! message lists.
//!
//! The distance between two names takes few lines, so no package computes it: the library of every FMU holds this code.

use std::borrow::Cow;

/// The most names that a message lists.
const MOST: usize = 8;
/// The most names that a user may have meant.
const MEANT: usize = 3;
/// The most letters in which a near name differs.
const FARTHEST: usize = 4;
/// Smallest number of letters of a name that others begin with.
const BEGINNING: usize = 3;

/// The names that there are, as the end of a message about one that isn't: those that the user may have meant, the allowed
/// range where only the index is wrong, then the nearest names. `all` shows all of them, as "`adaptive-fmu list`".
pub fn choice<N: AsRef<str>>(name: &str, known: &[N], all: &str) -> String {
    if known.is_empty() {
        return "there are none".to_owned();
    }
    if let Some(range) = index_range(name, known) {
        return range;
    }
    let (near, others) = sorted(name, known);
    let meant = meant(&near).map_or(String::new(), |meant| format!("{meant} There are: "));
    let begin = if meant.is_empty() { "there are: ".to_owned() } else { meant };
    if known.len() <= MOST {
        let names: Vec<_> = known.iter().map(|known| listed(known.as_ref())).collect();
        return format!("{begin}{}", names.join(", "));
    }
    let nearest: Vec<_> = near.iter().map(|(_, name)| *name).chain(others).take(MOST).map(listed).collect();
    let shown = if all.is_empty() { String::new() } else { format!(": {all} shows all") };
    format!("{begin}{}, and {} more{shown}", nearest.join(", "), known.len() - nearest.len())
}

/// A name in a list: in quotes where it holds what separates names.
fn listed(name: &str) -> Cow<'_, str> {
    if name.contains(", ") { format!("`{name}`").into() } else { name.into() }
}

/// The question whether the user meant one of these names, where one is near.
pub fn question<N: AsRef<str>>(name: &str, known: &[N]) -> Option<String> {
    meant(&sorted(name, known).0)
}

/// Rewords, as [`choice`] does, serde's message about an unknown key or item, which lists all known ones; other
/// messages stay as they are.
pub fn reworded(message: &str) -> Cow<'_, str> {
    let of = |before: &str, what: &str| {
        let (name, rest) = message.strip_prefix(before)?.split_once('`')?;
        let known: Vec<_> = rest.split('`').skip(1).step_by(2).collect();
        Some(format!("there is no {what} `{name}`; {}", choice(name, &known, "")))
    };
    let better = of("unknown field `", "key").or_else(|| of("unknown variant `", "item"));
    better.map_or(Cow::Borrowed(message), Cow::Owned)
}

/// The near names with how far they are, the nearest first, and the others, in their order.
fn sorted<'a, N: AsRef<str>>(name: &str, known: &'a [N]) -> (Vec<(usize, &'a str)>, Vec<&'a str>) {
    let (mut near, mut others) = (Vec::new(), Vec::new());
    for known in known.iter().map(AsRef::as_ref) {
        match distance(name, known) {
            Some(distance) => near.push((distance, known)),
            None => others.push(known),
        }
    }
    near.sort_by_key(|(distance, _)| *distance);
    (near, others)
}

/// The question whether the user meant one of the nearest.
fn meant(near: &[(usize, &str)]) -> Option<String> {
    let least = near.first()?.0;
    let nearest = near.iter().take_while(|(distance, _)| *distance == least).take(MEANT);
    let names: Vec<_> = nearest.map(|(_, name)| format!("`{name}`")).collect();
    let (last, before) = names.split_last()?;
    let before = if before.is_empty() { String::new() } else { format!("{} or ", before.join(", ")) };
    Some(format!("did you mean {before}{last}?"))
}

/// Distance of a known name from the one given; none if it isn't similar.
fn distance(name: &str, known: &str) -> Option<usize> {
    let (given, known) = (name.to_lowercase(), known.to_lowercase());
    if given == known {
        return Some(0);
    }
    // An element of it, or another element.
    if without_index(&known) == given || given.contains('[') && without_index(&known) == without_index(&given) {
        return Some(1);
    }
    let ends_with = |long: &str, short: &str| long.strip_suffix(short).is_some_and(|before| before.ends_with('.'));
    let own = known.rsplit('.').next().unwrap_or(&known);
    let begins = given.chars().count() >= BEGINNING && (known.starts_with(&given) || own.starts_with(&given));
    if begins || ends_with(&known, &given) || ends_with(&given, &known) {
        return Some(2);
    }
    let most = given.chars().count().div_ceil(3).min(FARTHEST);
    // A single letter is no misspelt one.
    let most = if given.chars().count() < 2 { 0 } else { most };
    let whole = changes(&given, &known, most);
    let of_element = changes(&given, without_index(&known), most).map(|changes| changes + 1);
    whole.or(of_element).map(|changes| changes + 2)
}

/// Number of letters to change, omit, insert or exchange with the next to turn one text into another (Damerau and
/// Levenshtein's distance, no letter changed twice); none if it exceeds `most`.
fn changes(one: &str, other: &str, most: usize) -> Option<usize> {
    let (one, other): (Vec<char>, Vec<char>) = (one.chars().collect(), other.chars().collect());
    if one.len().abs_diff(other.len()) > most {
        return None;
    }
    // Rows of the table, of which three are needed.
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=other.len()).collect();
    for i in 1..=one.len() {
        let mut row = vec![i];
        for j in 1..=other.len() {
            let same = usize::from(one[i - 1] != other[j - 1]);
            let mut least = (last[j] + 1).min(row[j - 1] + 1).min(last[j - 1] + same);
            if i > 1 && j > 1 && one[i - 1] == other[j - 2] && one[i - 2] == other[j - 1] {
                least = least.min(before[j - 2] + 1);
            }
            row.push(least);
        }
        before = std::mem::replace(&mut last, row);
    }
    last.last().copied().filter(|changes| *changes <= most)
}

fn without_index(name: &str) -> &str {
    name.split_once('[').map_or(name, |(name, _)| name)
}

/// The name of an element, and its indices.
fn element(name: &str) -> Option<(&str, Vec<u64>)> {
    let (array, indices) = name.strip_suffix(']')?.rsplit_once('[')?;
    let indices = indices.split(',').map(|index| index.trim().parse().ok());
    Some((array, indices.collect::<Option<_>>()?))
}

/// The range that an index must be in, where the name is one of an array's elements but for that.
fn index_range<N: AsRef<str>>(name: &str, known: &[N]) -> Option<String> {
    let (array, given) = element(name)?;
    let known = known.iter().filter_map(|known| element(known.as_ref()));
    let all: Vec<_> = known.filter(|(other, indices)| *other == array && indices.len() == given.len()).collect();
    let first = all.first()?.1.clone();
    let mut ranges: Vec<(u64, u64)> = first.into_iter().map(|index| (index, index)).collect();
    for (_, indices) in &all {
        for ((least, most), index) in ranges.iter_mut().zip(indices) {
            (*least, *most) = ((*least).min(*index), (*most).max(*index));
        }
    }
    // Of a diagonal there are not all.
    let count = ranges.iter().try_fold(1, |count: u64, (least, most)| count.checked_mul(most - least + 1));
    if count != Some(all.len() as u64) {
        return None;
    }
    let listed: Vec<_> = ranges.iter().map(|(least, most)| format!("{least} … {most}")).collect();
    let what = if listed.len() == 1 { "its index must be" } else { "its indices must be" };
    Some(format!("{what} within {} in `{array}`", listed.join(" and ")))
}

/// A fault of a text in TOML: its line, the beginning of it, and the reason.
pub fn in_line(text: &str, error: &toml::de::Error) -> String {
    let line = error.span().map_or(0, |span| text[..span.start].matches('\n').count());
    let quoted: String = text.lines().nth(line).unwrap_or("").trim().chars().take(80).collect();
    format!("line {}, `{quoted}`: {}", line + 1, reworded(error.message()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_user_may_have_meant_is_first() {
        let known = ["3.2.1-square", "3.2.1-cosine", "4-case1"];
        let message = choice("3.2.1-cosin", &known, "");
        assert_eq!(message, "did you mean `3.2.1-cosine`? There are: 3.2.1-square, 3.2.1-cosine, 4-case1");
        assert_eq!(choice("nothing", &known, ""), "there are: 3.2.1-square, 3.2.1-cosine, 4-case1");
        assert_eq!(choice("x", &[] as &[&str], ""), "there are none");
        assert_eq!(choice("max w", &["max |u|", "rms e, t >= 5 s"], ""), "there are: max |u|, `rms e, t >= 5 s`");
        for (given, near) in [
            ("omgea", "omega"),
            ("Omega", "omega"),
            ("feedback_gain", "feedback_gain[1,1]"),
            ("feedbak_gain", "feedback_gain[1,1]"),
            ("x[1]", "plant.x[1]"),
            ("plant.omega", "omega"),
            ("adaptation", "adaptation_gain"),
            ("adaptation", "controller.adaptation_gain"),
        ] {
            assert_eq!(question(given, &["other", near, "u"]).unwrap(), format!("did you mean `{near}`?"), "{given}");
        }
        for strange in ["nothing", "q", "r", ""] {
            assert_eq!(question(strange, &["omega", "u", "adaptation_gain"]), None, "{strange}");
        }
        assert_eq!(question("x3", &["x1", "x2", "y"]).unwrap(), "did you mean `x1` or `x2`?");
    }

    #[test]
    fn a_long_list_is_shortened_to_the_nearest_and_refers_to_all() {
        let known: Vec<String> = (1..=30).map(|k| format!("signal_{k}")).chain(["omega".to_owned()]).collect();
        let message = choice("omgea", &known, "`adaptive-fmu list`");
        assert!(message.starts_with("did you mean `omega`? There are: omega, signal_1, "), "{message}");
        assert!(message.ends_with(", signal_7, and 23 more: `adaptive-fmu list` shows all"), "{message}");
    }

    #[test]
    fn the_message_on_a_wrong_index_has_the_range_that_is_allowed() {
        let known = ["plant.x[1]", "plant.x[2]", "K[1,1]", "K[1,2]", "K[1,3]", "D[1,1]", "D[2,2]", "y"];
        assert_eq!(choice("plant.x[3]", &known, ""), "its index must be within 1 … 2 in `plant.x`");
        assert_eq!(choice("K[3,1]", &known, ""), "its indices must be within 1 … 1 and 1 … 3 in `K`");
        assert!(choice("D[1,2]", &known, "").starts_with("did you mean `D[1,1]` or `D[2,2]`?"));
        assert!(choice("y[1]", &known, "").starts_with("did you mean `y`?"));
    }

    #[test]
    fn keys_that_serde_does_not_know_are_reported_the_same_way() {
        let message = reworded("unknown field `strat`, expected one of `name`, `start`, `names`");
        assert_eq!(message, "there is no key `strat`; did you mean `start`? There are: name, start, names");
        assert_eq!(reworded("unknown field `a`, there are no fields"), "there is no key `a`; there are none");
        assert_eq!(reworded("missing field `model`"), "missing field `model`");
    }

    #[test]
    fn letters_that_are_left_out_put_in_changed_or_exchanged_count_one() {
        for (one, other, count) in [("gain", "gain", 0), ("gian", "gain", 1), ("gan", "gain", 1), ("gaain", "gain", 1)]
        {
            assert_eq!(changes(one, other, 4), Some(count), "{one}");
        }
        assert_eq!((changes("gain", "pole", 4), changes("gain", "pole", 3)), (Some(4), None));
        assert_eq!(changes("ä", "a", 1), Some(1));
    }
}
