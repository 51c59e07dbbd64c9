//! Managed nodes: what their callbacks' outcomes lead to, what others see and may ask for, and
//! publishers that are silent unless the node is active.

use crate::common::executor;
use replenish::middleware::InProcessBus;
use replenish::msg::Service;
use replenish::msg::std_msgs::Int32;
use replenish::{
    Context, Every, Executor, LifecycleError, Outcome, PublishError, Qos, SpinEnd, State,
    Transition,
};
use replenish_interfaces::lifecycle_msgs::msg::{Transition as Asked, TransitionEvent};
use replenish_interfaces::lifecycle_msgs::srv;
use replenish_testkit::watchdog::watchdog;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(30);

#[test]
fn outcomes_lead_where_the_machine_says() {
    use State::{Active, Finalized, Inactive, Unconfigured};
    use Transition::{Activate, Cleanup, Configure, Deactivate, Shutdown};
    let node = Context::in_process().node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let next = Arc::new(Mutex::new(VecDeque::new()));
    for transition in [Configure, Cleanup, Activate, Deactivate, Shutdown] {
        let (next, inside) = (Arc::clone(&next), lifecycle.clone());
        lifecycle.on_transition(transition, move |from| {
            assert_ne!(inside.state(), from);
            assert_eq!(inside.change(Shutdown), Err(LifecycleError::Nested));
            next.lock().unwrap().pop_front().unwrap()
        });
    }
    let errors = Arc::clone(&next);
    lifecycle.on_error(move |_| errors.lock().unwrap().pop_front().unwrap());
    let (good, failed, error) = (Outcome::Success, Outcome::Failure, Outcome::Error);
    let steps: [(Transition, &[Outcome], Result<State, State>); 14] = [
        (Configure, &[failed], Err(Unconfigured)),
        (Configure, &[error, good], Err(Unconfigured)),
        (Configure, &[good], Ok(Inactive)),
        (Activate, &[failed], Err(Inactive)),
        (Activate, &[good], Ok(Active)),
        (Deactivate, &[failed], Err(Active)),
        (Deactivate, &[good], Ok(Inactive)),
        (Cleanup, &[failed], Err(Inactive)),
        (Cleanup, &[good], Ok(Unconfigured)),
        (Configure, &[good], Ok(Inactive)),
        (Activate, &[good], Ok(Active)),
        (Deactivate, &[error, good], Err(Unconfigured)),
        (Configure, &[good], Ok(Inactive)),
        (Shutdown, &[error, failed], Err(Finalized)),
    ];
    for (at, (transition, outcomes, expected)) in steps.into_iter().enumerate() {
        next.lock().unwrap().extend(outcomes);
        let outcome = lifecycle.change(transition);
        let expected = expected.map_err(|now| LifecycleError::NotReached { now });
        assert_eq!(outcome, expected, "step {at}");
        assert!(next.lock().unwrap().is_empty(), "every callback ran: {at}");
    }
    let nowhere = LifecycleError::NotAllowed { from: Finalized };
    for transition in [Configure, Cleanup, Activate, Deactivate, Shutdown] {
        assert_eq!(lifecycle.change(transition), Err(nowhere));
    }
}

#[test]
fn a_callback_that_panics_ends_the_node_and_errors_without_a_callback_do() {
    let node = Context::in_process().node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    lifecycle.on_transition(Transition::Configure, |_| panic!("on purpose"));
    let panics = lifecycle.clone();
    let caught = std::thread::spawn(move || panics.change(Transition::Configure)).join();
    assert!(caught.is_err());
    assert_eq!(lifecycle.state(), State::Finalized);
    let lifecycle = node.lifecycle().unwrap();
    lifecycle.on_transition(Transition::Configure, |_| Outcome::Error);
    let end = LifecycleError::NotReached {
        now: State::Finalized,
    };
    assert_eq!(lifecycle.change(Transition::Configure), Err(end));
}

