//! A4, A10, A11: with `--dds`, beside Cyclone DDS, which echoes `/chatter` on `/echo`.

use super::{agent, program, row};
use crate::attacker::{Raw, base};
use crate::common::Scratch;
use crate::cyclone::{self, Cyclone};
use crate::memory::Victim;
use crate::stock_client::{At, HISTORY, KEEP_ALL, KEEP_TEN, Stock};
use replenish_testkit::harness::{Trial, skip_peer, trial};
use replenish_xrce::wire::{Delete, ObjectId, ObjectKind, StreamId};
use std::sync::atomic::{AtomicU16, Ordering};
use std::time::{Duration, Instant};

const STRING: &str = "std_msgs::msg::dds_::String_";

/// An agent with a bridge, and a DDS program in its domain.
struct Bridged {
    victim: Victim,
    cyclone: Cyclone,
    _scratch: Scratch,
}

impl Bridged {
    /// Skips the trial where there is no bridge or no Cyclone, and none is required.
    fn new(name: &str) -> Self {
        static NEXT: AtomicU16 = AtomicU16::new(0);
        // No address: it does not start. b209253 without a bridge does not know the option.
        let refused =
            replenish_testkit::program::run(&program(), &["agent", "--dds", "--udp", "nowhere"]);
        let words = String::from_utf8_lossy(&refused.stderr);
        let bridges = !["without the bridge", "unexpected argument '--dds'"]
            .iter()
            .any(|none| words.contains(none));
        let without = (!bridges).then(|| "this program is built without dds".into());
        if let Some(missing) = without.or_else(cyclone::missing) {
            skip_peer(&missing);
        }
        // Above 101 the ports are among those that the kernel hands out to others.
        let process = u16::try_from(std::process::id() % 9).unwrap();
        let domain = 10 + process * 10 + NEXT.fetch_add(1, Ordering::Relaxed) % 10;
        let scratch = Scratch::new(name);
        let number = domain.to_string();
        let victim = agent(&scratch, &["--dds", "--domain", &number, "--entities=512"]);
        Self {
            victim,
            cyclone: Cyclone::start(domain, &["echo", "reliable"]),
            _scratch: scratch,
        }
    }

    /// A client that talks to Cyclone, and one that hears it.
    fn pair(&self) -> (Stock, Stock) {
        let at = At::Udp(self.victim.at.udp);
        let (mut talker, mut listener) = (Stock::new(at, 201), Stock::new(at, 202));
        talker.equip(("rt/chatter", STRING), KEEP_TEN, None);
        listener.equip(("rt/echo", STRING), KEEP_TEN, Some(KEEP_TEN));
        listener.read(StreamId::RELIABLE);
        (talker, listener)
    }
}

/// Writes every 50 ms until an echo of this call comes back: how long that took.
fn echo(talker: &mut Stock, listener: &mut Stock, text: &str, limit: Duration) -> Option<Duration> {
    let (begin, mut last) = (Instant::now(), None::<Instant>);
    let length = u32::try_from(text.len() + 1).unwrap();
    let sample = [&length.to_le_bytes(), text.as_bytes(), b"\0"].concat();
    while begin.elapsed() < limit {
        let due = last.is_none_or(|last| last.elapsed() > Duration::from_millis(50));
        if due && talker.under_way() < HISTORY {
            talker.write(StreamId::RELIABLE, &sample);
            last = Some(Instant::now());
        }
        talker.turn();
        listener.turn();
        let heard = std::mem::take(&mut listener.got);
        let is_echo = |got: &Vec<u8>| String::from_utf8_lossy(got).contains(text);
        if heard.iter().any(is_echo) {
            return Some(begin.elapsed());
        }
    }
    None
}

const LIMIT: Duration = Duration::from_secs(12);

fn said(echo: Option<Duration>) -> String {
    let limit = LIMIT.as_secs();
    echo.map_or(format!("no echo for {limit} s"), |after| {
        format!("an echo after {:.1} s", after.as_secs_f64())
    })
}

/// b209253's DDS forgot a participant for good.
fn a04_a_dds_reader_pauses_for_longer_than_its_lease() {
    let bridged = Bridged::new("a04");
    let (mut talker, mut listener) = bridged.pair();
    let first = echo(&mut talker, &mut listener, "first", super::SOON);
    assert!(first.is_some(), "control");
    bridged.cyclone.signal("STOP");
    // Its lease is 2 s.
    echo(
        &mut talker,
        &mut listener,
        "unheard",
        Duration::from_secs(4),
    );
    bridged.cyclone.signal("CONT");
    // Samples that wait in its socket come from before.
    echo(&mut talker, &mut listener, "?", Duration::from_secs(1));
    let again = echo(&mut talker, &mut listener, "again", LIMIT);
    let holds = again.is_some();
    row(
        "A4",
        "a DDS reader pauses for 4 s, lease 2 s",
        &said(again),
        holds,
    );
}

/// b209253 counted names for good, and those of all clients together.
fn a10_one_client_brings_1100_names() {
    let bridged = Bridged::new("a10");
    let mut greedy = Raw::open(bridged.victim.at.tcp, 1, 512);
    for round in 0..11 {
        for number in 1..=100 {
            greedy.typed_topic(number, &format!("rt/n{round}_{number}"), STRING);
            greedy.writer(number, number, KEEP_ALL);
        }
        std::thread::sleep(Duration::from_millis(300));
        for number in 1..=100 {
            greedy.delete(number, ObjectKind::DataWriter);
            greedy.delete(number, ObjectKind::Topic);
        }
    }
    let (mut talker, mut listener) = bridged.pair();
    let heard = echo(&mut talker, &mut listener, "new", LIMIT);
    let holds = heard.is_some();
    row("A10", "1100 names; then a new one", &said(heard), holds);
}

/// b209253 kept the first type of a name for good.
fn a11_a_name_was_used_with_another_type() {
    let bridged = Bridged::new("a11");
    let mut wrong = Raw::open(bridged.victim.at.tcp, 1, 512);
    wrong.typed_topic(1, "rt/chatter", "std_msgs::msg::dds_::Wrong_");
    wrong.writer(1, 1, KEEP_ALL);
    std::thread::sleep(Duration::from_secs(1));
    wrong.control(|message| {
        let base = base(ObjectId::CLIENT);
        message.push_padded(&Delete { base }).unwrap();
    });
    std::thread::sleep(Duration::from_secs(1));
    let (mut talker, mut listener) = bridged.pair();
    let heard = echo(&mut talker, &mut listener, "right", LIMIT);
    let holds = heard.is_some();
    row(
        "A11",
        "/chatter with a wrong type, then the right one",
        &said(heard),
        holds,
    );
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "a04_a_dds_reader_pauses_for_longer_than_its_lease",
            a04_a_dds_reader_pauses_for_longer_than_its_lease,
        ),
        trial(
            "a10_one_client_brings_1100_names",
            a10_one_client_brings_1100_names,
        ),
        trial(
            "a11_a_name_was_used_with_another_type",
            a11_a_name_was_used_with_another_type,
        ),
    ]
}
