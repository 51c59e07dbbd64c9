//! Whether a publisher and a subscription fit together: the request-versus-offered rules of DDS
//! (OMG DDS 1.4, 2.2.3) for the policies that [`Qos`] has.

use crate::qos::{Durability, Qos, Reliability};
use core::fmt;
use core::time::Duration;

/// The policies that clash, with what is offered and what is requested.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct QosClash {
    offered: Qos,
    requested: Qos,
}

impl QosClash {
    /// The names of the policies that clash: `reliability`, `durability`, `deadline`, `liveliness`.
    pub fn policies(&self) -> impl Iterator<Item = &'static str> {
        names(self.bits())
    }

    /// The policies that clash.
    pub(crate) fn bits(&self) -> u8 {
        let (offered, requested) = (self.offered, self.requested);
        let bit = |clashes: bool, bit: u8| if clashes { bit } else { 0 };
        bit(is_weaker(offered, requested), RELIABILITY)
            | bit(is_shorter(offered, requested), DURABILITY)
            | bit(is_slower(offered, requested), DEADLINE)
            | bit(is_less_alive(offered, requested), LIVELINESS)
    }
}

/// Policies as bits, as agents tell them.
pub(crate) const RELIABILITY: u8 = 1;
pub(crate) const DURABILITY: u8 = 2;
pub(crate) const DEADLINE: u8 = 4;
pub(crate) const LIVELINESS: u8 = 8;

/// The names of the policies in `bits`.
pub(crate) fn names(bits: u8) -> impl Iterator<Item = &'static str> {
    let all = [
        (RELIABILITY, "reliability"),
        (DURABILITY, "durability"),
        (DEADLINE, "deadline"),
        (LIVELINESS, "liveliness"),
    ];
    let set = all.into_iter().filter(move |(bit, _)| bits & bit != 0);
    set.map(|(_, name)| name)
}

fn is_weaker(offered: Qos, requested: Qos) -> bool {
    offered.reliability == Reliability::BestEffort && requested.reliability == Reliability::Reliable
}

fn is_shorter(offered: Qos, requested: Qos) -> bool {
    offered.durability == Durability::Volatile && requested.durability == Durability::TransientLocal
}

fn is_slower(offered: Qos, requested: Qos) -> bool {
    time(offered.deadline) > time(requested.deadline)
}

fn is_less_alive(offered: Qos, requested: Qos) -> bool {
    offered.liveliness < requested.liveliness || time(offered.lease) > time(requested.lease)
}

fn time(time: Option<Duration>) -> Duration {
    time.filter(|time| !time.is_zero()).unwrap_or(Duration::MAX)
}

impl fmt::Display for QosClash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (offered, requested) = (&self.offered, &self.requested);
        f.write_str("not compatible:")?;
        for (at, policy) in self.policies().enumerate() {
            f.write_str(if at == 0 { " " } else { "; " })?;
            match policy {
                "reliability" => {
                    let (has, wants) = (offered.reliability, requested.reliability);
                    write!(f, "reliability {has:?} is offered, {wants:?} requested")?;
                }
                "durability" => {
                    let (has, wants) = (offered.durability, requested.durability);
                    write!(f, "durability {has:?} is offered, {wants:?} requested")?;
                }
                "liveliness" => {
                    let (has, wants) = (offered.liveliness, requested.liveliness);
                    let (lease, wanted) = (time(offered.lease), time(requested.lease));
                    let for_ever = |lease: Duration| (lease != Duration::MAX).then_some(lease);
                    let (lease, wanted) = (for_ever(lease), for_ever(wanted));
                    write!(
                        f,
                        "liveliness {has:?} with lease {lease:?} is offered, {wants:?} with {wanted:?} requested"
                    )?;
                }
                _ => match (offered.deadline, requested.deadline) {
                    (Some(has), Some(wants)) => {
                        write!(f, "deadline {has:?} is offered, {wants:?} requested")?;
                    }
                    (_, wants) => {
                        let wants = wants.unwrap_or(Duration::MAX);
                        write!(f, "no deadline is offered, {wants:?} requested")?;
                    }
                },
            }
        }
        Ok(())
    }
}

impl core::error::Error for QosClash {}

impl Qos {
    /// Whether a subscription that requests `requested` gets anything from a publisher that offers
    /// this: in ROS 2, endpoints that do not fit are not connected, silently. History, depth,
    /// lifespan and criticality never clash.
    ///
    /// ```
    /// use replenish::Qos;
    /// let clash = Qos::sensor_data().check_offers(Qos::latched()).unwrap_err();
    /// assert_eq!(
    ///     clash.to_string(),
    ///     "not compatible: reliability BestEffort is offered, Reliable requested; \
    ///      durability Volatile is offered, TransientLocal requested"
    /// );
    /// ```
    ///
    /// # Errors
    /// [`QosClash`], which names the policies.
    pub fn check_offers(self, requested: Self) -> Result<(), QosClash> {
        let clash = QosClash {
            offered: self,
            requested,
        };
        match clash.policies().next() {
            None => Ok(()),
            Some(_) => Err(clash),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qos::Liveliness;

    #[test]
    fn each_policy_clashes_in_one_direction_only() {
        let deadline = |ms| Qos::reliable().deadline(Duration::from_millis(ms));
        let lease = |ms| Qos::reliable().lease(Duration::from_millis(ms));
        let manual = Qos::reliable().liveliness(Liveliness::ManualByTopic);
        let pairs = [
            (Qos::reliable(), Qos::best_effort(), "reliability"),
            (
                Qos::reliable().transient_local(),
                Qos::reliable(),
                "durability",
            ),
            (deadline(5), deadline(6), "deadline"),
            (deadline(5), Qos::reliable(), "deadline"),
            (lease(5), lease(6), "liveliness"),
            (lease(5), Qos::reliable(), "liveliness"),
            (manual, Qos::reliable(), "liveliness"),
        ];
        for (strong, weak, policy) in pairs {
            assert_eq!(strong.check_offers(weak), Ok(()));
            assert_eq!(strong.check_offers(strong), Ok(()));
            let clash = weak.check_offers(strong).unwrap_err();
            assert!(clash.policies().eq([policy]), "{clash}");
            assert!(clash.to_string().contains(policy));
        }
        let history = Qos::reliable().keep_all(3).check_offers(Qos::reliable());
        assert_eq!(history, Ok(()));
    }
}
