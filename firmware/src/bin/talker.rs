//! The talker without an agent on the board: the heap that it takes, and ten numbers to a listener
//! in the same image, in virtual time, after which nothing is allocated any more.
#![no_std]
#![no_main]

extern crate alloc;

use core::net::SocketAddr;
use firmware::talker::{DATAGRAM, Talker};
use firmware::{console, say};
use replenish_os::freertos::{SealedHeap, start};
use replenish_rtps::participant::{EndpointSpec, Limits, Participant, ParticipantConfig, ReaderId};
use replenish_rtps::wire::{GuidPrefix, Nanos, Qos};

#[global_allocator]
static HEAP: SealedHeap<{ 110 * 1024 }> = SealedHeap::new();

/// Numbers that the listener hears.
const NUMBERS: i32 = 10;
const MS: Nanos = 1_000_000;

#[unsafe(no_mangle)]
extern "C" fn image_main() -> ! {
    let started = start(97, 16384, || {
        let heard = talk();
        if heard.is_none() {
            say!("nobody heard it");
        }
        console::exit(heard.is_some() && HEAP.usage().refused == 0)
    });
    say!("the kernel did not start: {}", started.is_ok());
    console::exit(false)
}

fn address(number: u8) -> SocketAddr {
    ([192, 168, 7, number], 7410).into()
}

/// Says what it takes, and that the listener hears the numbers one after another.
fn talk() -> Option<()> {
    let (board, host) = (GuidPrefix([1; 12]), GuidPrefix([2; 12]));
    let before = HEAP.usage().used;
    let mut talker = Talker::new(0, board, address(1), &[address(2)], 1).ok()?;
    let heap = HEAP.usage().used - before;
    let (mut listener, reader) = listener(host)?;
    HEAP.seal();
    let (mut buf, mut now, mut last) = ([0; DATAGRAM], 1, 0);
    while last < NUMBERS {
        while let Some((len, to)) = talker.poll(&mut buf, now) {
            if to == address(2) {
                listener.receive(&buf[..len], now).ok()?;
            }
        }
        while let Some((len, to)) = listener.transmit(&mut buf, now) {
            if to == address(1) {
                talker.receive(&buf[..len], now);
            }
        }
        while let Some(sample) = listener.take(reader) {
            let number = i32::from_le_bytes(sample.payload.get(4..)?.try_into().ok()?);
            if last != 0 && number != last + 1 {
                return None;
            }
            last = number;
        }
        now += 10 * MS;
        if now > 60_000 * MS {
            return None;
        }
    }
    say!("{{\"heap\": {heap}, \"heard\": {last}}}");
    Some(())
}

/// A listener with as little memory.
fn listener(prefix: GuidPrefix) -> Option<(Participant, ReaderId)> {
    let config = ParticipantConfig {
        discovery: [address(2)].into_iter().collect(),
        user: [address(2)].into_iter().collect(),
        announce_to: &[address(1)],
        datagram: DATAGRAM,
        host_datagram: DATAGRAM,
        announcements: 2,
        announcement_bytes: 1024,
        limits: Limits {
            participants: 1,
            endpoints: 2,
            own_endpoints: 1,
            matches: 1,
            events: 16,
        },
        ..ParticipantConfig::new(prefix)
    };
    let mut participant = Participant::new(&config, 1).ok()?;
    let spec = EndpointSpec {
        qos: Qos::unnamed(false),
        sample_bytes: 8,
        ..EndpointSpec::new("rt/chatter", "std_msgs::msg::dds_::Int32_")
    };
    let reader = participant.create_reader(&spec, 1).ok()?;
    Some((participant, reader))
}
