"""Checks, and sweeps as frames."""

import io
import os
import signal
import threading
import time

import pandas
import pytest
from conftest import HEAD, command, spec

import pe_synth

POINTS = {"pes": [1, 2], "solver": ["rk4", "heun"], "multiplier": ["25x18", "32x32"], "span": "1s"}
WORDS = ["--pes=1,2", "--solver=rk4,heun", "--multiplier=25x18,32x32", "--span=1s"]


def test_a_sweep_has_the_rows_of_the_command(tmp_path):
    frame = pe_synth.explore(spec("lotka_volterra"), output=tmp_path / "own", jobs=2, **POINTS)
    command("explore", *WORDS, "-q", "-o", tmp_path / "other", "--", spec("lotka_volterra"))
    text = (tmp_path / "other/points.csv").read_text()
    assert (tmp_path / "own/points.csv").read_text() == text
    pandas.testing.assert_frame_equal(frame, pandas.read_csv(io.StringIO(text)))
    assert len(frame) >= 8 and len(frame) == text.count("\n") - 1 and frame["cycles_per_step"].notna().all()
    # Without a folder, too, and a row that differs is noticed.
    again = pe_synth.explore(spec("lotka_volterra"), **POINTS)
    pandas.testing.assert_frame_equal(frame, again)
    again.loc[3, "cycles_per_step"] += 1
    with pytest.raises(AssertionError):
        pandas.testing.assert_frame_equal(frame, again)


def test_error_against_run_time_has_the_rows_of_the_command(tmp_path):
    options = {"solver": ["rk4"], "step": ["10ms", "5ms"], "span": "1s"}
    frame = pe_synth.accuracy(spec("lotka_volterra"), **options)
    words = ["--solver=rk4", "--step=10ms,5ms", "--span=1s"]
    command("accuracy", *words, "-q", "-o", tmp_path / "other", "--", spec("lotka_volterra"))
    expected = pandas.read_csv(tmp_path / "other/accuracy.csv")
    pandas.testing.assert_frame_equal(frame, expected)
    assert len(frame) >= 2


def test_sweeps_that_find_nothing_have_their_rows():
    text = HEAD + "state x = 1\nx' = 1000000*x\noutput x\n"
    with pytest.raises(pe_synth.NoDesign) as caught:
        pe_synth.explore(text=text, pes=[1], solver=["rk4"], multiplier=["32x32"])
    assert len(caught.value.frame) == 3 and caught.value.frame["message"].notna().all()
    with pytest.raises(pe_synth.UsageError, match="output"):
        pe_synth.explore(text=text, resume=True)
    with pytest.raises(pe_synth.UsageError, match="cluster"):
        pe_synth.explore(text=text, cluster="slurm")
    with pytest.raises(pe_synth.SpecError):
        pe_synth.accuracy(text=HEAD)


def test_ctrl_c_keeps_the_points_of_a_sweep(tmp_path):
    options = {**POINTS, "step": [f"{5 / k}ms" for k in range(1, 60)], "jobs": 1, "output": tmp_path / "sweep"}
    options["store"] = tmp_path / "store"

    def interrupt():
        while not list(tmp_path.glob("store/**/*.json")):
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        pe_synth.explore(spec("lotka_volterra"), **options)
    kept = pandas.read_csv(tmp_path / "sweep/points.csv")
    assert 0 < len(kept) < 59 * 8
    # The folder is free, and what is there is not computed again.
    frame = pe_synth.explore(spec("lotka_volterra"), **options, within="1ms", resume=True)
    assert len(frame) >= len(kept)


def test_a_check_is_what_the_command_says():
    result = pe_synth.check(spec("van_der_pol"), step="5ms")
    assert result.verdict == result.result["verdict"] and not result.refused and result.result["solver"] == "rk4"
    printed = command("check", "--step=5ms", "--all", spec("van_der_pol"))
    assert str(result) == printed
    refused = pe_synth.check(spec("van_der_pol"), step=3.0)
    assert refused.refused and refused.findings[0].code.startswith("E09") and "refused" in repr(refused).lower()
