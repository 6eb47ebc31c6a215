"""What type checkers see of the package."""

import subprocess
import sys
import textwrap

RIGHT = """
    import pe_synth
    from pe_synth.options import ExploreOptions

    design = pe_synth.compile("m.spec", pes=2, step="1 ms", solver="rk4", set={"k": 2}, host=["states"], fit=True)
    wanted: ExploreOptions = {"pes": [1, 2], "storage": [32, 40], "from_": "old.txt"}
    rows = len(pe_synth.explore("m.spec", output="out", **wanted))
    refused: bool = pe_synth.check("m.spec", step=1e-3).refused
    cycles: float = design.step
"""

WRONG = {
    'pe_synth.compile("m.spec", pe=2)': 'Unexpected keyword argument "pe"',
    'pe_synth.compile("m.spec", solver="rk5")': 'Argument "solver"',
    'pe_synth.compile("m.spec", pes="two", seed=1.5)': 'Argument "seed"',
    'pe_synth.compile("m.spec", quiet=True)': 'Unexpected keyword argument "quiet"',
    'pe_synth.check("m.spec", outputs="ports")': 'Unexpected keyword argument "outputs"',
    "pe_synth.compile(1)": "Argument 1",
}


def findings(folder, text):
    (folder / "use.py").write_text(text)
    words = [sys.executable, "-m", "mypy", "--no-incremental", "--follow-imports=silent", "use.py"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True).stdout


def test_right_uses_have_no_findings(tmp_path):
    assert "Success" in (told := findings(tmp_path, textwrap.dedent(RIGHT))), told


def test_wrong_uses_have_one_each(tmp_path):
    told = findings(tmp_path, "import pe_synth\n" + "\n".join(WRONG) + "\n")
    for line, expected in enumerate(WRONG.values(), start=2):
        assert any(row.startswith(f"use.py:{line}:") and expected in row for row in told.splitlines()), told
    assert f"Found {len(WRONG) + 1} errors" in told, told
