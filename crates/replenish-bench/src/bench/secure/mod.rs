//! `replenish bench secure`: a sample's round trip through the agent, encrypted and not.
//!
//! ```text
//!   command ─► credentials   keys, certificates and the access list of one run
//!      ├─────► measure       the paths take turns ─► path   one client that hears itself
//!      └─────► report        points, table, JSON
//! ```

mod command;
mod credentials;
mod measure;
mod path;
mod report;

pub(crate) use command::{Args, run};
