//! Where the resources of an FMU lie.

use std::path::PathBuf;

/// Name of the description within the resources.
pub const DESCRIPTION: &str = "description.toml";

/// The folder that a master's `fmuResourceLocation` names; without one, found from the library's own path.
///
/// # Errors
/// What is wrong with the location.
pub fn folder(location: Option<&str>) -> Result<PathBuf, String> {
    match location.filter(|location| !location.is_empty()) {
        Some(location) => from_uri(location),
        None => beside_library().ok_or_else(|| {
            "fmuResourceLocation is NULL, and the library's own path is not known: give the location".to_owned()
        }),
    }
}

/// The path of a `file:` URI, in any of the forms that masters use, or of a plain path.
fn from_uri(location: &str) -> Result<PathBuf, String> {
    let Some(rest) = location.strip_prefix("file:") else {
        if location.contains("://") {
            return Err(format!("fmuResourceLocation `{location}`: only file URIs can be read"));
        }
        return Ok(PathBuf::from(location));
    };
    let path = match rest.strip_prefix("//") {
        // An authority, which is empty or this host; `file:////` has none and a path with two slashes.
        Some(rest) => rest.strip_prefix("localhost").unwrap_or(rest),
        None => rest,
    };
    let path = percent_decoded(path).ok_or_else(|| format!("fmuResourceLocation `{location}`: broken percent code"))?;
    let windows_drive = path.len() > 2 && path.starts_with('/') && path.as_bytes()[2] == b':';
    let path = if windows_drive { path[1..].to_owned() } else { path };
    let collapsed = if path.starts_with("//") { format!("/{}", path.trim_start_matches('/')) } else { path };
    Ok(PathBuf::from(collapsed))
}

fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        if byte == b'%' {
            let digits = [rest.next()?, rest.next()?];
            bytes.push(u8::from_str_radix(std::str::from_utf8(&digits).ok()?, 16).ok()?);
        } else {
            bytes.push(byte);
        }
    }
    String::from_utf8(bytes).ok()
}

/// `…/binaries/linux64/NAME.so` → `…/resources`.
fn beside_library() -> Option<PathBuf> {
    let library = own_path()?;
    Some(library.parent()?.parent()?.parent()?.join("resources"))
}

#[cfg(unix)]
fn own_path() -> Option<PathBuf> {
    use std::ffi::CStr;
    use std::os::unix::ffi::OsStrExt;
    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here: fn(Option<&str>) -> Result<PathBuf, String> = folder;
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
    /// By an address within the module, which keeps its count of references.
    const FROM_ADDRESS_UNCHANGED: u32 = 4 | 2;
    /// More than Windows' longest path.
    const LONGEST: usize = 1 << 15;
    unsafe extern "system" {
        fn GetModuleHandleExW(flags: u32, address: *const c_void, module: *mut *mut c_void) -> i32;
        fn GetModuleFileNameW(module: *mut c_void, name: *mut u16, size: u32) -> u32;
    }
    let here: fn(Option<&str>) -> Result<PathBuf, String> = folder;
    let mut module = std::ptr::null_mut();
    let mut name = vec![0_u16; LONGEST];
    // SAFETY: the first function only looks up the address, one of this library, and writes the module's handle; the
    // second writes at most as many characters as it is told, which the buffer has.
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
            ("file:///a%20b/%C3%BC", "/a b/ü"),
            ("file:///a b/resources", "/a b/resources"),
            ("file:///C:/a/b", "C:/a/b"),
            ("/plain/path", "/plain/path"),
        ] {
            assert_eq!(folder(Some(location)), Ok(PathBuf::from(path)), "{location}");
        }
        assert!(folder(Some("http://host/resources")).is_err());
        assert!(folder(Some("file:///a%2")).is_err());
    }
}
