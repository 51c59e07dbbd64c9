//! Services with programs on bare DDS, in the forms of `rmw_cyclonedds` and `rmw_fastrtps`.

use crate::peer::{Foreign, Peer};
use crate::support::{budget, eventually, executor, node};
use replenish::{Executor, Node, Qos};
use replenish_interfaces::example_interfaces::srv::{
    AddTwoInts, AddTwoIntsRequest, AddTwoIntsResponse,
};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const REQUESTS: i64 = 50;

/// A service of ours on a worker with a budget.
pub(crate) fn serve(node: &Node, exec: &mut Executor) {
    exec.worker("server")
        .budget(budget())
        .serve::<AddTwoInts, _>(node, "/peer/add", Qos::services(), |request, reply, _| {
            reply.sum = request.a + request.b;
        })
        .unwrap();
}

/// The peer asks a service of ours.
pub(crate) fn server(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let mut exec = executor(&node);
    serve(&node, &mut exec);
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["client", &REQUESTS.to_string()]);
    assert_eq!(peer.line(), format!("answered {REQUESTS}"));
    drop(running.stop());
}

/// We ask a service of the peer.
pub(crate) fn client(foreign: Foreign) {
    let (node, domain) = node("/peer/ours");
    let limit = Duration::from_secs(60);
    let client = node
        .client::<AddTwoInts>("/peer/add", Qos::services(), limit)
        .unwrap();
    let answers = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&answers);
    let mut exec = executor(&node);
    exec.worker("client")
        .budget(budget())
        .replies(&client, move |reply: Result<&AddTwoIntsResponse, _>, _| {
            sink.lock().unwrap().push(reply.unwrap().sum);
        })
        .unwrap();
    let running = exec.start().unwrap();
    let peer = Peer::start(foreign, domain, &["serve"]);
    assert_eq!(peer.line(), "ready");
    assert!(client.wait_for_server(limit).unwrap());
    for number in 0..REQUESTS {
        let request = AddTwoIntsRequest { a: number, b: 1000 };
        client.call(&request).unwrap();
        let answered = || i64::try_from(answers.lock().unwrap().len()).unwrap() > number;
        assert!(eventually(answered), "{number}");
    }
    let expected: Vec<_> = (0..REQUESTS).map(|number| number + 1000).collect();
    assert_eq!(*answers.lock().unwrap(), expected);
    drop(running.stop());
}
