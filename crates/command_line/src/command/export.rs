//! `export`: descriptions become FMUs.

use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Once;

use crate::console;
use adaptive_fmu::analysis::{InLoop, in_loop, period};
use adaptive_fmu::error::{Error, Invalid};
use adaptive_fmu::exporter::{self, Binary, Content, Form, Glibc, Library, Platform, Source};
use adaptive_fmu::fmi2::firmware::{Fallback, Options, Signals};
use adaptive_fmu::model::{Description, Standard};
use adaptive_fmu::model_description::ModelDescription;
use adaptive_fmu::parallel;
use adaptive_fmu::related::{self, Exported};
use adaptive_fmu::scratch::Scratch;
use adaptive_fmu::structure::{Component, LoopFiles, Structure, composite, designed, pack, with_values};
use serde_json::json;

#[derive(clap::Args)]
pub struct Arguments {
    /// FMUs of this package, description files (NAME.toml), or folders of these [default: all FMUs of this package]
    ///
    /// With --composite or --ssp, but without --run, the default is none.
    names: Vec<String>,
    /// Export all FMUs of this package
    #[arg(long, conflicts_with = "names")]
    all: bool,
    /// Export a loop as a single FMU, integrated as one continuous system (repeatable).
    ///
    /// If no FMU is named, only the loops of --composite and --ssp are exported, unless --run is given.
    #[arg(long, value_name = "LOOP")]
    composite: Vec<String>,
    /// Component to leave out of the loops of --composite (repeatable).
    ///
    /// The inputs that it drives become inputs of the single FMU.
    #[arg(long, value_name = "UNIT", requires = "composite")]
    without: Vec<String>,
    /// Write a loop and its FMUs as one archive for other simulation tools, LOOP.ssp (repeatable).
    ///
    /// If no FMU is named, only the loops of --composite and --ssp are exported, unless --run is given.
    #[arg(long, value_name = "LOOP")]
    ssp: Vec<String>,
    /// Folder for the FMUs and archives
    #[arg(long, default_value = "fmus")]
    out: PathBuf,
    /// Shared library to pack, one per platform (repeatable) [default: those built with this program]
    ///
    /// If the libraries contain models of your own, one of them must be for this platform. With --source-only and
    /// --compile they are not packed.
    #[arg(long, value_name = "[PLATFORM=]FILE")]
    library: Vec<String>,
    /// Parameter set (.ssv) with start values for the FMU; exactly one FMU must be named
    #[arg(long, value_name = "FILE.ssv", requires = "names", conflicts_with_all = ["all", "composite", "ssp"])]
    values: Option<PathBuf>,
    /// Add C sources, for tools and embedded targets that compile FMUs themselves (docs/source_units.md)
    #[arg(long)]
    source: bool,
    /// Add C sources and omit the libraries
    #[arg(long)]
    source_only: bool,
    /// Add C sources, and libraries compiled from them by the C compiler of this machine.
    ///
    /// The compiler is the command in CC [default: cc]. If it is not found, zig is used.
    #[arg(long, conflicts_with = "source_only")]
    compile: bool,
    /// Write controllers as C for embedded targets, with test vectors, instead of FMUs (docs/firmware.md)
    #[arg(
        long,
        requires = "names",
        conflicts_with_all = ["all", "composite", "ssp", "source", "source_only", "compile", "terminals", "run"]
    )]
    firmware: bool,
    /// Time between two calls of the firmware, s [default: its sample time, or the step size of its description]
    #[arg(long, value_name = "S", requires = "firmware")]
    period: Option<f64>,
    /// Runge-Kutta steps in each call of the firmware [default: as many as it needs in its loop]
    #[arg(long, value_name = "N", requires = "firmware")]
    substeps: Option<u32>,
    /// Loop in which the number of these steps is found and the test vectors are recorded [default: the first example with this FMU]
    #[arg(long = "loop", value_name = "LOOP", requires = "firmware")]
    in_loop: Option<String>,
    /// Outputs of the firmware where a step is refused: those before (hold), zeros, or the manual control
    #[arg(long, value_name = "hold|zero|manual", requires = "firmware", default_value = "hold")]
    fallback: String,
    /// Parameters of the firmware that can change while it runs [default: all that allow it]
    ///
    /// Names without indices; `--calibrate ''` makes all of them constants.
    #[arg(long, value_name = "NAME,…", requires = "firmware", value_delimiter = ',')]
    calibrate: Option<Vec<String>>,
    /// Platforms to compile for, with zig [default: this platform only, with its own compiler]
    ///
    /// `pip install ziglang` installs zig. Libraries for Linux are compiled against glibc 2.17.
    #[arg(long, value_name = "PLATFORM,…", value_delimiter = ',', requires = "compile")]
    platforms: Vec<String>,
    /// Add terminalsAndIcons.xml, which some tools use to connect FMUs.
    ///
    /// Tools with FMI Library 3 refuse FMUs that contain it.
    #[arg(long)]
    terminals: bool,
    /// Leave out the reference experiment, with which importers check themselves (docs/tools.md)
    #[arg(long, conflicts_with = "firmware")]
    no_reference_results: bool,
    /// Version of FMI: 2 for FMI 2.0, 3 for FMI 3.0 (docs/fmi3.md)
    #[arg(
        long,
        value_name = "2|3",
        default_value = "2",
        value_parser = clap::value_parser!(u8).range(2..=3),
        conflicts_with_all = ["ssp", "run", "firmware"]
    )]
    fmi: u8,
    /// Run this loop with the exported FMUs afterwards
    #[arg(long, value_name = "LOOP")]
    run: Option<String>,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Writes the FMUs that are asked for, and closes a loop through them.
