//! Durations and times: seconds and 2^-32 parts of a second (RTPS 2.5, 9.3.2).

use super::{Reader, WireError, Writer};

/// Nanoseconds: intervals, and times of whatever monotonic clock the caller uses.
pub type Nanos = u64;

/// An interval without end, and a time that never comes.
pub const INFINITE: Nanos = Nanos::MAX;

const SECOND: u64 = 1_000_000_000;

/// Nearest, so that a nanosecond survives both ways.
fn nanos(seconds: u64, fraction: u32) -> Nanos {
    let parts = (u128::from(fraction) * u128::from(SECOND) + (1 << 31)) >> 32;
    seconds
        .saturating_mul(SECOND)
        .saturating_add(u64::try_from(parts).unwrap_or(0))
}

/// Rounded up: Fast DDS rounds down when it reads.
fn fraction(nanos: Nanos) -> u32 {
    let parts = (u128::from(nanos % SECOND) << 32).div_ceil(u128::from(SECOND));
    u32::try_from(parts).unwrap_or(u32::MAX)
}

/// An interval; negative ones are 0.
pub(super) fn duration(r: &mut Reader<'_>) -> Result<Nanos, WireError> {
    let (seconds, fraction) = (r.i32()?, r.u32()?);
    if seconds == i32::MAX {
        return Ok(INFINITE);
    }
    Ok(nanos(u64::try_from(seconds).unwrap_or(0), fraction))
}

pub(super) fn put_duration(w: &mut Writer<'_>, value: Nanos) {
    match i32::try_from(value / SECOND) {
        Ok(seconds) if seconds != i32::MAX => {
            w.i32(seconds);
            w.u32(fraction(value));
        }
        _ => {
            w.i32(i32::MAX);
            w.u32(u32::MAX);
        }
    }
}

/// A time of the source's wall clock: nanoseconds since 1970, good until 2106.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Timestamp(pub Nanos);

impl Timestamp {
    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        let (seconds, fraction) = (r.u32()?, r.u32()?);
        Ok(Timestamp(nanos(u64::from(seconds), fraction)))
    }

    pub(super) fn encode(self, w: &mut Writer<'_>) {
        w.u32(u32::try_from(self.0 / SECOND).unwrap_or(u32::MAX));
        w.u32(fraction(self.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding down both ways lost a nanosecond of most deadlines, so that a writer's and a
    /// reader's equal deadlines did not match.
    #[test]
    fn whole_nanoseconds_survive_the_wire() {
        for value in [0, 1, 999_999_999, 100_000_000, 20 * SECOND, 3 * SECOND + 7] {
            let mut buf = [0; 8];
            let mut w = Writer::new(&mut buf);
            put_duration(&mut w, value);
            assert_eq!(duration(&mut Reader::new(&buf, true)), Ok(value));
            // Also for a peer that rounds down.
            let [.., a, b, c, d] = buf;
            let parts = u64::from(u32::from_le_bytes([a, b, c, d]));
            assert_eq!((parts * SECOND) >> 32, value % SECOND);
        }
        let mut buf = [0; 8];
        put_duration(&mut Writer::new(&mut buf), INFINITE);
        assert_eq!(buf, [255, 255, 255, 127, 255, 255, 255, 255]);
        assert_eq!(duration(&mut Reader::new(&buf, true)), Ok(INFINITE));
    }
}
