//! [`EndpointData`]: an SEDP announcement of a writer or a reader (RTPS 2.5, 8.5.4 and 9.6.2).

use super::message::{VENDOR, VERSION};
use super::parameters::{ParameterWriter, pid};
use super::participant::{add, put_locators};
use super::{
    Encapsulated, EntityId, Guid, Locators, PL_CDR_LE, Parameters, Qos, Reader, SegmentName,
    WireError, Writer,
};

/// The hash of a ROS 2 type (REP-2016): 32 bytes, in text `RIHS01_` and 64 digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TypeHash(pub [u8; 32]);

const HASH_KEY: &[u8] = b"typehash=RIHS01_";

impl TypeHash {
    /// Finds the hash in the user data of an endpoint; other keys are skipped.
    #[must_use]
    pub fn find(user_data: &[u8]) -> Option<Self> {
        let mut parts = user_data.split(|byte| *byte == b';');
        let digits = parts.find_map(|part| part.strip_prefix(HASH_KEY))?;
        if digits.len() != 64 {
            return None;
        }
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(digits.chunks_exact(2)) {
            let pair = core::str::from_utf8(pair).ok()?;
            *byte = u8::from_str_radix(pair, 16).ok()?;
        }
        Some(TypeHash(hash))
    }

    /// The user data that announces the hash, as ROS 2 writes it: 81 bytes.
    #[must_use]
    pub fn user_data(&self) -> [u8; 81] {
        let digit = |value: u8| match value {
            0..=9 => b'0'.wrapping_add(value),
            _ => b'a'.wrapping_add(value.wrapping_sub(10)),
        };
        let pairs = self.0.iter().flat_map(|byte| [byte >> 4, byte & 15]);
        let bytes = HASH_KEY
            .iter()
            .copied()
            .chain(pairs.map(digit))
            .chain([b';']);
        let mut text = [0; 81];
        for (to, from) in text.iter_mut().zip(bytes) {
            *to = from;
        }
        text
    }
}

/// Names of partitions as they were received: a CDR sequence of strings.
#[derive(Clone, Copy, Debug)]
pub struct Partitions<'a> {
    left: u32,
    rest: Reader<'a>,
}

impl Partitions<'_> {
    /// The default partition alone.
    pub const DEFAULT: Partitions<'static> = Partitions {
        left: 0,
        rest: Reader::new(&[], true),
    };
}

impl<'a> Iterator for Partitions<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        self.left = self.left.checked_sub(1)?;
        self.rest.string().ok()
    }
}

/// A writer or reader as it is announced.
#[derive(Clone, Copy, Debug)]
pub struct EndpointData<'a> {
    /// The endpoint.
    pub guid: Guid,
    /// Its topic, in ROS 2 `rt/` and the topic's name.
    pub topic: &'a str,
    /// Its type, in ROS 2 `std_msgs::msg::dds_::Int32_`.
    pub type_name: &'a str,
    /// Its quality of service.
    pub qos: Qos,
    /// Addresses at which it is reached; none: the participant's default.
    pub unicast: Locators,
    /// Multicast groups in which it is reached.
    pub multicast: Locators,
    /// Its partitions.
    pub partitions: Partitions<'a>,
    /// In ROS 2 the type hash.
    pub user_data: &'a [u8],
    /// Bytes of its longest sample, if it says.
    pub max_size: Option<u32>,
    /// Whether a reader wants quality of service with every sample.
    pub expects_inline_qos: bool,
    /// The memory that a writer shares with programs on its host.
    pub segment: Option<SegmentName>,
}

impl<'a> EndpointData<'a> {
    /// An endpoint without announced addresses.
    #[must_use]
    pub const fn new(guid: Guid, topic: &'a str, type_name: &'a str, qos: Qos) -> Self {
        EndpointData {
            guid,
            topic,
            type_name,
            qos,
            unicast: Locators::NONE,
            multicast: Locators::NONE,
            partitions: Partitions::DEFAULT,
            user_data: &[],
            max_size: None,
            expects_inline_qos: false,
            segment: None,
        }
    }

    /// Reads the payload of an SEDP DATA.
    ///
    /// # Errors
    /// Any [`WireError`]; [`WireError::Missing`] without a GUID, topic or type.
    pub fn decode(payload: &'a [u8]) -> Result<Self, WireError> {
        let list = Encapsulated::decode(payload)?.parameters()?;
        let guid = endpoint_guid(list)?;
        let qos = Qos::unnamed(guid.entity.is_writer());
        let mut data = Self::new(guid, "", "", qos);
        for parameter in list {
            let parameter = parameter?;
            let mut r = parameter.value;
            let r = &mut r;
            if data.qos.take(parameter.id, r)? {
                continue;
            }
            match parameter.id {
                pid::TOPIC_NAME => data.topic = r.string()?,
                pid::TYPE_NAME => data.type_name = r.string()?,
                pid::UNICAST_LOCATOR => add(&mut data.unicast, r)?,
                pid::MULTICAST_LOCATOR => add(&mut data.multicast, r)?,
                pid::USER_DATA => data.user_data = r.bytes()?,
                pid::TYPE_MAX_SIZE => data.max_size = Some(r.u32()?),
                pid::EXPECTS_INLINE_QOS => data.expects_inline_qos = r.u8()? != 0,
                pid::SHARED_SEGMENT => data.segment = SegmentName::decode(r),
                pid::PARTITION => {
                    data.partitions = Partitions {
                        left: r.u32()?,
                        rest: *r,
                    };
                }
                _ => {}
            }
        }
        if data.topic.is_empty() {
            return Err(WireError::Missing("PID_TOPIC_NAME"));
        }
        if data.type_name.is_empty() {
            return Err(WireError::Missing("PID_TYPE_NAME"));
        }
        Ok(data)
    }

