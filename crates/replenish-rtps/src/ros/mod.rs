//! ROS 2's part: names of topics and types, and the graph of nodes.
//!
//! ```text
//!   names   /chatter ◄──► rt/chatter, std_msgs/msg/Int32 ◄──► std_msgs::msg::dds_::Int32_
//!   graph   ros_discovery_info: which nodes a participant has, and which endpoints are theirs
//!   known   the nodes of other participants, from theirs
//! ```

mod graph;
mod known;
mod names;

pub use graph::{
    GRAPH_QOS, GRAPH_TOPIC, GRAPH_TYPE, GidSize, Gids, Node, Nodes, RemoteNode, encode_graph,
};
pub use known::{KnownNodes, NodeLimits};
pub use names::{DdsName, Prefix, dds_topic, dds_type, ros_topic, ros_type};
