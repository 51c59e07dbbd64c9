#!/usr/bin/env python3
"""Whether `model.py` is the code: both replay the same random calls, and every state must be the same.

    differential.py [calls] [seed]      (200000 and 1, if not said)
"""

import os
import random
import subprocess
import sys
from pathlib import Path

import model

ROOT = Path(__file__).resolve().parent.parent


def history(rng, calls):
    """Lines for the example and, for each, what to do to the model."""
    while calls > 0:
        budget = rng.choice([1, 2, 3, 5, 8, 20, 100, 1000])
        period = budget + rng.choice([0, 1, 3, 7, budget, 9 * budget])
        limit = rng.randint(1, 5)
        tuning = [rng.choice([0, 1, 2, 5, 12]) for _ in range(2)] + [rng.choice([0, 3, 20, 90])]
        least = rng.choice([0, tuning[0]])
        yield ["new", limit, budget, period, least, *tuning], None
        now, cpu, level = 0, 0, model.HIGH
        for _ in range(rng.randint(1, 60)):
            calls -= 1
            span = rng.choice([0, 1, 2, rng.randint(0, budget), rng.randint(0, 2 * period)])
            ran = rng.choice([0, span, rng.randint(0, span)])
            since, before = now, cpu
            now, cpu = now + span, cpu + ran
            intervals = []
            if rng.random() < 0.4:
                cuts = sorted(rng.randint(since, now) for _ in range(2 * rng.randint(1, 3)))
                intervals = [(rng.randint(0, ran), a, b) for a, b in zip(cuts[::2], cuts[1::2])]
            readings = None if rng.random() < 0.3 else intervals
            name = rng.choice(
                ["activate", "activate", "block", "judge", "judge", "judge", "observe"]
                + ["raised", "lowered", "refused", "pull_in", "owe"]
            )
            numbers = {
                "activate": [rng.randint(0, now + 3), now, cpu],
                "refused": [now],
                "pull_in": [now],
                "owe": [rng.randint(0, budget), now],
            }.get(name, [now, cpu])
            if name in ("refused", "pull_in", "owe"):
                cpu = before
            yield [name, *numbers], readings


def line_of(call, readings):
    words = [str(word) for word in call]
    if call[0] in ("block", "judge", "observe"):
        if readings is None:
            words.append("unknown")
        else:
            words += [f"interval {ran} {out} {back}" for ran, out, back in readings]
    return " ".join(words)


def step(r, call, readings):
    name, numbers = call[0], call[1:]
    if name == "new":
        limit, budget, period, least, slack, rearm, backoff = numbers
        server = model.Corrected(budget, period, limit, least, 0)
        return model.Reservation(server, slack, rearm, backoff, 0, 0), None
    verdict = None
    if name in ("block", "judge", "observe"):
        verdict = getattr(r, name)(*numbers, readings)
    elif name in ("raised", "lowered"):
        r.applied(model.HIGH if name == "raised" else model.LOW, *numbers)
    else:
        getattr(r, name)(*numbers)
    return r, verdict


def shown(r, verdict):
    chunks = "".join(f"{time} {amount} " for time, amount in r.server.chunks())
    check = "None" if r.check_at == model.NEVER else f"Some({r.check_at})"
    runnable, backed = str(r.runnable).lower(), str(r.backoff > 0).lower()
    verdict = "None" if verdict is None else f"Some({verdict})"
    return f"{chunks}| {verdict} {r.level} {runnable} {check} {backed} | {r.cpu_high} {r.cpu_low} {r.inside} {r.owed}"


def main():
    calls = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    script = list(history(random.Random(seed), calls))
    lines = [line_of(*entry) for entry in script]
    cargo = os.environ.get("REPLENISH_REPLAY", "").split() or [
        *"cargo run --quiet --package sporadic --example replay".split()
    ]
    code = subprocess.run(
        cargo, input="\n".join(lines), capture_output=True, text=True, cwd=ROOT, check=True
    )
    states = code.stdout.splitlines()
    assert len(states) == len(lines), (len(states), len(lines), code.stderr)
    r = None
    for i, ((call, readings), state) in enumerate(zip(script, states)):
        r, verdict = step(r, call, readings)
        if shown(r, verdict) != state:
            begin = max(j for j in range(i + 1) if script[j][0][0] == "new")
            raise SystemExit(
                "\n".join(lines[begin : i + 1]) + f"\n  code:  {state}\n  model: {shown(r, verdict)}"
            )
    print(f"the model is the code: {len(lines)} calls, seed {seed}")


if __name__ == "__main__":
    main()
