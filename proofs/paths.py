"""Runs one piece of code over numbers, or over symbols of z3 on every path through it."""

import z3

_state = None


class _Path:
    def __init__(self, assumptions, answers):
        self.solver = z3.Solver()
        self.solver.add(*assumptions)
        self.answers, self.asked = answers, 0
        self.open = []  # beginnings of paths that are still to be walked
        self.quotients = 0

    def possible(self, condition):
        self.solver.push()
        self.solver.add(condition)
        answer = self.solver.check()
        self.solver.pop()
        return answer != z3.unsat  # unknown counts as possible

    def holds(self, condition):
        if self.asked == len(self.answers):
            answer = self.possible(condition)
            if answer and self.possible(z3.Not(condition)):
                self.open.append(self.answers[: self.asked] + [False])
            self.answers.append(answer)
        answer = self.answers[self.asked]
        self.asked += 1
        self.solver.add(condition if answer else z3.Not(condition))
        return answer


def holds(condition):
    """The condition; over symbols, one answer on each path that can have it."""
    return condition if isinstance(condition, bool) else _state.holds(condition)


def divide(a, b):
    """Quotient and remainder. Over symbols `a` is below 2 b, or `b` is a number."""
    if isinstance(a, int) and isinstance(b, int):
        return a // b, a % b
    if isinstance(b, int):
        _state.quotients += 1
        q = z3.Int(f"quotient{_state.quotients}")
        _state.solver.add(q * b <= a, a < (q + 1) * b)
        return q, a - q * b
    return 1, a - b


def explore(assumptions, code):
    """Walks every path through `code` that the assumptions allow: yields the solver of the path,
    which knows its conditions, and what the code returned."""
    global _state
    todo = [[]]
    while todo:
        _state = _Path(assumptions, todo.pop())
        result = code()
        todo += _state.open
        yield _state.solver, result
