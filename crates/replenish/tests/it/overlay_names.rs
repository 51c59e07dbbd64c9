//! Names in a deployment file: whole ones, and those that the kernel has cut after 15 bytes.

use crate::common::executor;
use replenish::{Context, Executor};
use std::path::PathBuf;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// A file that is gone at the end.
struct File(PathBuf);

impl File {
    fn new(name: &str, text: &str) -> Self {
        let file = format!("replenish-overlay-{name}-{}.toml", std::process::id());
        let path = std::env::temp_dir().join(file);
        std::fs::write(&path, text).unwrap();
        Self(path)
    }
}

impl Drop for File {
    fn drop(&mut self) {
        std::fs::remove_file(&self.0).ok();
    }
}

fn with_workers(names: &[&str]) -> Executor {
    let (mut exec, _) = executor(&Context::in_process());
    for name in names {
        exec.worker(name).timer(100 * MS, |_| ()).unwrap();
    }
    exec
}

/// The template of the program after an overlay with this worker pinned to CPU 0, or the error.
fn overlaid(test: &str, workers: &[&str], name: &str) -> Result<String, String> {
    let file = File::new(test, &format!("[[worker]]\nname = \"{name}\"\ncpu = 0\n"));
    let mut exec = with_workers(workers);
    exec.overlay(&file.0);
    let running = exec.start().map_err(|e| e.to_string())?;
    let template = running.template().to_owned();
    running.stop();
    Ok(template)
}

/// The workers that are pinned to a CPU.
fn pinned(template: &str) -> Vec<String> {
    let workers = template.split("[[worker]]").skip(1);
    let pinned = workers.filter(|w| w.contains("\ncpu = 0\n"));
    let name = |w: &str| w.split('"').nth(1).unwrap_or_default().to_owned();
    pinned.map(name).collect()
}

#[test]
fn a_cut_name_means_the_one_worker_that_begins_like_it() {
    let workers = ["camera_pipeline_left", "drive", "camera"];
    let template = overlaid("cut", &workers, "camera_pipeline").unwrap();
    assert_eq!(pinned(&template), ["camera_pipeline_left"]);
    // A worker of that very name comes first.
    let workers = ["camera_pipeline_left", "camera_pipeline"];
    let template = overlaid("exact", &workers, "camera_pipeline").unwrap();
    assert_eq!(pinned(&template), ["camera_pipeline"]);
}

#[test]
fn an_ambiguous_cut_name_is_refused_with_its_place() {
    let workers = ["camera_pipeline_left", "camera_pipeline_right"];
    let error = overlaid("both", &workers, "camera_pipeline").unwrap_err();
    assert!(
        error.ends_with(
            ".toml:2:8: worker.name: the name \"camera_pipeline\" is cut after 15 bytes and may be \
             any of camera_pipeline_left, camera_pipeline_right; write the whole name"
        ),
        "{error}"
    );
}

#[test]
fn other_beginnings_are_no_names() {
    for wrong in ["camera_pipe", "camera_pipeline_lef"] {
        let error = overlaid("short", &["camera_pipeline_left"], wrong).unwrap_err();
        assert!(error.contains(&format!("no worker \"{wrong}\"")), "{error}");
    }
}
