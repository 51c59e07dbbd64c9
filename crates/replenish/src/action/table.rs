//! The goals of one server: a fixed number of places, and what becomes of each. Pure.
//!
//! ```text
//!             offer                  accept             end            expire, make room
//!   free ───────────────► offered ───────────► under way ──► ended ─────────────────────► free
//!     ▲   a goal comes       │                                │ ▲
//!     └──────────────────────┘ reject          askers: answered └─ asked again: answered
//! ```
//!
//! A goal that has ended keeps its place and its result until it expires. If all places are taken
//! before that, the goal that ended first among those whose result a client has got makes room.
//! Everything is allocated when the table is made.

use super::state::{GoalEvent, GoalState};
use crate::Nanos;
use alloc::boxed::Box;
use alloc::vec::Vec;
use replenish_msg::action_msgs::{
    CancelGoalRequest, CancelGoalResponse, GoalInfo, GoalStatus, MAX_GOALS,
};
use replenish_msg::builtin_interfaces::Time;
use replenish_msg::heapless;
use replenish_msg::unique_identifier_msgs::UUID;

/// A place in the table and which of its goals: a later one has a higher number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Ticket {
    place: usize,
    turn: u64,
}

/// The goals, and the clients (`T`) that have asked for results.
pub(crate) struct Table<T> {
    places: Vec<Place<T>>,
    turns: u64,
    askers: usize,
    keep: Nanos,
}

struct Place<T> {
    turn: u64,
    info: GoalInfo,
    life: Life,
    /// The clients that wait for the result.
    askers: Vec<T>,
    /// The encoded answer to requests for the result, once the goal has ended.
    result: Box<[u8]>,
    len: usize,
    /// A client has got the result.
    told: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Life {
    Free,
    Offered,
    UnderWay(GoalState),
    /// In which state, and when.
    Ended(GoalState, Nanos),
}

/// Reason why a goal is not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NoPlace {
    /// The most goals are there already.
    Full { limit: usize },
    /// A goal of this id is there already.
    Known,
}

/// The answer to a request for a result.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Asked<'t, T> {
    /// The goal has ended: the answer, and the client that asked.
    Ended(&'t [u8], T),
    /// It will be answered.
    Waits,
    /// There is no such goal.
    Unknown(T),
    /// The most clients wait for it already.
    TooMany { limit: usize },
}

impl<T> Table<T> {
    /// `goals` places with results of up to `size` bytes, for which `askers` may wait each, kept
    /// for `keep` nanoseconds after the end.
    pub(crate) fn new(goals: usize, askers: usize, size: usize, keep: Nanos) -> Self {
        let place = || Place {
            turn: 0,
            info: GoalInfo::default(),
            life: Life::Free,
            askers: Vec::with_capacity(askers),
            result: alloc::vec![0; size].into(),
            len: 0,
            told: false,
        };
        Self {
            places: (0..goals).map(|_| place()).collect(),
            turns: 0,
            askers,
            keep,
        }
    }

    /// Keeps a place for a goal that may be accepted.
    pub(crate) fn offer(&mut self, id: UUID) -> Result<Ticket, NoPlace> {
        if self.places.iter().any(|p| p.is(id)) {
            return Err(NoPlace::Known);
        }
        let limit = self.places.len();
        let free = self.places.iter().position(|p| p.life == Life::Free);
        let place = free.or_else(|| self.dispensable());
        let place = place.ok_or(NoPlace::Full { limit })?;
        self.turns += 1;
        let turn = self.turns;
        if let Some(p) = self.places.get_mut(place) {
            p.clear();
            p.turn = turn;
            p.life = Life::Offered;
            p.info.goal_id = id;
        }
        Ok(Ticket { place, turn })
    }

    /// The goal that ended first among those whose result a client has got.
    fn dispensable(&self) -> Option<usize> {
        let places = self.places.iter().enumerate();
        let ended = places.filter_map(|(at, p)| match p.life {
            Life::Ended(_, since) if p.told && p.askers.is_empty() => Some((since, p.turn, at)),
            _ => None,
        });
        ended.min().map(|(_, _, at)| at)
    }

    fn place(&mut self, ticket: Ticket) -> Option<&mut Place<T>> {
        let place = self.places.get_mut(ticket.place)?;
        Some(place).filter(|p| p.turn == ticket.turn)
    }

