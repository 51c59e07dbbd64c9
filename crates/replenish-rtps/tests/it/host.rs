//! Samples to readers on the same host go in few datagrams, to others in many short ones.

use replenish_rtps::endpoint::{HostLimits, Writer, WriterLimits};
use replenish_rtps::wire::{EntityId, Guid, GuidPrefix, Message, MessageWriter, Qos, Submessage};
use std::net::SocketAddr;

const OWN: GuidPrefix = GuidPrefix([0; 12]);
const SAMPLE: usize = 200_000;

fn writer() -> Writer {
    let limits = WriterLimits {
        samples: 1,
        sample_bytes: SAMPLE,
        readers: 4,
        fragment_bytes: 1200,
        memory: None,
        host: HostLimits {
            burst: SAMPLE,
            ..HostLimits::DEFAULT
        },
    };
    Writer::new(
        Guid::new(OWN, EntityId::writer(1)),
        Qos::latched(1),
        &limits,
    )
}

fn add(writer: &mut Writer, key: u32, to: &str) {
    let reader = Guid::new(GuidPrefix([0; 12]), EntityId::reader(key));
    assert!(writer.add_reader(reader, &Qos::latched(1), to.parse().unwrap(), 0));
}

/// Datagrams sent within a second: the length of each and its number of fragments, by the
/// address.
fn sent(writer: &mut Writer) -> Vec<(SocketAddr, usize, usize)> {
    let mut all = Vec::new();
    for millisecond in 0..1000 {
        let mut buf = [0; 65_000];
        loop {
            let mut m = MessageWriter::new(&mut buf, OWN).unwrap();
            let Some(to) = writer.transmit(millisecond * 1_000_000, &mut m) else {
                break;
            };
            let parts = Message::decode(m.message()).unwrap().submessages();
            let parts = parts.filter(|part| matches!(part, Ok(Submessage::DataFrag(_))));
            all.push((to, m.len(), parts.count()));
        }
    }
    all.retain(|(_, _, fragments)| *fragments > 0);
    all
}

#[test]
fn to_this_host_samples_go_in_few_datagrams() {
    let mut writer = writer();
    add(&mut writer, 1, "127.0.0.1:7411");
    writer.write(&[7; SAMPLE], None, 0).unwrap();
    let sent = sent(&mut writer);
    assert_eq!(sent.len(), SAMPLE.div_ceil(64_000));
    assert!(sent.iter().all(|(_, _, fragments)| *fragments == 1));
}

#[test]
fn with_a_reader_on_another_host_all_datagrams_are_short() {
    let mut writer = writer();
    add(&mut writer, 1, "127.0.0.1:7411");
    add(&mut writer, 2, "10.0.0.7:7411");
    writer.write(&[7; SAMPLE], None, 0).unwrap();
    let sent = sent(&mut writer);
    assert_eq!(sent.len(), 2 * SAMPLE.div_ceil(1200));
    assert!(sent.iter().all(|(_, len, _)| *len <= 1360));
}

/// The sample was cut for this host: another one gets it all the same.
#[test]
fn a_late_reader_on_another_host_gets_what_was_cut_for_this_one() {
    let mut writer = writer();
    add(&mut writer, 1, "127.0.0.1:7411");
    writer.write(&[7; SAMPLE], None, 0).unwrap();
    sent(&mut writer);
    add(&mut writer, 2, "10.0.0.7:7411");
    let sent = sent(&mut writer);
    assert_eq!(sent.len(), SAMPLE.div_ceil(64_000));
    assert!(
        sent.iter()
            .all(|(to, _, _)| *to == "10.0.0.7:7411".parse().unwrap())
    );
}

/// A burst is due at once, and the next one after a pause.
#[test]
fn all_of_a_burst_is_due_at_once() {
    for (to, burst, pause) in [
        ("127.0.0.1:7411", SAMPLE.div_ceil(64_000), None),
        (
            "10.0.0.7:7411",
            65_536_usize.div_ceil(1200),
            Some(1_000_000),
        ),
    ] {
        let mut writer = writer();
        add(&mut writer, 1, to);
        writer.write(&[7; SAMPLE], None, 0).unwrap();
        let (mut buf, mut datagrams) = ([0; 65_000], 0);
        while writer.next_at(0) == 0 {
            let mut m = MessageWriter::new(&mut buf, OWN).unwrap();
            writer.transmit(0, &mut m).unwrap();
            datagrams += usize::from(m.len() > 1000);
        }
        assert_eq!(datagrams, burst, "{to}");
        let next = writer.next_at(0);
        assert!(pause.is_none_or(|pause| next == pause), "{to}: {next}");
    }
}
