//! The result of a study: printed, and written.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use adaptive_fmu::begun;
use adaptive_fmu::error::Error;
use adaptive_fmu::output::Files;
use adaptive_fmu::results::four_digits;
use adaptive_fmu::tuning::typed_set;
use adaptive_fmu::verification::Summary;

use super::loop_options::LoopOptions;
use super::results::PAGE;
use super::verify::{Arguments, Task};
use crate::console;

/// The verdict, and the table of all samples.
pub const RESULT: &str = "verify.json";
pub const SAMPLES: &str = "samples.csv";
/// Folders of parameter sets.
const WORST: &str = "worst";
const FAILED: &str = "failed";
/// Lines about requirements that are printed.
const MOST_LINES: usize = 20;

/// Writes the verdict, the table, the page, and the worst and the failing samples.
pub fn write(task: &Task, summary: &Summary, arguments: &Arguments, below: &str) -> Result<(), Error> {
    let folder = arguments.out.join(below);
    let mut files = Files::within(&arguments.out, below)?;
    let mut result = summary.json();
    result["results"] = console::path(&folder);
    files.add(RESULT, result.to_string())?;
    files.add(SAMPLES, summary.csv())?;
    files.add(PAGE, summary.html())?;
    for (kind, samples) in [(WORST, summary.worst()), (FAILED, summary.failed())] {
        for (k, sample) in samples.iter().enumerate() {
            let name = PathBuf::from(kind).join(format!("{:03}", k + 1));
            let (set, values) = (name.with_extension("ssv"), task.study.start_values(*sample));
            let remark = format!("Sample {sample}: {}", summary.described(*sample));
            let values: Vec<_> = values.iter().map(|(name, kind, text)| (name.as_str(), *kind, text.clone())).collect();
            files.add(&set, typed_set(&format!("sample {sample}"), &remark, &values).map_err(Error::file(&folder))?)?;
            let tag = format!("{kind}-{:03}", k + 1);
            let line = line(task, &arguments.name, (&folder.join(&set), &tag), *sample);
            files.add(name.with_extension("txt"), format!("# {}\n{line}\n", remark.replace('\n', " ")))?;
        }
    }
    files.place()?;
    for (kind, count) in [(WORST, summary.worst().len()), (FAILED, summary.failed().len())] {
        remove_further(&folder.join(kind), count)?;
    }
    Ok(())
}

/// Removes what an earlier study left in a folder of samples.
fn remove_further(folder: &Path, count: usize) -> Result<(), Error> {
    for number in count + 1..=999 {
        let mut is_there = false;
        for ending in ["ssv", "txt"] {
            let file = begun::path(&folder.join(format!("{number:03}.{ending}")));
            match fs::remove_file(&file) {
                Ok(()) => is_there = true,
                Err(error) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(Error::file(&file)(error)),
            }
        }
        if !is_there {
            break;
        }
    }
    Ok(())
}

/// The command that runs a sample as the study did.
fn line(task: &Task, name: &str, (set, tag): (&Path, &str), sample: u64) -> String {
    let LoopOptions { composite, fmus, step, until, order, accept_algebraic_loops, parameters, hosting, .. } =
        &task.options;
    let mut words: Vec<String> = ["adaptive-fmu", "run", name, "--tag", tag].map(str::to_owned).to_vec();
    let mut add = |option: &str, value: Option<String>| {
        words.push(option.to_owned());
        words.extend(value);
    };
    let path = |path: &Path| path.display().to_string();
    parameters.case.iter().for_each(|case| add("--case", Some(path(case))));
    add("--case", Some(path(set)));
    // It would replace the sample's own value.
    let own = task.study.start_values(sample);
    let is_own = |assignment: &&String| {
        let set = task.study.structure().set_by(assignment);
        set.is_some_and(|set| own.iter().any(|(name, ..)| *name == set))
    };
    parameters.set.iter().filter(|set| !is_own(set)).for_each(|set| add("--set", Some(set.clone())));
    task.study.events(sample).into_iter().for_each(|event| add("--event", Some(event)));
    step.iter().for_each(|step| add("--step", Some(step.to_string())));
    until.iter().for_each(|until| add("--until", Some(until.to_string())));
    order.iter().for_each(|order| add("--order", Some(order.to_string())));
    fmus.iter().for_each(|fmus| add("--fmus", Some(path(fmus))));
    if *composite {
        add("--composite", None);
    }
    if *accept_algebraic_loops {
        add("--accept-algebraic-loops", None);
    }
    if hosting.in_process {
        add("--in-process", None);
    }
    words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ")
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,@+".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Prints the verdict and what is counted apart, or what a script wants.
pub fn print(summary: &Summary, folder: &Path, json: bool) {
    if summary.ended.interrupted {
        let runs = summary.ended.tally.runs;
        error_line!("interrupted after {runs} of at most {} runs. Repeat the command to continue", summary.plan.runs());
    }
    if json {
        let mut result = summary.json();
        result["results"] = console::path(folder);
        print_line!("{result}");
        return;
    }
    print_line!("{}", summary.verdict());
    summary.counts().iter().take(MOST_LINES).for_each(|count| print_line!("{count}"));
    for index in summary.indices().iter().take(MOST_LINES) {
        if let Some(of) = index.of_failing {
            print_line!("{} explains {:.0} % of the variance of failing", index.name, 100.0 * of);
        }
    }
    for range in summary.failing_ranges().unwrap_or_default().iter().take(MOST_LINES) {
        if let Some([low, _, high]) = range.values {
            print_line!(
                "{} is {} … {} in 90 % of the failing samples",
                range.name,
                four_digits(low),
                four_digits(high)
            );
        }
    }
    print_line!("{}", summary.form());
    print_line!(
        "{PAGE} (charts), {SAMPLES} (all samples), {RESULT}, and {WORST} and {FAILED} samples as parameter sets with \
         their commands are in {}",
        folder.display()
    );
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn words_with_signs_of_a_shell_are_quoted() {
        assert_eq!(quoted("results/a-b/001.ssv"), "results/a-b/001.ssv");
        assert_eq!(quoted("2.5: plant.m=1"), "'2.5: plant.m=1'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted("plant.x[1]=2"), "'plant.x[1]=2'");
    }
}
