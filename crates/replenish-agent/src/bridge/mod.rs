//! The way to another middleware: the seam itself, and the names that may cross.

mod names;
mod ros_names;
mod seam;

pub(crate) use names::MOST_DOMAINS;
pub(crate) use names::{Asker, NameRefusal, Names};
pub(crate) use ros_names::ros_node;
pub use ros_names::{ros_topic, ros_type};
pub(crate) use seam::Bridge;
pub(crate) use seam::MAX_BYTES;
pub use seam::{BridgeEvent, BridgeId, BridgeKind, BridgeQos, BridgeSample, BridgeTopic};
