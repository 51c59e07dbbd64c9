//! The program's end: opens, closes, writes and takes without ever waiting for DDS.

use super::config::{DdsConfig, Interfaces};
use super::endpoint::{Endpoint, Id, Incoming, Node, Outgoing};
use super::error::{DdsError, OpenError};
use super::qos::Mismatch;
use super::report::DdsReport;
use super::state::{DdsEntity, EndpointTable, SharedState};
use super::thread::Engine;
use replenish_os::{PiMutex, Policy, Thread, ThreadSpec, WakeFd, spawn};
use std::io;
use std::net::{IpAddr, UdpSocket};
use std::sync::Arc;

/// DDS on a thread of its own. It ends when this is dropped.
///
/// Every call takes a lock with priority inheritance for some hundred nanoseconds and allocates;
/// none waits for DDS. Any thread may call.
#[derive(Debug)]
pub struct Dds {
    shared: Arc<SharedState>,
    waker: Arc<WakeFd>,
    thread: Option<Thread<()>>,
}

impl Dds {
    /// Starts the thread, called `dds`, with the ordinary scheduling policy. `wake` is woken when
    /// there is something to [take](Self::take).
    ///
    /// # Errors
    /// [`DdsError::Config`], [`DdsError::Interface`], [`DdsError::Ipv6`], or [`DdsError::Io`] when
    /// no descriptor or thread can be had.
    pub fn start(config: &DdsConfig, wake: Arc<WakeFd>) -> Result<Self, DdsError> {
        config.validate()?;
        if let Interfaces::Only(addresses) = &config.interfaces {
            addresses.iter().try_for_each(|address| is_here(*address))?;
        }
        let io = |what| move |source: io::Error| DdsError::Io { what, source };
        let waker = Arc::new(WakeFd::new().map_err(io("make a wake-up for DDS"))?);
        let shared = Arc::new(SharedState {
            table: PiMutex::new(EndpointTable::new(config.limits)),
            program: wake,
        });
        let engine = Engine::new(config.clone(), Arc::clone(&shared), Arc::clone(&waker));
        let spec = ThreadSpec::new("dds").policy(Policy::Other);
        let thread = spawn(spec, move || engine.run())
            .map_err(|error| io("start the thread of DDS")(io::Error::other(error)))?;
        Ok(Self {
            shared,
            waker,
            thread: Some(thread),
        })
    }

    /// Announces a node under an `id` that was not used before.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn open_node(&self, id: Id, node: Node) -> Result<(), OpenError> {
        self.open_entity(id, DdsEntity::Node(node))
    }

    /// Opens an endpoint under an `id` that was not used before. Whether DDS takes it is told by
    /// the [report](Self::report); samples can be written at once.
    ///
    /// # Errors
    /// See [`OpenError`].
    pub fn open(&self, id: Id, endpoint: Endpoint) -> Result<(), OpenError> {
        self.open_entity(id, DdsEntity::Endpoint(endpoint))
    }

    fn open_entity(&self, id: Id, entity: DdsEntity) -> Result<(), OpenError> {
        self.shared.table.lock().open(id, entity)?;
        self.wake();
        Ok(())
    }

    /// Closes an endpoint or node, with what waits for it in both directions.
    pub fn close(&self, id: Id) {
        self.shared.table.lock().close(id);
        self.wake();
    }

    /// Queues a sample for DDS. Without room the oldest samples of the endpoint are dropped and
    /// counted.
    pub fn write(&self, id: Id, outgoing: Outgoing) {
        let wake = self.shared.table.lock().write(id, outgoing);
        if wake {
            self.wake();
        }
    }

    /// The next sample from DDS, the endpoints in turn. To be called until there is none: the
    /// wake-up comes only for the first.
    pub fn take(&self) -> Option<(Id, Incoming)> {
        self.shared.table.lock().incoming.pop()
    }

    /// The next requester whose service has servers now (`true`), or none any more. To be called
    /// until there is none, after each wake-up.
    pub fn take_served(&self) -> Option<(Id, bool)> {
        self.shared.table.lock().take_served()
    }

    /// The next endpoint that does not talk with others because of its quality of service, and all
    /// policies known so far. To be called until there is none, after each wake-up.
    pub fn take_mismatch(&self) -> Option<(Id, Mismatch)> {
        self.shared.table.lock().take_mismatch()
    }

    /// See [`DdsReport::left_out`].
    #[must_use]
    pub fn left_out(&self) -> u64 {
        self.shared.table.lock().left_out
    }

    /// The state of DDS.
    #[must_use]
    pub fn report(&self) -> DdsReport {
        self.shared.table.lock().report()
    }

    fn wake(&self) {
        self.waker.wake();
    }
}

impl Drop for Dds {
    /// Ends the thread and waits for it: participants say good-bye.
    fn drop(&mut self) {
        self.shared.table.lock().stop();
        self.wake();
        if let Some(thread) = self.thread.take() {
            drop(thread.join());
        }
    }
}

fn is_here(address: IpAddr) -> Result<(), DdsError> {
    if address.is_ipv6() {
        return Err(DdsError::Ipv6(address));
    }
    match UdpSocket::bind((address, 0)) {
        Ok(_) => Ok(()),
        Err(_) => Err(DdsError::Interface(address)),
    }
}
