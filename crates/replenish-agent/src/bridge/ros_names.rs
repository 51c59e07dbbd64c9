//! The names of ROS 2 for those on the wire, for people who read tables and logs.

/// `/chatter` for `rt/chatter`; `/add` for `rq/addRequest` and `rr/addReply`. A name of another
/// form stays as it is.
#[must_use]
pub fn ros_topic(name: &str) -> String {
    let service = |suffix| name.get(2..).and_then(|rest| rest.strip_suffix(suffix));
    let found = match name.get(..3) {
        Some("rt/") => name.get(2..),
        Some("rq/") => service("Request"),
        Some("rr/") => service("Reply"),
        _ => None,
    };
    found.unwrap_or(name).to_string()
}

/// `std_msgs/msg/String` for `std_msgs::msg::dds_::String_`, and `a/srv/Add` for
/// `a::srv::dds_::Add_Request_` and `a::srv::dds_::Add_Response_`. A name of another form stays as
/// it is.
#[must_use]
pub fn ros_type(name: &str) -> String {
    let found = name.split_once("::dds_::").and_then(|(space, rest)| {
        let mut own = rest.strip_suffix('_')?;
        if space.ends_with("::srv") {
            let request = own.strip_suffix("_Request");
            own = request.or(own.strip_suffix("_Response")).unwrap_or(own);
        }
        Some(format!("{}/{own}", space.replace("::", "/")))
    });
    found.unwrap_or_else(|| name.to_string())
}

/// `/talker` for a participant called `talker` or `/talker`.
pub(crate) fn ros_node(name: &str) -> String {
    format!("/{}", name.trim_start_matches('/'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_on_the_wire_are_those_of_ros() {
        for (wire, ros) in [
            ("rt/chatter", "/chatter"),
            ("rt/a/b", "/a/b"),
            ("rq/addRequest", "/add"),
            ("rr/ns/addReply", "/ns/add"),
            ("rq/add", "rq/add"),
            ("DCPSTopic", "DCPSTopic"),
            ("é", "é"),
            ("", ""),
        ] {
            assert_eq!(ros_topic(wire), ros);
        }
        for (wire, ros) in [
            ("std_msgs::msg::dds_::String_", "std_msgs/msg/String"),
            ("a::srv::dds_::Add_Request_", "a/srv/Add"),
            ("a::srv::dds_::Add_Response_", "a/srv/Add"),
            ("Plain", "Plain"),
        ] {
            assert_eq!(ros_type(wire), ros);
        }
        assert_eq!(ros_node("talker"), "/talker");
    }
}
