//! Arguments that fmi2Instantiate accepts and refuses. A refusal is NULL with a message, never a crash.

use std::cell::RefCell;
use std::path::Path;
use std::ptr::null;

use adaptive_fmu::fmi2::types::*;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu_library::fmi2_functions::*;
use common::*;

const NAME: &str = "ReferenceNonlinearSiso";

fn right_guid() -> String {
    guid(&Model::from_description(Description::read(&description(NAME)).unwrap(), REGISTRY).unwrap())
}

/// Resources with this description in a folder of this name.
fn resources(folder_name: &str, content: &[u8]) -> (tempfile::TempDir, String) {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join(folder_name);
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("description.toml"), content).unwrap();
    let path = folder.to_str().unwrap().to_owned();
    (parent, path)
}

/// A request that is right in everything, with resources at this path.
fn request(path: &str) -> Request {
    Request {
        registry: REGISTRY,
        name: Some("unit".to_owned()),
        kind: CO_SIMULATION,
        guid: Some(right_guid()),
        location: Some(format!("file://{path}")),
    }
}

/// Instantiates, runs a step and frees; else the message.
fn try_with(change: impl FnOnce(&mut Request)) -> Result<(), String> {
    let (_folder, path) = resources("resources", description(NAME).as_bytes());
    let mut request = request(&path);
    change(&mut request);
    let log = RefCell::new(Vec::new());
    let component = request.make(&callbacks(&log));
    if component.is_null() {
        let (status, category, message) = log.take().pop().expect("a refusal says why");
        assert_eq!((status, category.as_str()), (ERROR as i32, "logStatusError"));
        assert!(is_plain_format(&message) && !message.contains('\n'), "{message}");
        return Err(message);
    }
    assert_eq!(unsafe { fmi2SetupExperiment(component, FALSE, 0.0, 0.0, FALSE, 0.0) }, OK);
    assert_eq!(unsafe { fmi2EnterInitializationMode(component) }, OK);
    assert_eq!(unsafe { fmi2ExitInitializationMode(component) }, OK);
    assert_eq!(unsafe { fmi2DoStep(component, 0.0, 0.1, TRUE) }, OK);
    unsafe { fmi2FreeInstance(component) };
    Ok(())
}

fn refused(change: impl FnOnce(&mut Request)) -> String {
    try_with(change).expect_err("this should be refused")
}

fn assert_names(message: &str, named: &[&str]) {
    named.iter().for_each(|name| assert!(message.contains(name), "`{message}` names {name}"));
}

#[test]
fn a_wrong_guid_is_refused_with_both_guids() {
    let wrong = "{00000000-0000-0000-0000-000000000000}";
    assert_names(&refused(|request| request.guid = Some(wrong.into())), &[wrong, &right_guid()]);
    refused(|request| request.guid = Some("".into()));
    assert_names(&refused(|request| request.guid = None), &["fmuGUID", "NULL"]);
}

#[test]
fn the_guid_of_a_changed_description_is_another() {
    let changed = description(NAME).replace("[2.0]", "[2.5]");
    assert_ne!(changed, description(NAME));
    let (_folder, path) = resources("resources", changed.as_bytes());
    let message = refused(|request| request.location = Some(path.clone()));
    assert_names(&message, &["fmi2Instantiate", &right_guid()]);
}

#[test]
fn an_interface_that_the_standard_does_not_know_is_refused_with_those_that_it_knows() {
    for kind in [2, -1, i32::MAX] {
        let names = [&format!("fmuType = {kind}")[..], "fmi2ModelExchange", "fmi2CoSimulation"];
        assert_names(&refused(|request| request.kind = kind), &names);
    }
}

#[test]
fn an_instance_name_may_hold_slashes_spaces_and_signs_but_not_be_empty() {
    for name in ["a/b/c", "left wheel", "x%s%n", "Ω.[1]", &"long".repeat(1000)] {
        assert_eq!(try_with(|request| request.name = Some(name.into())), Ok(()), "{name}");
    }
    assert_names(&refused(|request| request.name = Some("".into())), &["instanceName"]);
    assert_names(&refused(|request| request.name = None), &["instanceName"]);
}

#[test]
fn missing_resources_are_named() {
    for location in ["file:///nowhere/at/all", "/nowhere/at/all"] {
        assert_names(
            &refused(|request| request.location = Some(location.into())),
            &["/nowhere/at/all/description.toml"],
        );
    }
    assert_names(
        &refused(|request| request.location = Some("http://host/resources".into())),
        &["http://host/resources"],
    );
    refused(|request| request.location = Some("file:///broken%2".into()));
}

