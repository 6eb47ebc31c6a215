#!/usr/bin/env python3
"""Writes a folder of single PEs for hdl/measure-area.sh: the PEs of table I of the paper, as ours.

    docs/single_pes.py FOLDER

Programs and memory images are random bits, so that no tool can simplify them. The data memory of the paper's PE is ours
in two halves: own results and words from other PEs.
"""

import os
import random
import shutil
import sys

WORD, DATA, COEFFICIENT, PERIOD = 40, 25, 18, 512
SHIFTS = [1, 2, 3, 4, 5]
# Input ports and words of data memory.
PES = [(3, 32), (3, 64), (3, 128), (3, 1024), (1, 64), (7, 64), (15, 64)]


def index_bits(count):
    return (count - 1).bit_length()


def control_bits(ports, own, imported):
    """Width of a control word with a send field, as `control_layout` in hdl/pe_pkg.vhd adds it up."""
    address, receive = index_bits(own) + 1, index_bits(imported) + 1
    return index_bits(ports) + 2 * receive + 1 + 3 * address + index_bits(len(SHIFTS)) + 1 + COEFFICIENT


def words(generator, name, count, bits):
    lines = [f'    {index} => "{generator.getrandbits(bits):0{bits}b}"' for index in range(count)]
    return f"  constant {name} : word_array_t(0 to {count - 1})({bits - 1} downto 0) := (\n" + ",\n".join(lines) + "\n  );\n"


def main(folder):
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(os.path.join(folder, "hdl"))
    libraries = ["pe_pkg", "pe_ram", "pe_rom", "pe_multiplier", "pe"]
    for name in libraries:
        shutil.copy(os.path.join(root, "hdl", name + ".vhd"), os.path.join(folder, "hdl"))
    generator = random.Random(1)
    constants, shapes = [], []
    for index, (ports, data) in enumerate(PES):
        own = imported = data // 2
        bits = control_bits(ports, own, imported)
        constants += [words(generator, f"PE{index}_PROGRAM", PERIOD, bits),
                      words(generator, f"PE{index}_OWN_IMAGE", own, WORD),
                      words(generator, f"PE{index}_IMPORTED_IMAGE", imported, DATA)]
        shapes.append(f"shape={index} count=1 example={index} storage_bits=32 word_bits={WORD} data_bits={DATA} "
                      f"coefficient_bits={COEFFICIENT} own_words={own} imported_words={imported} ports={ports} "
                      f"shifts={','.join(map(str, SHIFTS))} accumulator_bits=43 factor=false swap=false send=true "
                      f"program_words={PERIOD} program_bits={bits}")
    with open(os.path.join(folder, "table1_program_pkg.vhd"), "w") as file:
        file.write("library ieee;\nuse ieee.std_logic_1164.all;\nlibrary pe_lib;\nuse pe_lib.pe_pkg.all;\n\n"
                   "package table1_program_pkg is\n"
                   f"  constant WORD_BITS : positive := {WORD};\n  constant DATA_BITS : positive := {DATA};\n"
                   f"  constant COEFFICIENT_BITS : positive := {COEFFICIENT};\n  constant PERIOD : positive := {PERIOD};\n")
        file.writelines(constants)
        file.write("end package table1_program_pkg;\n")
    with open(os.path.join(folder, "table1.f"), "w") as file:
        file.writelines(f"pe_lib hdl/{name}.vhd\n" for name in libraries)
        file.write("work table1_program_pkg.vhd\n")
    with open(os.path.join(folder, "table1_shapes.txt"), "w") as file:
        file.writelines(shape + "\n" for shape in shapes)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
