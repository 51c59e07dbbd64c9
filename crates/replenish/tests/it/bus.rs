//! The in-process bus gives places out again: those of contexts, topics, readers and writers; and a
//! number that outlives its place reaches no endpoint.

use proptest::prelude::*;
use replenish::middleware::{
    EndpointSpec, InProcess, InProcessBus, Interest, Middleware, MiddlewareError, PublishError,
    ReaderId, RequestIdentity, Room, ServiceSpec, WriterId,
};
use replenish::msg::std_msgs::{Int32, Int64};
use replenish::{Context, IngressLimit, Qos};
use std::collections::VecDeque;

fn spec<'a>(topic: &'a str, type_name: &'a str, max_size: usize) -> EndpointSpec<'a> {
    EndpointSpec {
        node: "/n",
        topic,
        type_name,
        dds_type_name: type_name,
        type_hash: None,
        qos: Qos::reliable(),
        max_size,
        ingress: IngressLimit::none(),
        keep_oldest: false,
    }
}

fn service(name: &str) -> ServiceSpec<'_> {
    ServiceSpec {
        node: "/n",
        service: name,
        type_name: "t/srv/T",
        request_type: "t",
        response_type: "t",
        type_hash: None,
        qos: Qos::reliable(),
        max_request: 8,
        max_response: 8,
    }
}

/// The samples that wait for one reader.
fn taken(of: &InProcess, reader: ReaderId) -> Vec<(RequestIdentity, Vec<u8>)> {
    let mut interest = Interest::empty();
    interest.insert(reader);
    let mut all = Vec::new();
    of.take(&mut interest, &mut |_, info, bytes| {
        all.push((info.request, bytes.to_vec()));
        Room::Left
    })
    .unwrap();
    all
}

/// On b209253 the 65th context of a bus could create nothing, whatever had become of the others.
#[test]
fn a_context_that_goes_leaves_its_place() {
    let bus = InProcessBus::new();
    let ready = |ctx: &Context| {
        let node = ctx.node("n").unwrap();
        node.publisher::<Int32>("t", Qos::reliable()).map(|_| ())
    };
    for _ in 0..200 {
        ready(&Context::new(bus.participant())).unwrap();
    }
    let mut all: Vec<Context> = (0..64).map(|_| Context::new(bus.participant())).collect();
    all.iter().for_each(|ctx| ready(ctx).unwrap());
    let one_more = Context::new(bus.participant());
    assert!(ready(&one_more).unwrap_err().to_string().contains("64"));
    all.swap_remove(17);
    let next = Context::new(bus.participant());
    ready(&next).unwrap();
    drop(one_more);
    let place = Context::new(bus.participant());
    assert!(ready(&place).is_err(), "it had none to leave");
}

/// On b209253 a topic stayed for ever, and with it its type: the second publisher was refused, and
/// after 20 000 topics a further one took ten times as long.
#[test]
fn a_topic_that_nobody_has_leaves_its_place_and_its_type() {
    let bus = InProcessBus::new();
    let ctx = Context::new(bus.participant());
    let node = ctx.node("n").unwrap();
    drop(node.publisher::<Int32>("t", Qos::reliable()).unwrap());
    let first = node.publisher::<Int64>("t", Qos::reliable()).unwrap();
    assert!(node.publisher::<Int32>("t", Qos::reliable()).is_err());
    let other = Context::new(bus.participant());
    let at_other = other.node("n").unwrap();
    let second = at_other.publisher::<Int64>("t", Qos::reliable()).unwrap();
    drop(first);
    assert!(node.publisher::<Int32>("t", Qos::reliable()).is_err());
    drop((second, at_other, other));
    node.publisher::<Int32>("t", Qos::reliable()).unwrap();
}

/// A request outlives its client's context; another client has both places when the reply comes.
#[test]
fn a_reply_for_a_client_that_is_gone_reaches_nobody() {
    let bus = InProcessBus::new();
    let server = bus.participant();
    let (requests, replies) = server.create_server(&service("/s")).unwrap();
    let client = bus.participant();
    let (_, asks) = client.create_client(&service("/s")).unwrap();
    client.request(asks, b"old").unwrap();
    drop(client);
    let client = bus.participant();
    let (answers, asks) = client.create_client(&service("/s")).unwrap();
    let waiting = taken(&server, requests);
    assert_eq!(waiting.len(), 1);
    let late = server.reply(replies, &waiting[0].0, b"late");
    assert_eq!(late, Err(PublishError::LinkDown));
    assert_eq!(taken(&client, answers), []);
    client.request(asks, b"new").unwrap();
    let waiting = taken(&server, requests);
    server.reply(replies, &waiting[0].0, b"yes").unwrap();
    assert_eq!(taken(&client, answers)[0].1, b"yes");
}

