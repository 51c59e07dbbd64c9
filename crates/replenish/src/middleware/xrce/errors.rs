//! Errors of the session, as errors of the middleware.

use super::limits::REQUESTS;
use crate::middleware::MiddlewareError;
use crate::platform::{StaticText, io, label};
use replenish_xrce::client::RequestError;
use replenish_xrce::stream::PushError;

/// The setting that limits samples: the window of a reliable stream holds at least the largest one.
pub(super) const fn setting(reliable: bool) -> StaticText {
    if reliable {
        label("of reliable ones it is XrceConfig::max_sample, 1..=16777216")
    } else {
        label("of best-effort ones it is XrceConfig::mtu - 12, with an mtu of 64..=65507")
    }
}

pub(super) fn request_error(error: &RequestError) -> MiddlewareError {
    match *error {
        RequestError::JournalFull => MiddlewareError::Capacity {
            what: label("objects of the session"),
            limit: REQUESTS,
        },
        RequestError::Stream(PushError::TooLarge { size, limit }) => MiddlewareError::TooLarge {
            size,
            limit,
            setting: label("that of a request with names this long is XrceConfig::mtu, 64..=65507"),
        },
        RequestError::Down => MiddlewareError::LinkDown,
        RequestError::Unsupported => {
            MiddlewareError::Unsupported(label("a question to the agent without feature `full`"))
        }
        _ => MiddlewareError::Unsupported(label("a name with a NUL inside")),
    }
}

pub(super) fn io_error(what: StaticText, error: &io::Error) -> MiddlewareError {
    MiddlewareError::Io {
        what,
        errno: error.raw_os_error().unwrap_or(0),
    }
}
