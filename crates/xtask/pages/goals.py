#!/usr/bin/env python3
"""Looks for a design for each of three goals of every small model, judges it, and writes docs/goals.md.

    cargo run -p xtask -- goals search    # compile --max-error E, E = 1e-3, 1e-4, 1e-6: docs/goals.csv
    cargo run -p xtask -- goals judge     # the truth about each design, and an exhaustive grid for each refusal of 1e-3 or 1e-4
    cargo run -p xtask -- goals page      # docs/goals.md

Each model is compiled as it is shipped, with `--max-error` and nothing else, with one thread. What is in docs/goals.csv
already is not done again. A search that takes longer than --seconds of processor time counts as a refusal, a grid that
does stays open. Needs `cargo build --release -p pe-synth --bins --examples`, and two hours of processor time.
"""

import argparse
import collections
import csv
import json
import pathlib
import resource
import subprocess
import tempfile
import textwrap

from common import ROOT, TARGET

TABLE = ROOT / "docs" / "goals.csv"
GOALS = ["1e-3", "1e-4", "1e-6"]

# Models of `models/` that are small enough to be compiled a hundred times, and those of the validation set that are
# not.
SHIPPED = ["harmonic_oscillator", "hodgkin_huxley", "kepler", "lorenz", "lotka_volterra", "lung", "motor_pid", "pendulum",
           "rc_ladder", "van_der_pol", "wave6"]
LARGE = ["brusselator20", "fhn_cube"]

FIELDS = ["model", "goal", "solver", "step_s", "early_steps", "storage_bits", "multiplier", "coefficients", "total", "double",
          "agreement", "tried", "seconds", "message", "true", "known_to", "judged_by", "grid_run", "grid_left_out", "grid_found",
          "commit"]


def problems():
    """Specs by name: shipped models and the validation set."""
    specs = {name: ROOT / "models" / name / f"{name}.spec" for name in SHIPPED}
    for spec in sorted((ROOT / "models" / "validation").glob("*.spec")):
        if spec.stem not in LARGE:
            specs[spec.stem] = spec
    return specs


def limited(seconds):
    """Makes a child process end after so many seconds of processor time."""
    return lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


def run(command, seconds):
    """Exit code, both outputs and processor seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=limited(seconds))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.returncode, done.stdout, done.stderr, used


def search(binary, spec, goal, seconds):
    """The design of a goal as a row."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False).stdout
    row = {"model": spec.stem, "goal": goal, "commit": commit.strip()}
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch) / "out"
        command = [binary, "compile", spec, "--max-error", goal, "--no-pictures", "-q", "-o", out]
        code, _, text, used = run(command, seconds)
        row["seconds"] = f"{used:.1f}"
        if code != 0:
            first = next((line for line in text.splitlines() if line.startswith("error")), "")
            row["message"] = first or f"stopped after {seconds} s"
            return row
        report = json.loads((out / "report.json").read_text())
    error, word = report["error"], report["word"]
    early = ",".join(f"{step['step_s']!r}@{step['until_s']!r}" for step in report["early_steps"])
    row |= {"solver": report["solver"], "step_s": repr(report["step_s"]), "early_steps": early, "storage_bits": word["storage_bits"],
            "multiplier": f"{word['mul_a_bits']}x{word['mul_b_bits']}",
            "coefficients": "two-slot" if word["coefficient_slots"] == 2 else "one-slot",
            "total": f"{error['total']:.2e}", "double": f"{error['double']:.2e}",
            "agreement": f"{error.get('reference_agreement') or 0:.1e}", "tried": report["choice"]["tried"]}
    return row


def judge(example, spec, row, seconds):
    """The true error of a design, or what the grid has for a refusal."""
    if row["solver"]:
        point = ["--solver", row["solver"], "--step", row["step_s"], "--storage", row["storage_bits"], "--multiplier",
                 row["multiplier"], "--coefficients", row["coefficients"], "--widen", "0"]
        point += ["--early-steps", row["early_steps"]] if row["early_steps"] else []
        code, text, _, _ = run([example, "truth", spec, "--goal", row["goal"], *point], seconds)
        words = text.strip().split(maxsplit=2) if code == 0 else []
        row["true"], row["known_to"], row["judged_by"] = words if len(words) == 3 else ("", "", "unknown")
    elif row["goal"] != "1e-6":
        code, text, _, _ = run([example, "grid", spec, "--goal", row["goal"]], seconds)
        words = text.strip().split(maxsplit=2) if code == 0 else ["", "", "stopped"]
        row["grid_run"], row["grid_left_out"], row["grid_found"] = (words + ["none"])[:3]


def right(row):
    """Whether a design meets its goal and is not worse than stated by more than 5 %, as far as that is known."""
    if not row["true"]:
        return None
    true, known = float(row["true"]), float(row["known_to"])
    return true - known <= min(float(row["goal"]), 1.05 * float(row["total"]) + known)


def builds(rows):
    """Lines that say which build made which searches: most come from one, which needs no list."""
    counts = collections.Counter(row["commit"] for row in rows)
    if len(counts) < 2:
        return []
    usual, _ = counts.most_common(1)[0]
    text = "; ".join(f"of {commit} those of " + ", ".join(sorted({row["model"] for row in rows if row["commit"] == commit}))
                     for commit in sorted(counts) if commit != usual)
    text = f"- Searches were made with builds of different commits: of {usual} most; {text}."
    return textwrap.wrap(text, 118, subsequent_indent="  ")


