//! Ports for a host: what `verify` says of designs that have them, and of such designs with something broken.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::support::bench::Folder;
use crate::support::damage::{Damage, missed};
use pe_map::Map;
use pe_verify::Scratch;
use pe_verify::engines::Bench;
use pe_verify::folder::DesignFolder;
use pe_verify::host::{self, Play};

fn pe_synth(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_pe-synth")).args(arguments).output().unwrap()
}

/// Compiles a shipped model with ports for a host; its folder.
fn compiled(test: &str, name: &str, options: &str) -> PathBuf {
    let spec = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../models/{name}/{name}.spec"));
    compiled_from(test, &spec, options)
}

/// Compiles a spec with ports for a host; its folder.
fn compiled_from(test: &str, spec: &Path, options: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let mut arguments = vec!["compile", spec.to_str().unwrap(), "--quiet", "--no-pictures"];
    arguments.extend(["-o", folder.to_str().unwrap()]);
    arguments.extend(options.split_whitespace());
    let output = pe_synth(&arguments);
    assert!(output.status.success(), "{test}: {}", String::from_utf8_lossy(&output.stderr));
    folder
}

/// Compiles the text of a spec.
fn compiled_text(test: &str, text: &str, options: &str) -> PathBuf {
    let home = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{test}_spec"));
    fs::create_dir_all(&home).unwrap();
    let spec = home.join("model.spec");
    fs::write(&spec, text).unwrap();
    compiled_from(test, &spec, options)
}

/// What a host finds wrong, if anything.
fn judged(folder: &Path) -> Result<usize, String> {
    let scratch = Scratch::new().unwrap();
    let folder = DesignFolder::open(folder).unwrap();
    let mut bench = Bench::new(&folder.path, &folder.design, &scratch.folder("bench").unwrap()).unwrap();
    let lines = |play: &Play| play.judge(&mut bench).map(|()| play.lines());
    let plays = host::plays(&folder).map_err(|failure| format!("{failure:?}"))?;
    plays.iter().map(lines).sum::<Result<usize, _>>().map_err(|failure| format!("{failure:?}"))
}

/// Ticks and inputs; looped stages with variants; swapped buffers; tables; a deep pipeline; words that saturate.
const DESIGNS: [(&str, &str); 7] = [
    // At rest, and nothing but a restart.
    ("motor_pid", "--pes 1 --span 100ms --host restart"),
    ("motor_pid", "--pes 2 --span 100ms --host restart,states,flags"),
    ("weibel5", "--pes 4 --span 20ms --multiplier 25x18 --loop on --host restart,states"),
    ("wave6", "--pes 3 --host states"),
    ("hodgkin_huxley", "--pes 2 --span 2ms --host restart"),
    ("spring_chain", "--pes 3 --loop on --pipeline deep --set n=12 --host states,flags"),
    ("rc_ladder", "--pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off --host restart,states,flags"),
];

#[test]
fn a_host_sees_what_the_simulator_has() {
    for (name, options) in DESIGNS {
        let folder = compiled(&format!("host_{name}"), name, options);
        assert!(judged(&folder).unwrap_or_else(|what| panic!("{name}: {what}")) > 0);
    }
}

/// Names that the ports for a host have, and a constant of theirs.
const NAMESAKES: &str = "\
model state_order
solver heun
step 1 ms
span 20 ms
input state_address [N] = sine(1, 20 Hz)
input restart = sine(0.5, 30 Hz)
input clear = sine(0.5, 40 Hz)
state operand = 0.25
state saturated = -1
operand' = state_address - 3*operand + clear
saturated' = restart - operand - saturated
output operand, saturated
";

#[test]
fn inputs_and_outputs_may_be_called_like_ports_for_a_host() {
    let folder = compiled_text("host_namesakes", NAMESAKES, "--pes 1 --host restart,states,flags");
    assert!(judged(&folder).unwrap_or_else(|what| panic!("{what}")) > 0);
}

