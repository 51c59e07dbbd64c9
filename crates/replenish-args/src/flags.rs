//! The walk over the arguments.

use crate::error::ArgsError;
use crate::log::{LogArgs, LogLevel};
use crate::parameters::{self, Override};
use crate::rule::Rule;
use crate::yaml::Source;

/// The largest file of parameters, in bytes.
const FILE: u64 = 16 << 20;

/// Everything that may stand behind `--ros-args`.
const KNOWN: &str = "-r, -p, --params-file, -e, --log-level, --log-config-file, --log-file-name, \
                     --[en|dis]able-stdout-logs, --[en|dis]able-rosout-logs and \
                     --[en|dis]able-external-lib-logs are; -- ends them";

/// Everything that the arguments say.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Said {
    pub(crate) rest: Vec<String>,
    pub(crate) rules: Vec<Rule>,
    pub(crate) parameters: Vec<Override>,
    pub(crate) enclave: Option<String>,
    pub(crate) log: LogArgs,
}

/// Reads the text of a file.
pub(crate) type Read<'a> = &'a dyn Fn(&str) -> std::io::Result<String>;

pub(crate) fn walk(args: Vec<String>, read: Read<'_>) -> Result<Said, ArgsError> {
    let mut out = Said::default();
    let mut args = args.into_iter().enumerate();
    let mut inside = false;
    while let Some((index, argument)) = args.next() {
        match argument.as_str() {
            "--ros-args" => inside = true,
            "--" if inside => inside = false,
            _ if !inside => out.rest.push(argument),
            _ => {
                let mut value = || match args.next() {
                    Some((at, value)) => Ok((at, value)),
                    None => Err(ArgsError::argument(
                        index,
                        &argument,
                        "its value is missing",
                    )),
                };
                one(index, &argument, &mut value, read, &mut out)?;
            }
        }
    }
    Ok(out)
}

fn one(
    index: usize,
    flag: &str,
    value: &mut dyn FnMut() -> Result<(usize, String), ArgsError>,
    read: Read<'_>,
    out: &mut Said,
) -> Result<(), ArgsError> {
    match flag {
        "-r" | "--remap" => {
            let (at, text) = value()?;
            let rule = Rule::parse(&text);
            out.rules
                .push(rule.map_err(|why| ArgsError::argument(at, &text, why))?);
        }
        "-p" | "--param" => {
            let (at, text) = value()?;
            let given = parameters::assignment(&text, &format!("argument {at}"));
            let given = given.map_err(|why| ArgsError::argument(at, &text, why))?;
            out.parameters.push(given);
        }
        "--params-file" => {
            let (at, name) = value()?;
            let text = read(&name).map_err(|e| ArgsError::argument(at, &name, e.to_string()))?;
            let source = Source {
                name: &name,
                text: &text,
            };
            parameters::file(source, &mut out.parameters)?;
        }
        "-e" | "--enclave" => {
            let (at, text) = value()?;
            crate::name::check(&text)
                .map_err(|why| ArgsError::argument(at, &text, format!("not an enclave: {why}")))?;
            out.enclave = Some(text);
        }
        "--log-level" => {
            let (at, text) = value()?;
            let (logger, level) = match text.split_once(":=") {
                Some((logger, level)) => (Some(logger), level),
                None => (None, text.as_str()),
            };
            let Some(level) = LogLevel::named(level) else {
                let why = format!("allowed is {}, also as logger:=level", LogLevel::ALLOWED);
                return Err(ArgsError::argument(at, &text, why));
            };
            match logger {
                Some(logger) => out.log.loggers.push((logger.into(), level)),
                None => out.log.level = Some(level),
            }
        }
        "--log-config-file" => out.log.config_file = Some(value()?.1),
        "--log-file-name" => out.log.file_name = Some(value()?.1),
        "--enable-stdout-logs" => out.log.stdout = true,
        "--disable-stdout-logs" => out.log.stdout = false,
        "--enable-rosout-logs" => out.log.rosout = true,
        "--disable-rosout-logs" => out.log.rosout = false,
        "--enable-external-lib-logs" => out.log.external_lib = true,
        "--disable-external-lib-logs" => out.log.external_lib = false,
        _ => {
            let why = format!("not known behind --ros-args: {KNOWN}");
            return Err(ArgsError::argument(index, flag, why));
        }
    }
    Ok(())
}

/// Reads a file of bounded size.
pub(crate) fn read_file(name: &str) -> std::io::Result<String> {
    use std::io::{Error, Read as _};
    let mut text = String::new();
    let file = std::fs::File::open(name)?;
    file.take(FILE + 1).read_to_string(&mut text)?;
    if text.len() as u64 > FILE {
        return Err(Error::other("longer than 16 MiB, which is the limit"));
    }
    Ok(text)
}
