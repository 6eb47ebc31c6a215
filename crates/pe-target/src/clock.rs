//! The clock that speeds are computed with: given by the user, estimated where networks were measured on the family of
//! the device, or assumed.

use pe_ir::multiplier::MULT18X18D;
use pe_ir::word::Pipeline::{self, Deep, Short};
use pe_ir::word::WordFormat;

use crate::area::Family;
use crate::devices::Device;

/// Clock where nothing is known, in MHz: the paper's designs reach 140 to 182.
const ASSUMED_MHZ: f64 = 150.0;

/// Where a clock comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Basis {
    /// The user gave it.
    Given,
    /// From measured networks of the same family.
    Estimated,
    /// Nobody knows.
    Assumed,
}

/// The clock of a design.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// Frequency in MHz.
    pub mhz: f64,
    /// What an estimate may be off by, to either side; else 0.
    pub error_mhz: f64,
    /// Where it comes from.
    pub basis: Basis,
}

impl Clock {
    /// In words.
    pub fn words(&self) -> String {
        words(self.mhz, (self.basis == Basis::Estimated).then_some(self.error_mhz), self.basis.name())
    }
}

/// A frequency in MHz with what it may be off by, and where it comes from, in words.
pub fn words(mhz: f64, error_mhz: Option<f64>, basis: &str) -> String {
    let error = error_mhz.map_or(String::new(), |error| format!(" ± {error:.0}"));
    format!("{mhz}{error} MHz ({basis})")
}

impl Basis {
    /// As the report names it.
    pub fn name(self) -> &'static str {
        match self {
            Basis::Given => "given",
            Basis::Estimated => "estimated",
            Basis::Assumed => "assumed",
        }
    }
}

/// What is known of the clock before there is a design.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClockSource {
    /// Frequency in MHz that the user gave.
    pub given: Option<f64>,
    /// The device.
    pub device: Option<&'static Device>,
}

impl ClockSource {
    /// The family that sizes are estimated for: that of the device.
    pub fn family(&self) -> Family {
        self.device.map(|device| device.family).unwrap_or_default()
    }

    /// The clock of a network of `pes` PEs.
    pub fn of(&self, format: &WordFormat, pes: u32) -> Clock {
        let exact = |mhz, basis| Clock { mhz, error_mhz: 0.0, basis };
        if let Some(mhz) = self.given {
            return exact(mhz, Basis::Given);
        }
        let estimate = self.device.filter(|device| device.clocks_measured).and_then(|_| ecp5(format, pes));
        estimate.unwrap_or(exact(ASSUMED_MHZ, Basis::Assumed))
    }

    /// For designs that differ, in words.
    pub fn words(&self) -> String {
        match self.device.filter(|device| self.given.is_none() && device.clocks_measured) {
            Some(device) => format!("estimated for {}, where networks like it were measured", device.name),
            None => self.of(&WordFormat::new(32, 32, 32), 1).words(),
        }
    }
}

/// A network whose clock was measured after place and route; `docs/silicon.md` has the models.
struct Measured {
    pipeline: Pipeline,
    blocks: u32,
    pes: u32,
    mhz: f64,
}

const fn measured(pipeline: Pipeline, blocks: u32, pes: u32, mhz: f64) -> Measured {
    Measured { pipeline, blocks, pes, mhz }
}

/// On LFE5U-85F, speed grade 8, by `xtask measure-clock` with flip-flops moved into registers of blocks.
const ECP5: &[Measured] = &[
    measured(Deep, 1, 1, 240.3),
    measured(Deep, 1, 1, 221.7),
    measured(Deep, 1, 1, 239.9),
    measured(Deep, 1, 1, 259.0),
    measured(Deep, 1, 1, 244.7),
    measured(Deep, 1, 1, 224.8),
    measured(Deep, 1, 4, 227.2),
    measured(Deep, 1, 8, 251.2),
    measured(Deep, 1, 16, 226.5),
    measured(Deep, 1, 32, 151.0),
    measured(Deep, 2, 1, 180.8),
    measured(Deep, 4, 1, 223.4),
    measured(Short, 1, 1, 96.3),
    measured(Short, 1, 4, 117.5),
    measured(Short, 1, 8, 132.4),
    measured(Short, 1, 16, 91.5),
    measured(Short, 6, 1, 108.5),
];

/// Registers of 32 bits, a choice among so many of them, and a memory behind it, which is the way of what a PE receives:
/// ports, and MHz on LFE5U-85F, speed grade 8, out of context, as the mean of three seeds.
const CHOICES: [(f64, f64); 5] = [(4.0, 338.6), (8.0, 278.6), (15.0, 235.8), (31.0, 193.6), (63.0, 168.9)];

/// The clock in MHz that the choice among input ports allows: by logarithms of what was measured, beyond it as well.
fn choice(ports: u32) -> f64 {
    let ports = f64::from(ports.max(1));
    let between = CHOICES.windows(2).find(|pair| ports <= pair[1].0).unwrap_or(&CHOICES[CHOICES.len() - 2..]);
    let ((fewer, first), (more, second)) = (between[0], between[1]);
    first * libm::pow(second / first, libm::log(ports / fewer) / libm::log(more / fewer))
}

/// How much slower than small networks with its pipeline one is whose PEs have so many input ports, 1 if it is not: by
/// networks and choices measured on ECP5.
pub fn slower_with_ports(pipeline: Pipeline, ports: u32) -> f64 {
    let alike = ECP5.iter().filter(|of| of.pipeline == pipeline && of.pes <= SMALL);
    let logs: Vec<f64> = alike.map(|of| libm::log(of.mhz)).collect();
    let usual = libm::exp(logs.iter().sum::<f64>() / logs.len() as f64);
    (usual / choice(ports)).max(1.0)
}

