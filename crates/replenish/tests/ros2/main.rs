//! Executors of ours in ROS 2 itself, no agent: genuine rclpy (Kilted and Jazzy, with Fast DDS) and
//! programs on bare DDS at the other end. `crates/replenish-rtps/tests/peers/setup.sh` installs
//! them; without them these trials count as ignored.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod actions;
mod dds;
mod diagnostics;
mod events;
mod graph;
mod large;
mod lifecycle;
mod logs;
mod lossy;
mod peer;
mod presence;
mod services;
mod simulation;
mod support;
mod topics;
#[path = "../../../replenish-interfaces/tests/support/types.rs"]
mod types;

use lossy::Link;
use peer::Foreign;
use replenish_testkit::harness::{peer_trial, run};

/// A trial's name and its body.
type Trial = (&'static str, fn(Foreign));

/// The trials that every distribution goes through.
const TRIALS: [Trial; 18] = [
    ("topics_there_and_back", topics::topics),
    ("late_joiners_both_ways", topics::late_joiners),
    ("megabytes_there_and_back", large::images),
    ("node_types_and_hashes_are_seen", graph::graph),
    ("nodes_of_rclpy_are_seen_by_name", graph::nodes),
    ("rclpy_asks_our_service", services::server),
    ("we_ask_a_service_of_rclpy", services::client),
    ("rclpy_asks_our_parameters", services::parameter_server),
    ("we_ask_parameters_of_rclpy", services::parameter_client),
    ("rclpy_sends_goals_to_our_action", actions::server),
    ("we_send_goals_to_an_action_of_rclpy", actions::client),
    ("every_message_has_its_hash", presence::hashes),
    ("a_paused_node_is_back", presence::pauses),
    ("rclpy_manages_our_node", lifecycle::managed),
    ("we_manage_a_node_of_rclpy", lifecycle::manager),
    ("rclpy_reads_our_log_and_sets_its_level", logs::logs),
    (
        "rclpy_drives_our_clock_and_sees_new_names",
        simulation::clock,
    ),
    ("qos_events_both_ways", events::events),
];

/// The trials of implementations of bare DDS.
const DDS_TRIALS: [Trial; 3] = [
    ("topics_there_and_back", topics::topics),
    ("it_asks_our_service", dds::server),
    ("we_ask_its_service", dds::client),
];

fn main() {
    presence::child();
    lossy::child();
    let ros = Foreign::ROS.map(|foreign| (foreign, &TRIALS[..]));
    let dds = Foreign::DDS.map(|foreign| (foreign, &DDS_TRIALS[..]));
    let mut trials = Vec::new();
    for (foreign, list) in ros.into_iter().chain(dds) {
        for &(name, body) in list {
            let name = format!("{}::{name}", foreign.name());
            trials.push(peer_trial(&name, foreign.missing(), move || body(foreign)));
        }
    }
    for foreign in Foreign::ROS {
        let name = format!("{}::rclpy_reads_our_diagnostics", foreign.name());
        let missing = foreign.missing_package("diagnostic_msgs");
        let body = move || diagnostics::diagnostics(foreign);
        trials.push(peer_trial(&name, missing, body));
    }
    let cyclone = Foreign::Cyclone11;
    let name = format!("{}::it_reads_our_statistics", cyclone.name());
    let body = move || diagnostics::statistics(cyclone);
    trials.push(peer_trial(&name, cyclone.missing(), body));
    let no_link = lossy::missing();
    let missing = |foreign: Foreign| foreign.missing().or_else(|| no_link.clone());
    for foreign in Foreign::ROS.into_iter().chain(Foreign::DDS) {
        let name = format!("{}::numbers_at_20_percent_loss", foreign.name());
        let body = move || lossy::numbers(foreign, Link("lossy", 20));
        trials.push(peer_trial(&name, missing(foreign), body));
    }
    for foreign in Foreign::ROS.into_iter().chain(Foreign::DDS) {
        let name = format!("{}::requests_at_20_percent_loss", foreign.name());
        let body = move || lossy::requests(foreign, Link("lossy", 20));
        trials.push(peer_trial(&name, missing(foreign), body));
    }
    for foreign in Foreign::ROS.into_iter().chain([Foreign::Cyclone11]) {
        let name = format!("{}::megabytes_at_5_percent_loss", foreign.name());
        let body = move || lossy::images(foreign, Link("lossy", 5));
        trials.push(peer_trial(&name, missing(foreign), body));
    }
    for foreign in Foreign::ROS.into_iter().chain(Foreign::DDS) {
        for (name, kind) in [
            ("numbers_over_ethernet", "ethernet"),
            ("a_network_that_comes_later_is_used", "late"),
            ("two_addresses_of_one_interface_are_used", "alias"),
            ("a_peer_is_sent_to_in_the_network_of_both", "beside"),
        ] {
            let name = format!("{}::{name}", foreign.name());
            let body = move || lossy::numbers(foreign, Link(kind, 0));
            trials.push(peer_trial(&name, missing(foreign), body));
        }
    }
    for foreign in Foreign::ROS.into_iter().chain([Foreign::Cyclone11]) {
        for kind in ["ethernet", "wireless"] {
            let name = format!("{}::megabytes_over_{kind}", foreign.name());
            let body = move || lossy::images(foreign, Link(kind, 0));
            trials.push(peer_trial(&name, missing(foreign), body));
        }
    }
    for foreign in Foreign::ROS {
        let name = format!(
            "{}::a_network_that_comes_later_is_used_by_the_agent",
            foreign.name()
        );
        let body = move || lossy::numbers_through_a_bridge(foreign, Link("late", 0));
        trials.push(peer_trial(&name, missing(foreign), body));
        let name = format!("{}::addresses_that_change_are_followed", foreign.name());
        trials.push(peer_trial(&name, missing(foreign), move || {
            lossy::moves(foreign);
        }));
        for (name, kind) in [
            ("a_static_peer_is_found", "named"),
            ("whose_static_peer_we_are_is_found", "names"),
        ] {
            let name = format!("{}::{name}", foreign.name());
            let body = move || lossy::requests(foreign, Link(kind, 0));
            trials.push(peer_trial(&name, missing(foreign), body));
        }
    }
    for (kind, loss) in [
        ("lossy", 5),
        ("wireless", 1),
        ("ethernet", 0),
        ("late", 0),
        ("amid", 0),
    ] {
        let body = move || lossy::images_of_our_own(Link(kind, loss));
        let name = format!("ours::megabytes_over_{kind}");
        trials.push(peer_trial(&name, no_link.clone(), body));
    }
    run(trials);
}
