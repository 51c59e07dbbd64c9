//! A board's recording: events at 16 bytes, the ring, the pieces on the line, and the host's file.

use replenish_recorder::board::{
    BoardThread, CompactEvent, CompactRing, EVENTS_PER_PIECE, Image, MAX_PIECE, Piece, PieceError,
    Relay,
};
use replenish_recorder::{Clocks, Event, Kind, MIN_RING, NameKind, Role, RunningTotals, View};
use std::sync::atomic::{AtomicU64, Ordering};

const HOUR: u64 = 3_600_000_000_000;
/// Host's clock less the board's.
const SHIFT: u64 = 5_000_000_000_000;
/// Unix time less the host's clock.
const WALL: u64 = 1_790_000_000_000_000_000;

fn event(time: u64, kind: Kind, name: u32, a: u64, b: u64) -> Event {
    Event {
        time,
        kind,
        name,
        a,
        b,
    }
}

fn at(monotonic: u64) -> Clocks {
    Clocks {
        monotonic,
        boottime: monotonic,
        realtime: monotonic + WALL,
    }
}

#[test]
fn every_kind_comes_back_from_16_bytes() {
    for time in [7, HOUR, 77 * HOUR, 100_000 * HOUR] {
        for kind in Kind::ALL {
            let (a, b) = match kind {
                Kind::Wake => (time + 5, 0),
                Kind::Begin | Kind::End | Kind::ChainStage | Kind::ChainEnd => (time - 7, 0),
                Kind::Publish | Kind::Level => (1, 1),
                _ => (123_456_789, 0),
            };
            let event = event(time, kind, 65_535, a, b);
            let bytes = CompactEvent::new(200, true, &event).to_bytes();
            let back = CompactEvent::from_bytes(&bytes).expand(time + 77 * HOUR);
            assert_eq!(back, Some((200, true, event)));
        }
    }
    let most = event(9, Kind::Skip, 70_000, u64::MAX, 3);
    let (_, of_budget, back) = CompactEvent::new(1, false, &most).expand(9).unwrap();
    assert_eq!((back.name, back.a, back.b), (0, (1 << 48) - 1, 0));
    assert!(!of_budget);
    assert_eq!(
        CompactEvent([0x7f << 48, 0]).expand(0),
        None,
        "no such kind"
    );
}

#[test]
fn the_ring_keeps_the_last_and_tells_what_is_gone() {
    let mut ring = CompactRing::<8>::new();
    let mut copy = [CompactEvent::default(); 5];
    assert_eq!(ring.copy(0, &mut copy), (0, 0));
    for n in 0..20 {
        ring.push(CompactEvent([n, n]));
    }
    assert_eq!((ring.written(), ring.copy(0, &mut copy)), (20, (12, 5)));
    assert_eq!(copy.map(|e| e.0[0]), [12, 13, 14, 15, 16]);
    assert_eq!(ring.copy(17, &mut copy), (17, 3));
    assert_eq!(ring.copy(99, &mut copy), (20, 0));
}

fn thread(index: usize) -> BoardThread<'static> {
    let names = ["dispatcher", "worker"];
    BoardThread {
        index,
        threads: 2,
        task: 10 + u8::try_from(index).unwrap(),
        role: [Role::Dispatcher, Role::Worker][index],
        budget: [None, Some((30, 100))][index],
        totals: RunningTotals {
            high: 1,
            low: 2,
            exhaustions: 3,
            replenishments: 4,
            available: 5,
            is_low: true,
        },
        name: names[index],
        policy: "SCHED_FIFO 60",
    }
}

fn name(id: u16, text: &str) -> Piece<'_> {
    let kind = NameKind::Handle;
    Piece::Name { id, kind, text }
}

/// Over the line and back.
fn sent(relay: &mut Relay, piece: &Piece<'_>, arrival: u64) -> Vec<(usize, bool, Event)> {
    let mut room = [0; MAX_PIECE];
    let len = piece.write(&mut room);
    let read = Piece::read(&room[..len]).unwrap();
    assert_eq!(read, *piece);
    for cut in 0..len {
        assert!(Piece::read(&room[..cut]).is_err());
    }
    let mut events = Vec::new();
    relay.take(&read, at(arrival), |e| {
        events.push((e.thread, e.of_budget, e.event));
    });
    events
}

fn described() -> Relay {
    let mut relay = Relay::new();
    for index in [1, 0] {
        assert!(!relay.is_complete());
        sent(&mut relay, &Piece::Thread(thread(index)), 1);
    }
    sent(&mut relay, &name(0, "pong"), 1);
    assert!(relay.is_complete());
    relay
}

fn bytes(events: &[(u8, bool, Event)]) -> Vec<u8> {
    let all = events.iter();
    all.flat_map(|(task, budget, event)| CompactEvent::new(*task, *budget, event).to_bytes())
        .collect()
}

