"""Drives a wrapper by an independent AXI master, with random stalls on all channels, against the reference.

The environment names the design's folder ($DESIGN), its name ($NAME), the reference as a library ($LIBRARY) and a seed.
"""

import json
import logging
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ClockCycles, RisingEdge, Timer
from cocotbext.axi import AxiLiteBus, AxiLiteMaster, AxiResp, AxiStreamBus, AxiStreamFrame, AxiStreamSink, AxiStreamSource

from reference import Reference

NAME = os.environ["NAME"]
FOLDER = Path(os.environ["DESIGN"])
WRAP = json.loads((FOLDER / f"{NAME}_wrap.json").read_text())
MAP = json.loads((FOLDER / f"{NAME}_map.json").read_text())
REGISTERS = {register["name"]: register for register in WRAP["registers"]}
PATIENCE = 2000


def stalls(randomness):
    """Clocks in which a channel stands still."""
    while True:
        yield randomness.random() < 0.3


def signed(value, bits):
    return value - (1 << bits) if value >> (bits - 1) else value


class Device:
    """A wrapper behind a master that stalls."""

    def __init__(self, dut):
        self.dut = dut
        self.random = random.Random(int(os.environ.get("SEED", "1")))

    async def start(self, stall=True):
        dut = self.dut
        logging.getLogger("cocotb").setLevel(logging.WARNING)
        dut.aresetn.value = 1
        names = "awaddr awvalid wdata wstrb wvalid bready araddr arvalid rready"
        for name in [f"s_axi_{name}" for name in names.split()] + ["s_axis_tdata", "s_axis_tlast", "s_axis_tvalid", "m_axis_tready"]:
            getattr(dut, name).value = 0
        # No edge comes before the inputs have values.
        dut.aclk.value = 0
        await Timer(10, "ns")
        cocotb.start_soon(Clock(dut.aclk, 10, "ns").start())
        # The first 100 ns belong to the global set and reset of cell models.
        await ClockCycles(dut.aclk, 20)
        self.master = AxiLiteMaster(AxiLiteBus.from_prefix(dut, "s_axi"), dut.aclk, dut.aresetn, reset_active_level=False)
        self.source = AxiStreamSource(AxiStreamBus.from_prefix(dut, "s_axis"), dut.aclk)
        self.sink = AxiStreamSink(AxiStreamBus.from_prefix(dut, "m_axis"), dut.aclk)
        for part in (self.master.write_if, self.master.read_if, self.source, self.sink):
            part.log.setLevel(logging.WARNING)
        if stall:
            write, read = self.master.write_if, self.master.read_if
            channels = [write.aw_channel, write.w_channel, write.b_channel, read.ar_channel, read.r_channel]
            for channel in channels + [self.source, self.sink]:
                channel.set_pause_generator(stalls(self.random))
        # Tests share a simulation.
        if WRAP["capabilities"]["restart"]:
            await self.command("RESTART")
            await self.wait("BUSY", False)
        for name, value in (("STATUS", 0xFFFFFFFF), ("MODE", 0), ("RUN_STEPS", 1), ("CLOCK_BUDGET", 0), ("PACE_PERIOD", 0)):
            await self.write(name, value)
        await self.give([0] * len(WRAP["inputs"]))
        return self

    def bits(self, register, names):
        fields = {field["name"]: field["low"] for field in REGISTERS[register]["fields"]}
        return sum(1 << fields[name] for name in names)

    async def try_read(self, address):
        answer = await self.master.read(address, 4)
        if answer.resp != AxiResp.OKAY:
            assert answer.resp == AxiResp.SLVERR
            return None
        return int.from_bytes(answer.data, "little")

    async def try_write(self, address, value):
        answer = await self.master.write(address, (value & 0xFFFFFFFF).to_bytes(4, "little"))
        return answer.resp == AxiResp.OKAY

    async def read(self, name):
        value = await self.try_read(REGISTERS[name]["address"])
        assert value is not None, name
        return value

    async def write(self, name, value):
        assert await self.try_write(REGISTERS[name]["address"], value), name

    async def command(self, *names):
        await self.write("COMMAND", self.bits("COMMAND", names))

    async def mode(self, *names):
        await self.write("MODE", self.bits("MODE", names))

    async def status(self, name):
        return bool(await self.read("STATUS") & self.bits("STATUS", [name]))

    async def wait(self, name, value):
        for _ in range(PATIENCE):
            if await self.status(name) == value:
                return
        raise AssertionError(f"{name} does not become {value}")

    def words(self):
        """Any words of the inputs."""
        return [self.random.randint(low // 4, high // 4) for low, high in (i["words"] for i in MAP["inputs"])]

    async def give(self, words):
        for place, word in zip(WRAP["inputs"], words):
            for half in range(place["words"]):
                assert await self.try_write(place["address"] + 4 * half, word >> 32 * half)

    async def outputs(self):
        values = []
        for place in WRAP["outputs"]:
            halves = [await self.try_read(place["address"] + 4 * half) for half in range(place["words"])]
            none = None in halves
            values.append(None if none else signed(sum(word << 32 * k for k, word in enumerate(halves)), 32 * len(halves)))
        return values

    async def run(self, steps):
        await self.write("RUN_STEPS", steps)
        await self.command("START")
        await self.wait("BUSY", False)

    async def open(self, *modes):
        await self.mode("ACCESS", *modes)
        await self.wait("ACCESS", True)

    async def snapshot(self, *modes):
        """Stored words of states and ticks, and the steps before them."""
        await self.open(*modes)
        order = MAP["host"]["access"]["order"]
        words = [0] * len(order)
        for place in order:
            await self.write("STATE_ADDRESS", place["address"])
            low = await self.read("STATE_LOW")
            words[position(place)] = signed(low | await self.read("STATE_HIGH") << 32, 64)
        steps = await self.read("STEP_COUNT_LOW")
        await self.mode(*modes)
        return steps, words

    async def restore(self, words):
        await self.open()
        for place in MAP["host"]["access"]["order"]:
            word = words[position(place)]
            await self.write("STATE_HIGH", word >> 32)
            await self.wait("STATE_READY", True)
            await self.write("STATE_LOW", word)
        await self.wait("ACCESS", True)
        await self.mode()


def position(place):
    return place["state"] if place["state"] is not None else len(MAP["states"]) + place["tick"]


def reference():
    return Reference(os.environ["LIBRARY"], NAME)


@cocotb.test()
async def accesses(dut):
    """Identity, random bytes of registers, errors."""
    device = await Device(dut).start()
    assert await device.read("ID") == 0x50455348
    digits = "".join([f"{await device.read(f'HASH_{k}'):08x}" for k in range(4)])
    assert digits == WRAP["hash"][:32] == MAP["hash"][:32]
    window = 1 << (WRAP["address_bits"] - 2)
    places = [REGISTERS[name]["address"] for name in ("RUN_STEPS", "CLOCK_BUDGET", "PACE_PERIOD")]
    places += [place["address"] + 4 * half for place in WRAP["inputs"] for half in range(place["words"])]
    content = {}
    for place in places:
        value = device.random.getrandbits(32)
        assert await device.try_write(place, value)
        content[place] = value.to_bytes(4, "little")
    for _ in range(150):
        place, first = device.random.choice(places), device.random.randrange(4)
        data = device.random.randbytes(device.random.randint(1, 4 - first))
        answer = await device.master.write(place + first, data)
        assert answer.resp == AxiResp.OKAY
        content[place] = content[place][:first] + data + content[place][first + len(data) :]
        place = device.random.choice(places)
        assert (await device.master.read(place, 4)).data == content[place]
    inputs, outputs = (4 * sum(place["words"] for place in WRAP[kind]) for kind in ("inputs", "outputs"))
    for address in (0x3FC, window, 2 * window + inputs, 3 * window + outputs, 4 * window - 4):
        assert await device.try_read(address) is None, hex(address)
        assert not await device.try_write(address, 1), hex(address)
    for address in (0, 3 * window):
        assert not await device.try_write(address, 1), hex(address)
    # Both at once, in turns.
    tasks = [cocotb.start_soon(device.try_read(device.random.choice(places))) for _ in range(20)]
    tasks += [cocotb.start_soon(device.try_write(place, 5)) for place in places for _ in range(5)]
    for task in tasks:
        assert await task is not None


@cocotb.test()
async def clocks_of_an_access(dut):
    """At most five clocks from VALID to the response, if the master does not wait."""
    device = await Device(dut).start(stall=False)
    worst = {}
    for kind, valid, answer in (("read", "arvalid", "rvalid"), ("write", "awvalid", "bvalid")):
        for _ in range(20):
            access = device.try_read(0x2C) if kind == "read" else device.try_write(0x2C, 1)
            task = cocotb.start_soon(access)
            clocks = 0
            while True:
                await RisingEdge(dut.aclk)
                clocks += clocks > 0 or bool(getattr(dut, f"s_axi_{valid}").value)
                if clocks and getattr(dut, f"s_axi_{answer}").value:
                    break
            worst[kind] = max(worst.get(kind, 0), clocks)
            await task
    print(f"clocks of an access: {worst}")
    assert max(worst.values()) <= 5


@cocotb.test()
async def runs(dut):
    """Steps with inputs that change every time; n steps; abort; inputs while busy."""
    device, model = await Device(dut).start(), reference()
    done = 0
    for _ in range(25):
        words, steps = device.words(), device.random.choice([1, 1, 1, 2, 3])
        await device.give(words)
        await device.run(steps)
        done += steps
        assert await device.outputs() == model.run(words, steps)
        assert await device.read("STEP_COUNT_LOW") == await device.read("OUTPUT_STEP_LOW") == done
    await device.mode("FREE_RUN")
    words = device.words()
    await device.give(words)
    await device.command("START")
    await device.give(device.words())
    await ClockCycles(dut.aclk, device.random.randint(1, 500))
    await device.command("ABORT")
    await device.wait("BUSY", False)
    ran = await device.read("STEP_COUNT_LOW") - done
    assert ran > 0 and await device.status("ABORTED")
    assert await device.outputs() == model.run(words, ran)
    await device.mode()
    await device.give(words)
    await device.run(1)
    assert await device.outputs() == model.run(words)


@cocotb.test()
async def limits(dut):
    """Clock budget and pace."""
    device, model = await Device(dut).start(), reference()
    await device.run(2)
    model.run([0] * model.inputs, 2)
    latency = await device.read("CLOCKS_LAST")
    await device.write("CLOCK_BUDGET", latency - 1)
    words = device.words()
    await device.give(words)
    await device.run(1)
    assert await device.status("TIME_EXCEEDED") and await device.status("UNFINISHED")
    assert await device.read("STEP_COUNT_LOW") == 2
    await device.write("CLOCK_BUDGET", 0)
    await device.give(device.words())
    await device.write("RUN_STEPS", 1)
    await device.command("START")
    await device.wait("BUSY", False)
    assert await device.outputs() == model.run(words)
    for period, fits in ((latency, True), (latency + 5, True), (latency - 1, False)):
        for modes in (["PACE"], ["PACE", "CONTINUE"]):
            await device.command("CLEAR")
            await device.write("STATUS", 0xFFFFFFFF)
            await device.mode(*modes)
            await device.write("PACE_PERIOD", period)
            words = device.words()
            await device.give(words)
            await device.run(3)
            ran = 3 if fits or "CONTINUE" in modes else 1
            assert await device.outputs() == model.run(words, ran)
            assert await device.status("OVERRUN") != fits
            assert signed(await device.read("SLACK_MIN"), 32) == period - latency


@cocotb.test()
async def states(dut):
    """A snapshot in the middle of a run goes to the reference, and one of the reference comes here; restart."""
    device, model = await Device(dut).start(), reference()
    words = device.words()
    await device.give(words)
    await device.mode("FREE_RUN")
    await device.command("START")
    await ClockCycles(dut.aclk, 300)
    steps, state = await device.snapshot("FREE_RUN")
    model.run(words, steps)
    assert state == model.state()
    await ClockCycles(dut.aclk, 200)
    await device.command("ABORT")
    await device.wait("BUSY", False)
    other = reference()
    other.restore(state)
    assert await device.outputs() == other.run(words, await device.read("STEP_COUNT_LOW") - steps)
    other.run(device.words(), 9)
    await device.restore(other.state())
    assert await device.outputs() == [None] * len(WRAP["outputs"])
    words = device.words()
    await device.give(words)
    await device.mode()
    await device.run(3)
    assert await device.outputs() == other.run(words, 3)
    await device.command("RESTART")
    await device.wait("BUSY", False)
    assert await device.outputs() == [output["initial"] for output in WRAP["outputs"]]
    await device.run(2)
    assert await device.outputs() == reference().run(words, 2)


def frame(words):
    halves = [word >> 32 * half & 0xFFFFFFFF for word, place in zip(words, WRAP["inputs"]) for half in range(place["words"])]
    return AxiStreamFrame(b"".join(half.to_bytes(4, "little") for half in halves))


def values(data):
    place, found = 0, []
    for output in WRAP["outputs"]:
        size = 4 * output["words"]
        found.append(int.from_bytes(data[place : place + size], "little", signed=True))
        place += size
    assert place == len(data)
    return found


@cocotb.test()
async def frames(dut):
    """A frame a step, with stalls on both sides; nothing is lost while nobody takes outputs; short and long frames."""
    device, model = await Device(dut).start(), reference()
    await device.mode("FREE_RUN", "STREAM")
    await device.command("START")
    given = [device.words() for _ in range(60)]
    for words in given:
        await device.source.send(frame(words))
    for words in given[:20]:
        assert values((await device.sink.recv()).tdata) == model.run(words)
    device.sink.clear_pause_generator()
    device.sink.pause = True
    await ClockCycles(dut.aclk, 1500)
    before = await device.read("STEP_COUNT_LOW")
    assert before < 30, "steps that have no place for their outputs"
    device.sink.pause = False
    for words in given[20:]:
        assert values((await device.sink.recv()).tdata) == model.run(words)
    assert not await device.status("FRAME")
    for wrong in (frame(given[0]).tdata[:-4], frame(given[0]).tdata + bytes(8)):
        if wrong:
            await device.source.send(AxiStreamFrame(wrong))
            await ClockCycles(dut.aclk, 100)
            assert await device.status("FRAME")
            await device.write("STATUS", 0xFFFFFFFF)
    await device.source.send(frame(given[0]))
    assert values((await device.sink.recv()).tdata) == model.run(given[0])
    assert await device.read("STEP_COUNT_LOW") == len(given) + 1
    await device.command("ABORT")
    await device.wait("BUSY", False)
