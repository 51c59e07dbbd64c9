//! The access list: `--access FILE`, read at the start and at each SIGHUP.

use super::private;
use crate::outcome::Failure;
use replenish_agent::{AccessControl, AccessList};
use serde_json::{Value, json};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Longer files are refused, in bytes.
const MAX_FILE: u64 = 4 << 20;

/// The list's file, and what has become of it.
#[derive(Debug)]
pub(super) struct AccessFile {
    path: PathBuf,
    control: AccessControl,
    clients: usize,
    loaded: u64,
    failed: u64,
    error: Option<String>,
}

/// Reads the list.
pub(super) fn read(path: &Path) -> Result<AccessList, Failure> {
    load(path).map_err(Failure::refused)
}

fn load(path: &Path) -> Result<AccessList, String> {
    let shown = private::shown(path);
    let unreadable = |why: std::io::Error| format!("cannot read {shown}: {why}");
    let file = File::open(path).map_err(unreadable)?;
    let found = file.metadata().map_err(unreadable)?;
    let mut text = String::new();
    let mut file = file.take(MAX_FILE + 1);
    file.read_to_string(&mut text).map_err(unreadable)?;
    let list = AccessList::parse(&text).map_err(|why| format!("{shown}: {why}"))?;
    if list.has_keys() {
        private::check(path, &found).map_err(|why| format!("cannot use {shown}: {why}"))?;
    }
    Ok(list)
}

impl AccessFile {
    /// A list of `clients` entries that was read from `path`.
    pub(super) fn new(path: PathBuf, control: AccessControl, clients: usize) -> Self {
        Self {
            path,
            control,
            clients,
            loaded: 1,
            failed: 0,
            error: None,
        }
    }

    /// Reads the file again, and says what has become of it. A file with an error changes nothing.
    pub(super) fn reload(&mut self) -> String {
        match load(&self.path) {
            Ok(list) => {
                (self.clients, self.error) = (list.len(), None);
                self.loaded += 1;
                self.control.replace(list);
                format!("read the access list again: {} entries", self.clients)
            }
            Err(why) => {
                self.failed += 1;
                let line = format!("kept the access list as it was: {why}");
                self.error = Some(why);
                line
            }
        }
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "file": self.path.display().to_string(),
            "entries": self.clients,
            "loaded": self.loaded,
            "failed": self.failed,
            "error": self.error,
        })
    }
}
