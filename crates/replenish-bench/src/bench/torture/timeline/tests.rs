//! The kernel's text, as pieces of CPU time.

use super::super::trace_text::rank;
use super::*;
use crate::load::Nanos;

const TRACE: &str = "\
    tail-7    [001] d..2. 12.000100: sched_switch: prev_comm=tail prev_pid=7 prev_prio=120 prev_state=S ==> next_comm=w [000] next_pid=9 next_prio=39
    w [000]-9 [001] d..2. 12.000150: sched_stat_runtime: comm=w [000] pid=9 runtime=49000 [ns]
    main-5    [000] d..2. 12.000170: sched_stat_runtime: comm=w [000] pid=9 runtime=20000 [ns]
    main-5    [000] d..2. 12.000180: sched_stat_runtime: comm=main pid=5 runtime=77 [ns]
    w-9       [001] d..2. 12.000200: sched_pi_setprio: comm=w pid=9 oldprio=39 newprio=19
    w-9       [001] d..2. 12.000250: sched_switch: prev_comm=w prev_pid=9 prev_prio=19 prev_state=R+ ==> next_comm=swapper/1 next_pid=0 next_prio=120
    idle-0    [001] d..2. 12.000300: sched_switch: prev_comm=swapper/1 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=e next_pid=3 next_prio=0
    e-3       [001] d..2. 12.000310: sched_switch: prev_comm=e prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w next_pid=9 next_prio=39";

/// Torture, seed 255: threads that waited for 20 s beside one that held their group, and were
/// stopped ten times with their process. Each time they used some microseconds, which nobody
/// accounts before they wake.
#[test]
fn a_stop_is_no_wait() {
    let mut reader = Reader::new(1);
    let lines = "\
        e-3 [001] d..2. 12.000310: sched_switch: prev_comm=e prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w next_pid=9 next_prio=39
        w-9 [001] d..2. 12.000340: sched_switch: prev_comm=w prev_pid=9 prev_prio=39 prev_state=T ==> next_comm=w next_pid=8 next_prio=39
        w-8 [001] d..2. 12.000360: sched_switch: prev_comm=w prev_pid=8 prev_prio=39 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let seen: Vec<_> = pieces.iter().map(|p| (p.thread, p.waits)).collect();
    assert_eq!(seen, [(9, false), (8, true)]);
}

#[test]
fn pieces_have_rank_clock_and_reason() {
    let mut reader = Reader::new(1);
    TRACE.lines().for_each(|l| reader.line(l));
    let timeline = reader.finish();
    assert!(!timeline.lost);
    let seen: Vec<_> = timeline
        .pieces
        .iter()
        .map(|p| (p.thread, p.rank, p.from % MS, p.cpu, p.waits, p.withheld))
        .collect();
    const MS: Nanos = 1_000_000;
    assert_eq!(
        seen,
        [
            (9, 60, 100_000, 49_000, false, false),
            (9, 60, 150_000, 20_000, false, false),
            (9, 60, 170_000, 0, false, false),
            (9, 80, 200_000, 0, false, false), // it inherits from here on
            (0, 0, 250_000, 0, false, true),   // though the thread wanted to go on
            (3, 99, 300_000, 0, true, false),
        ]
    );
}

#[test]
fn time_that_the_kernel_withholds_is_marked_until_it_lets_go() {
    let mut reader = Reader::new(1);
    let lines = "\
          w7-31065   [001] d..2. 14325.579236: sched_switch: prev_comm=w7 prev_pid=31065 prev_prio=40 prev_state=R ==> next_comm=enforcer/1 next_pid=31056 next_prio=0
  enforcer/1-31056   [001] d..2. 14325.579243: sched_switch: prev_comm=enforcer/1 prev_pid=31056 prev_prio=0 prev_state=S ==> next_comm=w7 next_pid=31065 next_prio=40
          w7-31065   [001] d..2. 14325.579283: sched_switch: prev_comm=w7 prev_pid=31065 prev_prio=40 prev_state=R ==> next_comm=kworker/1:2 next_pid=14888 next_prio=120
 kworker/1:2-14888   [001] d..2. 14325.579331: sched_switch: prev_comm=kworker/1:2 prev_pid=14888 prev_prio=120 prev_state=I ==> next_comm=ksoftirqd/1 next_pid=22 next_prio=120
 ksoftirqd/1-22      [001] d..2. 14325.579338: sched_switch: prev_comm=ksoftirqd/1 prev_pid=22 prev_prio=120 prev_state=S ==> next_comm=enforcer/1 next_pid=31056 next_prio=0
  enforcer/1-31056   [001] d..2. 14325.579348: sched_switch: prev_comm=enforcer/1 prev_pid=31056 prev_prio=0 prev_state=S ==> next_comm=w7 next_pid=31065 next_prio=40";
    lines.lines().for_each(|l| reader.line(l));
    let withheld: Vec<_> = reader
        .finish()
        .pieces
        .iter()
        .map(|p| (p.thread, p.withheld))
        .collect();
    assert_eq!(
        withheld,
        [
            (31056, false),
            (31065, false),
            (14888, true),
            (22, true),
            (31056, false)
        ]
    );
}