pub fn execute(arguments: &Arguments) -> Result<ExitCode, Error> {
    let Arguments { names, all: every, composite, without, ssp, out, library, values, run, json, .. } = arguments;
    let standard = if arguments.fmi == 3 { Standard::Fmi3 } else { Standard::Fmi2 };
    let content = Content { form: arguments.form()?, terminals: arguments.terminals, standard };
    let wanted = Wanted { content, results: !arguments.no_reference_results };
    let library = chosen(library)?;
    // A run needs the FMUs of its loop in the folder.
    let composites_only = !(composite.is_empty() && ssp.is_empty()) && run.is_none();
    let names = if *every || names.is_empty() && !composites_only { all() } else { with_folders(names)? };
    if arguments.firmware {
        return arguments.write_firmware(&names, &library);
    }
    let before = versions(out);
    let mut tried = match values {
        Some(values) => vec![export_with_values(&names, values, &library, out, &wanted)],
        None => export_named(&names, &library, out, &wanted)?,
    };
    tried.extend(composite.iter().map(|name| export_whole(name, without, &library, out, &wanted)));
    let mut failures = Vec::new();
    let fmus = written(tried, &mut failures);
    let loops = written(ssp.iter().map(|name| pack_loop(name, &library, out, &wanted)), &mut failures);
    for file in fmus.iter().filter(|file| before.get(*file).is_some_and(|version| version != standard.version())) {
        let (name, before) = (file.display(), &before[file]);
        remark!("{name} was an FMU of FMI {before}, and is one of FMI {} now", standard.version());
    }
    let paths = |files: &[PathBuf]| files.iter().map(|file| console::path(file)).collect::<Vec<_>>();
    if !failures.is_empty() && fmus.is_empty() && loops.is_empty() {
        // Nothing to print.
    } else if *json && ssp.is_empty() {
        print_line!("{}", json!({ "fmus": paths(&fmus) }));
    } else if *json {
        print_line!("{}", json!({ "fmus": paths(&fmus), "ssps": paths(&loops) }));
    } else {
        fmus.iter().chain(&loops).for_each(|file| print_line!("{}", file.display()));
    }
    if let Some(last) = failures.pop() {
        failures.iter().for_each(|error| error_line!("error: {error}"));
        return Err(last);
    }
    let Some(name) = run else { return Ok(ExitCode::SUCCESS) };
    // A parameter set is what the user wants, whatever the loop sets.
    if wanted.content.form != Form::Generic && values.is_none() {
        design_for(name, &library, out, &wanted, &fmus)?;
    }
    super::run::execute(&super::run::Arguments::of(name, out, *json))
}

