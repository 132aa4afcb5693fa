//! The shared library that goes into every FMU.

use std::collections::HashMap;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::Source;
use super::binaries::{self, Binaries, Binary};
use super::embedded;
use super::lines;
use super::platform::Platform;
use crate::cache::{self, Checksum, Entry};
use crate::dynamic;
use crate::error::Error;
use crate::fmi2::describe::{self, Described, FirmwareRequest, SourceUnit};
use crate::fmi2::firmware::{Firmware, Options};
use crate::reference::ReferenceExperiment;
use crate::text_file;

/// Folder of the libraries in an archive for users without Rust, one folder a platform in it.
pub const LIBRARIES: &str = "libraries";
/// Where a Python wheel puts what belongs to a program, from the folder above the program's.
pub const SHARED: &str = "share/adaptive-fmu";

/// A shared library for this platform, with the same for others.
#[derive(Debug)]
pub struct Library {
    path: PathBuf,
    /// Checksum of its bytes, if they are a file's.
    checksum: Option<Checksum>,
    loaded: dynamic::Library,
    binaries: Binaries,
    left_out: Vec<String>,
    /// Its last replies, by questions and descriptions: loops ask for those of their units again and again.
    replies: Mutex<HashMap<Asked, String>>,
}

/// The name of a question, and the text of the description that it is about; none where it is about the library itself.
type Asked = (&'static str, Option<String>);

/// A question about a description.
struct Question {
    /// The function that answers it in a library with models of a user.
    name: &'static str,
    /// Function that answers it for this package's models, which are in the program.
    answer: describe::Answer,
    /// Kind of its cache entry, if the answer takes long and follows from library and text.
    cached: Option<&'static str>,
}

/// The question for the FMU of a description, or for the library itself.
const DESCRIBE: Question =
    Question { name: "adaptive_fmu_describe", answer: describe::reply, cached: Some("described") };
/// The question for its C source.
const SOURCE: Question = Question { name: "adaptive_fmu_source", answer: describe::source, cached: None };
/// The question for its controller as C for a target.
const FIRMWARE: Question = Question { name: "adaptive_fmu_firmware", answer: describe::firmware, cached: None };
/// The question for a reference experiment.
const REFERENCE: Question =
    Question { name: "adaptive_fmu_reference", answer: describe::reference, cached: Some("referenced") };

/// So many replies are cached.
const MOST_REPLIES: usize = 128;

/// Reason for which a library refuses a description, with the lines of its file, also in an archive. A text that was changed
/// since it was read, as by a parameter set, has none.
fn refused(Source { file, text, as_written }: &Source, reason: &str) -> Error {
    let reason = if *as_written { lines::placed(text, reason) } else { reason.to_owned() };
    Error::Description { file: file.clone(), reason }
}

type DescribeFunction =
    unsafe extern "C" fn(*const c_char, Option<unsafe extern "C" fn(*mut c_void, *const c_char)>, *mut c_void) -> c_int;

impl Library {
    /// The library built together with this program.
    ///
    /// # Errors
    /// When there is none.
    pub fn next_to_program() -> Result<Self, Error> {
        #[cfg(target_family = "wasm")]
        return Ok(Self::linked());
        #[cfg(not(target_family = "wasm"))]
        Self::found()
    }

    /// This very library, where none can be loaded.
    #[cfg(target_family = "wasm")]
    fn linked() -> Self {
        let path = PathBuf::from("this library");
        let (platform, build) = (Platform::own(), binaries::own_build());
        let own = Binary { platform, file: path.clone(), build, glibc: None, bytes: None };
        Self::of_linked(path, Binaries::of(own))
    }

    #[cfg(target_family = "wasm")]
    fn of_linked(path: PathBuf, binaries: Binaries) -> Self {
        let (left_out, replies) = (Vec::new(), Mutex::default());
        Library { path, checksum: None, loaded: dynamic::Library, binaries, left_out, replies }
    }

    /// This very library, with libraries for FMUs that a page holds.
    ///
    /// # Errors
    /// When there is none, or they aren't of the same sources as this one.
    #[cfg(target_family = "wasm")]
    pub fn holding(libraries: Vec<Vec<u8>>) -> Result<Self, Error> {
        let refuse = || Error::Library("a file of this page is no library of this package".to_owned());
        let binary = |bytes: Vec<u8>| {
            let found = Binary::of_bytes(Path::new("library"), &bytes)?.ok_or_else(refuse)?;
            Ok(Binary { bytes: Some(bytes), ..found })
        };
        let mut found = libraries.into_iter().map(binary).collect::<Result<Vec<_>, Error>>()?.into_iter();
        let first = found.next().ok_or_else(|| Error::Library("choose a platform for the FMU".to_owned()))?;
        let mut binaries = Binaries::of(first);
        found.try_for_each(|binary| binaries.add(binary))?;
        let library = Self::of_linked(PathBuf::from("this library"), binaries);
        if !library.is_own() {
            return Err(Error::Library("the libraries of this page are of other sources than the page".to_owned()));
        }
        Ok(library)
    }

    #[cfg(not(target_family = "wasm"))]
    fn found() -> Result<Self, Error> {
        let found = own_library().ok_or_else(|| {
            let name = Platform::own().library_name();
            let folder = program_folder().unwrap_or_default();
            Error::Library(format!(
                "{name} is neither in this program nor in its folder, {}, because this is a debug build. Build with \
                 --release, or give --library FILE",
                folder.display()
            ))
        })?;
        Library::open(&found)
    }

    /// With the libraries next to this program of the same sources for other platforms, and for older systems of this one.
    ///
    /// # Errors
    /// When the program's place isn't known.
    pub fn with_other_platforms(mut self) -> Result<Self, Error> {
        for binary in binaries::near(&program_folder()?) {
            let taken = self.binaries.take(binary);
            self.left_out.extend(taken.err().map(|error| format!("left out: {error}")));
        }
        Ok(self)
    }

    /// A library by its path.
    ///
    /// # Errors
    /// When it can't be loaded.
    pub fn open(path: &Path) -> Result<Self, Error> {
        text_file::open(path).map_err(Error::file(path))?;
        let refuse = |error: String| Error::Library(format!("{}: {error}", path.display()));
        // A bare name would be looked for among the libraries of the system.
        let whole = path.canonicalize().map_err(|error| refuse(error.to_string()))?;
        // SAFETY: loading runs the initialisers of a library that the user named or built; one of ours has none.
        let loaded = unsafe { dynamic::Library::new(whole) }.map_err(|error| refuse(with_causes(&error)))?;
        let bytes = std::fs::read(path).map_err(Error::file(path))?;
        let own = Binary::own(path, &bytes);
        Ok(Library {
            path: path.to_owned(),
            checksum: Some(cache::checksum(path, &bytes)),
            loaded,
            binaries: Binaries::of(own),
            left_out: Vec::new(),
            replies: Mutex::default(),
        })
    }

    /// Adds the same library for another platform, which goes into every FMU, too.
    ///
    /// # Errors
    /// When it is of other sources, or for a platform that there is a library for already.
    pub fn add(&mut self, other: Binary) -> Result<(), Error> {
        self.binaries.add(other)
    }

    /// Files next to the program that don't go into FMUs, and why.
    pub fn left_out(&self) -> &[String] {
        &self.left_out
    }

    /// Its file for each platform.
    pub fn binaries(&self) -> &[Binary] {
        self.binaries.all()
    }

    /// The binaries of every FMU.
    pub(super) fn packed(&self) -> &Binaries {
        &self.binaries
    }

    /// Its description of itself, and of the FMU of a description.
    ///
    /// # Errors
    /// What it refuses, with the description's file; or when it isn't a library of this kind and version.
    pub fn describe(&self, description: Option<&Source>) -> Result<Described, Error> {
        let refuse = |reason: String| match description {
            Some(source) => refused(source, &reason),
            None => Error::Library(reason),
        };
        let reply = self.ask(&DESCRIBE, description)?;
        let described = describe::read(&reply).map_err(|reason| self.unknown(&reason))?.map_err(refuse)?;
        // The program answered for its own models; FMUs contain the build of their library.
        let build = if self.is_own() { self.binaries.all()[0].build.clone() } else { described.build };
        Ok(Described { build, ..described })
    }

    /// The unit of a description as C source.
    ///
    /// # Errors
    /// As [`Library::describe`], and for a kind that can't be recorded.
    pub fn source(&self, description: &Source) -> Result<SourceUnit, Error> {
        let refuse = |reason: String| refused(description, &reason);
        let reply = self.ask(&SOURCE, Some(description))?;
        describe::read_source(&reply).map_err(|reason| self.unknown(&reason))?.map_err(refuse)
    }

    /// The controller of a description as C for a target.
    ///
    /// # Errors
    /// As [`Library::source`], and for options that don't fit; for a library of an older version, which knows no firmware.
    pub fn firmware(&self, description: &Source, options: &Options) -> Result<Firmware, Error> {
        let refuse = |reason: String| refused(description, &reason);
        let request = FirmwareRequest { description: description.text.clone(), options: options.clone() };
        let text = serde_json::to_string(&request).map_err(|error| Error::Library(error.to_string()))?;
        let reply = self.ask(&FIRMWARE, Some(&Source { text, ..description.clone() }))?;
        describe::read_firmware(&reply).map_err(|reason| self.unknown(&reason))?.map_err(refuse)
    }

    /// A reference experiment of the FMU of a description, by an integration of its own; the reason where there is none.
    ///
    /// # Errors
    /// For a library of an older version, which makes none.
    pub fn reference(&self, description: &Source) -> Result<Result<ReferenceExperiment, String>, Error> {
        let reply = self.ask(&REFERENCE, Some(description))?;
        describe::read_reference(&reply).map_err(|reason| self.unknown(&reason))
    }

    /// True if its models are those of this program.
    pub fn is_own(&self) -> bool {
        self.binaries.all()[0].build.source == binaries::own_models().source
    }

    fn unknown(&self, reason: &str) -> Error {
        let advice = "it was built with another version of adaptive-fmu. Build it again";
        Error::Library(format!("{}: its reply can't be read ({reason}). {advice}", self.path.display()))
    }

    /// The library's reply to a question about a description.
    fn ask(&self, question: &Question, description: Option<&Source>) -> Result<String, Error> {
        let asked = (question.name, description.map(|source| source.text.clone()));
        let locked = || self.replies.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reply) = locked().get(&asked) {
            return Ok(reply.clone());
        }
        let entry = description.and_then(|source| self.entry(question, source));
        let kept_reply = entry.as_ref().and_then(Entry::read).and_then(|bytes| String::from_utf8(bytes).ok());
        let reply = match kept_reply {
            Some(reply) => reply,
            None => {
                let reply = self.ask_anew(question, description)?;
                entry.filter(|_| is_answer(&reply)).into_iter().for_each(|entry| entry.write(reply.as_bytes()));
                reply
            }
        };
        let mut replies = locked();
        if replies.len() >= MOST_REPLIES {
            replies.clear();
        }
        replies.insert(asked, reply.clone());
        Ok(reply)
    }

    /// Cache entry of a reply that takes long and follows from the library and the text: a design report takes up to half
    /// a second, and a reference experiment up to a second.
    fn entry(&self, question: &Question, description: &Source) -> Option<Entry> {
        Entry::of(question.cached?, &[self.checksum.as_ref()?, description.text.as_bytes()])
    }

    fn ask_anew(&self, question: &Question, description: Option<&Source>) -> Result<String, Error> {
        if self.is_own() {
            let text = description.map(|source| source.text.as_str());
            return Ok(describe::answered(question.answer, text, binaries::own_models()));
        }
        let text = description.map(|source| CString::new(source.text.as_str())).transpose();
        let text = text.map_err(|_| {
            let file = description.map(|source| source.file.clone()).unwrap_or_default();
            Error::Description { file, reason: "contains a NUL character".to_owned() }
        })?;
        let missing = |_| {
            let advice =
                "It needs the line export_fmi2!; a library of this package must be of the program's own version";
            Error::Library(format!("{} exports no models. {advice}", self.path.display()))
        };
        let mut reply: Option<String> = None;
        // SAFETY: a library that exports these symbols was made by `export_fmi2`, so they have this type; the text and the
        // reply's place live longer than the call.
        unsafe {
            let function = self.loaded.get::<DescribeFunction>(question.name).map_err(missing)?;
            let text = text.as_ref().map_or(std::ptr::null(), |text| text.as_ptr());
            function(text, Some(keep), std::ptr::from_mut(&mut reply).cast());
        }
        reply.ok_or_else(|| Error::Library(format!("{} gave no reply", self.path.display())))
    }
}

