//! From events to tracks: slices that nest, counters, states, instants.

use replenish_recorder::{Event, Kind};
use std::collections::{BTreeMap, BTreeSet};

/// One entry of a track.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) time: u64,
    pub(super) what: What,
}

/// The content of an entry: the begin or end of a slice, a point, or a value of the budget.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum What {
    /// A slice begins; the flow that ends there.
    Begin { name: String, flow: Option<u64> },
    /// The innermost slice ends.
    End,
    /// A point, with a value and its name, and the flow that begins there or goes through.
    Instant {
        kind: &'static str,
        name: String,
        value: Option<(&'static str, u64)>,
        flow: Option<Through>,
    },
    /// The budget that is left, ns.
    Left(u64),
    /// The level.
    Level(&'static str),
}

/// A flow at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Through {
    /// It goes on from there.
    On(u64),
    /// It ends there.
    End(u64),
}

/// A way through the trace: from a sample to its callback, as handle and arrival; or the worst
/// instance of a chain, as the chain and the instance's origin. A handle and a chain never have the
/// same id.
pub(super) type Flow = (u32, u64);

/// The flows of these events that have both ends.
pub(super) fn flows(threads: &[Vec<Event>]) -> BTreeSet<Flow> {
    let mut flows = samples(threads);
    flows.extend(worst_instances(threads));
    flows
}

/// Of each chain, the instance that took longest, of those that have a stage in the recording.
fn worst_instances(threads: &[Vec<Event>]) -> impl Iterator<Item = Flow> {
    let of = |kind: Kind| threads.iter().flatten().filter(move |e| e.kind == kind);
    let staged: BTreeSet<Flow> = of(Kind::ChainStage).map(|e| (e.name, e.a)).collect();
    let mut worst = BTreeMap::<u32, (u64, u64)>::new();
    for end in of(Kind::ChainEnd).filter(|e| staged.contains(&(e.name, e.a))) {
        let place = worst.entry(end.name).or_default();
        *place = (end.b, end.a).max(*place);
    }
    worst
        .into_iter()
        .map(|(chain, (_, origin))| (chain, origin))
}

fn samples(threads: &[Vec<Event>]) -> BTreeSet<Flow> {
    let ends = |kind: Kind, at: fn(&Event) -> u64| -> BTreeSet<Flow> {
        let events = threads.iter().flatten().filter(move |e| e.kind == kind);
        events.map(|e| (e.name, at(e))).collect()
    };
    let taken = ends(Kind::Take, |e| e.time);
    let begun = ends(Kind::Begin, |e| e.a);
    taken.intersection(&begun).copied().collect()
}

/// A flow's number.
fn number((name, time): Flow) -> u64 {
    // Mixed, so that flows of two programs in one trace differ.
    (u64::from(name) << 48 ^ time).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1
}

/// Ends the slices that are open.
fn close(entries: &mut Vec<Entry>, open: &mut Vec<bool>, time: u64) {
    let ends = open.drain(..).map(|_| Entry {
        time,
        what: What::End,
    });
    entries.extend(ends);
}

