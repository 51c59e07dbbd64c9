//! The table of goals: rules one by one, and random histories against a plain account of them.

use super::*;
use GoalEvent::{Abort, Cancel, Canceled, Execute, Succeed};
use GoalState::{Accepted, Canceling, Executing, Succeeded};
use proptest::prelude::*;

const KEEP: Nanos = 100;

fn id(n: u8) -> UUID {
    UUID { uuid: [n; 16] }
}

fn at(sec: i32) -> Time {
    Time { sec, nanosec: 0 }
}

fn table(goals: usize) -> Table<u32> {
    Table::new(goals, 2, 8, KEEP)
}

fn under_way(table: &mut Table<u32>, n: u8) -> Ticket {
    let ticket = table.offer(id(n)).unwrap();
    table.accept(ticket, at(n.into()), Executing);
    ticket
}

fn end(table: &mut Table<u32>, ticket: Ticket, event: GoalEvent, now: Nanos) -> bool {
    let encode = |end: GoalState, room: &mut [u8]| {
        room[0] = end.status().unsigned_abs();
        Ok::<usize, ()>(1)
    };
    table.end(ticket, event, now, encode).is_ok()
}

/// Delivers to all waiting clients and returns them.
fn delivered(table: &mut Table<u32>) -> Vec<u32> {
    let mut told = Vec::new();
    let tell = |asker: &u32, _: &[u8]| {
        told.push(*asker);
        Ok::<bool, ()>(true)
    };
    table.deliver(tell).unwrap();
    told
}

fn cancel(table: &mut Table<u32>, goal_id: UUID, stamp: Time) -> (i8, Vec<UUID>) {
    let request = CancelGoalRequest {
        goal_info: GoalInfo { goal_id, stamp },
    };
    let agreed = table.cancelable(&request);
    let mut answer = CancelGoalResponse::default();
    table.cancel(&request, &agreed, &mut answer);
    let goals = answer.goals_canceling.iter().map(|g| g.goal_id);
    (answer.return_code, goals.collect())
}

#[test]
fn a_full_table_names_its_limit_and_makes_room_for_what_was_told() {
    let mut table = table(2);
    let first = under_way(&mut table, 1);
    let second = under_way(&mut table, 2);
    assert_eq!(table.offer(id(3)), Err(NoPlace::Full { limit: 2 }));
    assert_eq!(table.offer(id(2)), Err(NoPlace::Known));
    assert!(end(&mut table, first, Succeed, 5));
    assert_eq!(
        table.offer(id(3)),
        Err(NoPlace::Full { limit: 2 }),
        "nobody has got its result"
    );
    assert!(matches!(table.ask(id(1), 7), Asked::Ended([4], 7)));
    table.got(id(1));
    let third = table.offer(id(3)).unwrap();
    assert_eq!(table.state(first), None, "it has made room");
    table.reject(third);
    assert_eq!(table.state(second), Some(Executing));
    assert!(matches!(table.ask(id(1), 8), Asked::Unknown(8)));
}

#[test]
fn everybody_who_asks_is_told_once_and_a_failure_is_nobody_elses() {
    let mut table = table(1);
    let goal = under_way(&mut table, 1);
    assert_eq!(table.ask(id(1), 1), Asked::Waits);
    assert_eq!(table.ask(id(1), 2), Asked::Waits);
    assert_eq!(table.ask(id(1), 3), Asked::TooMany { limit: 2 });
    assert!(!table.has_undelivered(), "it has not ended");
    assert!(end(&mut table, goal, Abort, 5));
    let outcome = |asker: &u32, answer: &[u8]| {
        assert_eq!(answer, [6]);
        match asker {
            1 => Err("gone"),
            _ => Ok(false),
        }
    };
    assert_eq!(table.deliver(outcome), Err("gone"));
    assert!(table.has_undelivered(), "the second had no room and waits");
    assert_eq!(delivered(&mut table), [2]);
    assert!(delivered(&mut table).is_empty());
}

