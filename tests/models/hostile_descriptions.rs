//! Descriptions that are broken or meant to do harm: refused or made, in bounded time and memory, never a fault.

use std::time::{Duration, Instant};

use common::described::{model, refused};
use common::random::Random;
use common::{description, description_names};

/// Longest time on a slow machine, where descriptions are tried one after the other.
const SOON: Duration = Duration::from_secs(10);

fn structure(model: &str, structure: &str) -> String {
    format!("name = \"X\"\nmodel = \"{model}\"\ndescription = \"\"\n[structure]\n{structure}\n")
}

/// `[[x, …], …]`
fn rows(rows: usize, columns: usize) -> String {
    format!("[{}]", vec![format!("[{}]", vec!["1.0"; columns].join(",")); rows].join(","))
}

fn identity(n: usize) -> String {
    let row = |i: usize| (0..n).map(|j| if i == j { "1.0" } else { "0.0" }).collect::<Vec<_>>().join(",");
    format!("[{}]", (0..n).map(|i| format!("[{}]", row(i))).collect::<Vec<_>>().join(","))
}

fn soon<T>(what: &str, call: impl FnOnce() -> T) -> T {
    let begun = Instant::now();
    let answer = call();
    assert!(begun.elapsed() < SOON, "{what} takes {:?}", begun.elapsed());
    answer
}

#[test]
fn sizes_that_would_fill_the_memory_are_refused_by_the_name_of_their_key() {
    let huge = i64::MAX;
    let network = |neurons: i64| {
        format!("relative_degree = 1\nchannels = 2\nnetwork = {{ rule = \"square_roots\", neurons = {neurons} }}")
    };
    let cases = [
        ("reference", format!("channels = {huge}"), "channels"),
        ("sensor", format!("channels = {huge}"), "channels"),
        ("sensor", format!("channels = 1\ndelay_samples = {huge}"), "delay_samples"),
        ("actuator", format!("channels = 1000\ndelay_samples = {huge}"), "delay_samples"),
        ("neuro-ppf", network(1_000_000_000), "neurons"),
        (
            "neuro-ppf",
            format!("relative_degree = 1\nchannels = {huge}\nnetwork = {{ rule = \"square_roots\" }}"),
            "channels",
        ),
        ("observer", format!("A = {0}\nB = {1}\nC = {2}", rows(201, 201), rows(201, 1), rows(1, 201)), "B"),
        (
            "l1",
            format!("B = {}\nC = {}\nregressor = \"state\"\ninput_gain = \"full\"", rows(5000, 1), rows(1, 5000)),
            "B",
        ),
        ("mrac-ppf", format!("A = {0}\nB = {0}", identity(300)), "numbers"),
    ];
    for (model, text, key) in cases {
        soon(model, || refused(&structure(model, &text), &[key]));
    }
}

#[test]
fn a_whole_of_more_parts_than_a_loop_can_have_is_refused_as_is_one_without_any() {
    let parts = |count: usize| {
        let part = |k| {
            format!("[[structure.parts]]\nname = \"p{k}\"\nmodel = \"reference\"\nstructure = {{ channels = 1000 }}\n")
        };
        format!("name = \"X\"\nmodel = \"composite\"\ndescription = \"\"\n{}", (0..count).map(part).collect::<String>())
    };
    soon("too many parts", || refused(&parts(1001), &["parts", "1001", "1000"]));
    soon("parts that are too large together", || refused(&parts(100), &["p6.", "200000"]));
    refused(&structure("composite", "parts = []"), &["parts", "0"]);
}

#[test]
fn a_composite_has_no_composite_in_it_and_no_two_parts_of_a_name() {
    let inner = "parts = [{ name = \"p\", model = \"composite\", structure = { parts = [] } }]";
    refused(&structure("composite", inner), &["`p`", "composite"]);
    let channel = "structure = { channels = 1 }";
    let twins = format!(
        "parts = [{{ name = \"a\", model = \"sensor\", {channel} }}, {{ name = \"a\", model = \"sensor\", {channel} }}]"
    );
    refused(&structure("composite", &twins), &["two parts", "`a`"]);
}

