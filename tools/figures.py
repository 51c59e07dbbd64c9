#!/usr/bin/env python3
"""Measures the figures of a page anew: `tools/figures.py docs/foreign-programs.md`.

A page names the command of a figure in a comment, `<!-- figures: bench foreign cost -->`. Its output
goes into the block below, with the machine's state on top. `--program` is the laboratory's program
(default: cargo run --release); more words select the figures whose command has them.
"""

import argparse
import datetime
import os
import pathlib
import platform
import re
import subprocess

FIGURE = re.compile(r"<!-- figures: (?P<command>.+?) -->\n```text\n.*?\n```\n", re.S)
LABORATORY = ["cargo", "run", "--release", "--quiet", "-p", "replenish-bench", "--"]


def measured(command, program):
    load = os.getloadavg()[0]
    output = subprocess.run([*program, *command.split()], stdout=subprocess.PIPE, text=True, check=True)
    lines = [line.rstrip() for line in output.stdout.strip("\n").splitlines()]
    day = datetime.date.today().isoformat()
    kernel = platform.release().partition("-")[0]
    state = f"{day}, Linux {kernel}, {os.cpu_count()} CPUs, load average {load:.1f} before"
    if program != LABORATORY:
        state += f", by {pathlib.Path(program[0]).name}"
    return "\n".join([f"replenish {command}", state, "", *lines])


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("page", type=pathlib.Path)
    options.add_argument("words", nargs="*")
    options.add_argument("--program", help="default: cargo run --release -p replenish-bench")
    given = options.parse_args()
    program = [given.program] if given.program else LABORATORY
    text = given.page.read_text()
    for figure in FIGURE.finditer(text):
        command = figure["command"]
        if all(word in command for word in given.words):
            block = f"<!-- figures: {command} -->\n```text\n{measured(command, program)}\n```\n"
            # Each at once: a later one may fail.
            text = text.replace(figure[0], block)
            given.page.write_text(text)
            print(block)


if __name__ == "__main__":
    main()