/// PEs up to which a network is as fast as a PE alone; each doubling beyond costs the same part of the clock.
const SMALL: u32 = 16;

/// Measured networks of a kind and size from which on an estimate has the smaller error.
const ENOUGH: usize = 3;

/// Least errors of an estimate, relative to it, from enough networks and from fewer: seeds of one network differ by 8
/// %.
const LEAST_ERROR: f64 = 0.1;
const FEW_ERROR: f64 = 0.2;

/// How often a small network is doubled to have so many PEs.
fn doublings(pes: u32) -> f64 {
    libm::log2(f64::from(pes.max(SMALL)) / f64::from(SMALL))
}

/// The geometric mean of the clocks of small networks of a kind, as a logarithm.
fn small(pipeline: Pipeline, blocks: u32) -> Option<f64> {
    let alike = ECP5.iter().filter(|of| (of.pipeline, of.blocks) == (pipeline, blocks) && of.pes <= SMALL);
    let logs: Vec<f64> = alike.map(|of| libm::log(of.mhz)).collect();
    (!logs.is_empty()).then(|| logs.iter().sum::<f64>() / logs.len() as f64)
}

/// What the logarithm of the clock loses with each doubling, by least squares.
fn loss(pipeline: Pipeline) -> f64 {
    let (mut weight, mut sum) = (0.0, 0.0);
    for of in ECP5.iter().filter(|of| of.pipeline == pipeline && of.pes > SMALL) {
        let lost = small(pipeline, of.blocks).map_or(0.0, |small| small - libm::log(of.mhz));
        weight += doublings(of.pes) * doublings(of.pes);
        sum += doublings(of.pes) * lost;
    }
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// The clock on an ECP5, if small networks of this kind, and with its pipeline any of at least this size were measured.
fn ecp5(format: &WordFormat, pes: u32) -> Option<Clock> {
    let (pipeline, blocks) = (format.pipeline, format.blocks(MULT18X18D));
    let (small, loss) = (small(pipeline, blocks)?, loss(pipeline));
    if !ECP5.iter().any(|of| of.pipeline == pipeline && of.pes >= pes) {
        return None;
    }
    let at = |pes| libm::exp(small - loss * doublings(pes));
    let alike = ECP5.iter().filter(|of| (of.pipeline, of.blocks) == (pipeline, blocks));
    let off = alike.clone().map(|of| (of.mhz / at(of.pes) - 1.0).abs());
    let enough = alike.filter(|of| (of.pes > SMALL) == (pes > SMALL)).count() >= ENOUGH;
    let off = off.fold(if enough { LEAST_ERROR } else { FEW_ERROR }, f64::max);
    // More than whole numbers the figures do not bear.
    let mhz = libm::round(at(pes));
    Some(Clock { mhz, error_mhz: libm::ceil(mhz * off), basis: Basis::Estimated })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_measured_network_is_within_the_error_of_its_estimate() {
        for of in ECP5 {
            let (data, coefficient) = [(18, 18), (25, 18), (32, 32)][of.blocks.min(4) as usize / 2];
            let format = WordFormat { pipeline: of.pipeline, ..WordFormat::new(32, data, coefficient) };
            assert_eq!(format.blocks(MULT18X18D), of.blocks);
            let clock = ecp5(&format, of.pes).expect("a network of this kind and size was measured");
            println!("{} {}: {} measured, {}", of.pipeline.name(), of.pes, of.mhz, clock.words());
            assert!((clock.mhz - of.mhz).abs() <= clock.error_mhz, "{}: {}", of.mhz, clock.words());
        }
    }

    #[test]
    fn more_ports_never_make_a_network_faster_and_few_cost_no_clock() {
        for (ports, mhz) in CHOICES {
            assert!((choice(ports as u32) - mhz).abs() < 1e-9, "{ports}");
        }
        for pipeline in [Deep, Short] {
            assert!((1..=15).all(|ports| slower_with_ports(pipeline, ports) == 1.0), "{pipeline:?}");
            let slower: Vec<f64> = (1..=256).map(|ports| slower_with_ports(pipeline, ports)).collect();
            assert!(slower.is_sorted() && slower[255] < 2.5, "{slower:?}");
        }
        assert!(slower_with_ports(Deep, 31) > 1.15);
        assert_eq!(slower_with_ports(Short, 63), 1.0, "multiplier and adder take longer than the choice");
    }

    #[test]
    fn what_nobody_measured_is_assumed_and_what_is_given_is_taken() {
        let ecp5 = crate::devices::DEVICES.iter().find(|device| device.clocks_measured).expect("an ECP5");
        let xilinx = crate::devices::DEVICES.iter().find(|device| !device.clocks_measured).expect("another one");
        let format = WordFormat { pipeline: Deep, ..WordFormat::new(32, 18, 18) };
        let basis = |given, device, pes| ClockSource { given, device }.of(&format, pes).basis;
        assert_eq!(basis(None, Some(ecp5), 1), Basis::Estimated);
        assert_eq!(basis(None, Some(ecp5), 100_000), Basis::Assumed);
        assert_eq!(basis(None, Some(xilinx), 1), Basis::Assumed);
        assert_eq!(basis(None, None, 1), Basis::Assumed);
        assert_eq!(basis(Some(99.0), Some(ecp5), 1), Basis::Given);
    }
}