/// The track of a thread: a slice for each time it is awake, callbacks inside. A slice whose begin
/// was overwritten is left out; a callback that has not ended stays open.
pub(super) fn of_thread(
    events: &[Event],
    name: impl Fn(u32) -> String,
    flows: &BTreeSet<Flow>,
) -> Vec<Entry> {
    let mut entries = Vec::with_capacity(events.len());
    let mut open: Vec<bool> = Vec::new(); // whether it is a callback's
    let mut last = 0;
    for event in events {
        let time = event.time;
        last = last.max(time);
        let mut push = |what| entries.push(Entry { time, what });
        let flow = |flow: Flow| flows.contains(&flow).then(|| number(flow));
        let text = || match name(event.name) {
            name if name.is_empty() => event.kind.name().to_owned(),
            name => format!("{} {name}", event.kind.name()),
        };
        let point = |value, flow| What::Instant {
            kind: event.kind.name(),
            name: text(),
            value,
            flow,
        };
        match event.kind {
            Kind::Wake => {
                last = last.max(event.a);
                let waited_from = if event.b > 0 { event.b.min(time) } else { time };
                close(&mut entries, &mut open, waited_from);
                open.push(false);
                let (name, flow) = ("awake".to_owned(), None);
                let what = What::Begin { name, flow };
                entries.push(Entry { time, what });
            }
            Kind::Gap => {
                open.drain(..).for_each(|_| push(What::End));
                push(point(Some(("events", event.a)), None));
            }
            Kind::Block => open.drain(..).for_each(|_| push(What::End)),
            Kind::Begin => {
                open.push(true);
                let flow = flow((event.name, event.a));
                let name = name(event.name);
                push(What::Begin { name, flow });
            }
            Kind::End => {
                if open.last() == Some(&true) {
                    open.pop();
                    push(What::End);
                }
            }
            Kind::Take => {
                let flow = flow((event.name, time)).map(Through::On);
                push(point(Some(("bytes", event.a)), flow));
            }
            Kind::ChainStage => {
                let flow = flow((event.name, event.a)).map(Through::On);
                push(point(Some(("stage", event.b)), flow));
            }
            Kind::ChainEnd => {
                let flow = flow((event.name, event.a)).map(Through::End);
                push(point(Some(("latency_ns", event.b)), flow));
            }
            Kind::Publish | Kind::Drop => push(point(Some(("bytes", event.a)), None)),
            Kind::Miss => push(point(Some(("lateness_ns", event.a)), None)),
            Kind::Skip => push(point(Some(("count", event.a)), None)),
            Kind::Mark => push(point(Some(("value", event.a)), None)),
            Kind::Used => {} // a reading, at no point of the program's
            _ => push(point(None, None)),
        }
    }
    // Outside of a callback the thread waits, as far as its recording goes.
    if open.last() == Some(&false) {
        close(&mut entries, &mut open, last);
    }
    entries
}

