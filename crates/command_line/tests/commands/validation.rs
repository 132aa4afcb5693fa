//! `validate` finds nothing wrong with the units of this package, and each fault that is put into one.
#![cfg(target_os = "linux")]

mod allowed;
mod bounds;
mod universal;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use adaptive_fmu::exporter::{self, Platform};
use adaptive_fmu::fmu::Hosting;
use adaptive_fmu::validation::{Finding, Report, Severity, Trial, validate};
use common::at_top;
use tempfile::TempDir;

/// A unit with variables of every kind that the package has.
const UNIT: &str = "L1NonlinearSiso";

fn program(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_adaptive-fmu")).args(arguments).current_dir(at_top("")).output().unwrap()
}

/// The unit, exported once.
fn good() -> &'static (TempDir, PathBuf) {
    static GOOD: OnceLock<(TempDir, PathBuf)> = OnceLock::new();
    GOOD.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let done = program(&["export", UNIT, "--out", folder.path().to_str().unwrap()]);
        assert!(done.status.success(), "{done:?}");
        let file = folder.path().join(format!("{UNIT}.fmu"));
        (folder, file)
    })
}

/// The files of its archive: names and bytes.
type Entries = Vec<(String, Vec<u8>)>;

fn entries() -> &'static Entries {
    static ENTRIES: OnceLock<Entries> = OnceLock::new();
    ENTRIES.get_or_init(|| {
        let (_, file) = good();
        let names = exporter::entries(file).unwrap().into_iter().map(|entry| entry.name);
        names.map(|name| (name.clone(), exporter::read_bytes(file, &name).unwrap())).collect()
    })
}

/// The unit with other files in its archive.
fn edited(edit: impl Fn(&mut Entries)) -> (TempDir, PathBuf) {
    let mut entries = entries().clone();
    edit(&mut entries);
    packed(&entries)
}

fn packed(entries: &[(String, Vec<u8>)]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("edited.fmu");
    let entries: Vec<_> = entries.iter().map(|(name, bytes)| (name.as_str(), bytes.as_slice())).collect();
    exporter::write_entries(&file, &entries).unwrap();
    (folder, file)
}

fn xml() -> String {
    exporter::read_entry(&good().1, "modelDescription.xml").unwrap()
}

/// Findings, without a run, for another description.
fn findings_of(xml: &str) -> Vec<Finding> {
    // Without its library: that is not what is edited, and takes long to read.
    let (_folder, file) = edited(|entries| {
        entries.retain(|(name, _)| !name.starts_with("binaries/"));
        entries.push(("sources/all.c".to_owned(), Vec::new()));
        entries.iter_mut().find(|(name, _)| name == "modelDescription.xml").unwrap().1 = xml.as_bytes().to_vec();
    });
    let report = validate(&file, None).unwrap();
    let about = |finding: &&Finding| !finding.what.contains("binaries/");
    report.findings.listed().iter().filter(about).cloned().collect()
}

#[test]
fn nothing_is_found_in_any_unit_of_this_package() {
    let folder = tempfile::tempdir().unwrap();
    let done = program(&["export", "--all", "--out", folder.path().to_str().unwrap()]);
    assert!(done.status.success(), "{done:?}");
    let files: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(files.len(), exporter::descriptions().len());
    for file in files {
        let Report { findings, trial, .. } = validate(&file, Some(&Hosting::InProcess)).unwrap();
        assert!(findings.listed().is_empty(), "{}: {:#?}", file.display(), findings.listed());
        assert!(matches!(trial, Trial::Ran(steps) if steps > 0), "{}: {trial:?}", file.display());
    }
}

