//! TIMESTAMP and `TIMESTAMP_REPLY`: the agent's clock as seen by the client (as in NTP).

use super::{Encode, SubmessageId};
use super::{Reader, WireError, Writer};

/// A point in time: seconds and nanoseconds since the Unix epoch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct WireTime {
    /// Seconds.
    pub seconds: i32,
    /// Nanoseconds within the second.
    pub nanoseconds: u32,
}

impl WireTime {
    /// Nanoseconds since the epoch.
    #[must_use]
    pub fn as_nanos(self) -> i64 {
        i64::from(self.seconds)
            .saturating_mul(1_000_000_000)
            .saturating_add(i64::from(self.nanoseconds))
    }

    /// Converts nanoseconds since the epoch; seconds beyond 32 bits saturate.
    #[must_use]
    pub fn from_nanos(nanos: i64) -> Self {
        let seconds = nanos.div_euclid(1_000_000_000);
        let fallback = if seconds < 0 { i32::MIN } else { i32::MAX };
        WireTime {
            seconds: i32::try_from(seconds).unwrap_or(fallback),
            nanoseconds: u32::try_from(nanos.rem_euclid(1_000_000_000)).unwrap_or(0),
        }
    }

    fn write(self, w: &mut Writer<'_>) {
        w.u32(self.seconds.cast_unsigned());
        w.u32(self.nanoseconds);
    }

    fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(WireTime {
            seconds: r.u32()?.cast_signed(),
            nanoseconds: r.u32()?,
        })
    }
}

/// TIMESTAMP: asks for the agent's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timestamp {
    /// Time at which the client sent it, on the client's clock.
    pub transmit: WireTime,
}

impl Encode for Timestamp {
    fn id(&self) -> SubmessageId {
        SubmessageId::Timestamp
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.transmit.write(w);
    }
}

impl Timestamp {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(Timestamp {
            transmit: WireTime::decode(r)?,
        })
    }
}

/// `TIMESTAMP_REPLY`: the agent's answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimestampReply {
    /// Time at which the agent sent it, on the agent's clock.
    pub transmit: WireTime,
    /// Time at which the agent received the TIMESTAMP, on the agent's clock.
    pub receive: WireTime,
    /// The time in the TIMESTAMP.
    pub originate: WireTime,
}

impl TimestampReply {
    /// Nanoseconds by which the client's clock is ahead of the agent's, if the reply arrived at
    /// `arrival` on the client's clock and both ways took equally long.
    #[must_use]
    pub fn offset(&self, arrival: WireTime) -> i64 {
        let client =
            i128::from(self.originate.as_nanos()).saturating_add(arrival.as_nanos().into());
        let agent =
            i128::from(self.receive.as_nanos()).saturating_add(self.transmit.as_nanos().into());
        let offset = client.saturating_sub(agent) >> 1;
        i64::try_from(offset).unwrap_or(if offset < 0 { i64::MIN } else { i64::MAX })
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(TimestampReply {
            transmit: WireTime::decode(r)?,
            receive: WireTime::decode(r)?,
            originate: WireTime::decode(r)?,
        })
    }
}

impl Encode for TimestampReply {
    fn id(&self) -> SubmessageId {
        SubmessageId::TimestampReply
    }

    fn write(&self, w: &mut Writer<'_>) {
        self.transmit.write(w);
        self.receive.write(w);
        self.originate.write(w);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offset_is_half_the_difference_of_the_sums() {
        let at = |nanos| WireTime::from_nanos(nanos);
        // Client 500 ns ahead, 100 ns each way.
        let reply = TimestampReply {
            originate: at(1500),
            receive: at(1100),
            transmit: at(1150),
        };
        assert_eq!(reply.offset(at(1750)), 500);
        assert_eq!(at(-1).as_nanos(), -1);
        assert_eq!(WireTime::from_nanos(i64::MAX).seconds, i32::MAX);
    }
}
