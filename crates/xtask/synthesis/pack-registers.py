#!/usr/bin/env python3
# SPDX-License-Identifier: MIT OR Apache-2.0
"""Moves flip-flops into the registers of ECP5 multiplier blocks and block RAMs, which yosys 0.70 leaves unused.

    cargo run -p xtask -- pack-registers NETLIST.json PACKED.json

Reads a netlist of `synth_ecp5`. What is moved:

- flip-flops in front of both operands of a MULT18X18D, to its input registers;
- flip-flops that take all products of a MULT18X18D, to its output register;
- flip-flops that take all outputs of a DP16KD, to its output register. Where they are reset or set, one flip-flop
  remembers that, and a look-up table per bit does it behind the block.

All flip-flops of a register must have one clock and one clock enable, and an output that is moved no other reader.
"""

import json
import sys

CONSTANTS = ("0", "1", "x", "z")


class Netlist:
    def __init__(self, module):
        self.cells = module["cells"]
        self.readers = {}
        self.drivers = {}
        self.next_bit = 2
        for name, cell in self.cells.items():
            for port, bits in cell["connections"].items():
                kind = self.readers if cell["port_directions"][port] == "input" else self.drivers
                for bit in bits:
                    kind.setdefault(bit, []).append((name, port))
        for port in module["ports"].values():
            for bit in port["bits"]:
                kind = self.readers if port["direction"] == "output" else self.drivers
                kind.setdefault(bit, []).append((None, None))
        for bit in list(self.readers) + list(self.drivers):
            if bit not in CONSTANTS:
                self.next_bit = max(self.next_bit, bit + 1)

    def new_bit(self):
        self.next_bit += 1
        return self.next_bit - 1

    def new_cell(self, name, kind, parameters, inputs, output):
        port, bit = output
        connections = {**inputs, port: bit}
        self.cells[name] = {
            "type": kind,
            "parameters": parameters,
            "attributes": {},
            "port_directions": {key: "output" if key == port else "input" for key in connections},
            "connections": {key: [value] for key, value in connections.items()},
        }

    def flip_flop_behind(self, bit):
        """The only reader of a bit, if that is a flip-flop."""
        readers = self.readers.get(bit, [])
        if len(readers) != 1 or readers[0][1] not in ("DI", "M"):
            return None
        return readers[0][0] if self.cells[readers[0][0]]["type"] == "TRELLIS_FF" else None

    def flip_flop_before(self, bit):
        drivers = self.drivers.get(bit, [])
        name = drivers[0][0] if drivers else None
        # One that is in a block by now is gone.
        return name if name in self.cells and self.cells[name]["type"] == "TRELLIS_FF" else None


class FlipFlop:
    def __init__(self, netlist, name):
        cell = netlist.cells[name]
        wire = lambda port: cell["connections"].get(port, ["0"])[0]
        parameters = cell["parameters"]
        self.name = name
        self.data = wire("DI")
        self.output = wire("Q")
        self.clock = (wire("CLK"), parameters.get("CLKMUX", "CLK").strip())
        self.enable = "1" if parameters.get("CEMUX", "1").strip() == "1" else wire("CE")
        self.plain = parameters.get("CEMUX", "1").strip() in ("CE", "1") and self.clock[1] == "CLK"
        self.reset = wire("LSR")
        self.over_enable = parameters.get("SRMODE") == "LSR_OVER_CE"
        self.value = parameters.get("REGSET", "RESET").strip()

    @property
    def simple(self):
        """Starts as 0 and is never reset."""
        return self.plain and self.reset == "0" and self.value == "RESET"


def one_register(flip_flops):
    """Clock and enable that all share."""
    kinds = {(ff.clock, ff.enable) for ff in flip_flops}
    return kinds.pop() if len(kinds) == 1 else None


