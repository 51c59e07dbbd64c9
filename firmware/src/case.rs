//! A case of the board's experiments, as the host writes it:
//! `budgets 10000 P/L/B/T@offset P P!`: the length, then one word per worker; all times in ms.
//! `P` alone is a worker without a budget, `!` one that is in an endless loop.

use alloc::vec::Vec;
use sporadic::{Low, Params};

const MS: u64 = 1_000_000;

/// One worker; times in ns.
#[derive(Clone, Copy, Debug)]
pub struct Worker {
    /// Its priority.
    pub priority: u8,
    /// The priority it has when its budget is used up.
    pub background: u8,
    /// Its budget; 0: none.
    pub budget: u64,
    /// The period of the budget.
    pub period: u64,
    /// Time at which it starts, after the case began.
    pub offset: u64,
    /// Whether it never comes back from its first callback.
    pub endless: bool,
}

impl Worker {
    /// The budget's parameters.
    pub fn params(&self) -> Option<Params> {
        let low = Low::Background(self.background);
        (self.budget > 0)
            .then(|| Params::new(self.priority, low, self.budget, self.period, 10).ok())?
    }
}

/// All of it.
#[derive(Debug)]
pub struct Case {
    /// Length of the measurement, in ns.
    pub length: u64,
    /// The workers.
    pub workers: Vec<Worker>,
}

/// Reads a case.
///
/// # Errors
/// A sentence on the part that is missing or wrong.
pub fn read(text: &str) -> Result<Case, &'static str> {
    let mut words = text.split_ascii_whitespace().skip(1);
    let length = words.next().and_then(|w| w.parse::<u64>().ok());
    let length = length.ok_or("the length in ms is missing")? * MS;
    let workers = words.map(worker).collect::<Option<Vec<_>>>();
    let workers = workers.filter(|w| !w.is_empty());
    Ok(Case {
        length,
        workers: workers.ok_or("a worker is P/L/B/T@offset, P or P!")?,
    })
}

fn worker(word: &str) -> Option<Worker> {
    let (word, endless) = word.strip_suffix('!').map_or((word, false), |w| (w, true));
    let (word, offset) = word.split_once('@').unwrap_or((word, "0"));
    let mut parts = word.split('/');
    let priority = parts.next()?.parse().ok()?;
    let mut worker = Worker {
        priority,
        background: 0,
        budget: 0,
        period: 0,
        offset: offset.parse::<u64>().ok()? * MS,
        endless,
    };
    if let Some(background) = parts.next() {
        worker.background = background.parse().ok()?;
        worker.budget = parts.next()?.parse::<u64>().ok()? * MS;
        worker.period = parts.next()?.parse::<u64>().ok()? * MS;
        worker.params()?;
    }
    Some(worker)
}
