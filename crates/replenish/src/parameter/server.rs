//! Reading and setting parameters from anywhere; callbacks, and the event that tells others.

use super::descriptor::Descriptor;
use super::error::{ParameterError, ParameterErrorKind as Kind};
use super::store::{Bounds, Buffer, Mark, Setter, Table};
use super::value::{FromParameter, ParameterValue, type_name};
use crate::context::Node;
use crate::error::Error;
use crate::middleware::remedy::LARGEST;
use crate::platform::{ShortText, wall_time};
use crate::publisher::Publisher;
use crate::qos::Qos;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering};
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::fmt;
use replenish_interfaces::rcl_interfaces::msg::{ParameterEvent, ParameterView};
use replenish_msg::wire::Encode;
use replenish_msg::{CdrError, CdrWriter, Message};
use replenish_os::current_tid;

/// Limits of a node's parameters: their number and their sizes.
#[derive(Debug, Clone, Copy)]
pub struct ParameterOptions {
    bounds: Bounds,
    events: bool,
    message: usize,
}

impl Default for ParameterOptions {
    fn default() -> Self {
        Self::new()
    }
}

impl ParameterOptions {
    /// Up to 32 parameters with names of up to 64 bytes and values of up to 256 bytes, all of them
    /// declared, changes published on `/parameter_events`.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            bounds: Bounds {
                parameters: 32,
                name: 64,
                value: 256,
                undeclared: false,
                removable: false,
            },
            events: true,
            message: 4100,
        }
    }

    /// The most parameters, 1..=1024.
    #[must_use]
    pub const fn parameters(mut self, most: usize) -> Self {
        self.bounds.parameters = most;
        self
    }

    /// Sets the longest name in bytes, 1..=255.
    #[must_use]
    pub const fn name_bytes(mut self, most: usize) -> Self {
        self.bounds.name = most;
        self
    }

    /// Sets the longest value in bytes, 8..=3072; each element of a string array takes 9 more than
    /// its text at most.
    #[must_use]
    pub const fn value_bytes(mut self, most: usize) -> Self {
        self.bounds.value = most;
        self
    }

    /// Sets the longest request and response of the services in bytes, 512..=268435456; default
    /// 4100. A list of all names takes 9 more than the name for each, and their prefixes as much
    /// again at most; each of the six services keeps two such messages, and its middleware those
    /// that wait.
    #[must_use]
    pub const fn max_size(mut self, most: usize) -> Self {
        self.message = most;
        self
    }

    /// Parameters that were not declared come into being by being set, and go by being set to
    /// nothing. They are of dynamic type.
    #[must_use]
    pub const fn allow_undeclared(mut self) -> Self {
        self.bounds.undeclared = true;
        self
    }

    /// Others undeclare a parameter by setting it to nothing, unless it is read-only, as they do
    /// with rclc. Otherwise only what [came by being set](Self::allow_undeclared) goes that way.
    #[must_use]
    pub const fn others_may_undeclare(mut self) -> Self {
        self.bounds.removable = true;
        self
    }

    /// Keeps changes off `/parameter_events`.
    #[must_use]
    pub const fn no_events(mut self) -> Self {
        self.events = false;
        self
    }
}

/// A parameter that is being set, or was.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ParameterChange<'a> {
    /// The parameter's name.
    pub name: &'a str,
    /// The value before.
    pub old: ParameterValue<'a>,
    /// The value after.
    pub new: ParameterValue<'a>,
}

