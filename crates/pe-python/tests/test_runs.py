"""Runs on arrays: the same integers as commands, files and other engines, whatever the arrays look like."""

import csv
import io
import json
import os
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from conftest import HEAD, command, spec

import pe_synth
from pe_synth import host

MODELS = [
    ("lotka_volterra", ["--pes=2", "--span=1s"]),
    ("motor_pid", ["--span=20ms"]),
    ("hodgkin_huxley", ["--span=5ms"]),
    ("lorenz", ["--multiplier=25x18", "--span=1s", "--pipeline=deep"]),
    ("hil_filter", ["--span=20us", "--outputs=memory"]),
]

EARLY = (
    "model robertson\nsolver rodas3\nstep 0.5 ms until 0.01 s, then 0.1 s\nspan 2 s\nstate a = 1\nstate b = 0\n"
    "r = 10*a\na' = -0.04*a + 0.1*b\nb' = 0.04*a - 0.1*b\ninput u = sine(0.1, 1 Hz) in -1 .. 1\nstate c = 0\n"
    "c' = u - c\noutput a, b, c, r\n"
)


def compiled(name, words):
    options = dict(word.removeprefix("--").split("=") for word in words)
    return pe_synth.compile(spec(name), **options)


def same(left, right):
    """Whether two arrays hold the same, and something, that moves."""
    left, right = np.asarray(left), np.asarray(right)
    assert left.shape == right.shape, (left.shape, right.shape)
    assert left.size > 0 and (left != left[0]).any(), "nothing is compared, or something at rest"
    return bool((left == right).all())


def simulated(*words):
    """Numbers of `pe-synth sim` from step 1 on."""
    rows = list(csv.reader(io.StringIO(command("sim", *words))))
    return rows[0][1:], np.array([[float(cell) for cell in row] for row in rows[2:]])


def recorded(folder, name, outputs):
    """Words of the reference trace's outputs in a folder, by step, of words of 32 bits."""
    lines = [line.split() for line in (folder / f"{name}_outputs.txt").read_text().splitlines()]
    words = np.array([int(word, 16) for _, _, word in lines], dtype=np.int64)
    return ((words ^ (1 << 31)) - (1 << 31)).reshape(-1, outputs)


