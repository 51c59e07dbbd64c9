//! Hashes of the types of common packages: an XRCE client says a type's name only, and ROS 2's
//! tools show a hash.
//!
//! The table is written from `replenish-interfaces`, whose tests compare it. The agent does not
//! depend on that crate, which takes long to build.

use replenish_rtps::ros::ros_type;
use replenish_rtps::wire::TypeHash;

/// A line for each message and service: `std_msgs/msg/Int32 RIHS01_b6578d…`.
const TABLE: &str = include_str!("type_hashes.txt");

/// The hash of a type of DDS, as ROS 2 Kilted has it; `None` if the table does not know it.
/// Requests and replies have that of their service.
pub(super) fn type_hash(dds: &str) -> Option<TypeHash> {
    let ros = ros_type(dds)?;
    let name = ros.as_str();
    let service = ["_Request", "_Response"].iter().find_map(|end| {
        let service = name.strip_suffix(end)?;
        service.contains("/srv/").then_some(service)
    });
    let name = service.unwrap_or(name);
    let of = |line: &'static str| line.strip_prefix(name)?.strip_prefix(' ');
    let text = TABLE.lines().find_map(of)?;
    TypeHash::find(format!("typehash={text};").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_and_both_parts_of_a_service_are_known_by_their_names() {
        let hash =
            |name: &str| type_hash(name).map(|hash| hash.0.map(|b| format!("{b:02x}")).concat());
        // As rclpy shows them.
        let string = "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
        assert_eq!(
            hash("std_msgs::msg::dds_::String_").as_deref(),
            Some(string)
        );
        let add = "e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a";
        for part in ["Request", "Response"] {
            let name = format!("example_interfaces::srv::dds_::AddTwoInts_{part}_");
            assert_eq!(hash(&name).as_deref(), Some(add));
        }
        for unknown in [
            "std_msgs::msg::dds_::Int3_",
            "own::msg::dds_::String_",
            "String",
            "",
        ] {
            assert_eq!(type_hash(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn every_line_is_a_name_and_a_hash() {
        for line in TABLE.lines() {
            let (name, hash) = line.split_once(' ').unwrap();
            assert_eq!(name.split('/').count(), 3, "{line}");
            assert!(TypeHash::find(format!("typehash={hash};").as_bytes()).is_some());
        }
    }
}
