//! `replenish doctor --save`: the overheads that plans count with, measured.

use super::latency::Latency;
use crate::handoff;
use crate::outcome::Failure;
use crate::time::Nanos;
use replenish_plan::Overheads;
use replenish_plan::ledger::{Found, Ledger};

/// The factor on observed costs: an observation is no bound.
const MARGIN: Nanos = 2;

/// The measured overheads, in ns. The others stay at their defaults.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub(super) struct Measured {
    latency: Nanos,
    context_switch: Nanos,
    callback: Nanos,
}

/// Measures on `cpu` and writes it where plans look.
///
/// - `latency`: the longest wake-up of the doctor's real-time thread, stalls of the machine left
///   out (no budget helps against those).
/// - `context_switch`: from a signal to the thread it wakes on the same CPU, 99 %.
/// - `callback`: there and back, that is two switches and the executor's part, 99 %; not less than
///   the default, which has decoding in it.
pub(super) fn save(cpu: usize, wake_ups: &Latency, real_time: bool) -> Result<Measured, Failure> {
    if !real_time {
        return Err(Failure::refused(
            "--save needs real-time priority: overheads of ordinary threads say nothing",
        ));
    }
    let ledger = match Ledger::find().map_err(Failure::refused)? {
        Found::Here(ledger) => ledger,
        Found::Off => return Err(Failure::refused("--save: the ledger is off")),
        Found::Nowhere(why) => return Err(Failure::refused(format!("--save: no ledger ({why})"))),
    };
    let (one_way, round_trip) = handoff::estimate(cpu)?;
    let default = Overheads::LINUX;
    #[expect(clippy::cast_sign_loss, reason = "a time that is not negative")]
    let latency = (wake_ups.max_undisturbed.max(1.0) * 1e3) as Nanos;
    let measured = Measured {
        latency: latency * MARGIN,
        context_switch: one_way * MARGIN,
        callback: (round_trip * MARGIN).max(default.callback),
    };
    let overheads = Overheads {
        latency: measured.latency,
        context_switch: measured.context_switch,
        callback: measured.callback,
        ..default
    };
    let how = format!(
        "measured on CPU {cpu} by replenish doctor {}, times {MARGIN}; the others are defaults",
        env!("CARGO_PKG_VERSION")
    );
    ledger
        .set_overheads(&overheads, &how)
        .map_err(Failure::refused)?;
    let us = |ns: Nanos| ns as f64 / 1e3;
    println!(
        "\n  Kept in {} (observed, times {MARGIN}): enforcer's latency {:.1} us, context switch {:.1} us, callback {:.1} us.",
        ledger.directory().display(),
        us(measured.latency),
        us(measured.context_switch),
        us(measured.callback)
    );
    Ok(measured)
}
