//! The agent's access file, and clients that log in by it.
#![no_main]

#[path = "../../crates/replenish-agent/tests/fuzzed/mod.rs"]
mod fuzzed;

use libfuzzer_sys::fuzz_target;
use replenish_agent::{AccessList, AgentConfig, AgentCore, Now};

fuzz_target!(|bytes: &[u8]| {
    let Ok(text) = core::str::from_utf8(bytes) else {
        return;
    };
    let list = match AccessList::parse(text) {
        Ok(list) => list,
        Err(error) => {
            let lines = text.matches('\n').count() + 1;
            assert!((1..=lines).contains(&error.line) && !error.message.is_empty());
            return;
        }
    };
    let now = Now {
        monotonic: 1,
        unix: 0,
    };
    let nobody = list.is_empty();
    let config = AgentConfig {
        access: Some(list.clone()),
        ..AgentConfig::default()
    };
    let mut agent = AgentCore::with(&config);
    for number in 0..4 {
        agent.receive(now, number, &fuzzed::agent::login(number, 0x81));
    }
    while agent.pump(now, 16, &mut |_, _| ()) {}
    assert!(!nobody || agent.stats().clients == 0);
    // The same list once more ends no session.
    let clients = agent.stats().clients;
    agent.set_access(now, Some(list));
    assert_eq!(agent.stats().clients, clients);
});
