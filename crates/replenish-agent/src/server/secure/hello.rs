//! The parts of a DTLS `ClientHello` that the exchange of cookies needs (RFC 6347, 4.2.1).

use std::ops::Range;

/// A record's header, and a handshake message's.
const RECORD: usize = 13;
const MESSAGE: usize = 12;

const HANDSHAKE: u8 = 22;
const CLIENT_HELLO: u8 = 1;
const HELLO_VERIFY_REQUEST: u8 = 3;

/// Bytes of a cookie of this agent.
pub(super) const COOKIE: usize = 32;

/// A `ClientHello` in one piece: the only form that begins a handshake here.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Hello<'a> {
    /// Its record.
    record: &'a [u8],
    pub(super) random: &'a [u8; 32],
    pub(super) cookie: &'a [u8],
    /// The bytes of the record that hold the cookie and, before it, its length.
    cookie_at: Range<usize>,
}

/// The type of a record and its epoch.
pub(super) fn kind(record: &[u8]) -> Option<(u8, u16)> {
    let (high, low) = (record.get(3)?, record.get(4)?);
    Some((*record.first()?, u16::from_be_bytes([*high, *low])))
}

/// The records of a datagram, each with its header.
pub(super) fn records(datagram: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = datagram;
    std::iter::from_fn(move || {
        let len = u16::from_be_bytes([*rest.get(11)?, *rest.get(12)?]);
        let (record, after) = rest.split_at_checked(RECORD + usize::from(len))?;
        rest = after;
        Some(record)
    })
}

impl<'a> Hello<'a> {
    /// The `ClientHello` at the start of a datagram, if one is there.
    pub(super) fn parse(datagram: &'a [u8]) -> Option<Self> {
        let record = records(datagram).next()?;
        if kind(record)? != (HANDSHAKE, 0) || *record.get(RECORD)? != CLIENT_HELLO {
            return None;
        }
        let body = record.get(RECORD + MESSAGE..)?;
        let number = |at: usize| {
            let bytes = record.get(RECORD + at..RECORD + at + 3)?;
            Some(
                bytes
                    .iter()
                    .fold(0, |sum, byte| sum << 8 | usize::from(*byte)),
            )
        };
        let (len, offset, piece) = (number(1)?, number(6)?, number(9)?);
        if offset != 0 || piece != len || len != body.len() {
            return None;
        }
        let random = body.get(2..34)?.first_chunk()?;
        let session = usize::from(*body.get(34)?);
        let at = 35 + session;
        let len = usize::from(*body.get(at)?);
        let cookie = body.get(at + 1..at + 1 + len)?;
        let start = RECORD + MESSAGE + at;
        Some(Self {
            record,
            random,
            cookie,
            cookie_at: start..start + 1 + len,
        })
    }

    /// The record that a client sends before it has a cookie: this one without its cookie.
    pub(super) fn without_cookie(&self) -> Vec<u8> {
        let mut first = Vec::with_capacity(self.record.len());
        first.extend_from_slice(self.record.get(..self.cookie_at.start).unwrap_or_default());
        first.push(0);
        first.extend_from_slice(self.record.get(self.cookie_at.end..).unwrap_or_default());
        let body = first.len().saturating_sub(RECORD + MESSAGE);
        let [.., high, middle, low] = body.to_be_bytes();
        let mut set = |at: usize, bytes: &[u8]| {
            for (to, byte) in first.iter_mut().skip(at).zip(bytes) {
                *to = *byte;
            }
        };
        let [.., record_high, record_low] = (body + MESSAGE).to_be_bytes();
        set(5, &[0; 6]); // its sequence number
        set(11, &[record_high, record_low]);
        set(RECORD + 1, &[high, middle, low]);
        set(RECORD + 4, &[0, 0]); // its message number
        set(RECORD + 9, &[high, middle, low]);
        first
    }
}

/// A `HelloVerifyRequest` with this cookie.
///
/// Its record always has the number 0: the client drops a second one, and the agent's first record
/// of the handshake has the number 1.
pub(super) fn verify_request(cookie: &[u8; COOKIE]) -> [u8; RECORD + MESSAGE + 3 + COOKIE] {
    const BODY: u8 = 3 + COOKIE as u8;
    let mut datagram = [0; RECORD + MESSAGE + 3 + COOKIE];
    let head = [
        [
            HANDSHAKE,
            0xfe,
            0xfd,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            0,
            BODY + MESSAGE as u8,
        ]
        .as_slice(),
        &[HELLO_VERIFY_REQUEST, 0, 0, BODY, 0, 0, 0, 0, 0, 0, 0, BODY],
        &[0xfe, 0xff, COOKIE as u8],
        cookie,
    ];
    for (to, byte) in datagram.iter_mut().zip(head.into_iter().flatten()) {
        *to = *byte;
    }
    datagram
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A hello with this cookie, as record `seq` and message `number`.
    fn hello(cookie: &[u8], seq: u8, number: u8) -> Vec<u8> {
        let mut body = vec![0xfe, 0xfd];
        body.extend([7; 32]);
        body.push(0);
        body.push(cookie.len() as u8);
        body.extend(cookie);
        body.extend([0, 2, 0xc0, 0xa8, 1, 0]);
        let len = body.len() as u8;
        let mut record = vec![HANDSHAKE, 0xfe, 0xfd, 0, 0, 0, 0, 0, 0, 0, seq, 0, len + 12];
        record.extend([CLIENT_HELLO, 0, 0, len, 0, number, 0, 0, 0, 0, 0, len]);
        record.extend(body);
        record
    }

    #[test]
    fn the_first_hello_is_found_again_behind_the_second() {
        let first = hello(&[], 0, 0);
        let second = hello(&[9; 32], 5, 1);
        let parsed = Hello::parse(&second).unwrap();
        assert_eq!((parsed.cookie, parsed.random), (&[9; 32][..], &[7; 32]));
        assert_eq!(parsed.without_cookie(), first);
        assert_eq!(Hello::parse(&first).unwrap().cookie, &[]);
        let cut: Vec<_> = (0..second.len())
            .map(|len| Hello::parse(&second[..len]))
            .collect();
        assert!(cut.iter().all(Option::is_none), "{cut:?}");
    }

    #[test]
    fn a_cookie_is_shorter_than_the_hello_that_asks_for_it() {
        let first = hello(&[], 0, 0);
        let reply = verify_request(&[3; COOKIE]);
        assert_eq!(records(&reply).count(), 1);
        assert_eq!(reply.len(), 60);
        assert!(
            reply.len() < first.len() + 20,
            "a real hello has extensions, too"
        );
    }
}
