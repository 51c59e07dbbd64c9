//! OpenMetrics 1.0 as text: families one after the other, values, labels, escapes.

use crate::time::Nanos;
use std::collections::HashSet;
use std::fmt::Write;

/// The media type of the text.
pub(super) const MEDIA_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Names of labels and their values.
pub(super) type Labels<'a> = [(&'a str, &'a str)];

/// The text as it grows.
#[derive(Debug, Default)]
pub(super) struct Text {
    out: String,
    /// The name of the family whose samples follow.
    family: String,
    /// Series of the family that are there: a stranger's file may repeat another one's names.
    series: HashSet<String>,
}

impl Text {
    /// Begins a family. With a unit, its name ends in `_unit`.
    pub(super) fn family(&mut self, name: &str, kind: &str, unit: &str, help: &str) {
        self.series.clear();
        self.family = name.into();
        writeln!(self.out, "# TYPE {name} {kind}").ok();
        if !unit.is_empty() {
            writeln!(self.out, "# UNIT {name} {unit}").ok();
        }
        writeln!(self.out, "# HELP {name} {}", escaped(help)).ok();
    }

    /// Whether no series of the family has these labels yet; it has from now on.
    pub(super) fn is_new(&mut self, labels: &Labels<'_>) -> bool {
        self.series.insert(written(labels))
    }

    /// A sample of the family, whose name `suffix` ends.
    pub(super) fn sample(&mut self, suffix: &str, labels: &Labels<'_>, value: &str) {
        let labels = written(labels);
        writeln!(self.out, "{}{suffix}{labels} {value}", self.family).ok();
    }

    /// The whole text.
    pub(super) fn end(mut self) -> String {
        self.out.push_str("# EOF\n");
        self.out
    }
}

fn written(labels: &Labels<'_>) -> String {
    let label = |(name, value): &(&str, &str)| format!("{name}=\"{}\"", escaped(value));
    let labels: Vec<String> = labels.iter().map(label).collect();
    if labels.is_empty() {
        return String::new();
    }
    format!("{{{}}}", labels.join(","))
}

/// Names are other people's: backslashes, quotes and line feeds are escaped, other control
/// characters replaced.
fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\\' => out.push_str("\\\\"),
            '"' => out.push_str("\\\""),
            '\n' => out.push_str("\\n"),
            c if c.is_control() => out.push(char::REPLACEMENT_CHARACTER),
            c => out.push(c),
        }
    }
    out
}

/// Nanoseconds in seconds, exact.
pub(super) fn seconds(ns: Nanos) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_strangers_stay_inside_their_quotes() {
        let mut text = Text::default();
        text.family("a", "gauge", "", "one \"line\"\nof help");
        text.sample("", &[("worker", "x\\\"} 1\n# EOF\r\u{1b}ü")], "0");
        let expected = "# TYPE a gauge\n# HELP a one \\\"line\\\"\\nof help\n\
                        a{worker=\"x\\\\\\\"} 1\\n# EOF\u{fffd}\u{fffd}ü\"} 0\n# EOF\n";
        assert_eq!(text.end(), expected);
    }

    #[test]
    fn a_series_is_new_once_in_its_family() {
        let mut text = Text::default();
        text.family("a", "gauge", "", "a");
        assert!(text.is_new(&[("b", "c")]) && !text.is_new(&[("b", "c")]));
        assert!(text.is_new(&[("b", "d")]));
        text.family("e", "gauge", "", "e");
        assert!(text.is_new(&[("b", "c")]));
    }

    #[test]
    fn seconds_are_exact() {
        assert_eq!(seconds(0), "0.000000000");
        assert_eq!(seconds(2_000_000_001), "2.000000001");
        assert_eq!(seconds(u64::MAX), "18446744073.709551615");
    }
}
