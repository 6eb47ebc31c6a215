#!/usr/bin/env python3
"""Pages in a browser: sorted, filtered, pointed at, clicked, slid, wide, narrow, printed.

    testbenches/pages.py FOLDER [--rate | --pictures]

Needs chromium, chromium-driver and selenium (testbenches/test-all.sh installs them); $PE_SYNTH names a binary. FOLDER takes what
is compiled. What pages show is compared with the CSV files beside them, fronts with fronts that this script finds. A page with an
error of JavaScript, or one that asks for anything from elsewhere, fails. Faults that are put into the pages must be found.
--rate prints how long a page of 10,000 points takes to open, sort, filter and slide; --pictures leaves pictures of all pages.
"""

import base64
import csv
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

ROOT = Path(__file__).resolve().parent.parent
PE_SYNTH = str(Path(os.environ.get("PE_SYNTH", ROOT / "target/debug/pe-synth")).resolve())
FLAGS = ("--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
         "--disable-component-update --disable-sync --hide-scrollbars --force-device-scale-factor=1").split()

# Scalars, arrays of one, two and three indices, functions that become tables, an input; a title that is no title.
FIELDS = """model fields "</script><script>document.title = 'taken'</script> & <b>a cube</b>"
solver heun
step 5 ms
span 1 s
index i in 1..4
index j in 1..5
index k in 1..6
index m in 1..12
state T[i, j, k] = i + 10*sin(j)*cos(k)
T[i, j, k]' = -T[i, j, k]*(1 + 0.2*i)
state v[i, j] = i*j
v[i, j]' = -j*v[i, j]
state r[m] = sin(m)
r[m]' = -m*r[m]
input drive = sine(1, 5 Hz, 0)
state s = 1
s' = drive - s/(0.8333333333333334*s^2 + 1) + 0.1*v[1, 1]
mass = sum(m: r[m])
output T, v, r, s, mass, drive
"""


def need(condition, message):
    if not condition:
        raise AssertionError(message)


