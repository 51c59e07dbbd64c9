//! Cost of recording, and of a chain, per message: two executors that differ in that alone, in
//! turns.

use super::awake::Awake;
use super::ours::{Ours, SEEN, Seen};
use super::receiver::Setting;
use super::window::{Window, window, windows};
use crate::load::spec::SUPPORT_PRIORITY;
use replenish_cli::lock;
use replenish_cli::machine::cpus::Cpus;
use replenish_cli::machine::fifo_or_other;
use replenish_cli::outcome::Failure;
use replenish_os::{ThreadSpec, spawn};

/// A window in which the machine stood still is measured again, so often at most.
const AGAIN: u64 = 3;

fn pairs(setting: Setting, with: Seen, without: Seen) -> Result<f64, Failure> {
    let mut on = Ours::start_seen(setting, 1, with)?;
    let mut off = Ours::start_seen(setting, 1, without)?;
    let mut ratios = Vec::new();
    for n in 0..setting.windows * AGAIN {
        if ratios.len() as u64 >= setting.windows {
            break;
        }
        let cost = |of: &mut Ours| -> Result<Option<f64>, Failure> {
            let window: Option<Window> = window(of, setting.rate)?;
            Ok(window.map(|w| w.each(w.used.cpu)))
        };
        // Back and forth, so that what drifts meets both alike.
        let (with, without) = if n % 2 == 0 {
            let with = cost(&mut on)?;
            (with, cost(&mut off)?)
        } else {
            let without = cost(&mut off)?;
            (cost(&mut on)?, without)
        };
        ratios.extend(
            with.zip(without)
                .map(|(with, without)| with / without.max(1.0)),
        );
    }
    on.stop()?;
    off.stop()?;
    ratios.sort_by(f64::total_cmp);
    let median = ratios.get(ratios.len() / 2).copied();
    median.ok_or_else(|| Failure::refused("the machine stood still in every window"))
}

/// CPU time per message with the recorder on against off, on this CPU. All windows together take
/// `units` units.
pub(crate) fn recorder_ratio(cpu: usize, units: u64) -> Result<f64, Failure> {
    ratio(cpu, units, SEEN, Seen { ring: 0, ..SEEN })
}

/// CPU time per message of a subscription that is a chain against one that is in none.
pub(crate) fn chain_ratio(cpu: usize, units: u64) -> Result<f64, Failure> {
    let chain = Seen {
        chain: true,
        ..SEEN
    };
    ratio(cpu, units, chain, SEEN)
}

/// The median over pairs of windows.
fn ratio(cpu: usize, units: u64, with: Seen, without: Seen) -> Result<f64, Failure> {
    const RATE: u64 = 1000;
    let setting = Setting {
        rate: RATE,
        windows: windows(units, RATE),
        cpu,
        support: Cpus::choose().support,
        awake: true,
    };
    let _alone = lock::acquire()?;
    let awake = Awake::keep(cpu)?;
    let policy = fifo_or_other(SUPPORT_PRIORITY - 1);
    let spec = ThreadSpec::new("sender")
        .policy(policy)
        .cpu(setting.support);
    let sender = spawn(spec, move || pairs(setting, with, without)).map_err(Failure::refused)?;
    let ratio = sender
        .join()
        .map_err(|_| Failure::refused("the sender panicked"))??;
    awake.stop()?;
    Ok((ratio * 1e4).round() / 1e4)
}
