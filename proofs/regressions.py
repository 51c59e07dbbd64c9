#!/usr/bin/env python3
"""Undoes each mending of `docs/enforcement.md` (C1 to C19, S), one line at a time, in a copy of the
workspace, and runs the row's test there: it must pass before, and fail or hang after.

    regressions.py [row or crate…]      for instance C7 sporadic
"""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
COPY = ROOT / "target/regressions"
# Seconds. A mutant may hang: a watchdog of the test's own, or this, ends it.
LONGEST = 150
# Nor does it take the machine's memory. Threads reserve much more than they use.
MEMORY = 16 << 30

OS, EXECUTOR, PLAN = ("replenish-os", "replenish", "replenish-plan")
WATCHDOG = "crates/replenish-os/src/enforcer/supervision.rs"
BUS = "crates/replenish/src/middleware/in_process"

# row, file, its line, the line without the mending, package, its test binary, test
REGRESSIONS = [
    ("C1", "crates/replenish-os/src/linux/suspend.rs",
     "let lowered = sched::set_priority(tid, SchedClass::Other);", "let lowered: io::Result<()> = Ok(());",
     OS, "rt", "a_section_that_outlasts_the_budget_is_left_low_and_paid_for"),
    ("C1", "crates/replenish-os/src/linux/suspend.rs",
     "let lowered = sched::set_priority(tid, SchedClass::Other);", "let lowered: io::Result<()> = Ok(());",
     EXECUTOR, "rt", "e31_a_suspended_worker_is_held_inside_a_group"),
    ("C1", "crates/replenish/src/executor/handles/one_user.rs",
     """        let value = self.0.lock().take()?;
        let mut taken = Taken {
            owner: self,
            value: Some(value),
        };
        taken.value.as_mut().map(work)
""", "        self.0.lock().as_mut().map(work)\n",
     EXECUTOR, "rt", "suspended::"),
    ("C1", "crates/replenish-os/src/linux/suspend.rs",
     "install_handler().and_then(|()| unblock_signal())", "install_handler()",
     OS, "rt", "a_program_that_blocks_all_signals_has_its_workers_stopped"),
    ("C2", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "if self.suspend.is_stopped() {", "if self.suspend.is_stopped() || late < u64::MAX {",
     OS, "rt", "a_worker_that_blocks_in_a_section_has_one_budget_when_it_wakes"),
    ("C17", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "self.escaped |= self.supervised.is_above_its_own();", "self.escaped |= false;",
     OS, "rt", "a_worker_that_raises_itself_pays_whoever_reads_its_account"),
    ("C17", "crates/replenish-os/src/linux/foreign/member.rs",
     "counted.map_or(self.mark + elapsed, |count| self.begin + count)", "counted.map_or(self.mark, |_| self.mark)",
     OS, "rt", "threads_that_end_are_charged_to_their_end"),
    ("C17", "crates/replenish-os/src/linux/foreign/group.rs",
     "        self.cpu += used;\n", "        self.cpu += used.min(elapsed);\n",
     OS, "rt", "threads_on_several_cpus_are_charged_each"),
    ("C17", WATCHDOG,
     "self.escaped = true;", "self.escaped = false;",
     OS, "rt", "a_worker_without_budget_that_raises_itself_pays_for_it"),
    ("C17", WATCHDOG,
     "has != self.given || (self.resets && !resets)", "has != self.given || (self.resets && !self.resets)",
     OS, "rt", "a_worker_that_drops_its_reset_on_fork_has_it_back"),
    ("C2", "crates/sporadic/src/reservation.rs",
     "Readings::Unknown => self.server.activate(since(now, used)),", "Readings::Unknown => {}",
     "sporadic", "it", "budget_does_not_pile_up_while_nobody_sees_it_block"),
    ("C2", "crates/sporadic/src/reservation.rs",
     "Readings::Unknown => self.server.activate(since(now, used)),", "Readings::Unknown => {}",
     EXECUTOR, "rt", "e13_blocking_without_records_piles_nothing_up"),
    ("C3", "crates/replenish-plan/src/planner/locks.rs",
     "if other.length.is_none() {", "if other.length.is_none() && both.is_empty() {",
     PLAN, "it", "work_of_unknown_length_in_a_group_is_refused"),
    ("C3", "crates/replenish-plan/src/planner/locks.rs",
     "        why_not(request, lock, waiting, other).map_or(Ok(()), Err)?;",
     "        let _ = why_not(request, lock, waiting, other);",
     EXECUTOR, "rt", "e15_a_guarantee_knows_who_shares_its_group"),
    # Stands for memory that was freed and used by others: it said "stop".
    ("C4", "crates/replenish-os/src/linux/supervised.rs",
     "        self.0.users.fetch_sub(1, Ordering::Release);\n",
     "        self.0.suspension.stop();\n        self.0.users.fetch_sub(1, Ordering::Release);\n",
     OS, "rt", "nothing_of_an_account_stays_in_its_thread"),
    ("C5", "crates/sporadic/src/reservation.rs",
     "        self.server.charge(amount, now);\n        self.counters.owed += amount;",
     "        let _ = now;\n        self.counters.owed += amount;",
     "sporadic", "it", "high_and_inherited_time_together_is_the_budget"),
    ("C5", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "Low::Background(_) => inherited.min(used),", "Low::Background(_) => inherited.min(used).min(0),",
     EXECUTOR, "rt", "e02_inherited_priority_is_no_free_budget"),
    ("C6", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "        if !obeyed {", "        if !obeyed && late == u64::MAX {",
     OS, "rt", "a_privilege_that_goes_away_is_reported"),
    ("C6", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "                    self.suspend.lower_itself(self.tid, low);\n", "",
     OS, "rt", "a_worker_that_its_enforcer_may_not_lower_lowers_itself"),
    ("C7", "crates/replenish/src/executor/change/live.rs",
     "if own || self.groups.has_mine() || self.updates.is_mine() {", "if own || self.groups.has_mine() {",
     EXECUTOR, "it", "a_hook_that_removes_its_handle_holds_up_nobody"),
    ("C8", "crates/replenish-os/src/enforcer/meter.rs",
     "            b.suspend.cancel();\n",
     "            b.suspend.cancel();\n            b.with(|t| drop(t.suspend.resume_at(t.tid, 40)));\n",
     EXECUTOR, "rt", "e34_a_stop_gives_a_suspended_worker_no_priority"),
    ("C8", "crates/replenish/src/executor/run/worker.rs",
     "        self.end(account, &accounting);\n",
     "        account.meter().abandon();\n        self.end(account, &accounting);\n",
     EXECUTOR, "rt", "e17_what_a_callback_owns_is_dropped_on_its_budget"),
    ("C9", "crates/sporadic/src/reservation.rs",
     "        (budget / 4)\n", "        (budget / 4).max(self.max_backoff)\n",
     "sporadic", "it", "a_small_budget_that_blocks_overruns_by_a_quarter"),
    ("C9", "crates/replenish-plan/src/machine.rs",
     "let max_backoff = if seen { 0 } else { self.tuning.max_backoff };",
     "let max_backoff = if seen { 0 } else { 0 };",
     PLAN, "it", "a_budget_whose_callbacks_wait_inside_is_overdrawn_by_a_check_that_was_put_off"),
    ("C10", "crates/sporadic/src/reservation.rs",
     "            self.advance = left;\n", "",
     "sporadic", "it", "the_long_run_share_of_small_budgets"),
    ("C10", "crates/sporadic/src/reservation.rs",
     "            self.advance = left;\n", "",
     "sporadic", "it", "a_hungry_thread"),
    ("C11", "crates/sporadic/src/corrected.rs",
     "        self.count_from(since(since(now, used), period));\n", "",
     "sporadic", "it", "after_starvation_two_budgets_come_back_to_back"),
    ("C12", "crates/replenish/src/executor/start/plan.rs",
     "&& params.max_repl() < 2", "&& params.max_repl() < 1",
     EXECUTOR, "it", "one_pending_replenishment_is_too_few"),
    ("C13", "crates/replenish-os/src/linux/lock_wait.rs",
     "        if current_tid() != self.tid {", "        if current_tid() != self.tid || self.tid.get() > 0 {",
     OS, "rt", "waiting_for_the_enforcers_lock_is_no_blocking"),
    ("C14", "crates/replenish/src/executor/handles/entry.rs",
     "        self.guarded(env, Self::drop_callback);\n", "        let _ = env;\n        self.drop_callback();\n",
     EXECUTOR, "it", "state_that_panics_when_dropped_ends_no_stop"),
    ("C14", "crates/replenish/src/executor/handles/entry.rs",
     "        self.guarded(env, Self::drop_callback);\n", "        let _ = env;\n        self.drop_callback();\n",
     EXECUTOR, "it", "a_panic_in_drop_is_the_removed_handles_own"),
    ("C15", f"{BUS}.rs",
     "(bus.leave(self.me), bus.watchers())",
     "(bus.leave(usize::MAX), bus.watchers())",
     EXECUTOR, "it", "a_context_that_goes_leaves_its_place"),
    ("C15", f"{BUS}/bus.rs",
     "            if topic.endpoints == 0 {", "            if topic.endpoints == usize::MAX {",
     EXECUTOR, "it", "a_topic_that_nobody_has_leaves_its_place_and_its_type"),
    ("C16", "crates/replenish-os/src/linux/blocking_detector.rs",
     "if log.drain(&mut feed).lost {", "if log.drain(&mut feed).lost && now == 0 {",
     OS, "lib", "a_ring_that_overflowed_is_not_believed"),
    ("C16", "crates/replenish-os/src/linux/blocked_intervals.rs",
     "        self.restart(now);\n        self.incomplete = true;", "        self.incomplete = true;",
     OS, "lib", "after_a_loss_the_last_record_is_not_believed"),
    ("C17", WATCHDOG,
     "if has == Some(given) && (resets || !view.resets) {", "if has == Some(given) || given > 0 {",
     OS, "rt", "a_worker_that_raises_itself_is_put_back"),
    ("C18", "crates/replenish-cli/src/signals.rs",
     "        self.0.stopped.load(Ordering::Acquire)\n",
     "        let _asked = self.0.asked.lock();\n        self.0.stopped.load(Ordering::Acquire)\n",
     "replenish-cli", "lib", "to_look_takes_no_lock"),
    ("C18", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "            self.reservation.postpone(since(due, at));\n", "            let _ = due;\n",
     OS, "lib", "the_check_of_a_thread_that_waits_for_the_cpu_counts_from_the_change"),
    ("C19", "crates/replenish-bench/src/testbench/summary.rs",
     "100.0 - self.support_cpu_percent - self.stolen_percent - self.others_percent();", "100.0;",
     "replenish-bench", "lib", "what_was_not_there_is_missing_in_the_background_and_idle_time_was_there"),
    ("S", "crates/replenish-os/src/enforcer/state.rs",
     "                return; // for good: signals are no error. It would come back at once, for ever.\n",
     "                continue;\n",
     OS, "lib", "an_enforcer_that_cannot_read_its_timer_ends_and_lowers_its_workers"),
    ("S", WATCHDOG,
     "            state.sweep(&mut threads, Enforcement::OtherCpu); // the workers run meanwhile\n", "",
     OS, "rt", "a_silent_enforcer_is_reported_and_its_worker_lowered"),
    ("S", WATCHDOG,
     "        if late > OVERDUE || wrong || !faults.is_empty() {\n",
     "        if late < NEVER {\n",
     OS, "lib", "a_look_that_finds_nothing_wrong_takes_no_lock"),
    ("S", WATCHDOG, "        self.glance_again(known);\n", "",
     OS, "lib", "a_look_amid_a_change_takes_no_lock"),
    ("S", WATCHDOG,
     "lock_when_free(&state.threads, now.saturating_add(PATIENCE))",
     "state.threads.lock_until(now.saturating_add(PATIENCE))",
     OS, "lib", "a_look_does_not_wait_for_the_lock_in_the_kernel"),
    ("S", WATCHDOG,
     "if clock::monotonic().saturating_sub(state.views.due()) > OVERDUE {\n", "if late < NEVER {\n",
     OS, "lib", "an_enforcer_that_judges_in_time_keeps_its_workers"),
    ("S", "crates/replenish-os/src/linux/pi_lock.rs",
     "let seized = word.load() & WAITERS != 0 && word.seize();", "let seized = false;",
     OS, "rt", "try_lock_takes_what_a_less_urgent_thread_was_handed_and_has_no_cpu_for"),
    ("S", "crates/replenish-os/src/linux/lock_wait.rs",
     "if cfg!(loom) { 0 } else { PATIENCE }", "if cfg!(loom) { 0 } else { 0 }",
     OS, "lib", "a_reader_does_not_wait_for_the_lock_in_the_kernel"),
    ("S", "crates/replenish-os/src/enforcer/change_user.rs",
     "let helper = spawn(spec, move || help(&theirs));", "let helper = spawn(spec, move || drop(theirs));",
     OS, "rt", "a_program_that_gives_up_its_user_waits_for_no_budget"),
    ("S", WATCHDOG,
     "        self.restore_enforcer(known, faults);\n", "",
     OS, "rt", "an_enforcer_that_lost_its_priority_gets_it_back"),
    ("S", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "                self.suspend.resume();\n                self.supervised.note(Some(high), true);\n",
     "                self.supervised.note(Some(high), true);\n",
     OS, "lib", "while_changes_are_refused_a_worker_has_its_budget_and_no_more"),
    ("S", "crates/replenish-os/src/enforcer/enforced_thread.rs",
     "                self.suspend.suspend(self.tid, runs).ok(); // it is there already\n", "                let _ = runs;\n",
     OS, "lib", "while_changes_are_refused_a_worker_has_its_budget_and_no_more"),
    ("S", "crates/sporadic/src/reservation.rs",
     "        } else if !self.refused {\n", "        } else {\n",
     "sporadic", "it", "a_refused_change_is_not_asked_for_at_each_activation"),
    ("S", "crates/replenish-os/src/linux/suspension.rs",
     "        self.kept.store(held, Ordering::Relaxed);\n", "",
     OS, "rt", "a_forgotten_guard_keeps_nothing_from_stopping"),
    ("S", "crates/replenish-os/src/linux/suspend.rs",
     "        if in_library.is_none() || !slot.retry.again(clock::thread_cpu()) {",
     "        if in_library.is_none() || clock::thread_cpu() > 0 {",
     OS, "rt", "a_stopped_worker_does_not_keep_the_heap"),
    ("S", "crates/replenish-os/src/linux/supervised.rs",
     "            slot.users.fetch_sub(1, Ordering::Release);\n", "",
     OS, "lib", "places_are_used_again_when_nobody_has_them"),
]



