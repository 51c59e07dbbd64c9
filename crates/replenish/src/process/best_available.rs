//! `best_available` of ROS 2: the quality that fits the peers which are there.

use super::Kind;
use crate::context::Node;
use crate::error::Error;
use crate::qos::{Durability, Qos, Reliability};
use std::vec::Vec;

impl Node {
    /// ROS 2's profile `best_available` for a subscription to `topic`: the strictest quality that
    /// every publisher satisfies which is known at this moment, keep last 10. Reliable if all of
    /// them are, late samples if all of them keep some, the longest of their deadlines. Without a
    /// publisher it is reliable and transient local, as in rmw.
    ///
    /// It is chosen once, and does not follow publishers that come later. Discovery takes time:
    /// call it when the publishers can be expected to be known.
    ///
    /// ```
    /// use replenish::{Context, Qos, msg::std_msgs::Int32, qos::Reliability};
    /// let node = Context::in_process().node("n")?;
    /// let _scan = node.publisher::<Int32>("scan", Qos::sensor_data())?;
    /// let qos = node.best_available_subscription("scan")?;
    /// assert_eq!(qos.reliability, Reliability::BestEffort);
    /// # Ok::<(), replenish::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Middleware`] where the middleware does not know its peers: DDS-XRCE. A name that is
    /// refused.
    pub fn best_available_subscription(&self, topic: &str) -> Result<Qos, Error> {
        Ok(subscription(&self.ends(topic, true)?))
    }

    /// ROS 2's profile `best_available` for a publisher on `topic`: reliable and transient local,
    /// which satisfies every subscription, keep last 10, with the shortest deadline that a
    /// subscription asks for which is known at this moment.
    ///
    /// # Errors
    /// As for [`Node::best_available_subscription`].
    pub fn best_available_publisher(&self, topic: &str) -> Result<Qos, Error> {
        Ok(publisher(&self.ends(topic, false)?))
    }

    /// The qualities of those that write to a topic, or read it.
    fn ends(&self, topic: &str, write: bool) -> Result<Vec<Qos>, Error> {
        let name = self.resolve(Kind::Topic, topic)?;
        let topics = self.graph()?.topics.into_iter();
        let of_name = topics.filter(|topic| topic.name == name);
        let ends = of_name.map(|topic| {
            if write {
                topic.publishers
            } else {
                topic.subscriptions
            }
        });
        Ok(ends.flatten().collect())
    }
}

/// As `qos_profile_get_best_available_for_subscription` of `rmw_dds_common` chooses.
fn subscription(publishers: &[Qos]) -> Qos {
    let all = |holds: fn(&Qos) -> bool| publishers.iter().all(holds);
    let deadline = publishers.iter().filter_map(|qos| qos.deadline).max();
    // A publisher without a deadline offers none: a subscription that asks for one does not hear
    // it.
    let promised = all(|qos| qos.deadline.is_some());
    Qos {
        reliability: if all(|qos| qos.reliability == Reliability::Reliable) {
            Reliability::Reliable
        } else {
            Reliability::BestEffort
        },
        durability: if all(|qos| qos.durability == Durability::TransientLocal) {
            Durability::TransientLocal
        } else {
            Durability::Volatile
        },
        deadline: deadline.filter(|_| promised),
        ..Qos::reliable()
    }
}

/// As `qos_profile_get_best_available_for_publisher` of `rmw_dds_common` chooses.
fn publisher(subscriptions: &[Qos]) -> Qos {
    Qos {
        deadline: subscriptions.iter().filter_map(|qos| qos.deadline).min(),
        ..Qos::reliable().transient_local()
    }
}
