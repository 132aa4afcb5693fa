//! Files that commands write: whole or not at all, in no place that the user didn't name.
#![cfg(unix)]

use std::fs::{self, File, Permissions};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::{Command, Output};
use std::time::Duration;

use adaptive_fmu::output::{self, Files};

/// Set in a child that plays a part of a test in this same program.
const PART: &str = "ADAPTIVE_FMU_WRITES";

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn refused(result: Result<(), adaptive_fmu::error::Error>) -> String {
    result.unwrap_err().to_string()
}

fn program(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_adaptive-fmu")).args(arguments).current_dir(folder).output().unwrap()
}

/// Every file below a folder, and what it holds.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    names(folder).into_iter().map(|name| (name.clone(), fs::read(folder.join(&name)).unwrap())).collect()
}

#[test]
fn a_file_is_replaced_as_a_whole_with_the_permissions_of_any_new_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.csv");
    File::create(folder.path().join("any")).unwrap();
    for text in ["one", "two"] {
        output::write(&file, text).unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), text);
    }
    let mode = |name: &str| fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
    assert_eq!(mode("a.csv"), mode("any"));
    assert_eq!(names(folder.path()), ["a.csv", "any"]);
}

#[test]
fn no_link_is_followed_wherever_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let (path, elsewhere) = (folder.path(), folder.path().join("elsewhere"));
    fs::create_dir(&elsewhere).unwrap();
    fs::write(elsewhere.join("mine"), "mine").unwrap();
    symlink(elsewhere.join("mine"), path.join("a.csv")).unwrap();
    symlink(elsewhere.join("nothing"), path.join("b.csv")).unwrap();
    symlink(&elsewhere, path.join("loop")).unwrap();
    for name in ["a.csv", "b.csv"] {
        let message = refused(output::write(&path.join(name), "x"));
        assert!(message.contains(name) && message.contains("is a link"), "{message}");
    }
    for name in ["loop", "loop/below"] {
        let message = refused(Files::within(path, name).map(drop));
        assert!(message.contains("loop: is a link"), "{message}");
        assert!(refused(output::check(path, name, &["c.csv"])).contains("loop: is a link"));
    }
    assert!(refused(Files::at(path).add("loop/c.csv", "x")).contains("loop: is a link"));
    assert_eq!(contents(&elsewhere), [("mine".to_owned(), b"mine".to_vec())]);
    // The folder that the user names may be one.
    Files::within(&path.join("loop"), "own").unwrap();
    assert_eq!(names(path), ["a.csv", "b.csv", "elsewhere", "loop"]);
}

#[test]
fn what_is_no_file_is_not_replaced_and_nothing_is_written_outside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::create_dir(path.join("folder")).unwrap();
    fs::write(path.join("kept"), "kept").unwrap();
    fs::set_permissions(path.join("kept"), Permissions::from_mode(0o444)).unwrap();
    assert!(Command::new("mkfifo").arg(path.join("pipe")).status().unwrap().success());
    for (name, expected) in [
        ("folder", "is a folder"),
        ("pipe", "is not a regular file"),
        ("kept", "is write-protected"),
        ("kept/a", "kept"),
    ] {
        let message = refused(output::write(&path.join(name), "x"));
        assert!(message.contains(expected), "{name}: {message}");
    }
    assert!(refused(output::check(path, "", &["new", "pipe"])).contains("pipe: is not a regular file"));
    assert!(refused(output::check(&path.join("kept"), "a", &[])).contains("kept: is not a folder"));
    for outside in ["../x", "/x", "a/../../x"] {
        assert!(refused(Files::within(path, outside).map(drop)).contains("outside"), "{outside}");
    }
    assert_eq!(names(path), ["folder", "kept", "pipe"]);
}

#[test]
fn files_that_belong_together_are_replaced_together_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let write = |text: &str| -> Result<(), adaptive_fmu::error::Error> {
        let mut files = Files::within(folder.path(), "loop")?;
        files.add("a", text)?;
        files.add("figures/b", text)?;
        files.add("c", text)?;
        files.place()
    };
    write("first").unwrap();
    fs::remove_file(folder.path().join("loop/c")).unwrap();
    fs::create_dir(folder.path().join("loop/c")).unwrap();
    assert!(refused(write("second")).contains("c: is a folder"));
    // One that is given up leaves nothing either.
    let mut given_up = Files::within(folder.path(), "loop").unwrap();
    given_up.add("a", "third").unwrap();
    drop(given_up);
    let read = |name: &str| fs::read_to_string(folder.path().join("loop").join(name)).unwrap();
    assert_eq!((read("a"), read("figures/b")), ("first".to_owned(), "first".to_owned()));
    assert_eq!(names(&folder.path().join("loop")), ["a", "c", "figures"]);
    let mut new = Files::at(folder.path());
    assert!(refused(new.add_new("loop", "x")).contains("exists"));
}

