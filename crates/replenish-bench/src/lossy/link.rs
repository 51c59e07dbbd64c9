//! The link: what becomes of each datagram, and which arrives next.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use replenish_xrce::Nanos;

/// Quality of a link: loss, delays, duplicates. Datagrams overtake each other if the delays differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Link {
    /// Datagrams that are lost, 0 to 100 percent.
    pub loss_percent: u8,
    /// Datagrams that arrive twice, 0 to 100 percent.
    pub duplicate_percent: u8,
    /// The shortest delay.
    pub delay_min: Nanos,
    /// The longest delay, not less than the shortest.
    pub delay_max: Nanos,
}

/// Direction of a datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Direction {
    /// From the sender of samples.
    Forth,
    /// To the sender of samples.
    Back,
}

/// The fate of a datagram: the delay of each copy that arrives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fate {
    /// Delay of the datagram; `None` if it is lost.
    pub delay: Option<Nanos>,
    /// Delay of its duplicate, if there is one.
    pub duplicate: Option<Nanos>,
}

/// `SplitMix64`.
struct Random(u64);

impl Random {
    const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next().checked_rem(n).unwrap_or(0)
    }

    fn percent(&mut self, p: u8) -> bool {
        self.below(100) < u64::from(p)
    }
}

impl Link {
    /// The fate of datagram `number` of `direction`, always the same for one `seed`.
    #[must_use]
    pub fn fate(&self, seed: u64, direction: Direction, number: u64) -> Fate {
        let way = match direction {
            Direction::Forth => 0,
            Direction::Back => 0x5851_f42d_4c95_7f2d,
        };
        let mut random = Random(seed.wrapping_mul(0xd134_2543_de82_ef95) ^ way);
        let start = random.next();
        let mut random = Random(start.wrapping_add(number.wrapping_mul(0xa076_1d64_78bd_642f)));
        let spread = self.delay_max.saturating_sub(self.delay_min);
        let delay = |random: &mut Random| {
            let extra = random.below(spread.saturating_add(1));
            self.delay_min.saturating_add(extra)
        };
        let lost = random.percent(self.loss_percent);
        let twice = random.percent(self.duplicate_percent);
        let (first, second) = (delay(&mut random), delay(&mut random));
        Fate {
            delay: (!lost).then_some(first),
            duplicate: (twice && !lost).then_some(second),
        }
    }
}

/// Arrival, then order of sending, then where to and what.
type Flight = Reverse<(Nanos, u64, Direction, Vec<u8>)>;

/// The datagrams under way on a link, and counts of the others.
#[derive(Debug)]
pub(super) struct Air {
    link: Link,
    seed: u64,
    flights: BinaryHeap<Flight>,
    launched: u64,
    sent: [u64; 2],
    pub(super) lost: u64,
}

impl Air {
    pub(super) const fn new(link: Link, seed: u64) -> Self {
        Air {
            link,
            seed,
            flights: BinaryHeap::new(),
            launched: 0,
            sent: [0; 2],
            lost: 0,
        }
    }

    pub(super) fn send(&mut self, now: Nanos, direction: Direction, bytes: &[u8]) {
        let count = match (&mut self.sent, direction) {
            ([forth, _], Direction::Forth) => forth,
            ([_, back], Direction::Back) => back,
        };
        let number = *count;
        *count = count.saturating_add(1);
        let fate = self.link.fate(self.seed, direction, number);
        if fate.delay.is_none() && direction == Direction::Forth {
            self.lost = self.lost.saturating_add(1);
        }
        for delay in fate.delay.into_iter().chain(fate.duplicate) {
            self.launched = self.launched.saturating_add(1);
            let at = now.saturating_add(delay);
            let flight = (at, self.launched, direction, bytes.to_vec());
            self.flights.push(Reverse(flight));
        }
    }

    pub(super) fn next_arrival(&self) -> Option<Nanos> {
        self.flights.peek().map(|Reverse((at, ..))| *at)
    }

    pub(super) fn land(&mut self) -> Option<(Direction, Vec<u8>)> {
        let Reverse((_, _, direction, bytes)) = self.flights.pop()?;
        Some((direction, bytes))
    }
}
