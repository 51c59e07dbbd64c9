//! The dispatcher, the paper's executor thread (its Algorithm 1, corrected):
//!
//! ```text
//!   ┌─► readmit readers whose inbox has room again
//!   │   wait on the middleware              no lock held; buffered data first
//!   │   take a bounded batch into inboxes   a reader that is full leaves the interest set
//!   │   ring the workers that got samples   outside all locks, highest priority first
//!   └───┘
//! ```
//!
//! Workers end its wait when a reader that had left the set has room again, and only then.

use super::route_updates::RouteUpdates;
use super::routes::Route;
use crate::Nanos;
use crate::event::{Event, Events};
use crate::executor::wake::doorbell::Doorbell;
use crate::executor::wake::stop::StopHandle;
use crate::middleware::{
    IncompatibleQos, Interest, LinkState, Middleware, MiddlewareError, ReaderId, Room, SampleInfo,
};
use crate::platform::TEXTS;
use crate::stats::Counter;
use crate::sync::Arc;
use alloc::vec::Vec;
use replenish_os::Account;
use replenish_os::clock;
use sporadic::later;

/// The pause after the middleware has failed, in nanoseconds: it must not become a busy loop at
/// the highest priority.
const PAUSE: u64 = 10_000_000;

/// The dispatcher's counters so far.
#[derive(Debug, Default)]
pub(crate) struct DispatcherCounters {
    pub(crate) rounds: Counter,
    pub(crate) samples: Counter,
    pub(crate) failures: Counter,
}

/// The readers whose samples the dispatcher wants at the moment.
pub(crate) struct Watch {
    interest: Interest,
    /// Readers whose inbox is full.
    parked: Interest,
    link_up: bool,
    /// The middleware's status number at the last look.
    news: Option<usize>,
}

/// The dispatcher's state; lives on its thread.
pub(crate) struct Dispatcher {
    pub(crate) stop: StopHandle,
    pub(crate) middleware: Arc<dyn Middleware>,
    pub(crate) events: Arc<Events>,
    pub(crate) counters: Arc<DispatcherCounters>,
    /// Routes by reader id.
    pub(crate) routes: Vec<Option<Route>>,
    /// Changes of the routes.
    pub(crate) updates: Arc<RouteUpdates>,
    /// The workers' bells, highest priority first.
    pub(crate) bells: Vec<Arc<Doorbell>>,
}

impl Dispatcher {
    /// Dispatches until a stop is requested.
    pub(crate) fn run(&mut self, account: &mut Account) {
        self.updates.open();
        let mut watch = self.watch();
        while !self.stop.is_stopping() {
            self.round(&mut watch, account, None);
        }
        self.update(&mut watch); // what was asked for before the end
    }

    /// Carries out the changes of routes that wait.
    pub(crate) fn update(&mut self, watch: &mut Watch) {
        let (interest, parked) = (&mut watch.interest, &mut watch.parked);
        self.updates
            .carry_out(&*self.middleware, &mut self.routes, interest, parked);
    }

    /// The state at the start: the samples of every reader are wanted.
    pub(crate) fn watch(&self) -> Watch {
        Watch {
            interest: self.everybody(),
            parked: Interest::empty(),
            link_up: true,
            news: None,
        }
    }

    /// Waits, up to `deadline` if there is one, and takes what has come.
    pub(crate) fn round(
        &mut self,
        watch: &mut Watch,
        account: &mut Account,
        deadline: Option<Nanos>,
    ) {
        self.update(watch);
        let middleware: &dyn Middleware = &*self.middleware;
        let (interest, parked) = (&mut watch.interest, &mut watch.parked);
        if !parked.is_empty() {
            self.readmit(interest, parked);
        }
        account.block();
        let waited = middleware.wait(interest, deadline);
        if account.has_budget() {
            account.activate(clock::monotonic());
        }
        self.counters.rounds.count(1);
        let taken = self.take(interest, parked);
        self.ring();
        // Mostly neither, and then neither is moved.
        if (waited.is_err() || taken.is_err())
            && let Err(error) = waited.and(taken)
        {
            self.failed(&error, account, deadline);
        }
        let middleware: &dyn Middleware = &*self.middleware;
        let news = middleware.status_generation();
        if news.is_none() || news != watch.news {
            watch.news = news;
            self.notice(watch);
        }
    }

