//! Texts of C that are the same for each element of their arrays, as a loop writes them.

/// Consecutive texts that are one text of an element `i`.
#[derive(Debug, PartialEq)]
pub(super) struct Run {
    /// The text, of element `i` where there are several.
    pub text: String,
    /// Elements that it is for; none where the text is for no element, or stands by itself.
    pub elements: Option<(usize, usize)>,
}

/// Fewer texts stay as they are.
const LEAST: usize = 2;

/// The texts, of which those that differ by the number of an element are one.
pub(super) fn runs(texts: &[String]) -> Vec<Run> {
    let mut runs = Vec::new();
    let mut left = texts;
    while let [first, ..] = left {
        let own = of_element(first);
        let is_next = |(k, text): &(usize, &String)| {
            let (Some((own, number)), Some((other, of))) = (&own, of_element(text)) else { return false };
            *own == other && of == number + k
        };
        let count = left.iter().enumerate().take_while(is_next).count();
        match own {
            Some((text, number)) if count >= LEAST => {
                runs.push(Run { text, elements: Some((number, number + count)) });
                left = &left[count..];
            }
            _ => {
                runs.push(Run { text: first.clone(), elements: None });
                left = &left[1..];
            }
        }
    }
    runs
}

/// A text of an element `i`, and that element's number, if all numbers in brackets are that.
fn of_element(text: &str) -> Option<(String, usize)> {
    let (before, first) = text.split_once('[')?;
    let number = first.split(']').next()?;
    let index = number.parse().ok()?;
    let place = format!("[{number}]");
    (!before.is_empty() && text.matches('[').count() == text.matches(&place).count())
        .then(|| (text.replace(&place, "[i]"), index))
}

#[cfg(test)]
mod tests {
    use super::{Run, runs};

    #[test]
    fn texts_of_consecutive_elements_are_one() {
        let found = |texts: &[&str]| {
            let texts: Vec<String> = texts.iter().map(|text| (*text).to_owned()).collect();
            runs(&texts).into_iter().map(|Run { text, elements }| (text, elements)).collect::<Vec<_>>()
        };
        let alone = |text: &str| (text.to_owned(), None);
        assert_eq!(
            found(&["n > 0", "a[1] < b[1]", "a[2] < b[2]", "a[3] < b[3]", "a[5] < b[5]"]),
            [alone("n > 0"), ("a[i] < b[i]".to_owned(), Some((1, 4))), alone("a[5] < b[5]")]
        );
        assert_eq!(found(&["a[0] < 1", "b[1] < 1"]), ["a[0] < 1", "b[1] < 1"].map(alone), "of two arrays");
        let crossed = ["a[0] < a[1]", "a[1] < a[2]", "a[2] < a[3]"];
        assert_eq!(found(&crossed), crossed.map(alone), "of two elements each");
    }
}
