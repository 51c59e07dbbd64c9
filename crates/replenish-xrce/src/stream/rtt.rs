//! An estimate of the round-trip time, after RFC 6298, but with more patience: what is sent again
//! in vain costs as much as what is sent again late.

use crate::Nanos;

/// Smoothed round-trip time and its variation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rtt {
    estimate: Option<(Nanos, Nanos)>,
}

impl Rtt {
    /// Takes in a measurement of a message that was sent once.
    pub(super) fn sample(&mut self, rtt: Nanos) {
        self.estimate = Some(match self.estimate {
            None => (rtt, rtt / 3),
            Some((smooth, var)) => {
                let deviation = smooth.abs_diff(rtt);
                let var = var.saturating_sub(var / 4).saturating_add(deviation / 4);
                (
                    smooth.saturating_sub(smooth / 8).saturating_add(rtt / 8),
                    var,
                )
            }
        });
    }

    /// Takes in a measurement that may be too long: only as far as it is believable.
    pub(super) fn sample_at_most(&mut self, rtt: Nanos) {
        let longest = self.estimate.map(|(smooth, _)| smooth.saturating_mul(2));
        self.sample(longest.map_or(rtt, |longest| rtt.min(longest)));
    }

    /// A time after which an answer that has not come will hardly come any more, if known.
    pub(super) fn timeout(&self) -> Option<Nanos> {
        self.estimate
            .map(|(smooth, var)| smooth.saturating_add(var.saturating_mul(6)))
    }
}

#[cfg(test)]
mod tests {
    use super::Rtt;

    #[test]
    fn follows_the_samples() {
        let mut rtt = Rtt::default();
        assert_eq!(rtt.timeout(), None);
        rtt.sample(1000);
        assert_eq!(rtt.timeout(), Some(2998));
        for _ in 0..200 {
            rtt.sample(10_000);
        }
        let timeout = rtt.timeout().unwrap();
        assert!((9_000..12_000).contains(&timeout), "{timeout}");
    }
}