#[test]
fn results_expire_in_their_time_and_goals_under_way_do_not() {
    let mut table = table(3);
    let [a, b, _] = [1, 2, 3].map(|n| under_way(&mut table, n));
    assert_eq!(table.next_expiry(), None);
    assert!(end(&mut table, a, Succeed, 10) && end(&mut table, b, Abort, 20));
    assert_eq!(table.next_expiry(), Some(110));
    assert_eq!((table.expire(109), table.expire(110)), (0, 1));
    assert_eq!(table.next_expiry(), Some(120));
    assert_eq!((table.expire(u64::MAX), table.statuses().count()), (1, 1));
}

#[test]
fn cancel_means_one_all_or_those_until_a_time() {
    let three = || {
        let mut table = table(4);
        for n in 1..=3 {
            under_way(&mut table, n);
        }
        table
    };
    let (none, never) = (UUID::default(), Time::default());
    assert_eq!(cancel(&mut three(), id(2), never), (0, vec![id(2)]));
    assert_eq!(cancel(&mut three(), none, never).1, [id(1), id(2), id(3)]);
    assert_eq!(cancel(&mut three(), none, at(2)).1, [id(1), id(2)]);
    assert_eq!(cancel(&mut three(), id(3), at(1)).1, [id(1), id(3)]);
    assert_eq!(
        cancel(&mut three(), none, at(0)).1.len(),
        3,
        "zeros are no time"
    );
    assert_eq!(
        cancel(&mut table(1), none, never),
        (0, vec![]),
        "no goal, no error"
    );
    let unknown = CancelGoalResponse::ERROR_UNKNOWN_GOAL_ID;
    assert_eq!(cancel(&mut three(), id(9), never), (unknown, vec![]));

    let mut table = table(2);
    let goal = under_way(&mut table, 1);
    let request = CancelGoalRequest::default();
    let mut answer = CancelGoalResponse::default();
    table.cancel(&request, &[], &mut answer);
    assert_eq!(answer.return_code, CancelGoalResponse::ERROR_REJECTED);
    assert_eq!(
        table.state(goal),
        Some(Executing),
        "the server was not willing"
    );
    assert_eq!(cancel(&mut table, id(1), never), (0, vec![id(1)]));
    assert_eq!(table.state(goal), Some(Canceling));
    assert_eq!(
        cancel(&mut table, id(1), never),
        (0, vec![id(1)]),
        "and again"
    );
    assert!(end(&mut table, goal, Canceled, 0));
    let terminated = CancelGoalResponse::ERROR_GOAL_TERMINATED;
    assert_eq!(cancel(&mut table, id(1), never), (terminated, vec![]));
}

#[test]
fn what_cannot_happen_changes_nothing() {
    let mut table = table(1);
    let goal = table.offer(id(1)).unwrap();
    assert_eq!(table.change(goal, Execute), Err(None), "not accepted yet");
    table.accept(goal, at(1), Accepted);
    assert!(!end(&mut table, goal, Succeed, 0), "not executing yet");
    assert_eq!(
        table.change(goal, Succeed),
        Err(Some(Accepted)),
        "that is an end"
    );
    assert_eq!(table.change(goal, Execute), Ok(Executing));
    let unencodable = |_, _: &mut [u8]| Err("too large");
    let ended = table.end(goal, Succeed, 0, unencodable);
    assert_eq!(ended, Ok(Err("too large")));
    assert_eq!(table.state(goal), Some(Executing));
    assert!(end(&mut table, goal, Succeed, 0));
    assert!(!end(&mut table, goal, Abort, 0));
    assert_eq!(table.state(goal), Some(Succeeded));
}

#[derive(Debug, Clone)]
enum Step {
    Offer(u8, u8),
    Event(usize, GoalEvent),
    Ask(u8),
    Cancel(u8, u8),
    Wait(u8),
}

