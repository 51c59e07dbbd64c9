//! A recording that another program wrote: a whole one with patches, with the right checksum or
//! not.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish_recorder::{
    Clocks, Event, Kind, MAX_NAMES, NameKind, Plan, Planned, Role, View, Writer, write_name,
};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

fuzz_target!(|bytes: &[u8]| {
    let Some((first, mut rest)) = bytes.split_first() else {
        return;
    };
    let mut file = recording().clone();
    // A patch: its place, of 4 bytes, its length, and its bytes.
    while let [a, b, c, d, len, after @ ..] = rest {
        let at = u32::from_le_bytes([*a, *b, *c, *d]) as usize % file.len();
        let (patch, after) = after.split_at(usize::from(*len).min(after.len()));
        let end = file.len().min(at + patch.len());
        file[at..end].copy_from_slice(&patch[..end - at]);
        rest = after;
    }
    if first & 1 == 0 {
        let sum = checksum(&file[..224]).to_le_bytes();
        file[224..232].copy_from_slice(&sum);
    }
    if first & 2 != 0 {
        file.truncate(file.len() * usize::from(*first) / 256);
    }
    let Ok(view) = View::read(&file[..]) else {
        return;
    };
    assert!(!view.program.chars().any(char::is_control));
    assert!(view.names(&file[..]).len() <= MAX_NAMES + 1);
    for thread in &view.threads {
        assert!(!thread.name.chars().any(char::is_control));
        for (events, _) in [thread.events(&file[..]), thread.budget_events(&file[..])] {
            assert!(events.len() * 32 <= file.len());
        }
    }
});

fn checksum(bytes: &[u8]) -> u64 {
    let step = |sum: u64, byte: &u8| (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

/// A file as a program would leave it.
fn recording() -> &'static Vec<u8> {
    static FILE: OnceLock<Vec<u8>> = OnceLock::new();
    FILE.get_or_init(|| {
        let thread = |name, role, budget| Planned {
            name,
            role,
            cpu: None,
            budget,
        };
        let threads = [
            thread("dispatcher", Role::Dispatcher, None),
            thread("worker", Role::Worker, Some((2_000, 10_000))),
        ];
        let plan = Plan::new(&threads, 4096).unwrap();
        let memory: Vec<AtomicU64> = (0..plan.bytes / 8).map(|_| AtomicU64::new(0)).collect();
        let clocks = Clocks {
            monotonic: 5,
            boottime: 6,
            realtime: 7,
        };
        plan.write(&memory, "robot", 42, clocks, &threads);
        write_name(
            plan.names.of(&memory),
            1,
            NameKind::Handle,
            "/node/sub:/scan",
        );
        let ring = plan.threads[1].ring.of(&memory);
        let mut writer = Writer::new(ring.len()).unwrap();
        for time in 0..1000 {
            let event = Event {
                time,
                kind: Kind::Begin,
                name: 1,
                a: time,
                b: 0,
            };
            writer.write(ring, &event);
        }
        let words = memory.iter().map(|word| word.load(Ordering::Relaxed));
        words.flat_map(u64::to_le_bytes).collect()
    })
}
