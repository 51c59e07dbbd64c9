//! The arguments as a program asks them.

use crate::environment::Environment;
use crate::error::ArgsError;
use crate::flags::{self, Said};
use crate::log::LogArgs;
use crate::name;
use crate::parameters::{self, Override};
use crate::pattern;
use crate::rule::{Kind, Target};

/// The arguments of a program. Empty by default: then every name stays as it is.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RosArgs {
    said: Said,
    environment: Environment,
}

impl RosArgs {
    /// The ROS arguments of this process: its arguments and its environment.
    ///
    /// # Errors
    /// [`ArgsError`]: the argument or variable, its place, and what is allowed.
    pub fn from_env() -> Result<Self, ArgsError> {
        let mut args = Vec::new();
        for (index, argument) in std::env::args_os().enumerate() {
            let text = argument.into_string();
            let wrong = |text: std::ffi::OsString| {
                ArgsError::argument(index, &text.to_string_lossy(), "it is not UTF-8")
            };
            args.push(text.map_err(wrong)?);
        }
        let environment = Environment::read(|name| std::env::var(name).ok())?;
        Self::parse(args, &environment)
    }

    /// The ROS arguments in `args`, the program's name first. Reads the files they name.
    ///
    /// # Errors
    /// As [`from_env`](Self::from_env).
    pub fn parse(
        args: impl IntoIterator<Item = String>,
        environment: &Environment,
    ) -> Result<Self, ArgsError> {
        Self::parse_with(args, environment, &flags::read_file)
    }

    /// As [`parse`](Self::parse), with the files' texts from `read`.
    ///
    /// # Errors
    /// As [`from_env`](Self::from_env).
    pub fn parse_with(
        args: impl IntoIterator<Item = String>,
        environment: &Environment,
        read: &dyn Fn(&str) -> std::io::Result<String>,
    ) -> Result<Self, ArgsError> {
        Ok(Self {
            said: flags::walk(args.into_iter().collect(), read)?,
            environment: environment.clone(),
        })
    }

    /// The arguments that are not ROS's, the program's name first.
    #[must_use]
    pub fn rest(&self) -> &[String] {
        &self.said.rest
    }

    /// `-e`, or its variable.
    #[must_use]
    pub fn enclave(&self) -> Option<&str> {
        let variable = self.environment.enclave.as_deref();
        self.said.enclave.as_deref().or(variable)
    }

    /// The options about logging.
    #[must_use]
    pub fn log(&self) -> &LogArgs {
        &self.said.log
    }

    /// The variables.
    #[must_use]
    pub fn environment(&self) -> &Environment {
        &self.environment
    }

    /// The name of a node that the program calls `given`, a fully qualified name. `fixed`: the
    /// program has said the namespace, and `ROS_NAMESPACE` does not matter.
    ///
    /// `node:__node:=new` looks at the name in the program, `node:__ns:=/new` at the new one, as in
    /// `rcl`. The first rule that fits wins.
    ///
    /// # Errors
    /// A name that ROS does not allow.
    pub fn node(&self, given: &str, fixed: bool) -> Result<String, ArgsError> {
        let (namespace, token) = name::split(given);
        let first = |is: fn(&Target) -> bool, node: &str| {
            let mut rules = self.said.rules.iter();
            let rule = rules.find(|rule| is(&rule.target) && rule.concerns(node));
            rule.map(|rule| rule.to.as_str())
        };
        let token = first(|t| *t == Target::Node, token).unwrap_or(token);
        let variable = self.environment.namespace.as_deref().filter(|_| !fixed);
        let namespace = first(|t| *t == Target::Namespace, token)
            .or(variable)
            .unwrap_or(namespace);
        Ok(name::join(namespace, token))
    }

    /// Replaces `{node}`, `{ns}` and `{namespace}` in a name as the program gives it, for the node
    /// with this fully qualified name.
    ///
    /// # Errors
    /// Other names in braces.
    pub fn substitute(given: &str, node: &str) -> Result<String, ArgsError> {
        name::substitute(given, node).map_err(|why| ArgsError::new("name", given, why))
    }

    /// The name by which `full`, a fully qualified name of `node`, is known: the first rule that
    /// fits.
    ///
    /// # Errors
    /// A rule that makes a name of it that ROS does not allow.
    pub fn name(&self, kind: Kind, full: &str, node: &str) -> Result<String, ArgsError> {
        let (_, token) = name::split(node);
        for rule in self.said.rules.iter().filter(|rule| rule.concerns(token)) {
            let Target::Name {
                pattern,
                kind: only,
            } = &rule.target
            else {
                continue;
            };
            if only.is_some_and(|only| only != kind) {
                continue;
            }
            let wrong = |why: String| ArgsError::new("remapping", full, why);
            // The parts of an action follow the action; a wildcard would move them twice.
            if full.contains("/_action/") && pattern.contains('*') {
                continue;
            }
            let pattern = name::expand(pattern, node).map_err(wrong)?;
            let Some(captures) = pattern::matches(&pattern, full) else {
                continue;
            };
            let filled = pattern::fill(&rule.to, &captures);
            let new = name::expand(&filled, node).map_err(wrong)?;
            let good = name::check(&new).is_ok() && new != "/";
            let why = || format!("{:?} makes {new:?} of it, which is not a name", rule.to);
            return if good { Ok(new) } else { Err(wrong(why())) };
        }
        Ok(full.into())
    }

    /// The value from outside of a parameter of `node`, a fully qualified name. The last one that
    /// was said wins, in a file as on the command line.
    #[must_use]
    pub fn parameter(&self, node: &str, name: &str) -> Option<&Override> {
        let mut given = self.said.parameters.iter().rev();
        given.find(|given| given.name == name && parameters::concerns(given, node))
    }

    /// All values from outside for `node`, later ones behind those that they replace.
    pub fn parameters(&self, node: &str) -> impl Iterator<Item = &Override> {
        let given = self.said.parameters.iter();
        given.filter(move |given| parameters::concerns(given, node))
    }
}