#[test]
fn events_stand_on_the_hosts_clock_by_the_exchange_and_else_by_arrival() {
    let mut relay = described();
    let events = bytes(&[
        (11, false, event(50, Kind::Begin, 1, 40, 0)),
        (11, true, event(60, Kind::Exhausted, 0, 7, 0)),
        (99, false, event(61, Kind::Mark, 0, 7, 0)), // nobody's
    ]);
    let piece = |first, now, ahead| Piece::Events {
        first,
        now,
        ahead,
        events: &events,
    };
    let ahead = Some((SHIFT + WALL).cast_signed());
    let late = SHIFT + 100 + 1_000_000; // a millisecond on its way
    let got = sent(&mut relay, &piece(0, 100, ahead), late);
    let begin = event(SHIFT + 50, Kind::Begin, 1, SHIFT + 40, 0);
    let exhausted = event(SHIFT + 60, Kind::Exhausted, 0, 7, 0);
    assert_eq!(got, [(1, false, begin), (1, true, exhausted)]);
    assert_eq!(relay.exchanged(), Some(SHIFT.cast_signed()));
    assert_eq!(relay.counts(), (2, 1));
    // A piece that comes twice counts once; a gap is counted.
    assert_eq!(sent(&mut relay, &piece(0, 101, ahead), late), []);
    assert_eq!(sent(&mut relay, &piece(10, 102, ahead), late).len(), 2);
    assert_eq!(relay.counts(), (4, 1 + 7 + 1));
    // An exchange that cannot be, and none.
    for lie in [None, Some(0), Some(i64::MAX)] {
        let mut relay = described();
        let got = sent(&mut relay, &piece(0, 100, lie), late);
        assert_eq!(got[0].2.time, late - 100 + 50);
        assert_eq!(relay.exchanged(), None);
    }
    // A board that has started again.
    sent(&mut relay, &piece(0, 90, ahead), late);
    assert_eq!((relay.starts(), relay.is_complete()), (1, false));
}

#[test]
fn the_hosts_file_is_read_like_any_other() {
    let mut relay = described();
    sent(&mut relay, &name(1, "/n/sub:t"), 1);
    let bytes_of_file = Image::<Vec<AtomicU64>>::bytes(&relay, MIN_RING).unwrap();
    let memory: Vec<AtomicU64> = (0..bytes_of_file / 8).map(|_| AtomicU64::new(0)).collect();
    let mut image = Image::new(&relay, MIN_RING, 1 << 30, at(9), &*memory).unwrap();
    let events = bytes(&[
        (11, false, event(50, Kind::Begin, 1, 40, 0)),
        (11, true, event(60, Kind::Exhausted, 0, 7, 0)),
        (10, true, event(61, Kind::Exhausted, 0, 7, 0)), // it has no budget
    ]);
    let piece = Piece::Events {
        first: 0,
        now: 100,
        ahead: None,
        events: &events,
    };
    relay.take(&piece, at(SHIFT), |event| image.write(&event));
    image.refresh(&relay);
    let file: Vec<u8> = memory
        .iter()
        .flat_map(|word| word.load(Ordering::Relaxed).to_le_bytes())
        .collect();
    let view = View::read(&*file).unwrap();
    assert_eq!((&*view.program, view.pid), ("pong", 1 << 30));
    let worker = &view.threads[1];
    assert_eq!((&*worker.name, worker.tid), ("worker", (1 << 30) + 2));
    assert_eq!(worker.budget, Some((30, 100)));
    assert_eq!(worker.totals, thread(1).totals);
    assert_eq!(worker.policy, "SCHED_FIFO 60");
    assert_eq!(worker.events(&*file).0.len(), 1);
    assert_eq!(worker.budget_events(&*file).0.len(), 1);
    assert_eq!(view.threads[0].events(&*file).0.len(), 0);
    let names = view.names(&*file);
    assert_eq!(names[1], Some((NameKind::Handle, "/n/sub:t".to_owned())));
}

#[test]
fn damaged_pieces_do_no_harm() {
    let events = bytes(&[(11, false, event(50, Kind::Begin, 1, 40, 0)); EVENTS_PER_PIECE]);
    let good = [
        Piece::Thread(thread(1)),
        name(3, "control\u{1b}[2J"),
        Piece::Events {
            first: 3,
            now: 100,
            ahead: Some(5),
            events: &events,
        },
    ];
    let mut relay = described();
    let mut seed = 1_u64;
    let mut below = |n: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        usize::try_from(seed >> 33).unwrap() % n
    };
    let (mut taken, mut refused) = (0, 0);
    for n in 0..30_000 {
        let mut room = [0; MAX_PIECE];
        let len = good[n % 3].write(&mut room);
        for _ in 0..=below(3) {
            room[below(len)] = [0, 1, 0x7f, 0x80, 0xff][below(5)];
        }
        match Piece::read(&room[..len.saturating_sub(below(3))]) {
            Ok(piece) => {
                taken += 1;
                relay.take(&piece, at(SHIFT), |event| assert!(event.thread < 16));
            }
            Err(_) => refused += 1,
        }
    }
    assert!(taken > 1000 && refused > 1000, "{taken} {refused}");
    assert_eq!(Piece::read(b"rpl"), Err(PieceError::NoPiece));
    assert_eq!(
        Piece::read(b"rplb\x02\x01\0\0"),
        Err(PieceError::Version(2))
    );
}

#[test]
fn numbers_at_the_end_of_their_range_do_no_harm() {
    let one = bytes(&[(11, false, event(50, Kind::Begin, 1, 40, 0))]);
    let piece = |first, events| Piece::Events {
        first,
        now: 100,
        ahead: None,
        events,
    };
    // As a stranger may send it: without events, or with one.
    let mut relay = described();
    for _ in 0..2 {
        assert_eq!(sent(&mut relay, &piece(u64::MAX, &[]), SHIFT), []);
    }
    assert_eq!(relay.counts(), (0, u64::MAX));
    assert_eq!(sent(&mut relay, &piece(u64::MAX - 1, &one), SHIFT).len(), 1);
    assert_eq!(relay.counts(), (1, u64::MAX));
    let mut room = [0; MAX_PIECE];
    let len = piece(u64::MAX, &one).write(&mut room);
    let refused = Piece::read(&room[..len]);
    assert_eq!(refused, Err(PieceError::Field("first")));
    // As a program may make it.
    relay.take(&piece(u64::MAX, &one), at(SHIFT), |_| {});
    assert_eq!(relay.counts(), (2, u64::MAX));
}
