#!/usr/bin/env python3
"""Counts what keeps the source readable: lines, functions, circles of modules, repeated places, casts.

    cargo run -p xtask -- house [--list ROW]...      ROW: files, functions, circles, duplicates, casts: lists what is counted

Reads the tracked source of the compiler, `crates/*/src/**/*.rs`. `largest file` looks at all hand-written code, tests,
VHDL and scripts included. "Without tests" leaves out modules under `#[cfg(test)]` and files named `tests.rs`.
"""

import argparse
import re
import subprocess
from collections import defaultdict
from pathlib import Path

from common import ROOT

CODE = {".rs", ".vhd", ".v", ".py", ".sh", ".pest"}
INTEGERS = r"(?:u8|u16|u32|u64|u128|usize|i8|i16|i32|i64|i128|isize)"
# Shorter runs of equal lines are idioms.
EQUAL_LINES = 8
SHOWN = 20


def tracked():
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [Path(name) for name in names.splitlines() if (ROOT / name).is_file()]


def blanked(text):
    """Rust text with comments, strings and characters replaced by blanks, line ends kept."""
    pattern = re.compile(
        r"""//[^\n]*|/\*.*?\*/|b?r(?P<hash>\#*)".*?"(?P=hash)|b?"(?:\\.|[^"\\])*"|b?'(?:\\[^\n]{1,8}?|[^'\\\n])'""", re.S)
    return pattern.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)


def closing(text, opening):
    """Place behind the brace that closes the one at a place."""
    depth = 0
    for place in range(opening, len(text)):
        depth += {"{": 1, "}": -1}.get(text[place], 0)
        if depth == 0:
            return place + 1
    return len(text)


def without_tests(text):
    """Blanked text without test modules."""
    while match := re.search(r"#\[cfg\(test\)\]\s*(?:pub\S*\s+)?mod\s+\w+\s*(?:\{|;)", text):
        end = match.end() if text[match.end() - 1] == ";" else closing(text, match.end() - 1)
        text = text[:match.start()] + re.sub(r"[^\n]", " ", text[match.start():end]) + text[end:]
    return text


class Source:
    """The modules of all crates, by crate and path of modules (`units::check`)."""

    def __init__(self):
        self.crates = defaultdict(dict)
        self.files = {}
        for path in tracked():
            parts = path.parts
            if path.suffix != ".rs" or len(parts) < 4 or parts[0] != "crates" or parts[2] != "src":
                continue
            if path.name == "tests.rs" or "tests" in parts[3:-1]:
                continue
            raw = (ROOT / path).read_text()
            module = list(parts[3:-1]) + ([] if path.stem in ("mod", "lib", "main") else [path.stem])
            self.crates[parts[1]]["::".join(module)] = path
            self.files[path] = without_tests(blanked(raw))

    def lines(self, path):
        """Lines of a file, those of tests aside."""
        raw = (ROOT / path).read_text().splitlines()
        kept = self.files[path].splitlines()
        tests = sum(1 for a, b in zip(raw, kept) if a.strip() and not b.strip() and not a.lstrip().startswith("//"))
        return len(raw), len(raw) - tests


def functions(source):
    """(lines, name, file) of all functions."""
    found = []
    for path, text in source.files.items():
        for match in re.finditer(r"\bfn\s+(\w+)", text):
            place, depth = match.end(), 0
            while place < len(text) and not (depth == 0 and text[place] in "{;"):
                depth += {"(": 1, "[": 1, ")": -1, "]": -1}.get(text[place], 0)
                place += 1
            if place < len(text) and text[place] == "{":
                lines = text.count("\n", match.start(), closing(text, place)) + 1
                found.append((lines, match.group(1), path))
    return sorted(found, key=lambda row: (-row[0], str(row[2])))


def imports(text):
    """Paths of modules and items that a file names, written out: `super::a::{b, c::d}` gives two."""
    for match in re.finditer(r"\b((?:crate|super|self)(?:::\w+)*)(::\{)?", text):
        head = match.group(1).split("::")
        if not match.group(2):
            yield head
            continue
        stack, word = [head], ""
        for sign in text[match.end():]:
            if sign == "{":
                stack.append(stack[-1] + [part for part in word.strip().split("::") if part])
                word = ""
            elif sign in ",}":
                name = [part for part in re.split(r"::|\s+as\s+", word.strip()) if part]
                if name:
                    yield stack[-1] + name
                word = ""
                if sign == "}":
                    stack.pop()
                    if not stack:
                        break
            else:
                word += sign


