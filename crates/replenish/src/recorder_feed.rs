//! A board's recording on its way to the host: pieces on the topic `/replenish/recorder`.

use crate::context::Node;
use crate::error::Error;
use crate::executor::RunningExecutor;
use crate::middleware::{MiddlewareError, PublishError};
use crate::platform::label;
use crate::publisher::Publisher;
use crate::qos::Qos;
use core::fmt;
use replenish_msg::{CdrError, CdrReader, CdrWriter, Message};
use replenish_os::recorder::{Feed, ON, PIECE, TOPIC};

/// Sends what the executor's threads did last, on a board with feature `recorder` of
/// `replenish-os`, to the agent: `replenish top` and `replenish trace` show the board then.
///
/// The program calls [`send`](Self::send) again and again in a task below all others. Every event
/// takes 16 bytes; those that were overwritten before they were sent are counted by the host.
pub struct RecorderFeed {
    publisher: Publisher<Bytes>,
    feed: Feed,
}

impl fmt::Debug for RecorderFeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RecorderFeed")
            .field("feed", &self.feed)
            .finish_non_exhaustive()
    }
}

impl RecorderFeed {
    /// A publisher of `node`, best effort. `board` is the name that the host shows; its first 40
    /// bytes are kept. Set-up only.
    ///
    /// # Errors
    /// [`MiddlewareError::Unsupported`] where nothing is recorded for a feed: without that feature,
    /// and on Linux, where the executor records into a file. Otherwise those of
    /// [`Node::publisher`].
    pub fn new(node: &Node, board: &str) -> Result<Self, Error> {
        if !ON {
            let source = MiddlewareError::Unsupported(label("a board's recording in this build"));
            return Err(Error::endpoint("publisher of", TOPIC, source));
        }
        Ok(Self {
            publisher: node.publisher(TOPIC, Qos::best_effort())?,
            feed: Feed::new(board),
        })
    }

    /// Sends one description (the board's name, a thread with its account, or a name, in turn) and
    /// up to `pieces` pieces of 11 events; how many it sent. Until everything was described once it
    /// sends descriptions alone. Does not allocate or wait.
    ///
    /// `ahead` is Unix time less [`clock::monotonic`](replenish_os::clock::monotonic) of this
    /// board, as [`Xrce::agent_clock_offset`](crate::middleware::xrce::Xrce::agent_clock_offset)
    /// gives it; `None`: the host relates the clocks by arrivals, which is wrong by the time on the
    /// line.
    ///
    /// # Errors
    /// Why a piece was not sent, but for [`PublishError::Full`], which ends this call: the piece is
    /// sent by the next one.
    pub fn send(
        &mut self,
        running: &RunningExecutor,
        ahead: Option<i64>,
        pieces: usize,
    ) -> Result<usize, PublishError> {
        let mut bytes = Bytes::default();
        let mut sent = 0;
        let usage = |thread: &str| running.usage(thread).unwrap_or_default();
        let descriptions = if self.feed.is_described() {
            1
        } else {
            pieces.max(1)
        };
        for _ in 0..descriptions {
            bytes.len = self.feed.description(usage, &mut bytes.room);
            if !self.publish(&bytes)? {
                return Ok(sent);
            }
            sent += 1;
        }
        for _ in 0..pieces {
            bytes.len = self.feed.events(ahead, &mut bytes.room);
            if bytes.len == 0 {
                break;
            }
            if !self.publish(&bytes)? {
                return Ok(sent);
            }
            sent += 1;
        }
        Ok(sent)
    }

    /// Whether there was room for it.
    fn publish(&mut self, bytes: &Bytes) -> Result<bool, PublishError> {
        match self.publisher.publish(bytes) {
            Ok(()) => self.feed.sent(),
            Err(PublishError::Full) => return Ok(false),
            Err(e) => return Err(e),
        }
        Ok(true)
    }
}

/// `std_msgs/msg/UInt8MultiArray` without dimensions.
struct Bytes {
    room: [u8; PIECE],
    len: usize,
}

impl Default for Bytes {
    fn default() -> Self {
        let room = [0; PIECE];
        Self { room, len: 0 }
    }
}

impl Message for Bytes {
    const TYPE_NAME: &'static str = "std_msgs/msg/UInt8MultiArray";
    const DDS_TYPE_NAME: &'static str = "std_msgs::msg::dds_::UInt8MultiArray_";
    const MAX_SIZE: usize = 12 + PIECE;

    fn encode(&self, w: &mut CdrWriter<'_>) -> Result<(), CdrError> {
        w.sequence(0)?; // dimensions
        w.u32(0)?; // data offset
        w.sequence(self.len)?;
        w.bytes(self.room.get(..self.len).unwrap_or_default())
    }

    fn decode(&mut self, r: &mut CdrReader<'_>) -> Result<(), CdrError> {
        r.sequence(0)?;
        r.u32()?;
        self.len = r.sequence(PIECE)?;
        let bytes = r.bytes(self.len)?;
        self.room
            .iter_mut()
            .zip(bytes)
            .for_each(|(to, from)| *to = *from);
        Ok(())
    }
}