#[test]
fn verify_plays_the_host() {
    let folder = compiled("host_verified", "van_der_pol", "--pes 1 --span 100ms --host restart,states,flags");
    let output = pe_synth(&["verify", folder.to_str().unwrap(), "--engines", "ghdl", "--steps", "2"]);
    let (text, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{errors}");
    assert!(text.contains("GHDL = simulator for a host:"), "{text}");
}

/// Found among random models: a PE has no sum that ends in front of the pause point, and one under way there.
const UNDER_WAY: &str = "\
model under_way
solver heun
step 1 ms
span 20 ms
state x0 = -0.160
state x1 = 0.208
state x2 = 0.425
state x3 = -0.450
state x4 = 0.161
state x5 = 0.327
state x6 = 0.373
state x7 = 0.091
state x8 = -0.387
x0' = -0.968*x0 - 0.059*x5 - 2.089*x0
x1' = -2.877*x1
x2' = -1.738*x2
x3' = -1.005*x5 + 0.659*x7*x7 - 2.499*x3
x4' = -0.557*x7 - 2.616*x4
x5' = -1.762*x5 - 0.001*x8 - 0.726*x3 + 1.080*x2 - 0.058*x0 - 0.149*x1 + 0.151*x6 + 1.634*x4 + 1.558*x7 - 1.508*x5
x6' = -1.022*x4 + 1.596*x0 + 0.077*x7 + 0.724*x1 - 1.338*x6 + 1.051*x5 - 0.743*x3 - 0.352*x2 - 1.910*x8 - 4.473*x6
x7' = -0.469*x0 + 0.685*x5*x6 - 4.668*x7
x8' = -1.000*x0 + 1.369*x5 - 5.749*x8
output x0
";

/// Found in the same way: all states are written behind the last control word of a step.
const WRAPPED: &str = "\
model wrapped
solver euler
step 1 ms
span 20 ms
state x0 = -0.145
state x1 = 0.435
state x2 = 0.385
state x3 = -0.011
x0' = -0.106*x1 - 0.726*x3 + 0.013*x3*x2 - 1.115*x0
x1' = 0.527*x3*x1 - 4.814*x1
x2' = -1.582*x3 + 0.949*x3*x0 - 1.871*x2
x3' = 1.020*x3 + 0.206*x0 - 5.564*x3
output x0
";

/// Damages of the hardware that no run without a host shows: file, what is there, what takes its place.
const DAMAGES: [Damage; 16] = [
    // A restart replaces nothing.
    ("hdl/pe.vhd", "replacement <= state_i;", "null;"),
    ("hdl/pe_access.vhd", "replacing <= restart;", "replacing <= '0';"),
    // What was read comes a clock later.
    ("hdl/pe_access.vhd", "  state_o       <= state;", "  state_o       <= state when rising_edge(clk_i);"),
    // Operands that are too large set the other flag.
    ("hdl/pe.vhd", "          if (SPLIT_FLAGS) then", "          if (false) then"),
    // Bases are added to what replaces them.
    (
        "hdl/pe_scale.vhd",
        "flag(control_i, LAYOUT.base.enable) and not replace_i",
        "flag(control_i, LAYOUT.base.enable)",
    ),
    // Products are added to what replaces a state.
    ("hdl/pe.vhd", "flag(control_i, LAYOUT.own.enable) and not replace_i", "flag(control_i, LAYOUT.own.enable)"),
    // A sum that was under way goes on.
    ("hdl/pe.vhd", "(ACCESS_STATES and refill_i = '1')", "(false)"),
    // Reading writes.
    ("hdl/pe_scale.vhd", "write_base_i and not look_i", "write_base_i"),
    // Another PE's words.
    ("hdl/pe_scale.vhd", "look_here_i when look_i = '1'", "'1' when look_i = '1'"),
    // The offset is added twice.
    ("hdl/pe_access.vhd", "resize(signed(source), WORD_BITS + 1) - offset", "resize(signed(source), WORD_BITS + 1)"),
    // Words in front of the pause point are matched in the first pass already.
    ("hdl/pe_access.vhd", "unsigned(next_i) >= PAUSE_WORD - 2", "unsigned(next_i) >= 0"),
    // The step that replaces states publishes outputs.
    ("hdl/pe_sequencer.vhd", "fetch and not settle and not replace_i", "fetch and not settle"),
    // It counts as a step for ticks.
    ("hdl/pe_sequencer.vhd", "sample_o  <= fetch and waiting and not replace_i", "sample_o  <= fetch and waiting"),
    // Ticks keep their counters.
    ("hdl/pe_tick.vhd", "(replace_i = '1' and here_i = '1')", "(false)"),
    // Steps begin while a host has access.
    ("hdl/pe_sequencer.vhd", "((step_i and not hold_i) or not waiting)", "(step_i or not waiting)"),
    // Flags stay.
    ("hdl/pe.vhd", "(clear_i = '1')", "(false)"),
];

#[test]
fn what_is_broken_for_a_host_is_caught() {
    let designs = [
        compiled("host_broken_motor", "motor_pid", "--pes 2 --span 100ms --host restart,states,flags"),
        compiled(
            "host_broken_ladder",
            "rc_ladder",
            "--pes 2 --span 10ms --multiplier 25x18 --storage 32 --proof off --host restart,states,flags",
        ),
        compiled(
            "host_broken_chain",
            "spring_chain",
            "--pes 2 --set n=8 --proof off --multiplier 25x18 --storage 32 --host restart,states,flags",
        ),
        compiled_text(
            "host_broken_under_way",
            UNDER_WAY,
            "--pes 3 --multiplier 18x18 --loop on --host restart,states,flags",
        ),
        compiled_text("host_broken_wrapped", WRAPPED, "--pes 3 --multiplier 18x18 --host restart,states,flags"),
        compiled("host_broken_oscillator", "harmonic_oscillator", "--pes 1 --host restart,states,flags"),
    ];
    for folder in &designs {
        assert!(judged(folder).unwrap_or_else(|what| panic!("{what}")) > 0);
    }
    let scratch = Folder::new("host_broken");
    let designs: Vec<&Path> = designs.iter().map(PathBuf::as_path).collect();
    let missed = missed(&designs, &scratch.0, &DAMAGES, |broken, _| judged(broken).is_err());
    assert_eq!(missed, Vec::<&str>::new(), "not caught");
}

#[test]
fn the_map_lists_the_ports_for_a_host() {
    let folder = compiled("host_map", "motor_pid", "--pes 2 --span 100ms --host restart,states,flags");
    let map = Map::read(&fs::read_to_string(folder.join("motor_pid_map.json")).unwrap()).unwrap();
    let network = fs::read_to_string(folder.join("motor_pid.vhd")).unwrap();
    let host = map.host.expect("there are ports for a host");
    let access = host.access.expect("there is access");
    let flags = host.flags.expect("there are flags");
    let words = [&access.word, &access.new_word, &access.address];
    let bits = [&access.request, &access.granted, &access.valid, &access.ready, &flags.clear, &flags.saturated];
    for port in words.into_iter().chain(bits).chain([&flags.operand, &flags.input, &host.restart.unwrap()]) {
        assert!(network.contains(&format!("    {port} ")), "no port {port}");
    }
    let mut states: Vec<u32> = access.order.iter().filter_map(|place| place.state).collect();
    states.sort_unstable();
    assert!(states.iter().copied().eq(0..map.states.len() as u32));
    assert_eq!(access.order.iter().filter(|place| place.tick.is_some()).count(), map.ticks.len());
    let plain = compiled("host_none", "motor_pid", "--pes 2 --span 100ms");
    let plain = fs::read_to_string(plain.join("motor_pid_map.json")).unwrap();
    assert_eq!(Map::read(&plain).unwrap().host, None);
}
