//! The help: commands by what they are for, and the options of its summary.

use std::fmt::Write;

/// The commands, by what they are for.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Everyday", &["design", "new", "check", "run", "explore", "playground", "export"]),
    ("Data", &["identify", "simulate"]),
    ("Comparison", &["compare", "sweep", "verify", "tune", "league"]),
    ("FMUs", &["info", "validate", "linearise", "list"]),
    ("Results", &["report"]),
    ("Set-up", &["completions", "manual", "dist", "schema", "help"]),
];
/// The options that `-h` shows of commands with many; `--help` shows all.
const SUMMARIES: [(&str, &str); 13] = [
    ("design", "settling-time bandwidth output inputs uncertainty margin kinds reference noise out force"),
    ("new", "name plant data states inputs outputs bandwidth reference uncertainty out force"),
    ("run", "all again out tag step until case set event composite open"),
    ("explore", "step until case set event composite open no-open out for port"),
    ("export", "all out ssp composite without values source compile platforms firmware json"),
    ("identify", "inputs states outputs structure delay hold-out fmu free page out force"),
    ("simulate", "input set event record until step interface tolerance compare out open"),
    ("compare", "out step until order case set event composite fmus open json"),
    ("sweep", "over out step until case set event composite force tag"),
    ("verify", "vary vary-from require at-most rare confidence runs until set out force"),
    ("tune", "parameter metric square particles generations seed until case set out resume"),
    ("league", "only quick study list out resume force tag page open json"),
    ("linearise", "at steady-state free want hold set states step json"),
];

/// The same command line with its help arranged.
pub fn arranged(command: clap::Command) -> clap::Command {
    let groups = groups(&command);
    let command = command
        .help_template(format!("{{about-with-newline}}\n{{usage-heading}} {{usage}}\n{groups}\nOptions:\n{{options}}"));
    SUMMARIES.iter().fold(command, |command, (name, shown)| {
        command.mut_subcommand(*name, |command| {
            command.mut_args(|argument| {
                let is_shown = argument.get_long().is_none_or(|long| shown.split(' ').any(|option| option == long));
                argument.hide_short_help(!is_shown)
            })
        })
    })
}

/// The list of commands.
fn groups(command: &clap::Command) -> String {
    let about = |name: &str| {
        let found = command.find_subcommand(name).and_then(clap::Command::get_about).map(ToString::to_string);
        found.unwrap_or_else(|| "Print the help of a command".to_owned())
    };
    let mut text = String::new();
    for (title, names) in GROUPS {
        let _ = writeln!(text, "\n{title}:");
        names.iter().for_each(|name| {
            let _ = writeln!(text, "  {name:12} {}", about(name));
        });
    }
    text
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn each_command_is_in_one_group_and_summaries_have_options_that_exist() {
        let command = crate::Arguments::command();
        let listed: Vec<_> = GROUPS.iter().flat_map(|(_, names)| *names).collect();
        let shown = command.get_subcommands().filter(|command| !command.is_hide_set()).map(clap::Command::get_name);
        for name in shown {
            assert_eq!(listed.iter().filter(|other| ***other == name).count(), 1, "{name}");
        }
        let is_known = |name: &str| name == "help" || command.find_subcommand(name).is_some();
        assert!(listed.iter().all(|name| is_known(name)), "{listed:?}");
        for (name, options) in SUMMARIES {
            let found = command.find_subcommand(name).unwrap();
            let longs: Vec<_> = found.get_arguments().filter_map(clap::Arg::get_long).collect();
            let unknown = options.split(' ').find(|option| !longs.contains(option));
            assert_eq!(unknown, None, "{name} has {longs:?}");
        }
    }
}
