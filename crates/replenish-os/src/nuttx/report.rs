//! Constants in which shim, image and this crate must agree. They are checked before the first
//! thread is made.

use super::ffi::{self, ShimReport, ThreadMemory};
use crate::Nanos;
use core::fmt;
use core::sync::atomic::{AtomicU32, Ordering};

const VERSION: u32 = 1;
const MASKS: u32 = 1;
const SWITCHES: u32 = 2;
const SPORADIC: u32 = 4;
const ROUND_ROBIN: u32 = 8;
/// A clock or tick coarser than this holds no budget worth the name.
const COARSEST: Nanos = 1_000_000;

/// The system's settings, as the shim found them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SystemInfo {
    /// `sizeof(pthread_attr_t)`.
    pub attr_bytes: u32,
    /// `sizeof(struct sched_param)`.
    pub param_bytes: u32,
    /// `sizeof(pthread_mutex_t)`.
    pub mutex_bytes: u32,
    /// `sizeof(time_t)`.
    pub time_bytes: u32,
    /// Resolution of the clock in nanoseconds; 1 for a clock of the image's.
    pub resolution: Nanos,
    /// The system's tick in nanoseconds: waits end at its multiples, and so do budgets. The
    /// next budget pays back the overrun of one.
    pub tick: Nanos,
    /// Whether switch hooks report CPU time and blocking. Always, but on a host.
    pub switch_hooks: bool,
    /// Pending replenishments of the system's own `SCHED_SPORADIC`; 0: there is none.
    pub native_repl: u32,
    /// Whether there is round-robin.
    pub round_robin: bool,
    /// The priority of a thread that asked for none.
    pub lowest: u8,
}

/// `clock 250 ns, tick 100000 ns, switch hooks, pthread_attr_t 56 B, ...`
impl fmt::Display for SystemInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hooks = if self.switch_hooks { "" } else { "no " };
        write!(
            f,
            "clock {} ns, tick {} ns, {hooks}switch hooks, SCHED_SPORADIC {}, pthread_attr_t {} B, sched_param \
             {} B, pthread_mutex_t {} B, time_t {} B",
            self.resolution,
            self.tick,
            self.native_repl,
            self.attr_bytes,
            self.param_bytes,
            self.mutex_bytes,
            self.time_bytes
        )
    }
}

/// Reason why nothing can run here.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[non_exhaustive]
pub enum CheckError {
    /// The shim is of another version of this crate.
    Version {
        /// The shim's version and the size of its report.
        shim: (u32, u32),
    },
    /// The shim's thread type is larger than the room for it.
    ThreadSize {
        /// Its size and alignment in bytes.
        shim: (u32, u32),
    },
    /// The system's functions write beyond a type as the shim knows it: shim and image were
    /// compiled with different configurations.
    Misfit {
        /// The type.
        what: &'static str,
        /// Its size in the shim, in bytes; 0: not reported.
        shim: u32,
    },
    /// The image's configuration lacks something.
    Missing {
        /// The options that bring it.
        options: &'static str,
    },
    /// The shim could not be set up.
    Start {
        /// The error number.
        errno: i32,
    },
    /// The clock or the tick is too coarse.
    Resolution {
        /// Its steps in nanoseconds.
        ns: Nanos,
    },
}

impl fmt::Display for CheckError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Version { shim: (v, bytes) } => write!(
                f,
                "nuttx/shim.c is version {v} with a report of {bytes} bytes, this library needs \
                 version {VERSION} and {} bytes: compile the shim of the same release",
                size_of::<ShimReport>()
            ),
            Self::ThreadSize {
                shim: (bytes, align),
            } => write!(
                f,
                "a thread of the shim takes {bytes} bytes aligned to {align}: allowed up to {} \
                 aligned to 8",
                ThreadMemory::BYTES
            ),
            Self::Misfit { what, shim } => write!(
                f,
                "{what} has {shim} bytes in the shim and more in the image: compile the shim with \
                 the image's include/nuttx/config.h"
            ),
            Self::Missing { options } => {
                write!(f, "the image was configured without {options}")
            }
            Self::Start { errno } => write!(
                f,
                "setting up failed with error {errno}: CONFIG_TLS_NELEM must be 1 or more, and \
                 CONFIG_DRIVERS_NOTE_MAX larger than the number of other note drivers"
            ),
            Self::Resolution { ns } => write!(
                f,
                "the clock or the tick has steps of {ns} ns: allowed 1 to {COARSEST} \
                 (CONFIG_USEC_PER_TICK, CONFIG_SCHED_TICKLESS)"
            ),
        }
    }
}

