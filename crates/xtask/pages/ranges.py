#!/usr/bin/env python3
"""Proofs of ranges of affine models as a table; see decisions/0045-proof-of-ranges.md.

    cargo run -p xtask -- ranges FOLDER [MODEL[:OPTION...]]...

Compiles each model into FOLDER and prints a line from its report: states with a proof, whether it holds for ever, bits by
which formats became wider and what the word-length error was without that, PEs without saturation. Without models all that
are affine, the large ones with a mapping of few tries. $PE_SYNTH names a binary to use in
place of building one.
"""

import json
import os
import subprocess
import sys

from common import ROOT, built

SMALL = ["harmonic_oscillator", "rc_ladder", "lutchen20", "wave6", "wave_fdtd", "heat_plate", "weibel5",
         "weibel5:--multiplier:25x18", "rc_ladder:--multiplier:25x18", "lutchen20:--multiplier:25x18",
         "wave_fdtd:--multiplier:25x18"]
VALIDATION = ["chebyshev", "dc_motor", "decay_chain", "detest_a1", "detest_b2", "detest_c1", "detest_c3", "low_pass",
              "prothero_robinson"]
LARGE = ["weibel11", "weibel11_pressure", "weibel11_square", "lutchen4000", "wave80"]


def spec(model):
    return str(ROOT / "models" / (f"validation/{model}.spec" if model in VALIDATION else f"{model}/{model}.spec"))


def main(folder, *models):
    program = built()
    large = [f"{model}:--tries:200:--pes:64" for model in LARGE]
    print("| model | states proven | for ever | bits wider | word-length error before, with | PEs without saturation |")
    print("|---|---|---|---|---|---|")
    for entry in models or SMALL + [f"{model}:--allow:E0914" for model in VALIDATION] + large:
        model, *options = entry.split(":")
        target = os.path.join(folder, entry.replace(":", "_").replace("-", ""))
        command = [program, "compile", spec(model), "--no-pictures", "--quiet", "-o", target, *options]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        with open(os.path.join(target, "report.json"), encoding="utf-8") as file:
            report = json.load(file)
        ranges, error = report["ranges"], report["error"]["word_length"]
        states = ranges["states"]
        lasts = "yes" if ranges.get("for_ever") else "no"
        named = " ".join([model, *(o for o in options if o == "25x18")])
        bits = f"{ranges['widened_bits']}" if not ranges.get("missing_bits") else f"({ranges['missing_bits']} missing)"
        before = ranges["word_length_before"]
        # Without it, nothing ran in the narrow formats.
        before = "-" if before is None else f"{before:.1e}"
        print(f"| {named} | {states['proven']} of {sum(states.values())} | {lasts} | {bits} "
              f"| {before}, {error:.1e} | {ranges['pes_without_saturation']} of {report['pes']} |",
              flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(*sys.argv[1:])
