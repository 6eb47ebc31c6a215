#!/usr/bin/env python3
"""Steps per second of the reference as a library, in closed loop; see docs/library.md.

    cargo run -p xtask -- loop-speed [FOLDER]

Compiles a rotary pendulum, a filter of order six and a DC motor, builds their libraries with `rustc -O`, and prints
for both forms the steps per second of a loop in one process that reads all outputs and sets all inputs in every step: the
fastest of many runs from the initial state. Then the same loops in numbers, by `pe-synth rates`; see docs/host.md.
$PE_SYNTH names a binary to use in place of building one.
"""

import json
import os
import subprocess
import sys
import tempfile

from common import built

PENDULUM = """model pendulum_plant "Rotary pendulum on a motor"
solver rk4
step   100 us
span   100 ms
param mp = 0.024
param lr = 0.085
param l  = 0.0645
param jr = 5.7198e-5
param jp = 1.33e-4
param km = 0.042
param rm = 8.4
param dr = 0.0015
param dp = 0.0005
param g  = 9.81
input v  = sine(2, 10 Hz) in -10 .. 10
state theta = 0
state alpha = 0.1
state w = 0
state q = 0
s = sin(alpha)
c = cos(alpha)
m11 = mp*lr^2 + jr + jp*s^2
m12 = mp*l*lr*c
t1 = km*(v - km*w)/rm - dr*w - 2*jp*s*c*w*q + mp*l*lr*s*q^2
t2 = jp*s*c*w^2 + mp*g*l*s - dp*q
inv = 1/(jp*m11 - m12^2)
theta' = w
alpha' = q
w' = (jp*t1 - m12*t2)*inv
q' = (m11*t2 - m12*t1)*inv
output theta, alpha
"""

# Chebyshev II, 60 dB from 5 MHz on: scipy.signal.cheby2(6, 60, 5e6, fs=25e6, output='sos')
FILTER = """model filter "Low pass of order six"
solver euler
step   40 ns
span   40 us
index s in 1..3
param b0[s] = [0.006299878989007241, 1.0, 1.0]
param b1[s] = [0.009761994380309637, 0.05421737463422856, -0.5546650773291735]
param b2[s] = [0.00629987898900724, 1.0, 1.0]
param a1[s] = [-0.794835432424744, -0.9827461943560528, -1.2960112709142195]
param a2[s] = [0.1747440708550006, 0.37547853238106155, 0.7409957840385255]
input u = sine(0.5, 500 kHz) in -2 .. 2
every 40 ns {
  state m1[s] = 0
  state m2[s] = 0
  feed[s] = if s == 1 then u else y[s - 1]
  y[s] = b0[s]*feed[s] + m1[s]
  next m1[s] = b1[s]*feed[s] - a1[s]*y[s] + m2[s]
  next m2[s] = b2[s]*feed[s] - a2[s]*y[s]
}
output y[3], y[1]
"""

MOTOR = """model motor "DC motor"
solver rk4
step   1 ms
span   2 s
input u   = square(12, 1 Hz) in -24 .. 24
input tau = 0.02
state w = 0
state i = 0
w' = (0.01*i - 0.1*w - tau)/0.01
i' = (u - i - 0.01*w)/0.5
output w, i
"""

MODELS = [("rotary pendulum", "pendulum_plant", PENDULUM), ("filter", "filter", FILTER), ("motor", "motor", MOTOR)]

LOOP = """use network::{Form, Network};
use std::time::Instant;

fn main() {
    for (form, runs) in [(Form::Fast, 2000), (Form::Clocked, 300)] {
        let mut network = Network::new(form).unwrap();
        let (mut least, mut sum) = (f64::MAX, 0i64);
        for _ in 0..runs {
            network.reset();
            sum = 0;
            let start = Instant::now();
            for step in 0..500i64 {
                let shown = (0..Network::OUTPUTS).map(|index| network.output(index).unwrap_or(0));
                let fed = shown.fold(step * 7919 % 100_000, |fed, word| fed ^ (word >> 12));
                network.set_inputs(&[fed; Network::INPUTS]).unwrap();
                network.step(1);
                sum ^= fed;
            }
            least = least.min(start.elapsed().as_secs_f64() / 500.0);
        }
        println!("{:.0} {} {}", 1.0 / least, network.flags(), sum);
    }
}
"""


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main(folder):
    program = built()
    print("| model | control words per step | fast form, steps/s | clocked form, steps/s |")
    print("|---|---|---|---|")
    for title, name, text in MODELS:
        home = os.path.join(folder, name)
        os.makedirs(home, exist_ok=True)
        spec, loop = os.path.join(home, f"{name}.spec"), os.path.join(home, "loop.rs")
        library, binary = os.path.join(home, "libnetwork.rlib"), os.path.join(home, "loop")
        for path, content in [(spec, text), (loop, LOOP)]:
            with open(path, "w", encoding="utf-8") as file:
                file.write(content)
        out = os.path.join(home, "out")
        run(program, "compile", spec, "-q", "--no-pictures", "-o", out)
        rustc = ["rustc", "-O", "--edition", "2021"]
        source = os.path.join(out, f"{name}_reference.rs")
        run(*rustc, "--crate-type", "lib", "--crate-name", "network", "-o", library, source)
        run(*rustc, "-o", binary, loop, "--extern", f"network={library}")
        (fast, *shown), (clocked, *other) = [line.split() for line in run(binary).splitlines()]
        if shown != other or shown[0] != "0":
            sys.exit(f"{name}: flags and sums {shown} and {other}")
        with open(source, encoding="utf-8") as file:
            period = next(line.split()[-1].rstrip(";") for line in file if line.startswith("const PERIOD:"))
        print(f"| {title} | {period} | {int(fast):,} | {int(clocked):,} |", flush=True)
    print("\n| model | `model` | `clocked` | `fast` |")
    print("|---|---|---|---|")
    for title, name, _ in MODELS:
        out = os.path.join(folder, name, "out")
        rates = run(program, "rates", out, "--transport", "model,clocked,fast", "--message-format", "json")
        measured = [f"{int(row['measured_samples_per_s']):,}" for row in json.loads(rates)[:3]]
        print(f"| {title} | " + " | ".join(measured) + " |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as scratch:
            main(scratch)
