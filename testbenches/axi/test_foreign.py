"""Drives the wrapper of a user's entity by an independent AXI master, with random stalls on all channels, against a model.

The environment names the design's folder ($DESIGN), its name ($NAME), the entity in entity_models.py ($ENTITY) and a seed.
"""

import os

import cocotb
from cocotb.triggers import ClockCycles
from cocotbext.axi import AxiStreamFrame

from entity_models import Stepper
from test_wrapper import MAP, WRAP, Device, frame, signed, values

CAPS = next(register["fields"] for register in WRAP["registers"] if register["name"] == "CAPS")
# An entity without a reset goes on from one test to the next.
MODEL = Stepper(os.environ["ENTITY"])


class Foreign(Device):
    async def start(self, stall=True):
        await super().start(stall)
        if WRAP["capabilities"]["restart"]:
            MODEL.reset()
        return self

    def words(self):
        """Any words, those at the ends among them, of all lengths."""
        words = []
        for low, high in (port["words"] for port in MAP["inputs"]):
            any_word = self.random.randint(low, high) >> self.random.randint(0, high.bit_length() - 1)
            words.append(self.random.choice([low, high, any_word, any_word, any_word]))
        return words


@cocotb.test()
async def accesses(dut):
    """Identity, and clocks of a step."""
    device = await Foreign(dut).start()
    assert await device.read("ID") == 0x50455348
    digits = "".join([f"{await device.read(f'HASH_{k}'):08x}" for k in range(4)])
    assert digits == WRAP["hash"][:32] == MAP["hash"][:32]
    caps = await device.read("CAPS")
    has = WRAP["capabilities"]
    for field in (field for field in CAPS if field["bits"] == 1):
        assert bool(caps >> field["low"] & 1) == has[field["name"].lower()], field
    place = next(register["address"] for register in WRAP["registers"] if register["name"] == "STEP_CLOCKS")
    assert await device.read("STEP_CLOCKS") == MODEL.clocks
    assert await device.try_write(place, 0) == has["ready"]
    answer = await device.master.write(place + 1, b"\x02")
    assert answer.resp == 0
    assert await device.read("STEP_CLOCKS") == (0 if has["ready"] else MODEL.clocks) + 0x200
    for clocks in (3, 6):
        await device.write("STEP_CLOCKS", clocks)
        words = device.words()
        await device.give(words)
        await device.run(1)
        assert await device.outputs() == MODEL.run(words, clocks=clocks)
        assert await device.read("CLOCKS_LAST") == MODEL.latency == clocks + 1
    await device.write("STEP_CLOCKS", MODEL.clocks)


@cocotb.test()
async def runs(dut):
    """Steps with inputs that change every time; n steps; inputs while busy; abort; restart."""
    device = await Foreign(dut).start()
    start = await device.read("STEP_COUNT_LOW")
    begun = MODEL.done
    for _ in range(30):
        words, steps = device.words(), device.random.choice([1, 1, 1, 2, 3])
        await device.give(words)
        await device.run(steps)
        assert await device.outputs() == MODEL.run(words, steps)
        assert await device.read("STEP_COUNT_LOW") - start == MODEL.done - begun
    for _ in range(3):
        done = await device.read("STEP_COUNT_LOW")
        await device.mode("FREE_RUN")
        words = device.words()
        await device.give(words)
        await device.command("START")
        await device.give(device.words())
        await ClockCycles(dut.aclk, device.random.randint(1, 100))
        await device.command("ABORT")
        await device.wait("BUSY", False)
        ran = await device.read("STEP_COUNT_LOW") - done
        assert ran > 0 and await device.outputs() == MODEL.run(words, ran)
        await device.mode()
    # Inputs that are taken in the middle of a step act in the next one; each step has three clocks at least.
    for clocks in (1, 2, 3):
        first, second = device.words(), device.words()
        await device.give(first)
        await device.mode("HALT")
        await device.write("RUN_STEPS", 2)
        await device.command("START")
        await device.write("SINGLE_CLOCKS", clocks)
        await device.wait("CLOCKING", False)
        await device.give(second)
        await device.command("INPUTS")
        await device.mode()
        await device.wait("BUSY", False)
        MODEL.run(first)
        assert await device.outputs() == MODEL.run(second), clocks
    if WRAP["capabilities"]["restart"]:
        await device.command("RESTART")
        await device.wait("BUSY", False)
        MODEL.reset()
        assert await device.outputs() == [None] * len(WRAP["outputs"])
        words = device.words()
        await device.give(words)
        await device.run(2)
        assert await device.outputs() == MODEL.run(words, 2)


@cocotb.test()
async def limits(dut):
    """Clock budget and pace."""
    device = await Foreign(dut).start()
    for budget in (1, 2):
        words = device.words()
        await device.give(words)
        await device.write("CLOCK_BUDGET", budget)
        await device.run(1)
        assert await device.status("TIME_EXCEEDED") and await device.status("UNFINISHED")
        await ClockCycles(dut.aclk, 50)
        await device.write("STATUS", 0xFFFFFFFF)
        await device.write("CLOCK_BUDGET", 0)
        await device.give(device.words())
        await device.run(1)
        assert await device.outputs() == MODEL.run(words)
    # A time that does not vary: by clocks.
    await device.write("STEP_CLOCKS", 4)
    for period, fits in ((5, True), (9, True), (4, False)):
        for modes in (["PACE"], ["PACE", "CONTINUE"]):
            await device.command("CLEAR")
            await device.write("STATUS", 0xFFFFFFFF)
            await device.mode(*modes)
            await device.write("PACE_PERIOD", period)
            words = device.words()
            await device.give(words)
            await device.run(3)
            ran = 3 if fits or "CONTINUE" in modes else 1
            assert await device.outputs() == MODEL.run(words, ran, 4)
            assert await device.status("OVERRUN") != fits
            assert signed(await device.read("SLACK_MIN"), 32) == period - 5
    await device.mode()
    await device.write("STEP_CLOCKS", MODEL.clocks)


@cocotb.test()
async def frames(dut):
    """A frame a step, with stalls on both sides; nothing is lost while nobody takes outputs."""
    device = await Foreign(dut).start()
    await device.mode("FREE_RUN", "STREAM")
    await device.command("START")
    given = [device.words() for _ in range(50)]
    for words in given:
        await device.source.send(frame(words))
    for words in given[:20]:
        assert values((await device.sink.recv()).tdata) == MODEL.run(words)
    device.sink.clear_pause_generator()
    device.sink.pause = True
    await ClockCycles(dut.aclk, 1500)
    device.sink.pause = False
    for words in given[20:]:
        assert values((await device.sink.recv()).tdata) == MODEL.run(words)
    assert not await device.status("FRAME")
    await device.source.send(AxiStreamFrame(frame(given[0]).tdata[:-4]))
    await ClockCycles(dut.aclk, 100)
    assert await device.status("FRAME")
    await device.write("STATUS", 0xFFFFFFFF)
    await device.command("ABORT")
    await device.wait("BUSY", False)
    await device.mode()
