"""Equations of SymPy as specs."""

import numpy as np
import pytest
import sympy
from conftest import ROOT
from scipy.integrate import solve_ivp

import pe_synth

t = sympy.Symbol("t")
x, y, u = (sympy.Function(name)(t) for name in "xyu")
k = sympy.Symbol("k")


def test_a_spec_computes_what_sympy_does():
    right = {
        x: -k * x + sympy.tanh(y) / 2 + sympy.Rational(1, 3) * sympy.sin(3 * t),
        y: sympy.Piecewise((-y, x > 0), (sympy.exp(-(x**2)) - y**2, True))
        + sympy.Min(x, 2 * y, 3)
        - sympy.sqrt(1 + x**2) / 7,
    }
    spec = pe_synth.from_sympy(
        [sympy.Eq(one.diff(t), value) for one, value in right.items()],
        {x: 1, y: 0.5},
        parameters={k: 2},
        step="1 ms",
        span="2 s",
    )
    run = pe_synth.compile(text=spec.text).run()
    f = sympy.lambdify((t, x, y), [value.subs(k, 2) for value in right.values()])
    exact = solve_ivp(lambda t, z: f(t, *z), (0, 2), [1, 0.5], t_eval=run.time.clip(max=2), rtol=1e-9, atol=1e-9)
    assert np.abs(run.outputs - exact.y.T).max() < 1e-4


def test_delays_are_those_of_the_language():
    past = x.func(t - sympy.Rational(1, 2)) + y.func(t - k / 4)
    spec = pe_synth.from_sympy(
        [sympy.Eq(x.diff(t), -past), sympy.Eq(y.diff(t), x - y)],
        {x: 1, y: 0},
        parameters={k: 1},
        step="10 ms",
        span="1 s",
    )
    assert "x(t - 1/2)" in spec.text and "y(t - k/4)" in spec.text
    run = pe_synth.compile(text=spec.text).run(steps=50)
    # Up to then x was 1, and y 0 up to 0.25 s.
    assert np.abs(run.outputs[:25, 0] - (1 - run.time[:25])).max() < 1e-6
    with pytest.raises(pe_synth.UsageError, match="neither a state"):
        pe_synth.from_sympy([sympy.Eq(x.diff(t), x.func(2 * t))], {x: 1})


def test_names_are_made_safe():
    names = ["step", "pi", "\u03bb", "a b", "1x", "x;y", "", "a_20_b", "x'//", "output x\n"]
    states = [sympy.Function(name)(t) for name in names]
    spec = pe_synth.from_sympy(
        [sympy.Eq(one.diff(t), -one) for one in states], {one: 1 for one in states}, name="model", span="10 ms"
    )
    design = pe_synth.compile(text=spec.text)
    assert len(set(spec.names.values())) == len(names) == len(design.outputs)
    assert [output.name for output in design.outputs] == [spec.names[one] for one in states]


def test_keywords_are_those_of_the_grammar():
    from pe_synth.symbolic import _KEYWORDS

    rule = (ROOT / "grammar/ode.pest").read_text().split("keyword = @{")[1].split("}")[0]
    assert set(rule.split('"')[1::2]) | {"pi", "time"} == _KEYWORDS


def test_algebraic_equations_inputs_and_tunable_parameters():
    w = sympy.Function("w")(t)
    spec = pe_synth.from_sympy(
        [sympy.Eq(w, k * (u - x)), sympy.Eq(x.diff(t), w)],
        {x: 0},
        parameters={k: 3},
        tunable={k: (1, 9)},
        inputs={u: "sine(1, 5 Hz) in -1 .. 1"},
        outputs=[x, w],
        span="100 ms",
    )
    design = pe_synth.compile(text=spec.text, host=["states"])
    assert (design.inputs[0].name, design.parameters[0].name) == ("u", "k")
    assert not np.array_equal(design.run().words, design.run(parameters={"k": 8.0}).words)


@pytest.mark.parametrize(
    ("equation", "options", "message"),
    [
        (x + 1, {}, "is no equation"),
        (sympy.Eq(x.diff(t, 2), 1), {}, "left side"),
        (sympy.Eq(x.diff(t), k), {}, "`k` in an equation"),
        (sympy.Eq(x.diff(t), sympy.gamma(x)), {}, "no counterpart"),
        (sympy.Eq(x.diff(t), sympy.Piecewise((1, x > 0))), {}, "last branch"),
        (sympy.Eq(x.diff(t), sympy.oo), {}, "not finite"),
        (sympy.Eq(x.diff(t), sympy.I), {}, "complex|real"),
        (sympy.Eq(x.diff(t), 1), {"inputs": {u: "constant(0)\noutput x"}}, "one line"),
        (sympy.Eq(x.diff(t), 1), {"outputs": [y]}, "has no equation"),
        (sympy.Eq(y.diff(t), 1), {}, "has no initial value"),
        (sympy.Eq(x.diff(t), 1), {"tunable": {k: (0, 1)}}, "no value"),
    ],
)
def test_what_cannot_be_written_is_told(equation, options, message):
    with pytest.raises((pe_synth.UsageError, TypeError), match=message):
        pe_synth.from_sympy([equation], {x: 0}, **options)
