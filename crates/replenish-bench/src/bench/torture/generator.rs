//! From a seed to a case.
//!
//! The sets fit: their budgets, the strangers and the enforcer's work at each replenishment sum to
//! less than the real-time throttle leaves. So each promise can be kept, and is checked.

use super::case::{Case, Stop, Stranger, Work, Worker, ratio};
use super::random::Random;
use crate::load::{MS, Nanos};

const US: Nanos = 1000;

/// The enforcer's need for each budget and period, generously.
const COST: Nanos = 60 * US;

/// Parts of a case that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Feature {
    /// Groups, and with them inherited priorities.
    Groups,
    /// Callbacks that block.
    Blocking,
    /// FIFO threads that the executor does not know.
    Strangers,
    /// SIGSTOP and SIGCONT of the whole process.
    Stops,
    /// Handles that come and go.
    Handles,
    /// Callbacks that panic.
    Panics,
    /// No context-switch records.
    NoRecords,
    /// The right to raise a thread is taken away at run time.
    Privileges,
    /// Workers and enforcers that are not pinned.
    Unpinned,
    /// Workers with guarantees, whose priorities the executor chooses.
    Guarantees,
    /// Callbacks in groups that never end.
    Endless,
    /// Futures that await sleeps and write to the log.
    Futures,
}

/// Odd reservations: budget and period.
const ODD: [(Nanos, Nanos); 7] = [
    (50 * US, 500 * US),
    (100 * US, MS),
    (800 * US, 3 * MS),
    (2500 * US, 11 * MS),
    (7 * MS, 31 * MS),
    (23 * MS, 70 * MS),
    (70 * MS, 230 * MS),
];

/// The case of a seed that runs for so many seconds.
pub(super) fn case(seed: u64, seconds: u64, features: &[Feature]) -> Case {
    let mut r = Random::new(seed ^ 0x7265_706C_656E_6973);
    let mut has = |feature: Feature, chance: u64| {
        let drawn = r.percent(chance); // drawn in any case: the rest is as without the filter
        drawn && features.contains(&feature)
    };
    let groups = has(Feature::Groups, 30);
    let blocking = has(Feature::Blocking, 60);
    let strangers = has(Feature::Strangers, 40);
    let stops = has(Feature::Stops, 25);
    let handles = has(Feature::Handles, 30);
    let panics = has(Feature::Panics, 25);
    let records = !has(Feature::NoRecords, 25);
    let mut left = 0.5 + 0.35 * r.fraction();
    let strangers = if strangers {
        some_strangers(&mut r, &mut left)
    } else {
        Vec::new()
    };
    let mut workers = Vec::new();
    let wanted = r.one_of(&[1, 2, 3, 4, 6, 10, 16, 25, 40], 1);
    for index in 0..wanted {
        let share = left / (wanted - index) as f64 * (0.3 + 1.4 * r.fraction());
        let Some(worker) = worker(&mut r, share.min(left), (groups, blocking, panics)) else {
            continue;
        };
        left -= ratio(worker.budget + COST, worker.period);
        workers.push(worker);
    }
    if workers.is_empty() {
        workers.extend(worker(&mut r, 0.3, (false, false, false)));
    }
    let length = seconds * 1000 * MS;
    let stop = |r: &mut Random| Stop {
        at: r.within(length / 10, length * 8 / 10),
        lasts: r.within(1, 300) * MS,
    };
    let mut stops: Vec<Stop> = if stops {
        (0..r.within(1, seconds.clamp(1, 10)))
            .map(|_| stop(&mut r))
            .collect()
    } else {
        Vec::new()
    };
    stops.sort_by_key(|s| s.at);
    let mut case = Case {
        seed,
        records,
        workers,
        strangers,
        stops,
        churn_every: if handles { r.within(2, 50) * MS } else { 0 },
        drops_at: None,
        unpinned: false,
    };
    disturb(&mut case, length, features);
    if features.contains(&Feature::Futures) {
        await_and_log(&mut case);
    }
    case
}

