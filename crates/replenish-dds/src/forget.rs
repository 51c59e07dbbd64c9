//! Makes RustDDS forget the announcements of participants that it has heard.
//!
//! RustDDS drops an announcement whose number it has in its cache. Cyclone DDS and Fast DDS
//! announce a participant with one number for all its life. So a participant whose lease ran out
//! is never discovered again, though it is there and announces itself, until the announcement has
//! left the cache: after some ten minutes, or never. The cache keeps 64 announcements and is
//! cleaned when a number is a multiple of 64. So a few dozen messages that say "this participant
//! is gone", about a participant that never was, empty it. The next announcement of every
//! participant is then a new one; of those that are known it changes nothing.

use rustdds::GUID;
use std::io;
use std::net::{Ipv4Addr, UdpSocket};

/// Announcements that the cache of RustDDS 0.15 keeps, and some that may come meanwhile.
const MESSAGES: i64 = 64 + 16;

/// The cache is cleaned at multiples of it.
const STEP: i64 = 64;

/// Sends the messages to the participant with this GUID. Those before had numbers up to `last`;
/// returns the last number of these.
pub(crate) fn announcements(
    (domain, participant): (u16, u16),
    own: GUID,
    last: i64,
) -> io::Result<i64> {
    // DDSI-RTPS 2.5, 9.6.2.3: where a participant listens for announcements.
    let port = 7400 + 250 * u32::from(domain) + 10 + 2 * u32::from(participant);
    let port = u16::try_from(port).map_err(io::Error::other)?;
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    for number in 1..=MESSAGES {
        let message = gone(own.to_bytes(), last + number * STEP);
        socket.send_to(&message, (Ipv4Addr::LOCALHOST, port))?;
    }
    Ok(last + MESSAGES * STEP)
}

/// The announcement that a participant is gone which never was: `own` with other last bits.
fn gone(own: [u8; 16], number: i64) -> Vec<u8> {
    let mut prefix = own;
    prefix
        .iter_mut()
        .skip(8)
        .take(4)
        .for_each(|byte| *byte = !*byte);
    let (prefix, _) = prefix.split_at(12);
    let mut body = Vec::with_capacity(64);
    body.extend([0, 0, 16, 0]); // extra flags; the inline QoS begins 16 bytes from here
    body.extend([0, 1, 0, 0xc7]); // the participants' reader
    body.extend([0, 1, 0, 0xc2]); // the participants' writer
    let number = number.cast_unsigned();
    body.extend(((number >> 32) as u32).to_le_bytes());
    body.extend((number as u32).to_le_bytes());
    body.extend([0x71, 0, 4, 0, 0, 0, 0, 3]); // status: disposed and unregistered
    body.extend([1, 0, 0, 0]); // end of the inline QoS
    body.extend([0, 3, 0, 0]); // a parameter list, little-endian
    body.extend([0x50, 0, 16, 0]); // the participant's GUID
    body.extend(prefix);
    body.extend([0, 0, 1, 0xc1]);
    body.extend([1, 0, 0, 0]);
    let mut message = b"RTPS\x02\x04\x01\x12".to_vec();
    message.extend(prefix);
    message.extend([0x15, 0x0b]); // DATA: little-endian, inline QoS, key
    message.extend(u16::try_from(body.len()).unwrap_or(0).to_le_bytes());
    message.extend(body);
    message
}