/// Torture took the fair server's time for a moment at which the worker had no budget, and found
/// two budgets in a window that began there: the worker had woken, and was not let run.
#[test]
fn a_worker_that_wakes_while_the_kernel_withholds_the_cpu_is_kept_waiting() {
    let mut reader = Reader::new(1);
    let lines = "\
        swapper-0 [001] d..2. 12.000100: sched_switch: prev_comm=swapper/1 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=cc next_pid=7 next_prio=120
        main-5 [000] d..2. 12.000200: sched_wakeup: comm=w3 pid=9 prio=39 target_cpu=001
        main-5 [000] d..2. 12.000200: sched_wakeup: comm=w4 pid=8 prio=39 target_cpu=000
        cc-7 [001] d..2. 12.000205: sched_stat_runtime: comm=cc pid=7 runtime=105000 [ns]
        cc-7 [001] d..2. 12.004205: sched_stat_runtime: comm=cc pid=7 runtime=4000000 [ns]
        cc-7 [001] d..2. 12.005000: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=w3 next_pid=9 next_prio=39
        w3-9 [001] d..2. 12.006000: sched_switch: prev_comm=w3 prev_pid=9 prev_prio=39 prev_state=S ==> next_comm=cc next_pid=7 next_prio=120
        cc-7 [001] d..2. 12.007000: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let withheld: Vec<_> = pieces.iter().map(|p| (p.thread, p.withheld)).collect();
    assert_eq!(
        withheld,
        [(7, false), (7, true), (7, true), (9, false), (7, false)],
        "the first one ends as the worker wakes"
    );
}

/// Torture took the 5 us in which a thread leaves a lock, its inherited priority given back, for
/// proof that no more urgent worker had budget: seed 18, two budgets in a window.
#[test]
fn a_thread_that_leaves_a_lock_has_not_been_chosen_to_run() {
    let mut reader = Reader::new(1);
    let lines = "\
        e-3 [001] d..2. 12.000100: sched_switch: prev_comm=e prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w7 next_pid=9 next_prio=35
        w7-9 [001] d..2. 12.000200: sched_pi_setprio: comm=w7 pid=9 oldprio=35 newprio=96
        w7-9 [001] d..2. 12.000205: sched_switch: prev_comm=w7 prev_pid=9 prev_prio=96 prev_state=R ==> next_comm=w8 next_pid=8 next_prio=35
        w8-8 [001] d..2. 12.000300: sched_pi_setprio: comm=w8 pid=8 oldprio=35 newprio=96
        w8-8 [001] d..2. 12.000400: sched_switch: prev_comm=w8 prev_pid=8 prev_prio=96 prev_state=S ==> next_comm=e next_pid=3 next_prio=0";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let seen: Vec<_> = pieces
        .iter()
        .map(|p| (p.thread, p.rank, p.withheld))
        .collect();
    assert_eq!(
        seen,
        [
            (9, 64, false),
            (9, 3, true),
            (8, 64, false),
            (8, 3, false) // for longer: nobody else wanted the CPU
        ]
    );
}

