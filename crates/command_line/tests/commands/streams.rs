//! Every command ends well where nobody reads what it prints, and with its error where that can't be written.
#![cfg(target_os = "linux")]

use std::fs::{self, OpenOptions};
use std::io::Read;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn program(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_adaptive-fmu"));
    command.args(arguments);
    command
}

fn full() -> Stdio {
    OpenOptions::new().write(true).open("/dev/full").unwrap().into()
}

/// A pipe that nobody reads.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

fn error_text(done: &Output) -> String {
    String::from_utf8(done.stderr.clone()).unwrap()
}

/// Commands that print, each of its kind, with their files in a folder that holds an FMU.
fn commands(folder: &Path) -> Vec<Vec<String>> {
    let of = |words: &str| words.split_whitespace().map(str::to_owned).collect::<Vec<_>>();
    let out = folder.display().to_string();
    vec![
        of("list"),
        of("list --json"),
        of("schema"),
        of("--help"),
        of("run --help"),
        of("--version"),
        of("check L1NonlinearSiso"),
        of("check L1NonlinearSiso --json"),
        of(&format!("export NonlinearSiso --out {out}")),
        of(&format!("info {out}/NonlinearSiso.fmu")),
        of(&format!("info {out}/NonlinearSiso.fmu --json")),
        of(&format!("linearise {out}/NonlinearSiso.fmu")),
        of(&format!("new state-space --name Mine --states 2 --inputs 1 --outputs 1 --out {out}/Mine.toml --force")),
        of(&format!("run 3.2.1-cosine --composite --until 0.05 --out {out}")),
        of(&format!("run 3.2.1-cosine --composite --until 0.05 --out {out} --json")),
    ]
}

fn with_each_command(check: impl Fn(&[&str], &Output)) {
    let folder = tempfile::tempdir().unwrap();
    let exported = program(&["export", "NonlinearSiso", "--out", folder.path().to_str().unwrap()]).output().unwrap();
    assert!(exported.status.success(), "{exported:?}");
    for command in commands(folder.path()) {
        let words: Vec<&str> = command.iter().map(String::as_str).collect();
        // Exit status without an error: `check` ends with 3 if a design isn't sound.
        let well = program(&words).output().unwrap();
        assert!(well.status.code() == Some(0) || words[0] == "check", "{words:?}: {well:?}");
        check(&words, &well);
    }
}

#[test]
fn a_reader_who_has_seen_enough_changes_nothing() {
    with_each_command(|words, well| {
        let done = program(words).stdout(closed()).output().unwrap();
        assert_eq!(done.status.code(), well.status.code(), "{words:?}: {done:?}");
        assert_eq!(error_text(&done), error_text(well), "{words:?}");
    });
}

#[test]
fn a_full_disk_is_reported_and_the_command_counts_as_not_done() {
    with_each_command(|words, _| {
        let done = program(words).stdout(full()).output().unwrap();
        assert_eq!(done.status.code(), Some(1), "{words:?}: {done:?}");
        let last = error_text(&done).lines().last().unwrap_or_default().to_owned();
        assert!(last.starts_with("error: standard output: "), "{words:?}: {last}");
        assert!(!error_text(&done).contains("panicked"), "{words:?}");
    });
}

#[test]
fn an_error_stream_that_cant_be_written_changes_no_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    for (words, code) in [
        (vec!["info", "nothing.fmu"], 1),
        (vec!["run", "3.2.1-cosine", "--composite", "--set", "plant.nothing=1", "--out", out], 1),
        (vec!["run", "4-case3", "--composite", "--until", "0.2", "--out", out], 1),
        (vec!["nothing"], 2),
        (vec!["export", "NonlinearSiso", "--out", out], 0),
    ] {
        for stderr in [closed(), full()] {
            let done = program(&words).stderr(stderr).output().unwrap();
            assert_eq!(done.status.code(), Some(code), "{words:?}: {done:?}");
        }
    }
}

#[test]
fn a_run_whose_output_nobody_reads_leaves_its_results_and_no_temporary_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (temporary, out) = (folder.path().join("tmp"), folder.path().join("out"));
    fs::create_dir(&temporary).unwrap();
    for stdout in [closed(), full()] {
        let mut command = program(&["run", "3.2.1-cosine", "--composite", "--until", "0.05", "--out"]);
        command.arg(&out).env("TMPDIR", &temporary).stdout(stdout).output().unwrap();
        assert!(out.join("3.2.1-cosine-composite/result.csv").is_file());
        assert_eq!(fs::read_dir(&temporary).unwrap().count(), 0);
        fs::remove_dir_all(&out).unwrap();
    }
}

#[test]
fn what_is_read_before_the_pipe_is_closed_is_whole() {
    let whole = program(&["schema"]).output().unwrap().stdout;
    let mut child = program(&["schema"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut first = vec![0; 1000];
    child.stdout.take().unwrap().read_exact(&mut first).unwrap();
    let done = child.wait_with_output().unwrap();
    assert_eq!((&first[..], done.status.code(), error_text(&done)), (&whole[..1000], Some(0), String::new()));
}
