//! Signs in the kernel's text that the machine stood still.

use super::*;

/// Torture, seed 13: 6 ms between the wake-up of the enforcer and its first instruction.
#[test]
fn the_machine_stands_still_before_the_enforcer_runs() {
    let mut reader = Reader::new(1);
    let lines = "\
        w3-9 [001] dNh4. 12.002000: sched_wakeup: comm=enforcer/1 pid=3 prio=0 target_cpu=001
        w3-9 [001] d..2. 12.008000: sched_switch: prev_comm=w3 prev_pid=9 prev_prio=39 prev_state=R ==> next_comm=enforcer/1 next_pid=3 next_prio=0";
    lines.lines().for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, [(12_002_020_000, 12_008_000_000)]);
}

/// Torture, seed 35: the watchdog's CPU was taken from it while the enforcer waited for its lock.
#[test]
fn the_watchdogs_cpu_stands_still() {
    let mut reader = Reader::new(1);
    let lines = "\
        watchdog-3060 [000] d.h2. 12.005000: sched_stat_runtime: comm=watchdog pid=3060 runtime=4700000 [ns]
        watchdog-3060 [000] d..2. 12.006000: sched_stat_runtime: comm=watchdog pid=3060 runtime=90000 [ns]
        w0-3062 [000] d..2. 12.009000: sched_stat_runtime: comm=w0 pid=3062 runtime=4000000 [ns]";
    lines.lines().for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, [(12_000_400_000, 12_005_000_000)]);
}

/// A hypervisor that takes the CPU during a switch: the thread is charged for what it never had.
#[test]
fn the_machine_stands_still_during_a_switch() {
    let mut reader = Reader::new(1);
    let lines = "\
        cc-7 [001] d..2. 12.002000: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=w3 next_pid=9 next_prio=39
        w3-9 [001] d..2. 12.002040: sched_stat_runtime: comm=w3 pid=9 runtime=1040000 [ns]
        w3-9 [001] d..2. 12.002060: sched_stat_runtime: comm=w3 pid=9 runtime=60000 [ns]";
    lines.lines().for_each(|l| reader.line(l));
    let still = reader.finish().still;
    assert_eq!(
        still,
        [(12_001_020_000, 12_002_000_000)],
        "but for a switch's 20 us"
    );
}

#[test]
fn the_machine_delivers_a_timer_late() {
    let mut reader = Reader::new(1);
    let lines = "\
        e-3 [001] d..1. 12.000010: hrtimer_start: hrtimer=00ab function=timerfd_tmrproc expires=12000100000 softexpires=12000100000 mode=ABS
        e-3 [001] d..1. 12.000010: hrtimer_start: hrtimer=00cd function=tick_nohz_handler expires=12000000000 softexpires=1 mode=ABS
        w-9 [001] d.h1. 12.000461: hrtimer_expire_entry: hrtimer=00cd function=tick_nohz_handler now=12000460000
        w-9 [001] d.h1. 12.000461: hrtimer_expire_entry: hrtimer=00ab function=timerfd_tmrproc now=12000460000";
    lines.lines().for_each(|l| reader.line(l));
    let timeline = reader.finish();
    assert_eq!(timeline.still, [(12_000_120_000, 12_000_461_000)]);
    assert_eq!(
        timeline.stood_still(12_000_200_000, 12_000_300_000),
        100_000
    );
    assert_eq!(timeline.stood_still(0, 13_000_000_000), 361_000 - PUNCTUAL);
}

/// The machine stood still for 212 us inside of a timer's interrupt: seed 64. Of a wake-up after
/// another line nobody knows that.
#[test]
fn an_interrupt_that_takes_long_to_wake_the_enforcer_stood_still() {
    let expires = "\
        e-3 [001] d..2. 8.202977: hrtimer_start: hrtimer=00000000f416591d function=timerfd_tmrproc expires=8203015710 softexpires=8203015710 mode=ABS was_armed=0
        w6-9 [001] d.h1. 8.203033: hrtimer_expire_entry: hrtimer=00000000f416591d function=timerfd_tmrproc now=8203033041";
    let wakes = "        w6-9 [001] dNh5. 8.203245: sched_wakeup: comm=enforcer/1 pid=3 prio=0 target_cpu=001";
    let other =
        "        w6-9 [001] d.h1. 8.203040: sched_wakeup: comm=w7 pid=7 prio=39 target_cpu=001";
    let still = |lines: &[&str]| {
        let mut reader = Reader::new(1);
        let lines = lines.iter().flat_map(|l| l.lines());
        lines.for_each(|l| reader.line(l));
        reader.finish().still
    };
    assert_eq!(still(&[expires, wakes]), [(8_203_053_000, 8_203_245_000)]);
    assert!(still(&[expires, other, wakes]).is_empty());
}

