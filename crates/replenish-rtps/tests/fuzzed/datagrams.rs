//! Structured traffic of strangers: participants and endpoints that come and go, samples whole and
//! in fragments, heartbeats, gaps and acknowledgements, for the names that the participant under
//! fire has; some of it damaged.

use super::Choice;
use replenish_rtps::ros::{GRAPH_TOPIC, GRAPH_TYPE, GidSize, Node, encode_graph};
use replenish_rtps::wire::{
    AckNack, CDR_LE, ChainOrigin, Data, DataFrag, Durability, EndpointData, EntityId, FragmentSet,
    Gap, Guid, GuidPrefix, Heartbeat, HeartbeatFrag, INFINITE, LivelinessKind, MessageWriter,
    NackFrag, Nanos, ParticipantData, Payload, Qos, Reference, Reliability, SampleIdentity,
    SegmentName, SequenceNumber, SequenceSet, SharedPlace, Timestamp, TypeHash, Writer, disposal,
    put_chain_origins, put_related_request,
};

pub(crate) const TOPIC: &str = "rt/chatter";
pub(crate) const TYPE: &str = "std_msgs::msg::dds_::Int32_";
const SECOND: Nanos = 1_000_000_000;
/// Vendors, with which their prefixes begin, and none.
const VENDORS: [[u8; 2]; 4] = [[1, 15], [1, 16], [1, 1], [0, 0]];

const SEDP_WRITERS: [EntityId; 2] = [
    EntityId::SEDP_PUBLICATIONS_WRITER,
    EntityId::SEDP_SUBSCRIPTIONS_WRITER,
];
/// More than are taken in.
const STRANGERS: usize = 8;

/// One of more participants than are taken in.
pub(crate) fn stranger(number: usize) -> GuidPrefix {
    let [a, b] = VENDORS[number % VENDORS.len()];
    GuidPrefix([a, b, 9, 9, 9, 9, 9, 9, 9, 9, 9, number as u8])
}

/// Where the traffic goes, and how far its numbers have come.
pub(crate) struct Traffic {
    pub(crate) to: GuidPrefix,
    pub(crate) writer: EntityId,
    /// Its reader of the topic, and that of the graph.
    pub(crate) readers: [EntityId; 2],
    /// The last sample of each writer of each stranger.
    last: [[SequenceNumber; 7]; STRANGERS],
    count: u32,
}

impl Traffic {
    pub(crate) fn new(to: GuidPrefix, writer: EntityId, readers: [EntityId; 2]) -> Self {
        Traffic {
            to,
            writer,
            readers,
            last: [[0; 7]; STRANGERS],
            count: 0,
        }
    }

    /// The next datagram, in `buf`; returns its length.
    pub(crate) fn datagram(&mut self, choice: &mut impl Choice, buf: &mut [u8]) -> usize {
        self.count += 1;
        let number = choice.below(STRANGERS);
        let from = stranger(number);
        let Ok(mut m) = MessageWriter::new(buf, from) else {
            return 0;
        };
        if choice.one_in(2) {
            let others = [self.to, GuidPrefix::default(), from];
            let to = if choice.one_in(16) {
                choice.of(&others)
            } else {
                self.to
            };
            m.info_destination(to).ok();
        }
        for _ in 0..=choice.below(3) {
            // A part without room ends the datagram.
            if self.part(choice, number, &mut m).is_none() {
                break;
            }
        }
        let len = m.len();
        damage(choice, buf, len)
    }

    /// The number of a writer's sample: often the next one, or the last if it writes none.
    fn sn(
        &mut self,
        choice: &mut impl Choice,
        number: usize,
        writer: EntityId,
        writes: bool,
    ) -> SequenceNumber {
        let place = match writer {
            EntityId::SEDP_PUBLICATIONS_WRITER => 0,
            EntityId::SEDP_SUBSCRIPTIONS_WRITER => 1,
            EntityId::LIVELINESS_WRITER => 2,
            EntityId::SPDP_WRITER => 3,
            EntityId([_, _, key, _]) => 4 + usize::from(key) % 3,
        };
        let last = &mut self.last[number][place];
        // A reader that was led far ahead takes nothing more for long.
        match choice.below(1000) {
            0 => choice.of(&[1, 2, i64::MAX / 4, i64::MAX, 1 << 32, i64::MAX / 4 - 256]),
            1 => *last + choice.number(1000),
            2..100 => (*last - choice.number(4)).max(1),
            _ => {
                *last += i64::from(writes);
                (*last).max(1)
            }
        }
    }

