//! Sources of components: archives or descriptions.

use std::path::{Component, Path, PathBuf};

use super::files::is_inside;

/// Origin of a component's FMU.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum UnitFile {
    /// A folder of FMUs, by its name; without one, it is exported from the description of that name.
    Named,
    /// An archive that is taken as it is.
    Archive {
        /// Its path.
        path: PathBuf,
        /// True if it isn't in the loop's resources under its name.
        elsewhere: bool,
    },
    /// A description from which it is exported.
    Description(PathBuf),
}

/// Allowed sources, for messages.
const ALLOWED: &str = "must be resources/NAME.fmu, or the path or file: URI of another FMU or description (.toml)";

/// The name of an FMU, and its origin. The path is relative to a folder, which an archive's sources can't leave.
///
/// # Errors
/// If there is no such FMU, with the reason.
pub(super) fn unit_file(source: &str, folder: Option<&Path>, is_archive: bool) -> Result<(String, UnitFile), String> {
    let refuse = |reason: &str| Err(format!("source = {source}: {reason}"));
    let named = source.strip_prefix("resources/").and_then(|name| name.strip_suffix(".fmu"));
    let named = named.filter(|name| is_inside(name)).map(str::to_owned);
    let Some(folder) = folder else {
        return named.map_or_else(|| refuse(ALLOWED), |name| Ok((name, UnitFile::Named)));
    };
    // A name may contain a literal percent sign.
    let relative = if folder.join(source).is_file() { Ok(PathBuf::from(source)) } else { path_of(source) };
    let Ok(relative) = relative else { return refuse(ALLOWED) };
    let path = folder.join(&relative);
    let stem = path.file_stem().and_then(|stem| stem.to_str()).filter(|stem| !stem.contains(char::is_control));
    let extension = path.extension().and_then(|extension| extension.to_str());
    let (Some(stem), Some(extension @ ("fmu" | "toml"))) = (stem, extension) else { return refuse(ALLOWED) };
    let stays = relative.components().all(|part| matches!(part, Component::Normal(_)));
    if is_archive && !stays {
        return refuse("leads out of the archive; must be resources/NAME.fmu");
    }
    match (extension, named) {
        ("fmu", Some(name)) if path.is_file() => Ok((name, UnitFile::Archive { path, elsewhere: false })),
        ("fmu", Some(name)) => Ok((name, UnitFile::Named)),
        ("fmu", None) if path.is_file() => {
            Ok((stem.to_owned(), UnitFile::Archive { path: path.clone(), elsewhere: true }))
        }
        ("toml", _) if path.is_file() => Ok((stem.to_owned(), UnitFile::Description(path.clone()))),
        _ => refuse(&format!("there is no file {}; {ALLOWED}", path.display())),
    }
}

/// The path that a source names: a URI of a file, or a relative one, whose percent codes stand for bytes.
fn path_of(source: &str) -> Result<PathBuf, ()> {
    let scheme = source
        .split_once(':')
        .map(|(scheme, _)| scheme)
        .filter(|scheme| scheme.len() > 1 && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c)));
    let rest = match scheme {
        None => source,
        Some(scheme) if scheme.eq_ignore_ascii_case("file") => {
            let rest = &source[scheme.len() + 1..];
            match rest.strip_prefix("//") {
                None => rest,
                Some(rest) => {
                    let (host, _) = rest.split_at(rest.find('/').ok_or(())?);
                    if !(host.is_empty() || host.eq_ignore_ascii_case("localhost")) {
                        return Err(());
                    }
                    &rest[host.len()..]
                }
            }
        }
        Some(_) => return Err(()),
    };
    let path = decoded(rest)?;
    // On Windows the path of file:///C:/x begins with the drive.
    let drive = path.strip_prefix('/').filter(|path| cfg!(windows) && path.as_bytes().get(1) == Some(&b':'));
    Ok(PathBuf::from(drive.unwrap_or(&path)))
}

/// A text with bytes in place of percent codes.
fn decoded(text: &str) -> Result<String, ()> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&first, after)) = rest.split_first() {
        rest = after;
        if first != b'%' {
            bytes.push(first);
            continue;
        }
        let code = after.get(..2).and_then(|code| std::str::from_utf8(code).ok()).ok_or(())?;
        bytes.push(u8::from_str_radix(code, 16).map_err(|_| ())?);
        rest = &after[2..];
    }
    String::from_utf8(bytes).ok().filter(|text| !text.contains('\0')).ok_or(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_uri_of_a_file_is_a_path() {
        let path = |source: &str| path_of(source).map(|path| path.to_str().unwrap().to_owned());
        for source in [
            "file:///a b/c.fmu",
            "file:///a%20b/c.fmu",
            "file://localhost/a%20b/c%2Efmu",
            "FILE:/a b/c.fmu",
            "/a%20b/c.fmu",
        ] {
            assert_eq!(path(source), Ok("/a b/c.fmu".to_owned()), "{source}");
        }
        assert_eq!(path("../m%C3%B6tor.fmu"), Ok("../mötor.fmu".to_owned()));
        for source in
            ["https://example.org/a.fmu", "file://elsewhere/a.fmu", "%", "%2", "%zz.fmu", "%ff.fmu", "a%00.fmu"]
        {
            assert_eq!(path(source), Err(()), "{source}");
        }
    }

    #[test]
    fn a_unit_is_an_archive_a_description_or_a_name() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        std::fs::create_dir_all(root.join("loop/resources")).unwrap();
        for file in ["loop/resources/A.fmu", "loop/resources/B.toml", "C d.fmu", "loop/5%.fmu"] {
            std::fs::write(root.join(file), "").unwrap();
        }
        let inside = root.join("loop");
        let find = |source: &str| unit_file(source, Some(&inside), false);
        let archive = |path: PathBuf, elsewhere| UnitFile::Archive { path, elsewhere };
        let found = find("resources/A.fmu").unwrap();
        assert_eq!(found, ("A".to_owned(), archive(inside.join("resources/A.fmu"), false)));
        assert_eq!(find("resources/Gone.fmu").unwrap(), ("Gone".to_owned(), UnitFile::Named));
        assert!(matches!(find("resources/B.toml").unwrap(), (name, UnitFile::Description(_)) if name == "B"));
        let uri = format!("file://{}", root.join("C%20d.fmu").display());
        for source in ["../C d.fmu", "../C%20d.fmu", &uri] {
            assert!(
                matches!(find(source).unwrap(), (name, UnitFile::Archive { elsewhere: true, .. }) if name == "C d"),
                "{source}"
            );
        }
        assert_eq!(find("5%.fmu").unwrap().0, "5%");
        assert!(find("../Gone.fmu").unwrap_err().contains("there is no file"));
        assert!(find("a.txt").is_err() && find("https://example.org/A.fmu").is_err());
        // Sources in an archive can't leave it.
        for source in ["../C d.fmu", "..%2FC%20d.fmu", &uri] {
            assert!(
                unit_file(source, Some(&inside), true).unwrap_err().contains("leads out of the archive"),
                "{source}"
            );
        }
        assert!(unit_file("resources/A.fmu", Some(&inside), true).is_ok() && unit_file(&uri, None, false).is_err());
    }
}
