//! Sums that a recording keeps, whatever the machine does: of records, of callbacks, of CPU time.

use crate::common::{burn, executor};
use crate::recorder::{Directory, Read};
use replenish::{Budget, Context, Dump, Executor, Report};
use replenish_recorder::{Event, Kind, Role};
use replenish_testkit::watchdog::watchdog;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// Runs workers with rings of `ring` bytes for a moment: the report, and the recording as it was
/// when the last thread had ended.
fn run(name: &str, ring: usize) -> (Report, Directory, Read) {
    let directory = Directory::new(name);
    let ctx = Context::in_process();
    let (mut exec, _log) = executor(&ctx);
    exec.ledger(&directory.0).admission(false).recorder(ring);
    exec.dump(Dump::to(&directory.0).on_stop());
    workers(&mut exec);
    let running = exec.start().unwrap();
    std::thread::sleep(200 * MS);
    let report = running.stop();
    let [dump] = directory.files("dump").try_into().unwrap();
    let read = Read::of(&dump);
    (report, directory, read)
}

fn workers(exec: &mut Executor) {
    exec.worker("budgeted")
        .budget(Budget::of(10 * MS).every(20 * MS))
        .timer(5 * MS, |_| burn(1))
        .unwrap()
        .timer(3 * MS, |_| ())
        .unwrap();
    exec.worker("free")
        .timer(MS, |_| ())
        .unwrap()
        .timer(2 * MS, |_| ())
        .unwrap();
}

#[test]
fn every_record_was_read_or_overwritten() {
    let _dog = watchdog("identity of records", Duration::from_secs(60));
    for (ring, overwrites) in [(256 << 10, false), (4096, true)] {
        let (_, _directory, read) = run(&format!("records-{ring}"), ring);
        let mut lost = 0;
        for thread in &read.view.threads {
            let rings = [
                thread.events(&read.source),
                thread.budget_events(&read.source),
            ];
            for (events, copied) in rings {
                assert_eq!(copied.torn, 0, "{}", thread.name);
                assert_eq!(copied.read, events.len() as u64);
                assert_eq!(
                    copied.read + copied.overwritten,
                    copied.next,
                    "{}",
                    thread.name
                );
                lost += copied.overwritten;
            }
        }
        assert_eq!(lost > 0, overwrites, "{ring}");
    }
}

#[test]
fn every_callback_begins_and_ends_as_often_as_the_report_counts() {
    let _dog = watchdog("identity of callbacks", Duration::from_secs(60));
    let (report, _directory, read) = run("callbacks", 256 << 10);
    for thread in read.view.threads.iter().filter(|t| t.role == Role::Worker) {
        let events = read.events(&thread.name);
        let is_callback = |e: &&Event| matches!(e.kind, Kind::Begin | Kind::End);
        let callbacks: Vec<&Event> = events.iter().filter(is_callback).collect();
        for pair in callbacks.chunks(2) {
            let [begin, end] = pair else {
                panic!("{pair:?}")
            };
            assert_eq!((begin.kind, end.kind), (Kind::Begin, Kind::End));
            assert_eq!((begin.name, begin.a), (end.name, end.a));
            assert!(begin.time <= end.time);
        }
        let handles = report.handles.iter().filter(|h| h.worker == thread.name);
        let executed: u64 = handles.map(|h| h.stats.executed).sum();
        assert!(executed > 0);
        assert_eq!(callbacks.len() as u64, 2 * executed, "{}", thread.name);
    }
}

/// The executions that the handles of a worker were charged are what its CPU clock advanced between
/// two recorded readings.
#[test]
fn executions_add_up_to_the_cpu_clock() {
    let _dog = watchdog("identity of CPU time", Duration::from_secs(60));
    let (report, _directory, read) = run("clock", 256 << 10);
    let worker = read
        .view
        .threads
        .iter()
        .find(|t| t.name == "budgeted")
        .unwrap();
    let (budget, copied) = worker.budget_events(&read.source);
    assert_eq!(copied.overwritten, 0);
    let readings = budget.iter().filter(|e| {
        matches!(
            e.kind,
            Kind::Used | Kind::Activate | Kind::Block | Kind::Unblock
        )
    });
    let readings: Vec<u64> = readings.map(|e| e.b).collect();
    assert!(readings.is_sorted(), "a CPU clock does not go back");
    let handles = report.handles.iter().filter(|h| h.worker == "budgeted");
    let charged: u64 = handles
        .map(|h| h.stats.cpu_high + h.stats.cpu_background)
        .sum();
    // The account begins with the first reading, and the last charge ends at one.
    let first = readings[0];
    let mut ends = readings.iter().map(|r| r - first);
    assert!(
        charged > 0 && ends.any(|end| end == charged),
        "{charged} in {readings:?}"
    );
}
