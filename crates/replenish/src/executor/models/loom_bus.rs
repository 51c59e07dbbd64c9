//! The in-process bus gives a place out again while another thread has its number: what was sent to
//! the old one does not reach the new one, and the new one misses nothing.

use crate::middleware::{
    EndpointSpec, InProcess, InProcessBus, Interest, Middleware, ReaderId, Room,
};
use crate::qos::{IngressLimit, Qos};
use crate::sync::Arc;
use loom::thread;

fn spec(topic: &'static str) -> EndpointSpec<'static> {
    EndpointSpec {
        node: "/n",
        topic,
        type_name: "t",
        dds_type_name: "t",
        type_hash: None,
        qos: Qos::reliable().keep_last(1),
        max_size: 1,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

fn taken(of: &InProcess, reader: ReaderId) -> Vec<u8> {
    let mut interest = Interest::empty();
    interest.insert(reader);
    let mut all = Vec::new();
    of.take(&mut interest, &mut |_, _, bytes| {
        all.extend_from_slice(bytes);
        Room::Left
    })
    .unwrap();
    all
}

/// A participant leaves while another publishes to it; the next one has its place, and waits.
#[test]
fn loom_a_place_that_is_given_out_again_while_it_is_published_to() {
    loom::model(|| {
        let bus = InProcessBus::new();
        let here = bus.participant();
        let old = here.create_writer(&spec("/old")).unwrap();
        let new = here.create_writer(&spec("/new")).unwrap();
        let gone = bus.participant();
        gone.create_reader(&spec("/old")).unwrap();
        let next = thread::spawn(move || {
            drop(gone);
            let next = bus.participant();
            let reader = next.create_reader(&spec("/new")).unwrap();
            let next = Arc::new(next);
            let waiting = Arc::clone(&next);
            let mut interest = Interest::empty();
            interest.insert(reader);
            // Ends by a sample, or early by the bell of the one that was there before; then it is
            // not rung for a sample that comes later, so it looks first.
            waiting.wait(&interest, Some(0)).unwrap();
            (next, reader)
        });
        here.publish(old, &[1]).unwrap();
        here.publish(new, &[2]).unwrap();
        let (next, reader) = next.join().unwrap();
        let got = taken(&next, reader);
        assert!(got.is_empty() || got == [2], "{got:?}");
        here.publish(new, &[3]).unwrap();
        assert_eq!(taken(&next, reader), [3]);
    });
}

/// A reader's place is given out again while its sample is handed over.
#[test]
fn loom_a_reader_that_is_replaced_while_its_sample_is_handed_over() {
    loom::model(|| {
        let bus = InProcessBus::new();
        let end = Arc::new(bus.participant());
        let old = end.create_writer(&spec("/old")).unwrap();
        let new = end.create_writer(&spec("/new")).unwrap();
        let reader = end.create_reader(&spec("/old")).unwrap();
        end.publish(old, &[1]).unwrap();
        let replaces = {
            let end = Arc::clone(&end);
            thread::spawn(move || {
                end.delete_reader(reader).unwrap();
                let next = end.create_reader(&spec("/new")).unwrap();
                assert_eq!(next, reader);
                end.publish(new, &[2]).unwrap();
            })
        };
        let mut got = taken(&end, reader);
        replaces.join().unwrap();
        got.extend(taken(&end, reader));
        assert!(got == [2] || got == [1, 2], "{got:?}");
    });
}