def copied():
    """The sources as they are, with their times, so that what was built there before stays."""
    ours = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    )
    names = [name for name in ours.stdout.split("\0") if name]
    crates = {COPY / Path(*Path(name).parts[:2]) for name in names}
    for gone in set(COPY.glob("crates/*")) - crates:
        shutil.rmtree(gone)
    for name in names:
        source, to = ROOT / name, COPY / name
        if not source.is_file():
            continue
        to.parent.mkdir(parents=True, exist_ok=True)
        if not to.exists():
            shutil.copy2(source, to)
        elif to.read_bytes() != source.read_bytes():
            shutil.copyfile(source, to)  # newer than what a run that was cut short has built


def build(package, target):
    arguments = ["cargo", "test", "--quiet", "-p", package, *(["--lib"] if target == "lib" else ["--test", target])]
    built = subprocess.run(
        [*arguments, "--no-run"], cwd=COPY, capture_output=True, text=True, env=environment()
    )
    if built.returncode:
        raise SystemExit(f"{package}: does not compile\n{built.stderr[-3000:]}")
    return arguments


def environment():
    return {**os.environ, "REPLENISH_REQUIRE_RT": "1", "RUST_BACKTRACE": "0", "CARGO_INCREMENTAL": "0",
            "CARGO_TARGET_DIR": os.environ.get("REPLENISH_REGRESSIONS_TARGET", str(COPY / "target"))}


