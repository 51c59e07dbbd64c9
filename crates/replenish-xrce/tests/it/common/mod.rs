//! Reads `data/xrce-capture.txt`: annotated hex of real traffic between eProsima's client (2.4.3)
//! and agents (2.3.0, 3.0.1).

#![allow(dead_code, reason = "every test binary uses its own part")]

use std::fmt;

/// One datagram of the capture.
pub(crate) struct Datagram {
    pub(crate) scenario: String,
    pub(crate) number: usize,
    /// Nanoseconds since the scenario's start.
    pub(crate) time: u64,
    pub(crate) from_client: bool,
    pub(crate) client_port: u16,
    pub(crate) bytes: Vec<u8>,
    /// The annotation of each submessage, for messages.
    pub(crate) annotations: Vec<String>,
}

impl fmt::Display for Datagram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let direction = if self.from_client { "C->A" } else { "A->C" };
        write!(
            f,
            "scenario {}, #{} {direction}",
            self.scenario, self.number
        )
    }
}

/// All datagrams, in order.
pub(crate) fn capture() -> Vec<Datagram> {
    let mut datagrams: Vec<Datagram> = Vec::new();
    let mut scenario = String::new();
    for line in include_str!("../../data/xrce-capture.txt").lines() {
        if let Some((_, name)) = line.split_once("SCENARIO ") {
            scenario = name.to_string();
        } else if let Some(line) = line
            .strip_prefix('#')
            .filter(|line| line.contains("client_port="))
        {
            let field = |name: &str| {
                let (_, rest) = line.split_once(name).expect("field");
                rest.trim_start()
                    .split([' ', 'm'])
                    .next()
                    .expect("value")
                    .to_string()
            };
            // "1234.567" milliseconds, as microseconds.
            let micros: u64 = field("t=").replace('.', "").parse().expect("time");
            datagrams.push(Datagram {
                scenario: scenario.clone(),
                number: line
                    .split(' ')
                    .next()
                    .expect("number")
                    .parse()
                    .expect("number"),
                time: micros * 1000,
                from_client: line.contains("C->A"),
                client_port: field("client_port=").parse().expect("port"),
                bytes: Vec::with_capacity(field("len=").parse().expect("len")),
                annotations: Vec::new(),
            });
        } else if let Some(annotation) = line.strip_prefix("   SUB ") {
            datagrams
                .last_mut()
                .expect("a datagram")
                .annotations
                .push(annotation.to_string());
        } else if let Some(hex) = line.strip_prefix("      ") {
            let bytes = hex.split_whitespace().skip(1);
            let bytes = bytes.map(|byte| u8::from_str_radix(byte, 16).expect("hex"));
            datagrams
                .last_mut()
                .expect("a datagram")
                .bytes
                .extend(bytes);
        }
    }
    assert_eq!(datagrams.len(), 544, "datagrams in the capture");
    datagrams
}

/// The datagrams of one scenario.
pub(crate) fn scenario(name: &str) -> Vec<Datagram> {
    capture()
        .into_iter()
        .filter(|datagram| datagram.scenario == name)
        .collect()
}

/// Bytes of a datagram that have a meaning: false for the padding between and after submessages,
/// where eProsima's client leaves whatever its buffer held before.
pub(crate) fn meaningful(bytes: &[u8]) -> Vec<bool> {
    let mut mask = vec![true; bytes.len()];
    let mut pos = if bytes[0] < 0x80 { 8 } else { 4 };
    while pos + 4 <= bytes.len() {
        let len = usize::from(u16::from_le_bytes([bytes[pos + 2], bytes[pos + 3]]));
        pos += 4 + len;
        while pos % 4 != 0 && pos < bytes.len() {
            mask[pos] = false;
            pos += 1;
        }
    }
    mask
}

/// Asserts that we `made` the datagram that was captured, padding aside.
pub(crate) fn assert_same(expected: &Datagram, made: &[u8]) {
    let mask = meaningful(&expected.bytes);
    for (offset, &byte) in expected.bytes.iter().enumerate() {
        let ours = made.get(offset).copied();
        assert!(
            !mask[offset] || ours == Some(byte),
            "{expected}, offset {offset:#x}: captured {byte:#04x}, we made {ours:02x?}\n\
             captured {:02x?}\n    made {made:02x?}",
            expected.bytes
        );
    }
    assert_eq!(
        made.len(),
        expected.bytes.len(),
        "{expected}: length\ncaptured {:02x?}\n    made {made:02x?}",
        expected.bytes
    );
}
