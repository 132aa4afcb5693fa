//! A search that goes on from a file believes nothing in it that no search has left.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use adaptive_fmu::tuning::{Question, Record, Swarm};
use serde_json::{Value, json};

const SEARCH: [&str; 9] = [
    "tune",
    "4-case1-fuzzy",
    "--composite",
    "--until",
    "0.02",
    "--set",
    "integration_method=stiff",
    "--particles",
    "4",
];

fn tune(out: &Path, options: &[&str]) -> Output {
    let mut program = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    program.args(SEARCH).args(options).arg("--out").arg(out).output().unwrap()
}

/// A search of a few generations: its file, and what it asks.
fn searched(out: &Path) -> (PathBuf, Question) {
    let done = tune(out, &["--generations", "3"]);
    assert!(done.status.success(), "{done:?}");
    let file = out.join("4-case1-fuzzy-tuned").join("search.json");
    let record: Record = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    (file, record.question)
}

/// The ways to all values of a file that hold no others.
fn leaves(value: &Value, way: &str, found: &mut Vec<String>) {
    match value {
        Value::Object(entries) if !entries.is_empty() => {
            entries.iter().for_each(|(key, value)| leaves(value, &format!("{way}/{key}"), found));
        }
        Value::Array(entries) if !entries.is_empty() => {
            entries.iter().enumerate().for_each(|(k, value)| leaves(value, &format!("{way}/{k}"), found));
        }
        _ => found.push(way.to_owned()),
    }
}

/// The same file without one value.
fn without(whole: &Value, way: &str) -> Value {
    let mut edited = whole.clone();
    let (parent, key) = way.rsplit_once('/').unwrap();
    match edited.pointer_mut(parent).unwrap() {
        Value::Object(entries) => drop(entries.remove(key)),
        Value::Array(entries) => drop(entries.remove(key.parse().unwrap())),
        _ => unreachable!(),
    }
    edited
}

/// Every edit of one value, by its way and what was done to it.
fn edits(whole: &Value) -> Vec<(String, Value)> {
    let mut ways = Vec::new();
    leaves(whole, "", &mut ways);
    assert!(ways.len() > 150, "{}", ways.len());
    let mut edits = Vec::new();
    for way in ways {
        let was = whole.pointer(&way).unwrap().clone();
        let near = was.as_f64().map(|number| json!(number * (1.0 + 1e-15)));
        let next = was.as_u64().map(|number| json!(number.wrapping_add(1)));
        let others = [json!(0), json!(-1), json!(1e308), json!(null), json!("x"), json!([]), json!({}), json!(true)];
        for other in others.into_iter().chain(near).chain(next) {
            let mut edited = whole.clone();
            *edited.pointer_mut(&way).unwrap() = other.clone();
            edits.push((format!("{way} = {other} (was {was})"), edited));
        }
        edits.push((format!("{way} deleted"), without(whole, &way)));
    }
    edits
}

/// The swarm that goes on from a file, or the message if none does.
fn resumed(file: &Path, text: &str, question: &Question) -> Result<Swarm, String> {
    fs::write(file, text).unwrap();
    Record::resume(file, question).map_err(|error| error.to_string())
}

#[test]
fn every_edit_of_a_single_value_is_refused_or_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (file, question) = searched(folder.path());
    let text = fs::read_to_string(&file).unwrap();
    let swarm = resumed(&file, &text, &question).unwrap();
    let (mut refused, mut named) = (0, 0);
    for (edit, edited) in edits(&serde_json::from_str(&text).unwrap()) {
        match resumed(&file, &edited.to_string(), &question) {
            Ok(same) => assert_eq!(same, swarm, "{edit}"),
            Err(message) => {
                assert!(message.contains("search.json: "), "{edit}: {message}");
                refused += 1;
                named += usize::from(!message.contains("checksum"));
            }
        }
    }
    // The key reveals most; the checksum reveals the rest, such as values within their bounds.
    assert!(refused > 1500 && named * 2 > refused, "{named} of {refused}");
}

#[test]
fn a_refusal_names_the_key_its_value_and_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let (file, question) = searched(folder.path());
    let whole: Value = serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    for (way, value, expected) in [
        (
            "/swarm/particles/1/position/0",
            json!(100),
            "swarm.particles[1].position[0] = 100: must be a number from 8.0 to",
        ),
        ("/swarm/particles/1/velocity", json!([]), "swarm.particles[1].velocity has 0 entries: must have 9"),
        ("/swarm/particles", json!([]), "swarm.particles has 0 entries: must have 4"),
        ("/swarm/random", json!(-1), "swarm.random = -1: must be a whole number from 0 to 18446744073709551615"),
        ("/swarm/bounds/0/1", json!(7), "swarm.bounds[0][1] = 7: must be 12.0, as in question"),
        ("/swarm/best/value", json!(-1e9), "swarm.best.value = -1000000000.0: must be "),
        ("/swarm/best", json!(null), "swarm.best = null: must be the best position"),
        ("/swarm/history/1/failed", json!(5), "swarm.history[1].failed = 5: must be a whole number from 0 to 4"),
        ("/swarm/history/2/best", json!(1e9), "swarm.history[2].best = 1000000000.0: must be a number, at most"),
        ("/question/particles", json!(9), "belongs to another search: particles was 9, is 4"),
        ("/checksum", json!(null), "its content doesn't match its checksum"),
    ] {
        let mut edited = whole.clone();
        *edited.pointer_mut(way).unwrap() = value;
        let message = resumed(&file, &edited.to_string(), &question).unwrap_err();
        assert!(message.contains(expected), "{way}: {message}");
    }
    for text in ["", "null", "[]", "7", "{}", "{\"question\": 1}", &"[".repeat(100_000), "\u{0}"] {
        assert!(resumed(&file, text, &question).is_err());
    }
}

#[test]
fn the_program_goes_on_from_a_whole_file_and_refuses_a_changed_one() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = searched(folder.path());
    let left = fs::read_to_string(&file).unwrap();
    fs::write(&file, left.replacen("\"failed\":0", "\"failed\":1", 1)).unwrap();
    let changed = tune(folder.path(), &["--generations", "4"]);
    let error = String::from_utf8(changed.stderr).unwrap();
    assert!(changed.status.code() == Some(1) && error.contains("--force replaces it"), "{error}");
    fs::write(&file, &left).unwrap();
    assert!(tune(folder.path(), &["--generations", "4"]).status.success());
    assert_ne!(fs::read_to_string(&file).unwrap(), left);
}
