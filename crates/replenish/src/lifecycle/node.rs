//! A managed node: its callbacks, its state, and the events of its transitions.

use super::error::LifecycleError;
use super::machine::{Arrow, Outcome, State, Transition, concluded, requested};
use crate::context::Node;
use crate::error::Error;
use crate::platform;
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering};
use alloc::boxed::Box;
use core::fmt;
use replenish_interfaces::lifecycle_msgs::msg::{
    StateView, TransitionEvent, TransitionEventView, TransitionView,
};
use replenish_msg::View;
use replenish_os::current_tid;

type Callback = Box<dyn FnMut(State) -> Outcome + Send>;

/// The state of a managed node.
///
/// It changes when this program or another asks for it. Clones are the same; any thread may use
/// them. Transitions take turns, callbacks included; reading the state never waits.
///
/// ```
/// use replenish::{Context, Outcome, State, Transition};
/// let node = Context::in_process().node("camera")?;
/// let lifecycle = node.lifecycle()?;
/// let mut frames = None; // callbacks own what they work on
/// lifecycle.on_transition(Transition::Configure, move |_from| {
///     frames = Some(Vec::<u8>::with_capacity(1 << 16));
///     Outcome::Success
/// });
/// lifecycle.change(Transition::Configure)?;
/// assert_eq!(lifecycle.state(), State::Inactive);
/// let error = lifecycle.change(Transition::Deactivate).unwrap_err();
/// let text = "not allowed in state inactive; allowed are: cleanup activate shutdown";
/// assert_eq!(error.to_string(), text);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Lifecycle {
    pub(super) inner: Arc<Inner>,
}

pub(super) struct Inner {
    pub(super) node: Node,
    /// [`State::id`].
    pub(super) state: AtomicU64,
    /// Held for a transition, its callbacks included.
    pub(super) turn: Mutex<()>,
    /// Not held while one of them runs, so that it may give others.
    pub(super) callbacks: Mutex<Callbacks>,
    /// The thread that makes a transition: its callback must not wait for itself.
    pub(super) busy: AtomicU64,
    /// `None`: other programs do not hear of transitions.
    pub(super) events: Option<Publisher<TransitionEvent>>,
}

#[derive(Default)]
pub(super) struct Callbacks {
    pub(super) configure: Option<Callback>,
    pub(super) cleanup: Option<Callback>,
    pub(super) activate: Option<Callback>,
    pub(super) deactivate: Option<Callback>,
    pub(super) shutdown: Option<Callback>,
    pub(super) error: Option<Callback>,
}

impl Callbacks {
    /// The callback that runs in this state.
    fn of(&mut self, state: State) -> Option<&mut Option<Callback>> {
        Some(match state {
            State::Configuring => &mut self.configure,
            State::CleaningUp => &mut self.cleanup,
            State::Activating => &mut self.activate,
            State::Deactivating => &mut self.deactivate,
            State::ShuttingDown => &mut self.shutdown,
            State::ErrorProcessing => &mut self.error,
            _ => return None,
        })
    }
}

impl Node {
    /// Makes this a managed node, unconfigured.
    /// [`WorkerBuilder::lifecycle`](crate::WorkerBuilder::lifecycle) lets others ask for
    /// transitions.
    ///
    /// # Errors
    /// [`Error::Middleware`] when `~/transition_event` cannot be published.
    pub fn lifecycle(&self) -> Result<Lifecycle, Error> {
        let events = self.publisher("~/transition_event", Qos::reliable())?;
        Ok(self.managed(Some(events)))
    }

    /// The same without a topic of transitions: the node makes them itself, and the network does
    /// not see that it is managed, as with `enable_communication_interface = false` in rclcpp.
    #[must_use]
    pub fn lifecycle_unseen(&self) -> Lifecycle {
        self.managed(None)
    }

    fn managed(&self, events: Option<Publisher<TransitionEvent>>) -> Lifecycle {
        let inner = Inner {
            node: self.clone(),
            state: AtomicU64::new(State::Unconfigured.id().into()),
            turn: Mutex::new(()),
            callbacks: Mutex::new(Callbacks::default()),
            busy: AtomicU64::new(0),
            events,
        };
        Lifecycle {
            inner: Arc::new(inner),
        }
    }
}

