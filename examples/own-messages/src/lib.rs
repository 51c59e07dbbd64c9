//! Messages of one's own, from `msgs/robot_msgs`.

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));

/// The same without a heap: every type is inline, bounded, and its own view.
pub mod inline {
    include!(concat!(env!("OUT_DIR"), "/inline/interfaces.rs"));
}
