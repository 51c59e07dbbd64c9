//! CREATE and DELETE: a client's objects come and go.

use super::{
    BaseRequest, DataReaderBinary, DataWriterBinary, GroupBinary, ObjectId, ObjectKind,
    ParticipantBinary, Reader, ServiceBinary, TopicBinary, WireError, Writer,
};
use super::{Encode, SubmessageId};

/// The treatment of an object that exists already.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct CreationMode {
    /// Keep it if it is the same.
    pub reuse: bool,
    /// Replace it.
    pub replace: bool,
}

impl CreationMode {
    /// Keep it if it is the same, replace it otherwise: what micro-ROS asks for.
    pub const REUSE_OR_REPLACE: CreationMode = CreationMode {
        reuse: true,
        replace: true,
    };
    /// Replace it: what eProsima's examples ask for.
    pub const REPLACE: CreationMode = CreationMode {
        reuse: false,
        replace: true,
    };

    const FLAG_REUSE: u8 = 0x02;
    const FLAG_REPLACE: u8 = 0x04;

    /// The value as flags of CREATE.
    #[must_use]
    pub const fn flags(self) -> u8 {
        let reuse = if self.reuse { Self::FLAG_REUSE } else { 0 };
        let replace = if self.replace { Self::FLAG_REPLACE } else { 0 };
        reuse | replace
    }
}

/// Description of an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Representation<'a, B> {
    /// A name in the agent's configuration.
    Reference(&'a str),
    /// XML text.
    Xml(&'a str),
    /// A binary form.
    Binary(B),
}

impl<'a, B> Representation<'a, B> {
    const REFERENCE: u8 = 1;
    const XML: u8 = 2;
    /// The discriminator of a binary form.
    pub const BINARY: u8 = 3;

    fn write(&self, w: &mut Writer<'_>, binary: impl FnOnce(&B, &mut Writer<'_>)) {
        match self {
            Representation::Reference(name) => {
                w.u8(Self::REFERENCE);
                w.string(name);
            }
            Representation::Xml(xml) => {
                w.u8(Self::XML);
                w.string(xml);
            }
            Representation::Binary(value) => {
                w.u8(Self::BINARY);
                w.nested(|w| binary(value, w));
            }
        }
    }

    fn decode(
        r: &mut Reader<'a>,
        binary: impl FnOnce(&mut Reader<'a>) -> Result<B, WireError>,
    ) -> Result<Self, WireError> {
        match r.u8()? {
            Self::REFERENCE => r.string().map(Representation::Reference),
            Self::XML => r.string().map(Representation::Xml),
            Self::BINARY => {
                let bytes = r.bytes()?;
                binary(&mut Reader::new(bytes, r.little_endian())).map(Representation::Binary)
            }
            other => Err(WireError::UnknownRepresentation(other)),
        }
    }
}

/// An object to create, with its owner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "description, then the owner")]
pub enum Entity<'a> {
    Participant {
        repr: Representation<'a, ParticipantBinary<'a>>,
        domain: i16,
    },
    Topic {
        repr: Representation<'a, TopicBinary<'a>>,
        participant: ObjectId,
    },
    Publisher {
        repr: Representation<'a, GroupBinary<'a>>,
        participant: ObjectId,
    },
    Subscriber {
        repr: Representation<'a, GroupBinary<'a>>,
        participant: ObjectId,
    },
    DataWriter {
        repr: Representation<'a, DataWriterBinary<'a>>,
        publisher: ObjectId,
    },
    DataReader {
        repr: Representation<'a, DataReaderBinary<'a>>,
        subscriber: ObjectId,
    },
    Requester {
        repr: Representation<'a, ServiceBinary<'a>>,
        participant: ObjectId,
    },
    Replier {
        repr: Representation<'a, ServiceBinary<'a>>,
        participant: ObjectId,
    },
}

impl<'a> Entity<'a> {
    /// Its kind.
    #[must_use]
    pub const fn kind(&self) -> ObjectKind {
        match self {
            Entity::Participant { .. } => ObjectKind::Participant,
            Entity::Topic { .. } => ObjectKind::Topic,
            Entity::Publisher { .. } => ObjectKind::Publisher,
            Entity::Subscriber { .. } => ObjectKind::Subscriber,
            Entity::DataWriter { .. } => ObjectKind::DataWriter,
            Entity::DataReader { .. } => ObjectKind::DataReader,
            Entity::Requester { .. } => ObjectKind::Requester,
            Entity::Replier { .. } => ObjectKind::Replier,
        }
    }

