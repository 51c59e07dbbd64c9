//! Type hashes: RIHS01, the SHA-256 of a type's description as JSON (ROS REP 2016).
//!
//! The description has the fields of the type and of all types that it contains, without default
//! values and constants. Services and actions are types as well, made of their parts and of what
//! ROS 2 adds to them.

use crate::model::{Base, Definition, Field, Interface, Primitive, Shape, TypeName};
use crate::registry::Registry;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;

/// A type of the description: its fields as JSON, and the types that they contain.
#[derive(Default)]
struct Described {
    fields: Vec<String>,
    inner: Vec<TypeName>,
}

impl Described {
    fn add(
        &mut self,
        name: &str,
        kind: u8,
        capacity: usize,
        text: usize,
        nested: Option<&TypeName>,
    ) {
        let inner = nested.map(ToString::to_string).unwrap_or_default();
        self.fields.push(format!(
            "{{\"name\": \"{name}\", \"type\": {{\"type_id\": {kind}, \"capacity\": {capacity}, \
             \"string_capacity\": {text}, \"nested_type_name\": \"{inner}\"}}}}"
        ));
        self.inner.extend(nested.cloned());
    }

    /// A field of a message type.
    fn nested(mut self, name: &str, inner: &TypeName) -> Self {
        self.add(name, NESTED, 0, 0, Some(inner));
        self
    }

    /// At most one of a message type.
    fn optional(mut self, name: &str, inner: &TypeName) -> Self {
        self.add(name, NESTED + BOUNDED, 1, 0, Some(inner));
        self
    }

    fn field(&mut self, field: &Field) {
        let (kind, text, nested) = match &field.base {
            Base::Primitive(p) => (primitive(*p), 0, None),
            Base::Text(None) => (17, 0, None),
            Base::Wide(None) => (18, 0, None),
            Base::Text(Some(bound)) => (21, *bound, None),
            Base::Wide(Some(bound)) => (22, *bound, None),
            Base::Message(name) => (NESTED, 0, Some(name)),
        };
        let (shape, capacity) = match field.shape {
            Shape::One => (0, 0),
            Shape::Array(size) => (ARRAY, size),
            Shape::Sequence(Some(bound)) => (BOUNDED, bound),
            Shape::Sequence(None) => (UNBOUNDED, 0),
        };
        self.add(&field.name, kind + shape, capacity, text, nested);
    }

    fn json(&self, name: &TypeName) -> String {
        let fields = self.fields.join(", ");
        format!("{{\"type_name\": \"{name}\", \"fields\": [{fields}]}}")
    }
}

// type_description_interfaces/msg/FieldType
const NESTED: u8 = 1;
const ARRAY: u8 = 48;
const BOUNDED: u8 = 96;
const UNBOUNDED: u8 = 144;

fn primitive(p: Primitive) -> u8 {
    match p {
        Primitive::Int8 => 2,
        Primitive::UInt8 | Primitive::Char => 3, // a `char` of a .msg file is a `uint8` of IDL
        Primitive::Int16 => 4,
        Primitive::UInt16 => 5,
        Primitive::Int32 => 6,
        Primitive::UInt32 => 7,
        Primitive::Int64 => 8,
        Primitive::UInt64 => 9,
        Primitive::Float32 => 10,
        Primitive::Float64 => 11,
        Primitive::Bool => 15,
        Primitive::Byte => 16,
    }
}

fn described(definition: &Definition) -> Described {
    let mut described = Described::default();
    definition.fields.iter().for_each(|f| described.field(f));
    if definition.fields.is_empty() {
        described.add("structure_needs_at_least_one_member", 3, 0, 0, None);
    }
    described
}

