//! Parameters: a controller whose gain others can set while it runs, within its range, and whose
//! name is read-only. A second node asks for three changes and gets the reason why one was refused.
//!
//! Run: `cargo run -p replenish --example parameter_server` in one process; with an agent's address
//! (`127.0.0.1:8888`) behind it, through that agent.

use replenish::{Context, Descriptor, Every, Executor, ParameterOptions, Qos};
use replenish_interfaces::rcl_interfaces::msg::{Parameter, ParameterEvent, ParameterValue};
use replenish_interfaces::rcl_interfaces::srv::{SetParameters, SetParametersRequest};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ms = Duration::from_millis;
    let qos = Qos::reliable();
    let ctx = match std::env::args().nth(1) {
        Some(agent) => Context::xrce_udp(&agent)?,
        None => Context::in_process(),
    };
    let node = ctx.node("controller")?;
    let mut exec = Executor::new(&ctx);

    // At most 8 parameters; declared with a first value, which gives the type, and a range.
    let parameters = node.parameters(ParameterOptions::new().parameters(8))?;
    let gain = Descriptor::new().double_range(0.0, 1.0, 0.25);
    parameters.declare("gain", 0.5, gain.description("of the loop"))?;
    parameters.declare("model", "arm", Descriptor::new().read_only())?;
    parameters.veto(|change| match change.name {
        "gain" if change.new == 0.75.into() => Err("the arm resonates at 0.75"),
        _ => Ok(()),
    });
    exec.worker("parameters").parameters(&parameters)?;

    // The loop reads the value of the moment: a copy, no waiting.
    let read = parameters.clone();
    let mut last = 0.0;
    exec.worker("control").timer(ms(2), move |_| {
        let gain = read.get::<f64>("gain")?;
        if gain != last {
            println!("control: gain {gain}");
            last = gain;
        }
        Ok::<_, replenish::ParameterError>(())
    })?;

    // Another node, which knows the standard service and the standard event only.
    let other = ctx.node("operator")?;
    let client = other.client::<SetParameters>("controller/set_parameters", qos, ms(5000))?;
    let asks = client.clone();
    exec.worker("operator")
        .subscribe(&other, "/parameter_events", qos, |e: &ParameterEvent, _| {
            for p in &e.changed_parameters {
                println!("event: {} {} = {}", e.node, p.name, p.value.double_value);
            }
        })?
        .replies(&client, |reply, _| {
            for result in reply.iter().flat_map(|r| &r.results) {
                println!("result: {} {}", result.successful, result.reason);
            }
        })?
        .timer(Every::once(ms(50)), move |_| {
            let wish = |value| Parameter {
                name: "gain".into(),
                value: ParameterValue {
                    r#type: 3,
                    double_value: value,
                    ..ParameterValue::default()
                },
            };
            let parameters = [0.75, 2.0, 1.0].map(wish).to_vec();
            asks.call(&SetParametersRequest { parameters }).map(drop)
        })?
        .timer(Every::once(ms(500)), |cx| {
            println!("operator: done");
            cx.stop();
        })?;
    exec.spin()?;
    Ok(())
}
