"""For the scripts of this folder: where the project is, and the programs they run."""

import os
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
