//! Tables in the documentation that follow from the catalogue, the descriptions and counts. Each is in its page between
//! `<!-- generated: NAME -->` and `<!-- end -->`.

use std::path::PathBuf;
use std::sync::Mutex;

/// True if files that follow from others are to be written anew.
pub fn updating() -> bool {
    std::env::var_os("UPDATE_TABLES").is_some()
}

/// The lines of a table in a page.
pub fn generated(page: &str, name: &str) -> String {
    let text = read(page);
    let (begin, end) = place(page, &text, name);
    text[begin..end].to_owned()
}

/// Asserts that a page holds this table, or puts it there when files are written anew.
pub fn assert_generated(page: &str, name: &str, table: &str) {
    if updating() {
        write(page, name, table);
    }
    assert!(
        generated(page, name) == table,
        "the table `{name}` of {page} is not current. Run the tests once with UPDATE_TABLES=1; it should be:\n{table}"
    );
}

/// Puts a table into a page.
pub fn write(page: &str, name: &str, table: &str) {
    // Tests run side by side, and a page may hold several tables.
    static WRITING: Mutex<()> = Mutex::new(());
    let _alone = WRITING.lock().unwrap();
    let mut text = read(page);
    let (begin, end) = place(page, &text, name);
    text.replace_range(begin..end, table);
    std::fs::write(file(page), text).unwrap();
}

fn file(page: &str) -> PathBuf {
    crate::at_top(page)
}

fn read(page: &str) -> String {
    std::fs::read_to_string(file(page)).unwrap()
}

/// Range from after the mark's line to before the next mark.
fn place(page: &str, text: &str, name: &str) -> (usize, usize) {
    let mark = format!("<!-- generated: {name} -->\n");
    let begin = text.find(&mark).unwrap_or_else(|| panic!("{page} has no line {mark}")) + mark.len();
    let end = text[begin..].find("<!-- end -->").unwrap_or_else(|| panic!("{page}: `{name}` has no end"));
    (begin, begin + end)
}
