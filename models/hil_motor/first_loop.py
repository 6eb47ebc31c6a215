"""The loop of docs/first-loop.md: a motor on PEs, its controller here. Arguments: the folder of the design, a transport."""

import sys

from pe_synth import host

Kp, Ki, STEP = 60.0, 120.0, 1e-3  # V s, V, s: proportional and integral part

with host.open(sys.argv[1], sys.argv[2]) as motor:
    integral, words = 0.0, []
    speed, current = motor.read()  # sample 0
    for k in range(1000):
        error = 1.0 - speed  # 1/s
        integral += STEP * error
        voltage = max(-24.0, min(24.0, Kp * error + Ki * integral))
        exchanged = motor.exchange([voltage, 0.0])  # acts in step k + 1
        assert not exchanged.clamped
        speed, current = exchanged.outputs  # sample k + 1
        words.append(motor.read_words())
        if (k + 1) % 200 == 0:
            print(f"{motor.time:.1f} s: {voltage:7.3f} V, {speed:.6f} 1/s, {current:.6f} A")
    print(f"flags {motor.flags()}, sum of all words {sum(map(sum, words))}")
