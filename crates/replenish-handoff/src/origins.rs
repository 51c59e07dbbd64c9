//! The instants at which the chains that led to a sample began. They travel with the sample as
//! plain data, so nothing is looked up on the way.

/// Chains that one callback can be in.
pub const MOST_CHAINS: usize = 4;

/// For up to [`MOST_CHAINS`] links, the instant at which the instance of the chain began.
///
/// A link is a stage of a chain, by its number in the process; 0 is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Origins {
    links: [u32; MOST_CHAINS],
    instants: [u64; MOST_CHAINS],
}

impl Origins {
    /// Of a sample that belongs to no chain.
    pub const NONE: Self = Self {
        links: [0; MOST_CHAINS],
        instants: [0; MOST_CHAINS],
    };

    /// Whether the sample belongs to no chain.
    #[inline]
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        // They are filled from the first place on.
        let [first, ..] = self.links;
        first == 0
    }

    /// The sample comes from this link, and its instance began at `instant` (`CLOCK_MONOTONIC`, in
    /// nanoseconds). `false` if there is no place left; link 0 takes none.
    pub fn add(&mut self, link: u32, instant: u64) -> bool {
        let mut places = self.links.iter_mut().zip(&mut self.instants);
        let Some((place, at)) = places.find(|(place, _)| **place == 0) else {
            return false;
        };
        (*place, *at) = (link, instant);
        link != 0
    }

    /// The links that the sample comes from, each with the instant at which its instance began.
    pub fn links(&self) -> impl Iterator<Item = (u32, u64)> + '_ {
        let places = self.links.iter().zip(&self.instants);
        places
            .filter(|(link, _)| **link != 0)
            .map(|(link, at)| (*link, *at))
    }

    /// The instant at which the instance began, if the sample comes from this link.
    #[must_use]
    pub fn from_link(&self, link: u32) -> Option<u64> {
        let mut places = self.links.iter().zip(&self.instants);
        let found = places.find(|(place, _)| link != 0 && **place == link);
        found.map(|(_, instant)| *instant)
    }
}

/// A stamp of a publisher that is older than this is one of another clock, in ns.
const OLDEST: u64 = 60_000_000_000;

/// The instant at which a sample was published that arrived at `arrival`.
///
/// The publisher's `stamp` counts since the Unix epoch, where the wall clock shows `wall` at the
/// instant `now`. A stamp that cannot be of this host's clock, since it lies in the future or more
/// than a minute back, gives way to the arrival. All in nanoseconds.
#[must_use]
pub fn published_at(stamp: u64, arrival: u64, (wall, now): (u64, u64)) -> u64 {
    let age = wall.checked_sub(stamp);
    let instant = age.and_then(|age| now.checked_sub(age));
    let fits = |instant: &u64| *instant <= arrival && arrival - *instant <= OLDEST;
    instant.filter(fits).unwrap_or(arrival)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_that_cannot_be_this_hosts_gives_way_to_the_arrival() {
        let second = 1_000_000_000;
        let clocks = (1000 * second, 100 * second);
        let of = |stamp| published_at(stamp, 99 * second, clocks);
        assert_eq!(of(998 * second), 98 * second);
        assert_eq!(of(999 * second), 99 * second);
        assert_eq!(of(999 * second + 1), 99 * second, "after its arrival");
        assert_eq!(of(2000 * second), 99 * second, "in the future");
        assert_eq!(of(939 * second), 39 * second);
        assert_eq!(of(939 * second - 1), 99 * second, "more than a minute old");
        assert_eq!(of(0), 99 * second);
        assert_eq!(published_at(0, 0, (u64::MAX, 0)), 0);
    }

    #[test]
    fn each_link_has_its_own_instant_and_a_fifth_has_no_place() {
        let mut origins = Origins::NONE;
        assert!(origins.is_empty() && !origins.add(0, 7) && origins.is_empty());
        for link in 1..=4 {
            assert!(origins.add(link, u64::from(link) * 10));
        }
        assert!(!origins.add(5, 50) && !origins.is_empty());
        assert!(origins.links().eq([(1, 10), (2, 20), (3, 30), (4, 40)]));
        let instants = [0, 1, 2, 3, 4, 5].map(|link| origins.from_link(link));
        let expected = [None, Some(10), Some(20), Some(30), Some(40), None];
        assert_eq!(instants, expected);
    }
}
