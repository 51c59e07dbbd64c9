//! An agent's process under attack: its memory against the bound that it states, in `encrypted`
//! with DTLS and TLS; and, in `floods`, the places and the CPU time that others keep.

pub(crate) mod attacks;
mod encrypted;
pub(crate) mod floods;

use crate::attacker::SENT;
use crate::common::{BIN, Running, Scratch, json};
use attacks::{ATTACKS, CLIENTS, SAMPLE, Target};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The longest time that any step may take on a busy machine.
const SOON: Duration = Duration::from_secs(60);

const MIB: f64 = 1024.0 * 1024.0;

/// Bytes that all clients together may make it keep.
const MEMORY: u64 = 64 << 20;

/// The address of this kind in a line.
fn address(line: &str, kind: &str) -> std::net::SocketAddr {
    let place = line.split([',', ' ']).collect::<Vec<_>>();
    let at = place
        .iter()
        .position(|word| word.starts_with(kind))
        .unwrap();
    place[at - 1].parse().unwrap()
}

/// An agent that shows everything all the time.
pub(crate) struct Victim {
    pub(crate) running: Running,
    json: PathBuf,
    pub(crate) at: Target,
    /// The line in which the agent prints its addresses.
    line: String,
}

impl Victim {
    fn start(scratch: &Scratch, number: usize) -> Self {
        let limits = [
            format!("--memory={MEMORY}"),
            format!("--clients={CLIENTS}"),
            "--entities=512".into(),
            "--depth=65535".into(),
            format!("--sample={SAMPLE}"),
        ];
        Self::with(scratch, &number.to_string(), &limits)
    }

    /// One with these options.
    fn with(scratch: &Scratch, name: &str, limits: &[String]) -> Self {
        Self::of(BIN, scratch, name, limits)
    }

    /// One of another program.
    pub(crate) fn of(program: &str, scratch: &Scratch, name: &str, limits: &[String]) -> Self {
        let json = scratch.path(&format!("{name}.json"));
        let args = [
            "agent".into(),
            "--udp=127.0.0.1:0".into(),
            "--tcp=127.0.0.1:0".into(),
            "--watch=1".into(),
            format!("--json={}", json.display()),
        ];
        let args: Vec<&str> = args.iter().chain(limits).map(String::as_str).collect();
        let mut running = Running::start(program, &args);
        let line = running.expect_line("listening at", SOON);
        let at = Target {
            udp: address(&line, "(UDP)"),
            tcp: address(&line, "(TCP)"),
        };
        Self {
            running,
            json,
            at,
            line,
        }
    }

    /// The most bytes that it states.
    fn bound(&self) -> u64 {
        self.shows()["limits"]["process_memory"].as_u64().unwrap()
    }

    /// The most bytes that it ever had resident.
    pub(crate) fn peak(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.running.id()));
        let status = status.expect("it lives");
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = line.unwrap().trim().strip_suffix("kB").unwrap().trim();
        kib.parse::<u64>().unwrap() * 1024
    }

    /// Waits until it has shown its state anew, twice.
    pub(crate) fn shows(&self) -> serde_json::Value {
        for _ in 0..2 {
            let before = modified(&self.json);
            let end = Instant::now() + SOON;
            while modified(&self.json) == before {
                assert!(Instant::now() < end, "it shows nothing any more");
                std::thread::sleep(Duration::from_millis(50));
            }
        }
        json(&self.json)
    }
}

fn modified(path: &Path) -> Option<std::time::SystemTime> {
    std::fs::metadata(path).ok()?.modified().ok()
}

fn sum(state: &serde_json::Value, list: &str, field: &str) -> u64 {
    let list = state[list].as_array().unwrap().iter();
    list.map(|row| row[field].as_u64().unwrap()).sum()
}

/// b209253 had no bound: names alone took 80 MB that no limit counted. Prints each attack with the
/// bytes that it sent, the most memory that was resident, and the bound.
#[test]
fn no_attack_takes_more_memory_than_the_documented_bound() {
    let scratch = Scratch::new("attacks");
    println!("| attack | sent MB | charged MiB | resident MiB | bound MiB |");
    println!("|---|---|---|---|---|");
    let idle = Victim::start(&scratch, ATTACKS.len());
    let bound = idle.bound();
    let row = |name: &str, sent: u64, charged: u64, peak: u64| {
        println!(
            "| {name} | {:.1} | {:.1} | {:.1} | {:.1} |",
            sent as f64 / 1e6,
            charged as f64 / MIB,
            peak as f64 / MIB,
            bound as f64 / MIB,
        );
    };
    row("none", 0, 0, idle.peak());
    let mut worst = 0;
    let (mut names, mut sent) = (0, 0);
    for (number, (name, attack)) in ATTACKS.iter().enumerate() {
        let victim = Victim::start(&scratch, number);
        SENT.set(0);
        let open = attack(victim.at);
        let state = victim.shows();
        drop(open);
        let charged = sum(&state, "clients", "memory_bytes");
        let peak = victim.peak();
        row(name, SENT.get(), charged, peak);
        sent += SENT.get();
        assert!(charged <= MEMORY, "{name}: {charged}");
        assert!(peak <= bound, "{name}: {peak} of {bound}");
        worst = worst.max(charged);
        if number == 1 {
            names = sum(&state, "clients", "entities");
        }
        // The same one after another in one process: what one leaves, the next one finds.
        let open = attack(idle.at);
        std::thread::sleep(Duration::from_millis(1100));
        drop(open);
    }
    idle.shows();
    row("all, one after another", sent, 0, idle.peak());
    assert!(idle.peak() <= bound, "{} of {bound}", idle.peak());
    // They reach what they are meant to reach.
    assert!(worst > MEMORY * 9 / 10, "{worst}");
    assert!(names > 7000, "{names}");
}
