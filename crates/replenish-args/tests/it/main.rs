//! Arguments, remapping and files of parameters, in one binary.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod arguments;
mod files;
mod properties;
mod remapping;

use replenish_args::{ArgsError, Environment, RosArgs};

/// A command line without its program's name; files come from `yaml`.
fn parse_with(line: &str, yaml: &str) -> Result<RosArgs, ArgsError> {
    let args = ["program"].into_iter().chain(line.split_whitespace());
    let read = |name: &str| match name {
        "missing.yaml" => Err(std::io::Error::from(std::io::ErrorKind::NotFound)),
        _ => Ok(yaml.to_owned()),
    };
    RosArgs::parse_with(args.map(String::from), &Environment::default(), &read)
}

fn parse(line: &str) -> RosArgs {
    parse_with(line, "").unwrap()
}

fn refused(line: &str) -> String {
    parse_with(line, "").unwrap_err().to_string()
}