    fn own_reader(&self, choice: &mut impl Choice) -> EntityId {
        choice.of(&[
            self.readers[0],
            self.readers[0],
            self.readers[1],
            EntityId::UNKNOWN,
            EntityId::UNKNOWN,
            EntityId::SEDP_PUBLICATIONS_READER,
            EntityId::SEDP_SUBSCRIPTIONS_READER,
            EntityId::LIVELINESS_READER,
            EntityId::reader(77),
        ])
    }

    fn own_writer(&self, choice: &mut impl Choice) -> EntityId {
        choice.of(&[
            self.writer,
            self.writer,
            EntityId::SEDP_PUBLICATIONS_WRITER,
            EntityId::SEDP_SUBSCRIPTIONS_WRITER,
            EntityId::LIVELINESS_WRITER,
        ])
    }

    fn their_writer(&self, choice: &mut impl Choice) -> EntityId {
        match choice.below(8) {
            0 => EntityId::SEDP_PUBLICATIONS_WRITER,
            1 => EntityId::SEDP_SUBSCRIPTIONS_WRITER,
            2 => EntityId::LIVELINESS_WRITER,
            key => EntityId::writer(key as u32 % 2),
        }
    }

    fn part(
        &mut self,
        choice: &mut impl Choice,
        number: usize,
        m: &mut MessageWriter<'_>,
    ) -> Option<()> {
        let from = stranger(number);
        let reader = self.own_reader(choice);
        let kind = choice.below(16);
        let writer = match kind {
            0 => EntityId::SPDP_WRITER,
            1 | 2 => choice.of(&SEDP_WRITERS),
            3 if choice.one_in(20) => EntityId::SPDP_WRITER,
            3 => choice.of(&SEDP_WRITERS),
            4..8 => EntityId::writer(choice.below(2) as u32),
            _ => self.their_writer(choice),
        };
        let writes = kind < 8;
        let (sn, count) = (self.sn(choice, number, writer, writes), self.count);
        let final_flag = choice.one_in(2);
        match kind {
            0 => announce_participant(choice, from, m, sn),
            1 | 2 => announce_endpoint(choice, from, m, (writer, sn)),
            3 => gone(choice, from, m, (writer, sn)),
            4..7 => sample(choice, from, m, (reader, writer, sn)),
            7 if choice.one_in(2) => reference(choice, from, m, (reader, writer, sn)),
            7 => fragment(choice, m, (reader, writer, sn)),
            8 | 9 => {
                let back = choice.of(&[0, 0, 0, 1, 2, 12]);
                let first = (sn - back).max(1);
                m.heartbeat(&Heartbeat {
                    reader,
                    writer,
                    first,
                    last: sn.max(first - 1),
                    count,
                    final_flag,
                    liveliness: choice.one_in(8),
                })
                .ok()
            }
            10 => {
                let mut list = SequenceSet::empty(sn.saturating_add(choice.number(4)));
                fill(choice, |at| {
                    list.insert(list.base.saturating_add(at.into()))
                });
                m.gap(&Gap {
                    reader,
                    writer,
                    start: sn,
                    list,
                })
                .ok()
            }
            11 | 12 => {
                let mut state = SequenceSet::empty(choice.number(20));
                fill(choice, |at| state.insert(state.base + i64::from(at)));
                m.acknack(&AckNack {
                    reader: EntityId::reader(choice.below(3) as u32),
                    writer: self.own_writer(choice),
                    state,
                    count,
                    final_flag,
                })
                .ok()
            }
            13 => {
                let mut state = FragmentSet::empty(choice.below(9) as u32 + 1);
                fill(choice, |at| state.insert(state.base + at));
                m.nack_frag(&NackFrag {
                    reader: EntityId::reader(choice.below(3) as u32),
                    writer: self.own_writer(choice),
                    sn: choice.number(20),
                    state,
                    count,
                })
                .ok()
            }
            14 => {
                let last = choice.below(9) as u32 + 1;
                m.heartbeat_frag(&HeartbeatFrag {
                    reader,
                    writer,
                    sn,
                    last,
                    count,
                })
                .ok()
            }
            _ => {
                let source = stranger(choice.below(STRANGERS + 4));
                match choice.below(4) {
                    3 => {
                        let ours = self.own_writer(choice);
                        let reader = EntityId::reader(choice.below(3) as u32);
                        m.shared(reader, ours, final_flag).ok()
                    }
                    0 => m.info_source(source).ok(),
                    1 => m.info_timestamp(None).ok(),
                    _ => m.info_timestamp(Some(Timestamp(sn.unsigned_abs()))).ok(),
                }
            }
        }
    }
}

