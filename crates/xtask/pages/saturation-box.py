#!/usr/bin/env python3
"""How many states of an affine model a box proves free of overflow; see decisions/0013-saturation-stays.md.

    cargo run -p xtask -- saturation-box MODEL SPAN PES

Takes the equations of a step from `pe-synth dump`, puts each value as a sum over states and inputs at the beginning of
the step, and grows the box of largest magnitudes, from the initial values and the whole range of the input ports, until
a step maps it into itself or a state meets the end of its format. A state counts if none of its writes can reach that
end. Formats as they are, and one and two bits wider. Rounding is not in it, so this is what a proof could reach at
most. $PE_SYNTH names a binary to use in place of building one.
"""

import re
import subprocess
import sys
from collections import defaultdict

from common import ROOT, built

GROWTH = 1.05  # from the 200th round on, so that slow growth comes to an end


def dump(program, stage, *options):
    """The lines of a stage, without its header."""
    command = [program, "dump", "--stage", stage, "--only", *options]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[1:]


def linear_forms(step):
    """For each value its coefficients over start values; for each equation its values."""
    forms, writes = {}, defaultdict(list)
    for line in step:
        if not line.startswith("chain "):
            continue
        value, right = re.match(r"chain (?:in \S+: )?(\S+) = (.*)$", line).groups()
        base, weight, terms = re.match(r"(?:(\S+) \+ )?(?:2\^(-?\d+) \* )?\((.*)\)$", right).groups()
        form = defaultdict(float)
        parts = [(1.0, base)] if base else []
        for term in terms.replace(" - ", " + -").split(" + "):
            coefficient, operand = term.split("*", 1)
            parts.append((2.0 ** int(weight or 0) * float(coefficient), operand))
        for factor, operand in parts:
            for name, coefficient in forms.get(operand, {operand: 1.0}).items():
                form[name] += factor * coefficient
        forms[value] = form
        writes[re.sub(r"\.(stage\d+|next|sum\d+)$", "", value)].append(value)
    return forms, writes


def main(model, span, pes):
    program, spec = built(), str(ROOT / f"models/{model}/{model}.spec")
    point = [spec, "--span", span, "--pes", pes, "--multiplier", "25x18", "--tries", "500", "--proof", "off"]
    forms, writes = linear_forms(dump(program, "step", spec, "--span", span))
    mapping = [line.rsplit(" ", 1) for line in dump(program, "mapping", *point)]
    initial = [abs(float(number)) for number in re.findall(r"^state .* initial (\S+)", "\n".join(dump(program, "model", spec)), re.M)]
    words = [line.split() for line in dump(program, "program", *point)]
    bits = next({key: int(count) for key, count in zip(w[1::2], w[2::2])} for w in words if w and w[0] == "format")
    largest = bits["storage"] + bits["guard"] - 1
    formats = {w[1]: 2.0 ** (largest + int(w[3])) for w in words if w and w[0] == "state"}
    inputs = {w[1]: 2.0 ** (bits["storage"] - 1 + int(w[w.index("exponent") + 1])) for w in words if w and w[0] == "input"}

    def bound(value, box):
        reach = lambda name: box.get(name) or inputs.get(name) or abs(float(name.strip('"')))
        return sum(abs(coefficient) * reach(name) for name, coefficient in forms[value].items() if coefficient)

    for wider in range(3):
        ends = {state: limit * 2.0**wider for state, limit in formats.items()}
        box = {state: max(start, ends[state] * 1e-9) for state, start in zip(ends, initial)}
        growing = True
        for turn in range(3000):
            reached = {state: min(ends[state], bound(f"{state}.next", box)) for state in ends}
            growing = any(reached[state] > box[state] for state in ends)
            if not growing:
                break
            for state, size in reached.items():
                if size > box[state]:
                    box[state] = min(ends[state], size * (GROWTH if turn > 200 else 1.0))
        if growing:
            sys.exit("the box has not come to rest")
        proven = {state for state in ends if all(bound(value, box) < ends[state] for value in writes[state])}
        others = {pe for equation, pe in mapping if equation in ends and equation not in proven}
        print(f"{model}, {wider} bits wider: {len(proven)} of {len(ends)} states, {int(pes) - len(others)} of {pes} PEs")


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    main(*sys.argv[1:])
