//! The system's C compiler, as the environment names it.

use std::path::Path;

/// The command in `CC`, unchanged [default: `cc`].
pub fn named() -> String {
    std::env::var("CC").ok().filter(|text| !text.trim().is_empty()).unwrap_or_else(|| "cc".to_owned())
}

/// The program of a command, and its first arguments: `ccache gcc`, `gcc -O1`.
pub fn words(command: &str) -> (String, Vec<String>) {
    // A path may have blanks, and on Windows backslashes.
    let whole = Path::new(command).is_file();
    let mut words = if whole { vec![command.to_owned()] } else { split(command, cfg!(unix)) }.into_iter();
    (words.next().unwrap_or_default(), words.collect())
}

/// Words as in a shell, without substitutions. A backslash escapes on systems where paths have none.
fn split(text: &str, escapes: bool) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                // Quotes around nothing are a word.
                word.get_or_insert_default();
            }
            (None | Some('"'), '\\') if escapes => word.get_or_insert_default().extend(characters.next()),
            (None, _) if c.is_whitespace() => words.extend(word.take()),
            _ => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_split_as_a_shell_does() {
        for (text, expected) in [
            ("cc", &["cc"][..]),
            ("ccache gcc", &["ccache", "gcc"]),
            ("  gcc\t-O1   -g ", &["gcc", "-O1", "-g"]),
            (r#"gcc '-DA="a b"' "-I/my dir" -DC=\"c\ d\""#, &["gcc", r#"-DA="a b""#, "-I/my dir", r#"-DC="c d""#]),
            (r"gcc '' x'y z'w", &["gcc", "", "xy zw"]),
            (r"gcc 'a\b'", &["gcc", r"a\b"]),
        ] {
            assert_eq!(split(text, true), expected, "{text}");
        }
        assert_eq!(split(r#""C:\Program Files\cc.exe" -O1"#, false), [r"C:\Program Files\cc.exe", "-O1"]);
    }

    #[test]
    fn a_path_that_is_there_is_a_program_whatever_it_holds() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("my own cc");
        std::fs::write(&file, "").unwrap();
        let path = file.to_str().unwrap();
        assert_eq!(words(path), (path.to_owned(), vec![]));
        assert_eq!(words("gcc -O1"), ("gcc".to_owned(), vec!["-O1".to_owned()]));
    }
}
