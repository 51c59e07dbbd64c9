//! The names that a refusal is about, as ROS 2 has them.

use std::fmt;

/// The topic, service or node that was refused.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Subject {
    /// `/chatter`, the service `/add`, or the node `/talker`.
    pub name: String,
    /// `std_msgs/msg/String`; empty for a node.
    pub type_name: String,
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // The names of a client that were refused for what is in them are shown, too.
        let shown = |name: &str| -> String {
            let shown = name.chars().take(255);
            shown
                .map(|c| if c.is_control() { '?' } else { c })
                .collect()
        };
        if self.type_name.is_empty() {
            write!(f, "node {}", shown(&self.name))
        } else {
            write!(f, "{} ({})", shown(&self.name), shown(&self.type_name))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_shown_without_what_a_terminal_obeys() {
        let subject = |name: &str, type_name: &str| Subject {
            name: name.into(),
            type_name: type_name.into(),
        };
        let topic = subject("/chatter", "std_msgs/msg/String");
        assert_eq!(topic.to_string(), "/chatter (std_msgs/msg/String)");
        assert_eq!(subject("/a\x1b[2J", "").to_string(), "node /a?[2J");
        assert!(subject(&"n".repeat(5000), "").to_string().len() < 300);
    }
}
