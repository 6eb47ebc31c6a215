//! Foreign entities: what is understood, what is refused and where, and names that tools stumble over.

use pe_ir::source::{Diagnostic, Sources};
use pe_wrap::Origin;
use pe_wrap::foreign::{EntityMap, Given, Role, Wrapping, read};
use serde_json::{Value, json};

fn given(text: &str) -> Vec<Given> {
    vec![Given { name: "e.vhd".into(), content: text.into() }]
}

/// An entity `e` with these generics and ports.
fn entity(generics: &str, ports: &str) -> String {
    let generics = if generics.is_empty() { String::new() } else { format!("generic ({generics});\n") };
    format!(
        "library ieee;\nuse ieee.std_logic_1164.all;\nuse ieee.numeric_std.all;\nentity e is\n{generics}port (\n{ports}\n);\n\
         end entity;\narchitecture a of e is\nbegin\nend architecture;\n"
    )
}

const CLOCKED: &str = "clk : in std_logic;\nce : in std_logic;\n";

/// Findings as `code line text-at-the-place`.
fn told(findings: &[Diagnostic], sources: &Sources) -> Vec<String> {
    let one = |finding: &Diagnostic| {
        assert!(finding.help.is_some() || finding.code == "E1001", "{finding} has no help");
        let span = finding.span.expect("a place");
        let text = sources.text()[span.range()].lines().next().unwrap_or_default();
        format!("{} {}:{} {text}", finding.code, sources.position(span.start).file, sources.position(span.start).line)
    };
    findings.iter().map(one).collect()
}

fn refused(text: &str) -> Vec<String> {
    let (findings, sources) = read(&given(text), "e").err().unwrap_or_else(|| panic!("it is accepted: {text}"));
    told(&findings, &sources)
}

/// The wrapper with an edited map, or findings.
fn wrapped(text: &str, edit: impl FnOnce(&mut Value)) -> Result<Wrapping, Vec<String>> {
    let files = given(text);
    let mut reading = read(&files, "e").map_err(|(findings, sources)| told(&findings, &sources))?;
    let (map, _) = reading.first_map("pe-synth 0.0.0");
    let mut content: Value = serde_json::from_str(&map.text()).unwrap();
    edit(&mut content);
    let origin = Origin { generator: "pe-synth 0.0.0".into(), command: "pe-synth wrap".into() };
    let text = serde_json::to_string_pretty(&content).unwrap();
    let wrapping = reading.wrap(&files, ("e.json", &text), true, &origin);
    wrapping.map_err(|findings| told(&findings, &reading.sources))
}

fn first(text: &str) -> EntityMap {
    let reading = read(&given(text), "e").unwrap_or_else(|(findings, _)| panic!("{findings:?}"));
    reading.first_map("pe-synth 0.0.0").0
}

#[test]
fn what_cannot_be_wrapped_is_refused_with_its_line_all_in_one_run() {
    let ports = format!(
        "{CLOCKED}a : inout std_logic;\nb : buffer std_logic;\nc : in real;\nd, f : in integer range 0 to 7;\ng : in signed;\n\
         h : in std_logic_vector;\ni : in my.record_t;\nj : out std_logic_vector(3 downto 0, 1 downto 0);\nk : out bit;\n\
         l : out resolved std_ulogic"
    );
    let found = refused(&entity("type t;\nN : string", &ports));
    let expected = [
        "E1011 e.vhd:5 t",
        "E1011 e.vhd:6 N",
        "E1007 e.vhd:10 inout",
        "E1007 e.vhd:11 buffer",
        "E1008 e.vhd:12 real",
        "E1008 e.vhd:13 integer range 0 to 7",
        "E1008 e.vhd:13 integer range 0 to 7",
        "E1009 e.vhd:14 signed",
        "E1009 e.vhd:15 std_logic_vector",
        "E1008 e.vhd:16 my.record_t",
        "E1009 e.vhd:17 std_logic_vector(3 downto 0, 1 downto 0)",
        "E1008 e.vhd:18 bit",
        "E1008 e.vhd:19 resolved std_ulogic",
    ];
    for line in expected {
        assert!(found.iter().any(|found| found == line), "{line} is not among {found:#?}");
    }
    assert_eq!(found.len(), expected.len(), "{found:#?}");
}