impl Arguments {
    /// Writes controllers as C for targets.
    fn write_firmware(&self, names: &[String], library: &Library) -> Result<ExitCode, Error> {
        let fallback = match self.fallback.as_str() {
            "hold" => Fallback::Hold,
            "zero" => Fallback::Zero,
            "manual" => Fallback::Manual,
            other => return Err(Error::unknown("fallback", other, ["hold", "zero", "manual"], "")),
        };
        let named = |names: &Vec<String>| names.iter().filter(|name| !name.is_empty()).cloned().collect();
        let calibrate = self.calibrate.as_ref().map(named);
        let mut files = Vec::new();
        for name in names {
            let source = exporter::find_description(name)?;
            let source = match &self.values {
                Some(values) => with_values(source, values, library)?,
                None => source,
            };
            let calibrate = calibrate.clone();
            let mut options = Options { period: self.period, fallback, calibrate, ..Options::default() };
            options.substeps = self.substeps.unwrap_or(options.substeps);
            options.check().map_err(|invalid| Error::Argument(Invalid::because(format!("{name}: {invalid}"))))?;
            let (in_loop, found_in) = self.in_loop(&source, library)?;
            options.substeps = in_loop.substeps;
            options.may_rise = self.substeps.is_none();
            options.signals = (!in_loop.signals.is_empty()).then_some(in_loop.signals);
            let (written, substeps) = exporter::export_firmware(&source, library, &options, &self.out)?;
            files.extend(written);
            if let Some(FoundIn { name, loop_name, period }) = found_in {
                remark!("{name}: {substeps} Runge-Kutta steps in {period} s, as {loop_name} needs them");
            }
        }
        if self.json {
            print_line!("{}", json!({ "files": files.iter().map(|file| console::path(file)).collect::<Vec<_>>() }));
        } else {
            files.iter().for_each(|file| print_line!("{}", file.display()));
        }
        Ok(ExitCode::SUCCESS)
    }

    /// A controller in its loop: the Runge-Kutta steps that it needs there, where their number isn't given, and its signals; and
    /// where that number was found.
    fn in_loop(&self, source: &Source, library: &Library) -> Result<(InLoop, Option<FoundIn>), Error> {
        let refuse = |reason: String| Error::Description { file: source.file.clone(), reason };
        let described = Description::read(&source.text).map_err(|invalid| refuse(invalid.to_string()))?;
        let name = &described.name;
        let unit = library.describe(Some(source))?.unit;
        let unit = unit.map(|unit| ModelDescription::read(&unit.model_description)).transpose().map_err(refuse)?;
        let usual = described.experiment.step;
        let step = self.period.unwrap_or_else(|| unit.as_ref().map_or(usual, |unit| period(unit, usual)));
        let examples = || exporter::loops().iter().map(|(name, _)| *name);
        let loops: Vec<&str> = self.in_loop.as_deref().map_or_else(|| examples().collect(), |name| vec![name]);
        for name_of_loop in loops {
            let structure = LoopFiles::find(name_of_loop)?.structure()?;
            let Some(component) = structure.components.iter().find(|component| component.fmu == *name) else {
                continue;
            };
            let found = in_loop(&structure, component, (step, self.substeps), &*super::ready::units()?)?;
            let is_found = self.substeps.is_none() && found.integrates;
            let found_in = || FoundIn { name: name.clone(), loop_name: name_of_loop.to_owned(), period: step };
            return Ok((found, is_found.then(found_in)));
        }
        if let Some(name_of_loop) = &self.in_loop {
            return Err(refuse(format!("{name_of_loop} has no component of {name}")));
        }
        let integrates = unit.is_none_or(|unit| unit.variable("integration_method").is_some());
        match self.substeps {
            None if integrates => Err(refuse(format!(
                "no example has {name}: --loop LOOP names the loop in which the number of Runge-Kutta steps is found (`adaptive-fmu \
                 new loop` writes one), or --substeps N gives it"
            ))),
            asked => Ok((InLoop { substeps: asked.unwrap_or(1), integrates, signals: Signals::new() }, None)),
        }
    }

    /// Form of the FMUs.
    fn form(&self) -> Result<Form, Error> {
        let named = |name: &String| {
            Platform::named(name)
                .ok_or_else(|| Error::unknown("platform", name, Platform::all().map(|platform| platform.folder), ""))
        };
        let platforms = self.platforms.iter().map(named).collect::<Result<Vec<_>, _>>()?;
        Ok(if !platforms.is_empty() {
            Form::CompiledFor { platforms }
        } else if self.compile {
            Form::Compiled
        } else if self.source || self.source_only {
            Form::Source { with_library: !self.source_only }
        } else {
            Form::Generic
        })
    }
}

/// The loop in which the number of a controller's Runge-Kutta steps was found.
struct FoundIn {
    name: String,
    loop_name: String,
    /// From call to call, s.
    period: f64,
}