/// The tracks of a budget: what is left, the level, and points for the thread's own track. `low`:
/// its level at the end.
pub(super) fn of_budget(events: &[Event], low: bool) -> [Vec<Entry>; 3] {
    let [mut left, mut levels, mut points] = [const { Vec::new() }; 3];
    let level = |low: bool| What::Level(if low { "background" } else { "high" });
    // The level before the first change is the other one; without a change, the one at the end.
    let change = events.iter().find(|e| e.kind == Kind::Level);
    if let Some(first) = events.first() {
        let what = level(change.map_or(low, |e| e.a == 0));
        let time = first.time;
        levels.push(Entry { time, what });
    }
    for event in events {
        let time = event.time;
        let value = match event.kind {
            Kind::Exhausted => Some(0),
            Kind::Level if event.a == 1 => None, // it came with its exhaustion
            Kind::Off | Kind::On => None,        // they say nothing of the budget
            Kind::Level => Some(event.b),
            _ => Some(event.a),
        };
        left.extend(value.map(|value| Entry {
            time,
            what: What::Left(value),
        }));
        match event.kind {
            Kind::Level => levels.push(Entry {
                time,
                what: level(event.a == 1),
            }),
            Kind::Exhausted | Kind::Replenished | Kind::Unblock => {
                let late = event.kind == Kind::Exhausted;
                points.push(Entry {
                    time,
                    what: What::Instant {
                        kind: event.kind.name(),
                        name: event.kind.name().to_owned(),
                        value: late.then_some(("enforcer_late_ns", event.a)),
                        flow: None,
                    },
                });
            }
            _ => {}
        }
    }
    [left, levels, points]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(time: u64, kind: Kind, name: u32, a: u64) -> Event {
        let b = 70;
        Event {
            time,
            kind,
            name,
            a,
            b,
        }
    }

    #[test]
    fn slices_nest_whatever_was_overwritten() {
        let events = [
            event(1, Kind::End, 1, 0), // its begin was overwritten
            event(2, Kind::Wake, 0, 0),
            event(3, Kind::Begin, 1, 2),
            event(4, Kind::End, 1, 2),
            event(5, Kind::Block, 0, 0),
            event(5, Kind::Block, 0, 0),
            event(6, Kind::Wake, 0, 0),
            event(7, Kind::Begin, 1, 9),
        ];
        let taken = vec![event(2, Kind::Take, 1, 4)];
        let flows = flows(&[events.to_vec(), taken]);
        assert_eq!(flows, BTreeSet::from([(1, 2)]));
        let entries = of_thread(&events, |_| "cb".into(), &flows);
        let (mut depth, mut slices) = (0, 0);
        for entry in &entries {
            match &entry.what {
                What::Begin { .. } => (depth, slices) = (depth + 1, slices + 1),
                What::End => depth -= 1,
                other => panic!("{other:?}"),
            }
            assert!(depth >= 0);
        }
        assert_eq!((depth, slices), (2, 4), "the last callback has not ended");
    }

    /// A wake-up says when the wait before it began.
    #[test]
    fn a_slice_ends_where_the_wait_began() {
        let wake = |time, awake, waited_from| Event {
            b: waited_from,
            ..event(time, Kind::Wake, 0, awake)
        };
        let events = [
            wake(2, 3, 1),
            event(4, Kind::Begin, 1, 2),
            event(5, Kind::End, 1, 2),
            wake(8, 9, 5),
        ];
        let entries = of_thread(&events, |_| "cb".into(), &BTreeSet::new());
        let ends = entries.iter().filter(|e| matches!(e.what, What::End));
        let ends: Vec<u64> = ends.map(|e| e.time).collect();
        assert_eq!(ends, [5, 5, 9], "callback, slice, and the last slice");
    }

    #[test]
    fn the_worst_instance_of_a_chain_is_a_flow_through_its_stages() {
        let chain = |time, kind, origin, b| Event {
            b,
            ..event(time, kind, 9, origin)
        };
        let stage = |time, origin, stage| chain(time, Kind::ChainStage, origin, stage);
        let end = |time, origin| chain(time, Kind::ChainEnd, origin, time - origin);
        let first = vec![stage(11, 10, 0), stage(21, 20, 0), stage(61, 60, 0)];
        // The stages of the one that took longest, which began at 1, were overwritten.
        let last = vec![end(9, 1), stage(13, 10, 1), end(14, 10), stage(25, 20, 1)];
        let last = [last, vec![end(26, 20), stage(62, 60, 1), end(65, 60)]].concat();
        let threads = [first, last];
        let flows = flows(&threads);
        assert_eq!(flows, BTreeSet::from([(9, 20)]));
        let way = number((9, 20));
        let points = threads.iter().flat_map(|events| {
            let entries = of_thread(events, |_| "c".into(), &flows).into_iter();
            entries.filter_map(|entry| match entry.what {
                What::Instant { flow, value, .. } => flow.map(|flow| (entry.time, flow, value)),
                other => panic!("{other:?}"),
            })
        });
        let expected = [
            (21, Through::On(way), Some(("stage", 0))),
            (25, Through::On(way), Some(("stage", 1))),
            (26, Through::End(way), Some(("latency_ns", 6))),
        ];
        assert_eq!(points.collect::<Vec<_>>(), expected);
    }

    #[test]
    fn a_budget_is_0_where_it_is_exhausted() {
        let events = [
            event(1, Kind::Activate, 0, 50),
            event(2, Kind::Exhausted, 0, 3),
            event(2, Kind::Level, 0, 1),
            event(9, Kind::Replenished, 0, 70),
            event(9, Kind::Level, 0, 0),
        ];
        let [left, levels, points] = of_budget(&events, false);
        let left: Vec<_> = left.into_iter().map(|e| (e.time, e.what)).collect();
        let value = |time, value| (time, What::Left(value));
        assert_eq!(
            left,
            [value(1, 50), value(2, 0), value(9, 70), value(9, 70)]
        );
        let levels: Vec<_> = levels.into_iter().map(|e| (e.time, e.what)).collect();
        let level = |time, name| (time, What::Level(name));
        assert_eq!(
            levels,
            [level(1, "high"), level(2, "background"), level(9, "high")]
        );
        assert_eq!(points.len(), 2);
    }
}
