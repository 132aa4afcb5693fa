//! Generates the constants of pages, icons and embedded files.

use std::path::{Path, PathBuf};
use std::{env, fs};

use adaptive_fmu_sources::{self as sources, entries};

fn main() {
    embed();
    let pages = ["controllers", "plants"].map(|folder| Path::new("docs").join(folder));
    let pages: String = pages.iter().flat_map(|folder| entries(folder)).map(|file| page(&file)).collect();
    let icons = entries(Path::new("modelDescription/icons"));
    let icons: String =
        icons.iter().filter(|file| file.extension().is_some_and(|e| e == "svg")).map(|file| icon(file)).collect();
    write("pages.rs", &format!("{pages}const ICONS: &[Icon] = &[\n{icons}];\n"));
    // All sources of the library. In a package from a registry, the framework is a package of its own. Of the
    // documentation, FMUs and archives contain only these pages.
    let code = ["framework", "library"].map(|name| Path::new("crates").join(name).join("src"));
    let texts =
        ["src", "plants", "Cargo.toml", "docs/controllers", "docs/plants", "docs/license.txt", "docs/start.txt"];
    let places = code.into_iter().filter(|folder| folder.is_dir()).chain(texts.map(PathBuf::from));
    sources::track(&places.collect::<Vec<_>>());
}

/// Embeds the descriptions of FMUs and the closed loops in the program, which so needs no other files.
fn embed() {
    println!("cargo::rerun-if-changed=modelDescription");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").unwrap_or_default());
    let descriptions = texts(&root.join("modelDescription"), &["toml"], stem);
    // A page is for FMUs of a user; it computes what it needs.
    let is_page = env::var("CARGO_CFG_TARGET_FAMILY").is_ok_and(|family| family == "wasm");
    let references = root.join("modelDescription/references");
    let references = if is_page { String::new() } else { texts(&references, &["json"], stem) };
    let loops =
        entries(&root.join("examples")).into_iter().filter(|folder| folder.join("SystemStructure.ssd").is_file());
    let loops: Vec<_> = loops.collect();
    // Only these folders: files that a notebook leaves in `examples` must not trigger a new build.
    loops.iter().for_each(|folder| println!("cargo::rerun-if-changed={}", folder.display()));
    let responses: String = loops.iter().filter_map(|folder| response(folder)).collect();
    let loops =
        loops.iter().map(|folder| format!("({:?}, &[\n{}]),\n", name(folder), texts(folder, &["ssd", "ssv"], name)));
    let league = root.join("examples/league");
    println!("cargo::rerun-if-changed={}", league.display());
    let zoo = root.join("examples/zoo");
    println!("cargo::rerun-if-changed={}", zoo.display());
    let zoo = texts(&zoo, &["json", "toml"], name);
    let code = format!(
        "static LEAGUE: Embedded = &[\n{}];\nstatic ZOO: Embedded = &[\n{zoo}];\n\
         static DESCRIPTIONS: Embedded = &[\n{descriptions}];\nstatic REFERENCES: Embedded = &[\n{references}];\nstatic LOOPS: &[(&str, Embedded)] = &[\n{}];\n\
         static RESPONSES: Embedded = &[\n{responses}];\n",
        texts(&league, &["toml"], name),
        loops.collect::<String>()
    );
    write("embedded.rs", &code);
}

/// The entries of front matter; a page needs the first five.
const ENTRIES: [&str; 7] = ["title", "purpose", "alone", "gains", "limits", "take it for", "followed by"];

/// The page of a kind as a constant of its name: its front matter, and its text with that of the page that follows it.
fn page(file: &Path) -> String {
    let (head, mut text) = front_matter(file);
    let unknown = head.iter().find(|(name, _)| !ENTRIES.contains(&name.as_str()));
    assert!(unknown.is_none(), "{}: `{}` is none of {ENTRIES:?}", file.display(), unknown.unwrap().0);
    let lacking = ENTRIES[..5].iter().find(|entry| !head.iter().any(|(name, _)| name == *entry));
    assert!(lacking.is_none(), "{}: its front matter lacks `{}`", file.display(), lacking.unwrap());
    let value_of =
        |key: &str| head.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str()).unwrap_or_default();
    if !value_of("followed by").is_empty() {
        text += &front_matter(&Path::new("docs").join(value_of("followed by")).with_extension("md")).1;
    }
    let gains: String = value_of("gains")
        .replace("\n  ", " ")
        .lines()
        .filter_map(|line| line.split_once(": "))
        .fold(String::new(), |list, (name, text)| list + &format!("({name:?}, {text:?}), "));
    let [title, purpose, alone, limits, choice] = ["title", "purpose", "alone", "limits", "take it for"].map(value_of);
    let choice: Vec<_> = choice.lines().collect();
    assert!([0, 2].contains(&choice.len()), "{}: `take it for` has two lines", file.display());
    let place = file.strip_prefix("docs").unwrap_or(file).with_extension("");
    format!(
        "/// [{title}](Page).\npub const {}: Page = Page {{\nplace: {place:?},\ntitle: {title:?},\nguide: Guide {{ \
         purpose: {purpose:?}, alone: {alone:?}, gains: &[{gains}], limits: {limits:?} }},\nchoice: &{choice:?},\ntext: {text:?},\n}};\n",
        stem(file).to_uppercase()
    )
}

/// The entries of a page's front matter, which may be YAML scalars and blocks only, and the text below it.
fn front_matter(file: &Path) -> (Vec<(String, String)>, String) {
    let page = fs::read_to_string(file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let parts = page.strip_prefix("---\n").and_then(|page| page.split_once("\n---\n"));
    let (head, text) = parts.unwrap_or_else(|| panic!("{}: it should begin with front matter", file.display()));
    let mut entries: Vec<(String, String)> = Vec::new();
    let mut between = "";
    for line in head.lines() {
        if let (Some(line), Some((_, value))) = (line.strip_prefix("  "), entries.last_mut()) {
            *value += if value.is_empty() { "" } else { between };
            *value += line;
        } else if let Some((key, value)) = line.split_once(':') {
            between = if value == " |-" { "\n" } else { " " };
            entries.push((key.to_owned(), value.trim_matches([' ', '|', '>', '-']).to_owned()));
        }
    }
    (entries, text.to_owned())
}

/// An icon as an entry of a Rust array.
fn icon(svg: &Path) -> String {
    let svg = Path::new(&env::var("CARGO_MANIFEST_DIR").unwrap_or_default()).join(svg);
    let png = svg.with_extension("png");
    format!("Icon {{ name: {:?}, svg: include_str!({svg:?}), png: include_bytes!({png:?}) }},\n", stem(&svg))
}

/// A file of code, where `include!` finds it.
fn write(name: &str, code: &str) {
    let file = Path::new(&env::var("OUT_DIR").unwrap_or_default()).join(name);
    fs::write(file, code).expect("cargo's own folder can be written");
}

/// The response of a loop as an entry of a Rust array, if the folder has one.
fn response(folder: &Path) -> Option<String> {
    let file = folder.join("response.txt");
    file.is_file().then(|| format!("({:?}, include_str!({file:?})),\n", name(folder)))
}

/// The files of a folder with one of some extensions, as entries of a Rust array: key and text.
fn texts(folder: &Path, extensions: &[&str], key: fn(&Path) -> String) -> String {
    let has = |path: &PathBuf| path.extension().is_some_and(|e| extensions.iter().any(|extension| e == *extension));
    let files = entries(folder).into_iter().filter(has);
    files.map(|path| format!("({:?}, include_str!({path:?})),\n", key(&path))).collect()
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