/// True if a reply answers a question, and refuses nothing.
fn is_answer(reply: &str) -> bool {
    let described = || describe::read(reply).is_ok_and(|described| described.is_ok());
    described() || describe::read_reference(reply).is_ok_and(|experiment| experiment.is_ok())
}

/// The file of the library built together with this program, where there is one. It is looked for once, as long as it stays
/// there.
pub fn own_library() -> Option<PathBuf> {
    static FOUND: Mutex<Option<PathBuf>> = Mutex::new(None);
    let mut found = FOUND.lock().unwrap_or_else(PoisonError::into_inner);
    if found.as_ref().is_none_or(|file| !file.is_file()) {
        *found = find_own_library();
    }
    found.clone()
}

/// Cargo leaves it in `deps`, an archive or a wheel next to the program; else it is unpacked of the program. The copy that
/// cargo puts next to the program may be of an earlier build.
fn find_own_library() -> Option<PathBuf> {
    let folder = program_folder().ok()?;
    let own = Platform::own();
    let of_folders = library_folders(&folder).map(|libraries| libraries.join(own.folder));
    let mut places = std::iter::once(folder.join("deps")).chain(of_folders).map(|place| place.join(own.library_name()));
    places.find(|place| place.is_file()).or_else(embedded::file).or_else(|| {
        let copy = folder.join(own.library_name());
        copy.is_file().then_some(copy)
    })
}

/// Folders of libraries by platform next to a program in this folder: in an archive for users without Rust, and where a Python
/// wheel puts what belongs to a program.
pub(super) fn library_folders(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let shared = folder.parent().map(|above| above.join(SHARED).join(LIBRARIES));
    std::iter::once(folder.join(LIBRARIES)).chain(shared)
}

fn program_folder() -> Result<PathBuf, Error> {
    let program = std::env::current_exe().map_err(Error::file("this program"))?;
    Ok(program.parent().unwrap_or(Path::new(".")).to_owned())
}

/// An error with its causes: libloading's own text is only `dlopen failed`.
pub(crate) fn with_causes(error: &dyn std::error::Error) -> String {
    std::iter::successors(Some(error), |error| error.source()).map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// Receives the reply of the describing function.
unsafe extern "C" fn keep(context: *mut c_void, text: *const c_char) {
    // SAFETY: called only by the library, with the given place and a C string.
    unsafe {
        let text = CStr::from_ptr(text).to_string_lossy().into_owned();
        *context.cast::<Option<String>>() = Some(text);
    }
}
