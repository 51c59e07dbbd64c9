//! Their client on a UDP socket.

use crate::until;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};
use zerodds_xrce::header::ClientKey;
use zerodds_xrce::object_id::ObjectId;
use zerodds_xrce::object_info::ResultStatusCode;
use zerodds_xrce::object_kind::ObjectKind;
use zerodds_xrce::object_repr::{ObjectVariant, ObjectVariantExtra};
use zerodds_xrce::submessages::read_data::DataDeliveryControl;
use zerodds_xrce::submessages::write_data::DataFormat;
use zerodds_xrce_client::{ClientError, ClientEvent, ClientState, ClientTransport, XrceClient};

/// Their socket, and the next number on their best-effort stream if it is put right here: the
/// client numbers every message of it 0 (8.3.2.3 wants them counted), of which an agent takes one.
struct Socket(UdpSocket, Option<u16>);

impl ClientTransport for Socket {
    fn send(&mut self, payload: &[u8]) -> Result<(), ClientError> {
        let mut datagram = payload.to_vec();
        if let (Some(next), [_, 0x01, low, high, ..]) = (&mut self.1, &mut datagram[..]) {
            assert_eq!(
                [*low, *high],
                [0, 0],
                "they count now: no need for this any more"
            );
            [*low, *high] = next.to_le_bytes();
            *next = next.wrapping_add(1);
        }
        let sent = self.0.send(&datagram);
        sent.map(drop).map_err(|_| ClientError::QueueFull)
    }

    fn try_recv(&mut self) -> Result<Option<Vec<u8>>, ClientError> {
        let mut buf = [0; 65_536];
        match self.0.recv(&mut buf) {
            Ok(len) => Ok(Some(buf[..len].to_vec())),
            Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
            Err(error) => panic!("{error}"),
        }
    }
}

pub(crate) struct Theirs {
    client: XrceClient<Socket>,
    started: Instant,
    /// Accepted requests.
    accepted: Vec<u16>,
    pub(crate) got: Vec<Vec<u8>>,
}

impl Theirs {
    /// A client with a session and a participant.
    pub(crate) fn connect(agent: SocketAddr, key: u8) -> Self {
        Self::numbering(agent, key, true)
    }

    /// The same; its best-effort messages get their numbers, or stay as they are.
    pub(crate) fn numbering(agent: SocketAddr, key: u8, numbering: bool) -> Self {
        let next = numbering.then_some(0);
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(agent).unwrap();
        socket.set_nonblocking(true).unwrap();
        let mut theirs = Self {
            client: XrceClient::new(ClientKey([key; 4]), 0x81, Socket(socket, next)),
            started: Instant::now(),
            accepted: Vec::new(),
            got: Vec::new(),
        };
        theirs.client.connect([1, 0]).unwrap();
        until("a session", || {
            theirs.turn();
            theirs.client.state() == ClientState::Connected
        });
        let xml = "<dds><participant><rtps><name>p</name></rtps></participant></dds>";
        let domain = ObjectVariantExtra {
            domain_id: Some(0),
            ..ObjectVariantExtra::default()
        };
        theirs.create(1, ObjectKind::Participant, xml, domain);
        theirs
    }

    fn create(&mut self, number: u16, kind: ObjectKind, xml: &str, extra: ObjectVariantExtra) {
        let form = ObjectVariant::ByXmlString(xml.into());
        let id = ObjectId::new(number, kind).unwrap();
        let request = self
            .client
            .create_object(id, form, extra, false, true, true);
        let request = request.unwrap();
        until("the status", || {
            self.turn();
            self.accepted.contains(&request)
        });
    }

    fn below(parent: ObjectKind) -> ObjectVariantExtra {
        ObjectVariantExtra {
            parent: Some(ObjectId::new(1, parent).unwrap()),
            ..ObjectVariantExtra::default()
        }
    }

    fn topic(&mut self, number: u16, topic: &str) -> String {
        let inner = format!("<kind>NO_KEY</kind><name>{topic}</name><dataType>T</dataType>");
        let xml = format!("<dds><topic>{inner}</topic></dds>");
        self.create(
            number,
            ObjectKind::Topic,
            &xml,
            Self::below(ObjectKind::Participant),
        );
        inner
    }

    /// A data writer.
    pub(crate) fn writes(&mut self, topic: &str) {
        let inner = self.topic(1, topic);
        self.create(
            1,
            ObjectKind::Publisher,
            "",
            Self::below(ObjectKind::Participant),
        );
        let xml = format!("<dds><data_writer><topic>{inner}</topic></data_writer></dds>");
        self.create(
            1,
            ObjectKind::DataWriter,
            &xml,
            Self::below(ObjectKind::Publisher),
        );
    }

    /// A data reader that gets everything.
    pub(crate) fn reads(&mut self, topic: &str, reliable: bool) {
        let inner = self.topic(2, topic);
        self.create(
            1,
            ObjectKind::Subscriber,
            "",
            Self::below(ObjectKind::Participant),
        );
        let xml = format!("<dds><data_reader><topic>{inner}</topic></data_reader></dds>");
        self.create(
            1,
            ObjectKind::DataReader,
            &xml,
            Self::below(ObjectKind::Subscriber),
        );
        let reader = ObjectId::new(1, ObjectKind::DataReader).unwrap();
        let stream = if reliable { 0x80 } else { 0x01 };
        let control = DataDeliveryControl {
            max_samples: u16::MAX,
            max_elapsed_time: 0,
            max_bytes_per_second: 0,
            min_pace_period: 0,
        };
        let format = DataFormat::Data;
        let read = self
            .client
            .request_read(reader, stream, format, None, Some(control), true);
        read.unwrap();
        // READ_DATA is not answered; what is created after it is, and comes after it.
        self.topic(3, topic);
    }

    pub(crate) fn write(&mut self, payload: &[u8], reliable: bool) {
        let writer = ObjectId::new(1, ObjectKind::DataWriter).unwrap();
        self.client
            .request_write(writer, payload, reliable)
            .unwrap();
    }

    /// Takes in what has come.
    pub(crate) fn turn(&mut self) {
        let now: Duration = self.started.elapsed();
        self.client.tick(now).unwrap();
        for event in self.client.poll(now).unwrap() {
            match event {
                ClientEvent::Data { payload, .. } => self.got.push(payload),
                ClientEvent::Status {
                    request_id, code, ..
                } => {
                    let ok = matches!(code, ResultStatusCode::Ok | ResultStatusCode::OkMatched);
                    assert!(ok, "{code:?}");
                    self.accepted.push(request_id);
                }
                ClientEvent::Connected { .. } => {}
                other => panic!("{other:?}"),
            }
        }
    }

    pub(crate) fn disconnect(&mut self) {
        self.client.disconnect();
    }
}
