//! A thousand workers, admitted and refused: the time is printed by `-- --nocapture`
//! (`cargo test --release -p replenish-plan --test it thousand -- --nocapture`).

use replenish_plan::{ExecutorRequest, Guarantee, Machine, Refusal, Request, Worker, plan};
use std::time::{Duration, Instant};

/// The form of the guarantee that the workers ask for.
#[derive(Debug, Clone, Copy)]
enum Kind {
    /// An amount per period.
    Budget,
    /// More, if there is some left.
    Elastic,
    /// A rate and the time of a callback.
    Rate,
}

/// Workers that leave the last third of each CPU free.
fn thousand(cpus: usize, kind: Kind) -> Request {
    let mut request = Request::new(Machine::with_cpus(cpus));
    request.executor = ExecutorRequest::None;
    for i in 0..1000u64 {
        let period = Duration::from_millis(2000 + i);
        let amount = period * u32::try_from(cpus).unwrap() / 2500;
        let importance = (i % 256) as u8;
        let guarantee = match kind {
            Kind::Budget => Guarantee::of(amount).every(period),
            Kind::Elastic => Guarantee::of(amount).every(period).up_to(amount * 3),
            Kind::Rate => Guarantee::at(1.0 / period.as_secs_f64()).taking(amount),
        };
        let guarantee = guarantee.importance(importance);
        request = request.worker(Worker::guaranteed(format!("w{i}"), guarantee));
    }
    request
}

fn timed<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    let took = start.elapsed();
    println!("{what}: {} ms", took.as_millis());
    // Not a measurement: the limit is a second, and a quadratic step too many takes
    // minutes.
    assert!(took.as_secs() < 20, "{what}: {took:?}");
    result
}

fn refused(what: &str, request: &Request, because: &str) -> Refusal {
    let Err(refusal) = timed(what, || plan(request)) else {
        panic!("{what}: admitted");
    };
    println!("    {refusal}");
    assert!(refusal.sentence.contains(because), "{refusal}");
    refusal
}

#[test]
fn a_thousand_workers() {
    for cpus in [1, 8] {
        for kind in [Kind::Budget, Kind::Elastic, Kind::Rate] {
            let what = format!("{kind:?}, {cpus} CPUs");
            let all = thousand(cpus, kind);
            match timed(&what, || plan(&all)) {
                Ok(admitted) => assert!(admitted.workers.iter().all(|w| w.slack().is_some())),
                // A budget of a rate has room for being preempted by each of a thousand.
                Err(refusal) => assert!(matches!(kind, Kind::Rate) && cpus == 1, "{refusal}"),
            }

            // Too much in sum.
            let much = Guarantee::of(Duration::from_millis(96)).every(Duration::from_millis(100));
            let request = all.clone().worker(Worker::guaranteed("much", much));
            refused(&format!("{what}, too much"), &request, "does not fit");

            // Too late: in any order, one of them is late.
            let mut request = all;
            for i in 0..8 {
                let urgent = Guarantee::of(Duration::from_millis(60))
                    .every(Duration::from_millis(2000))
                    .deadline(Duration::from_millis(100 + i));
                request = request.worker(Worker::guaranteed(format!("urgent{i}"), urgent));
            }
            if cpus == 1 {
                refused(&format!("{what}, too late"), &request, "deadline");
            }

            // Unfit from the first on.
            let mut request = thousand(cpus, kind);
            for worker in &mut request.workers {
                *worker = Worker::guaranteed(
                    worker.name.clone(),
                    Guarantee::at(0.5)
                        .taking(Duration::from_millis(2) * u32::try_from(cpus).unwrap())
                        .deadline(Duration::from_millis(500)),
                );
            }
            refused(&format!("{what}, hundreds too many"), &request, "deadline");
        }
    }
}
