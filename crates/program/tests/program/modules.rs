//! No two modules of the sources depend on each other, directly or through others.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{read_dir, read_to_string};
use std::path::{Path, PathBuf};

use common::at_top;

type Modules = BTreeMap<String, BTreeSet<String>>;

/// The Rust files in a folder, or a file itself.
fn files(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() {
        return read_dir(path).unwrap().flat_map(|entry| files(&entry.unwrap().path())).collect();
    }
    path.extension().is_some_and(|extension| extension == "rs").then(|| path.to_owned()).into_iter().collect()
}

/// The names behind `crate::` in a text, outside of its comments and of its own tests.
fn known(text: &str) -> BTreeSet<String> {
    let own = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let lines: Vec<_> = own.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    let text = lines.join("\n");
    let names = text.split("crate::").skip(1).flat_map(|behind| {
        let many = behind.strip_prefix('{').map(|list| list.split(['}', ';']).next().unwrap_or_default());
        many.unwrap_or(behind).split(',').take(if many.is_some() { usize::MAX } else { 1 })
    });
    let plain = |c: char| c.is_alphanumeric() || c == '_';
    names.map(|name| name.trim_start().split(|c| !plain(c)).next().unwrap_or_default().to_owned()).collect()
}

/// The modules in some folders, and the modules that each uses; what isn't a module is left out.
fn modules(folders: &[&str], without: &[&str]) -> Modules {
    let entries = folders.iter().flat_map(|folder| {
        let path = at_top(folder);
        if *folder == "plants" {
            vec![path]
        } else {
            read_dir(path).unwrap().map(|entry| entry.unwrap().path()).collect()
        }
    });
    let mut modules = Modules::new();
    for entry in entries {
        let name = entry.file_stem().unwrap().to_str().unwrap().to_owned();
        let of_tests = |file: &PathBuf| file.iter().any(|part| part == "tests" || part == "tests.rs");
        let sources: Vec<_> = files(&entry).into_iter().filter(|file| !of_tests(file)).collect();
        if sources.is_empty() {
            continue;
        }
        let names = sources.iter().flat_map(|file| {
            // The parent of a module is the package.
            let is_module = *file == entry || file.parent() == Some(&entry) && file.ends_with("mod.rs");
            let text = read_to_string(file).unwrap();
            known(&if is_module { text.replace("super::", "crate::") } else { text })
        });
        modules.entry(name).or_default().extend(names);
    }
    modules.retain(|name, _| !without.contains(&name.as_str()));
    let names: BTreeSet<_> = modules.keys().cloned().collect();
    for (name, known) in &mut modules {
        known.retain(|known| known != name && names.contains(known));
    }
    modules
}

/// A cycle of dependences from a module back to itself.
fn cycle(modules: &Modules) -> Option<Vec<String>> {
    fn follow(modules: &Modules, way: &mut Vec<String>) -> bool {
        let last = way.last().unwrap().clone();
        modules[&last].iter().any(|next| {
            way.push(next.clone());
            let closed = *next == way[0] || (!way[..way.len() - 1].contains(next) && follow(modules, way));
            if !closed {
                way.pop();
            }
            closed
        })
    }
    modules.keys().find_map(|name| {
        let mut way = vec![name.clone()];
        follow(modules, &mut way).then_some(way)
    })
}

#[test]
fn no_two_modules_depend_on_each_other() {
    let framework = modules(&["crates/framework/src"], &["lib"]);
    let models = modules(&["src", "plants"], &["lib"]);
    let program = modules(&["crates/program/src"], &["lib"]);
    assert!(framework.len() > 8 && framework["fmi2"].contains("system"), "{framework:?}");
    assert!(models.len() > 4 && models["plants"].contains("mathematics"), "{models:?}");
    assert!(program.len() > 12 && program["fmu"].contains("exporter"), "{program:?}");
    assert_eq!([cycle(&framework), cycle(&models), cycle(&program)], [None, None, None]);
    let architecture = read_to_string(at_top("ARCHITECTURE.md")).unwrap();
    for (folder, modules) in [("crates/framework", framework), ("crates/program", program)] {
        let table =
            architecture.split(&format!("| module of `{folder}` |")).nth(1).unwrap().split("\n\n").next().unwrap();
        let mut above = BTreeSet::new();
        for row in table.lines().skip(2) {
            let names: Vec<_> = row.split('|').nth(1).unwrap().split('`').skip(1).step_by(2).collect();
            above.extend(names.iter().map(|name| name.trim_end_matches(".rs").to_owned()));
            for (name, known) in
                modules.iter().filter(|(name, _)| names.iter().any(|it| it.trim_end_matches(".rs") == *name))
            {
                assert!(known.is_subset(&above), "ARCHITECTURE.md lists {name} above what it uses: {known:?}");
            }
        }
        assert_eq!(above, modules.into_keys().collect(), "modules of {folder} in ARCHITECTURE.md");
    }
}

#[test]
fn no_two_files_of_these_folders_depend_on_each_other() {
    let program =
        ["structure", "simulation", "figures", "results", "analysis"].map(|name| format!("crates/program/src/{name}"));
    for folder in program.iter().map(String::as_str).chain(["crates/framework/src/fmi2"]) {
        let files = modules(&[folder], &["mod"]);
        assert!(files.values().any(|known| !known.is_empty()), "{folder}: {files:?}");
        assert_eq!(cycle(&files), None, "{folder}");
    }
    let mut python = Modules::new();
    for file in read_dir(at_top("python/adaptive_fmu")).unwrap().map(|entry| entry.unwrap().path()) {
        let Ok(text) = read_to_string(&file) else { continue };
        let name = |behind: &str| behind.split_whitespace().next().unwrap_or_default().to_owned();
        python.insert(
            file.file_stem().unwrap().to_str().unwrap().to_owned(),
            text.split("from .").skip(1).map(name).collect(),
        );
    }
    let names: BTreeSet<_> = python.keys().cloned().collect();
    python.values_mut().for_each(|known| known.retain(|name| names.contains(name)));
    assert!(python["_result"].contains("_errors"), "{python:?}");
    assert_eq!(cycle(&python), None);
}

#[test]
fn a_cycle_through_others_is_found() {
    let set = |names: &[&str]| names.iter().map(ToString::to_string).collect::<BTreeSet<_>>();
    let mut modules = Modules::from([("a".into(), set(&["b"])), ("b".into(), set(&["c"])), ("c".into(), set(&[]))]);
    assert_eq!(cycle(&modules), None);
    modules.insert("c".into(), set(&["b"]));
    assert_eq!(cycle(&modules).unwrap(), ["b", "c", "b"]);
    let text = "use crate::{error, system};\n// crate::no\ncrate::fmi2::x";
    assert_eq!(known(text), set(&["error", "system", "fmi2"]));
}
