//! Files of wrappers: the register map in documents and VHDL, and the command that writes them.

use std::fs;
use std::process::Command;

use pe_map::registers;

use super::wrap::{pe_synth, root, wrapped};
use crate::support::bench::Folder;

/// The part of a text between two lines, replaced.
fn with_part(text: &str, [begin, end]: [&str; 2], part: &str) -> String {
    let (before, rest) = text.split_once(begin).expect("a first line");
    let (_, after) = rest.split_once(end).expect("a last line");
    format!("{before}{begin}\n{part}\n{end}{after}")
}

#[test]
fn the_vhdl_has_the_register_map() {
    let path = root().join("hdl/pe_register_pkg.vhd");
    let package = fs::read_to_string(&path).unwrap();
    let made = with_part(&package, ["  -- Registers\n", "  -- End of registers\n"], &pe_wrap::constants());
    if std::env::var_os("UPDATE_REGISTERS").is_some() {
        fs::write(&path, &made).unwrap();
    } else {
        assert!(package == made, "UPDATE_REGISTERS=1 cargo test -p pe-synth --test commands wrap renews it");
    }
}

#[test]
fn the_page_shows_the_register_map() {
    let path = root().join("docs/wrapper.md");
    let page = fs::read_to_string(&path).unwrap();
    let made = with_part(&page, ["<!-- registers -->\n", "<!-- end of registers -->"], &registers::tables());
    if std::env::var_os("UPDATE_REGISTERS").is_some() {
        fs::write(&path, &made).unwrap();
    } else {
        assert!(page == made, "UPDATE_REGISTERS=1 cargo test -p pe-synth --test commands wrap renews docs/wrapper.md");
    }
}

#[test]
fn the_page_shows_the_fault_table() {
    let path = root().join("docs/host.md");
    let page = fs::read_to_string(&path).unwrap();
    let made = with_part(&page, ["<!-- faults -->\n", "<!-- end of faults -->"], &pe_host::faults::table());
    if std::env::var_os("UPDATE_REGISTERS").is_some() {
        fs::write(&path, &made).unwrap();
    } else {
        assert!(page == made, "UPDATE_REGISTERS=1 cargo test -p pe-synth --test commands wrap renews docs/host.md");
    }
}

/// Runs a command that must fail; its exit code and what it says.
fn refused(arguments: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap();
    (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[test]
fn a_design_is_wrapped_as_a_whole_or_not_at_all() {
    let folder = Folder::new("wrap_command");
    let design = wrapped(&folder.0, "lotka_volterra/lotka_volterra", "--pes 1", &[]);
    let (path, read) = (design.to_str().unwrap(), |name: &str| fs::read(design.join(name)).unwrap());
    pe_synth(&["verify", path, "--engines", "reference", "--steps", "2"]);
    // Again, and elsewhere: the same files.
    let files = ["lotka_volterra_axi.vhd", "lotka_volterra_wrap.json", "lotka_volterra_axi.f", "report.json"];
    let before: Vec<Vec<u8>> = files.iter().map(|file| read(file)).collect();
    let elsewhere = folder.0.join("elsewhere");
    pe_synth(&["wrap", path, "--quiet"]);
    pe_synth(&["wrap", path, "--quiet", "-o", elsewhere.to_str().unwrap()]);
    for (file, before) in files.iter().zip(&before) {
        assert!(read(file) == *before && fs::read(elsewhere.join(file)).unwrap() == *before, "{file}");
    }
    // A folder that is not ours, one without a design, a program that the map is not of.
    let (other, empty) = (folder.sub("other"), folder.sub("empty"));
    fs::write(other.join("notes.txt"), "mine").unwrap();
    let (code, text) = refused(&["wrap", path, "-o", other.to_str().unwrap()]);
    assert!(code == 3 && text.contains("was not written by pe-synth"), "{code} {text}");
    let (code, text) = refused(&["wrap", empty.to_str().unwrap()]);
    assert!(code == 3 && text.contains("run `pe-synth compile` first"), "{code} {text}");
    let program = design.join("lotka_volterra_program.txt");
    let text = fs::read_to_string(&program).unwrap();
    fs::write(&program, text.replacen("model lotka_volterra", "model lotka_volterra2", 1)).unwrap();
    let (code, text) = refused(&["wrap", path]);
    assert!(code == 3 && text.contains("its hash is not that of the program beside it"), "{code} {text}");
}
