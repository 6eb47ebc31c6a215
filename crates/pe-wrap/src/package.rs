//! The register map as VHDL: the part of `hdl/pe_register_pkg.vhd` that is made of [`pe_map::registers`].

use pe_map::registers::{Capability, ID, REGISTER_VERSION, REGISTERS, Register, Use};

/// Constants of the registers, by name, and which there are; sets have a bit per register.
pub fn constants() -> String {
    let mut lines = vec![
        number("REGISTER_COUNT", REGISTERS.len().to_string()),
        number("REGISTER_VERSION", REGISTER_VERSION.to_string()),
    ];
    let set = |name: &str, of: &dyn Fn(&Register) -> bool| {
        let bits: String = REGISTERS.iter().map(|register| if of(register) { '1' } else { '0' }).collect();
        format!("  constant {name}\t: std_ulogic_vector(0 to {})\t:= b\"{bits}\";", REGISTERS.len() - 1)
    };
    lines.push(format!("  constant ID_WORD\t: std_ulogic_vector(31 downto 0)\t:= x\"{ID:08X}\";"));
    lines.push(set("READ_REGISTERS", &|register| register.usage != Use::Command));
    let written = |usage| !matches!(usage, Use::Read | Use::ReadForeign);
    lines.push(set("WRITE_REGISTERS", &|register| written(register.usage)));
    lines.push(set("FOREIGN_WRITES", &|register| register.usage == Use::ReadForeign));
    for (name, needed) in [("STATES", Capability::States), ("FLAGS", Capability::Flags)] {
        lines.push(set(&format!("{name}_REGISTERS"), &|register| register.needs == Some(needed)));
    }
    lines.push("\n  -- Windows: the upper two bits of an address".to_owned());
    for (window, name) in ["REGISTER", "PARAMETER", "INPUT", "OUTPUT"].into_iter().enumerate() {
        lines.push(number(&format!("{name}_WINDOW"), window.to_string()));
    }
    lines.push("\n  -- Registers: words from the beginning of their window".to_owned());
    lines.extend(
        REGISTERS
            .iter()
            .map(|register| number(&format!("{}_REGISTER", register.name), (register.address / 4).to_string())),
    );
    lines.push("\n  -- Lowest bits of their fields".to_owned());
    for register in REGISTERS {
        lines.extend(
            register
                .fields
                .iter()
                .map(|field| number(&format!("{}_{}", register.name, field.name), field.low.to_string())),
        );
    }
    pe_emit::aligned(lines.join("\n") + "\n")
}

fn number(name: &str, value: String) -> String {
    format!("  constant {name}\t: natural\t:= {value};")
}