    fn write(&self, w: &mut Writer<'_>) {
        w.u8(self.kind().number());
        let owner = match self {
            Entity::Participant { repr, domain } => {
                repr.write(w, ParticipantBinary::write);
                return w.i16(*domain);
            }
            Entity::Topic { repr, participant } => {
                repr.write(w, TopicBinary::write);
                participant
            }
            Entity::Publisher { repr, participant } | Entity::Subscriber { repr, participant } => {
                repr.write(w, GroupBinary::write);
                participant
            }
            Entity::DataWriter { repr, publisher } => {
                repr.write(w, DataWriterBinary::write);
                publisher
            }
            Entity::DataReader { repr, subscriber } => {
                repr.write(w, DataReaderBinary::write);
                subscriber
            }
            Entity::Requester { repr, participant } | Entity::Replier { repr, participant } => {
                repr.write(w, ServiceBinary::write);
                participant
            }
        };
        w.put(&owner.to_bytes());
    }

    fn decode(r: &mut Reader<'a>) -> Result<Self, WireError> {
        let kind = ObjectKind::from_number(r.u8()?)?;
        let owner = |r: &mut Reader<'a>| r.array().map(ObjectId::from_bytes);
        Ok(match kind {
            ObjectKind::Participant => Entity::Participant {
                repr: Representation::decode(r, ParticipantBinary::decode)?,
                domain: r.i16()?,
            },
            ObjectKind::Topic => Entity::Topic {
                repr: Representation::decode(r, TopicBinary::decode)?,
                participant: owner(r)?,
            },
            ObjectKind::Publisher => Entity::Publisher {
                repr: Representation::decode(r, GroupBinary::decode)?,
                participant: owner(r)?,
            },
            ObjectKind::Subscriber => Entity::Subscriber {
                repr: Representation::decode(r, GroupBinary::decode)?,
                participant: owner(r)?,
            },
            ObjectKind::DataWriter => Entity::DataWriter {
                repr: Representation::decode(r, DataWriterBinary::decode)?,
                publisher: owner(r)?,
            },
            ObjectKind::DataReader => Entity::DataReader {
                repr: Representation::decode(r, DataReaderBinary::decode)?,
                subscriber: owner(r)?,
            },
            ObjectKind::Requester => Entity::Requester {
                repr: Representation::decode(r, ServiceBinary::decode)?,
                participant: owner(r)?,
            },
            ObjectKind::Replier => Entity::Replier {
                repr: Representation::decode(r, ServiceBinary::decode)?,
                participant: owner(r)?,
            },
            other => return Err(WireError::UnknownKind(other.number())),
        })
    }
}

/// CREATE: creates an object; answered by STATUS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Create<'a> {
    /// The object's id.
    pub base: BaseRequest,
    /// The treatment of an object that exists already.
    pub mode: CreationMode,
    /// The object.
    pub entity: Entity<'a>,
}

impl Encode for Create<'_> {
    fn id(&self) -> SubmessageId {
        SubmessageId::Create
    }

    fn flags(&self) -> u8 {
        self.mode.flags()
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
        self.entity.write(w);
    }
}

impl<'a> Create<'a> {
    pub(super) fn decode(r: &mut Reader<'a>, flags: u8) -> Result<Self, WireError> {
        Ok(Create {
            base: BaseRequest::decode(r)?,
            mode: CreationMode {
                reuse: flags & CreationMode::FLAG_REUSE != 0,
                replace: flags & CreationMode::FLAG_REPLACE != 0,
            },
            entity: Entity::decode(r)?,
        })
    }
}

/// DELETE: deletes an object; of [`ObjectId::CLIENT`], the session. Answered by STATUS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delete {
    /// The object.
    pub base: BaseRequest,
}

impl Encode for Delete {
    fn id(&self) -> SubmessageId {
        SubmessageId::Delete
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.base.write(w);
    }
}

impl Delete {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        BaseRequest::decode(r).map(|base| Delete { base })
    }
}