def limited():
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))


def outcome(package, target, test):
    """None if the test passes; otherwise how it does not."""
    arguments = build(package, target)
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [*arguments, "--", test], cwd=COPY, stdout=pipe, stderr=subprocess.STDOUT, text=True,
        env=environment(), start_new_session=True, preexec_fn=limited,
    ) as run:
        try:
            out, _ = run.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)  # the test program, too
            run.communicate()
            return "hangs"
    ran = sum(int(n) for n in re.findall(r"(\d+) passed", out))
    if run.returncode == 0:
        if ran == 0:
            raise SystemExit(f"{test}: nothing ran\n{out[-1000:]}")
        return None
    said = re.search(r"panicked at [^\n]*\n\s*([^\n]+)", out)
    return said[1] if said else " ".join(out.split())[-160:]


def main():
    rows = sys.argv[1:]
    wanted = [r for r in REGRESSIONS if not rows or r[0] in rows or r[4] in rows]
    copied()
    for package, target, test in dict.fromkeys(r[4:] for r in wanted):
        before = outcome(package, target, test)
        if before:
            raise SystemExit(f"{test} fails without a mutant: {before}")
    seen, failed = 0, {}
    for row, file, line, change, package, target, test in wanted:
        path = COPY / file
        original = path.read_text()
        assert original.count(line) == 1, f"{row}: {line!r} is there {original.count(line)} times"
        began = time.monotonic()
        path.write_text(original.replace(line, change))
        try:
            after = outcome(package, target, test)
        finally:
            path.write_text(original)
        seen += after is not None
        failed[row] = failed.get(row, True) and after is not None
        took = time.monotonic() - began
        print(f"{row} {test}: {after or 'PASSES ALL THE SAME'} ({took:.0f} s)", flush=True)
    print(f"{seen} of {len(wanted)} tests fail without the mending")
    if seen < len(wanted):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
