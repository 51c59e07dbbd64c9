//! Services and parameters: rclpy as client and as server.

use crate::peer::{Foreign, Peer};
use crate::support::{budget, eventually, executor, node};
use replenish::{Descriptor, Executor, Node, ParameterOptions, Qos};
use replenish_interfaces::rcl_interfaces::srv;
use replenish_interfaces::test_msgs::srv::{BasicTypes, BasicTypesRequest, BasicTypesResponse};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Requests of a trial.
const REQUESTS: i64 = 50;

/// Twice the number, and the text backwards.
fn answer(request: &BasicTypesRequest, response: &mut BasicTypesResponse) {
    response.int64_value = 2 * request.int64_value;
    response.string_value = request.string_value.chars().rev().collect();
}

/// A service of ours on a worker with a budget.
pub(crate) fn serve(node: &Node, exec: &mut Executor) {
    exec.worker("server")
        .budget(budget())
        .serve::<BasicTypes, _>(node, "/peer/twice", Qos::services(), |request, reply, _| {
            answer(request, reply);
        })
        .unwrap();
}

/// rclpy asks a service of ours.
pub(crate) fn server(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    serve(&node, &mut exec);
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["client", &REQUESTS.to_string()]);
    assert_eq!(peer.line(), format!("answered {REQUESTS}"));
    let report = running.stop();
    let served = report
        .handles
        .iter()
        .find(|h| h.id.as_str().contains("twice"));
    let stats = &served.unwrap().stats;
    assert_eq!((stats.executed, stats.errors), (REQUESTS.unsigned_abs(), 0));
}

/// We ask a service of rclpy.
pub(crate) fn client(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let limit = Duration::from_secs(60);
    let client = node
        .client::<BasicTypes>("/peer/twice", Qos::services(), limit)
        .unwrap();
    let answers = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&answers);
    let mut exec = executor(&node);
    exec.worker("client")
        .budget(budget())
        .replies(&client, move |reply: Result<&BasicTypesResponse, _>, _| {
            let reply = reply.unwrap();
            let pair = (reply.int64_value, reply.string_value.clone());
            sink.lock().unwrap().push(pair);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["serve"]);
    assert_eq!(peer.line(), "ready");
    assert!(client.wait_for_server(limit).unwrap());
    let mut expected = Vec::new();
    for number in 0..REQUESTS {
        let request = BasicTypesRequest {
            int64_value: number,
            string_value: format!("text {number}"),
            ..BasicTypesRequest::default()
        };
        let mut response = BasicTypesResponse::default();
        answer(&request, &mut response);
        expected.push((response.int64_value, response.string_value));
        client.call(&request).unwrap();
        assert!(eventually(
            || answers.lock().unwrap().len() == expected.len()
        ));
    }
    assert_eq!(*answers.lock().unwrap(), expected);
    drop(running.stop());
}

/// rclpy sets and gets a parameter of ours a hundred times.
pub(crate) fn parameter_server(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    parameters.declare("gain", 0, Descriptor::new()).unwrap();
    let mut exec = executor(&node);
    exec.worker("parameters").parameters(&parameters).unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["ask", "/peer/ours"]);
    assert_eq!(peer.line(), "asked 100");
    drop(running.stop());
}

/// We ask rclpy's own service a hundred times.
pub(crate) fn parameter_client(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let limit = Duration::from_secs(60);
    let client = node
        .client::<srv::GetParameters>("/peer/peer/get_parameters", Qos::services(), limit)
        .unwrap();
    let answers = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&answers);
    let mut exec = executor(&node);
    exec.worker("client")
        .replies(
            &client,
            move |reply: Result<&srv::GetParametersResponse, _>, _| {
                let values = &reply.unwrap().values;
                sink.lock()
                    .unwrap()
                    .push(values.first().map(|value| value.integer_value));
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["serve"]);
    assert_eq!(peer.line(), "ready");
    assert!(client.wait_for_server(limit).unwrap());
    let mut request = srv::GetParametersRequest::default();
    request.names.push("gain".into());
    for count in 1..=100 {
        client.call(&request).unwrap();
        assert!(
            eventually(|| answers.lock().unwrap().len() == count),
            "{count}"
        );
    }
    assert!(
        answers
            .lock()
            .unwrap()
            .iter()
            .all(|value| *value == Some(3))
    );
    drop(running.stop());
}
