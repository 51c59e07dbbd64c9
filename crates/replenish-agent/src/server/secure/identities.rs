//! The pre-shared keys of the access list, as `dimpl` asks for them.

use crate::config::AccessList;
use dimpl::PskResolver;
use replenish_xrce::wire::ClientKey;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The clients' keys, and the last question for one. One thread uses it.
#[derive(Debug, Default)]
pub(super) struct Identities {
    list: Mutex<AccessList>,
    asked: Mutex<Option<Asked>>,
}

/// The identity that an association asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// The key of this client.
    Known(ClientKey),
    /// The list has no such identity.
    Unknown,
}

impl Identities {
    pub(super) fn new(list: AccessList) -> Self {
        Self {
            list: Mutex::new(list),
            asked: Mutex::default(),
        }
    }

    /// Goes by `list` from now on; the list before.
    pub(super) fn replace(&self, list: AccessList) -> AccessList {
        std::mem::replace(&mut *locked(&self.list), list)
    }

    /// Whether `key` has the same pre-shared key as in the list before.
    pub(super) fn is_same(&self, before: &AccessList, key: ClientKey) -> bool {
        let psk = before.psk(key);
        psk.is_some() && locked(&self.list).psk(key) == psk
    }

    /// The question since the last call.
    pub(super) fn asked(&self) -> Option<Asked> {
        locked(&self.asked).take()
    }

    fn find(&self, identity: &[u8]) -> Option<(ClientKey, Vec<u8>)> {
        let text = std::str::from_utf8(identity).ok();
        let text = text.filter(|text| text.len() == 8 && !text.starts_with('+'))?;
        let key = ClientKey(u32::from_str_radix(text, 16).ok()?.to_be_bytes());
        let psk = locked(&self.list).psk(key)?.bytes().to_vec();
        Some((key, psk))
    }
}

impl PskResolver for Identities {
    /// An identity is the client's key as eight hexadecimal digits.
    fn resolve(&self, identity: &[u8]) -> Option<Vec<u8>> {
        let found = self.find(identity);
        let asked = found
            .as_ref()
            .map_or(Asked::Unknown, |(key, _)| Asked::Known(*key));
        *locked(&self.asked) = Some(asked);
        found.map(|(_, psk)| psk)
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
