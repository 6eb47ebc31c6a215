#!/usr/bin/env python3
"""Runs test_wrapper.py on wrapped designs, in GHDL and, as netlist, in Verilator.

  testbenches/axi/run.py [--all] [--seed N] [--folder DIR]

Needs what requirements.txt names, GHDL, Verilator and rustc; $PE_SYNTH is the compiler to use. --folder keeps what was built.
--all runs all designs in both.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cocotb_tools.config
import find_libpython

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
HOST = "--host restart,states,flags".split()
# Ticks; a deep pipeline, in which two steps can be under way.
DESIGNS = [
    ("motor_pid", ["--pes", "2", "--span", "100ms", *HOST], ["ghdl"]),
    ("motor_pid", ["--pes", "1", "--span", "100ms", "--pipeline", "deep", *HOST], ["ghdl", "verilator"]),
]


def call(*words, **more):
    subprocess.run([str(word) for word in words], check=True, **more)


def built(folder, model, options):
    """A wrapped design and its reference as a library."""
    pe_synth = os.environ.get("PE_SYNTH", ROOT / "target/debug/pe-synth")
    design, library = folder / "design", folder / "libreference.so"
    quiet = ["--quiet", "--no-pictures"]
    call(pe_synth, "compile", ROOT / f"models/{model}/{model}.spec", *options, *quiet, "-o", design)
    call(pe_synth, "wrap", design, "--stream", "--quiet")
    call("rustc", "-O", "--edition", "2021", "--crate-type", "cdylib", "-o", library, design / f"{model}_reference.rs")
    for line in (design / f"{model}_axi.f").read_text().splitlines():
        library_name, file = line.split(" ", 1)
        call("ghdl", "-a", "--std=08", f"--work={library_name}", design / file, cwd=folder)
    return design, library


def environment_of(top, language, results, more):
    """What cocotb reads from the environment."""
    config = cocotb_tools.config
    return {
        **os.environ,
        **more,
        "COCOTB_TOPLEVEL": top,
        "TOPLEVEL_LANG": language,
        "COCOTB_TEST_MODULES": "test_wrapper",
        "COCOTB_RESULTS_FILE": str(results),
        "PYTHONPATH": os.pathsep.join(sys.path),
        "PYGPI_PYTHON_BIN": sys.executable,
        "GPI_USERS": f"{find_libpython.find_libpython()};{config.pygpi_entry_point()}",
    }


def ghdl(folder, top, more):
    """Runs the VHDL."""
    results = folder / "results_ghdl.xml"
    vpi = f"--vpi={cocotb_tools.config.lib_name_path('vpi', 'ghdl')}"
    words = ["ghdl", "-r", "--std=08", top, vpi, "--ieee-asserts=disable-at-0"]
    call(*words, cwd=folder, env=environment_of(top, "vhdl", results, more))
    return results


def verilator(folder, top, more):
    """Runs GHDL's netlist of it."""
    results, netlist = folder / "results_verilator.xml", folder / f"{top}.v"
    with open(netlist, "w", encoding="utf-8") as file:
        call("ghdl", "--synth", "--std=08", "--out=verilog", top, cwd=folder, stdout=file, stderr=subprocess.DEVNULL)
    libraries = cocotb_tools.config.libs_dir
    link = f"-Wl,-rpath,{libraries} -L{libraries} -lcocotbvpi_verilator"
    words = ["verilator", "--cc", "--exe", "--build", "--vpi", "--public-flat-rw", "--prefix", "Vtop", "-o", "top"]
    words += ["--timescale", "1ns/1ps", "-Wno-fatal", "-Wno-lint", "-Wno-INITIALDLY", "--Mdir", "verilator", "--top-module", top]
    call(*words, "-LDFLAGS", link, HERE / "main.cpp", netlist, cwd=folder, stdout=subprocess.DEVNULL)
    call(folder / "verilator" / "top", cwd=folder, env=environment_of(top, "verilog", results, more))
    return results


def judged(results):
    """Tests that ran; an error if one failed."""
    cases = ElementTree.parse(results).getroot().iter("testcase")
    failed = {case.get("name"): case.find("failure") is not None or case.find("error") is not None for case in cases}
    assert failed and not any(failed.values()), f"failed: {[name for name, wrong in failed.items() if wrong]}"
    return len(failed)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    simulators = {"ghdl": ghdl, "verilator": verilator}
    with tempfile.TemporaryDirectory() as scratch:
        for number, (model, more, some) in enumerate(DESIGNS):
            folder = (options.folder or Path(scratch)).resolve() / str(number)
            folder.mkdir(parents=True, exist_ok=True)
            design, library = built(folder, model, more)
            environment = {"DESIGN": str(design), "LIBRARY": str(library), "NAME": model, "SEED": options.seed}
            # cocotbext-axi uses what cocotb will drop.
            environment["PYTHONWARNINGS"] = "ignore"
            for simulator in simulators if options.all else some:
                count = judged(simulators[simulator](folder, f"{model}_axi", environment))
                print(f"{model} {' '.join(more)}: {count} tests passed in {simulator}", flush=True)


if __name__ == "__main__":
    main()