#[test]
fn tables_and_lists_within_each_other_without_end_are_refused() {
    let deep = 100_000;
    for text in [
        format!("x = {}", "[".repeat(deep)),
        format!("x = {}1{}", "[".repeat(deep), "]".repeat(deep)),
        format!("x = {}", "{ a = ".repeat(deep)),
        format!("[{}]", vec!["a"; deep].join(".")),
        format!("{} = 1", vec!["a"; deep].join(".")),
    ] {
        soon("deep nesting", || refused(&text, &[]));
    }
}

#[test]
fn a_file_of_many_wrong_values_is_refused_with_some_of_them() {
    let values: String = (0..30_000).map(|k| format!("a{k} = 1.0\n")).collect();
    let text = format!("{}[start]\n{values}", structure("reference", "channels = 1000"));
    let error = soon("many values", || model(&text).unwrap_err());
    assert!(error.contains("[start] a0") && error.matches("[start]").count() == 20, "{} characters", error.len());
}

#[test]
fn byte_order_marks_and_line_ends_of_other_systems_are_read() {
    let text = description("L1NonlinearSiso");
    assert!(model(&text.replace('\n', "\r\n")).is_ok());
    assert!(model(&format!("\u{feff}{text}")).is_ok());
}

/// A description with one thing in it changed: a byte, a line, a number, or all behind some place.
fn mutated(text: &str, random: &mut Random) -> String {
    let mut below = |n: usize| ((random.next() + 1.0) / 2.0 * n as f64) as usize % n.max(1);
    let numbers = [
        "1e308",
        "-1e308",
        "1e-308",
        "0",
        "-1",
        "nan",
        "inf",
        "9223372036854775807",
        "4294967296",
        "1e16",
        "2147483648",
        "0x7f",
        "\"x\"",
        "[]",
        "{}",
        "true",
    ];
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let line = below(lines.len());
    match below(6) {
        0 => lines.truncate(line),
        1 => drop(lines.remove(line)),
        2 => lines.insert(line, lines[below(lines.len())].clone()),
        3 => {
            // One number becomes another.
            let places: Vec<_> =
                lines[line].match_indices(|c: char| c.is_ascii_digit()).map(|(place, _)| place).collect();
            if let Some(&start) = places.get(below(places.len())) {
                let rest = &lines[line][start..];
                let end = start + rest.find(|c: char| !(c.is_ascii_digit() || ".e".contains(c))).unwrap_or(rest.len());
                let number = numbers[below(numbers.len())];
                lines[line].replace_range(start..end, number);
            }
        }
        4 => {
            let (key, _) = lines[line].split_once('=').unwrap_or((lines[line].as_str(), ""));
            lines[line] = format!("{key} = {}", numbers[below(numbers.len())]);
        }
        _ => {
            let mut bytes = lines[line].clone().into_bytes();
            if !bytes.is_empty() {
                let place = below(bytes.len());
                bytes[place] = b"\x00\x7f\"[]{}=,.#'-eZ9 "[below(17)];
            }
            lines[line] = String::from_utf8_lossy(&bytes).into_owned();
        }
    }
    lines.join("\n")
}

#[test]
fn no_change_of_a_description_leads_to_a_fault_or_takes_without_end() {
    let mut random = Random::new(20);
    let mut made = 0;
    for name in description_names() {
        let text = description(&name);
        for _ in 0..60 {
            let changed = mutated(&text, &mut random);
            let answer = std::panic::catch_unwind(|| soon(&changed, || model(&changed).map(|_| ())));
            let answer = answer.unwrap_or_else(|_| panic!("a fault in\n{changed}"));
            made += usize::from(answer.is_ok());
            let error = answer.err().unwrap_or_default();
            assert!(!error.contains('\n'), "{error}");
        }
    }
    assert!(made > 20, "some changes do no harm, and are not refused: {made}");
}