/// Says goodbye for a stranger.
pub(crate) fn goodbye(from: GuidPrefix, buf: &mut [u8]) -> usize {
    let mut m = MessageWriter::new(buf, from).unwrap();
    let (mut qos, mut key) = ([0; 40], [0; 40]);
    let guid = Guid::new(from, EntityId::PARTICIPANT);
    let (qos, key) = disposal(guid, &mut qos, &mut key).unwrap();
    let data = Data {
        reader: EntityId::UNKNOWN,
        writer: EntityId::SPDP_WRITER,
        sn: 1,
        inline_qos: None,
        payload: Payload::Key(key),
    };
    m.data(&data, qos).unwrap();
    m.len()
}

/// Some members of a set, often none.
fn fill(choice: &mut impl Choice, mut insert: impl FnMut(u32) -> bool) {
    for _ in 0..choice.below(6) {
        let most = choice.of(&[8, 8, 256, 300]);
        insert(choice.below(most) as u32);
    }
}

fn put(
    m: &mut MessageWriter<'_>,
    (reader, writer, sn): (EntityId, EntityId, SequenceNumber),
    payload: Payload<'_>,
    qos: &[u8],
) -> Option<()> {
    let data = Data {
        reader,
        writer,
        sn,
        inline_qos: None,
        payload,
    };
    m.data(&data, qos).ok()
}

fn announce_participant(
    choice: &mut impl Choice,
    from: GuidPrefix,
    m: &mut MessageWriter<'_>,
    sn: SequenceNumber,
) -> Option<()> {
    let prefix = if choice.one_in(16) {
        stranger(choice.below(20))
    } else {
        from
    };
    let mut data = ParticipantData::new(prefix);
    data.vendor = choice.of(&VENDORS);
    data.domain = choice.of(&[None, Some(0), Some(0), Some(1)]);
    data.lease = choice.of(&[SECOND / 10, SECOND, 10 * SECOND, INFINITE]);
    let one = 1 << choice.below(12);
    data.builtin = choice.of(&[0x3f, 0xc3f, 0xffff_ffff, 0, one]);
    data.name = choice.of(&["", "/", "a participant with a name"]);
    data.expects_inline_qos = choice.one_in(8);
    for _ in 0..choice.below(4) {
        let address = (
            [127, 0, 0, 1 + choice.below(3) as u8],
            choice.below(3) as u16,
        );
        data.metatraffic_unicast.add(address.into());
        data.default_unicast.add(([10, 0, 0, 7], 7411).into());
    }
    let mut buf = [0; 600];
    let mut w = Writer::new(&mut buf);
    data.encode(&mut w);
    let payload = w.finish().ok()?;
    let to = (EntityId::UNKNOWN, EntityId::SPDP_WRITER, sn);
    put(m, to, Payload::Data(payload), &[])
}

