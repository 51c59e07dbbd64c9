//! The analyser on recordings made by hand: stolen time, which no test can order from a hypervisor,
//! and the sum of the parts for any recording.

use super::parts::{By, Cause, named, take_apart};
use crate::live::timeline::{Facts, Late, Timeline};
use replenish_recorder::{Event, Kind};
use std::collections::BTreeMap;

const MS: u64 = 1_000_000;

fn event(time: u64, kind: Kind, name: u32, a: u64, b: u64) -> Event {
    Event {
        time,
        kind,
        name,
        a,
        b,
    }
}

/// A callback from `from` to `to` ms, released at 10 ms, late by a deadline of 2 ms.
fn callback(from: u64, to: u64) -> Vec<Event> {
    vec![
        event(9 * MS, Kind::Block, 0, 0, 0),
        event(10 * MS, Kind::Wake, 0, 10 * MS, 0),
        event(from * MS, Kind::Begin, 7, 10 * MS, 0),
        event(to * MS, Kind::End, 7, 10 * MS, 0),
        event(to * MS, Kind::Miss, 7, (to - 12) * MS, 2 * MS),
    ]
}

fn sums(thread: &Timeline) -> BTreeMap<Cause, u64> {
    let late = thread.late[0];
    let mut sums = BTreeMap::new();
    for ((cause, _), time) in take_apart(std::slice::from_ref(thread), 0, &late) {
        *sums.entry(cause).or_default() += time;
    }
    sums.retain(|_, time| *time > 0);
    assert_eq!(
        sums.values().sum::<u64>(),
        late.response.to - late.response.from
    );
    sums
}

/// With switch records and readings of the CPU clock as (time in ms, CPU time in ms).
fn budgeted(events: &[Event], switches: &[(u64, Kind, u64)], readings: &[(u64, u64)]) -> Timeline {
    let switches = switches
        .iter()
        .map(|(at, kind, a)| event(at * MS, *kind, 0, *a, 0));
    let readings = readings
        .iter()
        .map(|(at, cpu)| event(at * MS, Kind::Used, 0, 0, cpu * MS));
    let budget: Vec<Event> = switches.chain(readings).collect();
    Timeline::new(Facts::default(), events, &budget, [false; 2])
}

const SLEPT: [(u64, Kind, u64); 2] = [(9, Kind::Off, 1), (10, Kind::On, 0)];

#[test]
fn a_wait_begins_where_a_block_or_the_wake_up_says() {
    let mut events = callback(11, 13);
    let waits = |events: &[Event]| {
        let thread = budgeted(events, &[], &[]);
        let waits = thread
            .waits
            .iter()
            .map(|w| (w.time.from / MS, w.time.to / MS));
        waits.collect::<Vec<_>>()
    };
    assert_eq!(waits(&events), [(9, 10)]);
    events.remove(0);
    assert_eq!(waits(&events), [(10, 10)]);
    events[0].b = 8 * MS;
    assert_eq!(waits(&events), [(8, 10)]);
}

#[test]
fn time_on_the_cpu_that_its_clock_does_not_know_was_stolen() {
    let thread = budgeted(&callback(10, 18), &SLEPT, &[(10, 5), (18, 6)]);
    let sums = sums(&thread);
    assert_eq!(
        sums,
        [(Cause::OwnExecution, MS), (Cause::Stolen, 7 * MS)].into()
    );
    assert_eq!(named(&sums, 2 * MS), [Cause::Stolen]);
}

#[test]
fn stolen_time_and_preemption_are_told_apart() {
    let switches = [SLEPT[0], SLEPT[1], (11, Kind::Off, 0), (15, Kind::On, 0)];
    let thread = budgeted(&callback(10, 20), &switches, &[(10, 5), (20, 6)]);
    let sums = sums(&thread);
    let parts = [
        (Cause::OwnExecution, MS),
        (Cause::Preempted, 4 * MS),
        (Cause::Stolen, 5 * MS),
    ];
    assert_eq!(sums, parts.into());
    assert_eq!(named(&sums, 2 * MS), [Cause::Stolen, Cause::Preempted]);
}

