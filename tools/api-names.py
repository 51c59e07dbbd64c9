#!/usr/bin/env python3
"""Looks up every name of docs/api.md in the source of its column: replenish, rclrs, rclcpp.

    api-names.py RCLRS RCLCPP     two git repositories: clones of ros2-rust/ros2_rust and ros2/rclcpp

A name is a word in backticks. The source must define it: a function, type, module, macro, field, variant or variable.
That the definition is the one meant, and does what the page says, a reader has to judge.
CI has neither repository: run it by hand after a change of the table.
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUST = [r"\b(fn|struct|enum|trait|type|const|static|mod|macro_rules!)\s+{0}\b", r"\b{0}:\s", r"^\s*{0},$"]
CPP = [r"\b(class|struct|using|namespace|enum|define)\s+(\w+\s+)?{0}\b", r"(^|[\w>&*\]:])\s*{0}\s*\(", r"[\w>&*]\s+{0};"]
DEFINED = {"replenish": RUST, "rclrs": RUST, "rclcpp": CPP}
# Names that a generator makes, with a word of the source that stands for them: of the generator, or of a use.
MADE = {
    "RCLCPP_INFO_THROTTLE": "get_rclcpp_suffix_from_features",
    "SetBool_Request": r"SetBool_Request|AddTwoInts_Request",
    "SetBoolRequest": "SetBoolRequest",
}
# Names of the examples, of the languages and their libraries, and of interface packages.
OURS = set("arm t s a p q r d f m M S A ctx cx use async await include hpp rs build repeating double std void".split())
OURS |= set("Duration argc argv make_shared _".split())


def names():
    """The names of each column."""
    columns = {column: set() for column in DEFINED}
    for line in (ROOT / "docs/api.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if not line.startswith("| ") or len(cells) != 4:
            continue
        for column, cell in zip(columns, cells[1:]):
            for code in re.findall(r"`([^`]+)`", cell):
                code = re.sub(r'"[^"]*"', "", code)
                columns[column].update(re.findall(r"[A-Za-z_]\w*", code))
    return {column: sorted(words - OURS) for column, words in columns.items()}


def main():
    missing = 0
    for (column, words), repository in zip(names().items(), [ROOT, *sys.argv[1:3]], strict=True):
        git = ["git", "-C", repository]
        head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
        absent = []
        for word in words:
            defined = [rf"\b({MADE[word]})\b"] if word in MADE else [p.format(word) for p in DEFINED[column]]
            patterns = [part for pattern in defined for part in ("-e", pattern)]
            grep = [*git, "grep", "-qP", *patterns, "HEAD", "--", "*.rs", "*.hpp", "*.em", "*.cpp", "*.py"]
            if subprocess.run(grep).returncode:
                absent.append(word)
        missing += len(absent)
        found = len(words) - len(absent)
        print(f"{column} {head.stdout.strip()}: {found} of {len(words)} names; not there: {absent}")
    sys.exit(missing > 0)


if __name__ == "__main__":
    main()