class Browser:
    """A Chromium with one page, which it opens from disk."""

    def __init__(self):
        options = webdriver.ChromeOptions()
        for flag in FLAGS:
            options.add_argument(flag)
        self.profile = tempfile.TemporaryDirectory()
        options.add_argument(f"--user-data-dir={self.profile.name}")
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        self.driver = webdriver.Chrome(options=options, service=Service("/usr/bin/chromedriver"))
        self.driver.execute_cdp_cmd("Network.enable", {})

    def open(self, path, width=1600):
        self.size(width)
        begun = time.perf_counter()
        self.driver.get(path.resolve().as_uri())
        self.frames()
        return time.perf_counter() - begun

    def frames(self):
        """Waits until what has been done is drawn, however busy the machine is."""
        self.driver.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => done()));")

    def size(self, width):
        metrics = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def one(self, selector):
        found = self.all(selector)
        need(found, f"there is no {selector}")
        return found[0]

    def run(self, script, *values):
        return self.driver.execute_script(script, *values)

    def rows(self, table=".table"):
        """Cells of the rows that are elements, by the keys of their columns."""
        return self.run("""const table = document.querySelector(arguments[0]);
            const keys = [...table.querySelectorAll('thead th')].map((cell) => cell.dataset.key);
            return [...table.querySelectorAll('tbody tr:not(.space)')].map((row) =>
              Object.fromEntries([...row.children].map((cell, at) => [keys[at], cell.textContent])));""", table)

    def every_row(self, table=".table"):
        """All rows of a table: scrolled through from its first to its last."""
        seen = {}
        self.run("document.querySelector(arguments[0]).scrollTop = 0", table)
        for _ in range(1000):
            self.frames()
            for row in self.rows(table):
                seen[row["point"]] = row
            at_end = self.run("""const table = document.querySelector(arguments[0]); const before = table.scrollTop;
                table.scrollTop += 200; return table.scrollTop === before;""", table)
            if at_end:
                return list(seen.values())
        raise AssertionError("the table does not end")

    def set(self, selector, value):
        self.run("""const input = document.querySelector(arguments[0]); input.value = arguments[1];
            input.dispatchEvent(new Event('input'));""", selector, value)

    def find_tip(self, selector, wanted=r".", steps=28):
        """Moves the pointer over an element until the tip says what is wanted."""
        element = self.one(selector)
        self.run("arguments[0].scrollIntoView({block: 'center'})", element)
        box = element.size
        for row in range(1, steps):
            for column in range(1, steps):
                x = round((column / steps - 0.5) * box["width"])
                y = round((row / steps - 0.5) * box["height"])
                ActionChains(self.driver, duration=0).move_to_element_with_offset(element, x, y).perform()
                text = self.run("const tip = document.getElementById('tip'); return tip.hidden ? '' : tip.textContent;")
                if re.search(wanted, text):
                    return text, (x, y)
        raise AssertionError(f"nothing under the pointer on {selector} says {wanted}")

    def finish(self):
        """Fails if the page has reported an error, or has asked for something."""
        severe = [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"]
        need(not severe and not self.all(".problem"), f"the page has errors: {severe}")
        asked = []
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            # The browser's own first page asks for much.
            if message["method"] == "Network.requestWillBeSent" and message["params"]["documentURL"].startswith("file:"):
                asked.append(message["params"]["request"]["url"])
        foreign = [url for url in asked if not url.startswith(("file:", "data:"))]
        need(asked and not foreign, f"the page asks for {foreign}")

    def picture(self, path):
        height = min(self.run("return document.documentElement.scrollHeight"), 6000)
        width = self.run("return document.documentElement.clientWidth")
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        shot = self.driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})
        path.write_bytes(base64.b64decode(shot["data"]))

    def printed(self):
        return base64.b64decode(self.driver.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"])


def table(folder, name):
    with open(folder / name, newline="") as file:
        return list(csv.DictReader(file))


def value(text):
    return float(text) if text else None


def front(points, first, second, limit):
    """Points that no other beats in both: by comparing each with all."""
    known = [point for point in points if all(value(point[key]) is not None and math.isfinite(value(point[key])) for key in (first, second))
             and (limit is None or value(point["error_total"]) <= limit) and min(value(point[first]), value(point[second])) > 0]
    pairs = [(value(point[first]), value(point[second]), int(point["point"])) for point in known]
    beaten = lambda own: any(other[0] <= own[0] and other[1] <= own[1] and (other[:2] != own[:2] or other[2] < own[2]) for other in pairs)
    return {str(pair[2]) for pair in pairs if not beaten(pair)}


# Each sweep: its files, and the fronts that the page has: figures, and whether the slider moves them, down to which error.
SWEEPS = {
    "explore": ("points", [("time_per_simulated_second_ms", "error_total", 0.01), ("equivalent_lut", "time_per_simulated_second_ms", 0)]),
    "accuracy": ("accuracy", [("seconds", "error_total", None), ("equivalent_lut", "seconds", 0)]),
}


def fronts_of(kind, points, limit):
    fronts = set()
    for first, second, least in SWEEPS[kind][1]:
        fronts |= front(points, first, second, None if least is None or limit is None else max(limit, least))
    return fronts


def check_opens(browser, folder, kind):
    points = table(folder, f"{SWEEPS[kind][0]}.csv")
    need(browser.one("h1").text and f"{len(points)} rows" in browser.one(".told").text, "not all rows are counted")
    links = [link.get_attribute("href") for link in browser.all("nav a")]
    need(len(links) >= 3 and all(Path(link.removeprefix("file://")).is_file() for link in links), f"links lead nowhere: {links}")
    need(len(browser.all(".chart canvas")) == 2, "there are not two charts")


def check_sorts(browser, folder, kind):
    for key in ("error_total", "equivalent_lut", "solver"):
        for direction in (1, -1):
            browser.one(f"th[data-key={key}] button").click()
            told = [row[key] for row in browser.every_row()]
            known = [text for text in told if text not in ("–", "")]
            need(len(set(known)) > 1, f"{key} has one value")
            need(told[: len(known)] == known, f"what has no {key} does not come last")
            order = known if key == "solver" else [float(text.replace("∞", "inf")) for text in known]
            need(order == sorted(order, reverse=direction < 0), f"{key} is not in order: {order}")
    browser.one("th[data-key=point] button").click()


def check_filters(browser, folder, kind):
    points = table(folder, f"{SWEEPS[kind][0]}.csv")
    limit = sorted(value(point["error_total"]) for point in points if point["status"] == "compiled" and value(point["error_total"]))[5]
    cases = {
        "heun3": lambda point: "heun3" in " ".join(point.values()),
        f"error_total<={limit!r}": lambda point: value(point["error_total"]) is not None and value(point["error_total"]) <= limit,
        "rk4 multiplier=32x32": lambda point: "rk4" in " ".join(point.values()) and "32x32" in point["multiplier"],
        "storage_bits>40 heun": lambda point: value(point["storage_bits"]) > 40 and "heun" in " ".join(point.values()),
        "no_such_column<3": lambda point: False,
    }
    for text, wanted in cases.items():
        browser.set("input[type=search]", text)
        found = {row["point"] for row in browser.every_row()}
        need(found == {point["point"] for point in points if wanted(point)}, f"{text} finds {sorted(found)}")
    need("no column" in browser.one(".told").text, "a filter that cannot be is not told")
    browser.set("input[type=search]", "")


def check_fronts(browser, folder, kind):
    points = table(folder, f"{SWEEPS[kind][0]}.csv")
    errors = sorted(value(point["error_total"]) for point in points if value(point["error_total"]) and math.isfinite(value(point["error_total"])))
    limit = json.loads((folder / f"{SWEEPS[kind][0]}.json").read_text())["max_error"]
    browser.one(".only-fronts").click()
    shown = lambda: {row["point"] for row in browser.every_row()}
    wanted = fronts_of(kind, points, limit)
    need(wanted and shown() == wanted, f"fronts at first: {shown()}, not {wanted}")
    if kind == "explore":
        filed = {point["point"] for point in points if "1" in (point["on_error_time_front"], point["on_size_speed_front"])}
        need(filed == wanted, f"the files have {filed}")
    low, high = math.log10(errors[0]) - 0.02, math.log10(errors[-1]) + 0.02
    seen = set()
    for place in (60, 350, 650, 1000):
        browser.set(".limit", place)
        limit = None if place == 1000 else 10 ** (low + place / 1000 * (high - low))
        wanted = fronts_of(kind, points, limit)
        need(shown() == wanted, f"fronts at {limit}: {shown()}, not {wanted}")
        seen.add(frozenset(wanted))
    need(len(seen) > 1, "the slider moves no front")
    browser.one(".only-fronts").click()


def check_points(browser, folder, kind):
    points = table(folder, f"{SWEEPS[kind][0]}.csv")
    text, place = browser.find_tip(".chart .u-over", "total error")
    told = dict(line.split(": ", 1) for line in text.splitlines())
    ActionChains(browser.driver, duration=0).move_to_element_with_offset(browser.one(".chart .u-over"), *place).click().perform()
    number = re.match(r"Point (\d+):", browser.one(".point h2").text).group(1)
    point = next(point for point in points if point["point"] == number)
    need(told["solver"] == point["solver"] and math.isclose(float(told["total error"]), value(point["error_total"]), rel_tol=6e-3), f"{told} is not {point}")
    need(browser.one(".point code").text == point["command"], "the command is another point's")
    facts = len(browser.all(".point .facts div"))
    need(facts == len(point) - 1, f"the report has {facts} of {len(point) - 1} figures")
    browser.run("window.copied = null; Object.defineProperty(navigator, 'clipboard', {value: {writeText: async (text) => { window.copied = text; }}})")
    browser.one(".point .copy").click()
    browser.frames()
    need(browser.run("return window.copied") == point["command"], "the button copies something else")
    other = next(row for row in browser.rows() if row["point"] != number)
    browser.run("document.querySelector(`tr[data-row='${arguments[0]}']`).click()", other["point"])
    need(browser.one(".point h2").text.startswith(f"Point {other['point']}:"), "a click on a row chooses nothing")


def check_widths(browser, *_):
    for width in (1600, 400):
        browser.size(width)
        for _ in range(3):
            browser.frames()
        need(browser.run("return document.documentElement.scrollWidth") <= width, f"the page is wider than {width}")
        wide = browser.run("return Math.max(-1, ...[...document.querySelectorAll('.chart')].map((chart) => chart.clientWidth))")
        need(wide == -1 or 0.35 * width < wide <= width, f"charts are {wide} wide at {width}")
        cut = "return [...document.querySelectorAll('td:not(.text)')].find((cell) => cell.scrollWidth > cell.clientWidth)?.textContent"
        need(browser.run(cut) is None, f"a figure is cut at {width}: {browser.run(cut)}")
    browser.size(1600)
    pdf = browser.printed()
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    need(pdf.startswith(b"%PDF") and 1 <= pages <= 14, f"{pages} printed pages")


def check_design(browser, folder, name):
    data = json.loads(browser.one("#data").get_attribute("textContent"))
    need(browser.driver.title != "taken" and not browser.all("b"), "a name became an element")
    need("</script>" in browser.one("h1").text, "the title is not as it was given")
    need([curve["name"] for curve in data["curves"]] == ["s", "mass", "drive"], "curves are not the scalars")
    need([array["shape"] for array in data["arrays"]] == [[4, 5, 6], [12], [4, 5]], "arrays have other shapes")
    rows = browser.rows()
    bits = [float(row["headroom_bits"]) for row in rows]
    known = sorted(float(row["headroom_bits"]) for row in table(folder, f"{name}_variables.csv"))
    need(bits == sorted(bits) and abs(bits[0] - known[0]) < 0.01, "the least headroom is not first")
    need(not any(len(row["name"]) > 30 for row in rows), "a name is a formula")


def check_outputs(browser, folder, _):
    text, _ = browser.find_tip(".chart .u-over", "fixed point")
    need(text.startswith("t = ") and "double precision" in text, f"a curve says {text}")
    maps = browser.all("canvas.map")
    need(len(maps) == 3, "there are not three maps")
    pixels = "return [...document.querySelectorAll('canvas.map')].map((map) => map.toDataURL())"
    before = browser.run(pixels)
    browser.set(".time", 3)
    after = browser.run(pixels)
    need(before[0] != after[0] and before[2] != after[2] and before[1] == after[1], "the slider for the time moves the wrong maps")
    browser.set(".slice", 0)
    need(browser.run(pixels)[0] != after[0], "the slider for the first index moves nothing")
    text, place = browser.find_tip("canvas.map", r"T\[1,\d,\d\] at t = ")
    element, third, fourth = re.search(r"(T\[1,(\d),(\d)\])", text).groups()
    times = json.loads(browser.one("#data").get_attribute("textContent"))
    at = times["times"][times["arrays"][0]["frames"][3]]
    model = (1 + 10 * math.sin(int(third)) * math.cos(int(fourth))) * math.exp(-1.2 * at)
    shown = float(re.search(r"fixed point: (\S+)", text).group(1))
    need(abs(shown - model) < 0.01 * abs(model) + 0.02, f"{element} is {shown} at {at} s, not {model}")
    ActionChains(browser.driver, duration=0).move_to_element_with_offset(browser.one("canvas.map"), *place).click().perform()
    need(browser.all("h3")[-1].text.startswith(element) or any(head.text.startswith(element) for head in browser.all("h3")), "no course of an element")


def check_network(browser, folder, name):
    text, _ = browser.find_tip("canvas.network", r"^PE \d")
    pe = int(re.match(r"PE (\d+)", text).group(1))
    need("computes: " in text and re.search(r"[Tvrs](\[|\b)", text), f"a PE says {text}")
    program = (folder / f"{name}_program.txt").read_text()
    own = re.search(rf"^pe {pe} .*?(?=^pe \d|\Z)", program, re.S | re.M).group(0)
    first = re.search(r"computes: ([^\s,\[]+(?:\[[\d,]+\])?)", text).group(1)
    need(f"equation {first}\n" in own or first.endswith("'"), f"PE {pe} does not compute {first}")
    text, _ = browser.find_tip("canvas.occupancy", "product of the chain")
    pe, cycle, chain = re.search(r"PE (\d+), cycle (\d+)\nproduct of the chain (\S+)", text).groups()
    own = re.search(rf"^pe {pe} .*?(?=^pe \d|\Z)", program, re.S | re.M).group(0)
    word = re.search(rf"^word {cycle} .*# (.*)$", own, re.M)
    need(word and (chain in word.group(1) or " part" in text), f"cycle {cycle} of PE {pe} is {word and word.group(1)}, not {chain}")


def check_empty(browser, *_):
    """A sweep without any design, and a design of one PE without curves."""
    need(browser.all(".table tbody tr"), "there are no rows")
    need(not browser.all(".chart .u-over") or browser.all("canvas.map"), "a chart shows nothing")


SWEEP_CHECKS = [check_opens, check_sorts, check_filters, check_fronts, check_points, check_widths]
DESIGN_CHECKS = [check_design, check_outputs, check_network, check_widths]

# Faults: what is replaced in a page, and which check has to see it.
FAULTS = [
    ("explore", check_opens, "function sweepPage() {", "function sweepPage() { setTimeout(() => { throw new Error('planted'); }, 0);"),
    ("explore", check_opens, "function sweepPage() {", "function sweepPage() { fetch('https://example.org/').catch(() => {});"),
    ("explore", check_opens, 'href="points.csv"', 'href="point.csv"'),
    ("explore", check_sorts, "return sign * order(left, right)", "return order(left, right)"),
    ("explore", check_sorts, "missing(left) - missing(right)", "missing(right) - missing(left)"),
    ("explore", check_filters, "'<=': (a) => a <= limit", "'<=': (a) => a < limit"),
    ("explore", check_filters, "tests.every(", "tests.some("),
    ("explore", check_fronts, "const better = second.at(row) < least;", "const better = second.at(row) <= 2 * least;"),
    ("explore", check_fronts, "error.at(row) <= limit", "error.at(row) <= 10 * limit"),
    ("explore", check_points, "column.command.at(row)", "column.command.at(0)"),
    ("explore", check_points, "navigator.clipboard.writeText(text())", "navigator.clipboard.writeText('')"),
    ("explore", check_points, "if (distance <= least) [best, least] = [row, distance];", ""),
    ("explore", check_widths, "main, footer { max-width: 1560px;", "main, footer { min-width: 900px;"),
    ("explore", check_widths, "=> pen.measureText(text).width;", "=> pen.measureText(text).width / 3;"),
    ("fields", check_design, "order: 'headroom_bits'", "order: 'limit'"),
    ("fields", check_outputs, "const frame = () => Math.round(chosen().share * (frames.length - 1));", "const frame = () => 0;"),
    ("fields", check_outputs, "view.getUint16(2 * at, true)", "view.getUint16(2 * at, false)"),
    ("fields", check_network, "runs[place] <= cycle && cycle < runs[place] + runs[place + 1]", "runs[place] + 9 <= cycle"),
    ("fields", check_network, "places.forEach(([px, py], pe) => {", "[].forEach(([px, py], pe) => {"),
]


def run_checks(browser, path, checks, kind):
    browser.open(path)
    for check in checks:
        check(browser, path.parent, kind)
    browser.finish()


def planted(browser, folders):
    """Every fault must be found; a check that a fault does not disturb tests nothing."""
    for kind, check, old, new in FAULTS:
        path = folders[kind] / "index.html"
        text = path.read_text()
        need(text.count(old) >= 1, f"no page has {old}")
        broken = path.with_name("broken.html")
        broken.write_text(text.replace(old, new))
        try:
            browser.driver.get_log("browser"), browser.driver.get_log("performance")
            run_checks(browser, broken, [check], kind)
        except (AssertionError, StaleElementReferenceException, AttributeError, StopIteration) as found:
            print(f"  {check.__name__.removeprefix('check_')}: {str(found).splitlines()[0][:110]}")
            continue
        finally:
            broken.unlink()
            browser.driver.get("about:blank")
            browser.driver.get_log("browser"), browser.driver.get_log("performance")
        raise SystemExit(f"pages.py: {check.__name__} does not find the fault {new!r}")


def many(path, count):
    """A page of many points: those of another again and again, with figures that differ."""
    text = path.read_text()
    begin = text.index('id="data">') + len('id="data">')
    end = text.index("</script>", begin)
    data = json.loads(text[begin:end])
    for column in data["columns"]:
        for key in {"values", "places", "rest"} & set(column):
            known = column[key]
            column[key] = [known[at % len(known)] for at in range(count)]
        if column["key"] == "point":
            column["values"] = list(range(count))
        elif column["kind"] == "number":
            scaled = lambda number, at: number * (1 + 0.37 * math.sin(at)) if isinstance(number, (int, float)) else number
            column["values"] = [scaled(number, at) for at, number in enumerate(column["values"])]
    target = path.with_name(f"{count}.html")
    target.write_text(text[:begin] + json.dumps(data, separators=(",", ":")).replace("<", "\\u003c") + text[end:])
    return target


TIMED = """const done = arguments[arguments.length - 1]; const begun = performance.now(); (() => { %s })();
    requestAnimationFrame(() => setTimeout(() => done((performance.now() - begun) / 1000), 0));"""


def rate(browser, path, count=10_000):
    page = many(path, count)
    timed = lambda script: browser.driver.execute_async_script(TIMED % script)
    browser.open(path)
    for _ in range(3):
        seconds = {
            "opens": browser.open(page),
            "sorts": max(timed(f"document.querySelector('th[data-key={key}] button').click();") for key in ("error_total", "solver", "equivalent_lut")),
            "filters": timed("const input = document.querySelector('input[type=search]'); input.value = 'rk4 error_total<1e-4'; input.dispatchEvent(new Event('input'));"),
            "slides": timed("const input = document.querySelector('.limit'); input.value = 400; input.dispatchEvent(new Event('input'));"),
            "scrolls": timed("document.querySelector('.table').scrollTop = 20000;"),
        }
        need(browser.rows(), "no rows")
        print(f"{count} points, {page.stat().st_size / 1e6:.1f} MB: " + ", ".join(f"{what} in {time:.2f} s" for what, time in seconds.items()))
    browser.finish()


def main(out, *options):
    out = Path(out).resolve()
    out.mkdir(parents=True, exist_ok=True)
    (out / "fields.spec").write_text(FIELDS)
    model = ROOT / "models/van_der_pol/van_der_pol.spec"
    run = lambda *command: subprocess.run([PE_SYNTH, *map(str, command), "--quiet"], check=True, cwd=out, stdout=subprocess.DEVNULL)
    run("compile", "fields.spec", "--pes", "5", "-o", out / "fields")
    run("explore", model, "--span", "10s", "--pes", "1,2", "--storage", "32,48", "-o", out / "explore")
    run("accuracy", model, "--span", "10s", "--max-error", "1e-5", "-o", out / "accuracy")
    (out / "arrays.spec").write_text(FIELDS.replace("model fields", "model arrays").replace("output T, v, r, s, mass, drive", "output T"))
    run("compile", "arrays.spec", "--pes", "1", "-o", out / "arrays")
    refused = subprocess.run([PE_SYNTH, "explore", model, "--pes", "3", "--step", "1ms", "--span", "1s", "--quiet", "-o", out / "refused"],
                             stderr=subprocess.DEVNULL, check=False)
    need(refused.returncode == 1, "a sweep in which nothing can be compiled succeeds")
    folders = {name: out / name for name in ("fields", "explore", "accuracy")}
    browser = Browser()
    try:
        if options == ("--rate",):
            return rate(browser, folders["explore"] / "index.html")
        if options == ("--pictures",):
            for name, folder in folders.items():
                browser.open(folder / "index.html")
                (out / f"{name}.pdf").write_bytes(browser.printed())
                for width in (1600, 400):
                    browser.size(width)
                    browser.frames()
                    browser.frames()
                    browser.picture(out / f"{name}_{width}.png")
            return None
        for name, folder in folders.items():
            checks = DESIGN_CHECKS if name == "fields" else SWEEP_CHECKS
            run_checks(browser, folder / "index.html", checks, name)
            print(f"{name}: {', '.join(check.__name__.removeprefix('check_') for check in checks)}")
        for name in ("arrays", "refused"):
            run_checks(browser, out / name / "index.html", [check_empty, check_widths], name)
            print(f"{name}: empty, widths")
        planted(browser, folders)
        print(f"{len(FAULTS)} planted faults found")
    finally:
        browser.driver.quit()
        browser.profile.cleanup()
    return None


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    main(*sys.argv[1:])