/// A client's reader is deleted and its place given to another: on b209253 the client could go on,
/// and its replies came to that one.
#[test]
fn a_client_without_its_reader_sends_no_requests() {
    let bus = InProcessBus::new();
    let server = bus.participant();
    server.create_server(&service("/s")).unwrap();
    let client = bus.participant();
    let (answers, asks) = client.create_client(&service("/s")).unwrap();
    client.delete_reader(answers).unwrap();
    assert_eq!(client.create_reader(&spec("/t", "t", 8)), Ok(answers));
    let refused = client.request(asks, b"?");
    assert_eq!(refused, Err(PublishError::UnknownWriter));
}

/// While a sample is handed over, its reader is deleted and the place given to a reader of larger
/// samples. On b209253 the old buffer came to the new reader, which lost the bytes of a sample.
#[test]
fn a_buffer_comes_back_to_the_reader_that_it_belongs_to() {
    let bus = InProcessBus::new();
    let end = bus.participant();
    let reader = end.create_reader(&spec("/small", "t", 4)).unwrap();
    let small = end.create_writer(&spec("/small", "t", 4)).unwrap();
    let large = end.create_writer(&spec("/large", "t", 64)).unwrap();
    end.publish(small, b"tiny").unwrap();
    let mut interest = Interest::empty();
    interest.insert(reader);
    let hand_over = &mut |_: ReaderId, _: &_, bytes: &[u8]| {
        assert_eq!(bytes, b"tiny");
        end.delete_reader(reader).unwrap();
        let next = end.create_reader(&spec("/large", "t", 64)).unwrap();
        assert_eq!(next, reader, "the place is given out again");
        Room::Full
    };
    end.take(&mut interest, hand_over).unwrap();
    for n in 0..50 {
        end.publish(large, &[n; 64]).unwrap();
        let got = taken(&end, reader);
        assert_eq!(got.iter().map(|s| &s.1[..]).collect::<Vec<_>>(), [[n; 64]]);
    }
}

#[derive(Debug, Clone, Copy)]
enum Step {
    Enter,
    Leave(usize),
    Write(usize, usize),
    Read(usize, usize),
    DropWriter(usize),
    DropReader(usize),
    Publish(usize),
    Take(usize),
}

fn step() -> impl Strategy<Value = Step> {
    let any = 0..8_usize;
    prop_oneof![
        Just(Step::Enter),
        any.clone().prop_map(Step::Leave),
        (any.clone(), 0..6_usize).prop_map(|(p, t)| Step::Write(p, t)),
        (any.clone(), 0..6_usize).prop_map(|(p, t)| Step::Read(p, t)),
        any.clone().prop_map(Step::DropWriter),
        any.clone().prop_map(Step::DropReader),
        any.clone().prop_map(Step::Publish),
        any.prop_map(Step::Take),
    ]
}

struct Writer {
    of: usize,
    topic: usize,
    id: WriterId,
}

struct Reader {
    of: usize,
    topic: usize,
    id: ReaderId,
    expected: VecDeque<Vec<u8>>,
}

const TOPICS: [&str; 3] = ["/a", "/b", "/c"];
const TYPES: [&str; 2] = ["t/msg/One", "t/msg/Two"];

/// The bus beside a list of what there should be.
struct Model {
    bus: InProcessBus,
    /// By number, which counts on.
    ends: Vec<(usize, InProcess)>,
    writers: Vec<Writer>,
    readers: Vec<Reader>,
    entered: usize,
    sent: u32,
}

fn pick<T>(list: &[T], at: usize) -> Option<usize> {
    (!list.is_empty()).then(|| at % list.len())
}

impl Model {
    fn end(&self, number: usize) -> &InProcess {
        &self.ends.iter().find(|(n, _)| *n == number).unwrap().1
    }