impl core::error::Error for CheckError {}

impl ShimReport {
    fn has(&self, feature: u32) -> bool {
        self.features & feature != 0
    }

    /// The info, if everything that is needed is there. `host`: where tests run.
    fn judge(&self, host: bool) -> Result<SystemInfo, CheckError> {
        let report = u32::try_from(size_of::<Self>()).unwrap_or(0);
        if (self.version, self.bytes) != (VERSION, report) {
            return Err(CheckError::Version {
                shim: (self.version, self.bytes),
            });
        }
        if self.thread_bytes as usize > ThreadMemory::BYTES || self.thread_align > 8 {
            return Err(CheckError::ThreadSize {
                shim: (self.thread_bytes, self.thread_align),
            });
        }
        let types = [
            ("pthread_attr_t", self.attr_bytes),
            ("struct sched_param", self.param_bytes),
            ("sem_t", 0),
            ("struct timespec", 0),
        ];
        for (bit, (what, shim)) in types.into_iter().enumerate() {
            if self.misfits & 1 << bit != 0 {
                return Err(CheckError::Misfit { what, shim });
            }
        }
        for (feature, options) in [
            (MASKS, "CONFIG_BUILD_FLAT (and without CONFIG_SMP)"),
            (
                SWITCHES,
                "CONFIG_SCHED_INSTRUMENTATION_SWITCH and CONFIG_DRIVERS_NOTE",
            ),
        ] {
            let excused = host && feature == SWITCHES;
            if !self.has(feature) && !excused {
                return Err(CheckError::Missing { options });
            }
        }
        if self.started != 0 {
            return Err(CheckError::Start {
                errno: self.started,
            });
        }
        let coarser = self.resolution.max(self.step);
        if self.resolution == 0 || self.step == 0 || coarser > COARSEST {
            return Err(CheckError::Resolution { ns: coarser });
        }
        Ok(SystemInfo {
            attr_bytes: self.attr_bytes,
            param_bytes: self.param_bytes,
            mutex_bytes: self.mutex_bytes,
            time_bytes: self.time_bytes,
            resolution: self.resolution,
            tick: self.step,
            switch_hooks: self.has(SWITCHES),
            native_repl: if self.has(SPORADIC) { self.max_repl } else { 0 },
            round_robin: self.has(ROUND_ROBIN),
            lowest: u8::try_from(self.lowest).unwrap_or(1),
        })
    }
}

const UNKNOWN: u32 = 0;
const GOOD: u32 = 1;
const BAD: u32 = 2;
static CHECKED: AtomicU32 = AtomicU32::new(UNKNOWN);

/// Checks that shim, image and this library fit together, and says what the system has. Threads
/// are made only if they do; call it first to see why.
///
/// # Errors
/// [`CheckError`] names what does not fit, and what would.
pub fn check() -> Result<SystemInfo, CheckError> {
    let info = ffi::start_up().judge(cfg!(nuttx_host));
    let state = if info.is_ok() { GOOD } else { BAD };
    CHECKED.store(state, Ordering::Release);
    info
}

/// Whether everything fits; looks once.
pub(super) fn is_good() -> bool {
    match CHECKED.load(Ordering::Acquire) {
        GOOD => true,
        BAD => false,
        _ => check().is_ok(),
    }
}

#[cfg(test)]
mod tests;
