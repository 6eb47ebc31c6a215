#!/usr/bin/env python3
"""Writes a folder of single PEs for xtask measure-area.

    cargo run -p xtask -- single_pes FOLDER [SET]

SET is `table1`, the PEs of table I of the paper as ours (default), `shifts`, the same PE with other shift positions, or
`pre_adder`, PEs with and without sums of two operands, `tables`, PEs with and without lookups, `model`, PEs that
the area model is fitted to, `deep`, some of them with the deep pipeline, `widths`, PEs with other multipliers, or
`ports`, PEs with many input ports.
Programs and memory images are random bits, so that no tool can simplify them.
"""

import os
import random
import shutil
import sys
from pathlib import Path

STORAGE, PERIOD = 32, 512


def shape(own=16, base=None, coefficients=0, imported=16, ports=3, shifts="1,2,3,4,5", word=40, data=25, coefficient=18,
          accumulator=43, flags="", indices=0, index=0, octaves=0, pipeline="short"):
    """One PE, its base memory as deep as the own one unless said; flags are among `fpws`: factor, pre-adder,
    swap, send. `indices` words of `index` bits, `octaves` of which count octaves, are the index memory."""
    base = base or own
    return locals()


# The data memory of the paper's PE is ours in two halves: own results and words from other PEs.
TABLE1 = [shape(own=words // 2, imported=words // 2, ports=ports, word=33, flags="s")
          for ports, words in [(3, 32), (3, 64), (3, 128), (3, 1024), (1, 64), (7, 64), (15, 64)]]
# What positions cost: scattered ones need tables of their own.
SHIFTS = [shape(shifts=shifts, flags="s") for shifts in
          ("3", "1,2,3", "1,2,3,4", "1,2,3,4,5", "1,2,3,4,5,6,7,8,9,10,11,12", "0,1,3,4,6,9,10,11,12,13")]
# What sums of two operands cost, on one block each way round and on four.
PRE_ADDER = [shape(data=data, coefficient=coefficient, accumulator=accumulator, flags=flags)
             for data, coefficient, accumulator in [(25, 18, 43), (18, 25, 43), (32, 32, 64)] for flags in ("s", "ps")]
# What the area model is fitted to, beside the shapes of designs: each feature alone and the largest ones together.
MODEL = [
    shape(own=32, ports=2, shifts="1,2,3", word=33, data=18, flags="s", coefficient=25),
    shape(own=32, ports=2, shifts="8,9,10,12,13,15,18", word=33, coefficients=16, flags="fs"),
    shape(own=64, imported=128, ports=5, shifts="10", word=33, flags="ws"),
    shape(own=256, imported=512, ports=2, shifts="10", word=33, flags="s"),
    shape(own=32, ports=1, shifts="9", word=33, flags="s"),
    shape(own=64, imported=64, ports=4, shifts="1,2,3,4,5,6,7,8", word=40, data=32, coefficient=32, accumulator=68,
          coefficients=32, flags="fws"),
    shape(own=32, imported=32, ports=7, shifts="9,10,13,14", word=33, flags="s"),
    shape(own=64, imported=0, ports=0, shifts="8,9,10,11,12", word=33),
]
# What lookups cost: the deep base memory that columns need, then the index memory, and the count of octaves.
TABLES = [shape(own=32, base=base, coefficients=32, flags="fs", data=data, coefficient=coefficient, accumulator=bits,
                indices=indices, index=index, octaves=octaves)
          for data, coefficient, bits in [(25, 18, 43), (32, 32, 64)]
          for base, indices, index, octaves in [(32, 0, 0, 0), (256, 0, 0, 0), (256, 16, 5, 0), (256, 32, 6, 0),
                                                (256, 16, 5, 3), (256, 32, 6, 4)]]
# What the deep pipeline costs.
DEEP = [dict(pe, pipeline="deep") for pe in (
    shape(own=32, ports=2, shifts="1,2,3", word=33, flags="s"),
    shape(flags="ps"),
    shape(data=18, coefficient=25, flags="s"),
    shape(data=32, coefficient=32, accumulator=64, flags="s"),
    shape(own=32, ports=2, shifts="8,9,10,12,13,15,18", word=33, coefficients=16, flags="fs"),
    shape(own=64, imported=0, ports=0, shifts="8,9,10,11,12", word=33),
    shape(own=256, imported=512, ports=2, shifts="10", word=33, flags="s"),
)]
# What other multipliers cost, and coefficients in a memory that nothing writes.
WIDTHS = [
    shape(data=18, coefficient=18, accumulator=40, word=32, ports=2, flags="s"),
    shape(data=18, coefficient=18, accumulator=40, word=32, ports=2, flags="s", pipeline="deep"),
    shape(data=25, coefficient=35, accumulator=63, ports=1, shifts="2,4,9", flags="s"),
    shape(data=25, coefficient=35, accumulator=63, ports=2, flags="s", pipeline="deep"),
    shape(data=24, coefficient=27, accumulator=54, word=35, ports=2, flags="s"),
    shape(data=27, coefficient=24, accumulator=54, word=35, own=32, shifts="3,5", flags="s"),
    shape(own=4, imported=4, ports=1, shifts="6,8,10", word=33, coefficients=16, flags="s"),
    shape(own=8, imported=0, ports=0, shifts="3,5,9,11", data=32, coefficient=32, accumulator=66, coefficients=8, flags="f"),
]
# What choices among more ports cost than a table of six inputs makes.
PORTS = [shape(ports=ports, word=33, flags="s") for ports in (8, 12, 15, 24)]
SETS = {"table1": TABLE1, "ports": PORTS, "shifts": SHIFTS, "pre_adder": PRE_ADDER, "tables": TABLES, "model": MODEL, "deep": DEEP, "widths": WIDTHS}


def index_bits(count):
    return max(count - 1, 0).bit_length()


def write_words(pe):
    factors = pe["coefficients"] if "f" in pe["flags"] else 0
    return max(pe["own"], pe["base"], factors)


def control_bits(pe):
    """Width of a control word, as `control_layout` in hdl/pe_pkg.vhd adds it up."""
    swap, factor = "w" in pe["flags"], "f" in pe["flags"]
    imports = pe["imported"] > 0
    received = imports * (index_bits(pe["imported"]) + 1 + swap)
    indexed = (pe["indices"] > 0) * (2 * (index_bits(pe["indices"]) + 1) + (pe["octaves"] > 0))
    coefficient = index_bits(pe["coefficients"]) if pe["coefficients"] else pe["coefficient"]
    return (index_bits(pe["own"]) + 1 + swap + 2 * received + coefficient + 1 + 1 + index_bits(pe["base"])
            + index_bits(len(pe["shifts"].split(","))) + 2 + factor + swap + index_bits(write_words(pe))
            + indexed + ("s" in pe["flags"]) + index_bits(pe["ports"]))


def words(generator, name, count, bits):
    lines = [f'    {index} => "{generator.getrandbits(bits):0{bits}b}"' for index in range(count)]
    return f"  constant {name} : word_array_t(0 to {count - 1})({bits - 1} downto 0) := (\n" + ",\n".join(lines) + "\n  );\n"


def main(folder, name="table1"):
    root = Path(__file__).resolve().parents[3]
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(os.path.join(folder, "hdl"))
    libraries = ["pe_pkg", "pe_write_pkg", "pe_style_pkg", "pe_replica", "pe_ram", "pe_rom", "pe_multiplier", "pe_index", "pe_coefficient", "pe_scale", "pe"]
    for library in libraries:
        shutil.copy(root / "hdl" / f"{library}.vhd", os.path.join(folder, "hdl"))
    generator = random.Random(1)
    constants, lines = [], []
    for index, pe in enumerate(SETS[name]):
        bits = control_bits(pe)
        constants += [words(generator, f"PE{index}_STREAM", PERIOD, bits),
                      words(generator, f"PE{index}_OWN_IMAGE", pe["own"], pe["data"]),
                      words(generator, f"PE{index}_BASE_IMAGE", pe["base"], pe["word"]),
                      words(generator, f"PE{index}_COEFFICIENT_IMAGE", max(pe["coefficients"], 1), pe["coefficient"]),
                      words(generator, f"PE{index}_IMPORTED_IMAGE", max(pe["imported"], 1), pe["data"])]
        flags = [f"{flag}={str(flag[0 if flag != 'swap' else 1] in pe['flags']).lower()}"
                 for flag in ("factor", "pre_adder", "swap", "send")]
        lines.append(f"shape={index} count=1 example={index} storage_bits={STORAGE} word_bits={pe['word']} "
                     f"data_bits={pe['data']} coefficient_bits={pe['coefficient']} own_words={pe['own']} "
                     f"base_words={pe['base']} coefficient_words={pe['coefficients']} "
                     f"imported_words={pe['imported']} ports={pe['ports']} shifts={pe['shifts']} "
                     f"accumulator_bits={pe['accumulator']} {' '.join(flags)} base_last=false program_words={PERIOD} "
                     f"program_bits={bits} rounds=1 streamed_bits={bits}"
                     + f" index_words={pe['indices']} index_bits={pe['index']} octave_bits={pe['octaves']}"
                     * (pe["indices"] > 0)
                     + " pipeline=deep" * (pe["pipeline"] == "deep"))
    with open(os.path.join(folder, f"{name}_program_pkg.vhd"), "w") as file:
        file.write("library ieee;\nuse ieee.std_logic_1164.all;\nlibrary pe_lib;\nuse pe_lib.pe_pkg.all;\n\n"
                   f"package {name}_program_pkg is\n  constant PERIOD : positive := {PERIOD};\n  constant ROUNDS : positive := 1;\n")
        file.writelines(constants)
        file.write(f"end package {name}_program_pkg;\n")
    with open(os.path.join(folder, f"{name}.f"), "w") as file:
        file.writelines(f"pe_lib hdl/{library}.vhd\n" for library in libraries)
        file.write(f"work {name}_program_pkg.vhd\n")
    with open(os.path.join(folder, f"{name}_shapes.txt"), "w") as file:
        file.writelines(line + "\n" for line in lines)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(*sys.argv[1:])
