//! Builds the parts of an executor from its description, before anything has a thread: workers with
//! their mailboxes, the dispatcher with its routes, and the way to change them later.

use crate::context::Context;
use crate::event::Events;
use crate::executor::change::live::{Live, Post};
use crate::executor::change::registry::Registry;
use crate::executor::handles::own_source::OwnSource;
use crate::executor::handles::state::HandleState;
use crate::executor::run::dispatcher::{Dispatcher, DispatcherCounters};
use crate::executor::run::mailbox::Mailbox;
use crate::executor::run::route_updates::RouteUpdates;
use crate::executor::run::routes::Route;
use crate::executor::run::state::{Worker, WorkerSpec};
use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::executor::wake::run_queue::RunQueue;
use crate::executor::wake::stop::StopHandle;
use crate::middleware::{MAX_READERS, SourceSet};
use crate::platform::{FULL, STD, Static, make_static};
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_os::Policy;

/// The parts of an executor.
pub(crate) struct Assembly {
    pub(crate) dispatcher: Dispatcher,
    pub(crate) workers: Vec<Static<Box<Worker>>>,
    pub(crate) live: Arc<Live>,
}

/// The dispatcher's bells are left to the caller: whom it rings, and in which order.
#[inline(never)]
pub(crate) fn assemble(
    context: &Context,
    specs: Vec<Static<WorkerSpec>>,
    stop: &StopHandle,
    events: &Arc<Events>,
) -> Assembly {
    let mut dispatcher = Dispatcher {
        stop: stop.clone(),
        middleware: context.share_middleware(),
        events: Arc::clone(events),
        counters: Arc::new(DispatcherCounters::default()),
        routes: Vec::new(),
        updates: RouteUpdates::new(),
        bells: Vec::with_capacity(specs.len()),
    };
    if FULL {
        dispatcher.routes.resize_with(MAX_READERS, || None); // readers come without allocation
    }
    let (mut posts, mut limits) = (Vec::new(), 0);
    let mut workers = Vec::with_capacity(specs.len());
    let mut handles: Vec<(Arc<str>, Arc<HandleState>)> = Vec::new();
    for mut spec in specs {
        let limit = spec.limit();
        let bell = Arc::new(Doorbell::new(limit));
        stop.stop.join(Arc::clone(bell.notify()));
        let mailbox = Mailbox::new(spec.entries.len(), limit, Arc::clone(&bell));
        spec.order(limit);
        let sources = sources_of(context, &spec, &bell);
        let worker = Arc::clone(&spec.request.name);
        for entry in &mut spec.entries {
            if let Some(set) = &sources {
                entry.own = OwnSource::of(&entry.shared, &**context.middleware(), set, entry.slot);
            }
            handles.push((Arc::clone(&worker), Arc::clone(&entry.shared)));
            dispatcher.route_to(&entry.shared, mailbox.wake_handle(entry.slot));
        }
        limits += limit;
        let (name, urgent) = (&spec.request.name, spec.policy != Policy::Other);
        let clocked = spec.rules.every.is_some();
        let ranks = (urgent, spec.promised);
        let post = Post::new(name, &mailbox, &sources, spec.numbers(), clocked, ranks);
        posts.push(post);
        let rounds = spec.rules.rounds;
        workers.push(make_static(Box::new(Worker {
            stop: stop.clone(),
            events: Arc::clone(events),
            middleware: context.share_middleware(),
            mailbox,
            live: None,
            bell,
            run_queue: RunQueue::new(limit),
            sources,
            looks_at_all: false,
            outbox: rounds.and_then(|rounds| (rounds.outbox)(&spec.rules)),
            spec,
            grid: None,
            ran: 0,
        })));
    }
    let registry = Registry::new(handles, limits, workers.len());
    let mut groups = workers.iter().flat_map(|worker| {
        let entries = worker.spec.entries.iter();
        let groups = entries.filter_map(|entry| entry.handling.group.as_ref());
        groups.map(|group| (&worker.spec.request.name, group))
    });
    let updates = &dispatcher.updates;
    let live = Live::new(context, stop, registry, updates, posts, &mut groups);
    for worker in &mut workers {
        worker.live = Some(Arc::clone(&live));
    }
    Assembly {
        dispatcher,
        workers,
        live,
    }
}

/// The descriptors of a worker that waits by itself, and whose middleware hands it samples.
fn sources_of(
    context: &Context,
    spec: &WorkerSpec,
    bell: &Arc<Doorbell>,
) -> Option<Arc<SourceSet>> {
    let waits = STD && !spec.rules.spun && context.middleware().has_sources();
    waits.then(|| SourceSet::new(bell.notify())).flatten()
}

impl Dispatcher {
    fn route_to(&mut self, shared: &Arc<HandleState>, wake: WakeHandle) {
        let Some((reader, _)) = shared.input else {
            return;
        };
        let place = usize::from(reader.0);
        while self.routes.len() <= place {
            self.routes.push(None);
        }
        if let Some(route) = self.routes.get_mut(place) {
            // There is none before: a reader has one handle.
            let _before = make_static(route.replace(Route::new(Arc::clone(shared), wake)));
        }
    }
}