def pack_products(netlist, name, cell):
    wires = cell["connections"]
    products = {port: bits[0] for port, bits in wires.items() if port[0] == "P" and netlist.readers.get(bits[0])}
    behind = {port: netlist.flip_flop_behind(bit) for port, bit in products.items()}
    if not behind or None in behind.values():
        return False
    register = {port: FlipFlop(netlist, ff) for port, ff in behind.items()}
    shared = one_register(register.values())
    if not shared or not all(ff.simple for ff in register.values()):
        return False
    for port, ff in register.items():
        wires[port] = [ff.output]
        del netlist.cells[ff.name]
    clocked(cell, shared, "OUTPUT")
    return True


def pack_operands(netlist, name, cell):
    wires = cell["connections"]
    ports = [f"{operand}{bit}" for operand in "AB" for bit in range(18)]
    driven = {port: wires[port][0] for port in ports if wires[port][0] not in CONSTANTS}
    before = {port: netlist.flip_flop_before(bit) for port, bit in driven.items()}
    if not before or None in before.values():
        return False
    register = {port: FlipFlop(netlist, ff) for port, ff in before.items()}
    shared = one_register(register.values())
    # A constant 1 would start as 0 in a register.
    ones = any(wires[port][0] == "1" for port in ports)
    if not shared or ones or not all(ff.simple for ff in register.values()):
        return False
    for port, ff in register.items():
        wires[port] = [ff.data]
        netlist.readers[ff.output].remove((name, port))
        netlist.readers.setdefault(ff.data, []).append((name, port))
    clocked(cell, shared, "INPUTA", "INPUTB")
    return True


def clocked(cell, shared, *registers):
    (clock, _), enable = shared
    parameters, wires = cell["parameters"], cell["connections"]
    if "CLK0" in wires and (wires["CLK0"], wires["CE0"]) != ([clock], [enable]):
        sys.exit("a multiplier block whose registers differ in clock or enable")
    for port, bit in (("CLK0", clock), ("CE0", enable), ("RST0", "0")):
        wires[port] = [bit]
        cell["port_directions"][port] = "input"
    for register in registers:
        parameters[f"REG_{register}_CLK"] = "CLK0"
        parameters[f"REG_{register}_CE"] = "CE0"
        parameters[f"REG_{register}_RST"] = "RST0"
    parameters["GSR"] = "DISABLED"


def pack_memory(netlist, name, cell):
    wires, parameters = cell["connections"], cell["parameters"]
    outputs = {
        port: bits[0] for port, bits in wires.items() if port[:2] == "DO" and netlist.readers.get(bits[0])
    }
    behind = {port: netlist.flip_flop_behind(bit) for port, bit in outputs.items()}
    if not behind or None in behind.values():
        return False
    register = {port: FlipFlop(netlist, ff) for port, ff in behind.items()}
    shared = one_register(register.values())
    resets = all(ff.plain and (ff.reset == "0" or ff.over_enable) for ff in register.values())
    starts = all(ff.value == "RESET" or ff.reset != "0" for ff in register.values())
    clocks = {wires["CLK" + side][0] for side in "AB"} - set(CONSTANTS)
    if not shared or not resets or not starts or clocks != {shared[0][0]}:
        return False
    (clock, _), enable = shared
    flags = {}
    for port, ff in register.items():
        bit = ff.output
        if ff.reset != "0":
            if ff.reset not in flags:
                flags[ff.reset] = remember(netlist, f"{name}.cleared{len(flags)}", clock, enable, ff.reset)
            bit = netlist.new_bit()
            clear(netlist, ff, bit, flags[ff.reset])
        wires[port] = [bit]
        del netlist.cells[ff.name]
    for side in "AB":
        wires["OCE" + side] = [enable]
        parameters["REGMODE_" + side] = "OUTREG"
        # Words of 36 bits come out at both sides, which have one clock.
        wires["CLK" + side] = [clock]
    return True