#[test]
fn an_entity_needs_a_clock_and_a_clock_enable() {
    let found = refused(&entity("", "a : in signed(7 downto 0);\ny : out std_logic"));
    assert_eq!(found, ["E1005 e.vhd:4 e", "E1006 e.vhd:4 e"]);
    assert_eq!(refused(&entity("", "clk : in std_logic;\ny : out std_logic")), ["E1006 e.vhd:4 e"]);
    let text = entity("", "tick : in std_logic;\nsend : in std_logic;\ny : out std_logic");
    let (map, warnings) = read(&given(&text), "e").map_err(|(f, _)| f).unwrap().first_map("pe-synth 0.0.0");
    assert_eq!(warnings.iter().map(|warning| warning.code).collect::<Vec<_>>(), ["W1001", "W1001"]);
    assert!(map.ports.iter().all(|port| port.role == Role::Data));
    assert_eq!(wrapped(&text, |_| ()).err().unwrap(), ["E1005 e.vhd:4 e", "E1006 e.vhd:4 e", "W1004 e.vhd:4 e"]);
}

#[test]
fn one_entity_with_one_architecture_is_wanted() {
    let text = entity("", &format!("{CLOCKED}y : out std_logic"));
    let found = refused(&text.replace("entity e is", "entity ee is").replace("of e is", "of ee is"));
    assert_eq!(found, ["E1002 e.vhd:1 "]);
    let (findings, _) = read(&given(&text), "f").err().unwrap();
    assert!(findings[0].help.as_deref().unwrap().contains('e'), "{findings:?}");
    assert_eq!(refused(&text.replace("architecture a of e", "architecture a of f")), ["E1004 e.vhd:4 e"]);
    assert_eq!(refused(&format!("{text}\narchitecture b of E is begin end;")), ["E1004 e.vhd:15 b"]);
    assert_eq!(refused(&format!("{text}\n{text}"))[0], "E1003 e.vhd:18 e");
    assert_eq!(
        refused(&format!("{text}\nentity E_AXI is end; entity e_step is end;")),
        ["E1012 e.vhd:15 E_AXI", "E1012 e.vhd:15 e_step"]
    );
    // Letters of extended names count.
    let extended = text.replace(" e is", " \\e\\ is");
    assert!(read(&given(&extended), "\\E\\").is_err() && read(&given(&extended), "e").is_err());
    assert_eq!(read(&given(&extended), "\\e\\").map_err(|(f, _)| f).unwrap().entity.name, "\\e\\");
}

#[test]
fn text_that_is_no_vhdl_has_a_place() {
    let text = entity("", &format!("{CLOCKED}y : out std_logic;"));
    assert!(refused(&text)[0].starts_with("E1001 e.vhd:"), "{:?}", refused(&text));
    let found = refused(&entity("", &format!("{CLOCKED}CLK : out std_logic")));
    assert_eq!(found, ["E1001 e.vhd:8 CLK"]);
    assert_eq!(
        refused(&entity("", &format!("{CLOCKED}y : out signed({}7 downto 0)", "(".repeat(300))))[0],
        "E1018 e.vhd:8 ("
    );
    for text in [
        "",
        "\u{0}",
        "entity e is",
        "entity e is port (",
        "\u{feff}entity e is end;",
        "\"",
        "\\",
        "entity e is end; architecture a of e is begin process begin if x then",
    ] {
        assert!(!refused(text).is_empty());
    }
}

/// Bits of the port `x`.
fn bits(generics: &str, range: &str, edit: impl FnOnce(&mut Value)) -> Result<u32, Vec<String>> {
    let text = entity(generics, &format!("{CLOCKED}x : in signed{range};\ny : out std_logic"));
    let package = "package p is constant WIDE : natural := 3 * TWO; constant TWO : natural := 2; constant LOOP1 : natural := LOOP2; \
                   constant LOOP2 : natural := LOOP1; end package;\n";
    let text = package.to_owned() + &text.replace("entity e is", "use work.p.all;\nentity e is");
    wrapped(&text, edit).map(|wrapping| wrapping.map.inputs[0].format.bits)
}