#[test]
fn a_null_resource_location_is_an_error_where_no_resources_are_next_to_the_library() {
    // The test's own executable is no unpacked FMU.
    assert_names(&refused(|request| request.location = None), &["fmi2Instantiate"]);
    assert_names(&refused(|request| request.location = Some("".into())), &["fmi2Instantiate"]);
}

#[test]
fn a_garbled_description_is_refused_with_its_file() {
    let whole = description(NAME);
    let half = &whole[..whole.len() / 2];
    let contents: [&[u8]; 5] = [b"", b"name = ", &[0xff, 0xfe, 0, 1], b"\0\0\0\0", half.as_bytes()];
    for content in contents {
        let (_folder, path) = resources("resources", content);
        assert_names(&refused(|request| request.location = Some(path.clone())), &["description.toml"]);
    }
}

#[test]
fn resources_in_a_folder_with_spaces_and_signs_are_found() {
    let (_folder, path) = resources("my resources 100%", description(NAME).as_bytes());
    let encoded = path.replace('%', "%25").replace(' ', "%20");
    for location in [format!("file://{encoded}"), format!("file:///{encoded}"), format!("file:{encoded}")] {
        assert_eq!(try_with(|request| request.location = Some(location.clone())), Ok(()), "{location}");
    }
    assert_eq!(try_with(|request| request.location = Some(path.clone())), Ok(()), "a plain path");
}

#[test]
fn a_percent_sign_in_a_path_is_none_of_a_format() {
    let message = refused(|request| request.location = Some("/nowhere/100%s%n/resources".into()));
    assert!(Path::new("/nowhere").exists() || message.contains("/nowhere/100%%s%%n/resources"), "{message}");
}

#[test]
fn a_scheme_and_a_host_may_be_written_in_capitals() {
    let (_folder, path) = resources("resources", description(NAME).as_bytes());
    for start in ["FILE://", "file://LOCALHOST", "File://LocalHost"] {
        assert_eq!(try_with(|request| request.location = Some(format!("{start}{path}"))), Ok(()), "{start}");
    }
}

#[test]
fn a_broken_percent_code_is_named() {
    let message = refused(|request| request.location = Some("file:///a/100%zz/b".into()));
    assert_names(&message, &["`%%zz`", "file:///a/100%%zz/b"]);
}

/// Paths and names are bytes: on Unix they need not be UTF-8.
#[cfg(unix)]
#[test]
fn a_path_and_a_name_that_are_no_text_are_taken() {
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join(std::ffi::OsString::from_vec(b"caf\xe9".to_vec()));
    std::fs::create_dir(&folder).unwrap();
    std::fs::write(folder.join("description.toml"), description(NAME)).unwrap();
    let c_string = |bytes: &[u8]| std::ffi::CString::new(bytes).unwrap();
    let parent = parent.path().as_os_str().as_bytes();
    let encoded = [b"file://", parent, b"/caf%E9"].concat();
    let (guid, name, category) = (c_string(right_guid().as_bytes()), c_string(b"unit \xe9"), c"log \xe9");
    let log = RefCell::new(Vec::new());
    for location in [c_string(&encoded), c_string(&[b"file://", folder.as_os_str().as_bytes()].concat())] {
        let (guid, name, location) = (guid.as_ptr(), name.as_ptr(), location.as_ptr());
        let component = unsafe { fmi2Instantiate(name, CO_SIMULATION, guid, location, &callbacks(&log), FALSE, FALSE) };
        assert!(!component.is_null(), "{:?}", log.take());
        assert_eq!(unsafe { fmi2SetDebugLogging(component, TRUE, 1, &category.as_ptr()) }, ERROR);
        let (_, _, message) = log.take().pop().expect("a message");
        assert!(message.contains("fmi2SetDebugLogging: there is no category `log \u{fffd}`"), "{message}");
        unsafe { fmi2FreeInstance(component) };
    }
}

#[test]
fn null_callbacks_give_no_instance_and_a_null_logger_gives_a_silent_one() {
    let (_folder, path) = resources("resources", description(NAME).as_bytes());
    let request = request(&path);
    assert!(request.make(null()).is_null());
    let log = RefCell::new(Vec::new());
    let silent = CallbackFunctions { logger: None, ..callbacks(&log) };
    let component = request.make(&silent);
    assert!(!component.is_null());
    assert_eq!(unsafe { fmi2DoStep(component, 0.0, 1.0, TRUE) }, ERROR, "an error needs no logger");
    unsafe { fmi2FreeInstance(component) };
    assert!(log.take().is_empty());
}
