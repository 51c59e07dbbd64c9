//! Lines of a log as `rcutils` shows them. Writing them is the caller's.

use crate::log::LogLevel;
use core::fmt::Write;

/// `rcutils`' default.
const USUAL: &str = "[{severity}] [{time}] [{name}]: {message}";

/// A line of a log, with everything that may be shown of it.
#[derive(Debug, Clone, Copy)]
pub struct LogLine<'a> {
    /// The wall clock in nanoseconds since 1970.
    pub stamp: u64,
    /// Its severity.
    pub level: LogLevel,
    /// The logger's name.
    pub name: &'a str,
    /// The message.
    pub text: &'a str,
    /// The source file.
    pub file: &'a str,
    /// The function or module.
    pub function: &'a str,
    /// The line in the file.
    pub line: u32,
}

#[derive(Debug, PartialEq, Eq)]
enum Part {
    Plain(String),
    Severity,
    Time,
    Nanoseconds,
    Name,
    Message,
    Function,
    File,
    Line,
}

/// Form of the lines of a log, and whether they go to standard output instead of standard error.
#[derive(Debug)]
pub struct ConsoleFormat {
    parts: Vec<Part>,
    colours: bool,
    stdout: bool,
}

impl ConsoleFormat {
    /// As variables say that `variable` gives: `RCUTILS_CONSOLE_OUTPUT_FORMAT`,
    /// `RCUTILS_COLORIZED_OUTPUT`, `NO_COLOR`, `RCUTILS_LOGGING_USE_STDOUT`. `colours` goes before
    /// them. `terminal`: whether standard output (true) or standard error is one.
    #[must_use]
    pub fn read(
        variable: impl Fn(&str) -> Option<String>,
        colours: Option<bool>,
        terminal: impl Fn(bool) -> bool,
    ) -> Self {
        let set = |name| variable(name).filter(|value| !value.is_empty());
        let stdout = set("RCUTILS_LOGGING_USE_STDOUT").as_deref() == Some("1");
        let said = match set("RCUTILS_COLORIZED_OUTPUT").as_deref() {
            Some("0") => Some(false),
            Some("1") => Some(true),
            _ => set("NO_COLOR").map(|_| false),
        };
        let format = set("RCUTILS_CONSOLE_OUTPUT_FORMAT");
        Self {
            parts: parts(format.as_deref().unwrap_or(USUAL)),
            colours: colours.or(said).unwrap_or_else(|| terminal(stdout)),
            stdout,
        }
    }

    /// Whether lines go to standard output.
    #[must_use]
    pub const fn stdout(&self) -> bool {
        self.stdout
    }

    /// Appends a line with its end, which allocates if there is no room.
    pub fn write(&self, line: &LogLine<'_>, out: &mut String) {
        let (before, after) = match line.level {
            _ if !self.colours => ("", ""),
            LogLevel::Debug => ("\x1b[32m", "\x1b[0m"),
            LogLevel::Info => ("\x1b[0m", "\x1b[0m"),
            LogLevel::Warn => ("\x1b[33m", "\x1b[0m"),
            LogLevel::Error | LogLevel::Fatal => ("\x1b[31m", "\x1b[0m"),
        };
        out.push_str(before);
        for part in &self.parts {
            let (seconds, nanos) = (line.stamp / 1_000_000_000, line.stamp % 1_000_000_000);
            match part {
                Part::Plain(text) => out.push_str(text),
                Part::Severity => out.push_str(line.level.name()),
                Part::Time => write!(out, "{seconds}.{nanos:09}").unwrap_or_default(),
                Part::Nanoseconds => write!(out, "{}", line.stamp).unwrap_or_default(),
                Part::Name => out.push_str(line.name),
                Part::Message => out.push_str(line.text),
                Part::Function => out.push_str(line.function),
                Part::File => out.push_str(line.file),
                Part::Line => write!(out, "{}", line.line).unwrap_or_default(),
            }
        }
        out.push_str(after);
        out.push('\n');
    }
}

/// A word in braces that has no meaning stays as it is.
fn parts(format: &str) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut plain = String::new();
    let mut rest = format;
    while let Some(c) = rest.chars().next() {
        let word = rest.strip_prefix('{').and_then(|rest| rest.split_once('}'));
        let part = word.and_then(|(word, rest)| Some((part(word)?, rest)));
        let escaped = || rest.strip_prefix('\\').and_then(escape);
        if let Some((part, after)) = part {
            parts.push(Part::Plain(core::mem::take(&mut plain)));
            parts.push(part);
            rest = after;
        } else if let Some((meant, after)) = escaped() {
            plain.push(meant);
            rest = after;
        } else {
            plain.push(c);
            rest = rest.get(c.len_utf8()..).unwrap_or_default();
        }
    }
    parts.push(Part::Plain(plain));
    parts
}

fn part(word: &str) -> Option<Part> {
    Some(match word {
        "severity" => Part::Severity,
        "time" => Part::Time,
        "time_as_nanoseconds" => Part::Nanoseconds,
        "name" => Part::Name,
        "message" => Part::Message,
        "function_name" => Part::Function,
        "file_name" => Part::File,
        "line_number" => Part::Line,
        _ => return None,
    })
}

/// The character behind a backslash, and what follows it.
fn escape(rest: &str) -> Option<(char, &str)> {
    if let Some(after) = rest.strip_prefix("x1b") {
        return Some(('\x1b', after));
    }
    let mut chars = rest.chars();
    let meant = match chars.next()? {
        'a' => '\x07',
        'b' => '\x08',
        'n' => '\n',
        'r' => '\r',
        't' => '\t',
        '\\' => '\\',
        _ => return None,
    };
    Some((meant, chars.as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(variables: &[(&str, &str)], colours: Option<bool>, terminal: bool) -> String {
        let value = |name: &str| {
            let found = variables.iter().find(|(n, _)| *n == name);
            found.map(|(_, value)| String::from(*value))
        };
        let line = LogLine {
            stamp: 1_700_000_000_000_000_042,
            level: LogLevel::Warn,
            name: "robot.arm",
            text: "it is warm",
            file: "arm.rs",
            function: "robot::arm",
            line: 7,
        };
        let mut out = String::new();
        ConsoleFormat::read(value, colours, |_| terminal).write(&line, &mut out);
        out
    }

    #[test]
    fn a_line_looks_as_in_ros() {
        let plain = "[WARN] [1700000000.000000042] [robot.arm]: it is warm";
        let yellow = format!("\x1b[33m{plain}\x1b[0m\n");
        let plain = format!("{plain}\n");
        assert_eq!(shown(&[], None, false), plain);
        assert_eq!(shown(&[], None, true), yellow);
        assert_eq!(shown(&[("NO_COLOR", "1")], None, true), plain);
        assert_eq!(shown(&[("NO_COLOR", "")], None, true), yellow);
        let both = [("NO_COLOR", "1"), ("RCUTILS_COLORIZED_OUTPUT", "1")];
        assert_eq!(shown(&both, None, false), yellow);
        assert_eq!(shown(&both, Some(false), true), plain);
    }

    #[test]
    fn the_format_is_the_users() {
        let format = "{time_as_nanoseconds}\\t{file_name}:{line_number} {function_name} {odd} {";
        let variables = [("RCUTILS_CONSOLE_OUTPUT_FORMAT", format)];
        let line = "1700000000000000042\tarm.rs:7 robot::arm {odd} {\n";
        assert_eq!(shown(&variables, None, false), line);
    }
}
