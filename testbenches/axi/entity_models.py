"""Entities of users, what their maps are to say, and what they do, clock by clock."""


def wrapped(number, bits):
    return (number + (1 << bits - 1)) % (1 << bits) - (1 << bits - 1)


class Smoothing:
    """y follows x; outputs depend on the inputs without a register."""

    width, shift, inverts = 16, 3, False

    def __init__(self):
        self.state, self.second, self.ticks = 0, False, 0

    def shows(self, inputs):
        x, gain, slow = inputs
        y = wrapped(-self.state, self.width + 4) if self.inverts else self.state
        return [int(16 * x > self.state), y, (x + gain) % (1 << self.width), self.ticks, slow]

    def clock(self, inputs, _start):
        if self.second:
            bits = self.width + 4
            self.state = wrapped(self.state + (wrapped(16 * inputs[0] - self.state, bits) >> self.shift), bits)
        self.second = not self.second
        self.ticks = (self.ticks + 1) % (1 << 32)


class Narrow(Smoothing):
    """The same with generics."""

    width, shift, inverts = 12, 2, True


class Divider:
    """Takes a clock for each bit of the quotient, leading zeros left out."""

    def __init__(self):
        self.inputs, self.bits, self.result, self.busy = (0, 0), 0, [0, 0], False

    def shows(self, _inputs):
        return list(self.result)

    def ready(self):
        return not self.busy

    def clock(self, inputs, start):
        if start:
            self.inputs, self.bits, self.result, self.busy = tuple(inputs), inputs[0].bit_length(), [0, 0], True
        elif self.bits:
            self.bits -= 1
            front, divisor = self.inputs[0] >> self.bits, self.inputs[1]
            # So many bits make as many of the quotient; without a divisor all are 1.
            ones = (1 << self.inputs[0].bit_length() - self.bits) - 1
            self.result = list(divmod(front, divisor)) if divisor else [ones, front]
        else:
            self.busy = False


class Counter:
    """Ends its steps in one to four clocks; never reset."""

    def __init__(self):
        self.phase, self.turns, self.sum, self.steps = 0, 0, 0, 0

    def shows(self, inputs):
        return [wrapped(self.sum + (inputs[0] if inputs[1] else 0), 64), self.steps]

    def ready(self):
        return self.phase == self.turns

    def clock(self, inputs, _start):
        self.phase += 1
        if self.phase > self.turns:
            self.phase, self.turns = 0, (self.turns + 1) % 4
            self.sum = wrapped(self.sum + inputs[0], 64)
            self.steps += 1


def port(entity_map, name):
    return next(port for port in entity_map["ports"] if port["name"] == name)


def tie(entity_map):
    port(entity_map, "slow")["every"] = 3
    for name, more in (("mode", {"role": "constant", "value": "10"}), ("spare", {"role": "open"})):
        entry = port(entity_map, name)
        declared = entry["declared"]
        entry.clear()
        entry.update({"name": name, "declared": declared, **more})


def smoothing(entity_map):
    tie(entity_map)
    entity_map["clocks"] = 2


def narrow(entity_map):
    tie(entity_map)
    entity_map["clocks"] = 5
    for generic, value in zip(entity_map["generics"], (12, 2, True)):
        generic["value"] = value


def counter(entity_map):
    entity_map["until_ready"] = True
    entry = port(entity_map, "last")
    declared = entry["declared"]
    entry.clear()
    entry.update({"name": "last", "declared": declared, "role": "ready"})


# File, entity, what the map says, model, clocks of a step (0 until it is ready), steps from one word of each input to the next.
ENTITIES = {
    "smoothing": ("smoothing.vhd", "smoothing", smoothing, Smoothing, 2, (1, 1, 3)),
    "narrow": ("smoothing.vhd", "SMOOTHING", narrow, Narrow, 5, (1, 1, 3)),
    "divider": ("divider.vhd", "divider", lambda _: None, Divider, 0, (1, 1)),
    "counter": ("counter.vhd", "\\wire\\", counter, Counter, 0, (1, 1)),
}


class Stepper:
    """An entity, step by step."""

    def __init__(self, name):
        _, _, _, self.model, self.clocks, self.every = ENTITIES[name]
        self.reset()

    def reset(self):
        self.entity, self.done, self.held = self.model(), 0, [0] * len(self.every)

    def run(self, words, steps=1, clocks=None):
        """Outputs after steps with these inputs."""
        for _ in range(steps):
            self.held = [word if self.done % every == 0 else held for word, held, every in zip(words, self.held, self.every)]
            self.done += 1
            shown = self.step(self.clocks if clocks is None else clocks)
        return shown

    def step(self, clocks):
        self.entity.clock(self.held, True)
        self.latency = 2
        while self.latency <= clocks:
            self.entity.clock(self.held, False)
            self.latency += 1
        if clocks:
            return self.entity.shows(self.held)
        while True:
            ready, shown = self.entity.ready(), self.entity.shows(self.held)
            self.entity.clock(self.held, False)
            self.latency += 1
            if ready:
                return shown