def page(rows):
    """docs/goals.md."""
    designs = [row for row in rows if row["solver"]]
    verdicts = [right(row) for row in designs]
    refused = [row for row in rows if not row["solver"]]
    known = [row for row in refused if row["goal"] != "1e-6"]
    missed = [row for row in known if row["grid_found"] not in ("none", "", "stopped")]
    lines = ["# Goals", "", "Written by `cargo run -p xtask -- goals page` from [goals.csv](goals.csv), which `cargo run -p xtask -- goals search` and",
             "`cargo run -p xtask -- goals judge` make: every small model, compiled as it is shipped with `--max-error E`, one thread.", "",
             "- **stated**: the total error in the report. **true**: the largest difference over all steps to a run in double",
             "  precision with a much smaller step (rk4, rodas3 of stiff models), relative to the largest magnitude of the state; empty",
             "  where no affordable step makes two such runs agree to a twentieth of the goal.",
             "- **grid**: what an exhaustive grid has for a refusal of 1e-3 or 1e-4: all solvers, 20 steps (the spec's times",
             "  2^5 .. 2^-14), words of 24, 32, 36, 40, 48 bits, multipliers 25x18, 25x35, 32x32, 35x35. Assumed are that",
             "  rounding does not cancel more than half of the error in double precision, and that no run takes more than 1e9",
             "  products; points that would are counted as left out.",
             "- Processor seconds are those of a build in the `dev` profile on a loaded machine, with `--seconds 60`",
             "  (beeler_reuter and robertson_steps: 300): a search that took longer was stopped and counts as a refusal. Small",
             "  models that are not in the table have not been tried yet.",
             *builds(rows),
             "- Met and rightly stated: the true error is within the goal, and no more than 5 % above the stated one.",
             "", "| goal | problems | met | true error known | met and rightly stated | refused | refused, grid has one |",
             "|---|---|---|---|---|---|---|"]
    for goal in GOALS:
        own = [row for row in rows if row["goal"] == goal]
        met = [row for row in own if row["solver"]]
        judged = [right(row) for row in met if right(row) is not None]
        found = sum(row in missed for row in own)
        note = found if goal != "1e-6" else ""
        lines.append(f"| {goal} | {len(own)} | {len(met)} | {len(judged)} | {sum(judged)} | {len(own) - len(met)} | {note} |")
    lines += ["", "## Designs", "", "| model | goal | stated | true | by | solver, step, word | tried | s | |",
              "|---|---|---|---|---|---|---|---|---|"]
    for row, verdict in zip(designs, verdicts):
        true = f"{float(row['true']):.1e}" if row["true"] else ""
        note = {True: "", False: "**wrong**", None: "not judged"}[verdict]
        early = "".join(f"{float(step):.3g} s until {float(until):.3g} s, " for step, until in
                        (part.split("@") for part in row["early_steps"].split(",") if part))
        slots = ", two slots" if row["coefficients"] == "two-slot" else ""
        lines.append(f"| {row['model']} | {row['goal']} | {float(row['total']):.1e} | {true} | {row['judged_by']} | {row['solver']}, "
                     f"{early}{float(row['step_s']):.3g} s, {row['storage_bits']} {row['multiplier']}{slots} | {row['tried']} "
                     f"| {row['seconds']} | {note} |")
    lines += ["", "## Refusals", "", "| model | goal | message | grid: run, left out, found | s |", "|---|---|---|---|---|"]
    for row in refused:
        grid = f"{row['grid_run']}, {row['grid_left_out']}, {row['grid_found']}" if row["grid_found"] else ""
        lines.append(f"| {row['model']} | {row['goal']} | {row['message'].replace('|', '/')} | {grid} | {row['seconds']} |")
    (ROOT / "docs" / "goals.md").write_text("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["search", "judge", "page"])
    parser.add_argument("--binary", default=TARGET / "release/pe-synth")
    parser.add_argument("--example", default=TARGET / "release/examples/goals")
    parser.add_argument("--only", default="", help="names of models, with commas between")
    parser.add_argument("--seconds", type=int, default=300, help="processor time of a search, a run or a grid")
    options = parser.parse_args()
    chosen = [name for name in options.only.split(",") if name]
    specs = {name: spec for name, spec in problems().items() if not chosen or name in chosen}
    rows = list(csv.DictReader(TABLE.open())) if TABLE.exists() else []
    rows = [{field: row.get(field) or "" for field in FIELDS} for row in rows]

    def save():
        rows.sort(key=lambda row: (row["model"], -float(row["goal"])))
        with TABLE.open("w", newline="") as file:
            writer = csv.DictWriter(file, FIELDS, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)

    if options.what == "page":
        return page(rows)
    for name, spec in specs.items():
        for goal in GOALS:
            row = next((row for row in rows if (row["model"], row["goal"]) == (name, goal)), None)
            if options.what == "search" and row is None:
                found = search(options.binary, spec, goal, options.seconds)
                rows.append({field: str(found.get(field, "")) for field in FIELDS})
            elif options.what == "judge" and row is not None and not (row["judged_by"] or row["grid_found"]):
                judge(options.example, spec, row, options.seconds)
            else:
                continue
            save()
    return None


if __name__ == "__main__":
    main()
