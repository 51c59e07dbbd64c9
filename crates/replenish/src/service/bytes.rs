//! Messages as bytes, in buffers that are there before the executor starts: for services whose
//! messages have unbounded fields and which shall not allocate. Views look into the bytes.

use super::responder::Responder;
use super::size::sized;
use crate::executor::Topic;
use crate::middleware::PublishError;
use alloc::boxed::Box;
use core::fmt;
use core::marker::PhantomData;
use replenish_msg::{CdrError, CdrReader, CdrWriter, DecodeError, Message, Service};

/// The bytes of a `T`: [`MAX_SIZE`](Message::MAX_SIZE) of them, which counts the padding, or as
/// many as were asked for.
pub(crate) struct Body<T> {
    bytes: Box<[u8]>,
    len: usize,
    message: PhantomData<fn() -> T>,
}

impl<T: Message> Default for Body<T> {
    fn default() -> Self {
        Self {
            bytes: Box::default(),
            len: 0,
            message: PhantomData,
        }
    }
}

impl<T> Body<T> {
    /// An empty buffer with room for `bytes` bytes.
    fn with_room(bytes: usize) -> Self {
        Self {
            bytes: alloc::vec![0; bytes].into(),
            len: 0,
            message: PhantomData,
        }
    }

    pub(crate) fn payload(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// Replaces the bytes by what `write` writes.
    pub(crate) fn fill<E: From<CdrError>>(
        &mut self,
        write: impl FnOnce(&mut CdrWriter<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.len = 0;
        let mut w = CdrWriter::new(&mut self.bytes);
        write(&mut w)?;
        self.len = w.len();
        Ok(())
    }
}

impl<T: Message> Message for Body<T> {
    const TYPE_NAME: &'static str = T::TYPE_NAME;
    const DDS_TYPE_NAME: &'static str = T::DDS_TYPE_NAME;
    const MAX_SIZE: usize = T::MAX_SIZE + 3; // RTPS pads to multiples of four
    const BOUNDED: bool = T::BOUNDED;
    const TYPE_HASH: Option<&'static str> = T::TYPE_HASH;

    fn reserve(&mut self, bytes: usize) {
        *self = Self::with_room(bytes);
    }

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.bytes(self.payload())
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        let (len, most) = (r.remaining(), self.bytes.len());
        let bytes = r.bytes(len)?;
        let room = self.bytes.get_mut(..len);
        let room = room.ok_or(CdrError::TooLong { len, limit: most })?;
        room.copy_from_slice(bytes);
        self.len = len;
        Ok(())
    }
}

/// The service `S` with its messages as bytes.
pub(crate) struct Bare<S>(PhantomData<S>);

impl<S: Service> Service for Bare<S> {
    type Request = Body<S::Request>;
    type Response = Body<S::Response>;
    const TYPE_NAME: &'static str = S::TYPE_NAME;
    const TYPE_HASH: Option<&'static str> = S::TYPE_HASH;
}

/// A request that was not answered.
#[derive(Debug)]
pub(crate) enum Unanswered {
    Request(DecodeError),
    Response(CdrError),
    /// It takes more than `limit` bytes.
    TooLong {
        limit: usize,
    },
    Reply(PublishError),
}

impl From<DecodeError> for Unanswered {
    fn from(e: DecodeError) -> Self {
        Self::Request(e)
    }
}

impl From<CdrError> for Unanswered {
    fn from(e: CdrError) -> Self {
        Self::Response(e)
    }
}

impl fmt::Display for Unanswered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request(e) => write!(f, "not such a request: {e}"),
            Self::Response(e) => write!(f, "the response cannot be encoded: {e}"),
            Self::TooLong { limit } => {
                write!(f, "the response takes more than max_size: {limit}")
            }
            Self::Reply(e) => write!(f, "the response was not sent: {e}"),
        }
    }
}

/// Answers requests, with a response that is there before.
pub(crate) fn answers<S: Service, A>(
    name: Topic<'_>,
    mut answer: A,
) -> impl FnMut(&[u8], Responder<Bare<S>>) -> Answered + Send + 'static
where
    A: FnMut(&[u8], &mut CdrWriter<'_>) -> Result<(), Unanswered> + Send + 'static,
{
    let limit = sized::<Body<S::Response>>(name.max_size);
    let mut response = Body::<S::Response>::with_room(limit);
    move |request, to| {
        let filled = response.fill(|w| answer(request, w));
        filled.map_err(|e| match e {
            Unanswered::Response(CdrError::EndOfBuffer { .. }) => Unanswered::TooLong { limit },
            other => other,
        })?;
        to.reply(&response).map_err(Unanswered::Reply)
    }
}

pub(crate) type Answered = Result<(), Unanswered>;
