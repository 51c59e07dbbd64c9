//! A case that failed, with the kernel's text and all other evidence, on disk: judged again later.

use super::case::Case;
use super::judge::Evidence;
use super::timeline::Reader;
use replenish_cli::outcome::Failure;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};

/// The evidence but for the timeline, which is read from the trace again.
#[derive(Debug, Serialize, Deserialize)]
struct Kept {
    case: Case,
    cpu: usize,
    evidence: Evidence,
}

/// Where the trace of a case under way goes.
pub(super) fn trace(directory: &Path) -> PathBuf {
    directory.join(format!("under-way-{}.trace", std::process::id()))
}

/// Names the trace after its seed, and writes the rest of the evidence beside it. What an earlier
/// run of the seed has left stays.
pub(super) fn keep(
    directory: &Path,
    case: &Case,
    cpu: usize,
    evidence: &Evidence,
) -> Result<PathBuf, Failure> {
    let name = |n: u32| match n {
        0 => directory.join(format!("seed-{}.json", case.seed)),
        n => directory.join(format!("seed-{}-{n}.json", case.seed)),
    };
    let mut paths = (0..).map(name);
    let free = paths.find(|path| !path.exists());
    let path = free.ok_or_else(|| failed(directory, &"full"))?;
    let (from, to) = (trace(directory), path.with_extension("trace"));
    fs::rename(&from, to).map_err(|e| failed(&from, &e))?;
    let kept = KeptRef {
        case,
        cpu,
        evidence,
    };
    let text = serde_json::to_string(&kept).map_err(Failure::refused)?;
    fs::write(&path, text).map_err(|e| failed(&path, &e))?;
    Ok(path)
}

/// As [`Kept`], to be written.
#[derive(Serialize)]
struct KeptRef<'a> {
    case: &'a Case,
    cpu: usize,
    evidence: &'a Evidence,
}

/// Reads what [`keep`] has written, and the trace.
pub(super) fn read(path: &Path) -> Result<(Case, Evidence), Failure> {
    let text = fs::read_to_string(path).map_err(|e| failed(path, &e))?;
    let mut kept: Kept = serde_json::from_str(&text).map_err(|e| failed(path, &e))?;
    let trace = path.with_extension("trace");
    let lines = BufReader::new(fs::File::open(&trace).map_err(|e| failed(&trace, &e))?);
    let mut reader = Reader::new(kept.cpu).with_prompt(kept.case.prompt());
    for line in lines.split(b'\n') {
        let line = line.map_err(|e| failed(&trace, &e))?;
        reader.line(&String::from_utf8_lossy(&line));
    }
    kept.evidence.timeline = reader.finish();
    Ok((kept.case, kept.evidence))
}

fn failed(path: &Path, e: &dyn std::fmt::Display) -> Failure {
    Failure::refused(format!("{}: {e}", path.display()))
}
