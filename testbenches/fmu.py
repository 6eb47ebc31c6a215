#!/usr/bin/env python3
"""FMUs of several designs in FMPy, against files that know nothing of them.

    testbenches/fmu.py FOLDER [--rate]

Needs fmpy (testbenches/test-all.sh installs it), rustc for the transport `fast`, GHDL for `ghdl`; $PE_SYNTH names a binary.
Descriptions have to be valid; outputs of the first 24 steps are those of NAME_outputs.txt; 1000 steps with inputs that
change in every step give the same integers by every transport, and 100 in GHDL; states are saved and restored, also in
another instance; what is wrong is refused. --rate prints communication steps per second of the motor instead.
"""

import ctypes
import json
import os
import random
import subprocess
import sys
import time
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

ROOT = Path(__file__).resolve().parent.parent
PE_SYNTH = os.environ.get("PE_SYNTH", str(ROOT / "target/debug/pe-synth"))

# States as outputs; sampled blocks; words of two halves and outputs that are no states; early steps; no input at all;
# outputs in memories; parameters.
DESIGNS = {
    "dc_motor": ["models/validation/dc_motor.spec", "--host", "restart,states,flags"],
    "motor_pid": ["models/motor_pid/motor_pid.spec"],
    "lung": ["models/lung/lung.spec", "--storage", "40"],
    "robertson_steps": ["models/validation/robertson_steps.spec"],
    "lorenz": ["models/lorenz/lorenz.spec"],
    "fhn_cube": ["models/validation/fhn_cube.spec", "--pes", "4", "--span", "200ms", "--outputs", "memory"],
    "tuned": ["tuned.spec", "--host", "restart,states"],
}
# Parameters that are written at run time.
TUNED = """\
model tuned
solver rk4
step 1 ms
span 200 ms
param rate [1/s] = 5 tunable in 1 .. 10
param gain = 1 tunable in -2 .. 4
input drive = sine(1, 20 Hz) in -1 .. 1
state x = 1
state y = 0
x' = drive - rate*x
y' = gain*x - 3*y
output x, y
"""


class Unit:
    """An instance of an FMU, alike for both versions."""

    def __init__(self, path, transport="model", token=None, budget=0):
        self.description = read_model_description(str(path))
        self.three = self.description.fmiVersion.startswith("3")
        self.variables = {variable.name: variable for variable in self.description.modelVariables}
        self.messages = []
        self.fmu = (FMU3Slave if self.three else FMU2Slave)(
            guid=token or (self.description.instantiationToken if self.three else self.description.guid),
            unzipDirectory=extract(str(path)), modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="unit", fmiCallLogger=None)
        if self.three:
            self.fmu.instantiate(loggingOn=True, logMessage=self.log3)
        else:
            self.fmu.instantiate(loggingOn=True, callbacks=self.callbacks2())
        self.fmu.setString([1], [transport])
        if budget:
            (self.fmu.setInt32 if self.three else self.fmu.setInteger)([2], [budget])
        if not self.three:
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.time = 0.0

    def log3(self, _environment, _status, _category, message):
        self.messages.append(message.decode())

    def callbacks2(self):
        from fmpy.fmi2 import defaultCallbacks, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

        def log(_environment, _name, _status, _category, message):
            self.messages.append(message.decode())

        callbacks = fmi2CallbackFunctions()
        callbacks.logger = self.kept = fmi2CallbackLoggerTYPE(log)
        callbacks.allocateMemory, callbacks.freeMemory = defaultCallbacks.allocateMemory, defaultCallbacks.freeMemory
        return callbacks

    def numbers(self, names):
        return [self.variables[name].valueReference for name in names]

    def set(self, names, values):
        if names:
            (self.fmu.setFloat64 if self.three else self.fmu.setReal)(self.numbers(names), values)

    def get(self, names):
        return (self.fmu.getFloat64 if self.three else self.fmu.getReal)(self.numbers(names))

    def words(self, names):
        if self.three:
            return self.fmu.getInt64(self.numbers(f"{name}.word" for name in names))
        low = self.fmu.getInteger(self.numbers(f"{name}.word_low" for name in names))
        high = self.fmu.getInteger(self.numbers(f"{name}.word_high" for name in names))
        return [(high << 32) + (low & 0xFFFFFFFF) for low, high in zip(low, high)]

    def step(self, by):
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=by)
        self.time += by

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()


