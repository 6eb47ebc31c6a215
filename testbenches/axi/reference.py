"""The generated reference of a design, as a library in this process: what a wrapper must show."""

import ctypes


class Reference:
    """A network in its initial state; words are integers, as on the ports."""

    def __init__(self, library, name):
        self.library = ctypes.CDLL(str(library))
        self.name = name
        self.call("new").restype = ctypes.c_void_p
        self.network = ctypes.c_void_p(self.call("new")(0))
        self.inputs, self.outputs, self.words = (self.call(what)() for what in ("inputs", "outputs", "state_words"))

    def call(self, what):
        return getattr(self.library, f"{self.name}_{what}")

    def run(self, inputs, steps=1):
        """Runs steps with these inputs; the outputs."""
        given = (ctypes.c_int64 * max(1, self.inputs))(*inputs)
        assert self.call("set_inputs")(self.network, given, self.inputs) == 0
        self.call("step")(self.network, ctypes.c_uint64(steps))
        return self.shown()

    def shown(self):
        words = (ctypes.c_int64 * max(1, self.outputs))()
        assert self.call("get_outputs")(self.network, words, self.outputs) == 0
        return list(words)[: self.outputs]

    def state(self):
        """Stored words of states, then ticks."""
        words = (ctypes.c_int64 * max(1, self.words))()
        assert self.call("get_state")(self.network, words, self.words) == 0
        return list(words)[: self.words]

    def restore(self, words):
        """Replaces all of them."""
        given = (ctypes.c_int64 * max(1, self.words))(*words)
        assert self.call("set_state")(self.network, given, self.words) == 0