/// Torture, seed 37: an interrupt came in the middle of that, and two budgets were found in a
/// window.
#[test]
fn a_thread_that_is_interrupted_as_it_leaves_a_lock_is_still_leaving() {
    let mut reader = Reader::new(1);
    let lines = "\
        w13-31852 [001] d..2. 12.355481: sched_switch: prev_comm=w13 prev_pid=31852 prev_prio=27 prev_state=S ==> next_comm=w15 next_pid=31854 next_prio=27
        w15-31854 [001] d..3. 12.355507: sched_pi_setprio: comm=w15 pid=31854 oldprio=27 newprio=43
        w15-31854 [001] dNh2. 12.355520: hrtimer_expire_entry: hrtimer=00ab function=timerfd_tmrproc now=12355519505
        w15-31854 [001] dN.2. 12.355528: sched_stat_runtime: comm=w15 pid=31854 runtime=20150 [ns]
        w15-31854 [001] d..2. 12.355529: sched_switch: prev_comm=w15 prev_pid=31854 prev_prio=43 prev_state=R ==> next_comm=enforcer/1 next_pid=31836 next_prio=0";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let left: Vec<_> = pieces.iter().map(|p| (p.rank, p.withheld)).collect();
    assert_eq!(left, [(72, false), (56, true), (56, true)]);
    let mut reader = Reader::new(1);
    let uninterrupted = lines.replace("dNh2.", "dN.2.");
    uninterrupted.lines().for_each(|l| reader.line(l));
    let last = reader.finish().pieces.pop().unwrap();
    assert!(!last.withheld, "22 us are long enough to be chosen");
    // The interrupt came 5 us later, and its record 18 us after that.
    let mut reader = Reader::new(1);
    let later = lines.replace("355520:", "355530:");
    let later = later.replace("355528:", "355544:");
    let later = later.replace("355529:", "355546:");
    later.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let left: Vec<_> = pieces.iter().map(|p| (p.rank, p.withheld)).collect();
    assert_eq!(left.last(), Some(&(56, true)), "{left:?}");
}

#[test]
fn a_priority_that_the_enforcer_changes_is_forgotten_and_no_other() {
    let mut reader = Reader::new(1);
    let lines = "\
        w3-9 [001] d..2. 12.000100: sched_switch: prev_comm=w3 prev_pid=9 prev_prio=39 prev_state=R ==> next_comm=enforcer/1 next_pid=3 next_prio=0
        enforcer/1-3 [001] ..... 12.000120: sys_sched_setparam(pid: 0x9, param: 7f0012345678)
        enforcer/1-3 [001] d..2. 12.000150: sched_switch: prev_comm=enforcer/1 prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=cc next_pid=7 next_prio=120
        cc-7 [001] d..2. 12.005000: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    assert!(pieces.iter().all(|p| !p.withheld), "{pieces:?}");
    // The fair server lets a thread run as the enforcer waits: torture, seed 1.
    let mut reader = Reader::new(1);
    let other = lines.replace("(pid: 0x9,", "(pid: 8,");
    other.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let withheld: Vec<_> = pieces.iter().map(|p| (p.thread, p.withheld)).collect();
    assert_eq!(withheld, [(3, false), (7, true)]);
}

/// Torture, seed 63: the watchdog lowered a worker whose CPU stood still. Its last 270 us were no
/// part of its budget, and were counted as if they were.
#[test]
fn a_worker_is_low_from_the_moment_at_which_the_watchdog_lowers_it() {
    let mut reader = Reader::new(1);
    let lines = "\
        enforcer/1-6416 [001] d..2. 21.744187: sched_switch: prev_comm=enforcer/1 prev_pid=6416 prev_prio=0 prev_state=S ==> next_comm=w7 next_pid=6427 next_prio=11
        watchdog-6418 [000] d..2. 21.750850: sched_stat_runtime: comm=w7 pid=6427 runtime=6663370 [ns]
        watchdog-6418 [000] ..... 21.750877: sys_sched_setscheduler(pid: 0x191b, policy: 0x40000001, param: 0x7f26b1e1e938)
        w7-6427 [001] dNh1. 21.751181: sched_stat_runtime: comm=w7 pid=6427 runtime=258983 [ns]
        w7-6427 [001] d..2. 21.751198: sched_switch: prev_comm=w7 prev_pid=6427 prev_prio=98 prev_state=R ==> next_comm=enforcer/1 next_pid=6416 next_prio=0";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let seen: Vec<_> = pieces.iter().map(|p| (p.rank, p.cpu)).collect();
    assert_eq!(seen, [(88, 6_663_370), (88, 0), (1, 258_983), (1, 0)]);
}