    /// Writes the payload of an SEDP DATA.
    pub fn encode(&self, w: &mut Writer<'_>) {
        let writer = self.guid.entity.is_writer();
        w.put(&PL_CDR_LE);
        w.set_origin();
        let mut list = ParameterWriter::new(w);
        list.add(pid::ENDPOINT_GUID, |w| self.guid.encode(w));
        let participant = Guid::new(self.guid.prefix, EntityId::PARTICIPANT);
        list.add(pid::PARTICIPANT_GUID, |w| participant.encode(w));
        put_locators(&mut list, pid::UNICAST_LOCATOR, &self.unicast);
        put_locators(&mut list, pid::MULTICAST_LOCATOR, &self.multicast);
        list.add(pid::TOPIC_NAME, |w| w.string(self.topic));
        list.add(pid::TYPE_NAME, |w| w.string(self.type_name));
        list.add(pid::KEY_HASH, |w| self.guid.encode(w));
        if let Some(size) = self.max_size {
            list.add(pid::TYPE_MAX_SIZE, |w| w.u32(size));
        }
        list.add(pid::PROTOCOL_VERSION, |w| w.put(&VERSION));
        list.add(pid::VENDOR_ID, |w| w.put(&VENDOR));
        self.qos.encode(&mut list, writer);
        if self.partitions.left != 0 {
            list.add(pid::PARTITION, |w| {
                w.u32(self.partitions.left);
                for name in self.partitions {
                    w.align(4);
                    w.string(name);
                }
            });
        }
        if !self.user_data.is_empty() {
            list.add(pid::USER_DATA, |w| w.bytes(self.user_data));
        }
        if self.expects_inline_qos && !writer {
            list.add(pid::EXPECTS_INLINE_QOS, |w| w.u8(1));
        }
        if let Some(segment) = self.segment {
            list.add(pid::SHARED_SEGMENT, |w| segment.encode(w));
        }
        list.end();
    }
}

fn endpoint_guid(list: Parameters<'_>) -> Result<Guid, WireError> {
    let found = list.find(pid::ENDPOINT_GUID);
    Guid::decode(&mut found.ok_or(WireError::Missing("PID_ENDPOINT_GUID"))?)
}

/// The entity that a disposed sample of discovery names: by its key, or by the hash of its key.
///
/// # Errors
/// [`WireError::Missing`] if neither is there.
pub fn disposed_entity(key: &[u8], inline_qos: Option<Parameters<'_>>) -> Result<Guid, WireError> {
    let list = Encapsulated::decode(key).and_then(|key| key.parameters());
    let by_key = list.ok().and_then(|list| {
        let guid = list.find(pid::ENDPOINT_GUID);
        guid.or_else(|| list.find(pid::PARTICIPANT_GUID))
    });
    let by_hash = || inline_qos.and_then(|list| list.find(pid::KEY_HASH));
    let found = by_key.or_else(by_hash);
    Guid::decode(&mut found.ok_or(WireError::Missing("PID_KEY_HASH"))?)
}

/// Whether inline QoS says that the sample's instance is disposed or unregistered.
#[must_use]
pub fn is_disposal(inline_qos: Option<Parameters<'_>>) -> bool {
    let status = inline_qos.and_then(|list| list.find(pid::STATUS_INFO));
    // Four bytes, the last of which has the flags, whatever the byte order.
    let flags = status.and_then(|mut r| r.array::<4>().ok());
    flags.is_some_and(|[_, _, _, flags]| flags & 3 != 0)
}

/// Writes what follows an SEDP or SPDP header when `guid` is gone: inline QoS and, as the payload,
/// the key. Returns both.
///
/// # Errors
/// [`WireError::NoRoom`]; 32 bytes and 28 are enough.
pub fn disposal<'q, 'k>(
    guid: Guid,
    inline_qos: &'q mut [u8],
    key: &'k mut [u8],
) -> Result<(&'q [u8], &'k [u8]), WireError> {
    let mut w = Writer::new(inline_qos);
    let mut list = ParameterWriter::new(&mut w);
    list.add(pid::KEY_HASH, |w| guid.encode(w));
    list.add(pid::STATUS_INFO, |w| w.put(&[0, 0, 0, 3]));
    list.end();
    let inline_qos = w.finish()?;
    let id = if guid.entity == EntityId::PARTICIPANT {
        pid::PARTICIPANT_GUID
    } else {
        pid::ENDPOINT_GUID
    };
    let mut w = Writer::new(key);
    w.put(&PL_CDR_LE);
    w.set_origin();
    let mut list = ParameterWriter::new(&mut w);
    list.add(id, |w| guid.encode(w));
    list.end();
    Ok((inline_qos, w.finish()?))
}
