//! Names in events: ids that hold for the whole process, in the tables of all its recordings.

use replenish_os::live::SharedMemory;
use replenish_recorder::{MAX_NAMES, NameKind, Span, write_name};
use std::collections::HashMap;
use std::string::String;
use std::sync::{Arc, LazyLock, Mutex, PoisonError, Weak};
use std::vec::Vec;

/// The id of a name in events; 0 for names beyond the [`MAX_NAMES`] that there is room for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct NameId(pub(super) u32);

/// The program's own point in the recording, named when the program sets itself up.
///
/// [`CallbackContext::mark`](crate::CallbackContext::mark) records it.
#[derive(Debug, Clone, Copy)]
pub struct Mark(pub(super) NameId);

impl Mark {
    /// A mark of this name, of which the first 120 bytes are kept. The same name gives the same
    /// mark. Set-up only: this allocates. A process has room for 2048 names of handles, topics and
    /// marks; later ones are recorded without their name.
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self(intern(NameKind::Mark, name))
    }
}

/// The table of one recording.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) memory: Arc<SharedMemory>,
    pub(super) names: Span,
}

impl Table {
    fn write(&self, id: u32, kind: NameKind, name: &str) {
        write_name(self.names.of(&self.memory), id, kind, name);
    }
}

#[derive(Default)]
struct Names {
    ids: HashMap<String, u32>,
    all: Vec<(NameKind, String)>,
    tables: Vec<Weak<Table>>,
}

/// Locked where handles and publishers are made, which allocates as well: by no message.
static NAMES: LazyLock<Mutex<Names>> = LazyLock::new(Mutex::default);

/// The id of a handle's name.
pub(crate) fn handle(id: &str) -> NameId {
    intern(NameKind::Handle, id)
}

/// The id of a topic's name.
pub(crate) fn topic(name: &str) -> NameId {
    intern(NameKind::Topic, name)
}

/// The id of a chain's name.
pub(crate) fn chain(name: &str) -> NameId {
    intern(NameKind::Chain, name)
}

fn intern(kind: NameKind, name: &str) -> NameId {
    let prefix = match kind {
        NameKind::Handle => 'h',
        NameKind::Topic => 't',
        NameKind::Mark => 'm',
        NameKind::Chain => 'c',
    };
    let mut key = String::with_capacity(name.len() + 1);
    key.push(prefix);
    key.push_str(name);
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(id) = names.ids.get(&key) {
        return NameId(*id);
    }
    if names.all.len() >= MAX_NAMES {
        return NameId(0);
    }
    names.all.push((kind, name.into()));
    let id = u32::try_from(names.all.len()).unwrap_or(0);
    names.ids.insert(key, id);
    for table in names.tables.iter().filter_map(Weak::upgrade) {
        table.write(id, kind, name);
    }
    NameId(id)
}

/// Writes all names into a new table; later ones follow for as long as it lives.
pub(super) fn fill(table: &Arc<Table>) {
    let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
    for (id, (kind, name)) in (1..).zip(&names.all) {
        table.write(id, *kind, name);
    }
    names.tables.retain(|known| known.strong_count() > 0);
    names.tables.push(Arc::downgrade(table));
}