#[test]
fn lost_records_are_noticed_and_foreign_lines_skipped() {
    let mut reader = Reader::new(0);
    reader.line("# tracer: nop");
    reader.line("CPU:1 [LOST 12 EVENTS]");
    assert!(reader.finish().lost);
}

#[test]
fn ranks_are_those_of_sched_fifo() {
    assert_eq!(
        [rank(-1), rank(0), rank(39), rank(98), rank(120)],
        [100, 99, 60, 1, 0]
    );
}

/// A reader of the trace that is held up between the buffers of two CPUs gets another CPU's reading
/// of a clock before the switch to the thread. The charge went to the thread's stretch before, and
/// the judge's time may begin in between.
#[test]
fn a_charge_that_comes_before_its_thread_s_switch_belongs_behind_it() {
    let mut reader = Reader::new(1);
    let lines = "\
        idle-0 [001] d..2. 12.000100: sched_switch: prev_comm=swapper/1 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=w1 next_pid=9 next_prio=39
        w1-9   [001] d..2. 12.000200: sched_switch: prev_comm=w1 prev_pid=9 prev_prio=39 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120
        main-5 [000] d..2. 12.000900: sched_stat_runtime: comm=w1 pid=9 runtime=467000 [ns]
        idle-0 [001] d..2. 12.000433: sched_switch: prev_comm=swapper/1 prev_pid=0 prev_prio=120 prev_state=R ==> next_comm=w1 next_pid=9 next_prio=39
        w1-9   [001] d..2. 12.000950: sched_stat_runtime: comm=w1 pid=9 runtime=50000 [ns]
        w1-9   [001] d..2. 12.000951: sched_switch: prev_comm=w1 prev_pid=9 prev_prio=39 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    lines.lines().for_each(|l| reader.line(l));
    let pieces = reader.finish().pieces;
    let cpu_from = |from: Nanos| -> Nanos {
        let later = pieces.iter().filter(|p| p.from % 1_000_000 >= from);
        later.filter(|p| p.thread == 9).map(|p| p.cpu).sum()
    };
    assert_eq!((cpu_from(0), cpu_from(433_000)), (517_000, 517_000));
}

/// A machine that traces no switch from the idle thread. The charge that told of it went
/// to the thread's stretch before, or nowhere: seed 3, trace and clock 71 us apart.
#[test]
fn a_switch_from_the_idle_thread_shows_by_its_first_charge() {
    let mut reader = Reader::new(1);
    let lines = "\
        w2-8 [001] d..2. 12.000100: sched_switch: prev_comm=w2 prev_pid=8 prev_prio=39 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120
        main-5 [000] d..2. 12.000500: sched_wakeup: comm=w1 pid=9 prio=39 target_cpu=001
        w1-9 [001] d..3. 12.000540: sched_pi_setprio: comm=w2 pid=8 oldprio=39 newprio=96
        w1-9 [001] d..2. 12.000600: sched_stat_runtime: comm=w1 pid=9 runtime=95000 [ns]
        w1-9 [001] d..2. 12.000603: sched_switch: prev_comm=w1 prev_pid=9 prev_prio=39 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120
        w3-7 [001] d..2. 12.000900: sched_stat_runtime: comm=w3 pid=7 runtime=50000 [ns]
        w3-7 [001] d..2. 12.000903: sched_switch: prev_comm=w3 prev_pid=7 prev_prio=19 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    lines.lines().for_each(|l| reader.line(l));
    let timeline = reader.finish();
    let seen: Vec<_> = timeline
        .pieces
        .iter()
        .map(|p| (p.thread, p.rank, p.from % 1_000_000, p.cpu))
        .collect();
    assert_eq!(
        seen,
        [
            (0, 0, 100_000, 0),
            (9, 60, 505_000, 95_000),
            (9, 60, 600_000, 0),
            (0, 0, 603_000, 0),
            (7, 80, 850_000, 50_000), // no wake-up was traced
            (7, 80, 900_000, 0),
        ]
    );
    assert!(timeline.still.is_empty(), "{:?}", timeline.still);
}