def refused(what, call):
    try:
        call()
    except FMICallException:
        return
    except Exception as error:  # pylint: disable=broad-except
        # FMPy has no class of its own for this one.
        if "Failed to instantiate" in str(error):
            return
        raise
    raise SystemExit(f"fmu.py: {what} was not refused")


def step_at(design, time_now):
    """The length of the step that begins now."""
    early = next((part for part in design["early_steps"] if time_now < part["until"] - 1e-9 * part["step"]), design)
    return early["step"]


def signed(word, bits):
    return word - (1 << bits) if word >> (bits - 1) else word


def outputs_of(design):
    """Names of outputs in the FMU."""
    given = {port["name"] for port in design["inputs"]}
    return [port["name"] + (".output" if port["name"] in given else "") for port in design["outputs"]]


def recorded(folder, design, path):
    """The steps that `compile` recorded: stimulus words in, words of all outputs out."""
    name = design["entity"]
    ports = [port for port in design["inputs"] if port["meaning"] == "quantity"]
    columns = [index for index, port in enumerate(design["inputs"]) if port["meaning"] == "quantity"]
    stimulus = [line.split() for line in (folder / f"{name}_stimulus.txt").read_text().splitlines()]
    shown = [line.split() for line in (folder / f"{name}_outputs.txt").read_text().splitlines()]
    wanted = {(int(step), int(output)): int(word, 16) for step, output, word in shown}
    steps = 1 + max(step for step, _ in wanted)
    unit = Unit(path)
    compared = 0
    for step in range(steps):
        values = []
        for port, column in zip(ports, columns):
            values.append(signed(int(stimulus[step][column], 16), port["bits"]) * 2.0 ** port["exponent"])
        unit.set([port["name"] for port in ports], values)
        unit.step(step_at(design, unit.time))
        for index, word in enumerate(unit.words(outputs_of(design))):
            bits = design["outputs"][index]["bits"]
            if wanted[step, index] != word & ((1 << bits) - 1):
                raise SystemExit(f"fmu.py: {path.name}: step {step}, output {index}: {word:x}, not {wanted[step, index]:x}")
            compared += 1
    unit.close()
    return compared


def played(path, design, transport, steps):
    """Words of all outputs after each step, with inputs that change in every step."""
    source = random.Random(1)
    ports = [port for port in design["inputs"] if port["meaning"] == "quantity"]
    unit = Unit(path, transport)
    words = []
    for step in range(steps):
        tuned = design.get("parameters", []) if step % 40 == 10 else []
        unit.set([one["name"] for one in tuned], [source.uniform(*one["range"]) for one in tuned])
        unit.set([port["name"] for port in ports], [source.uniform(*(port["range"] or port["limits"])) for port in ports])
        unit.step(step_at(design, unit.time))
        words.append(unit.words(outputs_of(design)))
    unit.close()
    return words


def states(path, design):
    """A state is what a unit goes on from, in itself and, as bytes, in another one."""
    names, step = outputs_of(design), design["step"]
    first, second = Unit(path), Unit(path)
    for _ in range(5):
        first.step(step_at(design, first.time))
    three = first.three
    state = first.fmu.getFMUState() if three else first.fmu.getFMUstate()
    saved, before = first.time, first.time
    first.step(step_at(design, before))
    wanted = first.words(names)
    (first.fmu.setFMUState if three else first.fmu.setFMUstate)(state)
    first.time = saved
    first.step(step_at(design, before))
    assert first.words(names) == wanted, f"{path.name}: restored"
    data = (first.fmu.serializeFMUState if three else first.fmu.serializeFMUstate)(state)
    other = (second.fmu.deserializeFMUState if three else second.fmu.deSerializeFMUstate)(data)
    (second.fmu.setFMUState if three else second.fmu.setFMUstate)(other)
    second.time = saved
    second.step(step_at(design, before))
    assert second.words(names) == wanted, f"{path.name}: moved"
    refused("half a step", lambda: second.step(0.5 * step))
    (first.fmu.freeFMUState if three else first.fmu.freeFMUstate)(state)
    first.close()
    second.close()