    /// Reports changes of the link, incompatible endpoints and samples that were too long.
    #[inline(never)]
    fn notice(&self, watch: &mut Watch) {
        let middleware: &dyn Middleware = &*self.middleware;
        let up = middleware.link() == LinkState::Up;
        if up != watch.link_up {
            watch.link_up = up;
            self.events.emit(&Event::Link { up });
        }
        // Without texts the event could not be read.
        while TEXTS && let Some(clash) = middleware.next_incompatible_qos() {
            self.clashed(&clash);
        }
        while TEXTS && let Some((reader, size)) = middleware.next_oversize() {
            let route = self.route(reader).into_iter();
            route.for_each(|route| route.filler.refuse(size, &self.events));
        }
    }

    #[cold]
    fn clashed(&self, clash: &IncompatibleQos) {
        let writer = clash.writer();
        let route = clash.reader().and_then(|reader| self.route(reader));
        let endpoint = route.map_or(writer.as_str(), |route| &route.shared().id);
        let event = Event::Incompatible { endpoint, clash };
        match route {
            Some(route) => route.shared().report(1, &event, &self.events),
            None => self.events.emit(&event),
        }
    }

    fn everybody(&self) -> Interest {
        let mut all = Interest::empty();
        for route in self.routes.iter().flatten() {
            if let Some((reader, _)) = route.shared().input {
                all.insert(reader);
            }
        }
        all
    }

    #[cold]
    fn readmit(&self, interest: &mut Interest, parked: &mut Interest) {
        let out = *parked;
        for reader in out.iter() {
            let inbox = self.route(reader).and_then(|r| r.shared().input.as_ref());
            if inbox.is_some_and(|(_, inbox)| !inbox.is_parked()) {
                parked.remove(reader);
                interest.insert(reader);
            }
        }
    }

    fn route(&self, reader: ReaderId) -> Option<&Route> {
        self.routes.get(usize::from(reader.0))?.as_ref()
    }

    fn take(
        &mut self,
        interest: &mut Interest,
        parked: &mut Interest,
    ) -> Result<(), MiddlewareError> {
        let routes = &mut self.routes;
        let mut oversize = false;
        let mut sink = |reader: ReaderId, info: &SampleInfo, bytes: &[u8]| {
            let route = routes.get_mut(usize::from(reader.0));
            let Some(route) = route.and_then(Option::as_mut) else {
                return Room::Left; // nobody subscribes to it any more
            };
            route.wake.defer();
            let is_full = route.deliver(info, bytes);
            oversize |= route.filler.has_oversize();
            if !is_full {
                return Room::Left;
            }
            parked.insert(reader);
            Room::Full
        };
        let taken = self.middleware.take(interest, &mut sink);
        if oversize {
            // Not before: the middleware may hold locks while it takes, which hooks may want.
            let routes = self.routes.iter_mut().flatten();
            routes.for_each(|route| route.filler.report_oversize(&self.events));
        }
        self.counters.samples.count(taken? as u64);
        Ok(())
    }

    fn ring(&self) {
        let mut now = None; // one reading for all
        self.bells.iter().for_each(|bell| bell.flush(&mut now));
    }

    /// The middleware has failed: tells, and pauses.
    #[cold]
    fn failed(&self, error: &MiddlewareError, account: &mut Account, deadline: Option<Nanos>) {
        let count = self.counters.failures.add(1);
        let event = Event::MiddlewareFailed { error, count };
        self.events.emit_rarely(count, &event);
        account.block();
        let pause = later(clock::monotonic(), PAUSE);
        clock::sleep_until(deadline.map_or(pause, |at| at.min(pause)));
        account.activate(clock::monotonic());
    }
}
