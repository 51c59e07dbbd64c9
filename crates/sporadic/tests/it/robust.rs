//! Promises for any input: no panic, no overflow, bounded time, a clock that may jitter, and
//! the largest queues.

use crate::common::{check_chunks, corrected, pairs, posix};
use proptest::prelude::*;
use sporadic::{BudgetServer, Corrected, Kind, Level, Low, Nanos, Params, Server};

#[derive(Debug, Clone, Copy)]
enum Call {
    Activate(Nanos),
    Block(Nanos),
    Charge(Nanos, Nanos),
    Update(Nanos),
}

/// Any value, with a liking for the ends.
fn any_nanos() -> impl Strategy<Value = Nanos> {
    prop_oneof![any::<Nanos>(), 0..100u64, (u64::MAX - 100)..=u64::MAX]
}

fn any_call() -> impl Strategy<Value = Call> {
    prop_oneof![
        any_nanos().prop_map(Call::Activate),
        any_nanos().prop_map(Call::Block),
        (any_nanos(), any_nanos()).prop_map(|(used, now)| Call::Charge(used, now)),
        any_nanos().prop_map(Call::Update),
    ]
}

proptest! {
    #![proptest_config(crate::common::simulator::config())]

    #[test]
    fn any_call_with_any_value(
        budget in any_nanos(),
        period in any_nanos(),
        max_repl in 1..6u16,
        min_chunk in any_nanos(),
        start in any_nanos(),
        calls in proptest::collection::vec(any_call(), 0..40),
    ) {
        let (budget, period) = (budget.min(period).max(1), budget.max(period).max(1));
        let params = Params::new(60, Low::Suspend, budget, period, max_repl).unwrap();
        for kind in [Kind::Corrected, Kind::Posix] {
            let mut server = Server::<5>::new(kind, params, start).unwrap();
            if let Server::Corrected(inner) = server {
                server = Server::Corrected(inner.with_min_chunk(min_chunk));
            }
            let mut latest = start;
            for &call in &calls {
                let now = match call {
                    Call::Activate(now) => { server.activate(now); now }
                    Call::Block(now) => { server.block(now); now }
                    Call::Charge(used, now) => { server.charge(used, now); now }
                    Call::Update(now) => { server.update(now); now }
                };
                latest = latest.max(now);
                let foreseen = server.available(now);
                let level = server.update(now);
                prop_assert!(foreseen <= budget);
                prop_assert_eq!(foreseen, server.available(now));
                prop_assert_eq!(level == Level::High, foreseen > 0);
                prop_assert_eq!(level == Level::Low, server.next_replenishment().is_some());
                prop_assert!(server.next_replenishment().is_none_or(|time| time > latest));
                prop_assert!(server.pending() <= usize::from(max_repl) + 1);
                if let Server::Corrected(inner) = &server {
                    check_chunks(inner);
                }
            }
        }
    }

    /// A clock that goes back is a clock that stands still.
    #[test]
    fn jitter_of_the_clock(steps in proptest::collection::vec((0..9u8, 0..8u64, 0..5u64), 1..60)) {
        for kind in [Kind::Corrected, Kind::Posix] {
            let params = crate::common::params(4, 11, 3);
            let mut steady = Server::<3>::new(kind, params, 0).unwrap();
            let mut jittery = steady.clone();
            let mut latest = 0;
            for &(what, span, back) in &steps {
                // Either time goes on, or one of the two sees an earlier time.
                let (now, early) = if what % 2 == 0 {
                    latest += span;
                    (latest, latest)
                } else {
                    (latest, latest.saturating_sub(back))
                };
                for (server, now) in [(&mut steady, now), (&mut jittery, early)] {
                    match what / 2 {
                        0 => server.activate(now),
                        1 => server.block(now),
                        2 => server.charge(span, now),
                        _ => { server.update(now); }
                    }
                }
                prop_assert_eq!(&steady, &jittery);
                prop_assert_eq!(steady.available(now), jittery.available(early));
            }
        }
    }
}

#[test]
fn an_endless_overrun_is_charged_at_once() {
    let mut server = corrected(1, 1, 4);
    server.activate(0);
    server.charge(u64::MAX, 10); // a loop over used / B would not end
    assert_eq!(server.next_replenishment(), Some(u64::MAX));
    let mut server = corrected(1, 1 << 63, 4);
    server.charge(2, 10); // 2 T is one more than the last time there is
    assert_eq!(server.next_replenishment(), Some(u64::MAX));
    let mut server = posix(1, 1, 4);
    server.activate(0);
    server.charge(u64::MAX, 10);
    server.charge(u64::MAX, 10);
    assert_eq!(server.available(11), 1);
}

/// B = 200, T = 1000: a unit is used every other ns.
fn pieces(server: &mut impl BudgetServer, count: u64) {
    for start in (0..count).map(|i| 2 * i) {
        server.activate(start);
        assert_eq!(server.update(start), Level::High);
        server.charge(1, start + 1);
        server.block(start + 1);
    }
}

#[test]
fn max_repl_128_in_the_corrected_server() {
    let mut server = corrected(200, 1_000, 128);
    pieces(&mut server, 128);
    let expected = |count| (0..count).map(|i| (1_000 + 2 * i, 1)).collect::<Vec<_>>();
    assert_eq!(pairs(server.chunks())[1..], expected(128));
    assert_eq!(server.pending(), 128);
    server.activate(256);
    server.charge(1, 257); // one too many: the youngest becomes (1256, 2)
    assert_eq!(pairs(server.chunks())[1..128], expected(127));
    assert_eq!(pairs(server.chunks())[128..], [(1_256, 2)]);
    assert_eq!(server.available(1_256), 200);
}

#[test]
fn max_repl_128_in_the_posix_server() {
    let mut server = posix(200, 1_000, 128);
    pieces(&mut server, 128);
    assert_eq!(server.pending(), 128);
    assert_eq!(server.update(256), Level::Low); // with 72 left
    assert_eq!(server.next_replenishment(), Some(1_000));
    assert_eq!(server.update(1_000), Level::High);
    assert_eq!((server.available(1_000), server.pending()), (73, 127));
}

/// The queue is a ring: it goes round many times without losing order.
#[test]
fn the_ring_goes_round() {
    let params = Params::new(60, Low::Suspend, 5, 50, 3).unwrap();
    let mut server = Corrected::<3>::new(params, 0).unwrap();
    for start in (0..100_000).step_by(17) {
        server.activate(start);
        server.charge(server.available(start).min(2), start + 2);
        server.block(start + 2);
        server.update(start + 2);
        check_chunks(&server);
    }
    assert_eq!(server.available(200_000), 5);
}