    /// A goal that was offered is accepted.
    pub(crate) fn accept(&mut self, ticket: Ticket, stamp: Time, state: GoalState) {
        if let Some(place) = self.place(ticket).filter(|p| p.life == Life::Offered) {
            place.info.stamp = stamp;
            place.life = Life::UnderWay(state);
        }
    }

    /// A goal that was offered is not accepted.
    pub(crate) fn reject(&mut self, ticket: Ticket) {
        if let Some(place) = self.place(ticket).filter(|p| p.life == Life::Offered) {
            place.clear();
        }
    }

    /// The state of a goal that was accepted; `None` when it is known no more.
    pub(crate) fn state(&self, ticket: Ticket) -> Option<GoalState> {
        let place = self.places.get(ticket.place)?;
        place.state().filter(|_| place.turn == ticket.turn)
    }

    /// Something happens to a goal that does not end it. The state it is in otherwise.
    pub(crate) fn change(
        &mut self,
        ticket: Ticket,
        event: GoalEvent,
    ) -> Result<GoalState, Option<GoalState>> {
        let place = self.place(ticket).ok_or(None)?;
        let state = place.state().ok_or(None)?;
        let next = state.after(event).filter(|s| !s.is_terminal());
        let next = next.ok_or(Some(state))?;
        place.life = Life::UnderWay(next);
        Ok(next)
    }

    /// Ends a goal at `now`; `encode` writes the answer to requests for its result. The error is
    /// the state that the goal is in, or that of `encode`.
    pub(crate) fn end<E>(
        &mut self,
        ticket: Ticket,
        event: GoalEvent,
        now: Nanos,
        encode: impl FnOnce(GoalState, &mut [u8]) -> Result<usize, E>,
    ) -> Result<Result<GoalState, E>, Option<GoalState>> {
        let place = self.place(ticket).ok_or(None)?;
        let state = place.state().ok_or(None)?;
        let next = state.after(event).filter(|s| s.is_terminal());
        let next = next.ok_or(Some(state))?;
        Ok(encode(next, &mut place.result).map(|len| {
            place.len = len;
            place.life = Life::Ended(next, now);
            next
        }))
    }

