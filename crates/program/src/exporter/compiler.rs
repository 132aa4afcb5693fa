//! Libraries of an FMU, compiled from its C sources.

use std::path::Path;
use std::process::Command;

use super::platform::Platform;
use crate::c_compiler;
use crate::error::Error;

/// Options without fused operations, so that results equal those of the generic form to the bit.
const OPTIONS: [&str; 6] = ["-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared", "-s"];
/// The glibc that libraries for Linux are compiled against, if the compiler can choose.
const GLIBC: &str = "2.17";

/// A C compiler that was found, with its arguments for a platform.
struct Compiler {
    program: String,
    arguments: Vec<String>,
}

impl Compiler {
    /// Finds the system's own compiler, or zig if there is none; for portable libraries only zig.
    fn find(platform: Platform, portable: bool) -> Result<Self, Error> {
        let own = if portable { None } else { Self::own() };
        own.or_else(|| Self::zig(platform)).ok_or_else(|| {
            let own = format!("a C compiler (`{}`) or zig", c_compiler::named());
            let needed = if portable { "zig" } else { &own };
            Error::Library(format!(
                "libraries for {} are compiled by {needed}, which was not found. Install zig with `pip install \
                 ziglang`, or export with --source instead of --compile",
                platform.folder
            ))
        })
    }

    fn own() -> Option<Self> {
        let (program, arguments) = c_compiler::words(&c_compiler::named());
        let asked: Vec<&str> = arguments.iter().map(String::as_str).chain(["--version"]).collect();
        answers(&program, &asked).then_some(Compiler { program, arguments })
    }

    fn zig(platform: Platform) -> Option<Self> {
        let zigs: [(&str, &[&str]); 3] =
            [("zig", &[]), ("python3", &["-m", "ziglang"]), ("python", &["-m", "ziglang"])];
        let answering = |(program, first): &(&str, &[&str])| answers(program, &[first, &["version"][..]].concat());
        let (program, first) = zigs.into_iter().find(answering)?;
        let arguments = first.iter().map(|argument| (*argument).to_owned()).chain(zig_target(platform)).collect();
        Some(Compiler { program: program.to_owned(), arguments })
    }
}

/// Arguments of zig as a C compiler for a platform.
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

/// Compiles an FMU's sources in a folder for a platform. Returns the bytes of the library. `portable`: it should also
/// run on older systems than this one.
///
/// # Errors
/// If there is no compiler, or it refuses.
pub fn compile(folder: &Path, platform: Platform, portable: bool) -> Result<Vec<u8>, Error> {
    let Compiler { program, arguments } = Compiler::find(platform, portable)?;
    let library = folder.join(format!("{}{}", platform.folder, platform.suffix));
    let mut command = Command::new(&program);
    command.args(arguments).args(OPTIONS);
    if platform.suffix != ".dll" {
        command.arg("-fPIC");
    }
    if platform.suffix == ".dylib" {
        // Its install name, instead of the path where it is written.
        command.arg("-Wl,-install_name,@rpath/unit.dylib");
    }
    command.arg(folder.join("all.c")).arg("-o").arg(&library).arg("-lm");
    let output = command.output().map_err(Error::file(&program))?;
    if !output.status.success() {
        let error = String::from_utf8_lossy(&output.stderr);
        return Err(Error::Library(format!("{program} can't compile the FMU for {}: {error}", platform.folder)));
    }
    std::fs::read(&library).map_err(Error::file(&library))
}
