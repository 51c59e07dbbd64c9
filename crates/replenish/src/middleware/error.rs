//! Errors between the executor and the bytes.

use super::remedy::LARGEST;
use crate::platform::{StaticText, TEXTS, Text};
use core::fmt;
use replenish_msg::CdrError;

/// An operation of the middleware failed.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum MiddlewareError {
    /// A bound was reached.
    Capacity {
        /// The things of which there are too many.
        what: StaticText,
        /// The most that there may be.
        limit: usize,
    },
    /// The largest sample of the type does not fit.
    TooLarge {
        /// Bytes the type may need.
        size: usize,
        /// Bytes there is room for.
        limit: usize,
        /// The setting of the limit, and its range.
        setting: StaticText,
    },
    /// The middleware cannot do this.
    Unsupported(StaticText),
    /// The topic exists with another type.
    TypeMismatch {
        /// The type it has.
        existing: Text,
    },
    /// The peer did not answer in time.
    NoAnswer {
        /// The request that was not answered.
        what: StaticText,
    },
    /// The peer said no.
    Refused {
        /// The request.
        what: StaticText,
        /// The peer's own code (XRCE: `StatusValue`).
        status: u8,
    },
    /// The link to the peer is down.
    LinkDown,
    /// The operating system refused.
    Io {
        /// The action that failed.
        what: StaticText,
        /// Its error number.
        errno: i32,
    },
}

impl fmt::Display for MiddlewareError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Capacity { what, limit } => write!(f, "too many {what}: the limit is {limit}"),
            Self::TooLarge {
                size,
                limit,
                setting,
            } => {
                write!(
                    f,
                    "samples of up to {size} bytes do not fit, the limit is {limit}: {setting}; \
                     Topic::max_size asks for shorter samples"
                )
            }
            Self::Unsupported(what) => write!(f, "not supported by this middleware: {what}"),
            Self::TypeMismatch { existing } => write!(f, "the topic exists with type {existing}"),
            Self::NoAnswer { what } => write!(f, "no answer to: {what}"),
            Self::Refused { what, status } => {
                write!(
                    f,
                    "refused with status {status:#04x}: {what}{}",
                    why(*status)
                )
            }
            Self::LinkDown => f.write_str("the link is down"),
            Self::Io { what, errno } => write!(f, "{what}: {}", os_error(*errno)),
        }
    }
}

impl core::error::Error for MiddlewareError {}

/// The meaning of a status (XRCE 7.3.4, `StatusValue`), and a remedy.
fn why(status: u8) -> &'static str {
    match status {
        _ if !TEXTS => "",
        0x80 => " (an error of its DDS)",
        0x81 => " (it exists in another way)",
        0x82 => " (it exists already)",
        0x83 => " (denied)",
        0x84 => " (of something that does not exist)",
        0x85 => " (invalid data)",
        0x86 => " (incompatible)",
        0x87 => {
            " (no room: a limit of the agent for each client; that of `replenish agent` is --entities)"
        }
        _ => "",
    }
}

/// A sample was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum PublishError {
    /// The message could not be encoded: a field is longer than its bound. Without
    /// feature `texts` also a message that is [`TooLong`](Self::TooLong) for its buffer.
    Encode(CdrError),
    /// The message is longer than the buffer it is encoded into, which is
    /// [`Message::MAX_SIZE`](replenish_msg::Message::MAX_SIZE) bytes unless one asks for another
    /// size.
    TooLong {
        /// The field that was not written to its end; empty where that is not known.
        field: &'static str,
        /// Bytes that the message takes up to there: it takes as many or more.
        size: usize,
        /// Bytes of the buffer.
        limit: usize,
        /// The way to a longer buffer, up to 268435456 bytes.
        remedy: &'static str,
    },
    /// The encoded sample is larger than the writer allows.
    TooLarge {
        /// Bytes of the sample.
        size: usize,
        /// Bytes the writer allows.
        limit: usize,
    },
    /// The output queue of a reliable writer is full.
    Full,
    /// Every message of the publisher's pool is lent, waits for a subscription, or is read.
    AllLent {
        /// The number of the pool's messages.
        size: usize,
    },
    /// The link to the peer is down.
    LinkDown,
    /// The writer does not exist in this middleware.
    UnknownWriter,
    /// The operating system refused with this error number.
    Io(i32),
}

impl fmt::Display for PublishError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Encode(e) => write!(f, "the message cannot be encoded: {e}"),
            Self::TooLong {
                field,
                size,
                limit,
                remedy,
            } => {
                let (of, colon) = if field.is_empty() {
                    ("", "")
                } else {
                    ("field ", ": ")
                };
                write!(
                    f,
                    "{of}{field}{colon}the message takes {size} bytes or more, its buffer has {limit}; \
                     {remedy} makes room, for up to {LARGEST}"
                )
            }
            Self::TooLarge { size, limit } => {
                write!(f, "the sample has {size} bytes, the writer allows {limit}")
            }
            Self::AllLent { size } if TEXTS => write!(
                f,
                "all {size} messages of the pool are lent, wait for a subscription or are read: \
                 Publisher::pool makes a larger one"
            ),
            Self::Full | Self::AllLent { .. } => f.write_str("the output queue is full"),
            Self::LinkDown => f.write_str("the link is down"),
            Self::UnknownWriter => f.write_str("the writer does not exist in this middleware"),
            Self::Io(errno) => write!(f, "sending failed: {}", os_error(*errno)),
        }
    }
}

impl core::error::Error for PublishError {}

fn os_error(errno: i32) -> impl fmt::Display {
    crate::platform::io::Error::from_raw_os_error(errno)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::label;

    #[test]
    fn a_refusal_says_what_its_status_means() {
        let refused = |status| {
            let what = label("create a topic");
            MiddlewareError::Refused { what, status }.to_string()
        };
        assert_eq!(
            refused(0x87),
            "refused with status 0x87: create a topic (no room: a limit of the agent for each client; \
             that of `replenish agent` is --entities)"
        );
        assert_eq!(refused(0x42), "refused with status 0x42: create a topic");
    }
}
