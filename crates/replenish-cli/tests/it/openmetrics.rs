//! A reader of OpenMetrics text that refuses what the format's version 1.0 does not allow. It
//! shares nothing with the writer.

use std::collections::{BTreeMap, BTreeSet};

pub(crate) type Labels = BTreeMap<String, String>;

/// A sample, with its family.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Sample {
    pub(crate) family: String,
    pub(crate) kind: String,
    pub(crate) name: String,
    pub(crate) labels: Labels,
    pub(crate) value: f64,
}

fn is_name(text: &str) -> bool {
    let mut chars = text.chars();
    let first = chars
        .next()
        .is_some_and(|c| c.is_ascii_alphabetic() || c == '_');
    first && chars.all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// An escaped text up to a bare quote or the end, and the rest behind it.
fn unescape(text: &str) -> Result<(String, &str), String> {
    let (mut out, mut chars) = (String::new(), text.char_indices());
    while let Some((at, c)) = chars.next() {
        match c {
            '"' => return Ok((out, &text[at + 1..])),
            '\\' => match chars.next() {
                Some((_, 'n')) => out.push('\n'),
                Some((_, c @ ('\\' | '"'))) => out.push(c),
                other => return Err(format!("escape {other:?}")),
            },
            c => out.push(c),
        }
    }
    Ok((out, ""))
}

/// `name{a="b",c="d"} value`.
fn sample(line: &str) -> Result<(String, Labels, f64), String> {
    let end = line.find(['{', ' ']).ok_or("no value")?;
    let (name, mut rest) = line.split_at(end);
    let mut labels = Labels::new();
    if let Some(inside) = rest.strip_prefix('{') {
        rest = inside;
        loop {
            let (label, text) = rest.split_once("=\"").ok_or("no label")?;
            let (value, behind) = unescape(text)?;
            if !is_name(label) || labels.insert(label.into(), value).is_some() {
                return Err(format!("label {label:?}"));
            }
            match behind.split_at_checked(1).ok_or("labels without an end")? {
                (",", more) => rest = more,
                ("}", more) => {
                    rest = more;
                    break;
                }
                _ => return Err(format!("behind a label: {behind:?}")),
            }
        }
    }
    let value = rest.strip_prefix(' ').ok_or("no space before the value")?;
    let is_number = value.chars().all(|c| c.is_ascii_digit() || c == '.');
    let number = value.parse().ok().filter(|_| is_number);
    let number = number.ok_or_else(|| format!("value {value:?}"))?;
    if !is_name(name) {
        return Err(format!("name {name:?}"));
    }
    Ok((name.into(), labels, number))
}

fn suffixes(kind: &str) -> Result<&'static [&'static str], String> {
    Ok(match kind {
        "gauge" => &[""],
        "counter" => &["_total"],
        "info" => &["_info"],
        "histogram" => &["_bucket", "_count", "_sum"],
        "gaugehistogram" => &["_bucket", "_gcount", "_gsum"],
        other => return Err(format!("type {other:?}")),
    })
}

/// Every sample of a text.
pub(crate) fn parse(text: &str) -> Result<Vec<Sample>, String> {
    let body = text.strip_suffix("# EOF\n").ok_or("no # EOF at the end")?;
    let (mut families, mut series) = (BTreeSet::new(), BTreeSet::new());
    let (mut family, mut kind) = (String::new(), String::new());
    let (mut has_samples, mut samples) = (false, Vec::new());
    for line in body.split_terminator('\n') {
        let wrong = |why: &str| format!("{why}: {line:?}");
        if let Some(meta) = line.strip_prefix("# ") {
            let mut words = meta.splitn(3, ' ');
            let [word, name, more] =
                [words.next(), words.next(), words.next()].map(Option::unwrap_or_default);
            if word == "TYPE" {
                if !is_name(name) || !families.insert(name.to_owned()) {
                    return Err(wrong("a family twice, or without a name"));
                }
                suffixes(more)?;
                (family, kind, has_samples) = (name.into(), more.into(), false);
            } else if name != family || has_samples {
                return Err(wrong("not at the start of its family"));
            }
            match word {
                "TYPE" => {}
                "HELP" if unescape(more)?.1.is_empty() && !more.is_empty() => {}
                "UNIT" if family.ends_with(&format!("_{more}")) => {}
                _ => return Err(wrong("no such line")),
            }
            continue;
        }
        let (name, labels, value) = sample(line).map_err(|why| wrong(&why))?;
        let suffix = name.strip_prefix(&family).filter(|_| !family.is_empty());
        if !suffix.is_some_and(|s| suffixes(&kind).is_ok_and(|all| all.contains(&s))) {
            return Err(wrong("a sample outside of its family"));
        }
        if !series.insert((name.clone(), labels.clone())) {
            return Err(wrong("a series twice"));
        }
        has_samples = true;
        samples.push(Sample {
            family: family.clone(),
            kind: kind.clone(),
            name,
            labels,
            value,
        });
    }
    histograms(&samples)?;
    Ok(samples)
}

/// Buckets rise in bound and count, the last one is infinite and has the count of all.
fn histograms(samples: &[Sample]) -> Result<(), String> {
    let (mut bound, mut below) = (0.0, 0.0);
    for sample in samples.iter().filter(|s| s.kind.ends_with("histogram")) {
        let wrong = || format!("{sample:?} after {below} below {bound}");
        if sample.name.ends_with("_bucket") {
            let le = sample.labels.get("le").ok_or_else(wrong)?;
            let le = le
                .replace("+Inf", "inf")
                .parse::<f64>()
                .map_err(|_| wrong())?;
            if le <= bound || sample.value < below {
                return Err(wrong());
            }
            (bound, below) = (le, sample.value);
        } else if sample.name.ends_with("count") {
            if bound.is_finite() || sample.value.to_bits() != below.to_bits() {
                return Err(wrong());
            }
            (bound, below) = (0.0, 0.0);
        }
    }
    Ok(())
}

#[test]
fn the_reader_refuses_what_is_not_allowed() {
    let good = "# TYPE a_seconds counter\n# UNIT a_seconds seconds\n# HELP a_seconds x\n\
                a_seconds_total{b=\"\\\\\\n\\\"\"} 1.5\n# EOF\n";
    let all = parse(good).unwrap();
    assert_eq!((all.len(), all[0].labels["b"].as_str()), (1, "\\\n\""));
    for (from, to) in [
        ("# EOF\n", ""),
        ("_total", ""),
        ("1.5", "-1"),
        ("1.5", "1.5\n# HELP a_seconds late"),
        ("1.5", "1.5\na_seconds_total{b=\"\\\\\\n\\\"\"} 2"),
        ("1.5", "1.5\n# TYPE a_seconds gauge"),
        ("1.5", "1.5\n"),
        ("UNIT a_seconds seconds", "UNIT a_seconds bytes"),
        ("{b=", "{b=\"c\",b="),
        ("\\n", "\\t"),
        ("counter", "number"),
    ] {
        assert!(good.contains(from), "{from}");
        assert!(parse(&good.replace(from, to)).is_err(), "{from} -> {to}");
    }
    let buckets =
        "# TYPE h histogram\nh_bucket{le=\"1.0\"} 2\nh_bucket{le=\"+Inf\"} 3\nh_count 3\n# EOF\n";
    assert!(parse(buckets).is_ok());
    for (from, to) in [("} 2", "} 4"), ("count 3", "count 2"), ("+Inf", "2.0")] {
        assert!(parse(&buckets.replace(from, to)).is_err(), "{from} -> {to}");
    }
}
