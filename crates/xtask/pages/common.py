"""For the scripts of this folder: where the project is, and the programs they run."""

import functools
import os
import shutil
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
TARGET = ROOT / os.environ.get("CARGO_TARGET_DIR", "target")


def built(variable="PE_SYNTH", program="pe-synth", *options):
    """Path of the program that an environment variable names, or of one that is built."""
    if variable in os.environ:
        return str(Path(os.environ[variable]).resolve())
    subprocess.run(["cargo", "build", "--release", "--quiet", "--package", "pe-synth", *options], cwd=ROOT, check=True)
    return str(TARGET / "release" / program)


@functools.cache
def python_package():
    """A folder from which Python imports `pe_synth`, built in the profile `dev`."""
    subprocess.run(["cargo", "build", "--quiet", "--locked", "--package", "pe-python"], cwd=ROOT, check=True)
    home = TARGET / "pages"
    shutil.copytree(ROOT / "crates/pe-python/python", home, dirs_exist_ok=True)
    shutil.copy(TARGET / "debug/lib_native.so", home / "pe_synth/_native.abi3.so")
    return str(home)
