#!/usr/bin/env python3
"""Looks up every name of the columns `rclrs` and `rclcpp` of docs/api.md in their sources.

    api-names.py RCLRS RCLCPP     two git repositories: clones of ros2-rust/ros2_rust and ros2/rclcpp

A name is a word in backticks. That it stands in the source is what this shows, not what it does there.
CI has neither repository: run it by hand after a change of the table.
"""

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs/api.md"
# Names of the examples, of the languages, and of interface packages.
# Names that a generator makes, with the name in the source that stands for them.
MADE = {"RCLCPP_INFO_THROTTLE": "get_rclcpp_suffix_from_features", "SetBool_Request": "AddTwoInts_Request"}
OURS = set("arm t s a p q d f m M S A use async await include hpp repeating double std void".split())


def names():
    """The names of each column."""
    columns = {"rclrs": set(), "rclcpp": set()}
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if not line.startswith("| ") or len(cells) != 4:
            continue
        for column, cell in zip(columns, cells[2:]):
            for code in re.findall(r"`([^`]+)`", cell):
                code = re.sub(r'"[^"]*"', "", code)
                columns[column].update(re.findall(r"[A-Za-z_]\w*", code))
    return {column: sorted(words - OURS) for column, words in columns.items()}


def main():
    missing = 0
    for (column, words), repository in zip(names().items(), sys.argv[1:3], strict=True):
        git = ["git", "-C", repository]
        head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
        found = []
        for word in words:
            grep = [*git, "grep", "-qw", MADE.get(word, word), "HEAD", "--", "*.rs", "*.hpp", "*.em", "*.cpp"]
            found.append(subprocess.run(grep).returncode == 0)
        absent = [word for word, there in zip(words, found) if not there]
        missing += len(absent)
        print(f"{column} {head.stdout.strip()}: {sum(found)} of {len(words)} names; not there: {absent}")
    sys.exit(missing > 0)


if __name__ == "__main__":
    main()
