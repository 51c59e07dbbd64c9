//! The recordings as a picture, drawn as `simulate` draws a schedule: callbacks on the CPU, what
//! each budget had left, releases, and ends of late callbacks.

use super::recorded::Recorded;
use crate::commands::simulate::gantt;
use crate::commands::simulate::lanes::{Bar, Lane};
use crate::live::Program;
use crate::live::timeline::{Facts, Slice, Stretch, Timeline, within};
use crate::time::Nanos;
use replenish_recorder::{Event, Kind, Role, ThreadView};
use std::collections::BTreeSet;

/// The end of what was recorded, as long as `part` if that is asked for.
pub(super) fn draw(programs: &[(&Program, &[Recorded])], part: Option<Nanos>) -> String {
    let events = programs.iter().flat_map(|(_, recorded)| *recorded);
    let events = events.flat_map(|r| r.events.iter().chain(&r.budget));
    let times = || events.clone().map(|event| event.time);
    let (first, last) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    let first = part.map_or(first, |part| first.max(last.saturating_sub(part)));
    let cpus: BTreeSet<u64> = threads(programs).filter_map(|(_, t, _)| t.cpu).collect();
    let cpus: Vec<u64> = cpus.into_iter().collect();
    let several = programs.len() > 1;
    let lanes: Vec<Lane> = threads(programs)
        .map(|(program, thread, recorded)| {
            let mut lane = lane(thread, recorded, (first, last));
            lane.cpu = cpus.iter().position(|cpu| Some(*cpu) == thread.cpu);
            if several {
                lane.name = format!("{} of {}", thread.name, program.view.program);
            }
            lane
        })
        .collect();
    let numbers = cpus
        .iter()
        .map(|cpu| usize::try_from(*cpu).unwrap_or(usize::MAX));
    let numbers: Vec<usize> = numbers.collect();
    gantt::draw(&lanes, &numbers, 0..last.saturating_sub(first).max(1))
}

/// The workers of all programs.
fn threads<'a>(
    programs: &'a [(&'a Program, &'a [Recorded])],
) -> impl Iterator<Item = (&'a Program, &'a ThreadView, &'a Recorded)> {
    programs.iter().flat_map(|(program, recorded)| {
        let threads = program.view.threads.iter().zip(*recorded);
        let workers = threads.filter(|(thread, _)| thread.role == Role::Worker);
        workers.map(|(thread, recorded)| (*program, thread, recorded))
    })
}

/// A lane whose time 0 is `first`.
fn lane(thread: &ThreadView, recorded: &Recorded, (first, last): (Nanos, Nanos)) -> Lane {
    let facts = Facts {
        budget: thread.budget,
        ..Facts::default()
    };
    let timeline = Timeline::new(facts, &recorded.events, &recorded.budget, [false; 2]);
    let since = |time: Nanos| time.min(last).saturating_sub(first);
    let mut bars = Vec::new();
    for slice in &timeline.slices {
        bars_of(&timeline, slice, last, &mut bars);
    }
    for bar in &mut bars {
        (bar.from, bar.to) = (since(bar.from), since(bar.to));
    }
    bars.retain(|bar| bar.to > bar.from);
    let releases = timeline.slices.iter().map(|slice| slice.release);
    let releases = releases.filter(|release| *release >= first).map(since);
    let late = timeline.late.iter().map(|late| late.response.to);
    Lane {
        name: thread.name.clone(),
        policy: thread.policy.clone(),
        cpu: None,
        bars,
        budget: corners(&recorded.budget, &since),
        full: thread.budget.map_or(0, |(budget, _)| budget),
        releases: releases.collect(),
        late: late.filter(|late| *late >= first).map(since).collect(),
    }
}

/// A callback's stretches on the CPU, each at one level.
fn bars_of(timeline: &Timeline, slice: &Slice, last: Nanos, bars: &mut Vec<Bar>) {
    let whole = Stretch {
        from: slice.time.from,
        to: slice.time.to.min(last),
    };
    let mut on = Vec::new();
    let mut from = whole.from;
    for off in within(&timeline.offs, whole) {
        on.push((from, off.time.from.max(from)));
        from = off.time.to.min(whole.to).max(from);
    }
    on.push((from, whole.to));
    for (from, to) in on {
        let mut at = from;
        for low in within(&timeline.low, Stretch { from, to }) {
            let (start, end) = (low.from.clamp(at, to), low.to.clamp(at, to));
            for (from, to, background) in [(at, start, false), (start, end, true)] {
                bars.push(Bar {
                    from,
                    to,
                    background,
                });
            }
            at = end;
        }
        bars.push(Bar {
            from: at,
            to,
            background: false,
        });
    }
}

/// CPU time left in the budget, over time.
fn corners(events: &[Event], since: &dyn Fn(Nanos) -> Nanos) -> Vec<(Nanos, Nanos)> {
    let mut events = events.to_vec();
    events.sort_by_key(|event| event.time);
    let left = |event: &Event| match event.kind {
        Kind::Exhausted => Some(0),
        Kind::Level if event.a == 0 => Some(event.b),
        Kind::Activate | Kind::Block | Kind::Unblock | Kind::Used | Kind::Replenished => {
            Some(event.a)
        }
        _ => None,
    };
    let mut corners: Vec<(Nanos, Nanos)> = Vec::new();
    for event in &events {
        let Some(now) = left(event) else { continue };
        let time = since(event.time);
        // A replenishment comes at once; use goes bit by bit.
        if let Some((_, before)) = corners.last().filter(|(_, before)| now > *before) {
            corners.push((time, *before));
        }
        corners.push((time, now));
    }
    corners
}