/// The libraries named, or those built with this program; that of this platform is its own where none is named.
pub fn chosen(named: &[String]) -> Result<Library, Error> {
    if named.is_empty() {
        return Library::next_to_program()?.with_other_platforms();
    }
    let mut others = named.iter().map(|name| Binary::named(name)).collect::<Result<Vec<_>, _>>()?;
    let own = others.iter().position(|binary| binary.platform == Platform::own()).map(|place| others.remove(place));
    let mut library = own.map_or_else(Library::next_to_program, |binary| Library::open(&binary.file))?;
    others.into_iter().try_for_each(|binary| library.add(binary))?;
    Ok(library)
}

/// The FMUs in a folder, and the version of FMI that each is of.
fn versions(folder: &Path) -> HashMap<PathBuf, String> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    files.filter_map(|file| exporter::version_of(&file).map(|version| (file, version))).collect()
}

/// The names of all FMUs of this package.
fn all() -> Vec<String> {
    exporter::descriptions().iter().map(|(name, _)| (*name).to_owned()).collect()
}

/// The names, with the descriptions in a folder in place of that.
fn with_folders(names: &[String]) -> Result<Vec<String>, Error> {
    let mut all = Vec::new();
    for name in names {
        let folder = Path::new(name);
        if !folder.is_dir() || exporter::descriptions().iter().any(|(known, _)| known == name) {
            all.push(name.clone());
            continue;
        }
        let files = std::fs::read_dir(folder).and_then(Iterator::collect::<Result<Vec<_>, _>>);
        let mut files: Vec<_> = files.map_err(Error::file(folder))?.into_iter().map(|entry| entry.path()).collect();
        files.sort();
        let is_toml = |file: &&PathBuf| file.extension().is_some_and(|extension| extension == "toml");
        // Other TOML files may lie there, too.
        let describes = |file: &&PathBuf| {
            let text = std::fs::read_to_string(file).unwrap_or_default();
            let at_top = text.lines().take_while(|line| !line.trim_start().starts_with('['));
            at_top.into_iter().any(|line| line.split_once('=').is_some_and(|(key, _)| key.trim() == "model"))
        };
        let found: Vec<_> = files.iter().filter(is_toml).filter(describes).collect();
        if found.is_empty() {
            let reason = "contains no description of an FMU (NAME.toml). `adaptive-fmu new` writes one".to_owned();
            return Err(Error::Loop { file: folder.to_owned(), reason });
        }
        all.extend(found.into_iter().map(|file| file.to_string_lossy().into_owned()));
    }
    Ok(all)
}

/// Path of an FMU or archive that was written, or the error.
type Tried = Result<PathBuf, Error>;

/// Contents of the FMUs.
struct Wanted {
    content: Content,
    /// True if they hold reference results.
    results: bool,
}

/// Writes the FMU of a description into a folder; a line if it has no reference results though it should.
fn export_one(source: &Source, library: &Library, out: &Path, wanted: &Wanted) -> Tried {
    let Exported { file, without } = related::export(source, library, out, &wanted.content, wanted.results)?;
    if let Some(reason) = without {
        remark!("{} is complete, but without reference results: {reason}", file.display());
    }
    Ok(file)
}

/// The files that were written; one that fails doesn't keep the others from it.
fn written(tried: impl IntoIterator<Item = Tried>, failures: &mut Vec<Error>) -> Vec<PathBuf> {
    tried.into_iter().filter_map(|tried| tried.map_err(|error| failures.push(error)).ok()).collect()
}

/// Writes FMUs into a folder.
fn export_named(names: &[String], library: &Library, out: &Path, wanted: &Wanted) -> Result<Vec<Tried>, Error> {
    warn_of(library)?;
    let one = |(): &(), k: usize| export_one(&exporter::find_description(&names[k])?, library, out, wanted);
    Ok(parallel::each(&vec![(); parallel::cores()], names.len(), one))
}

/// Writes one FMU that starts with the values of a parameter set.
fn export_with_values(names: &[String], values: &Path, library: &Library, out: &Path, wanted: &Wanted) -> Tried {
    let [name] = names else {
        let reason = format!("this parameter set would apply to {} FMUs. Name one FMU", names.len());
        return Err(Error::Loop { file: values.to_owned(), reason });
    };
    warn_of(library)?;
    export_one(&with_values(exporter::find_description(name)?, values, library)?, library, out, wanted)
}

