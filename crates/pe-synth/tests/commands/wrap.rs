//! Wrappers: the register map in documents and VHDL.

use std::fs;
use std::path::{Path, PathBuf};

use pe_map::registers;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The part of a text between two lines, replaced.
fn with_part(text: &str, [begin, end]: [&str; 2], part: &str) -> String {
    let (before, rest) = text.split_once(begin).expect("a first line");
    let (_, after) = rest.split_once(end).expect("a last line");
    format!("{before}{begin}\n\n{part}\n{end}{after}")
}

#[test]
fn the_page_shows_the_register_map() {
    let path = root().join("docs/wrapper.md");
    let page = fs::read_to_string(&path).unwrap();
    let made = with_part(&page, ["<!-- registers -->", "<!-- end of registers -->"], &registers::tables());
    if std::env::var_os("UPDATE_REGISTERS").is_some() {
        fs::write(&path, &made).unwrap();
    } else {
        assert!(page == made, "UPDATE_REGISTERS=1 cargo test -p pe-synth --test commands wrap renews docs/wrapper.md");
    }
}
