#!/usr/bin/env python3
"""Works on a spec in Visual Studio Code as a person does: colours, hover, findings, definition, renaming, completion, layout.

    editor.py ADDRESS FOLDER        ADDRESS of code-server, FOLDER for pictures; editor.sh runs it
"""

import sys
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

FLAGS = """--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
    --disable-component-update --disable-sync --window-size=1300,850"""
TEXT = """return [...document.querySelectorAll('.view-line')].sort((a, b) => a.offsetTop - b.offsetTop)
    .map(line => line.textContent.replace(/\\u00a0/g, ' ')).join('\\n')"""
PATIENCE = 60
"""Seconds until what should happen counts as not happening."""


class Editor:
    def __init__(self, address, folder):
        self.folder = folder
        options = webdriver.ChromeOptions()
        for flag in FLAGS.split():
            options.add_argument(flag)
        options.add_argument(f"--user-data-dir={folder}/chromium")
        self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
        self.driver.get(address)

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def text(self):
        """What the editor shows of the file."""
        return self.driver.execute_script(TEXT)

    def until(self, what, condition):
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if found := condition():
                return found
            time.sleep(0.2)
        self.driver.save_screenshot(str(self.folder / "failed.png"))
        raise SystemExit(f"editor: {what} did not come; the file is\n{self.text()}")

    def word(self, line, word):
        """The word in the first line that begins so."""
        for row in self.all(".view-line"):
            if row.text.replace("\u00a0", " ").startswith(line):
                return next(part for part in row.find_elements(By.CSS_SELECTOR, "span span") if part.text.strip() == word)
        raise SystemExit(f"editor: no line begins with {line!r}")

    def chord(self, *keys):
        actions = ActionChains(self.driver)
        for key in keys[:-1]:
            actions.key_down(key)
        actions.send_keys(keys[-1])
        for key in keys[:-1]:
            actions.key_up(key)
        actions.perform()

    def type(self, text):
        ActionChains(self.driver).send_keys(text).perform()

    def command(self, name):
        self.chord(Keys.F1)
        self.until("the list of commands", lambda: self.all(".quick-input-widget input"))
        self.type(name)
        self.until(f"the command {name}", lambda: any(name in row.text for row in self.all(".quick-input-list .monaco-list-row")))
        self.type(Keys.ENTER)

    def errors(self):
        return len(self.all(".squiggly-error"))


def main(address, folder):
    editor = Editor(address, folder)
    try:
        rows = editor.until("the spec in the explorer", lambda: [row for row in editor.all(".monaco-list-row") if "lotka" in row.text])
        ActionChains(editor.driver).double_click(rows[0]).perform()
        editor.until("the text", lambda: "predator'" in editor.text())
        kinds = editor.until("colours", lambda: {part.get_attribute("class") for part in editor.all(".view-line span span")} - {"mtk1"})
        assert len(kinds) >= 4, kinds
        assert "pe-synth spec" in editor.driver.find_element(By.CSS_SELECTOR, "footer, .statusbar").text

        def hover():
            """The box, of a pointer that comes anew: its first answer may precede the run that gives ranges."""
            for line, word in [("model", "lotka_volterra"), ("state prey", "prey")]:
                ActionChains(editor.driver).move_to_element_with_offset(editor.word(line, word), 0, 0).pause(1).perform()
            told = [box.text for box in editor.all(".monaco-hover")]
            return [text for text in told if "number format" in text and "range: magnitudes up to" in text]

        told = editor.until("a hover with range and format", hover)
        assert "alpha*prey - beta*prey*predator" in told[0], told

        assert editor.errors() == 0
        editor.chord(Keys.CONTROL, Keys.END)
        editor.type("\nwrong = nowhere + 1\n")
        editor.until("a finding", lambda: editor.errors() == 1)
        editor.driver.save_screenshot(str(folder / "finding.png"))
        for _ in range(12):  # each takes back a word or less
            editor.chord(Keys.CONTROL, "z")
        editor.until("no finding", lambda: editor.errors() == 0)

        editor.word("prey' ", "alpha").click()
        editor.chord(Keys.F12)
        place = editor.driver.find_element(By.CSS_SELECTOR, r"#status\.editor\.selection")
        editor.until("the definition", lambda: place.text.startswith("Ln 6,"))
        before = editor.text().count("alpha")
        editor.chord(Keys.F2)
        editor.until("the box for a name", lambda: editor.driver.execute_script(
            "return document.activeElement.matches('.rename-box input') && document.activeElement.value == 'alpha'"))
        editor.chord(Keys.CONTROL, "a")
        editor.type("growth" + Keys.ENTER)
        editor.until("the new name", lambda: "alpha" not in editor.text() and editor.text().count("growth of") == 1
                     and editor.text().count("growth") == before + 1)

        editor.chord(Keys.CONTROL, Keys.END)
        editor.type("\npower   = gro")
        editor.chord(Keys.CONTROL, Keys.SPACE)
        editor.until("a proposal", lambda: any(row.text.startswith("growth") for row in editor.all(".suggest-widget .monaco-list-row")))
        editor.type(Keys.ENTER + "  *   prey")
        editor.until("what was proposed", lambda: "power   = growth  *   prey" in editor.text())
        editor.command("Format Document")
        editor.until("the layout", lambda: "power = growth*prey" in editor.text())
        editor.driver.save_screenshot(str(folder / "layout.png"))
    finally:
        editor.driver.quit()
    print("editor: colours, hover, a finding, definition, renaming, completion and layout in Visual Studio Code")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