/// rclc's callbacks have no context, and a node has to be finished by hand. Here each callback owns
/// its own, gets the state that the transition starts from, and is dropped with the node.
#[test]
fn callbacks_own_their_context_and_go_with_the_node() {
    use Transition::{Activate, Cleanup, Configure, Deactivate, Shutdown};
    let node = Context::in_process().node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let seen = Arc::new(Mutex::new(Vec::new()));
    for transition in [Configure, Cleanup, Activate, Deactivate, Shutdown] {
        let (mut calls, to) = (0, Arc::clone(&seen));
        lifecycle.on_transition(transition, move |from| {
            calls += 1;
            to.lock().unwrap().push((transition, from, calls));
            match calls {
                3 => Outcome::Error,
                _ => Outcome::Success,
            }
        });
    }
    let (mut calls, to) = (10, Arc::clone(&seen));
    lifecycle.on_error(move |from| {
        calls += 1;
        to.lock().unwrap().push((Shutdown, from, calls));
        Outcome::Success
    });
    let round = [Configure, Activate, Deactivate, Cleanup];
    for step in [round, round].concat() {
        lifecycle.change(step).unwrap();
    }
    lifecycle.change(Configure).unwrap_err();
    let (unconfigured, inactive, active) = (State::Unconfigured, State::Inactive, State::Active);
    let once = |n| {
        [
            (Configure, unconfigured, n),
            (Activate, inactive, n),
            (Deactivate, active, n),
            (Cleanup, inactive, n),
        ]
    };
    let failed = [(Configure, unconfigured, 3), (Shutdown, unconfigured, 11)];
    let all = [&once(1)[..], &once(2), &failed].concat();
    assert_eq!(*seen.lock().unwrap(), all);
    assert_eq!(Arc::strong_count(&seen), 7);
    drop((lifecycle, node));
    assert_eq!(Arc::strong_count(&seen), 1, "the callbacks are gone");
}

/// A node that is managed by a running executor, and any more when its five services are removed.
#[test]
fn a_running_executor_takes_on_a_managed_node_and_lets_it_go() {
    let _dog = watchdog("live lifecycle", LIMIT * 2);
    let bus = InProcessBus::new();
    let ctx = Context::new(bus.participant());
    let node = ctx.node("camera").unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w").capacity(5);
    let running = exec.start().unwrap();
    let change = running.handle();
    let lifecycle = node.lifecycle().unwrap();
    let ids = change.worker("w").unwrap().lifecycle(&lifecycle).unwrap();
    assert_eq!(ids.len(), 5);
    let full = change.worker("w").unwrap().lifecycle(&lifecycle);
    assert!(matches!(
        full,
        Err(replenish::Error::Capacity { limit: 5, .. })
    ));
    let configure = Asked {
        id: 1,
        ..Asked::default()
    };
    let request = srv::ChangeStateRequest {
        transition: configure,
    };
    assert!(ask::<srv::ChangeState>(&bus, "change_state", &request).success);
    assert_eq!(lifecycle.state(), State::Inactive);
    for id in &ids {
        change.remove(id, replenish::Removal::Wait(LIMIT)).unwrap();
    }
    let asker = Context::new(bus.participant()).node("asker").unwrap();
    let name = "/camera/change_state";
    let client = asker.client::<srv::ChangeState>(name, Qos::services(), LIMIT);
    assert!(!client.unwrap().wait_for_server(Duration::ZERO).unwrap());
}