type Veto = Box<dyn FnMut(&ParameterChange<'_>) -> Result<(), ShortText> + Send>;
type After = Box<dyn FnMut(&ParameterChange<'_>) + Send>;

/// The parameters of one node. Clones are the same parameters; any thread may use them.
///
/// Reading waits only for other threads that copy a value: no callback runs under that lock.
/// Threads that set take turns, with priority inheritance, callbacks included.
///
/// ```
/// use replenish::{Context, Descriptor, ParameterOptions};
/// let node = Context::in_process().node("controller")?;
/// let parameters = node.parameters(ParameterOptions::new())?;
/// parameters.declare("gain", 0.5, Descriptor::new().double_range(0.0, 1.0, 0.0))?;
/// parameters.veto(|change| match change.name {
///     "gain" if change.new == 0.25.into() => Err("a quarter resonates"),
///     _ => Ok(()),
/// });
/// parameters.set("gain", 0.75)?;
/// assert_eq!(parameters.get::<f64>("gain")?, 0.75);
/// let error = parameters.set("gain", 1.5).unwrap_err();
/// assert_eq!(error.reason(), "gain = 1.5: allowed are 0..=1 in steps of 0");
/// assert_eq!(parameters.set("gain", 0.25).unwrap_err().reason(), "gain: a quarter resonates");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Parameters {
    pub(crate) inner: Arc<Inner>,
}

pub(crate) struct Inner {
    pub(crate) node: Node,
    pub(crate) table: Mutex<Table>,
    pub(super) setters: Mutex<Setters>,
    /// Callbacks that a callback has given: they are asked from the next time on.
    late: Mutex<(Vec<Veto>, Vec<After>)>,
    /// The thread that has the setters' lock: a callback that sets must not wait for itself.
    setter: AtomicU64,
    events: Option<Publisher<ParameterEvent>>,
    /// The largest request or response in bytes.
    pub(super) message: usize,
}

pub(super) struct Setters {
    vetoes: Vec<Veto>,
    after: Vec<After>,
    old: Buffer,
}

impl Node {
    /// Parameters of this node. [`WorkerBuilder::parameters`](crate::WorkerBuilder::parameters)
    /// serves them to others.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an option out of range, [`Error::Middleware`] when
    /// `/parameter_events` cannot be published.
    pub fn parameters(&self, options: ParameterOptions) -> Result<Parameters, Error> {
        let bounds = options.bounds;
        let checks = [
            ("parameters", bounds.parameters, 1..=1024, "1..=1024"),
            ("name_bytes", bounds.name, 1..=255, "1..=255"),
            ("value_bytes", bounds.value, 8..=3072, "8..=3072"),
            (
                "max_size",
                options.message,
                512..=LARGEST,
                "512..=268435456",
            ),
        ];
        for (field, value, range, allowed) in checks {
            if !range.contains(&value) {
                let owner = alloc::format!("parameters of {}", self.name());
                return Err(Error::parameter(owner, field, &value, allowed));
            }
        }
        let events = if options.events {
            Some(self.publisher("/parameter_events", Qos::parameter_events())?)
        } else {
            None
        };
        let inner = Inner {
            node: self.clone(),
            table: Mutex::new(Table::new(bounds)),
            setters: Mutex::new(Setters {
                vetoes: Vec::new(),
                after: Vec::new(),
                old: Buffer::new(bounds.value),
            }),
            late: Mutex::new((Vec::new(), Vec::new())),
            setter: AtomicU64::new(0),
            events,
            message: options.message,
        };
        Ok(Parameters {
            inner: Arc::new(inner),
        })
    }
}

/// A list of what is to be set, which can be gone through several times.
pub(crate) trait Wishes<'v>: Iterator<Item = (&'v str, ParameterValue<'v>)> + Clone {}

impl<'v, I: Iterator<Item = (&'v str, ParameterValue<'v>)> + Clone> Wishes<'v> for I {}

impl Parameters {
    /// A new parameter with its first value, whose type it keeps unless the descriptor says
    /// otherwise. A value of the program's arguments (`-p`, `--params-file`) goes before it.
    /// Allocates for the descriptor, and for a value from outside.
    ///
    /// # Errors
    /// [`ParameterError`]: its kind says which.
    pub fn declare<'v>(
        &self,
        name: &str,
        value: impl Into<ParameterValue<'v>>,
        descriptor: Descriptor,
    ) -> Result<(), ParameterError> {
        let node = &self.inner.node;
        let value = (value.into(), descriptor.dynamic);
        let args = node.context().process_args();
        args.declared(node.name(), name, value, |value| {
            let stage = |table: &mut Table| table.declare(name, &value, descriptor);
            self.change(stage, core::iter::once((name, value.clone())))
        })
    }

    /// Removes a parameter. A [veto](Self::veto) is asked with
    /// [`NotSet`](ParameterValue::NotSet) as the new value.
    ///
    /// # Errors
    /// If there is none of this name, it is read-only, or a callback refuses.
    pub fn undeclare(&self, name: &str) -> Result<(), ParameterError> {
        let wish = core::iter::once((name, ParameterValue::NotSet));
        self.change(|table| table.undeclare(name), wish)
    }

    /// Sets one parameter. Does not allocate.
    ///
    /// # Errors
    /// [`ParameterError`]: its kind says which; nothing has changed then.
    pub fn set<'v>(
        &self,
        name: &str,
        value: impl Into<ParameterValue<'v>>,
    ) -> Result<(), ParameterError> {
        self.set_all(Setter::Node, core::iter::once((name, value.into())))
    }

    /// Sets several parameters, all or none: one [`get_all`](Self::get_all) sees all of them
    /// changed or none.
    ///
    /// # Errors
    /// As [`set`](Self::set), for the first that cannot be set.
    pub fn set_atomically(
        &self,
        wishes: &[(&str, ParameterValue<'_>)],
    ) -> Result<(), ParameterError> {
        let wishes = wishes.iter().map(|(name, value)| (*name, value.clone()));
        self.set_all(Setter::Node, wishes)
    }

    pub(super) fn set_all<'v>(
        &self,
        setter: Setter,
        wishes: impl Wishes<'v>,
    ) -> Result<(), ParameterError> {
        let all = wishes.clone();
        let stage = |table: &mut Table| {
            let mut all = all;
            all.try_for_each(|(name, value)| table.stage(name, &value, setter))
        };
        self.change(stage, wishes)
    }

    /// The value of a parameter. Strings and arrays allocate; [`get_into`](Self::get_into) does not
    /// once there is room.
    ///
    /// # Errors
    /// If there is no such parameter, or it is of another type.
    pub fn get<T: FromParameter>(&self, name: &str) -> Result<T, ParameterError> {
        let mut value = T::default();
        self.get_into(name, &mut value)?;
        Ok(value)
    }

    /// Copies the value of a parameter.
    ///
    /// # Errors
    /// As [`get`](Self::get); `to` is unchanged then.
    pub fn get_into<T: FromParameter>(&self, name: &str, to: &mut T) -> Result<(), ParameterError> {
        let table = self.inner.table.lock();
        copy(&table, name, to)
    }

    /// Copies several values of one type, as they were at one moment.
    ///
    /// # Errors
    /// As [`get`](Self::get), for the first; those before are copied.
    pub fn get_all<T: FromParameter>(
        &self,
        names: &[&str],
        to: &mut [T],
    ) -> Result<(), ParameterError> {
        let table = self.inner.table.lock();
        let mut pairs = names.iter().zip(to);
        pairs.try_for_each(|(name, to)| copy(&table, name, to))
    }

    /// From now on `callback` is asked before anything is set, on the thread that sets. Its error
    /// is the reason for the refusal, and nothing of the set is changed. It may read parameters,
    /// not set them. To be called at set-up: allocates, and stays. A veto given in such a callback
    /// is asked from the next time on.
    pub fn veto<E: fmt::Display>(
        &self,
        mut callback: impl FnMut(&ParameterChange<'_>) -> Result<(), E> + Send + 'static,
    ) {
        let veto =
            move |change: &ParameterChange<'_>| callback(change).map_err(|e| ShortText::of(&e));
        if self.inner.is_mine() {
            self.inner.late.lock().0.push(Box::new(veto));
        } else {
            self.inner.setters.lock().vetoes.push(Box::new(veto));
        }
    }

    /// From now on `callback` gets each change, on the thread that sets, after the change is in
    /// force. Like a [veto](Self::veto) otherwise.
    pub fn after_set(&self, callback: impl FnMut(&ParameterChange<'_>) + Send + 'static) {
        if self.inner.is_mine() {
            self.inner.late.lock().1.push(Box::new(callback));
        } else {
            self.inner.setters.lock().after.push(Box::new(callback));
        }
    }

    /// Stages, asks, commits and tells.
    fn change<'v>(
        &self,
        stage: impl FnOnce(&mut Table) -> Result<(), ParameterError>,
        wishes: impl Wishes<'v>,
    ) -> Result<(), ParameterError> {
        let inner = &*self.inner;
        inner.not_nested()?;
        let mut setters = inner.setters.lock();
        inner.setter.store(me(), Ordering::Relaxed);
        let _turn = Turn(inner);
        {
            let mut late = inner.late.lock();
            setters.vetoes.append(&mut late.0);
            setters.after.append(&mut late.1);
        }
        stage(&mut inner.table.lock())?;
        let Setters { vetoes, after, old } = &mut *setters;
        for (name, new) in wishes.clone() {
            self.recall(name, old, false);
            let change = ParameterChange {
                name,
                old: old.value(),
                new,
            };
            for veto in vetoes.iter_mut() {
                veto(&change).map_err(|why| {
                    let text = format_args!("{name}: {}", why.as_str());
                    ParameterError::new(Kind::Refused, text)
                })?;
            }
        }
        {
            let mut table = inner.table.lock();
            inner.tell(&table);
            table.commit();
        }
        if after.is_empty() {
            return Ok(());
        }
        for (name, new) in wishes {
            self.recall(name, old, true);
            let change = ParameterChange {
                name,
                old: old.value(),
                new,
            };
            after.iter_mut().for_each(|tell| tell(&change));
        }
        Ok(())
    }

    /// The value before what is staged, or before what was committed last.
    fn recall(&self, name: &str, old: &mut Buffer, committed: bool) {
        let table = self.inner.table.lock();
        let value = match table.find(name) {
            Ok(slot) if committed => slot.next.value(),
            Ok(slot) => slot.now.value(),
            Err(_) => ParameterValue::NotSet,
        };
        old.keep(&value); // as large as the values themselves
    }
}

impl fmt::Debug for Parameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Parameters")
            .field("node", &self.inner.node.name())
            .finish_non_exhaustive()
    }
}

