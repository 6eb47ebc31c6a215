"""Drives a network of processing elements: numbers go in, steps run, numbers come out.

    import pe_host

    motor = pe_host.open("out/motor_pid", "model")
    outputs = motor.read()
    for _ in range(1000):
        outputs = motor.exchange([0.5 + 0.1 * outputs[0], 0.0]).outputs

The outputs of sample k are read; the inputs that are computed from them act in step k + 1. docs/host.md says more.
"""

from ._pe_host import TRANSPORTS, Error, Exchanged, Host, Snapshot, Written, open

__all__ = ["TRANSPORTS", "Error", "Exchanged", "Host", "Snapshot", "Written", "open"]