fn qos(choice: &mut impl Choice) -> Qos {
    match choice.below(4) {
        0 | 1 => return Qos::ros(),
        2 => return Qos::latched(1),
        _ => {}
    }
    let promise =
        |choice: &mut dyn FnMut(usize) -> usize| [SECOND / 10, SECOND, INFINITE][choice(3)];
    let mut below = |end| choice.below(end);
    Qos {
        deadline: promise(&mut below),
        lifespan: promise(&mut below),
        liveliness_lease: promise(&mut below),
        depth: choice.of(&[0, 1, u32::MAX]),
        reliability: choice.of(&[Reliability::BestEffort, Reliability::Reliable]),
        durability: choice.of(&[Durability::Volatile, Durability::TransientLocal]),
        liveliness: choice.of(&[LivelinessKind::Automatic, LivelinessKind::ManualByTopic]),
        exclusive: choice.one_in(8),
        by_source_time: choice.one_in(8),
        ..Qos::ros()
    }
}

fn announce_endpoint(
    choice: &mut impl Choice,
    from: GuidPrefix,
    m: &mut MessageWriter<'_>,
    (writer, sn): (EntityId, SequenceNumber),
) -> Option<()> {
    let key = choice.below(2) as u32;
    let (entity, reader) = if (writer == SEDP_WRITERS[0]) != choice.one_in(16) {
        (EntityId::writer(key), EntityId::SEDP_PUBLICATIONS_READER)
    } else {
        (EntityId::reader(key), EntityId::SEDP_SUBSCRIPTIONS_READER)
    };
    let topics = [TOPIC, TOPIC, TOPIC, GRAPH_TOPIC, GRAPH_TOPIC, "rt/other"];
    let types = [TYPE, TYPE, TYPE, GRAPH_TYPE, GRAPH_TYPE, "a::b"];
    let at = choice.below(topics.len());
    let ty = types[if choice.one_in(16) {
        choice.below(types.len())
    } else {
        at
    }];
    let hash = TypeHash([choice.byte(); 32]).user_data();
    let mut data = EndpointData::new(Guid::new(from, entity), topics[at], ty, qos(choice));
    data.user_data = choice.of(&[&[], &hash, &hash[..20]]);
    data.max_size = choice.of(&[None, Some(8), Some(u32::MAX)]);
    data.segment = choice.of(&[None, Some(SegmentName([1; 16])), Some(SegmentName([2; 16]))]);
    if choice.one_in(4) {
        data.unicast
            .add(([127, 0, 0, 1], 9000 + choice.below(2) as u16).into());
    }
    let mut buf = [0; 700];
    let mut w = Writer::new(&mut buf);
    data.encode(&mut w);
    put(
        m,
        (reader, writer, sn),
        Payload::Data(w.finish().ok()?),
        &[],
    )
}

/// Says that an endpoint or a participant is gone, sometimes another's.
fn gone(
    choice: &mut impl Choice,
    from: GuidPrefix,
    m: &mut MessageWriter<'_>,
    (writer, sn): (EntityId, SequenceNumber),
) -> Option<()> {
    let prefix = if choice.one_in(8) {
        stranger(choice.below(16))
    } else {
        from
    };
    let key = choice.below(2) as u32;
    let entity = match writer {
        EntityId::SPDP_WRITER => EntityId::PARTICIPANT,
        EntityId::SEDP_PUBLICATIONS_WRITER => EntityId::writer(key),
        _ => EntityId::reader(key),
    };
    let (mut inline, mut name) = ([0; 40], [0; 40]);
    let (inline, name) = disposal(Guid::new(prefix, entity), &mut inline, &mut name).ok()?;
    let payload = choice.of(&[Payload::Key(name), Payload::Data(name), Payload::None]);
    put(m, (EntityId::UNKNOWN, writer, sn), payload, inline)
}

/// Inline quality of service, often none.
fn inline<'b>(choice: &mut impl Choice, from: GuidPrefix, buf: &'b mut [u8; 64]) -> &'b [u8] {
    let guid = Guid::new(from, EntityId::reader(1));
    let sn = choice.of(&[SampleIdentity::OWN, 1, i64::MAX]);
    match choice.below(6) {
        0 => put_related_request(&SampleIdentity { guid, sn }, buf),
        1 => put_chain_origins(&[ChainOrigin { chain: 7, time: 8 }; 2], buf),
        _ => Ok(&[][..]),
    }
    .unwrap_or(&[])
}