#[test]
fn publishers_are_silent_unless_the_node_is_active() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let publisher = lifecycle.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let mut exec = Executor::new(&ctx);
    let seen = Arc::new(Mutex::new(Vec::new()));
    let to = Arc::clone(&seen);
    exec.worker("w")
        .subscribe(&node, "t", Qos::reliable(), move |m: &Int32, _| {
            to.lock().unwrap().push(m.data);
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let mut data = 0;
    let mut publish = || {
        data += 1;
        publisher.publish(&Int32 { data }).unwrap()
    };
    assert!(!publish());
    lifecycle.change(Transition::Configure).unwrap();
    assert!(!publish());
    lifecycle.change(Transition::Activate).unwrap();
    assert!(publish());
    lifecycle.change(Transition::Deactivate).unwrap();
    assert!(!publish());
    while local.spin_some(Duration::from_millis(5)).end == SpinEnd::Worked {}
    assert_eq!(*seen.lock().unwrap(), [3]);
    assert_eq!(publisher.clone().withheld(), 3);
}

/// The barrier has room for one sample in a round. Publishing the second one is an error, which it
/// would not be if the first one had gone out.
#[test]
fn managed_publishers_respect_the_output_barrier() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let publisher = lifecycle.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let mut exec = Executor::new(&ctx);
    let (sent, seen) = (Arc::new(Mutex::new(Vec::new())), Arc::new(Mutex::new(0)));
    let (note, count) = (Arc::clone(&sent), Arc::clone(&seen));
    let once = Every::once(Duration::ZERO);
    let active = lifecycle.clone();
    exec.worker("w")
        .output_barrier(1, 64)
        .timer(once, move |cx| {
            for data in 0..2 {
                note.lock()
                    .unwrap()
                    .push(publisher.publish_in(cx, &Int32 { data }));
            }
            active.change(Transition::Configure).unwrap();
            active.change(Transition::Activate).unwrap();
            for data in 2..4 {
                note.lock()
                    .unwrap()
                    .push(publisher.publish_in(cx, &Int32 { data }));
            }
        })
        .unwrap()
        .subscribe(&node, "t", Qos::reliable(), move |m: &Int32, cx| {
            *count.lock().unwrap() += m.data;
            cx.stop();
        })
        .unwrap();
    exec.local().unwrap().spin_for(LIMIT);
    let full = Err(PublishError::Full);
    assert_eq!(
        *sent.lock().unwrap(),
        [Ok(false), Ok(false), Ok(true), full]
    );
    assert_eq!(*seen.lock().unwrap(), 2);
}

/// As drivers do it that know only then what they have to do.
#[test]
fn a_callback_of_a_transition_gives_the_next_ones() {
    let node = Context::in_process().node("n").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    let inside = lifecycle.clone();
    let mut times = 0;
    lifecycle.on_transition(Transition::Configure, move |_| {
        times += 1;
        if times == 2 {
            inside.on_transition(Transition::Configure, |_| Outcome::Failure);
        }
        inside.on_transition(Transition::Activate, |_| Outcome::Failure);
        Outcome::Success
    });
    for _ in 0..2 {
        lifecycle.change(Transition::Configure).unwrap();
        assert!(lifecycle.change(Transition::Activate).is_err());
        assert_eq!(
            lifecycle.change(Transition::Cleanup),
            Ok(State::Unconfigured)
        );
    }
    // From the third time on it is the other one.
    assert!(lifecycle.change(Transition::Configure).is_err());
}

