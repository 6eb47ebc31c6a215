"""What is wrong is an exception with its place, what is doubtful a warning, and Ctrl-C ends what takes long."""

import os
import pickle
import signal
import threading
import time
import warnings

import pytest
from conftest import HEAD, spec

import pe_synth

BROKEN = HEAD + "state x = 1\nx' = -y*x\nz = \u00e4\noutput x\n"


def test_errors_have_a_code_a_place_and_help():
    with pytest.raises(pe_synth.SpecError) as caught:
        pe_synth.compile(text=BROKEN, name="lib/broken.spec")
    error = caught.value
    assert (error.code, error.message, error.file) == ("E0201", "unknown name `y`", "lib/broken.spec")
    assert (error.line, error.column) == (6, 7) and BROKEN.encode()[slice(*error.span)] == b"y"
    assert [finding.code for finding in error.findings] == ["E0201", "E0102"] and error.findings[1].help
    assert "6 | x' = -y*x" in str(error) and "\x1b" not in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert again.findings == error.findings and error.kind == "model"


def test_errors_of_files_and_of_the_step(tmp_path):
    (tmp_path / "m.spec").write_text(HEAD + 'include "part.spec"\noutput x\n')
    (tmp_path / "part.spec").write_text("state x = 1\nx' = q\n")
    with pytest.raises(pe_synth.SpecError) as caught:
        pe_synth.compile(tmp_path / "m.spec")
    assert os.path.basename(caught.value.file) == "part.spec" and caught.value.line == 2
    with pytest.raises(pe_synth.SpecError) as caught:
        pe_synth.compile(spec("van_der_pol"), step=3.0)
    assert caught.value.code.startswith("E09") and caught.value.help
    with pytest.raises(pe_synth.FileError, match="no such file") as caught:
        pe_synth.compile(tmp_path / "other.spec")
    assert isinstance(caught.value, OSError) and caught.value.kind == "file"
    with pytest.raises(pe_synth.FileError):
        pe_synth.compile(tmp_path)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pess": 2}, "similar argument exists: '--pes'"),
        ({"pes": 0}, "invalid value '0'"),
        ({"solver": "euler2"}, "invalid value"),
        ({"step": "-1ms"}, "invalid value"),
        ({"set": {"mu": "a"}}, "not a number"),
        ({"quiet": True}, "nothing is printed"),
        ({"text": "model m"}, "not both"),
        ({"pes": object()}, "cannot be a object"),
        ({"step": float("nan")}, "invalid value"),
        ({"fit": True}, "--device"),
    ],
)
def test_options_that_are_wrong(options, message):
    with pytest.raises(pe_synth.UsageError, match=message):
        pe_synth.compile(spec("van_der_pol"), **options)


def test_options_are_those_of_the_command():
    design = pe_synth.compile(spec("van_der_pol"), solver="heun", step="2ms", span="1s", set={"mu": 2}, observe=["y"])
    assert design.report["command"] == (
        "pe-synth compile --solver=heun --step=2ms --span=1s --set=mu=2 --observe=y -- van_der_pol.spec"
    )
    assert (design.report["solver"], design.step, design.outputs[0].name) == ("heun", 2e-3, "y")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\0" * 100,
        "model " + "x" * 10_000,
        HEAD + "state x = " + "(" * 100_000,
        HEAD + "x = " + "-" * 100_000 + "1",
        HEAD + 'include "../../etc/passwd"\n',
        HEAD + 'include "/etc/passwd"\n',
        HEAD + "index k in 1..1000000000000\nstate x[k] = 0\nx[k]' = 0\noutput x\n",
        "model m\u202e\ud7ff\n",
        "a" * ((16 << 20) + 1),
    ],
    ids=range(10),
)
def test_hostile_texts_are_refused(text):
    with pytest.raises(pe_synth.SpecError) as caught:
        pe_synth.compile(text=text)
    assert caught.value.code and len(str(caught.value)) < 100_000


def test_texts_that_are_none():
    with pytest.raises(UnicodeEncodeError):
        pe_synth.compile(text="model \ud800")
    with pytest.raises(pe_synth.UsageError):
        pe_synth.compile(text=b"model m")
    with pytest.raises(pe_synth.UsageError, match="its path"):
        pe_synth.compile(HEAD)
    with pytest.raises(pe_synth.UsageError, match="SPEC"):
        pe_synth.compile()
    with pytest.raises(pe_synth.FileError):
        pe_synth.compile("-")


def test_names_of_a_spec_are_no_markup():
    title = '<script>alert(1)</script>"'.replace('"', "&quot;")
    design = pe_synth.compile(text=f'model m "{title}"\n' + HEAD.split("\n", 1)[1] + "state x = 1\nx' = -x\noutput x\n")
    page = design._repr_html_()
    assert "<script" not in page and page.count("<img") >= 1
    for picture in design.pictures.values():
        assert picture._repr_svg_().startswith("<svg") or "<svg" in picture.svg
        assert "<script" not in picture.svg


def test_warnings_are_warnings_of_the_caller():
    text = HEAD + "state x = 1\nconst half = 7 // 2\nx' = -half*x\noutput x\n"
    with pytest.warns(pe_synth.SpecWarning, match="nothing is divided") as told:
        pe_synth.compile(text=text)
    assert told[0].filename == __file__ and told[0].message.finding.code == "W0007"
    assert told[0].message.finding.line == 6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(pe_synth.SpecWarning):
            pe_synth.compile(text=text)


@pytest.mark.parametrize("what", ["compile", "run", "check"])
def test_ctrl_c_ends_it(what, driven):
    long = HEAD.replace("span 20 ms", "span 100000 s") + "state x = 1\nstate y = 0\nx' = y\ny' = -x\noutput x\n"
    work = {
        "compile": lambda: pe_synth.compile(text=long),
        "check": lambda: pe_synth.check(text=long),
        "run": lambda: driven.run(steps=50_000_000),
    }[what]
    timer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        timer.start()
        work()
    assert time.monotonic() - begin < 3.0
    # What was left ends by itself: nothing uses the processor for long.
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        before = time.process_time()
        time.sleep(0.2)
        if time.process_time() - before < 0.05:
            break
    else:
        pytest.fail("work goes on that nobody waits for")
    assert len(driven.run(steps=3)) == 3