fn sample(
    choice: &mut impl Choice,
    from: GuidPrefix,
    m: &mut MessageWriter<'_>,
    name: (EntityId, EntityId, SequenceNumber),
) -> Option<()> {
    let (mut qos, mut buf) = ([0; 64], [0; 400]);
    let qos = inline(choice, from, &mut qos);
    let payload = if choice.one_in(4) {
        let list = [
            EntityId::writer(1),
            EntityId::reader(2),
            EntityId::reader(3),
        ];
        let names = [
            "listener",
            "talker",
            "",
            "no name!",
            "a_node_with_quite_a_long_name",
        ];
        let node = |choice: &mut dyn FnMut(usize) -> usize| Node {
            namespace: ["/", "/ns", "/a/b/c", "ns"][choice(4)],
            name: names[choice(5)],
            readers: &list[..choice(4)],
            writers: &list[choice(4)..],
        };
        let mut below = |end| choice.below(end);
        let nodes = [node(&mut below), node(&mut below), node(&mut below)];
        let size = choice.of(&[GidSize::Bytes16, GidSize::Bytes24]);
        encode_graph(&mut buf, from, &nodes[..choice.below(4)], size).ok()?
    } else {
        buf[..4].copy_from_slice(&CDR_LE);
        buf[4..].fill(choice.byte());
        &buf[..choice.of(&[0, 3, 4, 8, 8, 64, 399])]
    };
    let payload = choice.of(&[
        Payload::Data(payload),
        Payload::Data(payload),
        Payload::Key(payload),
    ]);
    put(m, name, payload, qos)
}

fn fragment(
    choice: &mut impl Choice,
    m: &mut MessageWriter<'_>,
    (reader, writer, sn): (EntityId, EntityId, SequenceNumber),
) -> Option<()> {
    let whole = choice.one_in(8);
    let fragment_size = choice.of(&[100, 100, 100, 1, 65_535]);
    let bytes = [7; 250];
    let body = DataFrag {
        reader,
        writer,
        sn,
        start: if whole { 1 } else { choice.below(4) as u32 + 1 },
        count: if whole { 3 } else { 1 },
        fragment_size,
        sample_size: choice.of(&[250, 250, 250, 251, 4000, u32::MAX]),
        key: choice.one_in(16),
        inline_qos: None,
        payload: &bytes[..if whole {
            250
        } else {
            choice.of(&[100, 100, 50, 0])
        }],
    };
    m.data_frag(&body, &[]).ok()
}

fn reference(
    choice: &mut impl Choice,
    from: GuidPrefix,
    m: &mut MessageWriter<'_>,
    (reader, writer, sn): (EntityId, EntityId, SequenceNumber),
) -> Option<()> {
    let mut qos = [0; 64];
    let qos = inline(choice, from, &mut qos);
    let body = Reference {
        reader,
        writer,
        sn,
        sample_size: choice.of(&[1, 250, 250, 4000, u32::MAX]),
        place: SharedPlace {
            slot: choice.byte().into(),
            stamp: sn.unsigned_abs(),
        },
        fragment_size: choice.of(&[100, 100, 1, 65_535]),
        inline_qos: None,
    };
    m.reference(&body, qos).ok()
}

/// Damages an eighth of the datagrams: some bytes, the end, more bytes; or noise altogether.
fn damage(choice: &mut impl Choice, buf: &mut [u8], len: usize) -> usize {
    match choice.below(64) {
        0..5 => {
            for _ in 0..=choice.below(3) {
                let at = choice.below(len);
                buf[at] = match choice.below(3) {
                    0 => choice.byte(),
                    1 => buf[at] ^ (1 << choice.below(8)),
                    _ => choice.of(&[0, 1, 0x7f, 0x80, 0xff]),
                };
            }
            len
        }
        5 | 6 => choice.below(len + 1),
        7 => {
            let end = buf.len().min(len + 40);
            for byte in &mut buf[len..end] {
                *byte = choice.byte();
            }
            end
        }
        _ => len,
    }
}
