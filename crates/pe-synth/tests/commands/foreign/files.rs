//! `wrap --vhdl` as a command: what it writes, what it leaves alone, and how it ends.

use std::fs;
use std::process::Command;

use serde_json::Value;

use crate::support::bench::Folder;

const ADDER: &str = "\
library ieee; use ieee.std_logic_1164.all; use ieee.numeric_std.all;
entity adder is
  port (clk, ce : in std_logic; a : in signed(7 downto 0); y : out signed(7 downto 0));
end entity;
architecture rtl of adder is
begin
  process (clk) begin
    if rising_edge(clk) and ce = '1' then y <= y + a; end if;
  end process;
end architecture;
";

fn run(arguments: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code().unwrap(), text)
}

#[test]
fn an_entity_is_wrapped_in_two_calls() {
    let folder = Folder::new("foreign_command");
    let (file, target) = (folder.0.join("my adder.vhd"), folder.0.join("out"));
    fs::write(&file, ADDER).unwrap();
    let (file, out) = (file.to_str().unwrap(), target.to_str().unwrap());
    let first = ["wrap", "--vhdl", file, "--entity", "Adder", "-o", out];
    let (code, text) = run(&first);
    assert!(code == 0 && text.contains("edit the map, and give it with --map"), "{code} {text}");
    let map = target.join("adder_entity.json");
    let content: Value = serde_json::from_str(&fs::read_to_string(&map).unwrap()).unwrap();
    let roles: Vec<&str> =
        content["ports"].as_array().unwrap().iter().map(|port| port["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["clock", "clock_enable", "data", "data"]);
    // What a user may have edited stays.
    let (code, text) = run(&first);
    assert!(code == 3 && text.contains("give it with --map, or remove it"), "{code} {text}");
    let second = [&first[..], &["--map", map.to_str().unwrap()]].concat();
    let (code, text) = run(&second);
    assert!(code == 0 && text.contains("warning[W1004]"), "{code} {text}");
    let list = fs::read_to_string(target.join("adder_axi.f")).unwrap();
    assert!(list.contains("work vhdl/my_adder.vhd\nwork adder_step.vhd\nwork adder_axi.vhd\n"), "{list}");
    let files = |at: &std::path::Path| {
        let names = [
            "adder_axi.vhd",
            "adder_step.vhd",
            "adder_wrap.json",
            "adder_map.json",
            "adder_entity.json",
            "wrapped.json",
        ];
        names.map(|name| fs::read(at.join(name)).unwrap())
    };
    let before = files(&target);
    assert_eq!(run(&second).0, 0);
    assert!(files(&target) == before, "the same call writes the same files");
    // Another content is another design.
    let hash = |at: &std::path::Path| {
        serde_json::from_slice::<Value>(&fs::read(at.join("adder_map.json")).unwrap()).unwrap()["hash"].clone()
    };
    let old = hash(&target);
    fs::write(file, ADDER.replace("y + a", "y - a")).unwrap();
    assert_eq!(run(&second).0, 0);
    assert!(hash(&target) != old);
}

#[test]
fn what_cannot_be_wrapped_leaves_nothing_behind() {
    let folder = Folder::new("foreign_refused");
    let (file, target) = (folder.0.join("a.vhd"), folder.0.join("out"));
    let (path, out) = (file.to_str().unwrap(), target.to_str().unwrap());
    fs::write(&file, ADDER.replace("a : in signed(7 downto 0)", "a : in real")).unwrap();
    let (code, text) = run(&["wrap", "--vhdl", path, "--entity", "adder", "-o", out]);
    assert!(
        code == 1 && text.contains("error[E1008]") && text.contains("a.vhd:3:40") && text.contains('^'),
        "{code} {text}"
    );
    assert!(!target.exists());
    let json = ["wrap", "--vhdl", path, "--entity", "adder", "-o", out, "--message-format", "json"];
    let (_, text) = run(&json);
    let finding: Value = serde_json::from_str(text.lines().next().unwrap()).unwrap();
    assert_eq!((&finding["code"], &finding["place"]["line"]), (&"E1008".into(), &3.into()));
    for arguments in [
        &["wrap"][..],
        &["wrap", "--vhdl", path, "-o", out],
        &["wrap", "--vhdl", path, "--entity", "adder"],
        &["wrap", out, "--map", path],
    ] {
        assert_eq!(run(arguments).0, 2, "{arguments:?}");
    }
    assert_eq!(run(&["wrap", "--vhdl", "nowhere.vhd", "--entity", "adder", "-o", out]).0, 3);
}
