#!/usr/bin/env python3
"""How many pairs of lookup tables of a Xilinx netlist can share one: at most five inputs between them.

    crates/xtask/synthesis/count-pairs.py NETLIST.json

Tables that feed a carry chain stay alone, because the chain takes one output of theirs and often an input. A maximal
matching, partners with the most common inputs first: what it finds can be placed, more may be possible.
"""

import json
import sys


def main(name):
    with open(name) as file:
        modules = json.load(file)["modules"]
    pairs = 0
    for module in modules.values():
        if int(str(module.get("attributes", {}).get("blackbox", "0")), 2):
            continue
        cells = module["cells"].values()
        carried = {bit for cell in cells if cell["type"] in ("CARRY4", "MUXF7", "MUXF8", "MUXCY", "XORCY")
                   for port, bits in cell["connections"].items() if cell["port_directions"][port] == "input" for bit in bits}
        tables = []
        for cell in cells:
            if cell["type"][:3] == "LUT" and cell["type"][3:].isdigit() and cell["connections"]["O"][0] not in carried:
                inputs = frozenset(bit for port, bits in cell["connections"].items() if port[0] == "I" for bit in bits)
                if len(inputs) <= 5:
                    tables.append(inputs)
        tables.sort(key=lambda inputs: (-len(inputs), sorted(map(str, inputs))))
        while tables:
            one = tables.pop(0)
            fits = [(len(one | other), index) for index, other in enumerate(tables) if len(one | other) <= 5]
            if fits:
                tables.pop(min(fits, key=lambda fit: (fit[0] - len(tables[fit[1]]), fit))[1])
                pairs += 1
    print(pairs)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
