//! One thread's recording as stretches of time: callbacks, waits, time off the CPU, time without
//! budget.

use replenish_recorder::{Event, Kind};

/// A stretch of time, its end not included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Stretch {
    pub(crate) from: u64,
    pub(crate) to: u64,
}

impl Stretch {
    pub(crate) const fn covers(self, time: u64) -> bool {
        self.from <= time && time < self.to
    }

    /// The time that both have in common.
    pub(crate) fn common(self, other: Self) -> u64 {
        let (from, to) = (self.from.max(other.from), self.to.min(other.to));
        to.saturating_sub(from)
    }
}

/// Something that takes time.
pub(crate) trait Timed {
    fn time(&self) -> Stretch;
}

macro_rules! timed {
    ($($kind:ty),*) => {$(
        impl Timed for $kind {
            fn time(&self) -> Stretch {
                self.time
            }
        }
    )*};
}

timed!(Slice, Wait, Off, Queue);

impl Timed for Stretch {
    fn time(&self) -> Stretch {
        *self
    }
}

/// The one that covers this moment, of some in their order.
fn at<T: Timed>(all: &[T], time: u64) -> Option<&T> {
    let n = all.partition_point(|one| one.time().from <= time);
    let last = all.get(n.checked_sub(1)?)?;
    last.time().covers(time).then_some(last)
}

/// The items of `all`, which are in order, that have time in common with `whole`.
pub(crate) fn within<T: Timed>(all: &[T], whole: Stretch) -> impl Iterator<Item = &T> {
    let n = all.partition_point(|one| one.time().to <= whole.from);
    let rest = all.iter().skip(n);
    rest.take_while(move |one| one.time().from < whole.to)
}

/// A callback from its begin to its end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slice {
    pub(crate) handle: u32,
    pub(crate) release: u64,
    pub(crate) time: Stretch,
}

/// A wait of the worker for its bell or its next release.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wait {
    /// Up to the moment at which the worker was runnable.
    pub(crate) time: Stretch,
    /// The wait returned: the worker has the CPU.
    pub(crate) awake: u64,
}

/// Time off the CPU, from the kernel's switch records.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Off {
    pub(crate) time: Stretch,
    pub(crate) blocked: bool,
}

/// A callback's wait for its group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Queue {
    pub(crate) time: Stretch,
    /// The handle that ran; 0 if it had just ended.
    pub(crate) holder: u32,
}

/// A callback that ended after its deadline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Late {
    pub(crate) handle: u32,
    pub(crate) deadline: u64,
    /// From the release to the end.
    pub(crate) response: Stretch,
}

/// The facts about a thread that do not change.
#[derive(Debug, Clone, Default)]
pub(crate) struct Facts {
    /// The worker's name; with the program's, if that is another one.
    pub(crate) name: String,
    pub(crate) cpu: Option<u64>,
    /// Real-time priority as the kernel granted it; 0 without one.
    pub(crate) priority: u8,
    /// Budget and period.
    pub(crate) budget: Option<(u64, u64)>,
}

/// One thread.
#[derive(Debug, Clone, Default)]
pub(crate) struct Timeline {
    pub(crate) facts: Facts,
    pub(crate) slices: Vec<Slice>,
    pub(crate) waits: Vec<Wait>,
    pub(crate) offs: Vec<Off>,
    /// There are switch records: `offs` are all of them.
    pub(crate) exact: bool,
    /// At the low level.
    pub(crate) low: Vec<Stretch>,
    /// Readings of the CPU clock: time, CPU time so far.
    pub(crate) used: Vec<(u64, u64)>,
    pub(crate) queues: Vec<Queue>,
    /// Publications and marks.
    pub(crate) points: Vec<(u64, Kind, u32)>,
    pub(crate) late: Vec<Late>,
    /// From here on no event is missing.
    pub(crate) complete_from: u64,
}

/// A stretch that has no end yet.
const OPEN: u64 = u64::MAX;

impl Timeline {
    /// From the events of the thread and those of its budget, each in the order of writing.
    /// `overwritten`: whether older ones were overwritten.
    pub(crate) fn new(
        facts: Facts,
        thread: &[Event],
        budget: &[Event],
        overwritten: [bool; 2],
    ) -> Self {
        let mut this = Self {
            facts,
            ..Self::default()
        };
        for (ring, overwritten) in [thread, budget].into_iter().zip(overwritten) {
            let mut in_order = ring
                .iter()
                .filter(|e| !matches!(e.kind, Kind::Off | Kind::On));
            if let Some(oldest) = in_order.next().filter(|_| overwritten) {
                this.complete_from = this.complete_from.max(oldest.time);
            }
        }
        this.of_thread(thread);
        let mut budget = budget.to_vec();
        budget.sort_by_key(|event| event.time); // switches are written when they are read
        this.of_budget(&budget);
        this
    }