def clear(netlist, ff, bit, flag):
    """Makes the output of a flip-flop from that of the block and the flag, if possible in the table that reads it."""
    readers = netlist.readers.get(ff.output, [])
    table = netlist.cells[readers[0][0]] if len(readers) == 1 and readers[0][0] else None
    if table and table["type"] == "LUT4":
        wires = table["connections"]
        place = "ABCD".index(readers[0][1])
        free = next((index for index in range(4) if wires["ABCD"[index]][0] in CONSTANTS), None)
        if free is not None:
            init = int(table["parameters"]["INIT"], 2)
            # The inputs that stay constant, the free one included, are 0 or whatever they are wired to.
            fixed = 1 if wires["ABCD"[free]][0] == "1" else 0
            new = 0
            for inputs in range(16):
                flagged = inputs >> free & 1
                value = inputs >> place & 1
                value = (value | flagged if ff.value == "SET" else value & ~flagged) & 1
                old = inputs & ~(1 << free) & ~(1 << place) | fixed << free | value << place
                new |= (init >> old & 1) << inputs
            table["parameters"]["INIT"] = f"{new:016b}"
            wires["ABCD"[place]] = [bit]
            wires["ABCD"[free]] = [flag]
            netlist.readers[bit] = [(readers[0][0], "ABCD"[place])]
            netlist.readers.setdefault(flag, []).append((readers[0][0], "ABCD"[free]))
            return
    if table and table["type"] == "CCU2C" and readers[0][1][0] in "AB":
        wires = table["connections"]
        operand, half = readers[0][1]
        inverted = wires["C" + half][0]
        # An adder of yosys: the sum of A and B, with B inverted if C is 1; D chooses the half of the table.
        if table["parameters"]["INIT" + half] == f"{0x96AA:016b}" and inverted in "01" and wires["D" + half] == ["1"]:
            init = 0
            for inputs in range(8):
                a, b, flagged = inputs & 1, inputs >> 1 & 1, inputs >> 2
                value = a if operand == "A" else b
                value = (value | flagged if ff.value == "SET" else value & ~flagged) & 1
                other = (b if operand == "A" else a)
                init |= (value ^ other ^ int(inverted)) << 8 + inputs
                # Where both are equal, the carry is either; the table of A and B takes the one without flag.
                carry = b ^ int(inverted) if operand == "A" else a
                init |= carry << (inputs & 3)
            table["parameters"]["INIT" + half] = f"{init:016b}"
            wires[operand + half] = [bit]
            wires["C" + half] = [flag]
            netlist.readers[bit] = [readers[0]]
            netlist.readers.setdefault(flag, []).append((readers[0][0], "C" + half))
            return
    # Input B of the table is the flag; the table ignores C and D.
    init = "1110" * 4 if ff.value == "SET" else "0010" * 4
    inputs = {"A": bit, "B": flag, "C": "0", "D": "0"}
    netlist.new_cell(f"{ff.name}.cleared", "LUT4", {"INIT": init}, inputs, ("Z", ff.output))


def remember(netlist, name, clock, enable, reset):
    """A flip-flop that is 1 if the last enabled clock was a reset; it starts like one."""
    output = netlist.new_bit()
    parameters = {
        "CEMUX": "1" if enable == "1" else "CE",
        "CLKMUX": "CLK",
        "GSR": "DISABLED",
        "LSRMUX": "LSR",
        "REGSET": "SET",
        "SRMODE": "LSR_OVER_CE",
    }
    inputs = {"CLK": clock, "CE": enable, "LSR": reset, "DI": "0"}
    netlist.new_cell(name, "TRELLIS_FF", parameters, inputs, ("Q", output))
    return output


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        design = json.load(file)
    for module in design["modules"].values():
        if "top" not in module["attributes"]:
            continue
        netlist = Netlist(module)
        for kind, pack in (("MULT18X18D", pack_products), ("DP16KD", pack_memory), ("MULT18X18D", pack_operands)):
            found = [(name, cell) for name, cell in netlist.cells.items() if cell["type"] == kind]
            packed = sum(pack(netlist, name, cell) for name, cell in found)
            print(f"{pack.__name__.replace('pack_', '')}: {packed} of {len(found)} {kind}")
        # What was copied into blocks and has no reader any more.
        for name, cell in list(netlist.cells.items()):
            if cell["type"] == "TRELLIS_FF" and not netlist.readers.get(cell["connections"]["Q"][0]):
                del netlist.cells[name]
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        json.dump(design, file)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main()