#[test]
fn widths_are_constant_expressions_of_integers() {
    for (generics, range, expected) in [
        ("", "(7 downto 0)", 8),
        ("", "(0 to 7)", 8),
        ("", "(10 downto 3)", 8),
        ("", "(-1 downto -4)", 4),
        ("W : positive := 12", "(W - 1 downto 0)", 12),
        ("w : positive := 12; f : natural := w / 5", "(2**F + W mod 5 - 1 downto 0)", 6),
        ("", "(WIDE - 1 downto 0)", 6),
        ("", "(work.p.wide downto p.TWO - 1)", 6),
        ("", "(maximum(3, TWO) + minimum(1, 2) downto abs (-1))", 4),
        ("", "(16#F# downto 0)", 16),
        ("", "(natural range 4 downto 0)", 5),
    ] {
        assert_eq!(bits(generics, range, |_| ()), Ok(expected), "{generics} {range}");
    }
    let set = |value: Value| move |map: &mut Value| map["generics"][0]["value"] = value;
    assert_eq!(bits("W : positive := 12", "(W - 1 downto 0)", set(json!(20))), Ok(20));
    assert_eq!(bits("W : positive", "(W - 1 downto 0)", set(json!(20))), Ok(20));
    assert_eq!(bits("W : positive", "(W - 1 downto 0)", |_| ()).unwrap_err(), ["E1011 e.vhd:7 W", "W1004 e.vhd:6 e"]);
    for value in [json!(0), json!(true), json!(3_000_000_000_i64)] {
        let found = bits("W : positive := 12", "(W - 1 downto 0)", set(value)).unwrap_err();
        assert!(found[0].starts_with("E1016 e.json:") && found[0].ends_with("\"W\""), "{found:?}");
    }
    for range in [
        "(clog2(5) downto 0)",
        "(0 downto 1)",
        "(X downto 0)",
        "(t'range)",
        "(LOOP1 downto 0)",
        "(1 / 0 downto 0)",
        "(63 + 1 downto 0)",
    ] {
        let found = bits("", range, |_| ()).err().unwrap_or_else(|| panic!("{range} is accepted"));
        assert!(found[0].starts_with("E1010 e."), "{range}: {found:?}");
    }
    // The parser takes no such number for one.
    let found = bits("", "(99999999999999999999 downto 0)", |_| ()).unwrap_err();
    assert_eq!(found[0], "E1001 e.vhd:10 99999999999999999999");
}

#[test]
fn roles_are_guessed_by_usual_names() {
    let ports = "aclk : in std_logic; i_clk_en : in std_ulogic; s_aresetn : in std_logic; Start_i : in std_logic;\n\
                 BUSY : out std_logic; done_v : out std_logic_vector(0 downto 0); rst : in std_logic;\n\
                 u : in unsigned(3 downto 0); s : out signed(3 downto 0); w : in std_logic_vector(63 downto 0)";
    let map = first(&entity("", ports));
    let roles: Vec<String> = map
        .ports
        .iter()
        .map(|port| {
            let active = port.active.map_or(String::new(), |level| format!(" {level:?}"));
            format!("{:?}{active}", port.role)
        })
        .collect();
    let expected =
        ["Clock", "ClockEnable High", "Reset Low", "Start High", "Ready Low", "Data", "Data", "Data", "Data", "Data"];
    assert_eq!(roles, expected);
    assert!(map.until_ready);
    let signs: Vec<Option<bool>> = map.ports[5..].iter().map(|port| port.signed).collect();
    assert_eq!(signs, [Some(false), Some(false), Some(false), Some(true), Some(true)]);
}

/// Findings of a map in which an entry was replaced.
fn with_port(number: usize, port: Value) -> Vec<String> {
    let text = entity("", &format!("{CLOCKED}x : in signed(3 downto 0);\ny : out std_logic;\nrst : in std_logic"));
    match wrapped(&text, |map| map["ports"][number] = port) {
        Ok(_) => Vec::new(),
        Err(found) => found.iter().map(|line| line.split(':').next().unwrap().to_owned()).collect(),
    }
}

