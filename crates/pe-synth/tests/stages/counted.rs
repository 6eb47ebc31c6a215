//! Designs that are judged by their events: what is counted, what is refused, and what the option does not excuse.

use std::fs;
use std::process::{Command, Output};

use crate::support::agree::assert_same_words;
use crate::support::bench::Folder;
use crate::support::is_long_suite;
use crate::support::written::next;
use serde_json::Value;

/// The program on a spec in a folder of its own.
struct Spec(Folder);

impl Spec {
    fn new(name: &str, text: &str) -> Spec {
        let folder = Folder::new(&format!("counted_{name}"));
        fs::write(folder.0.join("counted.spec"), format!("model counted\n{text}")).unwrap();
        Spec(folder)
    }

    fn run(&self, arguments: &str) -> Output {
        let program = env!("CARGO_BIN_EXE_pe-synth");
        Command::new(program).args(arguments.split_whitespace()).current_dir(&self.0.0).output().unwrap()
    }

    /// The report of a design that is not refused.
    fn report(&self, options: &str) -> Value {
        let arguments = format!("compile counted.spec --quiet --no-pictures --judge events {options} -o out");
        let output = self.run(&arguments);
        assert!(output.status.success(), "{arguments}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_str(&fs::read_to_string(self.0.0.join("out/report.json")).unwrap()).unwrap()
    }

    /// What a design that is refused is told.
    fn refusal(&self, options: &str) -> String {
        let output = self.run(&format!("compile counted.spec --quiet --no-pictures {options} -o out"));
        assert!(!output.status.success(), "{options}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stderr).unwrap()
    }

    /// How often anything fired in a run, as the last row of its outputs says.
    fn fired(&self, options: &str) -> f64 {
        let output = self.run(&format!("sim counted.spec --judge events {options} -o run.csv"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let rows = fs::read_to_string(self.0.0.join("run.csv")).unwrap();
        let last = rows.lines().last().unwrap();
        last.split(',').skip(1).map(|cell| cell.trim().parse::<f64>().unwrap()).sum()
    }
}

/// A network of spiking neurons with random synapses and delays.
fn network(neurons: usize, synapses: usize, span: f64, more: &str, outputs: &str) -> String {
    let mut seed = 5;
    let mut text = format!("solver heun\nstep 0.5\nspan {span}\nconst n = {neurons}\nindex i in 1..n\n");
    text += "param drive[i] = 4 + 0.02*i*i - 0.1*i\n";
    text += "state v[i] = -70 + i in -150 .. 900\nstate u[i] = -14 in -40 .. 120\nstate s[i] = 0\nstate fired[i] = 0\n";
    text += "u[i]' = 0.02*(0.2*v[i] - u[i])\ns[i]' = -s[i]/5\nfired[i]' = 0\n";
    text += "when v[i] >= 30 { v[i] = -65; u[i] = u[i] + 8; s[i] = s[i] + 1; fired[i] = fired[i] + 1 }\n";
    for neuron in 1..=neurons {
        text += &format!("v[{neuron}]' = 0.04*v[{neuron}]^2 + 5*v[{neuron}] + 140 - u[{neuron}] + drive[{neuron}]");
        for _ in 0..synapses {
            let source = 1 + (next(&mut seed) * neurons as f64) as usize;
            let weight = 3.0 * next(&mut seed) - if source.is_multiple_of(4) { 6.0 } else { 0.0 };
            text += &format!(" + {weight:.3}*s[{source}](t - {})", 1 + (next(&mut seed) * 8.0) as usize);
        }
        text.push('\n');
    }
    text + more + &format!("output {outputs}\n")
}

#[test]
fn numbers_of_spikes_are_those_that_runs_count_themselves() {
    let spec = Spec::new("network", &network(8, 4, 200.0, "", "fired"));
    let told = spec.refusal("--pes 2");
    assert!(["E0903", "E0906", "E0907"].iter().any(|code| told.contains(code)), "{told}");
    let report = spec.report("--pes 2");
    let fired = report["events"]["counts"].as_array().unwrap().iter().find(|own| own["name"] == "fired").unwrap();
    let (double, fixed) = (fired["double"].as_f64().unwrap(), fired["fixed"].as_f64().unwrap());
    assert!(double > 15.0, "too few to say anything: {fired}");
    assert_eq!((double, fixed), (spec.fired("--double"), spec.fired("")), "{fired}");
    let halved = spec.fired("--double --step 0.25");
    assert_eq!(fired["half_step"].as_f64().unwrap(), halved, "{fired}");
    // Every neuron's `v`, `u` and `s` jump with its counter.
    for own in report["events"]["counts"].as_array().unwrap() {
        assert_eq!((&own["double"], &own["fixed"]), (&fired["double"], &fired["fixed"]), "{own}");
    }
    assert_same_words(
        &spec.0.0.join("counted.spec"),
        "--pes 2 --judge events",
        if is_long_suite() { 60 } else { 25 },
        0.2,
    );
}

#[test]
fn a_reference_counts_its_own_spikes() {
    let report = Spec::new("reference", &network(4, 2, 200.0, "", "fired")).report("--pes 1 --step 0.125 --reference");
    let events = &report["events"];
    let double = &events["reference_double"]["total"];
    assert!(double["should"].as_f64().unwrap() >= 8.0, "{events}");
    assert!(double["part"].as_f64().unwrap() < 0.1, "{events}");
    // Two methods of high order find the same events as long as nothing is chaotic, but for which step a time on its end counts to.
    assert_eq!(events["reference_second"]["total"]["part"].as_f64(), Some(0.0), "{events}");
    // The solution has the spikes in the middle of steps, the network at their ends.
    assert!(events["reference_fixed"]["apart_s"].as_f64().is_none_or(|time| time > 1.0), "{events}");
}

#[test]
fn what_no_event_depends_on_is_not_excused() {
    // Increments of half a millionth are lost in words of such a range.
    let slow = "state slow = 0 in -1e7 .. 1e7\nslow' = 1e-6\n";
    let spec = Spec::new("slow", &network(8, 4, 200.0, slow, "fired, slow"));
    let told = spec.refusal("--pes 2 --judge events --storage 25");
    assert!(told.contains("E0932") && told.contains("`slow`"), "{told}");
    // Without that state the same words do.
    Spec::new("not_slow", &network(8, 4, 200.0, "", "fired")).report("--pes 2 --storage 25");
}

#[test]
fn trajectories_count_while_events_fall_in_the_same_steps() {
    // Short coefficients change the period of the oscillation, and no event.
    let sawtooth = "solver rk4\nstep 0.01\nspan 2000\nstate y = 0\ny' = 1\nwhen y > 0.9925 { y = 0 }\n";
    let beside = "state x = 1\nstate p = 0\nx' = 6.1*p\np' = -6.1*x\noutput x, y\n";
    let spec = Spec::new("sawtooth", &format!("{sawtooth}{beside}"));
    let told = spec.refusal("--pes 1 --judge events --storage 18 --multiplier 12x12");
    assert!(told.contains("E0907"), "{told}");
    spec.report("--pes 1");
}

#[test]
fn words_that_change_the_rates_are_refused() {
    // Three bits are lost to a range that nothing needs.
    let network = network(8, 4, 200.0, "", "fired").replace("-150 .. 900", "-4000 .. 4000");
    let spec = Spec::new("coarse", &network);
    let told = spec.refusal("--pes 2 --judge events --storage 12 --multiplier 12x12");
    assert!(["E0932", "E0802", "E0901", "E0902", "E0907"].iter().any(|code| told.contains(code)), "{told}");
}

#[test]
fn a_model_without_events_has_nothing_to_count() {
    let never = "solver rk4\nstep 0.01\nspan 1\nstate x = 1\nx' = -x\nwhen x >= 2 { x = 1 }\noutput x\n";
    let none = "solver rk4\nstep 0.01\nspan 1\nstate x = 1\nx' = -x\noutput x\n";
    for (name, text) in [("never", never), ("none", none)] {
        let told = Spec::new(name, text).refusal("--judge events");
        assert!(told.contains("E0931"), "{told}");
    }
}

#[test]
fn a_spike_that_would_leave_all_bounds_within_a_step_is_found_before() {
    // Without its event the solution ends 0.8 s behind the threshold, within the step of a spike.
    let spike = "solver heun\nstep 0.5\nspan 100\nstate v = -65 in -150 .. 900\nstate n = 0\n";
    let body = "v' = 0.04*v^2 + 5*v + 163\nn' = 0\nwhen v >= 30 { v = -65; n = n + 1 }\noutput n, v\n";
    let report = Spec::new("bounds", &format!("{spike}{body}")).report("--pes 1 --reference --allow E0932");
    let double = &report["events"]["reference_double"];
    assert!(double["total"]["part"].as_f64().unwrap() < 0.2, "{report}");
    assert!(report["events"]["counts"][0]["double"].as_f64().unwrap() >= 5.0, "{report}");
}
