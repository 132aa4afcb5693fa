//! Location of an FMU's resources.

use std::path::PathBuf;

use crate::text_file;

/// Name of the description within the resources.
pub const DESCRIPTION: &str = "description.toml";

/// Prefix of a location that contains the description itself, for hosts without files such as a browser.
pub const DATA_PREFIX: &str = "data:,";

/// The description of the unit whose resources a master's `fmuResourceLocation` names, and its file, for messages.
///
/// # Errors
/// What is wrong with the location, or that the file can't be read.
pub fn description(location: Option<&[u8]>) -> Result<(PathBuf, String), String> {
    if cfg!(target_family = "wasm")
        && let Some(encoded) = location.and_then(|location| location.strip_prefix(DATA_PREFIX.as_bytes()))
    {
        let text = String::from_utf8(percent_decoded(encoded)?).map_err(|error| format!("{DESCRIPTION}: {error}"))?;
        return Ok((PathBuf::from(DESCRIPTION), text));
    }
    let file = folder(location)?.join(DESCRIPTION);
    let text = text_file::read(&file).map_err(|error| format!("{}: {error}", file.display()))?;
    Ok((file, text))
}

/// The folder that a master's `fmuResourceLocation` names; without one, found from the library's own path.
///
/// # Errors
/// What is wrong with the location.
pub fn folder(location: Option<&[u8]>) -> Result<PathBuf, String> {
    match location.filter(|location| !location.is_empty()) {
        Some(location) => from_uri(location)
            .map_err(|reason| format!("fmuResourceLocation `{}`: {reason}", String::from_utf8_lossy(location))),
        None => next_to_library().ok_or_else(|| {
            "fmuResourceLocation is NULL, and the library's own path is not known: give the location".to_owned()
        }),
    }
}

/// The path of a `file:` URI, in any of the forms that masters use, or of a plain path. Bytes, since neither needs to
/// be text.
fn from_uri(location: &[u8]) -> Result<PathBuf, String> {
    let Some(rest) = without_prefix(location, b"file:") else {
        if location.windows(3).any(|bytes| bytes == b"://") {
            return Err("only file URIs can be read".to_owned());
        }
        return path(location.to_vec());
    };
    let rest = match rest.strip_prefix(b"//") {
        // An authority, which is empty or this host; `file:////` has none and a path with two slashes.
        Some(rest) => without_prefix(rest, b"localhost").filter(|path| path.starts_with(b"/")).unwrap_or(rest),
        None => rest,
    };
    let mut decoded = percent_decoded(rest)?;
    let windows_drive = decoded.len() > 2 && decoded[0] == b'/' && decoded[2] == b':';
    let slashes = decoded.iter().take_while(|&&byte| byte == b'/').count();
    decoded.drain(..if windows_drive { 1 } else { slashes.saturating_sub(1) });
    path(decoded)
}

/// The rest after a prefix, whose letters may be large or small.
fn without_prefix<'a>(bytes: &'a [u8], prefix: &[u8]) -> Option<&'a [u8]> {
    let (start, rest) = bytes.split_at_checked(prefix.len())?;
    start.eq_ignore_ascii_case(prefix).then_some(rest)
}

fn percent_decoded(bytes: &[u8]) -> Result<Vec<u8>, String> {
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while let Some((&byte, after)) = rest.split_first() {
        (decoded, rest) = if byte == b'%' {
            let digits = after.first_chunk::<2>().and_then(|digits| std::str::from_utf8(digits).ok());
            // `from_str_radix` takes a sign, too.
            let digits = digits.filter(|digits| digits.chars().all(|digit| digit.is_ascii_hexdigit()));
            let code = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok()).ok_or_else(|| {
                let shown = String::from_utf8_lossy(&rest[..rest.len().min(3)]).into_owned();
                format!("`{shown}` is no percent code; a percent sign itself is written %25")
            })?;
            decoded.push(code);
            (decoded, &after[2..])
        } else {
            decoded.push(byte);
            (decoded, after)
        };
    }
    Ok(decoded)
}

#[cfg(unix)]
fn path(bytes: Vec<u8>) -> Result<PathBuf, String> {
    use std::os::unix::ffi::OsStringExt;
    Ok(PathBuf::from(std::ffi::OsString::from_vec(bytes)))
}

/// Paths are text here.
#[cfg(not(unix))]
fn path(bytes: Vec<u8>) -> Result<PathBuf, String> {
    let text = String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        format!("byte {} of the path, {:#04x}, is not UTF-8", place + 1, error.as_bytes()[place])
    })?;
    Ok(PathBuf::from(text))
}

/// `…/binaries/linux64/NAME.so` → `…/resources`.
fn next_to_library() -> Option<PathBuf> {
    let library = own_path()?;
    Some(library.parent()?.parent()?.parent()?.join("resources"))
}

