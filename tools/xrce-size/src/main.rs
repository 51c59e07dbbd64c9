//! A program that publishes and subscribes over the XRCE client with what micro-ROS configures: an
//! MTU of 512 bytes and four messages of history each way. It is linked and measured, never run:
//! its port is two registers in memory. With the feature `restore` it also receives fragments and
//! brings what was not acknowledged to the next agent, for which the stock client has nothing.
#![no_std]
#![no_main]
#![expect(unsafe_code, reason = "the linker must find the entry by its name")]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// The port's stand-in, as [`CLOCK`] is the clock's: the compiler may not guess their values.
static PORT: AtomicU8 = AtomicU8::new(0);
static CLOCK: AtomicU32 = AtomicU32::new(0);

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}

#[unsafe(no_mangle)]
extern "C" fn entry() -> ! {
    #[cfg(not(feature = "empty"))]
    client::run();
    #[cfg(feature = "empty")]
    loop {
        PORT.store(CLOCK.load(Ordering::Relaxed) as u8, Ordering::Relaxed);
    }
}

#[cfg(not(feature = "empty"))]
mod client {
    use super::{AtomicU8, CLOCK, Ordering, PORT};
    use replenish_xrce::client::{Buffers, Config, Event, ReliableBuffers, Session, SessionState};
    use replenish_xrce::wire::{
        ClientKey, CreationMode, DataReaderBinary, DataWriterBinary, DeliveryControl, Entity,
        GroupBinary, ObjectId, ObjectKind, ParticipantBinary, Representation, StreamId,
        TopicBinary,
    };

    const MTU: usize = 512;
    const HISTORY: usize = 4;
    const JOURNAL: usize = 256;
    /// The largest sample received in fragments.
    const FRAGMENTS: usize = if cfg!(feature = "restore") {
        MTU * HISTORY
    } else {
        0
    };
    /// Requests on their way after a new log-in.
    const RESTORE: usize = if cfg!(feature = "restore") { MTU } else { 0 };

    type Client<'a> = Session<&'a mut [u8], HISTORY, 12>;

    struct Memory {
        best_effort: [u8; MTU],
        output: [u8; MTU * HISTORY],
        input: [u8; MTU * HISTORY],
        fragments: [u8; FRAGMENTS],
        journal: [u8; JOURNAL],
        restore: [u8; RESTORE],
        datagram: [u8; MTU],
    }

    /// As much as session and buffers take, so that it shows in the figure for static RAM: here
    /// they live on the stack of a function that never returns.
    #[used]
    static RAM: [AtomicU8; size_of::<Client<'_>>() + size_of::<Memory>()] =
        [const { AtomicU8::new(0) }; size_of::<Client<'_>>() + size_of::<Memory>()];

    const PARTICIPANT: ObjectId = ObjectId::new(1, ObjectKind::Participant);
    const TOPIC: ObjectId = ObjectId::new(1, ObjectKind::Topic);
    const PUBLISHER: ObjectId = ObjectId::new(1, ObjectKind::Publisher);
    const WRITER: ObjectId = ObjectId::new(1, ObjectKind::DataWriter);
    const SUBSCRIBER: ObjectId = ObjectId::new(1, ObjectKind::Subscriber);
    const READER: ObjectId = ObjectId::new(1, ObjectKind::DataReader);

    fn create(session: &mut Client<'_>) {
        let group = Representation::Binary(GroupBinary::default());
        let entities = [
            (
                PARTICIPANT,
                Entity::Participant {
                    repr: Representation::Binary(ParticipantBinary::default()),
                    domain: 0,
                },
            ),
            (
                TOPIC,
                Entity::Topic {
                    repr: Representation::Binary(TopicBinary {
                        name: "rt/chatter",
                        type_reference: None,
                        type_name: Some("std_msgs::msg::dds_::Int32_"),
                    }),
                    participant: PARTICIPANT,
                },
            ),
            (
                PUBLISHER,
                Entity::Publisher {
                    repr: group,
                    participant: PARTICIPANT,
                },
            ),
            (
                WRITER,
                Entity::DataWriter {
                    repr: Representation::Binary(DataWriterBinary {
                        topic: TOPIC,
                        qos: None,
                    }),
                    publisher: PUBLISHER,
                },
            ),
            (
                SUBSCRIBER,
                Entity::Subscriber {
                    repr: group,
                    participant: PARTICIPANT,
                },
            ),
            (
                READER,
                Entity::DataReader {
                    repr: Representation::Binary(DataReaderBinary {
                        topic: TOPIC,
                        qos: None,
                    }),
                    subscriber: SUBSCRIBER,
                },
            ),
        ];
        for (object, entity) in entities {
            let created = session.create(object, CreationMode::REUSE_OR_REPLACE, &entity);
            PORT.store(u8::from(created.is_ok()), Ordering::Relaxed);
        }
        let read = session.read(READER, StreamId::RELIABLE, DeliveryControl::UNLIMITED);
        PORT.store(u8::from(read.is_ok()), Ordering::Relaxed);
    }

    pub(super) fn run() -> ! {
        let mut memory = Memory {
            best_effort: [0; MTU],
            output: [0; MTU * HISTORY],
            input: [0; MTU * HISTORY],
            fragments: [0; FRAGMENTS],
            journal: [0; JOURNAL],
            restore: [0; RESTORE],
            datagram: [0; MTU],
        };
        let mut session: Client<'_> = Session::new(
            Config::new(ClientKey(*b"size")),
            Buffers {
                best_effort: [&mut memory.best_effort[..]],
                reliable: [ReliableBuffers {
                    output: &mut memory.output[..],
                    large_output: &mut [],
                    input: &mut memory.input[..],
                    fragments: &mut memory.fragments[..],
                }],
                journal: &mut memory.journal[..],
                restore: &mut memory.restore[..],
            },
        );
        let now = || u64::from(CLOCK.load(Ordering::Relaxed)) * 1_000;
        session.connect(now());
        create(&mut session);
        loop {
            let len = usize::from(PORT.load(Ordering::Relaxed));
            for byte in memory.datagram.iter_mut().take(len) {
                *byte = PORT.load(Ordering::Relaxed);
            }
            let mut events = |event: Event<'_>| {
                if let Event::Data { payload, .. } = event {
                    PORT.store(payload.first().copied().unwrap_or(0), Ordering::Relaxed);
                }
            };
            if let Some(datagram) = memory.datagram.get(..len) {
                session.handle(now(), datagram, &mut events);
            }
            session.tick(now(), &mut events);
            if session.state() == SessionState::Up {
                let number = CLOCK.load(Ordering::Relaxed).to_le_bytes();
                let reliable = session.write(WRITER, StreamId::RELIABLE, &number);
                let best_effort = session.write(WRITER, StreamId::BEST_EFFORT, &number);
                let sent = reliable.is_ok() && best_effort.is_ok();
                PORT.store(u8::from(sent), Ordering::Relaxed);
            }
            while let Some(datagram) = session.poll_transmit(now()) {
                for byte in datagram {
                    PORT.store(*byte, Ordering::Relaxed);
                }
            }
        }
    }
}
