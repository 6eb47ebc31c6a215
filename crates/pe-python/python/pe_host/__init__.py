"""The name under which `pe_synth.host` was a package of its own; the same classes and functions.

New programs write `from pe_synth import host`.
"""

from pe_synth.host import TRANSPORTS, Error, Exchanged, Frames, Host, Snapshot, Written, open

__all__ = ["TRANSPORTS", "Error", "Exchanged", "Frames", "Host", "Snapshot", "Written", "open"]