    /// Whether the topic may have this type: no endpoint has it with another one.
    fn agrees(&self, topic: usize) -> bool {
        let writers = self.writers.iter().map(|w| w.topic);
        let mut all = writers.chain(self.readers.iter().map(|r| r.topic));
        all.all(|t| t / 2 != topic / 2 || t == topic)
    }

    fn judge<T>(&self, topic: usize, made: Result<T, MiddlewareError>) -> Option<T> {
        let agrees = self.agrees(topic);
        match made {
            Ok(made) => {
                assert!(agrees, "two types on one topic");
                Some(made)
            }
            Err(e) => {
                assert!(matches!(e, MiddlewareError::TypeMismatch { .. }), "{e}");
                assert!(!agrees, "refused: {e}");
                None
            }
        }
    }

    fn carry_out(&mut self, step: Step) {
        let of = |topic: usize| spec(TOPICS[topic / 2], TYPES[topic % 2], 8);
        match step {
            Step::Enter => {
                self.ends.push((self.entered, self.bus.participant()));
                self.entered += 1;
            }
            Step::Leave(at) => {
                if let Some(at) = pick(&self.ends, at) {
                    let (gone, _) = self.ends.swap_remove(at);
                    self.writers.retain(|w| w.of != gone);
                    self.readers.retain(|r| r.of != gone);
                }
            }
            Step::Write(at, topic) => {
                if let Some((number, end)) = pick(&self.ends, at).map(|at| &self.ends[at])
                    && let Some(id) = self.judge(topic, end.create_writer(&of(topic)))
                {
                    let of = *number;
                    self.writers.push(Writer { of, topic, id });
                }
            }
            Step::Read(at, topic) => {
                if let Some((number, end)) = pick(&self.ends, at).map(|at| &self.ends[at])
                    && let Some(id) = self.judge(topic, end.create_reader(&of(topic)))
                {
                    let (of, expected) = (*number, VecDeque::new());
                    self.readers.push(Reader {
                        of,
                        topic,
                        id,
                        expected,
                    });
                }
            }
            Step::DropWriter(at) => {
                if let Some(at) = pick(&self.writers, at) {
                    let gone = self.writers.swap_remove(at);
                    self.end(gone.of).delete_writer(gone.id);
                    let late = self.end(gone.of).publish(gone.id, b"late");
                    assert_eq!(late, Err(PublishError::UnknownWriter));
                }
            }
            Step::DropReader(at) => {
                if let Some(at) = pick(&self.readers, at) {
                    let gone = self.readers.swap_remove(at);
                    self.end(gone.of).delete_reader(gone.id).unwrap();
                }
            }
            Step::Publish(at) => {
                if let Some(at) = pick(&self.writers, at) {
                    let Writer { of, topic, id } = self.writers[at];
                    self.sent += 1;
                    let sample = self.sent.to_be_bytes().to_vec();
                    self.end(of).publish(id, &sample).unwrap();
                    let depth = usize::from(Qos::reliable().depth);
                    for r in self.readers.iter_mut().filter(|r| r.topic == topic) {
                        r.expected.push_back(sample.clone());
                        while r.expected.len() > depth {
                            r.expected.pop_front();
                        }
                    }
                }
            }
            Step::Take(at) => {
                if let Some(at) = pick(&self.readers, at) {
                    let reader = &mut self.readers[at];
                    let expected: Vec<_> = reader.expected.drain(..).collect();
                    let (of, id) = (reader.of, reader.id);
                    let got = taken(self.end(of), id);
                    let got: Vec<_> = got.into_iter().map(|(_, bytes)| bytes).collect();
                    assert_eq!(got, expected);
                }
            }
        }
    }
}

proptest! {
    /// Each reader gets the samples of its own topic since it came, and no other.
    ///
    /// Participants, readers and writers come and go in any order. A topic has a type for as long
    /// as it has a reader or a writer.
    #[test]
    fn places_are_given_out_again_and_nobody_hears_samples_of_another(
        steps in proptest::collection::vec(step(), 1..200),
    ) {
        let mut model = Model {
            bus: InProcessBus::new(),
            ends: Vec::new(),
            writers: Vec::new(),
            readers: Vec::new(),
            entered: 0,
            sent: 0,
        };
        for step in steps {
            if model.ends.len() < 64 || !matches!(step, Step::Enter) {
                model.carry_out(step);
            }
        }
    }
}
