"""Equations of SymPy as a spec."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from .errors import UsageError

_KEYWORDS = frozenset(
    "model solver step span const index param input state output include function units every next matrix angle "
    "component instance when if then else sum where for in and or not div mod pi time".split()
)
"""Names that a spec cannot define, or has a meaning of its own for."""

_FUNCTIONS = {
    "Abs": "abs",
    "ceiling": "ceil",
    **{name: name for name in "exp log sin cos tan asin acos atan sinh cosh tanh sign floor".split()},
}
"""Functions of one argument, as the language calls them."""

_LONGEST = 200


@dataclass(frozen=True)
class SympySpec:
    """A spec, and what its names stand for."""

    text: str
    names: Mapping[Any, str]
    """By symbol, or by function of time."""

    def __str__(self) -> str:
        return self.text


def from_sympy(
    equations: Iterable[Any],
    initial: Mapping[Any, float],
    *,
    parameters: Mapping[Any, float] | None = None,
    tunable: Mapping[Any, tuple[float, float]] | None = None,
    inputs: Mapping[Any, str] | None = None,
    outputs: Iterable[Any] | None = None,
    time: Any = None,
    name: str = "model",
    solver: str = "rk4",
    step: str = "1 ms",
    span: str = "1 s",
) -> SympySpec:
    """Writes ordinary differential equations as a spec.

    `equations` are `Eq(x(t).diff(t), ...)` for each state, and `Eq(y(t), ...)` for what is computed from these; they are
    solved for nothing. `initial` has the number of every state at time zero, by function; `parameters` the number of every
    other symbol; `tunable` the range of those that a host may change; `inputs` signals in the language of specs, by
    function, such as `{u(t): "sine(1, 2 Hz) in -1 .. 1"}`. `x(t - tau)` is what `x` was some time ago. Outputs are the
    states, if they are not given. `time` is the symbol of the time, `t` if it is not given. Names that a spec does not allow
    get others: `names` of the result has them.
    """
    import sympy

    time = sympy.Symbol("t") if time is None else time
    parameters, tunable, inputs = dict(parameters or {}), dict(tunable or {}), dict(inputs or {})
    states, algebraic = {}, {}
    for equation in equations:
        if not isinstance(equation, sympy.Equality):
            raise UsageError(f"`{equation}` is no equation: `Eq(x(t).diff(t), ...)` is one")
        left = equation.lhs
        if isinstance(left, sympy.Derivative) and left.args[1:] == ((time, 1),):
            states[left.args[0]] = equation.rhs
        elif isinstance(left, sympy.core.function.AppliedUndef):
            algebraic[left] = equation.rhs
        else:
            raise UsageError(f"`{left}` cannot be the left side: it is a first derivative by {time}, or a function of it")
    for what, given in [("initial value", initial), ("equation", {**states, **algebraic})]:
        missing = [state for state in states if state not in given]
        if missing:
            raise UsageError(f"`{missing[0]}` has no {what}")
    if unknown := [one for one in initial if one not in states]:
        raise UsageError(f"`{unknown[0]}` has an initial value and no equation")
    if unknown := [one for one in tunable if one not in parameters]:
        raise UsageError(f"`{unknown[0]}` is tunable and has no value in `parameters`")
    names = _names([*states, *algebraic, *inputs, *parameters])
    known = {**names, time: "time"}
    lines = [f"model {_safe(name, set())}", f"solver {solver}", f"step {step}", f"span {span}", ""]
    for symbol, value in parameters.items():
        ends = tunable.get(symbol)
        range_ = f" tunable in {_number(ends[0])} .. {_number(ends[1])}" if ends else ""
        lines.append(f"param {names[symbol]} = {_number(value)}{range_}")
    lines += [f"input {names[one]} = {_line(signal)}" for one, signal in inputs.items()]
    lines += [f"state {names[one]} = {_number(initial[one])}" for one in states]
    lines += [f"{names[one]} = {_written(value, known)}" for one, value in algebraic.items()]
    lines += [f"{names[one]}' = {_written(value, known)}" for one, value in states.items()]
    shown = list(states) if outputs is None else list(outputs)
    if unknown := [one for one in shown if one not in names]:
        raise UsageError(f"output `{unknown[0]}` has no equation")
    lines.append("output " + ", ".join(names[one] for one in shown))
    return SympySpec("\n".join(lines) + "\n", names)


def _names(symbols: list[Any]) -> dict[Any, str]:
    """A name of its own for each."""
    taken: set[str] = set()
    names = {}
    for symbol in symbols:
        function = getattr(symbol, "func", None)
        own = getattr(function, "__name__", str(symbol)) if symbol.args else symbol.name
        names[symbol] = _safe(str(own), taken)
    return names


def _safe(name: str, taken: set[str]) -> str:
    """A name that specs allow and that is not taken."""
    made = re.sub(r"[^A-Za-z0-9_]", lambda match: f"_{ord(match[0]):x}_", name)[: _LONGEST - 10]
    if not made or made[0].isdigit():
        made = f"v{made}"
    made = f"{made}_" if made in _KEYWORDS else made
    whole, count = made, 1
    while whole in taken:
        count += 1
        whole = f"{made}_{count}"
    taken.add(whole)
    return whole


def _line(text: str) -> str:
    """A text that stays in its statement."""
    if not isinstance(text, str) or any(sign in text for sign in "\n\r\0") or "//" in text:
        raise UsageError(f"{text!r} is no signal on one line")
    return text


def _number(value: Any) -> str:
    number = float(value)
    if number != number or number in (float("inf"), float("-inf")):
        raise UsageError(f"{value} is not finite")
    return repr(number)


_OTHER, _SUM, _PRODUCT, _POWER, _OPERAND = range(5)
"""How tight the outermost operator of an expression is."""


def _written(expression: Any, names: Mapping[Any, str]) -> str:
    """An expression in the language of specs."""
    import sympy

    return _Writer(names).write(sympy.sympify(expression))[0]


class _Writer:
    def __init__(self, names: Mapping[Any, str]) -> None:
        self.names = names

    def within(self, part: Any, least: int) -> str:
        """An expression as an operand of what takes operators of this kind and tighter ones."""
        text, own = self.write(part)
        return text if own >= least else f"({text})"

    def write(self, part: Any) -> tuple[str, int]:
        import sympy

        if part in self.names:
            return self.names[part], _OPERAND
        if part == sympy.pi:
            return "pi", _OPERAND
        if part.is_number and not part.is_Rational:
            return self.number(_number(part))
        if part.is_Integer:
            return self.number(str(int(part)))
        if part.is_Rational or part.is_Mul:
            return self.product(part)
        if part.is_Add:
            return self.sum(part)
        if part.is_Pow:
            return self.power(*part.args)
        if part.is_Piecewise:
            return self.choice(part.args), _OTHER
        if part.is_Relational:
            return f"{self.within(part.lhs, _SUM)} {part.rel_op} {self.within(part.rhs, _SUM)}", _OTHER
        if isinstance(part, (sympy.And, sympy.Or)):
            word = " and " if isinstance(part, sympy.And) else " or "
            return word.join(f"({self.write(one)[0]})" for one in part.args), _OTHER
        if isinstance(part, sympy.Not):
            return f"not ({self.write(part.args[0])[0]})", _OTHER
        if isinstance(part, sympy.core.function.AppliedUndef) and len(part.args) == 1:
            return self.delayed(part), _OPERAND
        arguments = ", ".join(self.write(one)[0] for one in part.args)
        if isinstance(part, (sympy.Max, sympy.Min)):
            return f"{'max' if isinstance(part, sympy.Max) else 'min'}({arguments})", _OPERAND
        name = type(part).__name__
        if part.is_Function and name in _FUNCTIONS and len(part.args) == 1:
            return f"{_FUNCTIONS[name]}({arguments})", _OPERAND
        if part.is_Symbol or isinstance(part, sympy.core.function.AppliedUndef):
            raise UsageError(f"`{part}` in an equation is neither a state, nor an input, nor among `parameters`")
        raise UsageError(f"`{part}` has no counterpart in specs")

    def delayed(self, part: Any) -> str:
        """What a function of time was some time ago: `x(t - tau)`."""
        for time in (symbol for symbol, name in self.names.items() if name == "time"):
            past = time - part.args[0]
            if part.func(time) in self.names and not past.has(time):
                return f"{self.names[part.func(time)]}(t - {self.within(past, _PRODUCT)})"
        raise UsageError(f"`{part}` in an equation is neither a state, nor an input, nor among `parameters`")

    @staticmethod
    def number(text: str) -> tuple[str, int]:
        return text, _SUM if text.startswith("-") else _OPERAND

    def sum(self, part: Any) -> tuple[str, int]:
        text = ""
        for term in part.as_ordered_terms():
            minus = term.could_extract_minus_sign()
            sign = ("-" if minus else "") if not text else (" - " if minus else " + ")
            text += sign + self.within(-term if minus else term, _PRODUCT)
        return text, _SUM

    def product(self, part: Any) -> tuple[str, int]:
        import sympy

        if part.could_extract_minus_sign():
            return f"-{self.within(-part, _PRODUCT)}", _SUM
        above, below = [], []
        for factor in part.args if part.is_Mul else [part]:
            if factor.is_Rational and not factor.is_Integer:
                above += [sympy.Integer(factor.p)] if factor.p != 1 else []
                below.append(sympy.Integer(factor.q))
            elif factor.is_Pow and factor.exp.is_number and factor.exp.is_negative:
                below.append(factor.base ** -factor.exp)
            else:
                above.append(factor)
        text = "*".join(self.within(factor, _POWER) for factor in above) or "1"
        if below:
            under = [self.within(factor, _POWER) for factor in below]
            text += "/" + (under[0] if len(under) == 1 else f"({'*'.join(under)})")
        return text, _PRODUCT

    def power(self, base: Any, exponent: Any) -> tuple[str, int]:
        if exponent.is_number and exponent.is_negative:
            return f"1/{self.within(base**-exponent, _POWER)}", _PRODUCT
        if 2 * exponent == 1:
            return f"sqrt({self.write(base)[0]})", _OPERAND
        return f"{self.within(base, _OPERAND)}^{self.within(exponent, _OPERAND)}", _POWER

    def choice(self, branches: Any) -> str:
        (value, condition), rest = branches[0].args, branches[1:]
        if condition == True:  # noqa: E712, the truth of SymPy
            return self.write(value)[0]
        if not rest:
            raise UsageError("a Piecewise needs a last branch `(..., True)`")
        return f"if {self.write(condition)[0]} then {self.within(value, _SUM)} else {self.choice(rest)}"
