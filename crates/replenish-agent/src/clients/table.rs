//! The table of clients: by slot, by where their messages come from, by key.

use super::client::Client;
use replenish_xrce::wire::{ClientKey, SessionId};
use std::collections::HashMap;
use std::hash::Hash;

/// A bounded table of clients. A client keeps its slot until it is removed.
#[derive(Debug)]
pub(crate) struct Clients<P> {
    slots: Vec<Option<Client<P>>>,
    routes: HashMap<(P, SessionId), usize>,
    keys: HashMap<ClientKey, usize>,
}

impl<P: Copy + Eq + Hash> Clients<P> {
    /// A table for `limit` clients.
    pub(crate) fn new(limit: usize) -> Self {
        Self {
            slots: std::iter::repeat_with(|| None).take(limit).collect(),
            routes: HashMap::new(),
            keys: HashMap::new(),
        }
    }

    /// A free slot, if there is one.
    pub(crate) fn vacancy(&self) -> Option<usize> {
        self.slots.iter().position(Option::is_none)
    }

    /// Puts a client into a free slot. No other client has its key or its route.
    pub(crate) fn insert(&mut self, index: usize, client: Client<P>) {
        if let Some(slot) = self.slots.get_mut(index) {
            self.routes.insert((client.peer, client.session), index);
            self.keys.insert(client.key, index);
            *slot = Some(client);
        }
    }

    pub(crate) fn remove(&mut self, index: usize) -> Option<Client<P>> {
        let client = self.slots.get_mut(index)?.take()?;
        self.routes.remove(&(client.peer, client.session));
        self.keys.remove(&client.key);
        Some(client)
    }

    /// The client whose messages of `session` come from `peer`.
    pub(crate) fn by_route(&self, peer: P, session: SessionId) -> Option<usize> {
        self.routes.get(&(peer, session)).copied()
    }

    /// The clients at some peers.
    pub(crate) fn at(&self, which: impl Fn(&P) -> bool) -> Vec<usize> {
        let slots = self.slots.iter().enumerate();
        slots
            .filter(|(_, slot)| slot.as_ref().is_some_and(|client| which(&client.peer)))
            .map(|(index, _)| index)
            .collect()
    }

    pub(crate) fn by_key(&self, key: ClientKey) -> Option<usize> {
        self.keys.get(&key).copied()
    }

    pub(crate) fn get(&self, index: usize) -> Option<&Client<P>> {
        self.slots.get(index)?.as_ref()
    }

    pub(crate) fn get_mut(&mut self, index: usize) -> Option<&mut Client<P>> {
        self.slots.get_mut(index)?.as_mut()
    }

    /// The clients with their slots.
    pub(crate) fn iter_slots(&self) -> impl Iterator<Item = (usize, &Client<P>)> {
        let slots = self.slots.iter().enumerate();
        slots.filter_map(|(at, slot)| Some((at, slot.as_ref()?)))
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = &Client<P>> {
        self.slots.iter().flatten()
    }

    pub(crate) fn len(&self) -> usize {
        self.routes.len()
    }
}
