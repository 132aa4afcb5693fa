//! `completions`: what completes commands, options, loops and FMUs in a shell.

use std::process::ExitCode;

use adaptive_fmu::exporter;
use clap::builder::PossibleValuesParser;
use clap_complete::Shell;

use crate::console;

/// Kind of names that an argument takes; a path is allowed, too.
#[derive(Clone, Copy, PartialEq)]
enum Names {
    Loops,
    Fmus,
    Both,
}

/// Arguments that go by their place.
const BY_PLACE: [&str; 3] = ["name", "names", "runs"];

/// Arguments that name what this package holds: command, argument, names.
const NAMED: [(&str, &str, Names); 13] = [
    ("run", "name", Names::Loops),
    ("compare", "runs", Names::Loops),
    ("sweep", "name", Names::Loops),
    ("explore", "name", Names::Loops),
    ("tune", "name", Names::Loops),
    ("export", "names", Names::Fmus),
    ("export", "composite", Names::Loops),
    ("export", "ssp", Names::Loops),
    ("export", "run", Names::Loops),
    ("export", "in_loop", Names::Loops),
    ("check", "name", Names::Fmus),
    ("simulate", "name", Names::Both),
    ("linearise", "name", Names::Both),
];

#[derive(clap::Args)]
pub struct Arguments {
    /// Shell that the script is for
    shell: Shell,
}

/// Prints the script.
pub fn execute(arguments: &Arguments, command: &clap::Command) -> ExitCode {
    console::text(&script(arguments.shell, command));
    ExitCode::SUCCESS
}

/// The script for a shell.
pub fn script(shell: Shell, command: &clap::Command) -> String {
    let name = command.get_name().to_owned();
    // Commands that are there for other programs are not offered.
    let shown = command.get_subcommands().filter(|command| !command.is_hide_set()).cloned();
    let plain = clap::Command::new(env!("CARGO_BIN_NAME")).version(env!("CARGO_PKG_VERSION"));
    let command = plain.args(command.get_arguments().cloned()).subcommands(shown);
    let named = |command: clap::Command, (subcommand, argument, names): &(&'static str, &'static str, Names)| {
        let values = PossibleValuesParser::new(names.known());
        command.mut_subcommand(*subcommand, |found| found.mut_arg(*argument, |found| found.value_parser(values)))
    };
    let mut command = NAMED.iter().fold(command, named);
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut command, &name, &mut text);
    let text = String::from_utf8_lossy(&text).into_owned();
    match shell {
        // In the names of its parts the script writes a hyphen of the program's name in two ways.
        Shell::Bash => text.replace(&name.replace('-', "__subcmd__"), &name.replace('-', "__")),
        Shell::Zsh => with_files(text),
        Shell::Fish => text + &of_positions(&name),
        Shell::PowerShell => with_names(&text),
        _ => text,
    }
}

/// The script for zsh, in which files are offered in addition to names.
fn with_files(script: String) -> String {
    let mut functions = String::new();
    let mut script = script;
    for (function, names) in [("loops", Names::Loops), ("fmus", Names::Fmus), ("units", Names::Both)] {
        let known = names.known().join(" ");
        script = script.replace(&format!(":({known})"), &format!(":_adaptive_fmu_{function}"));
        let body = format!("_alternative 'names:name:({known})' 'files:file:_files'");
        functions.push_str(&format!("\n_adaptive_fmu_{function}() {{\n    {body}\n}}\n"));
    }
    // Behind the first line, by which zsh knows what the file is for.
    let begin = script.find('\n').map_or(0, |end| end + 1);
    script.insert_str(begin, &functions);
    script
}

/// Lines for fish, whose script lacks the names of positional arguments. It offers files, too.
fn of_positions(name: &str) -> String {
    let by_place = NAMED.iter().filter(|(_, argument, _)| BY_PLACE.contains(argument));
    let line = |(subcommand, _, names): &(&str, &str, Names)| {
        let (known, function) = (names.known().join(" "), name.replace('-', "_"));
        format!("complete -c {name} -n \"__fish_{function}_using_subcommand {subcommand}\" -a \"{known}\"\n")
    };
    by_place.map(line).collect()
}

/// The script for PowerShell, which holds no names of arguments: what is offered last is what its tail filters. Where no
/// name fits, PowerShell offers files.
fn with_names(script: &str) -> String {
    let table = |by_place: bool| -> String {
        let named = NAMED.iter().filter(|(_, argument, _)| BY_PLACE.contains(argument) == by_place);
        let line = |(subcommand, argument, names): &(&str, &str, Names)| {
            let key = if by_place { (*subcommand).to_owned() } else { format!("{subcommand} --{argument}") };
            let known: Vec<_> = names.known().into_iter().map(|name| format!("'{name}'")).collect();
            format!("        '{key}' = @({})\n", known.join(", "))
        };
        named.map(line).collect()
    };
    let (by_place, of_options) = (table(true), table(false));
    let names = format!(
        "    $byPlace = @{{\n{by_place}    }}\n    $ofOptions = @{{\n{of_options}    }}\n{}",
        "    $words = @($commandElements | Where-Object { $_.Extent.EndOffset -lt $cursorPosition } |
        ForEach-Object { $_.Extent.Text })
    $subcommand = $words | Select-Object -Skip 1 | Where-Object { -not $_.StartsWith('-') } | Select-Object -First 1
    $names = @()
    if ($subcommand) {
        $names = $ofOptions[\"$subcommand $($words[-1])\"]
        if ($names) { $completions = @() } else { $names = $byPlace[$subcommand] }
    }
    foreach ($name in $names) {
        $completions = @($completions) + [CompletionResult]::new($name, $name, [CompletionResultType]::ParameterValue, $name)
    }

"
    );
    let tail = "    $completions.Where{";
    debug_assert!(script.contains(tail), "the script ends otherwise than it did");
    script.replacen(tail, &(names + tail), 1)
}

impl Names {
    fn known(self) -> Vec<&'static str> {
        let loops = || exporter::loops().iter().map(|(name, _)| *name);
        let fmus = || exporter::descriptions().iter().map(|(name, _)| *name);
        match self {
            Names::Loops => loops().collect(),
            Names::Fmus => fmus().collect(),
            Names::Both => fmus().chain(loops()).collect(),
        }
    }
}