#[test]
fn nothing_is_found_in_a_composite_or_in_a_unit_with_names_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(program(&["export", "--composite", "3.3.1-case2", "--out", out]).status.success());
    for own in ["dc_motor/DcMotor", "dc_motor/DcMotorController", "two_mass_drive/TwoMassDriveReference"] {
        assert!(program(&["export", &format!("examples/own/{own}.toml"), "--out", out]).status.success());
    }
    let files: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
    assert_eq!(files.len(), 4);
    for file in files {
        let Report { findings, trial, .. } = validate(&file, Some(&Hosting::InProcess)).unwrap();
        assert!(findings.listed().is_empty(), "{}: {:#?}", file.display(), findings.listed());
        assert!(matches!(trial, Trial::Ran(steps) if steps > 0));
    }
}

/// An edit of the description: a text, its replacement (at the first place), and the finding.
type Edit = (&'static str, &'static str, &'static str);

const EDITS: [Edit; 46] = [
    ("fmiVersion=\"2.0\"", "fmiVersion=\"1.0\"", "fmiVersion = \"1.0\""),
    ("fmiVersion=\"2.0\"", "", "lacks the required attribute `fmiVersion`"),
    ("modelName=\"L1NonlinearSiso\"", "modelName=\"\"", "modelName is empty"),
    ("guid=\"", "id=\"", "lacks the required attribute `guid`"),
    ("<fmiModelDescription ", "<fmiModelDescription colour=\"red\" ", "does not allow the attribute `colour`"),
    ("\"structured\"", "\"nested\"", "variableNamingConvention = \"nested\" in fmiModelDescription"),
    ("numberOfEventIndicators=\"1\"", "numberOfEventIndicators=\"-1\"", "numberOfEventIndicators = \"-1\""),
    ("generationTool=", "generationDateAndTime=\"31.1.2026\" generationTool=", "generationDateAndTime = \"31.1.2026\""),
    (
        "modelIdentifier=\"L1NonlinearSiso\"",
        "modelIdentifier=\"L1-Siso\"",
        "modelIdentifier = \"L1-Siso\" of ModelExchange",
    ),
    ("canGetAndSetFMUstate=\"true\"", "", "canSerializeFMUstate without canGetAndSetFMUstate"),
    ("providesDirectionalDerivative=\"true\"", "providesDirectionalDerivative=\"yes\"", "it must be true or false"),
    ("<BaseUnit/>", "<BaseUnit m=\"1.5\"/>", "m = \"1.5\" in BaseUnit"),
    ("<Unit name=\"1/s\">", "<Unit name=\"1\">", "the unit `1` is defined twice"),
    ("<Unit name=\"1/s\">", "<Unit name=\"1/min\">", "the unit `1/s` is not defined"),
    (
        "<SimpleType name=\"AdaptiveStart\">",
        "<SimpleType name=\"InputHandling\">",
        "the type `InputHandling` is defined twice",
    ),
    (
        "<SimpleType name=\"AdaptiveStart\">",
        "<SimpleType name=\"enabled\">",
        "the type `enabled` has the same name as a variable",
    ),
    (
        "name=\"bumpless\" value=\"2\"",
        "name=\"bumpless\" value=\"1\"",
        "two items of the type `AdaptiveStart` have the value 1",
    ),
    (
        "<Category name=\"logEvents\"",
        "<Category name=\"logStatusError\"",
        "the log category `logStatusError` appears twice",
    ),
    ("stopTime=\"20.0\"", "stopTime=\"-1\"", "stopTime = -1 is not after startTime = 0"),
    ("tolerance=\"1e-6\"", "tolerance=\"1e-6 m\"", "tolerance = \"1e-6 m\" in DefaultExperiment"),
    ("stepSize=\"0.001\"", "stepSize=\"-0.001\"", "stepSize = -0.001"),
    ("<ModelVariables>", "<ModelVariables>loose", "ModelVariables contains text"),
    ("<ModelVariables>", "<Parameters/><ModelVariables>", "does not allow the element `Parameters`"),
    ("<ModelVariables>", "<ModelStructure/><ModelVariables>", "ModelVariables must come before ModelStructure"),
    ("name=\"r[1]\" valueReference", "name=\"x[1]\" valueReference", "already has this name"),
    ("name=\"r[1]\" valueReference", "name=\"r[1\" valueReference", "does not follow the convention `structured`"),
    ("valueReference=\"35\"", "valueReference=\"-35\"", "valueReference = \"-35\""),
    (
        "valueReference=\"35\"",
        "valueReference=\"36\"",
        "it shares valueReference 36 with `r[1]`, and both have a start value",
    ),
    ("causality=\"input\"", "causality=\"sensor\"", "causality = \"sensor\" in ScalarVariable"),
    (
        "causality=\"input\" variability=\"continuous\"",
        "causality=\"input\" variability=\"fixed\"",
        "the variability must be discrete, continuous",
    ),
    ("causality=\"input\" variability=\"continuous\"", "causality=\"input\" initial=\"exact\"", "remove initial"),
    (
        "variability=\"tunable\" initial=\"exact\"",
        "variability=\"tunable\" initial=\"approx\"",
        "initial must be exact",
    ),
    (
        "variability=\"discrete\">\n      <Boolean",
        "variability=\"continuous\">\n      <Boolean",
        "variability = \"continuous\", but the type is Boolean",
    ),
    ("<Real unit=\"1\" start=\"0.0\"/>", "<Real unit=\"1\"/>", "there is no start value, but causality = \"input\""),
    ("<Real unit=\"1\"/>", "<Real unit=\"1\" start=\"0\"/>", "there is a start value, but initial = \"calculated\""),
    ("<Real unit=\"1\" start=\"0.0\"/>", "<Real unit=\"1\" start=\"0,0\"/>", "start = \"0,0\" in Real"),
    (
        "<Real unit=\"1\" start=\"0.0\"/>",
        "<Real unit=\"1\" start=\"0\" min=\"1\"/>",
        "start = 0 is outside its limits, 1 … inf",
    ),
    (
        "<Real unit=\"1\" start=\"0.0\"/>",
        "<Real unit=\"1\" start=\"0\" min=\"1\" max=\"-1\"/>",
        "min = 1 is above max = -1",
    ),
    ("<Real unit=\"1\" start=\"0.0\"/>", "<Real unit=\"1\" start=\"0\" nominal=\"0\"/>", "nominal = 0"),
    ("<Real unit=\"1\" start=\"0.0\"/>", "<Real unit=\"furlong\" start=\"0\"/>", "the unit `furlong` is not defined"),
    (
        "<Real unit=\"1\" start=\"0.0\"/>",
        "<Real declaredType=\"InputHandling\" start=\"0\"/>",
        "`InputHandling` is defined for Enumeration",
    ),
    ("<Real unit=\"1\" start=\"0.0\"/>", "<Real derivative=\"9999\" start=\"0\"/>", "derivative = \"9999\""),
    (
        "<Real unit=\"1\" start=\"0.0\"/>",
        "<Real reinit=\"true\" start=\"0\"/>",
        "reinit = \"true\", but the variable is not a state",
    ),
    (
        "<Real unit=\"1\" start=\"0.0\"/>",
        "",
        "ScalarVariable contains no Real or Integer or Boolean or String or Enumeration",
    ),
    ("declaredType=\"InputHandling\"", "declaredType=\"Nothing\"", "the type `Nothing` is not defined"),
    (
        "declaredType=\"InputHandling\" min=\"1\" max=\"3\" start=\"1\"",
        "declaredType=\"InputHandling\" start=\"4\"",
        "start = 4 matches no item",
    ),
];

#[test]
fn each_fault_of_a_description_is_found_by_its_line() {
    let whole = xml();
    assert_eq!(findings_of(&whole), []);
    for (was, is, message) in EDITS {
        assert!(whole.contains(was), "{was}");
        let findings = findings_of(&whole.replacen(was, is, 1));
        let found = findings.iter().find(|finding| format!("{} {}", finding.what, finding.advice).contains(message));
        let found = found.unwrap_or_else(|| panic!("{was} -> {is}: {findings:#?}"));
        assert!(found.severity == Severity::Error && !found.section.is_empty() && !found.advice.is_empty());
        assert!(found.line.is_some(), "{is}: {found:?}");
    }
}

/// Edits of the structure. They use the FMU's own numbers, from the file.
#[test]
fn each_fault_of_the_structure_is_found_by_its_variable() {
    let whole = xml();
    let list = |name: &str| {
        let (start, end) = (format!("<{name}>\n"), format!("    </{name}>"));
        let begin = whole.find(&start).unwrap() + start.len();
        (begin, begin + whole[begin..].find(&end).unwrap())
    };
    let with = |name: &str, edit: &dyn Fn(&str) -> String| {
        let (begin, end) = list(name);
        format!("{}{}{}", &whole[..begin], edit(&whole[begin..end]), &whole[end..])
    };
    let first = |text: &str| text.lines().next().unwrap().to_owned() + "\n";
    let index = |text: &str| text.split('"').nth(1).unwrap().to_owned();
    let add = |unknown: &'static str| move |text: &str| format!("{text}{unknown}\n");
    let without_first = |text: &str| text.replacen(&first(text), "", 1);
    let dependencies = |to: &'static str| {
        move |text: &str| {
            let own = text.split("dependencies=\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
            text.replacen(&format!("dependencies=\"{own}\""), to, 1)
        }
    };
    let edits: Vec<(String, &str)> = vec![
        (with("Outputs", &without_first), "it is an output, but is not listed in Outputs"),
        (with("Outputs", &add("<Unknown index=\"1\"/>")), "it is listed in Outputs, but has causality input"),
        (with("Outputs", &|text| format!("{text}{}", first(text))), "it is listed twice in Outputs"),
        (with("Outputs", &add("<Unknown index=\"0\"/>")), "index = \"0\" in Outputs"),
        (with("Outputs", &add("<Unknown index=\"9999\"/>")), "index = \"9999\" in Outputs"),
        (with("Outputs", &add("<Unknown/>")), "Unknown lacks the required attribute `index`"),
        (with("Derivatives", &dependencies("dependencies=\"9999\"")), "dependencies = \"9999\" in Derivatives"),
        (with("Derivatives", &dependencies("dependencies=\"1 1\"")), "dependencies list variable 1 twice"),
        (with("Derivatives", &dependencies("dependencies=\"one\"")), "dependencies = \"one\" in Unknown"),
        (
            with("Derivatives", &dependencies("dependencies=\"1 2\" dependenciesKind=\"fixed\"")),
            "2 dependencies, but 1 entries in dependenciesKind",
        ),
        (
            with("Derivatives", &dependencies("dependenciesKind=\"fixed\"")),
            "dependenciesKind is given without dependencies",
        ),
        (
            with("Derivatives", &dependencies("dependencies=\"1\" dependenciesKind=\"perhaps\"")),
            "dependenciesKind = \"perhaps\"",
        ),
        (
            with("Derivatives", &|text| text.replacen(&format!("index=\"{}\"", index(text)), "index=\"1\"", 1)),
            "it is listed in Derivatives, but has no attribute derivative",
        ),
        (with("InitialUnknowns", &without_first), "is not listed in InitialUnknowns"),
        (
            with("InitialUnknowns", &add("<Unknown index=\"1\"/>")),
            "it is listed in InitialUnknowns, but is not an output",
        ),
        (
            with("InitialUnknowns", &|text| {
                let begins = text.find(" dependencies=\"").unwrap();
                let ends = begins + text[begins..].find("/>").unwrap();
                let kinds = " dependencies=\"1\" dependenciesKind=\"fixed\"";
                format!("{}{kinds}{}", &text[..begins], &text[ends..])
            }),
            "dependenciesKind = \"fixed\" in InitialUnknowns",
        ),
    ];
    for (edited, kinds) in edits {
        let findings = findings_of(&edited);
        let found = findings.iter().find(|finding| finding.what.contains(kinds));
        let found = found.unwrap_or_else(|| panic!("{kinds}: {findings:#?}"));
        assert!(found.severity == Severity::Error && found.section == "2.2.8" && found.line.is_some(), "{found:?}");
    }
}

#[test]
fn a_file_that_is_no_xml_is_a_finding_and_one_that_is_no_archive_an_error() {
    let whole = xml();
    for broken in [&whole[..whole.len() / 2], "", "<a/>", "<!DOCTYPE x><fmiModelDescription/>", "{}"] {
        let findings = findings_of(broken);
        assert!(findings.iter().any(|finding| finding.severity == Severity::Error), "{broken:.40}: {findings:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("no.fmu");
    fs::write(&file, "no archive").unwrap();
    let done = program(&["validate", file.to_str().unwrap()]);
    assert!(done.status.code() == Some(1) && done.stdout.is_empty(), "{done:?}");
}

fn found_in(file: &Path) -> Vec<String> {
    validate(file, Some(&Hosting::InProcess)).unwrap().findings.listed().iter().map(ToString::to_string).collect()
}

#[test]
fn each_fault_of_an_archive_is_found() {
    type Case<'a> = (&'a str, &'a dyn Fn(&mut Entries));
    let cases: [Case; 8] = [
        (
            "has no modelDescription.xml at its root (FMI 2.0, section 2.3): `unit/modelDescription.xml` is in a subfolder",
            &|all| {
                all.iter_mut().for_each(|(name, _)| name.insert_str(0, "unit/"));
            },
        ),
        ("has no modelDescription.xml at its root (FMI 2.0, section 2.3): add it", &|all| {
            all.retain(|(name, _)| name != "modelDescription.xml");
        }),
        ("the entry `../x` would be unpacked outside", &|all| all.push(("../x".to_owned(), Vec::new()))),
        ("the entry `/x` would be unpacked outside", &|all| all.push(("/x".to_owned(), Vec::new()))),
        ("the path `resources\\x` contains a backslash", &|all| all.push(("resources\\x".to_owned(), Vec::new()))),
        ("warning: `notes.txt` at the root", &|all| all.push(("notes.txt".to_owned(), Vec::new()))),
        ("there is no library binaries/PLATFORM/L1NonlinearSiso.so", &|all| {
            all.retain(|(name, _)| !name.starts_with("binaries/"));
        }),
        ("is not a shared library: ", &|all| {
            all.iter_mut()
                .filter(|(name, _)| name.starts_with("binaries/"))
                .for_each(|(_, bytes)| bytes.truncate(1000));
        }),
    ];
    for (message, edit) in cases {
        let (_folder, file) = edited(edit);
        let found = found_in(&file);
        assert!(found.iter().any(|finding| finding.contains(message)), "{message}: {found:#?}");
    }
}

/// A unit in C with some faults, packed; none where there is no C compiler.
fn built(faults: &[&str], flags: &str) -> (TempDir, PathBuf) {
    built_as(faults, &description(flags))
}

fn built_as(faults: &[&str], description: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("unit.so");
    let source = at_top("tests/validation/unit.c");
    let faults: Vec<_> = faults.iter().map(|fault| format!("-D{fault}")).collect();
    let done = Command::new("cc").args(["-shared", "-fPIC", "-o"]).arg(&library).arg(source).args(faults).output();
    let done = done.unwrap();
    assert!(done.status.success(), "{done:?}");
    packed(&[
        ("modelDescription.xml".to_owned(), description.as_bytes().to_vec()),
        (Platform::own().binary("unit"), fs::read(library).unwrap()),
    ])
}

/// The description of that unit.
fn description(flags: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<fmiModelDescription fmiVersion=\"2.0\" modelName=\"Unit\" guid=\"g\">\n\
         <CoSimulation modelIdentifier=\"unit\" {flags}/>\n\
         <DefaultExperiment startTime=\"0\" stopTime=\"1\" stepSize=\"0.1\"/>\n<ModelVariables>\n\
         <ScalarVariable name=\"y\" valueReference=\"0\" causality=\"output\"><Real/></ScalarVariable>\n\
         <ScalarVariable name=\"k\" valueReference=\"1\" causality=\"parameter\" variability=\"fixed\">\
         <Real start=\"1\"/></ScalarVariable>\n</ModelVariables>\n<ModelStructure>\
         <Outputs><Unknown index=\"1\"/></Outputs><InitialUnknowns><Unknown index=\"1\"/></InitialUnknowns>\
         </ModelStructure>\n</fmiModelDescription>\n"
    )
}

#[test]
fn what_a_unit_does_when_it_is_run_is_found() {
    let (_folder, file) = built(&[], "");
    assert_eq!((found_in(&file), validate(&file, Some(&Hosting::InProcess)).unwrap().trial), (vec![], Trial::Ran(10)));
    let (_folder, file) = built(&["ONLY_ONE"], "canBeInstantiatedOnlyOncePerProcess=\"true\"");
    assert_eq!(found_in(&file), Vec::<String>::new());
    for (faults, flags, message) in [
        (&["NAN_OUTPUT"][..], "", "error: `y`: its value is NaN at t = "),
        (&["FAILING_STEP"], "", "fmi2DoStep failed at t = "),
        (&["OTHER_START"], "", "error: `k`: it starts at 2, but modelDescription.xml has start = 1"),
        (&["ONLY_ONE"], "", "fmi2Instantiate"),
        (&["UNLOADABLE"], "", "nothing_of_this_name"),
        (&["NO_STEP"], "", "/unit.so does not export fmi2DoStep, which CoSimulation requires"),
        (&["NO_STATE"], "", "does not export fmi2GetFMUstate, which CoSimulation requires"),
        (
            &["NO_STATE"],
            "canGetAndSetFMUstate=\"true\"",
            "does not export fmi2GetFMUstate, although canGetAndSetFMUstate is true in CoSimulation",
        ),
    ] {
        let (_folder, file) = built(faults, flags);
        let found = found_in(&file);
        assert!(found.len() == 1 && found[0].contains(message), "{faults:?} {flags}: {found:#?}");
        // Each gives one line, and the exit code. Two instances in processes of their own can't disturb each other.
        let place = if faults == ["ONLY_ONE"] { "--in-process" } else { "--patience=30" };
        let done = program(&["validate", file.to_str().unwrap(), place]);
        let lines = String::from_utf8(done.stdout).unwrap();
        assert!(done.status.code() == Some(3) && lines.lines().count() == 2, "{lines}");
    }
    // What isn't run can't fail.
    let (_folder, file) = built(&["NAN_OUTPUT"], "");
    assert_eq!(program(&["validate", file.to_str().unwrap(), "--no-run"]).status.code(), Some(0));
}

#[test]
fn findings_are_printed_for_scripts_too() {
    let (_folder, file) = built(&["OTHER_START"], "");
    let done = program(&["validate", file.to_str().unwrap(), "--json"]);
    let output: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((done.status.code(), &output["sound"], &output["errors"]), (Some(3), &false.into(), &1.into()));
    let finding = &output["findings"][0];
    assert_eq!(
        (&finding["severity"], &finding["variable"], &finding["section"]),
        (&"error".into(), &"k".into(), &"2.2.7".into())
    );
    let (_, good) = good();
    let done = program(&["validate", good.to_str().unwrap(), "--json"]);
    let output: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!((done.status.code(), &output["sound"], &output["warnings"]), (Some(0), &true.into(), &0.into()));
}