/// A worker inherits the enforcer's priority for the few microseconds in which it holds the
/// enforcer's lock: 529 us say that the machine stood still, seed 27.
#[test]
fn a_worker_that_holds_the_enforcers_lock_for_long_stood_still() {
    let mut reader = Reader::new(1);
    let lines = "\
        enforcer/1-3 [001] d..2. 12.000100: sched_switch: prev_comm=enforcer/1 prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w1 next_pid=9 next_prio=0
        w1-9 [001] dN.2. 12.000636: sched_stat_runtime: comm=w1 pid=9 runtime=530000 [ns]
        w1-9 [001] d..3. 12.000640: sched_pi_setprio: comm=w1 pid=9 oldprio=0 newprio=9
        w1-9 [001] d..2. 12.001000: sched_stat_runtime: comm=w1 pid=9 runtime=364000 [ns]";
    lines.lines().for_each(|l| reader.line(l));
    // It gives the lock back 4 us later.
    assert_eq!(reader.finish().still, [(12_000_206_000, 12_000_640_000)]);
}

/// The kernel reads the time at the beginning of the timer's interrupt. The machine stood still for
/// 850 us after that, and the enforcer was not woken before: seed 4.
#[test]
fn a_timer_s_interrupt_is_as_late_as_its_record() {
    let mut reader = Reader::new(1);
    let lines = "\
        e-3 [001] d..2. 674.294584: hrtimer_start: hrtimer=0000000089d26319 function=timerfd_tmrproc expires=674294602000 softexpires=674294602000 mode=ABS was_armed=0
        w2-9 [001] d.h.. 674.295461: hrtimer_expire_entry: hrtimer=0000000089d26319 function=timerfd_tmrproc now=674294611434";
    lines.lines().for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, [(674_294_622_000, 674_295_461_000)]);
}

/// Seed 98: for 1.4 ms no timer's interrupt came to the CPU, and a worker began so much later than
/// it was due. It had budget waiting then, and the judge did not know.
#[test]
fn a_worker_that_is_woken_late_shows_that_the_machine_stood_still() {
    let mut reader = Reader::new(1);
    let lines = "\
        w0-7186    [001] d..1. 13844.977692: hrtimer_start: hrtimer=75b7f26c function=hrtimer_wakeup expires=13844978527612 softexpires=13844978527612 mode=ABS was_armed=0
        cc-8    [001] d..1. 13844.977693: hrtimer_start: hrtimer=00ab function=hrtimer_wakeup expires=13844978000000 softexpires=13844978000000 mode=ABS was_armed=0
        opt cgu.03-7306    [001] d.h.. 13844.979945: hrtimer_expire_entry: hrtimer=00ab function=hrtimer_wakeup now=13844979944490
        opt cgu.03-7306    [001] d.h.. 13844.979946: hrtimer_expire_entry: hrtimer=75b7f26c function=hrtimer_wakeup now=13844979944490";
    lines.lines().for_each(|l| reader.line(l));
    // A thread of others may have been on another CPU since: its timer may be another one.
    assert_eq!(
        reader.finish().still,
        [(13_844_978_547_612, 13_844_979_946_000)]
    );
}

/// Seeds 26 and 31: the machine stood still while a thread that is not traced let a woken worker
/// have the CPU, and while a worker was on its way to its clock. No timer was due meanwhile.
#[test]
fn a_worker_that_reads_its_clock_late_shows_that_the_machine_stood_still() {
    let lines = "\
        agent-75 [001] dNh4. 25979.936686: sched_wakeup: comm=w1 pid=20668 prio=49 target_cpu=001
        w1-20668 [001] d..2. 25979.938071: sched_stat_runtime: comm=w1 pid=20668 runtime=1386161 [ns]
        w1-20668 [001] d..2. 25979.938471: sched_stat_runtime: comm=w1 pid=20668 runtime=400000 [ns]
        w1-20668 [001] d..2. 25979.938472: sched_switch: prev_comm=w1 prev_pid=20668 prev_prio=49 prev_state=S ==> next_comm=opt next_pid=7 next_prio=120
        opt-7 [001] dNh4. 25979.939000: sched_wakeup: comm=w2 pid=20669 prio=49 target_cpu=001
        opt-7 [001] d..2. 25979.939001: sched_switch: prev_comm=opt prev_pid=7 prev_prio=120 prev_state=S ==> next_comm=w2 next_pid=20669 next_prio=49
        w2-20669 [001] d..2. 25979.939401: sched_stat_runtime: comm=w2 pid=20669 runtime=400000 [ns]
        enforcer-3 [001] d..2. 25979.940000: sched_wakeup: comm=w1 pid=20668 prio=49 target_cpu=001
        enforcer-3 [001] d..2. 25979.940001: sched_switch: prev_comm=enforcer prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w1 next_pid=20668 next_prio=49
        w1-20668 [001] d..2. 25979.940401: sched_stat_runtime: comm=w1 pid=20668 runtime=400000 [ns]";
    let still = |prompt: &[&str]| {
        let prompt = prompt.iter().map(ToString::to_string).collect();
        let mut reader = Reader::new(1).with_prompt(prompt);
        lines.lines().for_each(|l| reader.line(l));
        reader.finish().still
    };
    // `w2` may have waited in the middle of a callback, and `w1` was suspended in one at the end:
    // these charges are their own.
    assert_eq!(still(&["w1"]), [(25_979_936_784_839, 25_979_938_071_000)]);
    assert_eq!(still(&[]), []);
}

