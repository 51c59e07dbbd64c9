//! From what was described to what runs, before anything has a thread: workers with their
//! mailboxes, the dispatcher with its routes, and the way to change them later.

use super::StopHandle;
use super::agenda::Agenda;
use super::builder::WorkerSpec;
use super::desk::Desk;
use super::dispatcher::{Dispatcher, DispatcherCounters};
use super::doorbell::Line;
use super::handle::Shared;
use super::live::{Live, Post, Registry};
use super::mailbox::Mailbox;
use super::plan::Request;
use super::routes::Route;
use super::worker::Worker;
use crate::context::Context;
use crate::event::Events;
use crate::handoff::ReadySet;
use crate::middleware::MAX_READERS;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;

/// The parts of an executor.
pub(crate) struct Assembly {
    pub(crate) dispatcher: Dispatcher,
    pub(crate) workers: Vec<(Box<Worker>, Request)>,
    pub(crate) live: Arc<Live>,
}

/// `order`: the workers in the order in which the dispatcher rings them; those that are not in it
/// are not rung.
#[inline(never)]
pub(crate) fn assemble(
    context: &Context,
    specs: Vec<WorkerSpec>,
    stop: &StopHandle,
    events: &Arc<Events>,
    order: &[usize],
) -> Assembly {
    let mut bells = Vec::with_capacity(order.len());
    for spec in order.iter().filter_map(|w| specs.get(*w)) {
        bells.push((Arc::clone(&spec.bell), false));
    }
    let place = |worker: usize| order.iter().position(|w| *w == worker).unwrap_or(0);
    let mut dispatcher = Dispatcher {
        stop: stop.clone(),
        events: Arc::clone(events),
        counters: Arc::new(DispatcherCounters::default()),
        routes: Vec::new(),
        desk: Desk::new(),
        bells,
    };
    if cfg!(feature = "live") {
        dispatcher.routes.resize_with(MAX_READERS, || None); // readers come without allocation
    }
    let (mut posts, mut limits) = (Vec::with_capacity(specs.len()), 0);
    let mut workers = Vec::with_capacity(specs.len());
    let mut handles: Vec<(Arc<str>, Arc<Shared>)> = Vec::new();
    for (i, spec) in specs.into_iter().enumerate() {
        let name: Arc<str> = spec.request.name.as_str().into();
        let limit = spec.limit();
        let bell = Arc::clone(&spec.bell);
        stop.stop.join(Arc::clone(bell.signal()));
        let marks = Arc::new(ReadySet::new(limit));
        let (used, number) = (spec.entries.len(), spec.numbers());
        let mailbox = Mailbox::new(used, limit, Arc::clone(&bell), Arc::clone(&marks));
        let entries = WorkerSpec::ordered(spec.entries, limit);
        for entry in &entries {
            handles.push((Arc::clone(&name), Arc::clone(&entry.shared)));
            dispatcher.route_to(place(i), &entry.shared, mailbox.line(entry.slot));
        }
        limits += limit;
        posts.push(Post::new(&name, place(i), &mailbox, number));
        let rounds = spec.rules.rounds;
        let worker = Box::new(Worker {
            name,
            stop: stop.clone(),
            events: Arc::clone(events),
            mailbox,
            live: None,
            bell,
            entries,
            agenda: Agenda::new(marks, limit),
            looks_at_all: false,
            rounds,
            outbox: rounds.and_then(|rounds| (rounds.outbox)(&spec.rules)),
            rules: spec.rules,
            grid: None,
            ran: 0,
        });
        workers.push((worker, spec.request));
    }
    let registry = Registry::new(handles, limits);
    let live = Live::new(context, stop, registry, &dispatcher.desk, posts);
    for (worker, _) in &mut workers {
        worker.live = Some(Arc::clone(&live));
    }
    Assembly {
        dispatcher,
        workers,
        live,
    }
}

impl Dispatcher {
    fn route_to(&mut self, worker: usize, shared: &Arc<Shared>, line: Line) {
        let Some((reader, _)) = shared.input else {
            return;
        };
        let place = usize::from(reader.0);
        if self.routes.len() <= place {
            self.routes.resize_with(place + 1, || None);
        }
        if let Some(route) = self.routes.get_mut(place) {
            *route = Some(Route {
                shared: Arc::clone(shared),
                worker,
                line,
                hand: None,
            });
        }
    }
}