fn step() -> impl Strategy<Value = Step> {
    let event = prop_oneof![
        Just(Execute),
        Just(Cancel),
        Just(Succeed),
        Just(Canceled),
        Just(Abort)
    ];
    prop_oneof![
        3 => (1..9_u8, 0..3_u8).prop_map(|(n, how)| Step::Offer(n, how)),
        4 => (0..30_usize, event).prop_map(|(which, event)| Step::Event(which, event)),
        2 => (1..9_u8).prop_map(Step::Ask),
        1 => (0..9_u8, 0..9_u8).prop_map(|(n, sec)| Step::Cancel(n, sec)),
        1 => (0..80_u8).prop_map(Step::Wait),
    ]
}

proptest! {
    /// The promises of a table hold after any history.
    ///
    /// No goal is in two places, and none leaves a final state. A ticket of a goal that is gone
    /// does nothing. Each request for a result has one answer or a refusal. The limit holds.
    #[test]
    fn any_history_keeps_its_promises(steps in prop::collection::vec(step(), 0..200)) {
        const GOALS: usize = 3;
        let mut table = table(GOALS);
        // Every goal that was accepted, and its state as far as it was seen.
        let mut seen: Vec<(Ticket, GoalState)> = Vec::new();
        let (mut asked, mut settled, mut now) = (0_u32, 0_usize, 0);
        for step in steps {
            match step {
                Step::Offer(n, how) => {
                    let known = table.statuses().any(|s| s.goal_info.goal_id == id(n));
                    match table.offer(id(n)) {
                        Ok(ticket) => {
                            prop_assert!(!known);
                            prop_assert_eq!(table.state(ticket), None);
                            let begin = [Accepted, Executing].get(usize::from(how));
                            match begin {
                                Some(begin) => {
                                    table.accept(ticket, at(n.into()), *begin);
                                    seen.push((ticket, *begin));
                                }
                                None => table.reject(ticket),
                            }
                        }
                        Err(NoPlace::Known) => prop_assert!(known),
                        Err(NoPlace::Full { limit }) => {
                            prop_assert!(!known);
                            prop_assert_eq!((limit, table.statuses().count()), (GOALS, GOALS));
                        }
                    }
                }
                Step::Event(which, event) if !seen.is_empty() => {
                    let (ticket, before) = seen[which % seen.len()];
                    let next = before.after(event);
                    let gone = table.state(ticket).is_none();
                    let terminal = next.is_some_and(GoalState::is_terminal);
                    let done = if terminal { end(&mut table, ticket, event, now) } else { table.change(ticket, event).is_ok() };
                    prop_assert_eq!(done, next.is_some() && !gone);
                    if done && terminal {
                        settled += delivered(&mut table).len();
                    }
                }
                Step::Event(..) => {}
                Step::Ask(n) => {
                    asked += 1;
                    match table.ask(id(n), asked) {
                        Asked::Waits => {}
                        Asked::Ended(answer, _) => {
                            let state = GoalState::from_status(answer[0].cast_signed());
                            prop_assert!(state.unwrap().is_terminal());
                            table.got(id(n));
                            settled += 1;
                        }
                        Asked::Unknown(_) | Asked::TooMany { .. } => settled += 1,
                    }
                }
                Step::Cancel(n, sec) => {
                    cancel(&mut table, id(n), at(sec.into()));
                }
                Step::Wait(time) => {
                    now += Nanos::from(time);
                    table.expire(now);
                    prop_assert!(table.next_expiry().is_none_or(|next| next > now));
                }
            }
            for (ticket, before) in &mut seen {
                if let Some(state) = table.state(*ticket) {
                    prop_assert!(state == *before || state > *before && !before.is_terminal());
                    *before = state;
                }
            }
            let mut ids: Vec<_> = table.statuses().map(|s| s.goal_info.goal_id).collect();
            ids.sort();
            let known = ids.len();
            ids.dedup();
            prop_assert_eq!((known, known <= GOALS), (ids.len(), true));
        }
        // A client that still waits gets an answer when everything ends.
        for (ticket, _) in &seen {
            end(&mut table, *ticket, Abort, now);
        }
        settled += delivered(&mut table).len();
        prop_assert_eq!(settled, usize::try_from(asked).unwrap());
    }
}
