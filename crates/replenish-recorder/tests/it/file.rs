//! The file: written, read, and damaged.

use replenish_recorder::{
    ChainCount, Clocks, Event, Invalid, Kind, LayoutError, MAX_NAMES, NameKind, Plan, Planned,
    PlannedChain, Role, RunningTotals, View, Writer, add_to_chain, bucket_end, copy,
    write_chain_worst, write_name, write_policy, write_tid, write_totals,
};
use std::sync::atomic::{AtomicU64, Ordering};

const CLOCKS: Clocks = Clocks {
    monotonic: 5,
    boottime: 6,
    realtime: 7,
};

fn threads() -> [Planned<'static>; 2] {
    let dispatcher = Planned {
        name: "dispatcher",
        role: Role::Dispatcher,
        cpu: None,
        budget: None,
    };
    let worker = Planned {
        name: "wörker\u{1b}[2J",
        role: Role::Worker,
        cpu: Some(3),
        budget: Some((2_000, 10_000)),
    };
    [dispatcher, worker]
}

fn event(n: u64) -> Event {
    Event {
        time: n,
        kind: Kind::Begin,
        name: 2,
        a: n,
        b: 0,
    }
}

fn plan() -> Plan {
    Plan::with_chains(&threads(), 2, 4096).unwrap()
}

/// A file as a program would leave it.
fn file() -> Vec<u8> {
    let threads = threads();
    let plan = plan();
    let memory: Vec<AtomicU64> = (0..plan.bytes / 8).map(|_| AtomicU64::new(0)).collect();
    let chain = |name, limit| PlannedChain {
        name,
        id: 3,
        limit,
        bound: None,
    };
    plan.write_chains(
        &memory,
        &[chain("brake\u{7}", Some(20_000)), chain("", None)],
    );
    let brake = plan.chains[0].of(&memory);
    for latency in [500, 30_000, 10_000] {
        add_to_chain(brake, ChainCount::Begun, 2);
        add_to_chain(brake, ChainCount::Ended, 1);
        add_to_chain(brake, ChainCount::Sum, latency);
        let bucket = (0..).find(|n| latency <= bucket_end(*n)).unwrap();
        add_to_chain(brake, ChainCount::Bucket(bucket), 1);
    }
    add_to_chain(brake, ChainCount::Exceeded, 1);
    add_to_chain(brake, ChainCount::Bucket(102), 1); // there is none
    write_chain_worst(brake, 77, 30_000);
    plan.write(&memory, "robot", 42, CLOCKS, &threads);
    let names = plan.names.of(&memory);
    write_name(names, 1, NameKind::Handle, "/node/sub:/scan");
    write_name(names, 2, NameKind::Mark, &"long ".repeat(100));
    let worker = plan.threads[1];
    let entry = worker.entry.of(&memory);
    write_tid(entry, 4711);
    write_policy(entry, "SCHED_FIFO 60");
    let totals = RunningTotals {
        high: 1,
        low: 2,
        exhaustions: 3,
        replenishments: 4,
        available: 5,
        is_low: true,
    };
    write_totals(entry, &totals);
    for span in [worker.ring, worker.budget.unwrap()] {
        let ring = span.of(&memory);
        let mut writer = Writer::new(ring.len()).unwrap();
        (0..1000).for_each(|n| writer.write(ring, &event(n)));
    }
    let words = memory.iter().map(|w| w.load(Ordering::Relaxed));
    words.flat_map(u64::to_ne_bytes).collect()
}

#[test]
fn a_file_tells_what_was_written() {
    let file = file();
    let view = View::read(&*file).unwrap();
    assert_eq!(
        (&*view.program, view.pid, view.clocks),
        ("robot", 42, CLOCKS)
    );
    let [dispatcher, worker] = &*view.threads else {
        panic!("{view:?}");
    };
    assert_eq!(dispatcher.role, Role::Dispatcher);
    assert_eq!(
        (dispatcher.tid, dispatcher.cpu, dispatcher.budget),
        (0, None, None)
    );
    assert_eq!((worker.tid, worker.cpu), (4711, Some(3)));
    assert_eq!(worker.name, "wörker\u{fffd}[2J", "no control characters");
    assert_eq!(worker.policy, "SCHED_FIFO 60");
    assert_eq!(worker.budget, Some((2_000, 10_000)));
    assert!(worker.totals.is_low && worker.totals.exhaustions == 3);
    let names = view.names(&*file);
    assert_eq!(names.len(), MAX_NAMES + 1);
    assert_eq!(names[1], Some((NameKind::Handle, "/node/sub:/scan".into())));
    assert_eq!(names[2].as_ref().unwrap().1.len(), 120, "cut, not refused");
    assert_eq!((&names[0], &names[3]), (&None, &None));
    for (events, copied, slots) in [
        (worker.events(&*file), 128_u64),
        (worker.budget_events(&*file), 64),
    ]
    .map(|((events, copied), slots)| (events, copied, slots))
    {
        assert_eq!((copied.read, copied.torn), (slots, 0));
        assert_eq!(copied.read + copied.overwritten, 1000);
        assert_eq!(events, (1000 - slots..1000).map(event).collect::<Vec<_>>());
    }
    assert_eq!(dispatcher.events(&*file).0, []);
    assert_eq!(dispatcher.budget_events(&*file).0, []);
}