    fn of_thread(&mut self, events: &[Event]) {
        let (mut open, mut blocked, mut queue) = (None, None, None);
        let mut gap = 0;
        for event in events {
            let time = event.time;
            match event.kind {
                Kind::Block => blocked = Some(time),
                Kind::Wake => {
                    let said = (event.b > 0).then_some(event.b);
                    // Before its first wait the worker did not exist.
                    let from = said.or(blocked.take()).unwrap_or(time).min(time);
                    let time = Stretch { from, to: time };
                    let awake = event.a.max(time.to);
                    self.waits.push(Wait { time, awake });
                }
                Kind::Queue => queue = Some((time, event.a)),
                Kind::Begin => {
                    if let Some((from, holder)) = queue.take() {
                        let time = Stretch { from, to: time };
                        let holder = u32::try_from(holder).unwrap_or(0);
                        self.queues.push(Queue { time, holder });
                    }
                    open = Some(*event);
                }
                Kind::End => {
                    if let Some(begin) = open.take() {
                        self.slices.push(Slice {
                            handle: begin.name,
                            release: begin.a,
                            time: Stretch {
                                from: begin.time,
                                to: time,
                            },
                        });
                    }
                }
                // Nothing is certain of what had begun.
                Kind::Gap => {
                    (open, blocked, queue) = (None, None, None);
                    gap = time;
                }
                Kind::Used => self.used.push((time, event.b)),
                Kind::Publish | Kind::Mark => self.points.push((time, event.kind, event.name)),
                Kind::Miss => {
                    let response = event.a.saturating_add(event.b);
                    let from = time.saturating_sub(response);
                    if from >= gap {
                        self.late.push(Late {
                            handle: event.name,
                            deadline: event.b,
                            response: Stretch { from, to: time },
                        });
                    }
                }
                _ => {}
            }
        }
        if let Some(from) = blocked {
            let time = Stretch { from, to: OPEN };
            self.waits.push(Wait { time, awake: OPEN });
        }
        if let Some(begin) = open {
            let time = Stretch {
                from: begin.time,
                to: OPEN,
            };
            self.slices.push(Slice {
                handle: begin.name,
                release: begin.a,
                time,
            });
        }
    }

    fn of_budget(&mut self, events: &[Event]) {
        let (mut off, mut low): (Option<(u64, bool)>, Option<u64>) = (None, None);
        for event in events {
            let time = event.time;
            match event.kind {
                Kind::Off => {
                    self.exact = true;
                    off = off.or(Some((time, event.a == 1)));
                }
                Kind::On => {
                    self.exact = true;
                    if let Some((from, blocked)) = off.take() {
                        let time = Stretch { from, to: time };
                        self.offs.push(Off { time, blocked });
                    }
                }
                Kind::Level if event.a == 1 => low = low.or(Some(time)),
                Kind::Level => {
                    if let Some(from) = low.take() {
                        self.low.push(Stretch { from, to: time });
                    }
                }
                Kind::Activate | Kind::Block | Kind::Unblock | Kind::Used => {
                    self.used.push((time, event.b));
                }
                _ => {}
            }
        }
        if let Some((from, blocked)) = off {
            let time = Stretch { from, to: OPEN };
            self.offs.push(Off { time, blocked });
        }
        self.low.extend(low.map(|from| Stretch { from, to: OPEN }));
        self.used.sort_unstable();
    }

    /// The callback that runs at this moment.
    pub(crate) fn slice_at(&self, time: u64) -> Option<&Slice> {
        at(&self.slices, time)
    }

    /// The time off the CPU that covers this moment.
    pub(crate) fn off_at(&self, time: u64) -> Option<&Off> {
        at(&self.offs, time)
    }

    /// The wait for a group that covers this moment.
    pub(crate) fn queue_at(&self, time: u64) -> Option<&Queue> {
        at(&self.queues, time)
    }

    /// The last wait that began by then.
    pub(crate) fn wait_at(&self, time: u64) -> Option<&Wait> {
        let n = self.waits.partition_point(|w| w.time.from <= time);
        self.waits.get(n.checked_sub(1)?)
    }

    /// Since when its level is low at this moment.
    pub(crate) fn low_at(&self, time: u64) -> Option<u64> {
        at(&self.low, time).map(|low| low.from)
    }

    /// The time in `stretch` in which switch records show it on the CPU.
    pub(crate) fn on_cpu(&self, stretch: Stretch) -> u64 {
        let off = within(&self.offs, stretch).map(|o| o.time.common(stretch));
        let whole = stretch.to.saturating_sub(stretch.from);
        whole.saturating_sub(off.fold(0, u64::saturating_add))
    }

    /// Whether it runs at this moment, as far as is known.
    pub(crate) fn runs_at(&self, time: u64) -> bool {
        if self.exact {
            return time >= self.complete_from
                && !self.used.is_empty()
                && self.off_at(time).is_none();
        }
        match self.wait_at(time) {
            Some(wait) => time >= wait.awake,
            None => self.slice_at(time).is_some(),
        }
    }
}
