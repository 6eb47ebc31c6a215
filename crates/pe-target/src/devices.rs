//! Devices that a design can be compared with, with the figures of their data sheets.
//!
//! A new device is a row of [`DEVICES`] and a row of the table in `docs/reference.md`.

use crate::area::{Area, Family};

/// What a device offers.
#[derive(Clone, Copy, Debug)]
pub struct Device {
    /// Part name.
    pub name: &'static str,
    /// Who makes it.
    pub vendor: &'static str,
    /// LUTs.
    pub luts: u32,
    /// Family that sizes are estimated for.
    pub family: Family,
    /// Flip-flops.
    pub ffs: u32,
    /// Multiplier blocks.
    pub dsps: u32,
    /// Block RAMs of 18 kbit; those of 36 kbit count twice.
    pub bram18s: u32,
    /// Whether clocks of networks on its family were measured ([`crate::clock`]).
    pub clocks_measured: bool,
    /// Data sheet.
    pub source: &'static str,
}

/// All known devices.
pub const DEVICES: &[Device] = &[
    Device {
        name: "XC6VLX240T",
        vendor: "AMD Virtex-6",
        luts: 150_720,
        family: Family::Virtex6,
        ffs: 301_440,
        dsps: 768,
        bram18s: 2 * 416,
        clocks_measured: false,
        source: "Virtex-6 Family Overview, DS150",
    },
    Device {
        name: "XC7Z020",
        vendor: "AMD Zynq-7000",
        luts: 53_200,
        family: Family::Virtex6,
        ffs: 106_400,
        dsps: 220,
        bram18s: 2 * 140,
        clocks_measured: false,
        source: "Zynq-7000 SoC Data Sheet: Overview, DS190",
    },
    Device {
        name: "LFE5UM-85F",
        vendor: "Lattice ECP5",
        luts: 83_640,
        family: Family::Ecp5,
        ffs: 83_640,
        dsps: 156,
        bram18s: 208,
        clocks_measured: true,
        source: "ECP5 and ECP5-5G Family Data Sheet, FPGA-DS-02012",
    },
    Device {
        name: "GW2A-LV18",
        vendor: "Gowin Arora",
        luts: 20_736,
        family: Family::Gowin,
        ffs: 15_552,
        dsps: 48,
        bram18s: 46,
        clocks_measured: false,
        source: "GW2A series of FPGA Products Data Sheet, DS102",
    },
    Device {
        name: "XCAU25P",
        vendor: "AMD Artix UltraScale+",
        luts: 141_000,
        family: Family::UltraScale,
        ffs: 282_000,
        dsps: 1_200,
        bram18s: 2 * 300,
        clocks_measured: false,
        source: "UltraScale Architecture and Product Data Sheet: Overview, DS890",
    },
    Device {
        name: "XCVU9P",
        vendor: "AMD Virtex UltraScale+",
        luts: 1_182_240,
        family: Family::UltraScale,
        ffs: 2_364_480,
        dsps: 6_840,
        bram18s: 2 * 2_160,
        clocks_measured: false,
        source: "UltraScale Architecture and Product Data Sheet: Overview, DS890",
    },
    Device {
        name: "XCVU13P",
        vendor: "AMD Virtex UltraScale+",
        luts: 1_728_000,
        family: Family::UltraScale,
        ffs: 3_456_000,
        dsps: 12_288,
        bram18s: 2 * 2_688,
        clocks_measured: false,
        source: "UltraScale Architecture and Product Data Sheet: Overview, DS890",
    },
];

/// The device of a name, whatever its case.
pub fn named(name: &str) -> Option<&'static Device> {
    DEVICES.iter().find(|device| device.name.eq_ignore_ascii_case(name))
}

/// One resource of a device and what a design needs of it.
#[derive(Clone, Copy, Debug)]
pub struct Use {
    /// Key in the report.
    pub resource: &'static str,
    /// Needed.
    pub used: u64,
    /// There.
    pub available: u64,
}

impl Use {
    /// Part of the resource that is needed; more than 1 does not fit.
    pub fn share(&self) -> f64 {
        self.used as f64 / self.available as f64
    }
}

/// A design held against a device.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The device.
    pub device: &'static Device,
    /// Its resources.
    pub uses: [Use; 4],
    /// PEs of the mean size of the design's that would fit.
    pub fitting_pes: u64,
}

impl Fit {
    /// Holds a design, its cells counted for the family of the device, against a device.
    pub fn of(device: &'static Device, area: &Area) -> Fit {
        let needed = |resource, used, available: u32| Use { resource, used, available: u64::from(available) };
        let uses = [
            needed("lut", area.lut.round() as u64, device.luts),
            needed("ff", area.ff.round() as u64, device.ffs),
            needed("dsp", u64::from(area.dsp), device.dsps),
            needed("bram18", u64::from(area.bram18), device.bram18s),
        ];
        let room = |of: &Use| (of.available * u64::from(area.pes)).checked_div(of.used).unwrap_or(u64::MAX);
        let fitting_pes = uses.iter().map(room).min().unwrap_or(0);
        Fit { device, uses, fitting_pes }
    }

    /// Resources that are not enough.
    pub fn exceeded(&self) -> impl Iterator<Item = &Use> {
        self.uses.iter().filter(|of| of.used > of.available)
    }

    /// Whether the device has enough of everything.
    pub fn fits(&self) -> bool {
        self.exceeded().next().is_none()
    }

    /// In a line of the summary.
    pub fn summary(&self) -> String {
        let shares = self.uses.map(|of| format!("{:.0} % {}", 100.0 * of.share(), of.resource.to_uppercase()));
        let verdict = if self.fits() { "fits" } else { "does not fit" };
        let name = self.device.name;
        format!("{verdict} {name}: {}; room for {} PEs", shares.join(", "), self.fitting_pes)
    }

    /// What is wrong, in words; nothing if it fits.
    pub fn complaint(&self) -> Option<String> {
        let missing: Vec<String> = self
            .exceeded()
            .map(|of| format!("{} of {} {}", of.used, of.available, of.resource.to_uppercase()))
            .collect();
        let text = format!("the design does not fit {}: it needs {}", self.device.name, missing.join(", "));
        (!missing.is_empty()).then_some(text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fit(device: &str, pes: u32) -> Fit {
        let device = DEVICES.iter().find(|known| known.name == device).expect("a known device");
        let area = Area {
            lut: 400.0 * f64::from(pes),
            ff: 300.0 * f64::from(pes),
            dsp: 4 * pes,
            bram18: 2 * pes,
            pes,
            ..Area::default()
        };
        Fit::of(device, &area)
    }

    #[test]
    fn a_design_fits_with_exactly_the_pes_that_there_is_room_for() {
        for device in DEVICES {
            let room = fit(device.name, 1).fitting_pes as u32;
            assert!(fit(device.name, room).fits(), "{}", device.name);
            let more = fit(device.name, room + 1);
            assert!(!more.fits() && more.complaint().is_some(), "{}", device.name);
            assert_eq!(more.fitting_pes, u64::from(room), "{}", device.name);
        }
    }

    #[test]
    fn the_resource_that_is_missing_is_named() {
        let fit = fit("XC6VLX240T", 300);
        assert_eq!(fit.exceeded().map(|of| of.resource).collect::<Vec<_>>(), ["dsp"]);
        assert_eq!(fit.complaint().unwrap(), "the design does not fit XC6VLX240T: it needs 1200 of 768 DSP");
    }
}