#[test]
fn a_map_must_fit_its_entity() {
    let x = |more: Value| {
        let mut entry = json!({"name": "x", "declared": "in  SIGNED(3 DOWNTO 0)", "role": "data"});
        entry.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        with_port(2, entry)
    };
    assert_eq!(
        x(json!({"bits": 4, "exponent": -3, "unit": "V", "range": [-1, 1], "rounding": "towards_zero", "every": 2})),
        [""; 0]
    );
    assert_eq!(x(json!({"role": "constant", "value": -8})), [""; 0]);
    assert_eq!(x(json!({"role": "constant", "value": 15})), [""; 0]);
    for more in [
        json!({"role": "constant"}),
        json!({"role": "constant", "value": 16}),
        json!({"role": "constant", "value": -9}),
        json!({"role": "constant", "value": "10"}),
        json!({"role": "constant", "value": "10x1"}),
        json!({"role": "constant", "value": "1011", "every": 2}),
        json!({"value": 1}),
        json!({"active": "low"}),
        json!({"bits": 5}),
        json!({"exponent": 5000}),
        json!({"every": 0}),
        json!({"range": [1, 0]}),
    ] {
        assert_eq!(x(more.clone()), ["E1016 e.json"], "{more}");
    }
    for role in ["open", "ready", "start", "clock_enable", "reset"] {
        assert!(x(json!({"role": role})).contains(&"E1015 e.json".to_owned()), "{role}");
    }
    assert_eq!(x(json!({"declared": "in signed(7 downto 0)"})), ["E1014 e.json"]);
    assert_eq!(x(json!({"name": "z"})), ["E1014 e.json", "E1014 e.vhd"]);
    assert_eq!(x(json!({"name": "clk", "declared": "in std_logic", "role": "clock"})), ["E1014 e.json", "E1014 e.vhd"]);
    assert_eq!(x(json!({"roll": "data"})), ["E1013 e.json"]);
    assert_eq!(x(json!({"role": "datum"})), ["E1013 e.json"]);
    assert_eq!(with_port(3, json!({"name": "y", "declared": "out std_logic", "role": "open"})), ["E1017 e.vhd"]);
    assert_eq!(with_port(0, json!({"name": "clk", "declared": "in std_logic", "role": "data"})), ["E1005 e.vhd"]);
    assert_eq!(
        with_port(1, json!({"name": "ce", "declared": "in std_logic", "role": "constant", "value": 1})),
        ["E1006 e.vhd"]
    );
    assert_eq!(
        with_port(4, json!({"name": "rst", "declared": "in std_logic", "role": "clock"})),
        ["E1015 e.json", "W1004 e.vhd"]
    );
    let text = entity("", &format!("{CLOCKED}x : in signed(3 downto 0);\ny : out std_logic;\nrst : in std_logic"));
    for (key, value, code) in [
        ("entity_version", json!(2), "E1013"),
        ("entity", json!("f"), "E1014"),
        ("step", json!(0), "E1016"),
        ("clocks", json!(0), "E1016"),
        ("reset_clocks", json!(1_000_000), "E1016"),
        ("until_ready", json!(true), "E1015"),
    ] {
        let found = wrapped(&text, |map| map[key] = value).err().unwrap_or_else(|| panic!("{key} is accepted"));
        assert!(found[0].starts_with(&format!("{code} e.json")), "{key}: {found:?}");
    }
    // All at once.
    let found = wrapped(&text, |map| {
        map["step"] = json!(-1);
        map["ports"][2]["every"] = json!(0);
        map["ports"][3]["role"] = json!("open");
    });
    assert_eq!(found.err().unwrap().len(), 3);
    let wrapping = wrapped(&text, |map| map["ports"][2]["signed"] = json!(false)).unwrap_or_else(|f| panic!("{f:?}"));
    assert_eq!(wrapping.warnings.iter().map(|warning| warning.code).collect::<Vec<_>>(), ["W1003"]);
}

#[test]
fn names_that_others_reserve_stay_apart() {
    let ports = "clk_i : in std_logic; ce_i : in std_logic; clk : in std_logic_vector(1 downto 0); \\CLK\\ : in std_logic;\n\
                 \\clk\\ : in std_logic; step : in std_logic; take : in std_logic; \\a \"b\\\\c\\ : out std_logic; \\a b c\\ : out std_logic;\n\
                 restart : out std_logic; \\signal\\ : out unsigned(62 downto 0)";
    let wrapping = wrapped(&entity("", ports), |map| {
        map["ports"][2] =
            json!({"name": "clk", "declared": "in std_logic_vector(1 downto 0)", "role": "constant", "value": 2});
        map["ports"][3]["role"] = json!("data");
    });
    let wrapping = wrapping.unwrap_or_else(|found| panic!("{found:#?}"));
    let ports: Vec<&str> = wrapping
        .map
        .inputs
        .iter()
        .map(|input| input.port.as_str())
        .chain(wrapping.map.outputs.iter().map(|o| o.port.as_str()))
        .collect();
    let mut lower: Vec<String> = ports.iter().map(|port| port.to_lowercase()).collect();
    lower.sort();
    lower.dedup();
    assert_eq!(lower.len(), ports.len(), "{ports:?}");
    let own = ["clk_i", "ce_i", "step_i", "busy_o", "done_o", "overflow_o", "restart_i", "step_clocks_i"];
    assert!(!lower.iter().any(|port| own.contains(&port.as_str())), "{ports:?}");
    let shell = wrapping.artefacts.iter().find(|file| file.path == "e_step.vhd").unwrap();
    assert!(
        shell.text.contains("\\a \"b\\\\c\\") && shell.text.contains("u_entity : entity work.e(a)"),
        "{}",
        shell.text
    );
    assert_eq!(wrapping.map.outputs.last().unwrap().name, "\\signal\\");
}
