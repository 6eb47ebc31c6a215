"""Drives a network of processing elements: numbers go in, steps run, numbers come out.

    from pe_synth import host

    motor = host.open("out/motor_pid", "model")
    outputs = motor.read()
    for _ in range(1000):
        outputs = motor.exchange([0.5 + 0.1 * outputs[0], 0.0]).outputs

The outputs of sample k are read; the inputs that are computed from them act in step k + 1. docs/host.md says more.
"""

from .._native import TRANSPORTS, Exchanged, Frames, Host, Snapshot, Written
from .._native import HostError as Error
from .._native import open_host as open

__all__ = ["TRANSPORTS", "Error", "Exchanged", "Frames", "Host", "Snapshot", "Written", "open"]
