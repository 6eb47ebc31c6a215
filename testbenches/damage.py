#!/usr/bin/env python3
"""Prints a row for each campaign that `verify --inject N --message-format json` wrote: which run caught how many damages,
which proof excused how many, how many are in words that no run reads, and those that are missed.

    testbenches/damage.py FILE...
"""

import collections
import json
import sys

print("| design | damages | caught | from the beginning | the middle | random words | limits | sums | operands | entries | datasheet | equivalence | never read | missed |")
print("|" + "---|" * 14)
misses = []
for path in sys.argv[1:]:
    with open(path) as file:
        campaign = json.load(file)
    runs = collections.Counter(damage["caught_from"] for damage in campaign["damages"] if damage["fate"] == "caught")
    starts = ("the beginning", "random words", "words at the limits", "sums beyond the limits", "operands too large", "entries not read")
    named = [runs.pop(name, 0) for name in starts]
    # What is left starts at a step.
    named.insert(1, sum(runs.values()))
    every = campaign["all"]
    row = [campaign["design"], every["injected"], every["caught"], *named, every["datasheet"], every["equivalence"], every["never_read"], every["missed"]]
    print("|", " | ".join(map(str, row)), "|")
    misses += [(campaign["design"], damage) for damage in campaign["damages"] if damage["fate"] == "missed"]
for design, damage in misses:
    print(f"\nmissed in {design}: {damage['class']} in {damage['file']}, line {damage['line']}: {damage['what']}")
    print(f"    before: {damage['before']}\n    after:  {damage['after']}\n    {damage['message']}")