/// The answer to a client in another context.
fn ask<S: Service>(bus: &InProcessBus, service: &str, request: &S::Request) -> S::Response
where
    S::Response: Clone,
{
    let ctx = Context::new(bus.participant());
    let node = ctx.node("asker").unwrap();
    let name = format!("/camera/{service}");
    let client = node.client::<S>(&name, Qos::services(), LIMIT).unwrap();
    assert!(client.wait_for_server(LIMIT).unwrap());
    let answer = Arc::new(Mutex::new(None));
    let to = Arc::clone(&answer);
    let mut exec = Executor::new(&ctx);
    exec.worker("c")
        .replies(&client, move |reply, cx| {
            *to.lock().unwrap() = reply.ok().cloned();
            cx.stop();
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    client.call(request).unwrap();
    assert_eq!(local.spin_for(LIMIT).end, SpinEnd::Stopped);
    let answer = answer.lock().unwrap().take();
    answer.expect("a reply in time")
}

#[test]
fn others_ask_for_transitions_and_hear_of_them() {
    let _dog = watchdog("lifecycle services", LIMIT * 2);
    let bus = InProcessBus::new();
    let ctx = Context::new(bus.participant());
    let node = ctx.node("camera").unwrap();
    let lifecycle = node.lifecycle().unwrap();
    lifecycle.on_transition(Transition::Activate, |_| Outcome::Failure);
    let (mut exec, _) = executor(&ctx);
    exec.worker("lifecycle").lifecycle(&lifecycle).unwrap();
    let running = exec.start().unwrap();

    let listener = Context::new(bus.participant());
    let seen = Arc::new(Mutex::new(Vec::new()));
    let to = Arc::clone(&seen);
    let mut exec = Executor::new(&listener);
    exec.worker("w")
        .subscribe(
            &listener.node("listener").unwrap(),
            "/camera/transition_event",
            Qos::reliable(),
            move |event: &TransitionEvent, _| {
                assert!(event.timestamp > 0);
                let line = format!(
                    "{} {}: {} to {}",
                    event.transition.id,
                    event.transition.label,
                    event.start_state.label,
                    event.goal_state.label
                );
                to.lock().unwrap().push(line);
            },
        )
        .unwrap();
    let mut events = exec.local().unwrap();

    let change = |id, label: &str| {
        let label = label.to_owned();
        let request = srv::ChangeStateRequest {
            transition: Asked { id, label },
        };
        ask::<srv::ChangeState>(&bus, "change_state", &request).success
    };
    let state = || {
        let got = ask::<srv::GetState>(&bus, "get_state", &srv::GetStateRequest::default());
        (got.current_state.id, got.current_state.label)
    };
    assert_eq!(state(), (1, "unconfigured".to_owned()));
    assert!(!change(3, ""), "activate, before it is configured");
    assert!(!change(10, ""), "an outcome is not for others to say");
    assert!(change(1, ""));
    assert!(!change(0, "activate"), "the callback fails");
    assert_eq!(state(), (2, "inactive".to_owned()));
    let heard = Arc::clone(&seen);
    events.spin_while(LIMIT, || heard.lock().unwrap().len() < 4);
    let expected = [
        "1 configure: unconfigured to configuring",
        "10 transition_success: configuring to inactive",
        "3 activate: inactive to activating",
        "31 transition_failure: activating to inactive",
    ];
    assert_eq!(*seen.lock().unwrap(), expected);

    let request = srv::GetAvailableStatesRequest::default();
    let states = ask::<srv::GetAvailableStates>(&bus, "get_available_states", &request);
    let ids: Vec<u8> = states.available_states.iter().map(|s| s.id).collect();
    assert_eq!(ids, [0, 1, 2, 3, 4, 10, 11, 12, 13, 14, 15]);
    let request = srv::GetAvailableTransitionsRequest::default();
    let ids = |service| {
        let got = ask::<srv::GetAvailableTransitions>(&bus, service, &request);
        let all = got.available_transitions.into_iter();
        all.map(|t| t.transition.id).collect::<Vec<_>>()
    };
    assert_eq!(ids("get_available_transitions"), [2, 3, 6]);
    assert_eq!(ids("get_transition_graph").len(), 25);
    let report = running.stop();
    assert!(
        report.handles.iter().all(|h| h.stats.errors == 0),
        "{report}"
    );
}

/// rclcpp's `enable_communication_interface = false`.
#[test]
fn a_managed_node_may_keep_its_transitions_to_itself() {
    let _dog = watchdog("unseen node", LIMIT);
    let ctx = Context::in_process();
    let (listener, heard) = (ctx.node("listener").unwrap(), Arc::new(Mutex::new(0)));
    let (mut exec, _) = executor(&ctx);
    for name in ["seen", "unseen"] {
        let count = Arc::clone(&heard);
        let hear = move |_: &TransitionEvent, _: &replenish::CallbackContext<'_>| {
            assert_eq!(name, "seen");
            *count.lock().unwrap() += 1;
        };
        let topic = format!("/{name}/transition_event");
        let qos = Qos::reliable().keep_last(10);
        let worker = exec.worker(name);
        worker.subscribe(&listener, &*topic, qos, hear).unwrap();
    }
    let mut local = exec.local().unwrap();
    let seen = ctx.node("seen").unwrap().lifecycle().unwrap();
    let unseen = ctx.node("unseen").unwrap().lifecycle_unseen();
    unseen.on_transition(Transition::Activate, |_| Outcome::Failure);
    for node in [&unseen, &seen] {
        assert_eq!(node.change(Transition::Configure), Ok(State::Inactive));
    }
    unseen.change(Transition::Activate).unwrap_err();
    assert_eq!(
        unseen.state(),
        State::Inactive,
        "it is managed all the same"
    );
    local.spin_while(LIMIT, || *heard.lock().unwrap() < 2);
    assert_eq!(local.spin_some(Duration::ZERO).callbacks, 0);
    assert_eq!(*heard.lock().unwrap(), 2, "configure, and its success");
}
