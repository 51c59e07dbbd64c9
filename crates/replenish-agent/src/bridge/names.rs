//! The topic names that clients bring to the other side: how many, whose, and of which type.
//!
//! Names cost memory here and at all others in the domain. So they are bounded for all, for a
//! client and for a host, and an endpoint with one more is refused, not ignored. A name that
//! nothing uses is forgotten with its type.
//!
//! ```text
//!   CREATE ──► admit ── known, same type ─────────────────► used once more
//!                 ├──── known, other type ────────────────► refused: Type
//!                 └──── new ── room for all, client, host ► used, else refused: Full
//!   DELETE ──► release ── used by nothing more ───────────► forgotten
//! ```

use replenish_xrce::wire::ClientKey;
use std::collections::HashMap;
use std::net::IpAddr;

/// The part of all names that one client may bring, and the part for all clients of a host.
const CLIENT_PART: usize = 8;
const HOST_PART: usize = 2;

/// Domains with names: as many as `dds.limits.domains` may be.
pub(crate) const MOST_DOMAINS: usize = 16;

/// The client that asks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asker {
    pub(crate) key: ClientKey,
    pub(crate) host: Option<IpAddr>,
}

/// Why a name cannot cross.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NameRefusal {
    /// It has another type, and endpoints use it.
    Type,
    /// There are as many as there may be: the limit's name and value.
    Full(&'static str, usize),
}

/// The names of all domains.
#[derive(Debug)]
pub(crate) struct Names {
    /// The domain of clients that say 0.
    domain: u16,
    /// Names of one domain.
    limit: usize,
    table: HashMap<(u16, Box<str>), Name>,
}

#[derive(Debug)]
struct Name {
    type_name: Box<str>,
    users: usize,
    by: Asker,
}

impl Names {
    pub(crate) fn new(domain: u16, limit: usize) -> Self {
        Self {
            domain,
            limit,
            table: HashMap::new(),
        }
    }

    fn domain(&self, of_client: i16) -> u16 {
        match of_client {
            0 => self.domain,
            other => other.cast_unsigned(),
        }
    }

    /// Notes one more endpoint of `by` on this topic, or says why it cannot be.
    pub(crate) fn admit(
        &mut self,
        by: Asker,
        (domain, name, type_name): (i16, &str, &str),
    ) -> Result<(), NameRefusal> {
        let domain = self.domain(domain);
        let key = (domain, Box::from(name));
        if let Some(known) = self.table.get_mut(&key) {
            if *known.type_name != *type_name {
                return Err(NameRefusal::Type);
            }
            known.users += 1;
            return Ok(());
        }
        self.place_for(domain)?;
        self.room(domain, by)?;
        let name = Name {
            type_name: type_name.into(),
            users: 1,
            by,
        };
        self.table.insert(key, name);
        Ok(())
    }

    /// Whether there may be names in this domain, too.
    fn place_for(&self, domain: u16) -> Result<(), NameRefusal> {
        let mut domains: Vec<u16> = self.table.keys().map(|(of, _)| *of).collect();
        domains.sort_unstable();
        domains.dedup();
        if domains.len() < MOST_DOMAINS || domains.contains(&domain) {
            return Ok(());
        }
        Err(NameRefusal::Full("domains with names", MOST_DOMAINS))
    }

    /// Whether `by` may bring one more.
    fn room(&self, domain: u16, by: Asker) -> Result<(), NameRefusal> {
        let (mut all, mut of_client, mut of_host) = (0, 0, 0);
        for ((of, _), name) in &self.table {
            if *of == domain {
                all += 1;
                of_client += usize::from(name.by.key == by.key);
                of_host += usize::from(by.host.is_some() && name.by.host == by.host);
            }
        }
        let part = |of: usize| (self.limit / of).max(1);
        if all >= self.limit {
            Err(NameRefusal::Full("dds.limits.topics", self.limit))
        } else if of_client >= part(CLIENT_PART) {
            let what = "topic names of one client in DDS";
            Err(NameRefusal::Full(what, part(CLIENT_PART)))
        } else if of_host >= part(HOST_PART) {
            let what = "topic names of one host in DDS";
            Err(NameRefusal::Full(what, part(HOST_PART)))
        } else {
            Ok(())
        }
    }

    /// An endpoint on this topic is gone.
    pub(crate) fn release(&mut self, domain: i16, name: &str) {
        let key = (self.domain(domain), Box::from(name));
        if let Some(known) = self.table.get_mut(&key) {
            known.users = known.users.saturating_sub(1);
            if known.users == 0 {
                self.table.remove(&key);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn client(number: u8, host: u8) -> Asker {
        Asker {
            key: ClientKey([number; 4]),
            host: Some([127, 0, 0, host].into()),
        }
    }

    /// Before, one client took all names for good, and others were told OK and never bridged.
    #[test]
    fn a_client_and_a_host_take_their_part_of_the_names_only() {
        let mut names = Names::new(0, 64);
        let mut bring = |by: Asker| {
            let admit = |number| names.admit(by, (0, &format!("{by:?}{number}"), "T"));
            (0..100).map(admit).filter(Result::is_ok).count()
        };
        assert_eq!(bring(client(1, 1)), 8);
        assert_eq!((2..9).map(|key| bring(client(key, 1))).sum::<usize>(), 24);
        assert_eq!(bring(client(9, 2)), 8, "another host still has names");
        assert_eq!(names.admit(client(1, 1), (0, "x", "T")), {
            let what = "topic names of one client in DDS";
            Err(NameRefusal::Full(what, 8))
        });
    }

    #[test]
    fn a_name_has_one_type_while_it_is_used() {
        let mut names = Names::new(5, 64);
        let by = client(1, 1);
        assert_eq!(names.admit(by, (0, "a", "Wrong")), Ok(()));
        assert_eq!(names.admit(by, (5, "a", "Right")), Err(NameRefusal::Type));
        assert_eq!(names.admit(by, (6, "a", "Right")), Ok(()));
        names.release(0, "a");
        assert_eq!(names.admit(by, (0, "a", "Right")), Ok(()));
    }

    /// Before, each of 65536 domains kept the names that clients once had in it.
    #[test]
    fn domains_that_nobody_uses_keep_no_names() {
        let mut names = Names::new(0, 8);
        for domain in 1..1000 {
            assert_eq!(names.admit(client(1, 1), (domain, "a", "T")), Ok(()));
            names.release(domain, "a");
            assert!(names.table.len() <= MOST_DOMAINS);
        }
        let admitted = (1..1000).filter(|d| names.admit(client(1, 1), (*d, "a", "T")).is_ok());
        assert_eq!(admitted.count(), MOST_DOMAINS, "all in use");
    }

    #[test]
    fn names_are_forgotten_one_by_one() {
        let mut names = Names::new(0, 8);
        assert_eq!(names.admit(client(200, 200), (0, "kept", "T")), Ok(()));
        for round in 0..100 {
            let name = format!("{round}");
            assert_eq!(names.admit(client(round, round), (0, &name, "T")), Ok(()));
            names.release(0, &name);
        }
        assert_eq!(names.table.len(), 1);
    }
}