/// Warnings about the packed libraries.
pub fn warn_of(library: &Library) -> Result<(), Error> {
    static LOGGED: Once = Once::new();
    let slow = !library.describe(None)?.build.optimised;
    let slow =
        slow.then(|| "the library was built without optimisation and is slow. Build it with --release".to_owned());
    let new = library.binaries().iter().filter_map(asks_for_much);
    let warnings = slow.into_iter().chain(new).chain(library.left_out().iter().cloned());
    LOGGED.call_once(|| warnings.for_each(|warning| error_line!("warning: {warning}")));
    Ok(())
}

/// Warning about a library that older systems can't load.
fn asks_for_much(Binary { file, build, glibc, .. }: &Binary) -> Option<String> {
    let asked = glibc.filter(|glibc| *glibc > Glibc::PROMISED)?;
    let (file, promised, target) = (file.display(), Glibc::PROMISED, &build.target);
    Some(format!(
        "{file} requires glibc {asked} or newer, so older systems can't load the FMUs. `cargo zigbuild --release \
         --target {target}.{promised}` builds a library for them (docs/platforms.md)"
    ))
}

/// Writes a loop as one FMU into a folder, but for some of its units.
fn export_whole(name: &str, without: &[String], library: &Library, out: &Path, wanted: &Wanted) -> Tried {
    let mut structure = LoopFiles::find(name)?.structure()?;
    structure.leave_out(without)?;
    warn_of(library)?;
    let (source, warnings) = composite(&structure, library)?;
    let file = export_one(&source, library, out, wanted)?;
    warnings.iter().for_each(|warning| error_line!("warning: {warning}"));
    Ok(file)
}

/// The FMUs of a loop that are exported from descriptions.
fn exported(structure: &Structure) -> BTreeSet<&String> {
    let exported = structure.components.iter().filter(|component| component.is_exported());
    exported.map(|component| &component.fmu).collect()
}

/// Writes a loop as an .ssp archive, with the FMUs that came with it, or newly exported ones.
fn pack_loop(name: &str, library: &Library, out: &Path, wanted: &Wanted) -> Tried {
    let files = LoopFiles::find(name)?;
    let new = Scratch::new()?;
    let structure = files.structure()?;
    if structure.components.iter().any(Component::is_exported) {
        export_with_choices(&structure, library, new.path(), wanted)?;
    }
    let (file, warnings) = pack(&files, new.path(), out)?;
    warnings.iter().for_each(|warning| error_line!("warning: {warning}"));
    Ok(file)
}

/// Writes the FMUs of a loop into a folder, started as the loop chooses from enumerations, which other masters can't set, and
/// designed with its values where a design is fixed at export.
fn export_with_choices(structure: &Structure, library: &Library, out: &Path, wanted: &Wanted) -> Result<(), Error> {
    warn_of(library)?;
    for fmu in exported(structure) {
        let source = match wanted.content.form {
            Form::Generic => structure.description_of(fmu)?,
            _ => designed(structure, fmu, library)?,
        };
        export_one(&source.with_start(choices(structure, fmu))?, library, out, wanted)?;
    }
    Ok(())
}

/// Writes those of some FMUs of a loop anew whose design is fixed at export and reads what the loop sets.
fn design_for(name: &str, library: &Library, out: &Path, wanted: &Wanted, fmus: &[PathBuf]) -> Result<(), Error> {
    let structure = LoopFiles::find(name)?.structure()?;
    let is_asked = |fmu: &&String| fmus.contains(&out.join(format!("{fmu}.fmu")));
    for fmu in exported(&structure).into_iter().filter(is_asked) {
        let source = designed(&structure, fmu, library)?;
        if source != structure.description_of(fmu)? {
            export_one(&source, library, out, wanted)?;
            remark!("{fmu}.fmu is designed with the values of {name}");
        }
    }
    Ok(())
}

/// The enumerations' items that all units of an FMU take.
fn choices<'a>(structure: &'a Structure, fmu: &str) -> Vec<(&'a str, &'a str)> {
    let mut units = structure.components.iter().filter(|component| component.fmu == fmu).map(|unit| {
        let chosen = unit.values.iter().filter(|value| value.data_type.as_deref() == Some("Enumeration"));
        chosen.map(|value| (value.name.as_str(), value.text.trim())).collect::<BTreeSet<_>>()
    });
    let first = units.next().unwrap_or_default();
    let common = units.fold(first, |common, unit| &common & &unit);
    common.into_iter().collect()
}
