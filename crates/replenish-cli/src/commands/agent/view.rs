//! The agent's state as tables for people.

use super::bridge_rows::BridgeRow;
use super::status::{EntityRow, Half, Status};
use crate::report::table::Table;

/// Rows of one table on a screen.
const ROWS: usize = 40;

/// The tables; `all` rows, or as many as a screen takes.
pub(super) fn tables(status: &Status, all: bool) -> String {
    let most = if all { usize::MAX } else { ROWS };
    let stats = &status.stats;
    let mut text = format!(
        "{} clients, {} topics; {} samples in, {} out, {} dropped, {} sent again; {} requests \
         refused; {} KiB wait; rates over {:.1} s\n",
        status.clients.len(),
        status.topics.len(),
        stats.samples_in,
        stats.samples_out,
        stats.samples_dropped + stats.samples_refused + stats.samples_expired,
        stats.retransmitted,
        stats.refused,
        status.queued_bytes / 1024,
        status.interval_seconds,
    );
    text += &clients(status, most);
    text += &topics(status, most);
    text += &endpoints(status, most);
    text += &bridge(status.bridge.as_deref().unwrap_or_default(), most);
    text
}

fn clients(status: &Status, most: usize) -> String {
    let mut table = Table::new(&[
        "client",
        "at",
        "up s",
        "silent s",
        "entities",
        "KiB",
        "in/s",
        "out/s",
        "B in/s",
        "B out/s",
        "again",
        "unacked",
        "over rate",
    ]);
    for client in status.clients.iter().take(most) {
        table.row([
            client.key.clone(),
            client.peer.clone(),
            format!("{:.0}", client.age_seconds),
            format!("{:.1}", client.silent_seconds),
            client.entities.to_string(),
            (client.memory_bytes / 1024).to_string(),
            rate(client.datagrams_in_per_second),
            rate(client.datagrams_out_per_second),
            rate(client.bytes_in_per_second),
            rate(client.bytes_out_per_second),
            client.retransmitted.to_string(),
            client.unacknowledged.to_string(),
            client.rate_limited.to_string(),
        ]);
    }
    finish(&table, status.clients.len(), most)
}

fn topics(status: &Status, most: usize) -> String {
    let mut table = Table::new(&[
        "topic", "type", "domain", "writers", "readers", "in/s", "B in/s", "out/s", "B out/s",
        "dropped",
    ]);
    for topic in status.topics.iter().take(most) {
        table.row([
            printable(&topic.topic),
            printable(&topic.type_name),
            topic.domain.to_string(),
            topic.writers.to_string(),
            topic.readers.to_string(),
            rate(topic.messages_in_per_second),
            rate(topic.bytes_in_per_second),
            rate(topic.messages_out_per_second),
            rate(topic.bytes_out_per_second),
            topic.dropped.to_string(),
        ]);
    }
    finish(&table, status.topics.len(), most)
}

fn endpoints(status: &Status, most: usize) -> String {
    let mut table = Table::new(&[
        "client", "id", "kind", "", "topic", "QoS", "priority", "matched", "not", "msg/s", "B/s",
        "queued", "dropped",
    ]);
    let halves: Vec<(&EntityRow, &str, &Half)> = status
        .entities
        .iter()
        .flat_map(|entity| {
            let writes = entity.writes.iter().map(move |half| (entity, "w", half));
            let reads = entity.reads.iter().map(move |half| (entity, "r", half));
            writes.chain(reads)
        })
        .collect();
    for (entity, direction, half) in halves.iter().take(most) {
        table.row([
            entity.client.clone(),
            entity.id.clone(),
            entity.kind.to_string(),
            (*direction).to_string(),
            printable(&entity.topic),
            qos(half),
            half.priority.map_or("-".into(), |p| p.to_string()),
            half.matched.to_string(),
            half.mismatched.to_string(),
            rate(half.messages_per_second),
            rate(half.bytes_per_second),
            half.queued.to_string(),
            (half.dropped + half.expired).to_string(),
        ]);
    }
    finish(&table, halves.len(), most)
}

fn bridge(rows: &[BridgeRow], most: usize) -> String {
    let mut table = Table::new(&[
        "in ROS 2", "node", "kind", "type", "domain", "state", "matched", "not", "sent",
        "received", "waiting", "dropped", "missed", "lost", "unheard",
    ]);
    for row in rows.iter().take(most) {
        table.row([
            printable(if row.topic.is_empty() {
                "-"
            } else {
                &row.topic
            }),
            printable(&row.node),
            row.kind.to_string(),
            printable(&row.type_name),
            row.domain.to_string(),
            row.reason.as_deref().map_or(row.state.into(), printable),
            row.matched.to_string(),
            row.counts.mismatched.to_string(),
            row.counts.sent.to_string(),
            row.counts.received.to_string(),
            row.waiting.to_string(),
            row.dropped.to_string(),
            row.counts.missed.to_string(),
            row.counts
                .lost
                .saturating_sub(row.counts.returned)
                .to_string(),
            row.counts.unheard.to_string(),
        ]);
    }
    finish(&table, rows.len(), most)
}

/// The table's text, empty without rows; a last line counts the rows that are not shown.
fn finish(table: &Table, rows: usize, most: usize) -> String {
    if rows == 0 {
        return String::new();
    }
    let more = match rows.checked_sub(most) {
        Some(more) if more > 0 => format!("  and {more} more; --json has all\n"),
        _ => String::new(),
    };
    format!("\n{}{more}", table.to_text())
}

fn qos(half: &Half) -> String {
    let reliability = if half.reliable {
        "reliable"
    } else {
        "best effort"
    };
    let durability = if half.durable { ", durable" } else { "" };
    match half.depth {
        Some(depth) => format!("{reliability}{durability}, last {depth}"),
        None => format!("{reliability}{durability}, all"),
    }
}

fn rate(per_second: f64) -> String {
    if per_second >= 10.0 || per_second == 0.0 {
        format!("{per_second:.0}")
    } else {
        format!("{per_second:.1}")
    }
}

/// A name that a client has sent: without control characters, which could rule a terminal.
fn printable(name: &str) -> String {
    const LONGEST: usize = 48;
    let escaped: String = name.escape_debug().take(LONGEST + 1).collect();
    match escaped.char_indices().nth(LONGEST) {
        Some((cut, _)) => escaped.get(..cut).unwrap_or_default().to_string() + "..",
        None => escaped,
    }
}

#[cfg(test)]
mod tests {
    use super::printable;

    #[test]
    fn names_cannot_rule_the_terminal() {
        assert_eq!(printable("rt/chatter"), "rt/chatter");
        assert_eq!(printable("a\u{1b}[2Jb\n"), "a\\u{1b}[2Jb\\n");
        assert_eq!(printable(&"x".repeat(100)).len(), 50);
    }
}
