//! How many peers an endpoint has, those of this participant included. All endpoints of the
//! domain, in the names of ROS 2.

use super::adapter::Rtps;
use super::qos::ros;
use crate::middleware::{GraphEnd, ReaderId, WriterId};
use replenish_rtps::endpoint::{Reader, Writer};
use replenish_rtps::ros::{Prefix, ros_topic, ros_type};

impl Rtps {
    pub(super) fn count_readers(&self, writer: WriterId) -> Option<usize> {
        // A thread that waits for a peer may be the only one that looks after discovery.
        self.look_after_discovery();
        let state = self.state.lock();
        let id = state.writers.get(usize::from(writer.0))?.id?;
        state.participant.writer(id).map(Writer::matched)
    }

    pub(super) fn count_writers(&self, reader: ReaderId) -> Option<usize> {
        self.look_after_discovery();
        let state = self.state.lock();
        let id = state.readers.get(usize::from(reader.0))?.id?;
        state.participant.reader(id).map(Reader::matched)
    }

    /// Endpoints that ROS 2 has not made are left out, and so are replies: their service is known
    /// by its requests.
    pub(super) fn every_end(&self, each: &mut dyn FnMut(&GraphEnd<'_>)) {
        self.look_after_discovery();
        let state = self.state.lock();
        let owners = state.graph.owners(state.participant.prefix());
        for end in state.participant.all_endpoints() {
            let (Some((prefix, name)), Some(dds)) =
                (ros_topic(end.topic()), ros_type(end.type_name()))
            else {
                continue;
            };
            let service = prefix != Prefix::Topic;
            if prefix == Prefix::Reply {
                continue;
            }
            let type_name = dds.as_str();
            let requested = type_name.strip_suffix("_Request").filter(|_| service);
            each(&GraphEnd {
                name,
                type_name: requested.unwrap_or(type_name),
                service,
                writes: !end.guid.entity.is_reader(),
                qos: ros(&end.qos),
                node: owners.get(&end.guid.to_bytes()).copied(),
            });
        }
    }

    pub(super) fn every_node(&self, each: &mut dyn FnMut(&str)) {
        self.look_after_discovery();
        self.state.lock().graph.names().for_each(each);
    }
}
