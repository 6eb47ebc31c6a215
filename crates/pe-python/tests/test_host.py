"""The package against a compiled design: $PE_SYNTH names the compiler, $PE_DESIGN the folder of motor_pid.

    python -m pytest crates/pe-python/tests
"""

import os
import random
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

from pe_synth import host as pe_host

DESIGN = os.environ["PE_DESIGN"]
STEPS = 300


def program(host):
    """Every word of every sample, with inputs that change in every step."""
    numbers = random.Random(5)
    seen = [host.read_words()]
    for step in range(STEPS):
        seen.append(host.exchange_words([numbers.randrange(-(2**31), 2**31) >> numbers.randrange(16) for _ in range(2)]))
        if step == STEPS // 3:
            kept = host.snapshot()
        if step == 2 * STEPS // 3:
            host.restore(kept)
            assert host.sample == kept.sample
            seen.append(host.read_words())
    seen.append(host.flags())
    host.reset()
    seen.append(host.read_words())
    return seen


class HostTest(unittest.TestCase):
    def serve(self):
        """A server in front of the model; its transport."""
        command = [os.environ["PE_SYNTH"], "serve", DESIGN, "--tcp", "127.0.0.1:0"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.addCleanup(server.stdout.close)
        self.addCleanup(server.wait)
        self.addCleanup(server.kill)
        return server, "tcp:" + server.stdout.readline().split()[-1]

    def test_the_same_integers(self):
        expected = program(pe_host.open(DESIGN))
        for transport in ["fast", "clocked", self.serve()[1]]:
            with pe_host.open(DESIGN, transport) as host:
                self.assertEqual(program(host), expected, transport)

    def test_a_closed_loop_in_numbers(self):
        with pe_host.open(DESIGN, "model") as host:
            self.assertEqual((host.inputs, host.outputs), (["target", "load"], ["theta", "u", "torque"]))
            self.assertEqual((host.sample, host.time, host.read()), (0, 0.0, [0.0, 0.0, 0.0]))
            outputs = host.read()
            for _ in range(1000):
                outputs = host.exchange([0.5 + 0.1 * outputs[0], 0.0]).outputs
            self.assertEqual(host.sample, 1000)
            self.assertAlmostEqual(host.time, 1000 * host.step)
            self.assertGreater(outputs[0], 0.1)
            self.assertEqual(host.write([9.0, 0.0]).clamped, ["target"])
            self.assertEqual(host.exchange([0.0, -9.0], 2).clamped, ["load"])
            self.assertEqual(host.run(3), 0)
            snapshot = host.snapshot()
            other = pe_host.open(DESIGN, "fast")
            other.restore(pe_host.Snapshot(snapshot.hash, snapshot.sample, snapshot.state))
            self.assertEqual(other.exchange([0.1, 0.0]).outputs, host.exchange([0.1, 0.0]).outputs)

    def test_frames_are_steps(self):
        numbers = random.Random(9)
        frames = [[numbers.uniform(-0.5, 0.5), numbers.uniform(-0.01, 0.01)] for _ in range(100)] + [[9.0, 0.0]]
        with pe_host.open(DESIGN) as host, pe_host.open(DESIGN, self.serve()[1], timeout=5.0) as other:
            ran = other.run_frames(frames)
            self.assertEqual(ran.outputs, [host.exchange(frame).outputs for frame in frames])
            self.assertEqual((ran.clamped, ran.overruns, other.sample), (["target"], 0, 101))
            self.assertEqual(other.run_frames_words([[5, 6]]), [host.exchange_words([5, 6])])
            self.assertEqual((host.parameters, host.read_parameters(), host.write_parameters([]).clamped), ([], [], []))
            with self.assertRaises(pe_host.Error):
                other.run_frames([[1.0]])

    def test_errors_have_a_kind_and_come_in_time(self):
        def kind(call):
            begin = time.monotonic()
            with self.assertRaises(pe_host.Error) as caught:
                call()
            self.assertLess(time.monotonic() - begin, 1.0)
            return caught.exception.kind

        host = pe_host.open(DESIGN)
        self.assertEqual(kind(lambda: pe_host.open(DESIGN, "none")), "transport")
        self.assertEqual(kind(lambda: pe_host.open("nowhere")), "file")
        self.assertEqual(kind(lambda: host.write([1.0])), "count")
        self.assertEqual(kind(lambda: host.write([1.0, float("nan")])), "not-a-number")
        self.assertEqual(kind(lambda: host.limit(clock_budget=1)), "lacks")
        self.assertEqual(kind(lambda: host.restore(pe_host.Snapshot("0", 0, []))), "wrong-hash")
        host.close()
        self.assertEqual(kind(host.read), "lost")
        with self.assertRaises(ValueError):
            pe_host.open(DESIGN, timeout=-1.0)
        server, transport = self.serve()
        host = pe_host.open(DESIGN, transport)
        host.limit(clock_budget=1)
        self.assertEqual(kind(host.run), "time-exceeded")
        self.assertEqual(host.counters()["overruns"], 0)
        server.kill()
        server.wait()
        self.assertEqual(kind(host.run), "lost")

    def test_the_example_of_the_page_runs(self):
        page = (Path(__file__).resolve().parents[3] / "docs/host.md").read_text(encoding="utf-8")
        example = page.split("```python\n")[1].split("```")[0]
        with tempfile.TemporaryDirectory() as home:
            (Path(home) / "out").mkdir()
            (Path(home) / "out/motor_pid").symlink_to(Path(DESIGN).resolve())
            run = subprocess.run([sys.executable, "-c", example], cwd=home, capture_output=True, text=True, check=True)
        self.assertIn(" s: [", run.stdout)

    def test_other_threads_run_while_steps_do(self):
        host = pe_host.open(DESIGN)
        runner = threading.Thread(target=host.run, args=(200_000,))
        runner.start()
        counted = 0
        while runner.is_alive():
            counted += 1
        self.assertGreater(counted, 100)


if __name__ == "__main__":
    unittest.main()
