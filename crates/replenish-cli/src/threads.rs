//! Each thread's requested scheduling, and the one that the kernel reports.

use crate::supervised::ThreadRow;
use replenish_os::{Granted, Tid, granted};
use std::fmt::Display;
use std::path::Path;

/// A thread by its name in this process, as the kernel sees it.
pub fn row(process: &str, name: &str, requested: &dyn Display) -> ThreadRow {
    let granted = find(name).and_then(|tid| granted(tid).ok());
    ThreadRow {
        name: format!("{process}/{name}"),
        requested: requested.to_string(),
        granted: granted.map_or_else(|| "unknown".to_string(), |g| policy(&g)),
        cpu: granted.map_or_else(|| "unknown".to_string(), |g| g.cpus.to_string()),
    }
}

/// The policy alone: the CPUs have a column of their own.
fn policy(granted: &Granted) -> String {
    let text = granted.to_string();
    text.split_once(", CPU")
        .map_or(text.as_str(), |(policy, _)| policy)
        .to_string()
}

/// The first thread of this process that has this name; the kernel keeps 15 bytes of it.
pub fn find(name: &str) -> Option<Tid> {
    all(name).into_iter().next()
}

/// Every thread of this process that has this name, in the order of their ids.
pub fn all(name: &str) -> Vec<Tid> {
    let wanted = name.as_bytes().get(..15).unwrap_or(name.as_bytes());
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    let named = tasks.flatten().filter_map(|task| {
        let comm = std::fs::read_to_string(Path::new(&task.path()).join("comm")).ok()?;
        let tid = task.file_name().to_str()?.parse().ok()?;
        (comm.trim_end().as_bytes() == wanted).then_some(())?;
        Tid::new(tid)
    });
    let mut named: Vec<Tid> = named.collect();
    named.sort_unstable_by_key(|tid| tid.get());
    named
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_thread_is_found_by_its_name() {
        let (tx, rx) = std::sync::mpsc::channel();
        let (end, ended) = std::sync::mpsc::channel::<()>();
        let thread = std::thread::Builder::new()
            .name("a-name-of-more-than-15".into())
            .spawn(move || {
                tx.send(replenish_os::current_tid()).unwrap();
                ended.recv().ok();
            })
            .unwrap();
        let tid = rx.recv().unwrap();
        assert_eq!(super::find("a-name-of-more-than-15"), Some(tid));
        assert_eq!(super::find("no such thread"), None);
        drop(end);
        thread.join().unwrap();
    }
}