    /// Notes that a client asks for the result of `id`.
    pub(crate) fn ask(&mut self, id: UUID, asker: T) -> Asked<'_, T> {
        let limit = self.askers;
        let known = self.places.iter_mut().find(|p| p.is(id));
        match known {
            None => Asked::Unknown(asker),
            Some(p) => match p.life {
                Life::Free | Life::Offered => Asked::Unknown(asker),
                Life::Ended(..) => Asked::Ended(p.result.get(..p.len).unwrap_or_default(), asker),
                Life::UnderWay(_) if p.askers.len() < limit => {
                    p.askers.push(asker);
                    Asked::Waits
                }
                Life::UnderWay(_) => Asked::TooMany { limit },
            },
        }
    }

    /// Keeps `asker`, which the result of `id` did not reach, for a later try; `false` without
    /// room.
    pub(crate) fn postpone(&mut self, id: UUID, asker: T) -> bool {
        let limit = self.askers;
        let place = self.places.iter_mut().find(|p| p.is(id));
        let place = place.filter(|p| p.askers.len() < limit);
        place.map(|p| p.askers.push(asker)).is_some()
    }

    /// Notes that a client has got the result of `id`.
    pub(crate) fn got(&mut self, id: UUID) {
        if let Some(place) = self.places.iter_mut().find(|p| p.is(id)) {
            place.told = true;
        }
    }

    /// Hands the results of ended goals to the clients that wait for them. `tell` returns
    /// `Ok(true)` if the client got it, `Err` if it never will, and `Ok(false)` if it is to be
    /// tried again. Returns the last error; every client gets its turn whatever becomes of the
    /// others.
    pub(crate) fn deliver<E>(
        &mut self,
        mut tell: impl FnMut(&T, &[u8]) -> Result<bool, E>,
    ) -> Result<(), E> {
        let mut result = Ok(());
        for place in &mut self.places {
            if !matches!(place.life, Life::Ended(..)) {
                continue;
            }
            let answer = place.result.get(..place.len).unwrap_or_default();
            let told = &mut place.told;
            place.askers.retain(|asker| match tell(asker, answer) {
                Ok(settled) => {
                    *told |= settled;
                    !settled
                }
                Err(e) => {
                    result = Err(e);
                    false
                }
            });
        }
        result
    }

    /// Whether a result is to be delivered still.
    pub(crate) fn has_undelivered(&self) -> bool {
        let mut places = self.places.iter();
        places.any(|p| matches!(p.life, Life::Ended(..)) && !p.askers.is_empty())
    }

    /// Forgets the goals whose time is over at `now`; how many.
    pub(crate) fn expire(&mut self, now: Nanos) -> usize {
        let mut expired = 0;
        for place in &mut self.places {
            if matches!(place.life, Life::Ended(_, since) if since.saturating_add(self.keep) <= now)
            {
                place.clear();
                expired += 1;
            }
        }
        expired
    }

    /// Time at which the next goal expires.
    pub(crate) fn next_expiry(&self) -> Option<Nanos> {
        let ended = self.places.iter().filter_map(|p| match p.life {
            Life::Ended(_, since) => Some(since.saturating_add(self.keep)),
            _ => None,
        });
        ended.min()
    }

    /// The goals that `request` means and that can be canceled.
    pub(crate) fn cancelable(&self, request: &CancelGoalRequest) -> heapless::Vec<UUID, MAX_GOALS> {
        let meant = self.places.iter().filter(|p| p.is_meant(request));
        let can = meant.filter(|p| {
            p.state()
                .is_some_and(|s| s.after(GoalEvent::Cancel).is_some())
        });
        can.map(|p| p.info.goal_id).take(MAX_GOALS).collect()
    }

    /// Cancels what `request` means, as far as it is among the `agreed`; `answer` gets the outcome.
    pub(crate) fn cancel(
        &mut self,
        request: &CancelGoalRequest,
        agreed: &[UUID],
        answer: &mut CancelGoalResponse,
    ) {
        answer.goals_canceling.clear();
        let id = request.goal_info.goal_id;
        let (mut named, mut could) = (None, false);
        for place in &mut self.places {
            let Some(state) = place.state() else {
                continue;
            };
            if place.info.goal_id == id {
                named = Some(state);
            }
            if state.is_terminal() || !place.is_meant(request) {
                continue;
            }
            could = true;
            if let Some(next) = state.after(GoalEvent::Cancel) {
                if !agreed.contains(&place.info.goal_id) {
                    continue;
                }
                place.life = Life::UnderWay(next);
            }
            // One that is being canceled already is named again.
            answer.goals_canceling.push(place.info).ok();
        }
        let by_id = id != UUID::default();
        answer.return_code = match (by_id, named) {
            _ if !answer.goals_canceling.is_empty() => CancelGoalResponse::ERROR_NONE,
            _ if could => CancelGoalResponse::ERROR_REJECTED,
            (true, None) => CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID,
            (true, Some(_)) => CancelGoalResponse::ERROR_GOAL_TERMINATED,
            (false, _) => CancelGoalResponse::ERROR_NONE,
        };
    }

    /// The goals that were accepted and are known still.
    pub(crate) fn statuses(&self) -> impl Iterator<Item = GoalStatus> + '_ {
        self.places.iter().filter_map(|p| {
            let status = p.state()?.status();
            let goal_info = p.info;
            Some(GoalStatus { goal_info, status })
        })
    }
}

impl<T> Place<T> {
    fn is(&self, id: UUID) -> bool {
        self.life != Life::Free && self.info.goal_id == id
    }

    fn state(&self) -> Option<GoalState> {
        match self.life {
            Life::Free | Life::Offered => None,
            Life::UnderWay(state) | Life::Ended(state, _) => Some(state),
        }
    }

    /// Whether a request to cancel is about this goal: with an id, that one; with a stamp, those
    /// accepted until then; with neither, all.
    fn is_meant(&self, request: &CancelGoalRequest) -> bool {
        let GoalInfo { goal_id, stamp } = request.goal_info;
        let (by_id, by_time) = (goal_id != UUID::default(), stamp != Time::default());
        let this = by_id && self.info.goal_id == goal_id;
        let before = by_time && self.info.stamp <= stamp;
        this || before || !(by_id || by_time)
    }

    fn clear(&mut self) {
        self.life = Life::Free;
        self.info = GoalInfo::default();
        self.askers.clear();
        (self.len, self.told) = (0, false);
    }
}

#[cfg(test)]
#[cfg(not(loom))]
#[path = "table_tests.rs"]
mod tests;
