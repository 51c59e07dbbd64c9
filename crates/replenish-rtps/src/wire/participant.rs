//! [`ParticipantData`]: an SPDP announcement (RTPS 2.5, 8.5.3.2 and 9.6.2).

use super::message::{VENDOR, VERSION};
use super::parameters::{ParameterWriter, pid};
use super::time::{duration, put_duration};
use super::{
    Encapsulated, EntityId, Guid, GuidPrefix, Locator, Locators, Nanos, PL_CDR_LE, Reader,
    WireError, Writer,
};

/// Bits of `PID_BUILTIN_ENDPOINT_SET`: the endpoints that a participant has.
pub mod builtin {
    /// Writer and reader of participants, publications and subscriptions.
    pub const DISCOVERY: u32 = 0x3f;
    /// The writer of publications.
    pub const PUBLICATIONS_WRITER: u32 = 1 << 2;
    /// The reader of publications.
    pub const PUBLICATIONS_READER: u32 = 1 << 3;
    /// The writer of subscriptions.
    pub const SUBSCRIPTIONS_WRITER: u32 = 1 << 4;
    /// The reader of subscriptions.
    pub const SUBSCRIPTIONS_READER: u32 = 1 << 5;
    /// The writer of assertions of liveliness.
    pub const LIVELINESS_WRITER: u32 = 1 << 10;
    /// The reader of assertions of liveliness.
    pub const LIVELINESS_READER: u32 = 1 << 11;
}

/// A participant as it announces itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParticipantData<'a> {
    /// Its name.
    pub prefix: GuidPrefix,
    /// Its protocol version.
    pub version: [u8; 2],
    /// Its vendor.
    pub vendor: [u8; 2],
    /// Its domain; old implementations do not say it.
    pub domain: Option<u32>,
    /// Addresses at which its built-in endpoints are reached.
    pub metatraffic_unicast: Locators,
    /// Multicast groups of its built-in endpoints.
    pub metatraffic_multicast: Locators,
    /// Addresses at which its other endpoints are reached, unless they announce their own.
    pub default_unicast: Locators,
    /// Multicast groups of its other endpoints.
    pub default_multicast: Locators,
    /// Time in ns that it counts as alive after an announcement.
    pub lease: Nanos,
    /// Its built-in endpoints, see [`builtin`].
    pub builtin: u32,
    /// Whether its readers want quality of service with every sample.
    pub expects_inline_qos: bool,
    /// Its name in words.
    pub name: &'a str,
    /// ROS 2 writes `enclave=/;`.
    pub user_data: &'a [u8],
}

impl<'a> ParticipantData<'a> {
    /// A participant of this crate's version and vendor that says nothing else.
    #[must_use]
    pub const fn new(prefix: GuidPrefix) -> Self {
        ParticipantData {
            prefix,
            version: VERSION,
            vendor: VENDOR,
            domain: None,
            metatraffic_unicast: Locators::NONE,
            metatraffic_multicast: Locators::NONE,
            default_unicast: Locators::NONE,
            default_multicast: Locators::NONE,
            // The default of PID_PARTICIPANT_LEASE_DURATION.
            lease: 100_000_000_000,
            builtin: builtin::DISCOVERY,
            expects_inline_qos: false,
            name: "",
            user_data: &[],
        }
    }

    /// Reads the payload of an SPDP DATA.
    ///
    /// # Errors
    /// Any [`WireError`]; [`WireError::Missing`] without a GUID.
    pub fn decode(payload: &'a [u8]) -> Result<Self, WireError> {
        let mut found = None;
        let mut data = Self::new(GuidPrefix::default());
        data.builtin = 0;
        for parameter in Encapsulated::decode(payload)?.parameters()? {
            let parameter = parameter?;
            let mut r = parameter.value;
            let r = &mut r;
            match parameter.id {
                pid::PARTICIPANT_GUID => found = Some(Guid::decode(r)?.prefix),
                pid::PROTOCOL_VERSION => data.version = r.array()?,
                pid::VENDOR_ID => data.vendor = r.array()?,
                pid::DOMAIN_ID => data.domain = Some(r.u32()?),
                pid::METATRAFFIC_UNICAST_LOCATOR => add(&mut data.metatraffic_unicast, r)?,
                pid::METATRAFFIC_MULTICAST_LOCATOR => add(&mut data.metatraffic_multicast, r)?,
                pid::DEFAULT_UNICAST_LOCATOR => add(&mut data.default_unicast, r)?,
                pid::DEFAULT_MULTICAST_LOCATOR => add(&mut data.default_multicast, r)?,
                pid::PARTICIPANT_LEASE_DURATION => data.lease = duration(r)?,
                pid::BUILTIN_ENDPOINT_SET => data.builtin = r.u32()?,
                pid::EXPECTS_INLINE_QOS => data.expects_inline_qos = r.u8()? != 0,
                pid::ENTITY_NAME => data.name = r.string()?,
                pid::USER_DATA => data.user_data = r.bytes()?,
                _ => {}
            }
        }
        data.prefix = found.ok_or(WireError::Missing("PID_PARTICIPANT_GUID"))?;
        Ok(data)
    }

    /// Writes the payload of an SPDP DATA.
    pub fn encode(&self, w: &mut Writer<'_>) {
        w.put(&PL_CDR_LE);
        w.set_origin();
        let mut list = ParameterWriter::new(w);
        list.add(pid::PROTOCOL_VERSION, |w| w.put(&self.version));
        list.add(pid::VENDOR_ID, |w| w.put(&self.vendor));
        if let Some(domain) = self.domain {
            list.add(pid::DOMAIN_ID, |w| w.u32(domain));
        }
        let guid = Guid::new(self.prefix, EntityId::PARTICIPANT);
        list.add(pid::PARTICIPANT_GUID, |w| guid.encode(w));
        let locators = [
            (pid::METATRAFFIC_UNICAST_LOCATOR, self.metatraffic_unicast),
            (
                pid::METATRAFFIC_MULTICAST_LOCATOR,
                self.metatraffic_multicast,
            ),
            (pid::DEFAULT_UNICAST_LOCATOR, self.default_unicast),
            (pid::DEFAULT_MULTICAST_LOCATOR, self.default_multicast),
        ];
        for (id, locators) in &locators {
            put_locators(&mut list, *id, locators);
        }
        list.add(pid::PARTICIPANT_LEASE_DURATION, |w| {
            put_duration(w, self.lease);
        });
        list.add(pid::BUILTIN_ENDPOINT_SET, |w| w.u32(self.builtin));
        if self.expects_inline_qos {
            list.add(pid::EXPECTS_INLINE_QOS, |w| w.u8(1));
        }
        if !self.name.is_empty() {
            list.add(pid::ENTITY_NAME, |w| w.string(self.name));
        }
        if !self.user_data.is_empty() {
            list.add(pid::USER_DATA, |w| w.bytes(self.user_data));
        }
        list.end();
    }
}

/// Adds the UDP address that `r` holds; those beyond the list's room are left out.
pub(super) fn add(locators: &mut Locators, r: &mut Reader<'_>) -> Result<(), WireError> {
    if let Some(addr) = Locator::decode(r)?.socket_addr() {
        locators.add(addr);
    }
    Ok(())
}

pub(super) fn put_locators(list: &mut ParameterWriter<'_, '_>, id: u16, locators: &Locators) {
    for addr in locators.iter() {
        list.add(id, |w| Locator::from(addr).encode(w));
    }
}
