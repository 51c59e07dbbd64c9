//! Parameter lists: pairs of an id and bytes up to a sentinel (RTPS 2.5, 9.4.2.11).

use super::{Reader, WireError, Writer};

/// Ids of parameters (RTPS 2.5, table 9.13 and 9.14).
pub mod pid {
    #![allow(missing_docs, reason = "the names are the specification's")]
    pub const PAD: u16 = 0x0000;
    pub const SENTINEL: u16 = 0x0001;
    pub const PARTICIPANT_LEASE_DURATION: u16 = 0x0002;
    pub const TOPIC_NAME: u16 = 0x0005;
    pub const TYPE_NAME: u16 = 0x0007;
    pub const DOMAIN_ID: u16 = 0x000f;
    pub const PROTOCOL_VERSION: u16 = 0x0015;
    pub const VENDOR_ID: u16 = 0x0016;
    pub const RELIABILITY: u16 = 0x001a;
    pub const LIVELINESS: u16 = 0x001b;
    pub const DURABILITY: u16 = 0x001d;
    pub const OWNERSHIP: u16 = 0x001f;
    pub const PRESENTATION: u16 = 0x0021;
    pub const DEADLINE: u16 = 0x0023;
    pub const DESTINATION_ORDER: u16 = 0x0025;
    pub const LATENCY_BUDGET: u16 = 0x0027;
    pub const PARTITION: u16 = 0x0029;
    pub const LIFESPAN: u16 = 0x002b;
    pub const USER_DATA: u16 = 0x002c;
    pub const UNICAST_LOCATOR: u16 = 0x002f;
    pub const MULTICAST_LOCATOR: u16 = 0x0030;
    pub const DEFAULT_UNICAST_LOCATOR: u16 = 0x0031;
    pub const METATRAFFIC_UNICAST_LOCATOR: u16 = 0x0032;
    pub const METATRAFFIC_MULTICAST_LOCATOR: u16 = 0x0033;
    pub const HISTORY: u16 = 0x0040;
    pub const EXPECTS_INLINE_QOS: u16 = 0x0043;
    pub const DEFAULT_MULTICAST_LOCATOR: u16 = 0x0048;
    pub const PARTICIPANT_GUID: u16 = 0x0050;
    pub const BUILTIN_ENDPOINT_SET: u16 = 0x0058;
    pub const ENDPOINT_GUID: u16 = 0x005a;
    pub const TYPE_MAX_SIZE: u16 = 0x0060;
    pub const ENTITY_NAME: u16 = 0x0062;
    pub const KEY_HASH: u16 = 0x0070;
    pub const STATUS_INFO: u16 = 0x0071;
    pub const DATA_REPRESENTATION: u16 = 0x0073;
    pub const RELATED_SAMPLE_IDENTITY: u16 = 0x0083;
    /// Fast DDS's own id for the same.
    pub const FAST_RELATED_SAMPLE_IDENTITY: u16 = 0x800f;
    /// Ours: the chains that led to a sample.
    pub const CHAIN_ORIGINS: u16 = 0x8e52;
    /// Ours: the name of the memory that a writer shares with programs on its host.
    pub const SHARED_SEGMENT: u16 = 0x8e53;
}

/// One parameter.
#[derive(Clone, Copy, Debug)]
pub struct Parameter<'a> {
    /// Its id, see [`pid`].
    pub id: u16,
    /// Its value, padded to a multiple of four bytes.
    pub value: Reader<'a>,
}

/// A list of parameters that was received.
#[derive(Clone, Copy, Debug)]
pub struct Parameters<'a> {
    rest: Reader<'a>,
    ended: bool,
}

impl<'a> Parameters<'a> {
    /// The list that begins where `reader` stands.
    #[must_use]
    pub const fn new(reader: Reader<'a>) -> Self {
        Parameters {
            rest: reader,
            ended: false,
        }
    }

    /// Bytes after the sentinel, once every parameter was taken.
    pub(super) fn after(mut self) -> Result<Reader<'a>, WireError> {
        for parameter in self.by_ref() {
            parameter?;
        }
        Ok(self.rest)
    }

    /// The first parameter with this id.
    #[must_use]
    pub fn find(self, id: u16) -> Option<Reader<'a>> {
        let mut list = self.filter_map(Result::ok);
        list.find(|parameter| parameter.id == id)
            .map(|found| found.value)
    }

    fn step(&mut self) -> Result<Option<Parameter<'a>>, WireError> {
        loop {
            let (id, len) = (self.rest.u16()?, usize::from(self.rest.u16()?));
            if id == pid::SENTINEL {
                return Ok(None);
            }
            let little = self.rest.little_endian();
            let value = Reader::new(self.rest.take(len)?, little);
            if id != pid::PAD {
                return Ok(Some(Parameter { id, value }));
            }
        }
    }
}

impl<'a> Iterator for Parameters<'a> {
    type Item = Result<Parameter<'a>, WireError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let step = self.step().transpose();
        self.ended = !matches!(step, Some(Ok(_)));
        step
    }
}

/// Writes a list of parameters.
#[derive(Debug)]
pub struct ParameterWriter<'w, 'a>(&'w mut Writer<'a>);

impl<'w, 'a> ParameterWriter<'w, 'a> {
    /// Begins a list. The writer stands at a multiple of four.
    pub const fn new(writer: &'w mut Writer<'a>) -> Self {
        ParameterWriter(writer)
    }

    /// Adds a parameter whose value `write` writes.
    pub fn add(&mut self, id: u16, write: impl FnOnce(&mut Writer<'a>)) {
        let w = &mut *self.0;
        w.align(4);
        w.u16(id);
        w.u16(0);
        let start = w.len();
        write(w);
        w.align(4);
        let len = w.len().saturating_sub(start);
        w.patch_u16(start.saturating_sub(2), len);
    }

    /// Ends the list.
    pub fn end(self) {
        self.0.u16(pid::SENTINEL);
        self.0.u16(0);
    }
}