/// The part of a child: sets of files, of which each holds its set's number over and over.
fn write_sets(folder: &Path, sets: std::ops::Range<usize>, size: usize) -> Result<(), adaptive_fmu::error::Error> {
    for set in sets {
        let mut files = Files::within(folder, "")?;
        for name in ["a", "b"] {
            files.add(name, format!("{set} ").repeat(size))?;
        }
        files.place()?;
    }
    Ok(())
}

#[test]
fn child() {
    match std::env::var(PART).as_deref() {
        Ok("endless") => write_sets(Path::new("."), 0..usize::MAX, 20_000).unwrap(),
        Ok("limited") => {
            write_sets(Path::new("."), 1..2, 10).unwrap();
            let message = refused(write_sets(Path::new("."), 2..3, 1_000_000));
            assert!(message.contains("File too large"), "{message}");
        }
        _ => {}
    }
}

/// This program, in a shell that has set limits, as the child of that name.
fn shell(limits: &str, part: &str, folder: &Path) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", &format!("{limits} exec \"$0\" --exact results::child --nocapture")]);
    command.arg(std::env::current_exe().unwrap()).env(PART, part).current_dir(folder);
    command
}

#[test]
fn where_no_more_can_be_written_the_earlier_files_stay_and_nothing_else_does() {
    let folder = tempfile::tempdir().unwrap();
    let done = shell("trap '' XFSZ; ulimit -f 100;", "limited", folder.path()).output().unwrap();
    assert!(done.status.success(), "{done:?}");
    let earlier = "1 ".repeat(10).into_bytes();
    assert_eq!(contents(folder.path()), [("a".to_owned(), earlier.clone()), ("b".to_owned(), earlier)]);
}

#[test]
fn a_process_that_is_killed_while_it_writes_leaves_whole_files_and_what_is_cleared_away_next_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut parts = 0;
    for k in 0..20 {
        let mut child = shell("", "endless", folder.path()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(40 + 7 * k));
        child.kill().unwrap();
        child.wait().unwrap();
        for (name, bytes) in contents(folder.path()) {
            if name.starts_with('.') {
                parts += 1;
                continue;
            }
            let text = String::from_utf8(bytes).unwrap();
            let set = text.split(' ').next().unwrap();
            assert!(text == format!("{set} ").repeat(20_000), "{name} of set {set} isn't whole");
        }
    }
    // Files that another process is still writing stay.
    let mut writing = Files::at(folder.path());
    writing.add("a", "in time").unwrap();
    write_sets(folder.path(), 7..8, 1).unwrap();
    writing.place().unwrap();
    assert_eq!(names(folder.path()), ["a", "b"], "after {parts} left over");
    assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "in time");
}

const RUN: [&str; 5] = ["run", "3.2.1-cosine", "--until", "0.05", "--json"];
const RESULTS: &str = "results/3.2.1-cosine";