/// Seeds 56 and 61: the kernel handled packets of another program for 200 us while a worker gave a
/// lock back.
#[test]
fn handlers_of_interrupts_take_the_cpu_for_as_long_as_they_last() {
    let lines = "\
        w1-9 [001] d..2. 12.000100: sched_switch: prev_comm=cc prev_pid=7 prev_prio=120 prev_state=R ==> next_comm=w1 next_pid=9 next_prio=39
        w1-9 [001] d.h1. 12.000200: irq_handler_entry: irq=27 name=virtio1-input.0
        w1-9 [001] d.h1. 12.000205: irq_handler_exit: irq=27 ret=handled
        w1-9 [001] ..s1. 12.000210: softirq_entry: vec=3 [action=NET_RX]
        w1-9 [000] d.h1. 12.000220: irq_handler_entry: irq=28 name=virtio1-input.1
        w1-9 [001] ..s1. 12.000410: softirq_exit: vec=3 [action=NET_RX]
        w1-9 [000] d.h1. 12.000900: irq_handler_exit: irq=28 ret=handled";
    let mut reader = Reader::new(1);
    lines.lines().for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, [(12_000_230_000, 12_000_410_000)]);
    // An end without a beginning says nothing, nor does a beginning before a switch.
    let mut reader = Reader::new(1);
    let some = lines.lines().filter(|l| !l.contains("softirq_entry"));
    some.for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, []);
}

/// Seed 81: the CPU stood still for 100 to 300 us at a time, and no other timer was due.
#[test]
fn the_timer_that_rings_again_and_again_shows_each_standstill() {
    let lines = "\
        w1-9 [001] d.h1. 12.000050: hrtimer_start: hrtimer=00aa function=perf_swevent_hrtimer expires=12000100000 softexpires=12000100000 mode=REL
        w1-9 [001] d.h1. 12.000107: hrtimer_expire_entry: hrtimer=00aa function=perf_swevent_hrtimer now=12000106000
        w1-9 [001] d.h1. 12.000109: hrtimer_start: hrtimer=00aa function=perf_swevent_hrtimer expires=12000150000 softexpires=12000150000 mode=REL
        w1-9 [001] d.h1. 12.000392: hrtimer_expire_entry: hrtimer=00aa function=perf_swevent_hrtimer now=12000390000
        w1-9 [001] d.h1. 12.009000: hrtimer_expire_entry: hrtimer=00aa function=perf_swevent_hrtimer now=12009000000";
    let mut reader = Reader::new(1);
    lines.lines().for_each(|l| reader.line(l));
    // The last one was not set: the kernel had held the ticks back.
    assert_eq!(reader.finish().still, [(12_000_170_000, 12_000_392_000)]);
}

/// Seed 8: the machine stood still for 1 ms amid a judgement. A worker's budget fell due meanwhile;
/// the enforcer came to it when it had set its timer again, and the judge did not know.
#[test]
fn a_judgement_in_which_the_machine_stood_still_lasts_until_its_end() {
    let lines = "\
        w9-8 [001] d..2. 12.168606: sched_switch: prev_comm=w9 prev_pid=8 prev_prio=95 prev_state=R ==> next_comm=enforcer/1 next_pid=3 next_prio=0
        enforcer/1-3 [001] d.h1. 12.168608: hrtimer_start: hrtimer=00aa function=perf_swevent_hrtimer expires=12168615000 softexpires=12168615000 mode=ABS
        enforcer/1-3 [001] d.h.. 12.169613: hrtimer_expire_entry: hrtimer=00aa function=perf_swevent_hrtimer now=12169611489
        enforcer/1-3 [001] d..2. 12.169640: sched_stat_runtime: comm=enforcer/1 pid=3 runtime=76293 [ns]
        enforcer/1-3 [001] d..2. 12.169654: sched_switch: prev_comm=enforcer/1 prev_pid=3 prev_prio=0 prev_state=S ==> next_comm=w15 next_pid=9 next_prio=76
        w15-9 [001] d..2. 12.169674: sched_switch: prev_comm=w15 prev_pid=9 prev_prio=76 prev_state=R ==> next_comm=enforcer/1 next_pid=3 next_prio=0";
    let mut reader = Reader::new(1);
    lines.lines().for_each(|l| reader.line(l));
    assert_eq!(reader.finish().still, [(12_168_635_000, 12_169_654_000)]);
}