/// The turn of a thread that sets; it ends also if a callback panics.
struct Turn<'i>(&'i Inner);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.table.lock().unstage();
        self.0.setter.store(0, Ordering::Relaxed);
    }
}

fn copy<T: FromParameter>(table: &Table, name: &str, to: &mut T) -> Result<(), ParameterError> {
    let slot = table.find(name)?;
    if to.fill(&slot.now.value()) {
        Ok(())
    } else {
        let (is, wanted) = (type_name(slot.now.view().r#type), T::TYPE);
        let text = format_args!("{name}: it is of type {is}, asked for was {wanted}");
        Err(ParameterError::new(Kind::Type, text))
    }
}

/// The calling thread.
fn me() -> u64 {
    u64::from(current_tid().get().unsigned_abs())
}

impl Inner {
    /// Whether the calling thread sets: it is in one of the callbacks.
    fn is_mine(&self) -> bool {
        self.setter.load(Ordering::Relaxed) == me()
    }

    /// A callback of setting must not wait for itself.
    pub(super) fn not_nested(&self) -> Result<(), ParameterError> {
        if !self.is_mine() {
            return Ok(());
        }
        let text = format_args!("a parameter was set from a callback of setting parameters");
        Err(ParameterError::new(Kind::Nested, text))
    }

    /// Publishes the staged changes. An event that cannot be sent is left out: others can ask.
    fn tell(&self, table: &Table) {
        let Some(events) = &self.events else {
            return;
        };
        let written = |room: &mut [u8]| {
            let mut w = CdrWriter::new(room);
            wall_time().encode(&mut w)?;
            w.string(self.node.name())?;
            for mark in [Mark::New, Mark::Changed, Mark::Deleted] {
                changes(&mut w, table, mark)?;
            }
            Ok(w.len())
        };
        events.publish_with(written).ok();
    }
}

fn changes(w: &mut CdrWriter<'_>, table: &Table, mark: Mark) -> Result<(), CdrError> {
    w.sequence(table.marked(mark).count())?;
    for slot in table.marked(mark) {
        let value = slot.next.view();
        let name = &*slot.name;
        ParameterView { name, value }.put(w)?;
    }
    Ok(())
}
