//! The variables that ROS reads.

use crate::error::ArgsError;
use crate::name;

/// The environment's part in a program's arguments; an argument goes before its variable.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Environment {
    /// `ROS_NAMESPACE`: the namespace of nodes that have none in the program.
    pub namespace: Option<String>,
    /// `ROS_DOMAIN_ID`, 0 to 232.
    pub domain: Option<u8>,
    /// `ROS_SECURITY_ENCLAVE_OVERRIDE`.
    pub enclave: Option<String>,
    /// `RCUTILS_COLORIZED_OUTPUT`: colours even without a terminal, or never.
    pub colours: Option<bool>,
}

impl Environment {
    /// The settings in variables as `of` gives them. An empty variable counts as none.
    ///
    /// # Errors
    /// The first variable out of its range.
    pub fn read(of: impl Fn(&str) -> Option<String>) -> Result<Self, ArgsError> {
        let set = |name: &str| of(name).filter(|value| !value.is_empty());
        let wrong = |name: &str, value: &str, why: &str| Err(ArgsError::new(name, value, why));
        let namespace = set("ROS_NAMESPACE").map(|ns| name::absolute(&ns));
        if let Some(Err(why)) = namespace.as_ref().map(|ns| name::check(ns)) {
            let given = set("ROS_NAMESPACE").unwrap_or_default();
            return wrong("ROS_NAMESPACE", &given, why);
        }
        let domain = match set("ROS_DOMAIN_ID") {
            None => None,
            Some(text) => match text.trim().parse::<u8>() {
                Ok(domain) if domain <= 232 => Some(domain),
                _ => return wrong("ROS_DOMAIN_ID", &text, "allowed is 0 to 232"),
            },
        };
        let colours = match set("RCUTILS_COLORIZED_OUTPUT").as_deref() {
            None => None,
            Some("0") => Some(false),
            Some("1") => Some(true),
            Some(other) => return wrong("RCUTILS_COLORIZED_OUTPUT", other, "allowed is 0 or 1"),
        };
        Ok(Self {
            namespace,
            domain,
            enclave: set("ROS_SECURITY_ENCLAVE_OVERRIDE"),
            colours,
        })
    }
}
