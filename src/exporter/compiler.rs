//! Libraries of a unit, compiled from its C sources.

use std::path::Path;
use std::process::Command;

use super::platform::Platform;
use crate::error::Error;

/// The same bits as those of the generic form ask for no fused operations.
const OPTIONS: [&str; 6] = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"];
/// The oldest glibc that libraries for Linux are compiled against, where a compiler can choose.
const GLIBC: &str = "2.17";

/// A C compiler that was found, with what it is told to compile for a platform.
struct Compiler {
    program: String,
    arguments: Vec<String>,
}

impl Compiler {
    /// One for a platform: the system's own for this machine, zig for any.
    fn find(platform: Platform) -> Result<Self, Error> {
        let own = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        if platform == Platform::own() && answers(&own, &["--version"]) {
            return Ok(Compiler { program: own, arguments: Vec::new() });
        }
        let zigs: [(&str, &[&str]); 3] =
            [("zig", &[]), ("python3", &["-m", "ziglang"]), ("python", &["-m", "ziglang"])];
        let found = zigs.into_iter().find(|(program, first)| answers(program, &[first, &["version"][..]].concat()));
        let Some((program, first)) = found else {
            let needed = if platform == Platform::own() { "a C compiler (cc) or zig" } else { "zig" };
            let reason = format!(
                "libraries for {} are compiled by {needed}, which isn't found: `pip install ziglang` installs zig; or export \
                 with --source, without --compile",
                platform.folder
            );
            return Err(Error::Library(reason));
        };
        let arguments = first.iter().map(|argument| (*argument).to_owned()).chain(zig_target(platform)).collect();
        Ok(Compiler { program: program.to_owned(), arguments })
    }
}

/// What zig is told: to be a C compiler for a platform.
fn zig_target(platform: Platform) -> Vec<String> {
    let target = match platform.target() {
        ("i686", "linux") => format!("x86-linux-gnu.{GLIBC}"),
        (processor, "linux") => format!("{processor}-linux-gnu.{GLIBC}"),
        ("i686", "windows") => "x86-windows-gnu".to_owned(),
        (processor, "windows") => format!("{processor}-windows-gnu"),
        (processor, _) => format!("{processor}-macos"),
    };
    ["cc", "-target", &target].map(str::to_owned).to_vec()
}

fn answers(program: &str, arguments: &[&str]) -> bool {
    Command::new(program).args(arguments).output().is_ok_and(|output| output.status.success())
}

/// The library for a platform of a unit whose sources lie in a folder: its bytes.
///
/// # Errors
/// When there is no compiler, or it refuses.
pub fn compile(folder: &Path, platform: Platform) -> Result<Vec<u8>, Error> {
    let Compiler { program, arguments } = Compiler::find(platform)?;
    let library = folder.join(format!("{}{}", platform.folder, platform.suffix));
    let mut command = Command::new(&program);
    command.args(arguments).args(OPTIONS);
    if platform.suffix != ".dll" {
        command.arg("-fPIC");
    }
    command.arg(folder.join("all.c")).arg("-o").arg(&library).arg("-lm");
    let output = command.output().map_err(Error::file(&program))?;
    if !output.status.success() {
        let told = String::from_utf8_lossy(&output.stderr);
        return Err(Error::Library(format!("{program} can't compile the unit for {}: {told}", platform.folder)));
    }
    std::fs::read(&library).map_err(Error::file(&library))
}
