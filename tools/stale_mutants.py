#!/usr/bin/env python3
"""Prints each line of the lists of mutants and regressions that does not stand exactly once in its
file: such an entry would change nothing, and its test would be no evidence. The lists are read without
being run, since they need a prover and a copy of the tree.
"""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LISTS = {"proofs/regressions.py": "", "proofs/mutants.py": "crates/sporadic/src/", "tools/mutants_list.py": ""}


def lists(script):
    """The constants of a script that are lists of tuples."""
    values = {}
    for step in ast.parse((ROOT / script).read_text()).body:
        if isinstance(step, ast.Assign):
            try:
                exec(compile(ast.Module([step], []), script, "exec"), values)
            except NameError:  # not a constant
                continue
    return [v for v in values.values() if isinstance(v, list) and v and isinstance(v[0], tuple)]


for script, folder in LISTS.items():
    for entry in (entry for entries in lists(script) for entry in entries):
        at = next((at for at, text in enumerate(entry) if re.search(r"\.rs$", str(text))), None)
        if at is None:
            continue
        file, line = ROOT / folder / entry[at], entry[at + 1]
        times = file.read_text().count(line) if file.exists() else 0
        if times != 1:
            print(f"{script}: {line!r} stands {times} times in {entry[at]}")
