//! Requests to a node's six parameter services, as bytes of a stranger.
#![no_main]

use libfuzzer_sys::fuzz_target;
use replenish::middleware::{
    InProcess, InProcessBus, Interest, Middleware, Room, ServiceSpec, WriterId,
};
use replenish::{Context, Descriptor, Executor, LocalExecutor, ParameterOptions, Parameters, Qos};
use std::cell::RefCell;
use std::time::Duration;

const SERVICES: [(&str, &str); 6] = [
    ("get_parameters", "GetParameters"),
    ("get_parameter_types", "GetParameterTypes"),
    ("set_parameters", "SetParameters"),
    ("set_parameters_atomically", "SetParametersAtomically"),
    ("describe_parameters", "DescribeParameters"),
    ("list_parameters", "ListParameters"),
];

/// A node, and a client of each of its services.
struct World {
    exec: LocalExecutor,
    parameters: Parameters,
    stranger: InProcess,
    clients: Vec<WriterId>,
    interest: Interest,
}

fn world() -> World {
    let bus = InProcessBus::new();
    let context = Context::new(bus.participant());
    let node = context.node("arm").unwrap();
    let options = ParameterOptions::new()
        .parameters(8)
        .max_size(2048)
        .allow_undeclared();
    let parameters = node.parameters(options).unwrap();
    let range = Descriptor::new().integer_range(-3, 7, 3);
    parameters.declare("gain.p", 0, range).unwrap();
    let steps = Descriptor::new().double_range(0.0, 1.0, 0.1);
    parameters.declare("gain.d", 0.5, steps).unwrap();
    parameters
        .declare("name", "arm", Descriptor::new())
        .unwrap();
    let mut exec = Executor::new(&context);
    exec.worker("all").parameters(&parameters).unwrap();
    let stranger = bus.participant();
    let mut interest = Interest::empty();
    let mut clients = Vec::new();
    for (name, kind) in SERVICES {
        let dds = |part| format!("rcl_interfaces::srv::dds_::{kind}_{part}_");
        let spec = ServiceSpec {
            node: "/stranger",
            service: &format!("/arm/{name}"),
            type_name: &format!("rcl_interfaces/srv/{kind}"),
            request_type: &dds("Request"),
            response_type: &dds("Response"),
            type_hash: None,
            qos: Qos::reliable(),
            max_request: 4096,
            max_response: 8192,
        };
        let (reader, writer) = stranger.create_client(&spec).unwrap();
        interest.insert(reader);
        clients.push(writer);
    }
    World {
        exec: exec.local().unwrap(),
        parameters,
        stranger,
        clients,
        interest,
    }
}

thread_local! {
    static WORLD: RefCell<World> = RefCell::new(world());
}

fuzz_target!(|bytes: &[u8]| {
    let Some((which, request)) = bytes.split_first() else {
        return;
    };
    WORLD.with_borrow_mut(|world| {
        let client = world.clients[usize::from(*which) % world.clients.len()];
        if world.stranger.request(client, request).is_ok() {
            world.exec.spin_some(Duration::from_millis(1));
        }
        let mut interest = world.interest;
        let mut answers = 0;
        let mut sink = |_, _: &_, reply: &[u8]| {
            answers += 1;
            assert!(reply.len() <= 8192);
            Room::Left
        };
        world.stranger.take(&mut interest, &mut sink).unwrap();
        assert!(answers <= 1);
        // The declared parameters keep their types and ranges under any request.
        let gain: i64 = world.parameters.get("gain.p").unwrap();
        assert!([-3, 0, 3, 6, 7].contains(&gain));
        let d: f64 = world.parameters.get("gain.d").unwrap();
        assert!((0.0..=1.0).contains(&d));
        world.parameters.get::<String>("name").unwrap();
        // Undeclared parameters that were set go again: inputs know nothing of each other.
        if bytes.len().is_multiple_of(16) {
            *world = self::world();
        }
    });
});
