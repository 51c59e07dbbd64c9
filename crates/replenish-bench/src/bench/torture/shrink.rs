//! The smallest case that still fails.

use super::case::Case;

/// Smaller cases, the smallest first: each leaves something out.
fn smaller(case: &Case) -> Vec<Case> {
    let mut all = Vec::new();
    let count = case.workers.len();
    let mut parts = count / 2;
    while parts > 0 {
        for from in (0..count).step_by(parts) {
            let mut less = case.clone();
            less.workers.drain(from..(from + parts).min(count));
            all.push(less);
        }
        parts /= 2;
    }
    let mut without = |change: &dyn Fn(&mut Case)| {
        let mut less = case.clone();
        change(&mut less);
        if less != *case {
            all.push(less);
        }
    };
    without(&|c| c.strangers.clear());
    without(&|c| c.stops.clear());
    without(&|c| c.stops.truncate(1));
    without(&|c| c.churn_every = 0);
    without(&|c| c.records = true);
    without(&|c| c.drops_at = None);
    without(&|c| c.unpinned = false);
    without(&|c| c.workers.iter_mut().for_each(|w| w.panics = false));
    without(&|c| c.workers.iter_mut().for_each(|w| w.guaranteed = false));
    without(&|c| c.workers.iter_mut().for_each(|w| w.awaits = false));
    without(&|c| c.workers.iter_mut().for_each(|w| w.group = None));
    all.retain(|c| !c.workers.is_empty());
    all
}

/// Leaves out what a failure does not need; `fails` runs a case. At most so many runs.
pub(super) fn shrink(case: Case, mut runs: usize, mut fails: impl FnMut(&Case) -> bool) -> Case {
    let mut smallest = case;
    'smaller: loop {
        for less in smaller(&smallest) {
            if runs == 0 {
                return smallest;
            }
            runs -= 1;
            if fails(&less) {
                smallest = less;
                continue 'smaller;
            }
        }
        return smallest;
    }
}

#[cfg(test)]
mod tests {
    use super::super::generator::{Feature, case};
    use super::*;
    use clap::ValueEnum as _;

    #[test]
    fn the_worker_that_fails_is_left_alone() {
        let all = (0..).map(|seed| case(seed, 20, Feature::value_variants()));
        let large = all.into_iter().find(|c| c.workers.len() > 20).unwrap();
        let culprit = large.workers[13].clone();
        let smallest = shrink(large, 1000, |c| c.workers.contains(&culprit));
        assert_eq!(smallest.workers.len(), 1);
        assert!(smallest.strangers.is_empty() && smallest.churn_every == 0);
    }

    #[test]
    fn it_ends_when_the_runs_do() {
        let mut ran = 0;
        let large = case(3, 20, Feature::value_variants());
        shrink(large, 5, |_| {
            ran += 1;
            false
        });
        assert!(ran <= 5);
    }
}
