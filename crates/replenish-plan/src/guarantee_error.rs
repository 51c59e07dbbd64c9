//! A guarantee that contradicts itself, in the words in which it was said.

use crate::Nanos;
use crate::span::Exact;
use std::fmt;

/// A field of a guarantee out of its range.
///
/// ```
/// use replenish_plan::Guarantee;
/// use std::time::Duration;
/// let ms = Duration::from_millis;
/// let error = Guarantee::at(100.0).taking(ms(20)).check().unwrap_err();
/// let text = "taking = 20 ms is longer than the period, 10 ms (100 Hz)";
/// assert_eq!(error.to_string(), text);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct GuaranteeError {
    /// The field: `period`, `deadline`, `amount`, `minimum` or `desired`.
    pub field: &'static str,
    /// Its value in ns.
    pub value: Nanos,
    /// The smallest allowed value in ns.
    pub low: Nanos,
    /// The largest allowed value in ns.
    pub high: Nanos,
    /// The rate that was said, in Hz.
    pub(crate) rate: Option<f64>,
    /// Whether a deadline was said.
    pub(crate) deadline: bool,
}

/// The names of the same things where they were written.
struct Words {
    amount: [&'static str; 2],
    period: [&'static str; 2],
    minimum: &'static str,
    desired: &'static str,
}

/// A plain guarantee first, then a rate.
const PROGRAM: Words = Words {
    amount: ["of", "taking"],
    period: ["every", "at"],
    minimum: "at_least",
    desired: "up_to",
};

const FILE: Words = Words {
    amount: ["budget", "takes"],
    period: ["period", "rate"],
    minimum: "minimum",
    desired: "desired",
};

impl GuaranteeError {
    /// The sentence in the words of a deployment file, behind the name of the field.
    pub(crate) fn in_file(&self) -> String {
        let sentence = self.sentence(&FILE);
        let behind = sentence.split_once(" = ").map(|(_, rest)| rest.to_owned());
        behind.unwrap_or(sentence)
    }

    fn sentence(&self, words: &Words) -> String {
        let rate = usize::from(self.rate.is_some());
        let of = |names: [&'static str; 2]| names.get(rate).copied().unwrap_or_default();
        let (amount, value) = (of(words.amount), Exact(self.value));
        let name = match self.field {
            "period" => return self.period(of(words.period)),
            "amount" => amount,
            "minimum" => words.minimum,
            "desired" => words.desired,
            field => field,
        };
        if self.value == 0 {
            return format!("{name} = 0 is no time: allowed is 1 ns or more");
        }
        match self.field {
            "minimum" => format!(
                "{name} = {value} is more than {amount} = {}",
                Exact(self.high)
            ),
            "desired" if self.value < self.low => {
                format!(
                    "{name} = {value} is less than {amount} = {}",
                    Exact(self.low)
                )
            }
            _ => format!("{name} = {value} is longer than {}", self.limit()),
        }
    }

    /// The deadline or the period, whichever the value had to keep below.
    fn limit(&self) -> String {
        let high = Exact(self.high);
        match self.rate {
            _ if self.deadline && self.field != "deadline" => format!("the deadline, {high}"),
            Some(_) => format!("the period, {high} ({})", self.hertz()),
            None => format!("the period, {high}"),
        }
    }

    fn period(&self, name: &str) -> String {
        let (value, most) = (Exact(self.value), Exact(self.high));
        match (self.rate, self.value) {
            (Some(_), 0) => format!(
                "{name} = {} is not a rate: allowed is above 0 Hz to 1 GHz",
                self.hertz()
            ),
            (Some(_), _) => format!("{name} = {} is slower than once a day", self.hertz()),
            (None, 0) => format!("{name} = 0 is no time: allowed is 1 ns to a day"),
            (None, _) => format!("{name} = {value} is longer than a day, {most}"),
        }
    }

    /// The rate to four digits.
    fn hertz(&self) -> String {
        let rate = self.rate.unwrap_or(0.0);
        let digits = (0..9).find(|digits| rate * 10f64.powi(*digits) >= 1000.0);
        format!(
            "{} Hz",
            trimmed(rate, digits.unwrap_or(9).unsigned_abs() as usize)
        )
    }
}

/// `value` with `digits` digits behind the point, and no zeros at the end.
fn trimmed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').into()
}

impl fmt::Display for GuaranteeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.sentence(&PROGRAM))
    }
}

impl std::error::Error for GuaranteeError {}
