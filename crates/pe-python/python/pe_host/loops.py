"""`pe_synth.host.loops` under its former name."""

from pe_synth.host.loops import Network, Part, compare, compiled, run

__all__ = ["Network", "Part", "compare", "compiled", "run"]
