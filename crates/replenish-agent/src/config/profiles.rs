//! Entities that clients describe by reference, with a name alone.
//!
//! The file format is that of eProsima's `agent.refs`: each profile is the XML that a client could
//! have sent itself, with the name as an attribute.

use replenish_os::config::ConfigError;
use replenish_xrce::wire::ObjectKind;
use std::collections::HashMap;

const TAGS: [(&str, ObjectKind); 8] = [
    ("participant", ObjectKind::Participant),
    ("topic", ObjectKind::Topic),
    ("publisher", ObjectKind::Publisher),
    ("subscriber", ObjectKind::Subscriber),
    ("data_writer", ObjectKind::DataWriter),
    ("data_reader", ObjectKind::DataReader),
    ("requester", ObjectKind::Requester),
    ("replier", ObjectKind::Replier),
];

/// The meaning of names, by kind of entity.
///
/// A name without a profile describes an entity, too, unless [`strict`](Self::strict): the name
/// itself, without a `__t`, `__dw`, `__dr`, `__req` or `__rep` that micro-ROS appends, is the name
/// of the topic or service and of its type. So endpoints by reference talk to each other without
/// any configuration, but not to endpoints that say more about themselves.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Profiles {
    profiles: HashMap<(u8, Box<str>), Box<str>>,
    strict: bool,
}

impl Profiles {
    /// Reads profiles in the format of eProsima's `agent.refs`.
    ///
    /// # Errors
    /// An element is not closed, or a profile has no name.
    pub fn parse(xml: &str) -> Result<Self, ConfigError> {
        let mut profiles = HashMap::new();
        let mut rest = xml;
        while let Some((_, after)) = rest.split_once('<') {
            rest = after;
            if let Some(comment) = after.strip_prefix("!--") {
                rest = comment.split_once("-->").map_or("", |(_, rest)| rest);
                continue;
            }
            let name_end = after.find(['>', '/', ' ', '\t', '\r', '\n']);
            let name = after.get(..name_end.unwrap_or(0)).unwrap_or_default();
            let Some((tag, kind)) = TAGS.iter().find(|(tag, _)| *tag == name) else {
                continue;
            };
            let (element, next) = split_element(after, tag).ok_or_else(|| wrong(after))?;
            let name = crate::xml::attribute(&format!("<{element}"), tag, "profile_name")
                .ok_or_else(|| wrong(after))?
                .into();
            profiles.insert((kind.number(), name), format!("<{element}").into());
            rest = next;
        }
        Ok(Self {
            profiles,
            strict: false,
        })
    }

    /// Refuses names without a profile.
    #[must_use]
    pub fn strict(self) -> Self {
        Self {
            strict: true,
            ..self
        }
    }

    /// The number of profiles.
    #[must_use]
    pub fn len(&self) -> usize {
        self.profiles.len()
    }

    /// Whether there is no profile.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.profiles.is_empty()
    }

    /// The meaning of `name`.
    pub(crate) fn find<'a>(&'a self, kind: ObjectKind, name: &'a str) -> Option<Profile<'a>> {
        let key = (kind.number(), name.into());
        match self.profiles.get(&key) {
            Some(xml) => Some(Profile::Xml(xml)),
            None if self.strict || name.is_empty() => None,
            None => Some(Profile::Name(plain(name))),
        }
    }
}

/// The meaning of a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Profile<'a> {
    /// The entity that this XML describes.
    Xml(&'a str),
    /// The name itself.
    Name(&'a str),
}

/// Splits after the first element, of which the `<` is already gone.
fn split_element<'a>(xml: &'a str, tag: &str) -> Option<(&'a str, &'a str)> {
    let opening = xml.find('>')?;
    let end = if xml.get(..opening)?.ends_with('/') {
        opening + 1
    } else {
        let close = format!("</{tag}>");
        xml.find(&close)? + close.len()
    };
    xml.split_at_checked(end)
}

fn wrong(at: &str) -> ConfigError {
    ConfigError {
        field: "profiles",
        value: at.chars().take(40).collect(),
        allowed: "closed elements with a profile_name".into(),
    }
}

fn plain(name: &str) -> &str {
    let suffixes = ["__t", "__dw", "__dr", "__req", "__rep"];
    let plain = suffixes.iter().find_map(|s| name.strip_suffix(s));
    plain.filter(|plain| !plain.is_empty()).unwrap_or(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REFS: &str = r#"<profiles>
        <!-- <topic profile_name="none"> -->
        <participant profile_name="p"><rtps><name>n</name></rtps></participant>
        <data_writer profile_name="w"><topic><name>Square</name><dataType>Shape</dataType></topic>
        </data_writer>
        <topic profile_name="t"><name>Square</name><dataType>Shape</dataType></topic>
        <requester profile_name="r" service_name="s" request_type="a" reply_type="b"/>
    </profiles>"#;

    #[test]
    fn profiles_are_found_by_kind_and_name() {
        let profiles = Profiles::parse(REFS).unwrap().strict();
        assert_eq!(profiles.len(), 4);
        let xml = "<requester profile_name=\"r\" service_name=\"s\" request_type=\"a\" \
                   reply_type=\"b\"/>";
        assert_eq!(
            profiles.find(ObjectKind::Requester, "r"),
            Some(Profile::Xml(xml))
        );
        assert!(profiles.find(ObjectKind::Topic, "t").is_some());
        assert_eq!(profiles.find(ObjectKind::Topic, "w"), None);
        assert_eq!(profiles.find(ObjectKind::Topic, "none"), None);
    }

    #[test]
    fn a_name_without_a_profile_is_a_name() {
        let profiles = Profiles::default();
        let of = |name| profiles.find(ObjectKind::DataReader, name);
        assert_eq!(of("chatter__dr"), Some(Profile::Name("chatter")));
        assert_eq!(of("chatter"), Some(Profile::Name("chatter")));
        assert_eq!(of("__t"), Some(Profile::Name("__t")));
        assert_eq!(of(""), None);
    }

    #[test]
    fn what_is_not_closed_or_has_no_name_is_an_error() {
        for text in ["<topic profile_name=\"t\">", "<topic></topic>", "<topic a"] {
            let error = Profiles::parse(text).map(|profiles| profiles.len());
            assert!(error.is_err(), "{text}");
        }
        assert!(Profiles::parse("").unwrap().is_empty());
    }
}
