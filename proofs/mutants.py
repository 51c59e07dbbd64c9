#!/usr/bin/env python3
"""Changes one line of the code and the same line of the model at a time: an obligation of the proof
and a test must fail for each. A mutant that passes either is printed, and is an error.

    mutants.py [name…]
"""

import importlib
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import model
import paths
import prove

# A mutant's log may grow without end. Its tests get no more memory than this; they need a tenth.
MEMORY = 2 << 30

ROOT = Path(__file__).resolve().parent.parent
CRATE = ROOT / "crates/sporadic"
COPY = ROOT / "target/mutants/sporadic"

# name, file, its line, the mutated line, the model's, the mutated one
MUTANTS = [
    ("back too early", "corrected.rs",
     "time: later(time, period),", "time: later(time, period - 1),",
     "back = (time + self.period, taken)", "back = (time + self.period - 1, taken)"),
    ("merged at the earlier time", "corrected.rs",
     "            youngest.time = chunk.time;\n", "",
     "youngest = (chunk[0], amount + chunk[1])", "youngest = (time, amount + chunk[1])"),
    ("merged away", "corrected.rs",
     "youngest.amount += chunk.amount;", "youngest.amount = chunk.amount;",
     "youngest = (chunk[0], amount + chunk[1])", "youngest = (chunk[0], chunk[1])"),
    ("activated too early", "corrected.rs",
     "        self.head.time = time;\n", "",
     "        self.head = (time, self.head[1])\n", ""),
    ("activation loses a chunk", "corrected.rs",
     "self.head.amount += next.amount;", "",
     "self.head = (self.head[0], self.head[1] + next_[1])", "pass"),
    ("a sliver comes early", "corrected.rs",
     "time: next.time,", "time: self.head.time,",
     "self.head = (next_[0], self.head[1] + next_[1])",
     "self.head = (self.head[0], self.head[1] + next_[1])"),
    ("a large overrun is forgiven", "corrected.rs",
     "chunk.time = later(chunk.time, delay);", "chunk.time += delay - period;",
     "delay = rounds * self.period", "delay = (rounds - 1) * self.period"),
    ("an overrun is forgiven", "corrected.rs",
     "rest -= taken;", "rest = 0;",
     "rest = rest - taken", "rest = 0"),
    ("starvation piles budgets up", "corrected.rs",
     "        self.count_from(since(since(now, used), period));\n", "",
     "        self.count_from(minus(minus(now, used), self.period))\n", ""),
    ("paid in advance for ever", "reservation.rs",
     "        self.advance -= paid;\n", "",
     "        self.advance = self.advance - paid\n", ""),
    ("unknown counts as seen", "reservation.rs",
     "Readings::Unknown => self.server.activate(since(now, used)),",
     "Readings::Unknown => {}",
     "self.server.activate(minus(now, used))", "pass"),
    ("a block is no activation", "reservation.rs",
     "                        self.server.activate(interval.in_at);\n", "",
     "                    self.server.activate(in_at)\n", ""),
    ("a sliver is lost", "reservation.rs",
     "            self.advance = left;\n", "",
     "            self.advance = left\n", ""),
    ("twice the slack", "reservation.rs",
     "left <= self.tuning.slack", "left <= 2 * self.tuning.slack",
     "left <= self.slack", "left <= 2 * self.slack"),
    ("time is counted twice", "reservation.rs",
     "self.counters.cpu_low += used - rest;", "self.counters.cpu_low += used;",
     "self.cpu_low + used - rest", "self.cpu_low + used"),
    ("nobody looks after an early check", "reservation.rs",
     "        self.plan(now);\n        Verdict { change: None }", "        Verdict { change: None }",
     "            return want\n        self.plan(now)\n", "            return want\n"),
    ("observing forgets the check", "reservation.rs",
     "            self.account(now, cpu, readings);\n            self.replan(now);",
     "            self.account(now, cpu, readings);",
     "            self.account(now, cpu, readings)\n            self.replan(now)\n",
     "            self.account(now, cpu, readings)\n"),
]

MANIFEST = """
[package]
name = "sporadic"
version = "0.0.0"
edition = "2024"
[features]
default = ["posix"]
posix = []
[dev-dependencies]
proptest = { version = "1.12", default-features = false, features = ["std", "bit-set"] }
[profile.test]
opt-level = 1
debug = false
[workspace]
"""


def mutated(text, old, new, name):
    assert text.count(old) == 1, f"{name}: {old!r} is there {text.count(old)} times"
    return text.replace(old, new)


def refuted(name, old, new):
    """The first obligation that fails with the mutated model."""
    source = Path(model.__file__).read_text()
    exec(compile(mutated(source, old, new, name), "mutated model", "exec"), model.__dict__)
    try:
        for obligation in prove.OBLIGATIONS:
            try:
                prove.prove(obligation, 1)
            except AssertionError as failure:
                return str(failure)
            except TypeError as failure:  # a number where there was a symbol
                return f"{obligation.__name__}: {failure}"
    finally:
        importlib.reload(model)
        importlib.reload(prove)
    return None


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def test(directory):
    """The tests that fail; None if all pass. Compiling has no time limit, the tests have."""
    command = ["cargo", "test", "--quiet", "--offline", "--test", "it"]
    env = {**os.environ, "REPLENISH_TRACES": "1000", "RUST_BACKTRACE": "0"}
    subprocess.run([*command, "--no-run"], cwd=directory, check=True, env=env)
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, cwd=directory, stdout=pipe, stderr=pipe, text=True, env=env, start_new_session=True,
        preexec_fn=limited,
    ) as run:
        try:
            out, errors = run.communicate(timeout=300)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)  # the test program, too
            raise SystemExit("its tests took over 5 minutes: they hang, or the machine is busy")
    if run.returncode == 0:
        return None
    failed = re.findall(r"^    (\w+(?:::\w+)+)$", out, re.M)
    return sorted(set(failed)) or [errors[-300:]]


def main():
    names = sys.argv[1:]
    COPY.mkdir(parents=True, exist_ok=True)
    for part in ("src", "tests"):
        shutil.rmtree(COPY / part, ignore_errors=True)
        # Newer than what a run that was cut short has built of a mutant.
        shutil.copytree(CRATE / part, COPY / part, copy_function=shutil.copyfile)
    (COPY / "Cargo.toml").write_text(MANIFEST)
    shutil.copy(ROOT / "Cargo.lock", COPY / "Cargo.lock")
    assert test(COPY) is None, "the tests fail without a mutant"
    alive, mutants = 0, 0
    for name, file, line, change, of_model, of_mutant in MUTANTS:
        if names and name not in names:
            continue
        original = (CRATE / "src" / file).read_text()
        (COPY / "src" / file).write_text(mutated(original, line, change, name))
        failed = test(COPY)
        (COPY / "src" / file).write_text(original)
        refutation = refuted(name, of_model, of_mutant)
        mutants += 1
        alive += (failed is None) + (refutation is None)
        tests = f"{len(failed)} tests, such as {failed[0]}" if failed else "NO TEST"
        print(f"{name}:\n  proof: {refutation or 'NOTHING FAILS'}\n  tests: {tests}", flush=True)
    print(f"{mutants} mutants, {alive} times not seen")
    if alive:
        raise SystemExit(f"{alive} times a mutant was not seen")


if __name__ == "__main__":
    main()