#[test]
fn a_run_that_makes_no_step_leaves_earlier_results_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let good = program(folder.path(), &RUN);
    assert!(good.status.success(), "{good:?}");
    let before = contents(&folder.path().join(RESULTS));
    assert_eq!(before.len(), 4);
    // Bounds that contradict each other are refused at the end of initialisation; the file can't show them.
    for bad in ["controller.u_min[1]=5", "controller.nothing=1", "plant.omega=x"] {
        let refused = program(folder.path(), &[&RUN[..], &["--set", bad, "--set", "controller.u_max[1]=-5"]].concat());
        let error = String::from_utf8(refused.stderr).unwrap();
        assert!(refused.status.code() == Some(1) && refused.stdout.is_empty(), "{bad}: {error}");
        assert!(error.contains("error: ") && !error.contains("results until then"), "{bad}: {error}");
        assert!(contents(&folder.path().join(RESULTS)) == before, "{bad}: {error}");
    }
    // Nor is a comparison with such a one written.
    let compared = ["compare", "3.2.1-cosine", "3.2.1-square", "--until", "0.05"];
    assert!(program(folder.path(), &compared).status.success());
    let page = contents(&folder.path().join("results/comparison"));
    let bad = ["--set", "controller.u_min[1]=5", "--set", "controller.u_max[1]=-5"];
    let refused = program(folder.path(), &[&compared[..], &bad].concat());
    assert!(refused.status.code() == Some(1) && refused.stdout.is_empty());
    assert!(String::from_utf8(refused.stderr).unwrap().contains("u_min[1]"));
    assert!(contents(&folder.path().join("results/comparison")) == page);
    // One that fails midway keeps what was computed.
    let fails = program(folder.path(), &["run", "4-case3", "--composite", "--until", "0.2", "--json"]);
    assert!(String::from_utf8(fails.stderr).unwrap().contains("results until then are in"));
    let left = fs::read_to_string(folder.path().join("results/4-case3-composite/result.csv")).unwrap();
    assert!(left.lines().count() > 10);
}

#[test]
fn a_run_whose_results_have_no_place_is_refused_before_it_begins() {
    let folder = tempfile::tempdir().unwrap();
    let results = folder.path().join(RESULTS);
    fs::create_dir_all(&results).unwrap();
    fs::write(folder.path().join("mine"), "mine").unwrap();
    symlink("../../mine", results.join("result.csv")).unwrap();
    let refused = program(folder.path(), &RUN);
    let error = String::from_utf8(refused.stderr).unwrap();
    assert!(refused.status.code() == Some(1) && error.contains("result.csv: is a link"), "{error}");
    assert_eq!(fs::read_to_string(folder.path().join("mine")).unwrap(), "mine");
    assert_eq!((names(&results), folder.path().join("fmus").exists()), (vec!["result.csv".to_owned()], false));
}

#[test]
fn a_description_is_replaced_only_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let new = ["new", "state-space", "--name", "Mine", "--states", "2", "--inputs", "1", "--outputs", "1"];
    assert!(program(folder.path(), &new).status.success());
    let before = contents(folder.path());
    let again = program(folder.path(), &new);
    assert!(
        again.status.code() == Some(1) && String::from_utf8(again.stderr).unwrap().contains("Use --force to overwrite")
    );
    assert_eq!(contents(folder.path()), before);
    symlink("Mine.toml", folder.path().join("Other.toml")).unwrap();
    let other = program(folder.path(), &[&new[..], &["--out", "Other.toml", "--force"]].concat());
    assert!(String::from_utf8(other.stderr).unwrap().contains("Other.toml: is a link"));
    assert!(program(folder.path(), &[&new[..], &["--force"]].concat()).status.success());
}

/// Runs on its own disk, if this machine can mount one.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_leaves_the_earlier_results_complete() {
    let folder = tempfile::tempdir().unwrap();
    // There is room for one run, and not for a second one.
    let script = "run() { \"$0\" run 3.2.1-cosine --composite --until 0.05 --out $1 > $2 2>&1; }; \
                  run room trial || exit 3; one=$(du -sk room | cut -f1); \
                  mount -t tmpfs -o size=$((one + one / 2))k none disk || exit 77; cd disk; \
                  run . ../told || exit 1; cksum 3.2.1-cosine-composite/* > ../before; \
                  run . ../told; test $? = 1 || exit 2; cksum 3.2.1-cosine-composite/* > ../after; \
                  ls -A 3.2.1-cosine-composite > ../names; cmp ../before ../after";
    fs::create_dir(folder.path().join("disk")).unwrap();
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--mount", "sh", "-c", script, env!("CARGO_BIN_EXE_adaptive-fmu")]);
    let Ok(done) = command.current_dir(folder.path()).output() else {
        return eprintln!("skipped: no unshare on this machine");
    };
    let text = fs::read_to_string(folder.path().join("told")).unwrap_or_default();
    if text.is_empty() {
        return eprintln!("skipped: no disk can be mounted here: {}", String::from_utf8_lossy(&done.stderr));
    }
    assert!(done.status.success() && text.contains("No space left on device"), "{done:?}: {text}");
    let left = fs::read_to_string(folder.path().join("names")).unwrap();
    assert_eq!(left.lines().collect::<Vec<_>>(), ["index.html", "metrics.json", "plot.svg", "result.csv"]);
}