impl Lifecycle {
    /// Sets the callback of a transition, which runs on the thread that asks for the transition.
    /// Without one the transition succeeds. The callback gets the state it starts from. To be
    /// called at set-up, or in a callback of a transition: allocates.
    pub fn on_transition(
        &self,
        transition: Transition,
        callback: impl FnMut(State) -> Outcome + Send + 'static,
    ) {
        let state = match transition {
            Transition::Configure => State::Configuring,
            Transition::Cleanup => State::CleaningUp,
            Transition::Activate => State::Activating,
            Transition::Deactivate => State::Deactivating,
            Transition::Shutdown => State::ShuttingDown,
        };
        self.put(state, Box::new(callback));
    }

    /// Sets the callback for errors of the other callbacks. Success: everything is put back, the
    /// node is unconfigured; anything else, and the default: it is finalized.
    pub fn on_error(&self, callback: impl FnMut(State) -> Outcome + Send + 'static) {
        self.put(State::ErrorProcessing, Box::new(callback));
    }

    fn put(&self, state: State, callback: Callback) {
        let mut callbacks = self.inner.callbacks.lock();
        if let Some(place) = callbacks.of(state) {
            *place = Some(callback);
        }
    }

    /// The state at this moment.
    #[must_use]
    pub fn state(&self) -> State {
        self.inner.state()
    }

    /// Makes a transition, callback included, and returns the state it has led to. Does not
    /// allocate.
    ///
    /// # Errors
    /// [`LifecycleError`].
    pub fn change(&self, transition: Transition) -> Result<State, LifecycleError> {
        self.inner.change(0, transition.label())
    }
}

impl fmt::Debug for Lifecycle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Lifecycle")
            .field("node", &self.inner.node.name())
            .field("state", &self.state())
            .finish_non_exhaustive()
    }
}

/// A transition is made. If a callback panics, the node is finalized.
struct Turn<'i>(&'i Inner);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        if concluded(self.0.state(), Outcome::Success).is_some() {
            let end = State::Finalized.id().into();
            self.0.state.store(end, Ordering::Release);
        }
        self.0.busy.store(0, Ordering::Relaxed);
    }
}

impl Inner {
    pub(super) fn state(&self) -> State {
        let id = u8::try_from(self.state.load(Ordering::Acquire));
        id.ok().and_then(State::of_id).unwrap_or(State::Finalized)
    }

    pub(super) fn change(&self, id: u8, label: &str) -> Result<State, LifecycleError> {
        let me = u64::from(current_tid().get().unsigned_abs());
        if self.busy.load(Ordering::Relaxed) == me {
            return Err(LifecycleError::Nested);
        }
        let _held = self.turn.lock();
        self.busy.store(me, Ordering::Relaxed);
        let _turn = Turn(self);
        let start = self.state();
        let arrow = requested(start, id, label);
        let mut arrow = arrow.ok_or(LifecycleError::NotAllowed { from: start })?;
        let mut good = true;
        loop {
            self.follow(arrow);
            let state = arrow.to;
            let Some(callback) = self.callbacks.lock().of(state).map(Option::take) else {
                break; // a state it can stay in
            };
            let outcome = match callback {
                Some(callback) => self.call(state, callback, start),
                None if state == State::ErrorProcessing => Outcome::Failure,
                None => Outcome::Success,
            };
            good &= outcome == Outcome::Success && state != State::ErrorProcessing;
            match concluded(state, outcome) {
                Some(next) => arrow = next,
                None => break,
            }
        }
        if good {
            Ok(arrow.to)
        } else {
            Err(LifecycleError::NotReached { now: arrow.to })
        }
    }

    /// Runs the callback of `state`, which stays what it was unless it gave another.
    fn call(&self, state: State, mut callback: Callback, start: State) -> Outcome {
        let outcome = callback(start);
        if let Some(place) = self.callbacks.lock().of(state) {
            place.get_or_insert(callback);
        }
        outcome
    }

    /// Enters another state and publishes that. An event that cannot be sent is left out.
    fn follow(&self, arrow: &Arrow) {
        self.state.store(arrow.to.id().into(), Ordering::Release);
        let Some(events) = &self.events else {
            return;
        };
        let stamp = platform::wall_time();
        let seconds = u64::try_from(stamp.sec).unwrap_or(0);
        let event = TransitionEventView {
            timestamp: seconds * 1_000_000_000 + u64::from(stamp.nanosec),
            transition: transition(arrow),
            start_state: described(arrow.from),
            goal_state: described(arrow.to),
        };
        events.publish_with(|room| event.encode_to(room)).ok();
    }
}

pub(super) fn transition(arrow: &Arrow) -> TransitionView<'static> {
    let (id, label) = (arrow.id, arrow.label);
    TransitionView { id, label }
}

pub(super) fn described(state: State) -> StateView<'static> {
    let (id, label) = (state.id(), state.label());
    StateView { id, label }
}