/// Again a sequence of its own.
fn await_and_log(case: &mut Case) {
    let mut r = Random::new(case.seed ^ 0x6177_6169_7473_6C6F);
    let some = r.percent(40);
    for worker in &mut case.workers {
        let fits = matches!(worker.work, Work::Periodic { .. } | Work::Sleepy { .. });
        worker.awaits = r.percent(50) && some && fits && worker.group.is_none();
    }
}

/// The later features. Their numbers are a sequence of their own, so that a seed without them is
/// the case that it was.
fn disturb(case: &mut Case, length: Nanos, features: &[Feature]) {
    let mut r = Random::new(case.seed ^ 0x6469_7374_7572_6273);
    let mut has = |feature: Feature, chance: u64| {
        let drawn = r.percent(chance);
        drawn && features.contains(&feature)
    };
    let drops = has(Feature::Privileges, 20);
    case.unpinned = has(Feature::Unpinned, 20);
    // The planner pins whom it gives a guarantee.
    let guarantees = has(Feature::Guarantees, 25) && !case.unpinned;
    let endless = has(Feature::Endless, 50);
    let at = r.within(length / 5, length * 4 / 5);
    case.drops_at = drops.then_some(at);
    for worker in &mut case.workers {
        worker.guaranteed = r.percent(40) && guarantees;
        let sleep = worker.period / r.within(1, 8);
        let burn = worker.budget / r.within(1, 4);
        let work = r.one_of(
            &[Work::Endless, Work::Sleepy { burn, sleep }],
            Work::Endless,
        );
        if r.percent(25) && endless && worker.group.is_some() {
            worker.work = work;
        }
    }
}

fn some_strangers(r: &mut Random, left: &mut f64) -> Vec<Stranger> {
    let stranger = |r: &mut Random| {
        let burn = r.within(20, 3000) * US;
        Stranger {
            priority: u8::try_from(r.within(1, 98)).unwrap_or(1),
            burn,
            sleep: burn * r.within(25, 200),
        }
    };
    let all: Vec<Stranger> = (0..r.within(1, 3)).map(|_| stranger(r)).collect();
    *left -= all.iter().map(|s| ratio(s.burn, s.sleep)).sum::<f64>();
    all
}

/// A worker for about so large a share of the CPU, or none if the share is too small for any.
fn worker(
    r: &mut Random,
    share: f64,
    (groups, blocking, panics): (bool, bool, bool),
) -> Option<Worker> {
    let fits = |(budget, period): &(Nanos, Nanos)| ratio(budget + COST, *period) <= share;
    let odd: Vec<_> = ODD.into_iter().filter(fits).collect();
    let (budget, period) = if !odd.is_empty() && r.percent(50) {
        r.one_of(&odd, (70 * MS, 230 * MS))
    } else {
        // Any period, evenly over its logarithm, and the budget that the share allows.
        let period = scaled(500 * US, 460_f64.powf(r.fraction()));
        (scaled(period, share).saturating_sub(COST), period)
    };
    if budget < 50 * US {
        return None;
    }
    let work = work(r, budget, period, blocking);
    let group = (groups && r.percent(60)).then(|| u8::try_from(r.within(0, 1)).unwrap_or(0));
    let work = match (group, work) {
        // An endless callback would keep the others of its group out for good.
        (Some(_), Work::Endless | Work::Sleepy { .. }) => Work::Periodic {
            every: period,
            burn: (budget / 2).min(2 * MS),
        },
        (Some(_), Work::BackToBack { burn }) => Work::BackToBack {
            burn: burn.min(2 * MS),
        },
        (Some(_), Work::Periodic { every, burn }) => Work::Periodic {
            every,
            burn: burn.min(2 * MS),
        },
        (_, work) => work,
    };
    Some(Worker {
        priority: u8::try_from(r.within(10, 95)).unwrap_or(10),
        background: r
            .percent(50)
            .then(|| u8::try_from(r.within(1, 5)).unwrap_or(1)),
        budget,
        period,
        max_repl: u16::try_from(r.one_of(&[2, 4, 3, 8, 16, 64, 100], 16)).unwrap_or(16),
        work,
        group,
        panics: panics && r.percent(30),
        guaranteed: false,
        awaits: false,
    })
}

