"""The page on the package, and the examples, give what they show."""

import doctest
import re
import subprocess
import sys

from conftest import ROOT

EXAMPLES = ROOT / "crates/pe-python/examples"


def test_the_page_shows_what_python_prints(tmp_path, monkeypatch):
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    # What is printed ends at a blank line; on the page it ends with its block.
    text = re.sub(r"^```.*$", "", (ROOT / "docs/python.md").read_text(encoding="utf-8"), flags=re.M)
    page = doctest.DocTestParser().get_doctest(text, {}, "python.md", "python.md", 0)
    runner = doctest.DocTestRunner()
    runner.run(page)
    assert runner.tries > 25 and runner.failures == 0


def printed(name):
    run = subprocess.run([sys.executable, EXAMPLES / name], capture_output=True, text=True, check=True)
    assert run.stderr == "", run.stderr
    return dict(line.split(": ") for line in run.stdout.splitlines())


def test_the_fit_finds_what_made_the_measurement():
    told = printed("fit.py")
    for name, true in [("alpha", 1.1), ("beta", 0.4)]:
        assert abs(float(told[name]) - true) < 0.01, told
    assert float(told["largest residual"]) < 0.1 and int(told["runs"]) > 3


def test_the_pendulum_of_sympy_swings_as_scipy_says():
    told = printed("pendulum.py")
    assert 0 < float(told["largest difference"]) < 1e-3 and int(told["steps"]) == 3000
