//! Damaged deployment files: an error or a plan, never a panic, and never for long. 6000 of
//! them; `REPLENISH_SETS` sets another number.

use replenish_plan::Deployment;
use replenish_sim::{Options, Random, simulate};

const EXAMPLES: [&str; 3] = ["fits", "refused", "overloaded"];

/// Pieces that mean something, to be put where they may not belong.
const PIECES: [&str; 24] = [
    "86400 s",
    "0 ns",
    "1 ns",
    "86399 s",
    "[[worker]]",
    "[machine]",
    "cpus = 1024",
    "rate = \"1000000 kHz\"",
    "rate = \"0.00002 Hz\"",
    "takes = \"1 ns\"",
    "policy = { kind = \"fifo\", priority = 99 }",
    "importance = 255",
    "suspend = true",
    "locks = [{ name = \"a\", holds = \"1 s\" }]",
    "blocks = \"1 s\"",
    "\"",
    "{",
    "}",
    "=",
    "\n",
    "#",
    "jitter = \"86400 s\"",
    "desired = \"5 ms\"",
    "{ samples = [\"1 ms\", \"2 s\"] }",
];

fn damage(text: &str, r: &mut Random) -> String {
    let mut lines: Vec<String> = text
        .lines()
        .filter(|l| !l.starts_with('#'))
        .map(String::from)
        .collect();
    for _ in 0..r.between(1, 4) {
        let at = r.up_to(lines.len() as u64 - 1) as usize;
        let piece = PIECES[r.up_to(PIECES.len() as u64 - 1) as usize];
        match r.up_to(5) {
            0 => drop(lines.remove(at)),
            1 => lines.insert(at, piece.into()),
            2 => {
                let other = r.up_to(lines.len() as u64 - 1) as usize;
                lines.swap(at, other);
            }
            // Another value for what stands between quotes.
            3 | 4 => {
                let parts: Vec<&str> = lines[at].split('"').collect();
                if parts.len() > 2 {
                    let pick = (r.up_to(parts.len() as u64 / 2 - 1) * 2 + 1) as usize;
                    let mut parts: Vec<String> = parts.into_iter().map(String::from).collect();
                    parts[pick] = piece.into();
                    lines[at] = parts.join("\"");
                }
            }
            _ => {
                let line = &mut lines[at];
                let cut = r.up_to(line.len() as u64) as usize;
                if line.is_char_boundary(cut) {
                    line.truncate(cut);
                }
            }
        }
        if lines.is_empty() {
            break;
        }
    }
    lines.join("\n")
}

#[test]
fn damage_is_an_error_or_a_plan() {
    let (mut read, mut planned) = (0, 0);
    let sets = std::env::var("REPLENISH_SETS")
        .ok()
        .and_then(|v| v.parse().ok());
    for seed in 0..sets.unwrap_or(6000u64) {
        let r = &mut Random::new(seed);
        let name = EXAMPLES[(seed % 3) as usize];
        let text = std::fs::read_to_string(format!("../../examples/robot/{name}.toml")).unwrap();
        let text = damage(&text, r);
        let file = match Deployment::parse(&text, "damaged") {
            Ok(file) => file,
            Err(error) => {
                assert!(
                    error.line > 0 && !error.message.is_empty(),
                    "{error}\n{text}"
                );
                continue;
            }
        };
        read += 1;
        match file.plan() {
            Ok(plan) => {
                planned += 1;
                let system = file.system(&plan);
                system.check().unwrap_or_else(|e| panic!("{e}\n{text}"));
                // A worker with a million releases a second makes a long run: a few such runs do.
                if seed % 20 == 0 && !text.contains("kHz") && !text.contains("1 ns") {
                    simulate(&system, &Options::until(200_000_000)).unwrap();
                }
            }
            Err(refusal) => assert!(!refusal.sentence.is_empty()),
        }
    }
    println!("{read} could be read, {planned} planned");
    assert!(read > 500 && planned > 200);
}
