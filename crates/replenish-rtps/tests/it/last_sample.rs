//! The last sample of a burst is lost, and no later one shows it: the writer's heartbeats do, until
//! it is acknowledged.

use replenish_rtps::endpoint::{HostLimits, Reader, ReaderLimits, Writer, WriterLimits};
use replenish_rtps::wire::{
    CDR_LE, EntityId, Guid, GuidPrefix, Message, MessageWriter, Nanos, Qos, Submessage,
};
use std::net::SocketAddr;

const W: GuidPrefix = GuidPrefix([1; 12]);
const R: GuidPrefix = GuidPrefix([2; 12]);
const MILLI: Nanos = 1_000_000;
const BURST: u8 = 10;

/// The time from the last write until a reader that keeps the last samples has it, where the
/// burst's last sample and then so many datagrams with heartbeats are lost.
fn time_to_the_last_sample(qos: Qos, lost_heartbeats: u32) -> Nanos {
    let limits = WriterLimits {
        samples: 3,
        sample_bytes: 8,
        readers: 1,
        fragment_bytes: 1200,
        memory: None,
        host: HostLimits::DEFAULT,
    };
    let room = ReaderLimits {
        samples: 3,
        sample_bytes: 8,
        writers: 1,
    };
    let to: SocketAddr = "10.0.0.7:7411".parse().unwrap();
    let mut writer = Writer::new(Guid::new(W, EntityId::writer(1)), qos, &limits);
    let mut reader = Reader::new(Guid::new(R, EntityId::reader(1)), qos, &room);
    assert!(writer.add_reader(reader.guid(), &qos, to, 0));
    assert!(reader.add_writer(writer.guid(), &qos, to));
    let (mut lost, mut buf) = (0, [0; 1472]);
    let (mut written, mut last_write) = (0, 0);
    for step in 0_u64.. {
        let now = step * MILLI;
        assert!(now < 60_000 * MILLI, "never heard");
        if step >= 200 && written < BURST {
            written += 1;
            last_write = now;
            let [a, b, c, d] = CDR_LE;
            writer
                .write(&[a, b, c, d, written, 0, 0, 0], None, now)
                .unwrap();
        }
        loop {
            let mut m = MessageWriter::new(&mut buf, W).unwrap();
            if writer.transmit(now, &mut m).is_none() {
                break;
            }
            for part in Message::decode(m.message()).unwrap().submessages() {
                match part.unwrap() {
                    // The last sample goes out once by itself.
                    Submessage::Data(data) if data.sn < i64::from(BURST) || lost > 0 => {
                        reader.data(W, &data, None);
                    }
                    Submessage::Data(_) => lost = 1,
                    Submessage::Heartbeat(_) if (1..=lost_heartbeats).contains(&lost) => lost += 1,
                    Submessage::Heartbeat(body) => reader.heartbeat(W, &body),
                    Submessage::Gap(body) => reader.gap(W, &body),
                    _ => {}
                }
            }
            while reader.wants_to_transmit(now) {
                let mut m = MessageWriter::new(&mut buf, R).unwrap();
                reader.transmit(now, &mut m).unwrap();
                for part in Message::decode(m.message()).unwrap().submessages() {
                    if let Submessage::AckNack(body) = part.unwrap() {
                        writer.acknack(R, &body, now);
                    }
                }
            }
        }
        while let Some(sample) = reader.take() {
            if sample.payload[4] == BURST {
                return now - last_write;
            }
        }
    }
    unreachable!("it is heard or not")
}

/// Heartbeats come 10 ms after the last write, then after twice the time, at most 1 s apart.
#[test]
fn a_lost_last_sample_comes_after_the_next_heartbeat() {
    let mut bound = 10 * MILLI;
    for lost in 0..12 {
        for qos in [Qos::ros(), Qos::latched(3)] {
            let took = time_to_the_last_sample(qos, lost);
            assert!(took <= bound, "{took} ns after {lost} lost heartbeats");
        }
        bound += ((10 * MILLI) << lost).min(1000 * MILLI);
    }
}
