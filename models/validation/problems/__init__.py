"""Problems of the validation set, each with a right-hand side that is written here by hand, apart from its spec."""

import numpy as np

# Two solutions agree to this part of a state's largest magnitude, unless a case says that its own sensitivity forbids
# it.
LIMIT = 1e-10
CASES = {}


class Case:
    """A model: right-hand side, names and initial values of the states, end of the span."""

    def __init__(self, f, names, start, end, methods, published, limit, finest, jumps, period, sample, grid):
        self.grid = grid
        self.f, self.names, self.start, self.end = f, names, np.array(start, float), end
        self.methods, self.published, self.limit, self.finest, self.jumps = methods, published, limit, finest, jumps
        self.period, self.sample = period, sample


def case(name, names, start, end, methods=("DOP853", "LSODA"), published=None, limit=LIMIT, finest=1e-13,
         jumps=(), period=None, sample=None, grid=None):
    """Registers a right-hand side `f(t, y)`, which jumps at `jumps`. `published` is (time, values, relative tolerance).
    With `grid`, the step of the spec, the times of the file follow the solution: multiples of the grid that are dense
    where it is fast.

    At all multiples of `period` the states become `sample(y)`; what is sampled only has the derivative 0."""

    def register(f):
        CASES[name] = Case(f, names.split() if isinstance(names, str) else names, start, end, methods, published,
                           limit, finest, jumps, period, sample, grid)
        return f

    return register


def numbered(name, count, first=1):
    """Names of the elements of an array."""
    return [f"{name}[{k}]" for k in range(first, first + count)]
