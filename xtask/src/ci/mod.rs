//! `cargo xtask ci [STAGE…]`: what must pass before anything lands.
//!
//! ```text
//!   command: which stages, in which order, side by side ──► stages: the commands of each
//!                        └──────────► run: one command after another ──► tally: counts and times
//! ```
//! Nothing is installed here: `.ci/install` does that, and `.ci/run` calls both.

mod command;
mod paths;
mod run;
mod stage;
mod stages;
mod tally;

pub(crate) use command::run;
pub(crate) use stage::Stage;