/// Seeds 39 and 169: a worker without budget was raised while it was preempted. So none woke it,
/// and the judge took the fair server's time for a moment without budget: two budgets in a window
/// that began there.
#[test]
fn a_preempted_worker_that_is_raised_wants_the_cpu() {
    let lines = "\
        w0-9 [001] d..2. 12.000100: sched_switch: prev_comm=w0 prev_pid=9 prev_prio=120 prev_state=R ==> next_comm=enforcer/1 next_pid=3 next_prio=0
        enforcer/1-3 [001] ..... 12.000120: sys_sched_setscheduler(pid: 0x9, policy: 1, param: 7f0012345678)
        enforcer/1-3 [001] d..2. 12.000150: sched_switch: prev_comm=enforcer/1 prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=cc next_pid=7 next_prio=120
        cc-7 [001] d..2. 12.004995: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=kworker/1:1 next_pid=4 next_prio=120
        kworker/1:1-4 [001] d..2. 12.005000: sched_switch: prev_comm=kworker/1:1 prev_pid=4 prev_prio=120 prev_state=I ==> next_comm=w0 next_pid=9 next_prio=89
        w0-9 [001] d..2. 12.006000: sched_switch: prev_comm=w0 prev_pid=9 prev_prio=89 prev_state=S ==> next_comm=cc next_pid=7 next_prio=120
        cc-7 [001] d..2. 12.007000: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    let withheld = |lines: &str| {
        let mut reader = Reader::new(1);
        lines.lines().for_each(|l| reader.line(l));
        let pieces = reader.finish().pieces;
        let seen = pieces.iter().map(|p| (p.thread, p.withheld));
        seen.collect::<Vec<_>>()
    };
    let raised = withheld(lines);
    // Among others for a thread that had it for 5 us only: seed 39.
    let all = [(3, false), (7, true), (4, true), (9, false), (7, false)];
    assert_eq!(raised, all);
    // It slept until it was woken: nothing says that it wanted the CPU before.
    let wakes =
        "main-5 [000] d..2. 12.004990: sched_wakeup: comm=w0 pid=9 prio=89 target_cpu=001\n";
    let woken = lines.replacen("        cc-7", &format!("        {wakes}        cc-7"), 1);
    let woken = withheld(&woken);
    assert!(woken.iter().all(|(_, withheld)| !withheld), "{woken:?}");
    // It got the CPU at the lower priority that it was given.
    let lowered = lines.replace("next_prio=89", "next_prio=120");
    let lowered = withheld(&lowered);
    assert!(lowered.iter().all(|(_, withheld)| !withheld), "{lowered:?}");
}

/// Seed 116: a worker that was kept from the CPU for 24 ms waited 30 us for the enforcer's lock,
/// which the watchdog had. The judge took that for a wait of its own.
#[test]
fn a_worker_that_waits_for_the_watchdogs_lock_wants_the_cpu() {
    let lines = "\
        w8-9 [001] d..2. 12.000105: sched_switch: prev_comm=w8 prev_pid=9 prev_prio=6 prev_state=S ==> next_comm=w22 next_pid=7 next_prio=10
        w22-7 [001] d..2. 12.000127: sched_stat_runtime: comm=w22 pid=7 runtime=22000 [ns]
        watchdog-4 [000] d..4. 12.000130: sched_wakeup: comm=w8 pid=9 prio=6 target_cpu=001
        w22-7 [001] d..2. 12.000145: sched_switch: prev_comm=w22 prev_pid=7 prev_prio=10 prev_state=R ==> next_comm=w8 next_pid=9 next_prio=6
        w8-9 [001] d..2. 12.001000: sched_switch: prev_comm=w8 prev_pid=9 prev_prio=6 prev_state=S ==> next_comm=swapper/1 next_pid=0 next_prio=120";
    let withheld = |lines: &str| {
        let mut reader = Reader::new(1);
        let before = "enforcer/1-3 [001] d..2. 12.000100: sched_switch: prev_comm=enforcer/1 prev_pid=3 \
                      prev_prio=0 prev_state=S ==> next_comm=w8 next_pid=9 next_prio=6";
        reader.line(before);
        lines.lines().for_each(|l| reader.line(l));
        let pieces = reader.finish().pieces;
        let seen = pieces.iter().map(|p| (p.thread, p.withheld));
        seen.collect::<Vec<_>>()
    };
    let all = |meanwhile| [(9, false), (7, meanwhile), (7, meanwhile), (9, false)];
    assert_eq!(withheld(lines), all(true));
    let by_another = lines.replace("watchdog-4", "timer-4");
    assert_eq!(withheld(&by_another), all(false));
}
