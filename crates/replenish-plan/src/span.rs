//! Spans of time as people write them: `30 ms`, `1.5 us`.

use crate::Nanos;
use std::fmt;

/// The units, longest first, with their nanoseconds.
const UNITS: [(&str, Nanos); 4] = [
    ("s", 1_000_000_000),
    ("ms", 1_000_000),
    ("us", 1_000),
    ("ns", 1),
];

/// Reads `30 ms`, `30ms`, `0.5 s`, `250 us` (also `µs`), `10 ns`: a decimal number and a unit.
///
/// # Errors
/// The error, with the allowed values. Fractions of a nanosecond and spans above
/// 18 446 744 073 s do not exist.
pub fn parse(text: &str) -> Result<Nanos, String> {
    let refuse = |why: &str| {
        Err(format!(
            "{text:?} is not a duration{why}: allowed is a number with a unit (ns, us, ms or s), for example \"30 ms\""
        ))
    };
    let trimmed = text.trim();
    let end = trimmed.find(|c: char| !(c.is_ascii_digit() || c == '.'));
    let Some(end) = end else {
        return refuse(" (no unit)");
    };
    let (number, unit) = trimmed.split_at(end);
    let unit = unit.trim().replace(['µ', 'μ'], "u");
    let Some((_, scale)) = UNITS.iter().find(|(name, _)| *name == unit) else {
        return refuse("");
    };
    match decimal(number, *scale) {
        Some(span) => Ok(span),
        None => refuse(" in whole nanoseconds up to 2^64"),
    }
}

fn decimal(number: &str, scale: Nanos) -> Option<Nanos> {
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    let mut value = whole.parse::<Nanos>().ok()?.checked_mul(scale)?;
    let mut scale = scale;
    for digit in fraction.chars() {
        let digit = Nanos::from(digit.to_digit(10)?);
        if digit != 0 && !scale.is_multiple_of(10) {
            return None;
        }
        scale /= 10;
        value = value.checked_add(digit * scale)?;
    }
    Some(value)
}

/// Prints a span exactly, in the largest unit that is not larger than it: `30 ms`, `1.5 us`.
/// [`parse`] reads it back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exact(pub Nanos);

impl fmt::Display for Exact {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (unit, scale) = unit_of(self.0);
        let whole = self.0 / scale;
        let rest = self.0 % scale;
        if rest == 0 {
            return write!(f, "{whole} {unit}");
        }
        let width = scale.ilog10() as usize;
        let digits = format!("{rest:0width$}");
        write!(f, "{whole}.{} {unit}", digits.trim_end_matches('0'))
    }
}

/// Prints a span for people: four significant digits at most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rounded(pub Nanos);

impl fmt::Display for Rounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Exact(round(self.0, 4)).fmt(f)
    }
}

/// `value` to `digits` significant digits, to the nearest.
pub(crate) fn round(value: Nanos, digits: u32) -> Nanos {
    let step = step(value, digits);
    value.saturating_add(step / 2) / step * step
}

/// The distance of numbers with `digits` significant digits near `value`, at least 1.
pub(crate) fn step(value: Nanos, digits: u32) -> Nanos {
    let length = value.max(1).ilog10() + 1;
    10u64.pow(length.saturating_sub(digits))
}

fn unit_of(span: Nanos) -> (&'static str, Nanos) {
    let fitting = UNITS.iter().find(|(_, scale)| span >= *scale);
    *fitting.unwrap_or(&("ns", 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_read_and_printed_exactly() {
        for (text, ns) in [
            ("30 ms", 30_000_000),
            ("1.5 us", 1_500),
            ("2 s", 2_000_000_000),
            ("7 ns", 7),
            ("1.000001 ms", 1_000_001),
        ] {
            assert_eq!(parse(text), Ok(ns));
            assert_eq!(Exact(ns).to_string(), text);
        }
        assert_eq!(parse(" 30ms "), Ok(30_000_000));
        assert_eq!(parse("0.25 s"), Ok(250_000_000));
        assert_eq!(parse("3 µs"), Ok(3_000));
        assert_eq!(Exact(0).to_string(), "0 ns");
        assert_eq!(Rounded(12_345_678).to_string(), "12.35 ms");
    }

    #[test]
    fn what_is_no_span_is_refused_with_an_example() {
        for bad in [
            "",
            "30",
            "ms",
            "-3 ms",
            "1.5 ns",
            "3 h",
            "1e3 ms",
            "1..5 ms",
            "99999999999999 s",
        ] {
            let error = parse(bad).unwrap_err();
            assert!(error.contains("30 ms"), "{bad}: {error}");
        }
    }
}
