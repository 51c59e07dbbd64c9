//! An event in 16 bytes, and the ring that holds them.
//!
//! ```text
//!   word 0:  time, 48 bits │ kind, 7 bits │ of a budget, 1 bit │ task, 8 bits
//!   word 1:  value, 48 bits │ id of a name, 16 bits
//! ```
//!
//! 48 bits of nanoseconds wrap after 78 hours: the reader knows the board's whole clock and takes
//! the nearest time that fits.

use crate::event::{Event, Kind};

/// Bits of times and values.
const BITS: u32 = 48;
const MASK: u64 = (1 << BITS) - 1;
/// The highest bit of a value, where two values share it.
const FLAG: u64 = 1 << (BITS - 1);

/// An event of a board: 16 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CompactEvent(pub [u64; 2]);

impl CompactEvent {
    /// Bytes of one.
    pub const BYTES: usize = 16;

    /// The event of task `task`, of its budget or its own. [`Event::b`] is kept of [`Kind::Level`]
    /// and [`Kind::Publish`] alone; values beyond 48 bits (with a second one: 47) become the
    /// largest, names beyond 16 bits 0.
    #[must_use]
    pub fn new(task: u8, of_budget: bool, event: &Event) -> Self {
        let kind = event.kind as u64 | u64::from(of_budget) << 7;
        let value = match event.kind {
            // Instants: the reader finds the upper bits by the event's own time.
            kind if is_instant(kind) => event.a & MASK,
            Kind::Publish => event.a.min(FLAG - 1) | if event.b > 0 { FLAG } else { 0 },
            Kind::Level => event.b.min(FLAG - 1) | if event.a > 0 { FLAG } else { 0 },
            _ => event.a.min(MASK),
        };
        let name = u64::from(u16::try_from(event.name).unwrap_or(0));
        Self([
            event.time & MASK | kind << BITS | u64::from(task) << 56,
            value | name << BITS,
        ])
    }

    /// The task, whether the event is of its budget, and the event; `now` is the board's clock at a
    /// moment at most 78 hours after it. `None` for a kind that this reader does not know.
    #[must_use]
    pub fn expand(self, now: u64) -> Option<(u8, bool, Event)> {
        let [first, second] = self.0;
        let number = u16::try_from(first >> BITS & 0x7f).ok()?;
        let kind = Kind::from_number(number)?;
        let time = now.wrapping_sub(now.wrapping_sub(first) & MASK);
        let value = second & MASK;
        let (a, b) = match kind {
            kind if is_instant(kind) => (near(time, value), 0),
            Kind::Publish => (value & !FLAG, u64::from(value & FLAG > 0)),
            Kind::Level => (u64::from(value & FLAG > 0), value & !FLAG),
            _ => (value, 0),
        };
        let event = Event {
            time,
            kind,
            name: u32::try_from(second >> BITS).ok()?,
            a,
            b,
        };
        let task = u8::try_from(first >> 56).ok()?;
        Some((task, first >> 55 & 1 == 1, event))
    }

    /// Little-endian.
    #[must_use]
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let words = self.0.iter().flat_map(|word| word.to_le_bytes());
        bytes
            .iter_mut()
            .zip(words)
            .for_each(|(to, from)| *to = from);
        bytes
    }

    /// Little-endian.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; Self::BYTES]) -> Self {
        let word = |at: usize| {
            let word = bytes.get(at..).and_then(<[u8]>::first_chunk);
            u64::from_le_bytes(*word.unwrap_or(&[0; 8]))
        };
        Self([word(0), word(8)])
    }
}

/// Whether [`Event::a`] of such an event is on the same clock as its time.
pub(super) const fn is_instant(kind: Kind) -> bool {
    use Kind::{Begin, ChainEnd, ChainStage, End, Wake};
    matches!(kind, Wake | Begin | End | ChainStage | ChainEnd)
}

/// The instant nearest to `time` with these lower 48 bits.
fn near(time: u64, low: u64) -> u64 {
    let ahead = low.wrapping_sub(time) & MASK;
    if ahead < FLAG {
        time.wrapping_add(ahead)
    } else {
        time.wrapping_sub(MASK + 1 - ahead)
    }
}

/// The last `N` events of all tasks; on a board under the mask that keeps tasks from switching.
#[derive(Debug)]
pub struct CompactRing<const N: usize> {
    slots: [CompactEvent; N],
    written: u64,
}

impl<const N: usize> Default for CompactRing<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> CompactRing<N> {
    /// An empty ring.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            slots: [CompactEvent([0; 2]); N],
            written: 0,
        }
    }

    /// Writes one over the oldest.
    pub fn push(&mut self, event: CompactEvent) {
        if let Some(slot) = self.slots.get_mut(place::<N>(self.written)) {
            *slot = event;
            self.written += 1;
        }
    }

    /// Events written so far.
    #[must_use]
    pub const fn written(&self) -> u64 {
        self.written
    }

    /// Copies events from number `from` on, or from the oldest that is still there, into `to`; the
    /// number of the first one, and how many.
    pub fn copy(&self, from: u64, to: &mut [CompactEvent]) -> (u64, usize) {
        let oldest = self.written.saturating_sub(N as u64);
        let first = from.clamp(oldest, self.written);
        let mut count = 0;
        for (n, to) in (first..self.written).zip(to) {
            *to = self.slots.get(place::<N>(n)).copied().unwrap_or_default();
            count += 1;
        }
        (first, count)
    }
}

fn place<const N: usize>(n: u64) -> usize {
    usize::try_from(n % (N.max(1) as u64)).unwrap_or(0)
}
