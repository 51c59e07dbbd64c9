//! The report of `bench load`: a table, the JSON, and the verdict.

use super::agent::Seen;
use super::generator::{Load, Tally};
use super::options::Args;
use replenish_cli::machine::stats::Sorted;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::table::Table;

/// `bench load --json`. The names are a contract.
#[derive(Debug, serde::Serialize)]
pub(super) struct Json {
    clients: u16,
    topics: u16,
    rate: u64,
    seconds: u64,
    bytes: u64,
    sent: u64,
    delivered: u64,
    lost: u64,
    duplicated: u64,
    /// Gaps seen in the order of a topic.
    gaps: u64,
    offered_per_second: f64,
    messages_per_second: f64,
    writes_that_waited: u64,
    /// Messages that clients sent again.
    client_retransmitted: u64,
    /// Datagrams that the agent sent again.
    agent_retransmitted: u64,
    agent_dropped: u64,
    agent_datagrams_in: u64,
    agent_datagrams_out: u64,
    /// CPUs that the agent kept busy.
    agent_cpus: f64,
    agent_cpu_us_per_message: f64,
    agent_rss_bytes_early: u64,
    agent_rss_bytes_end: u64,
    agent_rss_growth_bytes: i64,
    p50_us: i64,
    p99_us: i64,
    max_us: i64,
    /// While their threads were ready: the tail comes from there if not from the agent.
    agent_waited_ms: f64,
    clients_waited_ms: f64,
    stolen_ms: f64,
    disconnected: u64,
}

/// Puts everything together.
pub(super) fn json(args: &Args, load: &Load, tally: &Tally, agent: &Seen) -> Json {
    let counter = |name: &str| agent.counters.get(name).and_then(serde_json::Value::as_u64);
    let counter = |name| counter(name).unwrap_or(0);
    let seconds = tally.duration as f64 / 1e9;
    let latencies = Sorted::new(tally.latencies.iter().copied().map(i64::from).collect());
    let (early, end) = agent.resident;
    let rate = tally.received as f64 / seconds.max(1e-9);
    let [agent_waited_ms, clients_waited_ms, stolen_ms] = agent.waited.map(|ns| ns as f64 / 1e6);
    let signed = |bytes: u64| i64::try_from(bytes).unwrap_or(i64::MAX);
    Json {
        clients: args.clients,
        topics: args.topics,
        rate: args.rate,
        seconds: args.seconds,
        bytes: args.bytes,
        sent: tally.sent,
        delivered: tally.received,
        lost: load.total().saturating_sub(tally.received),
        duplicated: tally.duplicated,
        gaps: tally.reordered,
        offered_per_second: load.total() as f64 / (args.seconds as f64),
        messages_per_second: rate,
        writes_that_waited: tally.blocked,
        client_retransmitted: tally.resent,
        agent_retransmitted: counter("retransmitted"),
        agent_dropped: counter("samples_dropped"),
        agent_datagrams_in: counter("datagrams_in"),
        agent_datagrams_out: counter("datagrams_out"),
        agent_cpus: agent.cpus,
        agent_cpu_us_per_message: agent.cpus * 1e6 / rate.max(1e-9),
        agent_rss_bytes_early: early,
        agent_rss_bytes_end: end,
        agent_rss_growth_bytes: signed(end) - signed(early),
        p50_us: latencies.median(),
        p99_us: latencies.percentile(99),
        max_us: latencies.max(),
        agent_waited_ms,
        clients_waited_ms,
        stolen_ms,
        disconnected: tally.disconnected,
    }
}

/// The table.
pub(super) fn print(json: &Json) {
    let mut table = Table::new(&["what", "figure"]);
    let ms = |ms: f64| format!("{ms:.1} ms");
    let kib = |bytes: u64| format!("{} KiB", bytes / 1024);
    let rows = [
        ("samples sent", json.sent.to_string()),
        ("delivered", json.delivered.to_string()),
        ("lost", json.lost.to_string()),
        ("twice", json.duplicated.to_string()),
        ("messages/s", format!("{:.0}", json.messages_per_second)),
        ("p50", format!("{} us", json.p50_us)),
        ("p99", format!("{} us", json.p99_us)),
        ("max", format!("{} us", json.max_us)),
        ("agent waited for a CPU", ms(json.agent_waited_ms)),
        ("clients waited for a CPU", ms(json.clients_waited_ms)),
        ("stolen by the hypervisor", ms(json.stolen_ms)),
        (
            "agent's CPU",
            format!("{:.0} % of one", json.agent_cpus * 100.0),
        ),
        (
            "agent's CPU a message",
            format!("{:.1} us", json.agent_cpu_us_per_message),
        ),
        ("agent's memory after 10 s", kib(json.agent_rss_bytes_early)),
        ("agent's memory at the end", kib(json.agent_rss_bytes_end)),
        ("agent's drops", json.agent_dropped.to_string()),
        (
            "sent again by the agent",
            json.agent_retransmitted.to_string(),
        ),
        (
            "sent again by clients",
            json.client_retransmitted.to_string(),
        ),
        ("datagrams in", json.agent_datagrams_in.to_string()),
        ("datagrams out", json.agent_datagrams_out.to_string()),
        ("writes that waited", json.writes_that_waited.to_string()),
    ];
    for (what, figure) in rows {
        table.row([what.to_string(), figure]);
    }
    println!(
        "{}  {} clients, {} topics each, {} Hz, {} bytes, {} s, all reliable; latency from when a \
         sample was due",
        table.to_text(),
        json.clients,
        json.topics,
        json.rate,
        json.bytes,
        json.seconds
    );
}

/// Whether every sample came once, in order.
pub(super) fn verdict(json: &Json) -> Outcome {
    let Json {
        sent,
        delivered,
        lost,
        duplicated,
        gaps,
        ..
    } = json;
    if *lost == 0 && *duplicated == 0 && *gaps == 0 && sent == delivered {
        return Ok(());
    }
    Err(Failure::refused(format!(
        "of {sent} samples sent {delivered} came, {lost} are missing, {duplicated} came twice, \
         {gaps} gaps"
    )))
}
