#!/usr/bin/env python3
"""Changes one line of the core at a time and runs the tests that must notice: a test has to fail
for each mutant. A mutant that survives, and a text that is not there any more, is an error.

    mutants.py [--target-dir DIR] [--list] [part of a name…]

The mutants stand in `mutants_list.py`. They are made in a copy of the tree, in `target/mutants`, and
built there, so that no binary of yours comes from a mutant. `cargo mutants`, where it is installed,
tries more of them (`cargo mutants -p sporadic`); this list is short enough for every night, and each
of its lines was chosen because a guarantee hangs on it.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

from mutants_list import BEFORE, GROUPS

ROOT = Path(__file__).resolve().parent.parent
COPY = ROOT / "target/mutants/tree"
MOST = 300  # seconds that the tests may take; a mutant may hang
MEMORY = 3 << 30  # bytes of address space that they may take; a mutant may queue without end
# Each mutant is built and runs once: what is quick to build is quick.
QUICK = ["debug=false", "incremental=true", "package.{}.opt-level=1"]


def tree():
    """Brings the copy up to date; files that are the same keep their times, so builds are short."""
    command = ["git", "ls-files", "-co", "--exclude-standard", "-z"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout
    for name in filter(None, names.decode().split("\0")):
        source, copy = ROOT / name, COPY / name
        if not source.is_file():
            continue
        if copy.is_file() and copy.read_bytes() == source.read_bytes():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(source.read_bytes())


def mutated(name, file, old, new):
    text = (ROOT / file).read_text()
    count = text.count(old)
    if count != 1:
        raise SystemExit(f"{name}: {file} has {count} times, and not once:\n{old}")
    return text.replace(old, new)


class Tests:
    """The tests of one group of mutants: what is built, and which of it runs."""

    def __init__(self, group, target):
        crate = group["crate"]
        quick = [word for line in QUICK for word in ("--config", "profile.dev." + line.format(crate))]
        self.build = ["cargo", "test", "--quiet", "-p", crate, *quick, *group["target"]]
        self.filters = group["tests"]
        usual = {"RUST_BACKTRACE": "0", "PROPTEST_CASES": "64"}
        self.environment = {**usual, **os.environ, "CARGO_TARGET_DIR": str(target)}

    def run(self, words, limit):
        """Runs cargo in a process group of its own, which ends with this call however it ends.
        With a `limit`, in seconds, memory is limited, too."""
        memory = ["prlimit", f"--as={MEMORY}"] if limit else []
        with subprocess.Popen(
            [*memory, *self.build, *words], cwd=COPY, env=self.environment, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        ) as child:
            try:
                return child.communicate(timeout=limit)[0], child.returncode
            finally:
                try:
                    os.killpg(child.pid, signal.SIGKILL)
                except ProcessLookupError:
                    pass  # the whole group has ended

    def compiles(self):
        """Compiling has no time limit."""
        out, code = self.run(["--no-run"], None)
        return None if code == 0 else out[-2000:]

    def failure(self):
        """The first test that fails, or that they hang; `None` if all pass."""
        try:
            out, code = self.run(["--", *self.filters], MOST)
        except subprocess.TimeoutExpired:
            return f"they hang: over {MOST} s"
        ran = sum(int(n) for n in re.findall(r"^running (\d+) tests?$", out, re.M))
        if code == 0:
            if ran == 0:
                raise SystemExit(f"{' '.join(self.filters)}: no such test")
            return None
        failed = re.findall(r"^    (\S*\w::\w+)$", out, re.M)
        return failed[0] if failed else out.strip().splitlines()[-1]


def group_of(group, words, target):
    """Tries the mutants of one group; how many there were, which survived, and which of those that
    count as equivalent did not."""
    wanted = [m for m in group["mutants"] if not words or any(w in m[0] for w in words)]
    if not wanted:
        return 0, [], []
    tests = Tests(group, target)
    named = ["-p", group["crate"], *group["target"], "--", *group["tests"]]
    print(f"== {group['name']}: cargo test {' '.join(named)}", flush=True)
    broken = tests.compiles() or tests.failure()
    if broken:
        raise SystemExit(f"without a mutant: {broken}")
    survived, wrong = [], []
    for name, file, old, new, *reason in wanted:
        began = time.monotonic()
        text = mutated(name, file, old, new)
        try:
            (COPY / file).write_text(text)
            broken = tests.compiles()
            if broken:
                raise SystemExit(f"{name} does not compile:\n{broken}")
            failed = tests.failure()
        finally:
            (COPY / file).write_bytes((ROOT / file).read_bytes())
        took = f"{time.monotonic() - began:.0f} s"
        if reason:
            verdict = "equivalent" if failed is None else f"NOT EQUIVALENT, {failed}"
            wrong.extend([name] if failed else [])
        else:
            verdict = "SURVIVED" if failed is None else f"killed by {failed}"
            survived.extend([name] if failed is None else [])
        print(f"{name}: {verdict} ({took})", flush=True)
    counted = sum(1 for m in wanted if len(m) == 4)
    return counted, survived, wrong


def stopped(number, _frame):
    """SIGTERM and SIGHUP unwind as Ctrl-C does: children end, and the copy is whole again."""
    raise SystemExit(128 + number)


def main():
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stopped)
    words = sys.argv[1:]
    target = ROOT / "target/mutants/target"
    if words[:1] == ["--target-dir"]:
        target, words = Path(words[1]).resolve(), words[2:]
    for group in GROUPS:  # a text that is gone is found before anything is built
        for name, file, old, new, *_ in group["mutants"]:
            mutated(name, file, old, new)
    if words[:1] == ["--list"]:
        for group in GROUPS:
            for name, file, _, _, *reason in group["mutants"]:
                print(f"{group['name']}: {name} ({file}){': ' if reason else ''}{''.join(reason)}")
        return
    tree()
    total, survived, wrong = 0, [], []
    for group in GROUPS:
        counted, alive, contradicted = group_of(group, words, target)
        total, survived, wrong = total + counted, survived + alive, wrong + contradicted
    if not total and not wrong:
        raise SystemExit(f"no mutant is called {' or '.join(words)}")
    print(f"score: {total - len(survived)} of {total} killed; {BEFORE}")
    if survived or wrong:
        raise SystemExit(f"survived: {survived}; killed, although equivalent: {wrong}")


if __name__ == "__main__":
    main()