/// Path of this library, from the list of loaded objects. Every glibc has that list; in old ones dladdr is in a
/// separate library.
#[cfg(target_os = "linux")]
fn own_path() -> Option<PathBuf> {
    use std::ffi::{CStr, c_int, c_void};
    use std::os::unix::ffi::OsStringExt;
    struct Search {
        address: usize,
        found: Option<Vec<u8>>,
    }
    unsafe extern "C" fn look(object: *mut libc::dl_phdr_info, _: usize, search: *mut c_void) -> c_int {
        // SAFETY: only dl_iterate_phdr calls it, with a loaded object and the place that it was given; the object's
        // segments and name are as it describes them, and stay as long as it is loaded.
        unsafe {
            let (object, search) = (&*object, &mut *search.cast::<Search>());
            if object.dlpi_phdr.is_null() || object.dlpi_name.is_null() {
                return 0;
            }
            let segments = std::slice::from_raw_parts(object.dlpi_phdr, object.dlpi_phnum.into());
            let within = segments.iter().filter(|segment| segment.p_type == libc::PT_LOAD).any(|segment| {
                let start = (object.dlpi_addr as usize).wrapping_add(segment.p_vaddr as usize);
                search.address.wrapping_sub(start) < segment.p_memsz as usize
            });
            search.found = within.then(|| CStr::from_ptr(object.dlpi_name).to_bytes().to_owned());
            within.into()
        }
    }
    let here: fn(Option<&[u8]>) -> Result<PathBuf, String> = folder;
    let mut search = Search { address: here as usize, found: None };
    // SAFETY: the function is called with the place of the search, which outlives the call, and keeps nothing of it.
    unsafe { libc::dl_iterate_phdr(Some(look), std::ptr::from_mut(&mut search).cast()) };
    let name = search.found?;
    // A program has no name there.
    let own = if name.is_empty() { std::env::current_exe().ok()? } else { std::ffi::OsString::from_vec(name).into() };
    std::fs::canonicalize(own).ok()
}

#[cfg(all(unix, not(target_os = "linux")))]
fn own_path() -> Option<PathBuf> {
    use std::ffi::CStr;
    use std::os::unix::ffi::OsStrExt;
    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here: fn(Option<&[u8]>) -> Result<PathBuf, String> = folder;
    // SAFETY: dladdr only reads the address, a function of this library, and writes the structure, all zero before;
    // the name that it gives, if any, is a C string that lives as long as the library is loaded.
    let name = unsafe {
        if libc::dladdr(here as *const libc::c_void, info.as_mut_ptr()) == 0 {
            return None;
        }
        let info = info.assume_init();
        if info.dli_fname.is_null() {
            return None;
        }
        CStr::from_ptr(info.dli_fname)
    };
    std::fs::canonicalize(std::ffi::OsStr::from_bytes(name.to_bytes())).ok()
}

#[cfg(windows)]
fn own_path() -> Option<PathBuf> {
    use std::ffi::{OsString, c_void};
    use std::os::windows::ffi::OsStringExt;
    /// Flags for a look-up by an address within the module, without a change of its reference count.
    const FROM_ADDRESS_UNCHANGED: u32 = 4 | 2;
    /// More than Windows' longest path.
    const LONGEST: usize = 1 << 15;
    unsafe extern "system" {
        fn GetModuleHandleExW(flags: u32, address: *const c_void, module: *mut *mut c_void) -> i32;
        fn GetModuleFileNameW(module: *mut c_void, name: *mut u16, size: u32) -> u32;
    }
    let here: fn(Option<&[u8]>) -> Result<PathBuf, String> = folder;
    let mut module = std::ptr::null_mut();
    let mut name = vec![0_u16; LONGEST];
    // SAFETY: the first function only looks up the address, one of this library, and writes the module's handle; the
    // second writes at most as many characters as its argument allows, which the buffer has.
    let length = unsafe {
        if GetModuleHandleExW(FROM_ADDRESS_UNCHANGED, here as *const c_void, &raw mut module) == 0 {
            return None;
        }
        GetModuleFileNameW(module, name.as_mut_ptr(), LONGEST as u32) as usize
    };
    (1..LONGEST).contains(&length).then(|| PathBuf::from(OsString::from_wide(&name[..length])))
}

#[cfg(not(any(unix, windows)))]
fn own_path() -> Option<PathBuf> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_of_a_resource_location_that_masters_use_is_read() {
        for (location, path) in [
            ("file:///a/b/resources", "/a/b/resources"),
            ("file:////a/b/resources", "/a/b/resources"),
            ("file:/a/b/resources", "/a/b/resources"),
            ("file://localhost/a/b", "/a/b"),
            ("FILE:///a/b", "/a/b"),
            ("File://LOCALHOST/a/b", "/a/b"),
            ("file:///localhost/b", "/localhost/b"),
            ("file:///a%20b/%C3%BC", "/a b/ü"),
            ("file:///a b/resources", "/a b/resources"),
            ("file:///C:/a/b", "C:/a/b"),
            ("/plain/path", "/plain/path"),
        ] {
            assert_eq!(folder(Some(location.as_bytes())), Ok(PathBuf::from(path)), "{location}");
        }
        assert!(folder(Some(b"http://host/resources")).is_err());
        for (broken, code) in [("file:///a%2", "`%2`"), ("file:///a%+1b", "`%+1`"), ("file:///100%/b", "`%/b`")] {
            let reason = folder(Some(broken.as_bytes())).expect_err(broken);
            assert!(reason.contains(code) && reason.contains(broken), "{reason}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_path_need_not_be_text() {
        use std::os::unix::ffi::OsStrExt;
        let path = PathBuf::from(std::ffi::OsStr::from_bytes(b"/a\xff/b"));
        for location in [&b"file:///a%FF/b"[..], b"file:///a\xff/b", b"/a\xff/b"] {
            assert_eq!(folder(Some(location)), Ok(path.clone()));
        }
    }
}
