//! Recordings that a stranger has damaged, through the commands that read other programs' files: no
//! panic, no hang, bounded memory. `REPLENISH_INPUTS=100000` asks for that many files.

use crate::common::{BIN, Scratch, json, stderr, stdout};
use crate::recorded::Program;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::process::{Command, Output};

/// Files in the directory at a time.
const FILES: usize = 100;

/// A command with 2 GB of address space and a minute of time.
fn bounded(directory: &Path, args: &[&str]) -> Output {
    let script = "ulimit -v 2000000 && exec timeout 60 \"$@\"";
    let mut command = Command::new("sh");
    let command = command.args(["-c", script, "sh", BIN]).args(args);
    command.env("REPLENISH_LIVE", directory).output().unwrap()
}

struct Seeded(u64);

impl Seeded {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        usize::try_from(self.0 >> 33).unwrap() % n
    }

    /// A value that a parser may stumble over.
    fn value(&mut self) -> u64 {
        let near = [
            0,
            1,
            7,
            8,
            63,
            64,
            4095,
            4096,
            1 << 20,
            1 << 30,
            1 << 63,
            u64::MAX,
        ];
        let value = near[self.below(near.len())];
        value.wrapping_add(self.below(3) as u64).wrapping_sub(1)
    }
}

fn checksum(bytes: &[u8]) -> u64 {
    let start = 0xcbf2_9ce4_8422_2325;
    let step = |sum: u64, b: &u8| (sum ^ u64::from(*b)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(start, step)
}

/// Damages a file; three in four get a header whose checksum is right.
fn damage(file: &File, whole: &[u8], seeded: &mut Seeded) {
    let mut header = whole[..4096].to_vec();
    for _ in 0..=seeded.below(3) {
        let value = seeded.value().to_le_bytes();
        match seeded.below(4) {
            // The header's fields; the table of threads; a ring; anything.
            0 => {
                let at = 8 * seeded.below(31);
                header[at..at + 8].copy_from_slice(&value);
            }
            1 => file
                .write_all_at(&value, 4096 + 8 * seeded.below(128) as u64)
                .unwrap(),
            place => {
                let from = if place == 2 { whole.len() / 2 } else { 4096 };
                let at = from + 8 * seeded.below((whole.len() - from) / 8);
                file.write_all_at(&value, at as u64).unwrap();
            }
        }
    }
    if seeded.below(4) > 0 {
        header[..8].copy_from_slice(&whole[..8]);
        header[8..16].copy_from_slice(&whole[8..16]);
        let sum = checksum(&header[..224]).to_le_bytes();
        header[224..232].copy_from_slice(&sum);
    }
    file.write_all_at(&header, 0).unwrap();
    if seeded.below(8) == 0 {
        file.set_len(seeded.below(whole.len()) as u64).unwrap();
    }
}

#[test]
fn damaged_recordings_do_no_harm() {
    let inputs = std::env::var("REPLENISH_INPUTS").ok();
    let inputs: usize = inputs.and_then(|n| n.parse().ok()).unwrap_or(2000);
    let scratch = Scratch::new("hostile");
    let mut program = Program::start("hostile");
    program.wait(&scratch.path("top.json"));
    program.child.kill().unwrap();
    program.child.wait().unwrap();
    let source = program.file();
    let whole = std::fs::read(&source).unwrap();
    let directory = scratch.path("damaged");
    std::fs::create_dir(&directory).unwrap();
    let paths: Vec<_> = (0..FILES)
        .map(|n| directory.join(format!("{n}.live")))
        .collect();
    let mut seeded = Seeded(19);
    let [out, trace, svg] = ["out.json", "out.pftrace", "out.svg"].map(|name| scratch.path(name));
    let [out_path, trace_path, svg_path] = [&out, &trace, &svg].map(|path| path.to_str().unwrap());
    let (mut taken, mut left_out) = (0, 0);
    for round in 0..inputs.div_ceil(FILES) {
        // Damage adds up for a few rounds.
        for path in &paths {
            if round % 4 == 0 {
                std::fs::write(path, &whole).unwrap();
            }
            let file = OpenOptions::new()
                .read(true)
                .write(true)
                .open(path)
                .unwrap();
            damage(&file, &whole, &mut seeded);
        }
        let args = ["top", "--once", "--ended", "--json", out_path];
        let output = bounded(&directory, &args);
        assert!(output.status.success(), "{}", stderr(&output));
        let top = json(&out);
        let [programs, warnings] = ["programs", "warnings"].map(|k| top[k].as_array().unwrap());
        assert_eq!(programs.len() + warnings.len(), FILES, "round {round}");
        taken += programs.len();
        left_out += warnings.len();
        let live = ["top", "--every", "100ms", "--ended", "--svg", svg_path];
        let output = bounded(&directory, &live);
        assert!(output.status.success(), "{}", stderr(&output));
        let output = bounded(&directory, &["metrics", "--ended"]);
        assert!(output.status.success(), "{}", stderr(&output));
        crate::openmetrics::parse(&stdout(&output)).unwrap();
        let one = paths[round % FILES].to_str().unwrap();
        for args in [
            ["trace", one, "--perfetto", trace_path].as_slice(),
            &["why", one, "--json", out_path],
        ] {
            let output = bounded(&directory, args);
            let code = output.status.code();
            assert!(matches!(code, Some(0 | 1)), "{args:?}: {}", stderr(&output));
        }
    }
    println!("{taken} files were read, {left_out} left out");
    assert!(taken > 0 && left_out > 0);
}