#[test]
fn chains_stand_in_the_file_and_in_its_copy() {
    let file = file();
    let mut copied = vec![0; file.len()];
    copy(&*file, |at, bytes| {
        let at = at as usize;
        copied[at..at + bytes.len()].copy_from_slice(bytes);
        true
    })
    .unwrap();
    for file in [&file, &copied] {
        let view = View::read(&**file).unwrap();
        let [brake, other] = &*view.chains else {
            panic!("{view:?}");
        };
        assert_eq!((&*brake.name, brake.id), ("brake\u{fffd}", 3));
        assert_eq!((brake.limit, brake.bound), (Some(20_000), None));
        let counts = (brake.begun, brake.ended, brake.exceeded, brake.sum);
        assert_eq!(counts, (6, 3, 1, 40_500));
        assert_eq!(brake.worst, Some((77, 30_000)));
        assert_eq!(brake.histogram.iter().sum::<u64>(), 3);
        assert_eq!(brake.percentile(0), 1023);
        assert!((30_000..37_500).contains(&brake.percentile(100)));
        assert_eq!((other.worst, other.percentile(99)), (None, 0));
    }
}

#[test]
fn numbers_out_of_range_are_refused() {
    let threads = threads();
    assert_eq!(Plan::new(&threads, 4095), Err(LayoutError::Ring(4095)));
    assert_eq!(Plan::new(&[], 4096), Err(LayoutError::Threads(0)));
    let many = [threads[0]; 17];
    let all = Plan::new(&many, 64 << 20);
    assert!(matches!(all, Err(LayoutError::Bytes(_))), "{all:?}");
    let all = Plan::with_chains(&threads, 65, 4096);
    assert_eq!(all, Err(LayoutError::Chains(65)));
}

/// A program that is killed in the middle of a record: the record that was begun is left out, and
/// the one that it was about to overwrite.
#[test]
fn a_record_that_was_begun_is_left_out() {
    let mut file = file();
    let ring = {
        let plan = plan();
        plan.threads[1].ring.start * 8
    };
    file[ring..ring + 8].copy_from_slice(&1001_u64.to_le_bytes());
    let slot = ring + 64 + (1000 % 128) * 32;
    file[slot..slot + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    let (events, copied) = View::read(&*file).unwrap().threads[1].events(&*file);
    assert_eq!(
        (copied.read, copied.overwritten, copied.torn),
        (127, 873, 0)
    );
    assert_eq!(events, (873..1000).map(event).collect::<Vec<_>>());
}

#[test]
fn foreign_and_short_files_are_refused() {
    let file = file();
    assert_eq!(View::read(&[] as &[u8]), Err(Invalid::NoRecording));
    assert_eq!(View::read(&[0_u8; 8192][..]), Err(Invalid::NoRecording));
    assert_eq!(View::read(&file[..file.len() - 1]), Err(Invalid::Length));
    let mut other = file.clone();
    other[8] = 2;
    assert_eq!(View::read(&*other), Err(Invalid::Version(2)));
    other = file.clone();
    other[24] ^= 1;
    assert_eq!(View::read(&*other), Err(Invalid::Checksum));
    other = file;
    let entry = plan().threads[0].entry.start * 8;
    other[entry + 48..entry + 56].fill(0xff);
    assert_eq!(View::read(&*other), Err(Invalid::Field("ring")));
}

/// Damaged files: no panic, no hang, no more than there is room for. `REPLENISH_INPUTS` of them.
#[test]
fn damaged_files_do_no_harm() {
    let inputs = std::env::var("REPLENISH_INPUTS").ok();
    let inputs = inputs.and_then(|n| n.parse().ok()).unwrap_or(2_000_u32);
    let whole = file();
    let mut file = whole.clone();
    let mut state = 0x1234_5678_9abc_def0_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut taken = 0_u32;
    for _ in 0..inputs {
        let mut touched = Vec::new();
        for _ in 0..=random() % 4 {
            // Most of it into header, threads and the heads of rings.
            let at = match random() % 4 {
                0 => random() % 256,
                1 => 4096 + random() % 512,
                _ => random() % whole.len() as u64,
            } as usize;
            file[at] = random() as u8;
            touched.push(at);
        }
        if random() % 2 == 0 {
            // A forger makes the checksum right.
            let sum = file[..224]
                .iter()
                .fold(0xcbf2_9ce4_8422_2325_u64, |sum, b| {
                    (sum ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3)
                });
            file[224..232].copy_from_slice(&sum.to_le_bytes());
        }
        let end = match random() % 8 {
            0 => (random() % whole.len() as u64) as usize,
            _ => whole.len(),
        };
        let damaged = &file[..end];
        if let Ok(view) = View::read(damaged) {
            taken += 1;
            assert!(view.names(damaged).len() <= MAX_NAMES + 1);
            assert!(view.chains.len() <= 64);
            for chain in &view.chains {
                assert!(!chain.name.chars().any(char::is_control));
                assert!(chain.percentile(0) <= chain.percentile(random() as u8 % 101));
            }
            for thread in &view.threads {
                assert!(!thread.name.chars().any(char::is_control));
                for (events, copied) in [thread.events(damaged), thread.budget_events(damaged)] {
                    assert_eq!(events.len() as u64, copied.read);
                    assert!(events.len() * 32 <= whole.len());
                }
            }
        }
        touched.iter().for_each(|at| file[*at] = whole[*at]);
        file[224..232].copy_from_slice(&whole[224..232]);
    }
    assert!(taken > inputs / 10, "{taken} of {inputs} were read at all");
}