#[expect(clippy::cast_sign_loss, reason = "neither factor is negative")]
fn scaled(amount: Nanos, by: f64) -> Nanos {
    (amount as f64 * by) as Nanos
}

fn work(r: &mut Random, budget: Nanos, period: Nanos, blocking: bool) -> Work {
    let burn = scaled(budget, 0.05 + 2.0 * r.fraction());
    match r.within(0, 9) {
        0..=3 => Work::Endless,
        4 => Work::BackToBack { burn },
        5 | 6 => Work::Periodic {
            every: scaled(period, 0.2 + r.fraction()) + 200 * US,
            burn,
        },
        7 => Work::Messages {
            every: scaled(period, 0.2 + r.fraction()) + 500 * US,
            burn,
        },
        _ if blocking => Work::Sleepy {
            burn,
            sleep: scaled(period, r.fraction()) + 50 * US,
        },
        _ => Work::Endless,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ValueEnum as _;

    /// Everything but the later features.
    const OLDER: [Feature; 7] = [
        Feature::Groups,
        Feature::Blocking,
        Feature::Strangers,
        Feature::Stops,
        Feature::Handles,
        Feature::Panics,
        Feature::NoRecords,
    ];

    /// A failure of an earlier session can be looked for by its seed.
    #[test]
    fn the_later_features_leave_the_rest_of_a_case_alone() {
        let mut found = [0; 5];
        for seed in 0..400 {
            let (old, new) = (
                case(seed, 20, &OLDER),
                case(seed, 20, Feature::value_variants()),
            );
            let mut without = new.clone();
            (without.drops_at, without.unpinned) = (None, false);
            for (worker, before) in without.workers.iter_mut().zip(&old.workers) {
                found[0] += usize::from(worker.guaranteed);
                found[1] += usize::from(worker.section().is_none());
                found[4] += usize::from(worker.awaits);
                (worker.guaranteed, worker.awaits, worker.work) = (false, false, before.work);
            }
            found[2] += usize::from(new.drops_at.is_some());
            found[3] += usize::from(new.unpinned);
            assert_eq!(without, old);
        }
        assert!(found.iter().all(|n| *n > 10), "{found:?}");
    }

    #[test]
    fn sets_fit_whatever_the_seed() {
        let mut sizes = [0_usize; 41];
        for seed in 0..2000 {
            let case = case(seed, 20, Feature::value_variants());
            let promised = case
                .workers
                .iter()
                .map(|w| ratio(w.budget + COST, w.period));
            let strangers = case.strangers.iter().map(|s| ratio(s.burn, s.sleep));
            let sum: f64 = promised.chain(strangers).sum();
            assert!(sum < 0.9, "{sum} {case}");
            assert!((1..=40).contains(&case.workers.len()), "{case}");
            sizes[case.workers.len()] += 1;
            for w in &case.workers {
                assert!(w.budget >= 50 * US && w.period <= 230 * MS + MS, "{w:?}");
                assert!(w.budget < w.period && (2..=100).contains(&w.max_repl));
                assert!(w.background.is_none_or(|b| b < w.priority));
                assert!(w.section().is_none_or(|section| section <= 230 * MS));
                assert!(case.inherits(w).is_none_or(|all| all <= 460 * MS));
            }
        }
        assert!(
            sizes[1] > 0 && sizes[20..].iter().sum::<usize>() > 0,
            "{sizes:?}"
        );
    }

    #[test]
    fn a_feature_that_is_left_out_is_not_there() {
        for seed in 0..200 {
            let plain = case(seed, 20, &[]);
            assert!(plain.records && plain.strangers.is_empty() && plain.stops.is_empty());
            assert!(plain.workers.iter().all(|w| w.group.is_none() && !w.panics));
            assert_eq!(plain, case(seed, 20, &[]), "a seed replays");
            assert!(plain.drops_at.is_none() && !plain.unpinned);
            let endless = |w: &Worker| w.guaranteed || w.awaits || w.section().is_none();
            assert!(!case(seed, 20, &OLDER).workers.iter().any(endless));
        }
    }
}
