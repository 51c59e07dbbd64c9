//! Samples for the readers of one participant.

use replenish_rtps::endpoint::{Body, Header, HostLimits, Writer, WriterLimits};
use replenish_rtps::wire::{EntityId, Guid, GuidPrefix, Message, MessageWriter, Qos, Submessage};

const OWN: GuidPrefix = GuidPrefix([0; 12]);

/// A reply is written before the client's reader of replies is known.
#[test]
fn a_sample_for_one_participant_waits_for_its_reader() {
    let (theirs, others) = (GuidPrefix([1; 12]), GuidPrefix([2; 12]));
    let limits = WriterLimits {
        samples: 10,
        sample_bytes: 8,
        readers: 4,
        fragment_bytes: 1200,
        memory: None,
        host: HostLimits::DEFAULT,
    };
    let qos = Qos::ros();
    let mut writer = Writer::new(Guid::new(OWN, EntityId::writer(1)), qos, &limits);
    writer.write(&[0; 8], None, 0).unwrap();
    for (number, only) in [(1, theirs), (2, others), (3, theirs)] {
        let header = Header {
            only: Some(only),
            ..Header::default()
        };
        let body = Body::Parts(&[&[number; 8]]);
        writer.write_with(body, &header, 0).unwrap();
    }
    let mut came = |prefix: GuidPrefix| {
        let reader = Guid::new(prefix, EntityId::reader(1));
        assert!(writer.add_reader(reader, &qos, "10.0.0.7:7411".parse().unwrap(), 0));
        let mut buf = [0; 1472];
        let mut numbers = Vec::new();
        loop {
            let mut m = MessageWriter::new(&mut buf, OWN).unwrap();
            if writer.transmit(0, &mut m).is_none() {
                return numbers;
            }
            for part in Message::decode(m.message()).unwrap().submessages() {
                if let Ok(Submessage::Data(data)) = part {
                    numbers.push(data.sn);
                }
            }
        }
    };
    // Not the first one, which all got that were there.
    assert_eq!(came(theirs), [2, 4]);
    assert_eq!(came(others), [3]);
    assert_eq!(came(GuidPrefix([3; 12])), []);
}
