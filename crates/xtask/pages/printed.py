#!/usr/bin/env python3
"""Writes what commands print into README.md and docs/*.md, or compares it.

    cargo run -p xtask -- printed [--check] [--long] [PAGE...]

A block of text under the line `<!-- printed by: COMMAND -->` is what COMMAND prints, on both outputs, in a folder that has the
models and, for each page, what its commands before have written; seconds of stages, and lines that tell what is left, are left out. Python finds
`pe_synth`, which is built where a page asks for it. `--check` changes nothing and fails where a block differs. Blocks under `<!-- printed by, long: COMMAND -->` take minutes and wait for `--long`. $PE_SYNTH
names a binary to use in place of building one; needs GHDL.
"""

import argparse
import difflib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from common import ROOT, built, python_package

BLOCK = re.compile(r"^(?P<mark><!-- printed by(?P<long>, long)?: (?P<command>[^\n]+) -->)\n```text\n(?P<text>.*?)^```$", re.M | re.S)
SECONDS = re.compile(r" +\([0-9.]+ s\)$", re.M)
LEFT = re.compile(r"^ +(?:verify|explore|accuracy)  .+ after [^\n]+ to go\n", re.M)


def printed(command, folder, path):
    environment = {**os.environ, "PATH": path}
    if "python3 models/" in command:
        environment["PYTHONPATH"] = python_package()
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=environment, text=True, check=False,
                          stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    return LEFT.sub("", SECONDS.sub("", done.stdout))


def renewed(page, long, path):
    """The text of a page with its blocks as they are printed now."""
    with tempfile.TemporaryDirectory() as scratch:
        (Path(scratch) / "models").symlink_to(ROOT / "models")
        shutil.copy(ROOT / "models/lung/lung.spec", scratch)

        def renew(block):
            if block["long"] and not long:
                return block[0]
            return f"{block['mark']}\n```text\n{printed(block['command'], scratch, path)}```"

        return BLOCK.sub(renew, page)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--long", action="store_true")
    parser.add_argument("pages", nargs="*", metavar="PAGE")
    options = parser.parse_args()
    pages = [Path(page) for page in options.pages] or [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    blocks, stale = 0, 0
    program = built()
    with tempfile.TemporaryDirectory() as tools:
        (Path(tools) / "pe-synth").symlink_to(program)
        texts = [page.read_text() for page in pages]
        if any("python3 models/" in text for text in texts):
            python_package()
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            renewing = [pool.submit(renewed, text, options.long, f"{tools}:{os.environ['PATH']}") for text in texts]
        for page, before, done in zip(pages, texts, renewing):
            after = done.result()
            blocks += len(BLOCK.findall(before))
            if after == before:
                continue
            stale += 1
            if options.check:
                lines = [text.splitlines(keepends=True) for text in (before, after)]
                sys.stderr.writelines(difflib.unified_diff(*lines, page.name, "what is printed", n=1))
            else:
                page.write_text(after)
                print(f"wrote {page.name}", file=sys.stderr)
    if blocks == 0:
        sys.exit("no block is marked")
    if options.check and stale > 0:
        sys.exit("pages show what is no longer printed: cargo run -p xtask -- printed")


if __name__ == "__main__":
    main()
