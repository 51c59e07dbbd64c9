//! Facts about this host before planning: the reservations of its programs, and the costs of
//! enforcement here.

use crate::outcome::Failure;
use replenish_plan::ledger::{Found, Ledger, VARIABLE};
use replenish_plan::{Deployment, Promise};

/// The facts that were found.
#[derive(Debug, Default)]
pub(crate) struct Host {
    /// The reservations of running programs.
    pub promised: Vec<Promise>,
    /// Whether the overheads were measured here.
    pub measured: bool,
    /// Notes for people, a sentence each.
    pub notes: Vec<String>,
}

impl Host {
    /// Looks into this host's ledger, unless that is to be `ignored`, and lets `deployment` count
    /// with the overheads that were measured here.
    pub(crate) fn look(deployment: &mut Deployment, ignored: bool) -> Result<Self, Failure> {
        let mut host = Self::default();
        if ignored {
            host.notes.push(
                "As if nothing else ran: the reservations of this host were not looked at.".into(),
            );
            return Ok(host);
        }
        let ledger = match Ledger::look().map_err(Failure::refused)? {
            Found::Here(ledger) => ledger,
            Found::Off => return Ok(host),
            Found::Nowhere(why) => {
                host.notes.push(format!(
                    "As if nothing else ran: no ledger of reservations ({why})."
                ));
                return Ok(host);
            }
        };
        if let Some(measured) = ledger.overheads().map_err(Failure::refused)? {
            deployment.measured(&measured);
            host.measured = true;
        }
        detail!(
            "the ledger of reservations is {}",
            ledger.directory().display()
        );
        let view = ledger.view().map_err(Failure::refused)?;
        host.notes.extend(view.warnings);
        for entry in &view.entries {
            let first = Promise::next_lock(deployment.locks.len(), &host.promised);
            host.promised.extend(entry.promises(first));
        }
        let cpus = &deployment.machine.cpus;
        let here = |p: &Promise| p.cpu.is_none_or(|cpu| cpus.contains(&cpu));
        host.promised.retain(here);
        if !host.promised.is_empty() {
            let owners: Vec<&str> = host.promised.iter().map(|p| p.owner.as_str()).collect();
            host.notes.push(format!(
                "Beside what runs on this host: {} (--ignore-ledger or {VARIABLE}=off: as if nothing did).",
                owners.join(", ")
            ));
        }
        Ok(host)
    }

    /// One line on the overheads.
    pub(crate) fn overheads(&self) -> &'static str {
        if self.measured {
            "Overheads: as `replenish doctor --save` measured them on this host."
        } else {
            "Overheads: defaults; `replenish doctor --save` measures this host's."
        }
    }
}