/// The types that ROS 2 makes for a service named `name`.
fn service(name: &TypeName, made: &mut BTreeMap<TypeName, Described>) {
    let [request, response, event] = ["_Request", "_Response", "_Event"].map(|s| name.with(s));
    let info = TypeName::new("service_msgs", "msg", "ServiceEventInfo");
    let whole = Described::default()
        .nested("request_message", &request)
        .nested("response_message", &response)
        .nested("event_message", &event);
    let observed = Described::default()
        .nested("info", &info)
        .optional("request", &request)
        .optional("response", &response);
    made.insert(name.clone(), whole);
    made.insert(event, observed);
}

/// The types that ROS 2 makes for an action named `name`.
fn action(name: &TypeName, made: &mut BTreeMap<TypeName, Described>) {
    let part = |suffix: &str| name.with(suffix);
    let id = TypeName::new("unique_identifier_msgs", "msg", "UUID");
    let time = TypeName::new("builtin_interfaces", "msg", "Time");
    let mut accepted = Described::default();
    accepted.add("accepted", primitive(Primitive::Bool), 0, 0, None);
    let mut status = Described::default();
    status.add("status", primitive(Primitive::Int8), 0, 0, None);
    let whole = Described::default()
        .nested("goal", &part("_Goal"))
        .nested("result", &part("_Result"))
        .nested("feedback", &part("_Feedback"))
        .nested("send_goal_service", &part("_SendGoal"))
        .nested("get_result_service", &part("_GetResult"))
        .nested("feedback_message", &part("_FeedbackMessage"));
    let goal = Described::default()
        .nested("goal_id", &id)
        .nested("goal", &part("_Goal"));
    let feedback = Described::default()
        .nested("goal_id", &id)
        .nested("feedback", &part("_Feedback"));
    made.insert(name.clone(), whole);
    made.insert(part("_SendGoal_Request"), goal);
    made.insert(part("_SendGoal_Response"), accepted.nested("stamp", &time));
    made.insert(
        part("_GetResult_Request"),
        Described::default().nested("goal_id", &id),
    );
    made.insert(
        part("_GetResult_Response"),
        status.nested("result", &part("_Result")),
    );
    made.insert(part("_FeedbackMessage"), feedback);
    service(&part("_SendGoal"), made);
    service(&part("_GetResult"), made);
}

/// The hash of a message or of a part.
pub(crate) fn message(registry: &Registry, name: &TypeName) -> Option<String> {
    hash(registry, name, &BTreeMap::new())
}

/// The hash of an interface as a whole. None if a type that ROS 2 adds to it is not there:
/// `service_msgs`, `unique_identifier_msgs` or `builtin_interfaces`.
pub(crate) fn interface(registry: &Registry, interface: &Interface) -> Option<String> {
    let mut made = BTreeMap::new();
    match interface.name.kind {
        "srv" => service(&interface.name, &mut made),
        "action" => action(&interface.name, &mut made),
        _ => {}
    }
    hash(registry, &interface.name, &made)
}

fn hash(
    registry: &Registry,
    name: &TypeName,
    made: &BTreeMap<TypeName, Described>,
) -> Option<String> {
    let mut all = BTreeMap::new();
    let mut open = vec![name.clone()];
    while let Some(next) = open.pop() {
        if all.contains_key(&next) {
            continue;
        }
        let (json, inner) = match made.get(&next) {
            Some(described) => (described.json(&next), described.inner.clone()),
            None => {
                let described = described(&registry.get(&next)?.definition);
                (described.json(&next), described.inner)
            }
        };
        open.extend(inner);
        all.insert(next, json);
    }
    let own = all.remove(name)?;
    // Sorted by the whole name as text, which is not the order of its components.
    let mut inner: Vec<_> = all
        .into_iter()
        .map(|(name, json)| (name.to_string(), json))
        .collect();
    inner.sort();
    let inner: Vec<_> = inner.into_iter().map(|(_, json)| json).collect();
    let description = format!(
        "{{\"type_description\": {own}, \"referenced_type_descriptions\": [{}]}}",
        inner.join(", ")
    );
    let mut text = String::from("RIHS01_");
    for byte in Sha256::digest(description) {
        write!(text, "{byte:02x}").ok()?;
    }
    Some(text)
}
