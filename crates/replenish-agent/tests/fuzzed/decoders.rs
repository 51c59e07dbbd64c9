//! Every decoder of the protocol on the same bytes.

use replenish_xrce::client::pong;
use replenish_xrce::framing::{
    Prefixed, SERIAL_AGENT, Serial, prefix, serial_frame, serial_frame_len,
};
use replenish_xrce::wire::{
    Body, Encode, Message, RequestId, SubmessageId, Submessages, Writer, measure,
};

/// As a message, and everything after the first two bytes as the body of every submessage.
pub(crate) fn message(bytes: &[u8]) {
    if let Ok(message) = Message::parse(bytes) {
        submessages(message.submessages(), message.body.len());
    }
    let info = pong(RequestId(10), bytes);
    assert!(info.is_none_or(|info| info.status.is_ok()));
    if let Some((flags, payload)) = bytes.split_first() {
        for number in 0..=u8::MAX {
            let Ok(id) = SubmessageId::from_number(number) else {
                break;
            };
            if let Ok(body) = Body::decode(id, *flags, payload) {
                again(id, &body);
            }
        }
    }
}

fn submessages(walk: Submessages<'_>, len: usize) {
    let mut walked = 0;
    for submessage in walk {
        walked += 1;
        let Ok(submessage) = submessage else { continue };
        if let Ok(body) = submessage.body() {
            again(submessage.id, &body);
        }
    }
    assert!(walked <= len / 4 + 1, "the walk makes progress");
}

/// A decoded value can be encoded, in the length that was announced, and then means the same.
fn again(id: SubmessageId, body: &Body<'_>) {
    // A body of more than 65535 bytes cannot have come in a submessage.
    let Ok(len) = measure(body) else { return };
    let mut buf = vec![0; len];
    let mut w = Writer::new(&mut buf);
    body.encode(&mut w).unwrap();
    assert_eq!(w.len(), len);
    let flags = body.flags() | 1;
    let decoded = Body::decode(id, flags, &buf).unwrap();
    let mut second = vec![0; len];
    let mut w = Writer::new(&mut second);
    decoded.encode(&mut w).unwrap();
    assert_eq!((w.len(), decoded.flags() | 1), (len, flags));
    assert_eq!(buf, second, "{body:?}");
}

/// As a serial line and as a TCP stream, in pieces of `size`: what is delivered fits the buffer,
/// does not depend on the pieces, and a message after the bytes arrives as if they had not been.
pub(crate) fn framing(bytes: &[u8], size: usize) {
    const ROOM: usize = 128;
    let line = |size: usize| {
        let (mut decoder, mut got) = (Serial::new(SERIAL_AGENT, [0; ROOM]), Vec::new());
        for piece in bytes.chunks(size.max(1)) {
            decoder.push(piece, |source, message| {
                assert!(message.len() <= ROOM);
                got.push((source, message.to_vec()));
            });
        }
        assert_eq!(decoder.stats().frames, got.len() as u64);
        (decoder, got)
    };
    let (mut decoder, got) = line(size);
    assert_eq!(got, line(bytes.len()).1);
    let mut frame = [0; serial_frame_len(4)];
    let len = serial_frame(1, SERIAL_AGENT, &[0x7e, 0x7d, 1, 2], &mut frame).unwrap();
    let mut after = 0;
    decoder.push(&frame[..len], |_, message| {
        after += 1;
        assert_eq!(message, [0x7e, 0x7d, 1, 2]);
    });
    assert_eq!(after, 1);

    let stream = |size: usize| {
        let (mut decoder, mut got) = (Prefixed::new([0; ROOM]), Vec::new());
        for piece in bytes.chunks(size.max(1)) {
            decoder.push(piece, |message| {
                assert!((1..=ROOM).contains(&message.len()));
                got.push(message.to_vec());
            });
        }
        (decoder, got)
    };
    let (mut decoder, got) = stream(size);
    assert_eq!(got, stream(bytes.len()).1);
    decoder.reset();
    let mut after = 0;
    decoder.push(&prefix(3).unwrap(), |_| {});
    decoder.push(&[1, 2, 3], |_| after += 1);
    assert_eq!(after, 1);
}