@pytest.mark.parametrize(("name", "words"), MODELS, ids=[name for name, _ in MODELS])
def test_a_run_is_what_the_command_simulates(name, words):
    design = compiled(name, words)
    names, rows = simulated(spec(name), *[word for word in words if "outputs" not in word])
    run = design.run()
    assert [output.name for output in design.outputs] == names
    assert same(run.outputs, rows[:, 1:]) and (run.time == rows[:, 0]).all()
    numbers = run.words * 2.0 ** np.array([output.exponent for output in design.outputs])
    assert same(numbers, run.outputs)
    # A word that differs is noticed.
    for place in [(0, 0), (len(run) // 2, -1), (-1, 0)]:
        changed = run.words.copy()
        changed[place] ^= 1
        assert not same(changed, run.words)


@pytest.mark.filterwarnings("ignore::pe_synth.SpecWarning")
def test_early_steps_are_those_of_the_command(tmp_path):
    (tmp_path / "robertson.spec").write_text(EARLY)
    design = pe_synth.compile(text=EARLY)
    _, rows = simulated(tmp_path / "robertson.spec")
    run = design.run()
    assert same(run.outputs, rows[:, 1:]) and np.allclose(run.time, rows[:, 0], rtol=1e-12)


@pytest.mark.parametrize(("name", "words"), [MODELS[0], MODELS[1]], ids=["two PEs", "sampled"])
def test_files_are_those_of_the_command(name, words, tmp_path):
    design = compiled(name, words)
    design.write(tmp_path / "own", pictures=True)
    command("compile", *words, "-o", tmp_path / "other", "--", spec(name))
    files = sorted(path.relative_to(tmp_path / "other") for path in (tmp_path / "other").rglob("*") if path.is_file())
    files = [file for file in files if file.name != "report-timing.json"]
    assert len(files) > 15
    for file in files:
        assert (tmp_path / "own" / file).read_bytes() == (tmp_path / "other" / file).read_bytes(), file
    words = recorded(tmp_path / "own", name, len(design.outputs))
    assert same(design.run(steps=len(words)).words, words)


def test_states_are_those_of_the_generated_reference(driven, tmp_path):
    driven.write(tmp_path / "design")
    random = np.random.default_rng(7)
    inputs = random.uniform(-1, 1, (50, 2))
    run = driven.run(inputs, states=True, parameters={"k": 33.0})
    with host.open(tmp_path / "design", "fast") as other:
        assert other.hash == driven.hash
        other.write_parameters([33.0])
        outputs, states = [], []
        for row in inputs:
            outputs.append(other.exchange(row.tolist()).outputs)
            states.append(other.snapshot().state[: len(driven.states)])
    assert same(run.outputs, outputs) and same(run.state_words, states)
    offsets = np.array([state.offset for state in driven.states])
    numbers = (run.state_words - offsets) * 2.0 ** np.array([state.exponent for state in driven.states])
    assert same(numbers, run.states) and {state.name: state.initial for state in driven.states}["x"] == 0.5
    # A program of which a bit has changed is another one.
    program = next((tmp_path / "design").glob("*_program.txt"))
    text = program.read_text()
    program.write_text(text.replace("1", "2", 1))
    with pytest.raises(host.Error) as caught:
        host.open(tmp_path / "design")
    assert caught.value.kind == "wrong-hash"


def test_arrays_of_every_layout_give_the_same(driven):
    numbers = np.random.default_rng(3).uniform(-1, 1, (40, 2))
    expected = driven.run(numbers)
    doubled = np.repeat(np.repeat(numbers, 2, axis=0), 3, axis=1)
    layouts = [
        np.asfortranarray(numbers),
        doubled[::2, ::3],
        numbers[::-1].copy()[::-1],
        numbers.astype(">f8"),
        numbers.tolist(),
        {"v": numbers[:, 1], "u": numbers[:, 0]},
    ]
    for layout in layouts:
        assert same(driven.run(layout).words, expected.words)
    read_only = numbers.copy()
    read_only.flags.writeable = False
    assert same(driven.run(read_only).words, expected.words)
    single = numbers.astype(np.float32)
    assert same(driven.run(single).words, driven.run(single.astype(float)).words)
    # What comes back is no window into the network.
    kept = expected.words.copy()
    driven.run(numbers[::-1])
    assert (expected.words == kept).all()


def test_words_and_numbers_of_inputs_are_the_same(driven):
    numbers = np.random.default_rng(5).uniform(-1, 1, (30, 2))
    words = np.round(numbers * 2.0 ** -np.array([port.exponent for port in driven.inputs])).astype(np.int64)
    assert same(driven.run(words).words, driven.run(numbers).words)
    assert same(driven.run({"u": words[:, 0], "v": numbers[:, 1]}).words, driven.run(numbers).words)


def test_inputs_that_are_not_given_are_those_of_the_spec(driven):
    own = driven.run(steps=20)
    t = (np.arange(20)) * 1e-3
    with_u = driven.run({"u": 0.5 * np.sin(2 * np.pi * 50 * t)})
    assert np.abs(own.outputs - with_u.outputs).max() < 1e-6
    assert same(driven.run({"v": 0.25}, steps=20).words, own.words)
    assert not same(driven.run({"v": 0.5}, steps=20).words, own.words)
    assert len(driven.run()) == driven.steps == 20 and driven.step == 1e-3


def test_a_run_goes_on_where_another_ended(driven):
    whole = driven.run(steps=20, states=True, parameters={"k": 50.0})
    first = driven.run(steps=8, parameters={"k": 50.0})
    rest = driven.run(steps=12, states=True, begin=first.end)
    assert same(rest.words, whole.words[8:]) and same(rest.state_words, whole.state_words[8:])
    assert (rest.time == whole.time[8:]).all() and rest.end.state == whole.end.state
    both = driven.run(steps=5, begin=first.end, parameters={"k": 50.0})
    assert same(both.words, whole.words[8:13])
    other = pe_synth.compile(text=HEAD + "state x = 1\nx' = -x\noutput x\n")
    with pytest.raises(host.Error):
        other.run(begin=first.end)


def test_parameters_act_in_their_run_alone(driven):
    before = driven.run(steps=20)
    changed = driven.run(steps=20, parameters={"k": 60.0})
    assert not same(changed.words, before.words)
    assert same(driven.run(steps=20).words, before.words)
    with driven.host() as network:
        assert network.parameters == ["k"] and network.read_parameters()[0] == pytest.approx(20)
    with pytest.warns(pe_synth.RunWarning, match="k beyond the range"):
        assert driven.run(steps=2, parameters={"k": 101.0}).beyond_range == ("k",)
    with pytest.raises(pe_synth.UsageError, match="`x` is no tunable parameter"):
        driven.run(parameters={"x": 1.0})
    with pytest.raises(host.Error, match="k"):
        driven.run(parameters={"k": float("nan")})


@pytest.mark.parametrize(
    ("inputs", "steps", "message"),
    [
        (np.zeros((5, 3)), None, "shape"),
        (np.zeros(5), None, "shape"),
        (np.zeros((5, 2, 1)), None, "shape"),
        ({"u": np.zeros((5, 1))}, None, "shape"),
        ({"u": np.zeros(5), "v": np.zeros(6)}, None, "different numbers of steps"),
        (np.zeros((5, 2)), 6, "5 steps, and the run 6"),
        ({"w": np.zeros(5)}, None, "`w` is no input; inputs are u, v"),
        ({"u": np.zeros(5, dtype=np.int32)}, None, "int32"),
        ({"u": np.zeros(5, dtype=np.uint64)}, None, "uint64"),
        ({"u": np.zeros(5, dtype=complex)}, None, "complex"),
        ({"u": np.zeros(5, dtype=bool)}, None, "bool"),
        ({"u": np.array(["a"])}, None, "type"),
        ({"u": np.array([None])}, None, "object"),
        ({"u": np.array([1.0]).astype("datetime64[s]")}, None, "datetime"),
        (None, -1, "-1 is no number of steps"),
        (None, 2.5, "2.5 is no number of steps"),
        (None, True, "True is no number of steps"),
    ],
)
def test_wrong_arrays_are_told(driven, inputs, steps, message):
    with pytest.raises(pe_synth.UsageError, match=message):
        driven.run(inputs, steps=steps)


def test_numbers_that_are_none_and_those_beyond_limits(driven):
    numbers = np.zeros((10, 2))
    numbers[7, 1] = np.nan
    with pytest.raises(host.Error, match="v") as caught:
        driven.run(numbers)
    assert caught.value.kind == "not-a-number"
    numbers[7, 1] = -np.inf
    with pytest.warns(pe_synth.RunWarning) as told:
        run = driven.run(numbers)
    assert (run.clamped, run.beyond_range) == (("v",), ("v",)) and told[0].filename == __file__
    with pytest.raises(host.Error) as caught:
        driven.run(np.full((3, 2), 2**62, dtype=np.int64))
    assert caught.value.kind == "range"


def test_nothing_and_too_much(driven):
    empty = driven.run(steps=0)
    assert empty.outputs.shape == (0, 2) and empty.end.sample == 0
    assert driven.run(np.zeros((0, 2))).words.shape == (0, 2)
    with pytest.raises(MemoryError):
        driven.run(steps=10**17)
    with pytest.raises((MemoryError, OverflowError)):
        driven.run(steps=2**64)
    # One number of memory for a million steps.
    long = np.broadcast_to(np.array([0.25, 0.5]), (200_000, 2))
    assert len(driven.run(long)) == 200_000


def test_a_run_is_shown(driven):
    run = driven.run(steps=20)
    assert run["x"].shape == (20,) and list(run.to_frame().columns) == ["y", "x"]
    assert run.to_frame().index.name == "t" and repr(run) == "<Run of m: 20 steps>"
    assert "<svg" in run._repr_svg_()
    with pytest.raises(pe_synth.UsageError, match="states=True"):
        run.states
    with pytest.raises(KeyError, match="no output or state 'z'"):
        run["z"]
    with pytest.raises(pe_synth.UsageError):
        driven.run(steps=0).picture()


def test_designs_and_threads_share_nothing(driven):
    inputs = [np.random.default_rng(seed).uniform(-1, 1, (2000, 2)) for seed in range(8)]
    expected = [driven.run(one).words for one in inputs]
    texts = [HEAD + f"state x = {k}\nx' = -{k}*x\noutput x\n" for k in range(1, 5)]
    alone = [pe_synth.compile(text=text).run().words for text in texts]
    with ThreadPoolExecutor(4) as pool:
        runs = [pool.submit(driven.run, one) for one in inputs]
        designs = [pool.submit(pe_synth.compile, text=text) for text in texts]
        for run, words in zip(runs, expected):
            assert same(run.result().words, words)
        for design, words in zip(designs, alone):
            assert same(design.result().run().words, words)
    with driven.host() as one, driven.host() as two:
        one.exchange([1.0, 1.0], 5)
        assert two.sample == 0 and two.read() == list(driven.initial_outputs().values())


def test_python_goes_on_while_a_network_runs(driven):
    counted = 0
    runner = threading.Thread(target=driven.run, kwargs={"steps": 300_000})
    runner.start()
    while runner.is_alive():
        counted += 1
    assert counted > 100


def test_closed_loops_use_the_interface_of_hosts(driven):
    import pe_host
    from pe_host import loops

    assert pe_host.Host is host.Host and pe_host.Error is host.Error and loops.run is host.loops.run
    with driven.host() as network:
        assert (network.inputs, network.outputs) == (["u", "v"], ["y", "x"])
        network.exchange([0.5, 0.5], 3)
        assert network.sample == 3 and network.hash == driven.hash


def test_a_folder_that_is_not_ours_stays(driven, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.txt").write_text("words")
    with pytest.raises(pe_synth.FileError, match="was not written by pe-synth"):
        driven.write(tmp_path / "mine")
    assert os.listdir(tmp_path / "mine") == ["thesis.txt"]
    driven.write(tmp_path / "ours", header=True)
    report = json.loads((tmp_path / "ours/report.json").read_text())
    assert {**driven.report, "files": None} == {**report, "files": None} and "m.h" in report["files"]
    shutil.rmtree(tmp_path / "ours")
