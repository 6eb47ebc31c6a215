#!/usr/bin/env python3
"""Asks `check` about short and long words of all small models, and prints what it refuses and what it lets pass.

    cargo run -p xtask -- words [CASE...]          all cases of the validation set and all small specs in models/, or those named

Builds pe-synth, or takes $PE_SYNTH. Every model is checked with the solver and the step of its spec or case at each of
the words below. A row is a word whose result is refused, or whose error is above 0.02. Takes a quarter of an hour.
"""

import csv
import json
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from common import ROOT, built

STORAGE = (18, 25, 32)
MULTIPLIERS = ("18x18", "25x18", "32x32")
# Longest check in seconds, and models that are judged by their error alone: affine ones, and a second run of the others
# would take too long.
LONGEST = 120
LARGE = ("weibel", "wave80", "lutchen4000", "atrial15", "gray_scott", "heat_plate")


def cases():
    """Name, spec and options of each case whose step is not refused on purpose, then of the specs without one."""
    text = (ROOT / "models/validation/cases.csv").read_text()
    rows = csv.DictReader(
        (line for line in text.splitlines() if not line.startswith("#")), skipinitialspace=True)
    found, seen = [], set()
    for row in rows:
        row = {key.strip(): (value or "").strip() for key, value in row.items()}
        seen.add(row["spec"])
        if row["spec"].startswith(LARGE):
            continue
        if row["verdict"] in ("fine", "W0903", "E0907") and "--multiplier" not in row["options"]:
            found.append((row["case"], row["spec"], shlex.split(row["options"])))
    for spec in sorted((ROOT / "models").glob("*/*.spec")):
        name = str(spec.relative_to(ROOT / "models"))
        if name not in seen and not name.startswith(LARGE):
            found.append((spec.stem, name, []))
    return found


def check(program, spec, options, storage, multiplier):
    """Codes, word-length error, method error and reason of a check; none if it takes too long."""
    command = [program, "check", str(ROOT / "models" / spec), "--message-format", "json", *options,
               "--storage", str(storage), "--multiplier", multiplier, "--allow", "E0907"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
    except subprocess.TimeoutExpired:
        return None
    findings = [json.loads(line) for line in done.stderr.splitlines() if line.startswith("{")]
    result = json.loads(done.stdout) if done.stdout.startswith("{") else {}
    error = result.get("error") or {}
    codes = sorted({finding["code"] for finding in findings if finding.get("code")})
    reason = next((finding["message"] for finding in findings if finding.get("code") in ("E0907", "W0905")), "")
    return codes, error.get("word_length"), error.get("method"), reason


def main():
    program = built()
    chosen = [case for case in cases() if not sys.argv[1:] or case[0] in sys.argv[1:]]
    words = [(storage, multiplier) for storage in STORAGE for multiplier in MULTIPLIERS]
    questions = [(*case, *word) for case in chosen for word in words]
    print("| case | storage | multiplier | word-length error | method error | codes | reason |\n|---|---|---|---|---|---|---|")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        answers = pool.map(lambda question: check(program, *question[1:]), questions)
        for (name, _, _, storage, multiplier), answer in zip(questions, answers):
            if answer is None:
                print(f"| {name} | {storage} | {multiplier} | | | too long | |", flush=True)
                continue
            codes, word, method, reason = answer
            if (word or 0) > 0.02 or any(code.startswith("E") for code in codes):
                shown = ["" if number is None else f"{number:.1e}" for number in (word, method)]
                row = [name, str(storage), multiplier, *shown, " ".join(codes), reason]
                print(f"| {' | '.join(row)} |", flush=True)


main()