def arrows(source, crate):
    """For each module the modules of its crate that it uses; what a module passes on counts for where it comes from."""
    modules = source.crates[crate]
    texts = {name: source.files[path] for name, path in modules.items()}

    def absolute(own, path):
        parts = own.split("::") if own else []
        rest = list(path)
        while rest and rest[0] in ("crate", "self", "super"):
            word = rest.pop(0)
            parts = [] if word == "crate" else parts if word == "self" else parts[:-1]
        return parts + rest

    passed_on = defaultdict(dict)
    for name, text in texts.items():
        for use in re.finditer(r"\bpub(?:\([^)]*\))?\s+use\s+([^;]+);", text):
            body = use.group(1)
            if not re.match(r"(crate|self|super)::", body):
                body = "self::" + body
            for path in imports(body):
                passed_on[name][path[-1]] = absolute(name, path)

    def home(path, depth=0):
        for length in range(len(path), -1, -1):
            module = "::".join(path[:length])
            if module in modules:
                rest = path[length:]
                if rest and rest[0] in passed_on[module] and depth < 8:
                    further = passed_on[module][rest[0]]
                    return home(further, depth + 1) if further != path else module
                return module
        return ""

    graph = {}
    for name, text in texts.items():
        text = re.sub(r"\bpub(?:\([^)]*\))?\s+use\s+[^;]+;", " ", text)
        text = re.sub(r"\bpub\((?:super|crate|self|in [^)]*)\)", " ", text)
        used = {home(absolute(name, path)) for path in imports(text)}
        children = set(re.findall(r"\bmod\s+(\w+)\s*;", text))
        for child in children:
            if re.search(rf"(?<![:\w]){child}::", text):
                used.add((name + "::" if name else "") + child)
        graph[name] = {other for other in used if other in modules and other != name}
    return graph


def circles(graph):
    """Strongly connected components of more than one module (Tarjan)."""
    index, low, stack, found = {}, {}, [], []

    def visit(node):
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            members = stack[stack.index(node):]
            del stack[stack.index(node):]
            if len(members) > 1:
                found.append(sorted(members))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


def duplicates(source):
    """Pairs of places with the same run of lines: (lines, place, place)."""
    lines, places = [], []
    for path, text in source.files.items():
        for number, line in enumerate(text.splitlines(), 1):
            word = re.sub(r"\s+", " ", line).strip()
            if len(word) > 3 and not word.startswith(("use ", "pub use ", "mod ", "pub mod ", "#[")):
                lines.append(word)
                places.append((path, number))
        lines.append(None)
        places.append((path, 0))
    windows = defaultdict(list)
    for start in range(len(lines) - EQUAL_LINES):
        window = tuple(lines[start:start + EQUAL_LINES])
        if None not in window:
            windows[window].append(start)
    found = []
    for starts in windows.values():
        for at, one in enumerate(starts):
            for other in starts[at + 1:]:
                if one > 0 and lines[one - 1] == lines[other - 1] and lines[one - 1] is not None:
                    continue
                length = 0
                while lines[one + length] is not None and lines[one + length] == lines[other + length]:
                    length += 1
                if one + length <= other:
                    found.append((length, places[one], places[other]))
    return sorted(found, key=lambda row: (-row[0], str(row[1])))


def casts(source):
    """Number of integer casts of each crate, and its lines."""
    count, size, places = defaultdict(int), defaultdict(int), []
    for crate, modules in source.crates.items():
        for path in modules.values():
            for number, line in enumerate(source.files[path].splitlines(), 1):
                found = len(re.findall(rf"\bas {INTEGERS}\b", line))
                count[crate] += found
                places += [f"{path}:{number}"] * found
            size[crate] += source.lines(path)[1]
    return count, size, places


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", action="append", default=[], metavar="ROW",
                        choices=["files", "functions", "circles", "duplicates", "casts"])
    listed = parser.parse_args().list
    source = Source()
    sizes = sorted(((len((ROOT / path).read_text().splitlines()), path) for path in tracked()
                    if path.suffix in CODE), key=lambda row: (-row[0], str(row[1])))
    longest = functions(source)
    rings = [(crate, ring) for crate in sorted(source.crates) for ring in circles(arrows(source, crate))]
    pairs = duplicates(source)
    count, size, places = casts(source)
    own = [source.lines(path) for path in source.crates["pe-synth"].values()]
    everything = sum(size.values())
    rows = [
        ("lines of pe-synth's source", f"{sum(all_lines for all_lines, _ in own)}, without tests {sum(kept for _, kept in own)}"),
        ("largest file", f"{sizes[0][0]} ({sizes[0][1]})"),
        ("longest function", f"{longest[0][0]} ({longest[0][1]}, {longest[0][2]})"),
        ("circles of modules inside crates", f"{len(rings)}"),
        (f"pairs of equal places ({EQUAL_LINES} lines or more)", f"{len(pairs)}"),
        ("integer `as` casts per 1,000 lines without tests", f"{1000 * sum(count.values()) / everything:.1f}"),
    ]
    rows += [(f"- {crate}", f"{1000 * count[crate] / size[crate]:.1f} ({count[crate]} in {size[crate]} lines)")
             for crate in sorted(size)]
    print("| figure | value |\n|---|---|")
    for name, value in rows:
        print(f"| {name} | {value} |")
    for row in listed:
        print()
        if row == "files":
            print("\n".join(f"{lines} {path}" for lines, path in sizes[:SHOWN]))
        elif row == "functions":
            print("\n".join(f"{lines} {name} {path}" for lines, name, path in longest[:SHOWN]))
        elif row == "circles":
            print("\n".join(f"{crate}: {', '.join(name or 'lib' for name in ring)}" for crate, ring in rings))
        elif row == "duplicates":
            print("\n".join(f"{lines} {a[0]}:{a[1]} {b[0]}:{b[1]}" for lines, a, b in pairs))
        else:
            print("\n".join(places))


if __name__ == "__main__":
    main()