#[test]
fn time_that_was_stolen_from_another_callback_is_not_its_turn() {
    let mut events = callback(18, 19);
    events.insert(2, event(10 * MS, Kind::Begin, 3, 10 * MS, 0));
    events.insert(3, event(18 * MS, Kind::End, 3, 10 * MS, 0));
    let thread = budgeted(&events, &SLEPT, &[(10, 5), (18, 7), (19, 8)]);
    let sums = sums(&thread);
    let parts = [
        (Cause::WaitedBehind, 2 * MS),
        (Cause::OwnExecution, MS),
        (Cause::Stolen, 6 * MS),
    ];
    assert_eq!(sums, parts.into());
    assert_eq!(named(&sums, 2 * MS), [Cause::Stolen, Cause::WaitedBehind]);
}

#[test]
fn a_reading_some_microseconds_later_is_no_theft() {
    let events = callback(10, 18);
    let mut thread = budgeted(&events, &SLEPT, &[(10, 5)]);
    thread.used.push((18 * MS + 20_000, 13 * MS));
    assert_eq!(sums(&thread), [(Cause::OwnExecution, 8 * MS)].into());
}

/// Overwritten beginnings, callbacks that never end, switches out of order, other threads: any
/// recording at all.
#[test]
fn the_sum_of_the_parts_is_the_response() {
    let mut seed = 1_u64;
    let mut next = |below: u64| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (seed >> 33) % below
    };
    for _ in 0..3000 {
        let mut threads = Vec::new();
        for n in 0..3 {
            let mut rings = [Vec::new(), Vec::new()];
            for ring in &mut rings {
                let mut time = next(100) * MS / 10;
                for _ in 0..next(40) {
                    time = (time + next(3) * MS / 3).saturating_sub(next(2) * 1000);
                    let kind = Kind::ALL[usize::try_from(next(20)).unwrap()];
                    let a = match kind {
                        Kind::Begin | Kind::Wake => time.saturating_sub(next(MS)),
                        Kind::Level | Kind::Off => next(2),
                        _ => next(5 * MS),
                    };
                    let name = u32::try_from(next(4)).unwrap();
                    ring.push(event(time, kind, name, a, next(3 * MS)));
                }
            }
            let facts = Facts {
                cpu: (n < 2).then_some(1),
                priority: u8::try_from(next(50)).unwrap(),
                ..Facts::default()
            };
            let [thread, budget] = &rings;
            threads.push(Timeline::new(facts, thread, budget, [true, false]));
        }
        for (n, thread) in threads.iter().enumerate() {
            for late in &thread.late {
                let parts = take_apart(&threads, n, late);
                let sum: u64 = parts.values().sum();
                assert_eq!(sum, late.response.to - late.response.from);
            }
        }
    }
}

/// Without switch records: the clock of the callback, and who else wanted the CPU more.
#[test]
fn without_switch_records_others_count_by_their_priority() {
    let facts = |priority| Facts {
        cpu: Some(1),
        priority,
        ..Facts::default()
    };
    let mut events = vec![event(5 * MS, Kind::Used, 0, 0, MS)];
    events.extend(callback(10, 18));
    events.push(event(18 * MS, Kind::Used, 0, 0, 4 * MS));
    let own = Timeline::new(facts(40), &events, &[], [false; 2]);
    let other = |priority| {
        let events = [
            event(12 * MS, Kind::Begin, 9, 12 * MS, 0),
            event(15 * MS, Kind::End, 9, 12 * MS, 0),
        ];
        Timeline::new(facts(priority), &events, &[], [false; 2])
    };
    let late: Late = own.late[0];
    for (priority, preempted) in [(60, 3 * MS), (20, 0)] {
        let threads = [own.clone(), other(priority)];
        let parts = take_apart(&threads, 0, &late);
        let part = |cause, by| parts.get(&(cause, by)).copied().unwrap_or(0);
        assert_eq!(part(Cause::OwnExecution, By::Nobody), 3 * MS);
        assert_eq!(part(Cause::Preempted, By::Thread(1, 9)), preempted);
        assert_eq!(part(Cause::Blocked, By::Unknown), 5 * MS - preempted);
    }
}

#[test]
fn off_the_cpu_at_the_low_level_is_no_preemption() {
    let low = [
        event(12 * MS, Kind::Level, 0, 1, 0),
        event(12 * MS, Kind::Off, 0, 0, 0),
        event(17 * MS, Kind::On, 0, 0, 0),
        event(17 * MS, Kind::Level, 0, 0, 0),
    ];
    let thread = Timeline::new(Facts::default(), &callback(10, 18), &low, [false; 2]);
    let parts = [(Cause::NoBudget, 5 * MS), (Cause::OwnExecution, 3 * MS)];
    assert_eq!(sums(&thread), parts.into());
}