def rate(path):
    """Communication steps per second: set the input, a step, get the outputs."""
    for transport in ["model", "fast"]:
        unit = Unit(path, transport)
        step = float(unit.description.defaultExperiment.stepSize)
        names = [variable.name for variable in unit.description.modelVariables]
        given = [name for name in names if unit.variables[name].causality == "input"]
        shown = [name for name in names if unit.variables[name].causality == "output" and ".word" not in name]
        numbers = lambda names: (ctypes.c_uint32 * len(names))(*unit.numbers(names))
        sets, gets = numbers(given), numbers(shown)
        values, results = (ctypes.c_double * len(given))(0.5), (ctypes.c_double * len(shown))()
        count, begun = 100_000, time.perf_counter()
        fmu, last = unit.fmu, ctypes.c_double()
        answers = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        for index in range(count):
            if unit.three:
                fmu.fmi3SetFloat64(fmu.component, sets, len(given), values, len(given))
                fmu.fmi3DoStep(fmu.component, index * step, step, True, *answers, ctypes.byref(last))
                fmu.fmi3GetFloat64(fmu.component, gets, len(shown), results, len(shown))
            else:
                fmu.fmi2SetReal(fmu.component, sets, len(given), values)
                fmu.fmi2DoStep(fmu.component, index * step, step, 1)
                fmu.fmi2GetReal(fmu.component, gets, len(shown), results)
        seconds = time.perf_counter() - begun
        print(f"{path.name} {transport}: {count / seconds:,.0f} communication steps/s")


def main(out, *options):
    compared = 0
    for name, (spec, *chosen) in DESIGNS.items():
        folder = Path(out) / name
        run = lambda *command: subprocess.run([PE_SYNTH, *map(str, command)], check=True)
        spec = ROOT / spec
        if name == "tuned":
            spec = Path(out) / "tuned.spec"
            spec.parent.mkdir(parents=True, exist_ok=True)
            spec.write_text(TUNED)
        run("compile", spec, *chosen, "--quiet", "--no-pictures", "-o", folder)
        simulated = name == "dc_motor"
        if simulated:
            run("wrap", folder, "--quiet")
        run("fmu", folder, "--quiet")
        design = json.loads((folder / f"{name}_map.json").read_text())
        units = [folder / f"{name}_fmi{version}.fmu" for version in (2, 3)]
        if options == ("--rate",):
            for path in units[: 2 * simulated]:
                rate(path)
            continue
        plays = []
        for path in units:
            problems = validate_fmu(str(path))
            if problems:
                raise SystemExit(f"fmu.py: {path.name}: {problems}")
            compared += recorded(folder, design, path)
            plays.append(played(path, design, "model", 1000))
            states(path, design)
        plays.append(played(units[0], design, "fast", 1000))
        if len(plays[0]) != 1000 or any(play != plays[0] for play in plays) or plays[0][0] == plays[0][-1]:
            raise SystemExit(f"fmu.py: {name}: versions or transports differ, or nothing moves")
        compared += 2 * 1000 * len(plays[0][0])
        if simulated:
            for path in units:
                if played(path, design, "ghdl", 100) != plays[0][:100]:
                    raise SystemExit(f"fmu.py: {path.name}: GHDL differs")
                compared += 100 * len(plays[0][0])
                refused("a wrong hash", lambda path=path: Unit(path, token="0" * 64))
                refused("a transport that there is not", lambda path=path: Unit(path, "telepathy"))
                unit = Unit(path, budget=1)
                unit.set([design["inputs"][0]["name"]], [1e9])
                unit.step(design["step"])
                unit.step(design["step"])
                told = " ".join(unit.messages)
                if told.count("clamped") != 1 or told.count("time_exceeded") != 2:
                    raise SystemExit(f"fmu.py: {path.name}: warnings are {unit.messages}")
                refused("the past", lambda unit=unit: unit.fmu.doStep(0.0, design["step"]))
                refused("NaN", lambda unit=unit: unit.set([design["inputs"][0]["name"]], [float("nan")]))
                unit.close()
    if options != ("--rate",):
        if compared == 0:
            raise SystemExit("fmu.py compared nothing")
        print(f"{compared} integers compared")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3) or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    main(*sys.argv[1:])
