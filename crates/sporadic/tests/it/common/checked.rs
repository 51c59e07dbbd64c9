//! Each server next to its model, compared after every event.

use super::posix_model::PosixModel;
use super::simulator::Machine;
use super::units::Units;
use super::{check_answers, check_chunks, pairs, params, unit_times};
use sporadic::{BudgetServer, Consumed, Corrected, Level, Nanos, Posix};

/// The server next to the model, and the log of what was consumed.
#[derive(Clone)]
pub struct CheckedCorrected {
    pub server: Corrected<16>,
    pub model: Units,
    pub log: Vec<(Nanos, Nanos)>,
    /// Whether server and model must agree in everything: no limit of the server can act.
    pub unlimited: bool,
    /// The latest time checked.
    pub now: Nanos,
}

impl CheckedCorrected {
    pub fn new(budget: Nanos, period: Nanos, max_repl: u16, min_chunk: Nanos) -> Self {
        let server = Corrected::new(params(budget, period, max_repl), 0).unwrap();
        Self {
            server: server.with_min_chunk(min_chunk),
            model: Units::new(budget, period),
            log: Vec::new(),
            unlimited: Nanos::from(max_repl) >= budget && min_chunk <= 1,
            now: 0,
        }
    }
}

impl Machine for CheckedCorrected {
    fn activate(&mut self, now: Nanos) {
        self.server.activate(now);
        self.model.activate(now);
    }

    fn block(&mut self, now: Nanos) {
        self.server.block(now);
    }

    fn charge(&mut self, used: Nanos, now: Nanos) {
        let period = self.server.params().period();
        let first = self.log.len();
        self.server.charge_with(
            used,
            now,
            &mut |Consumed {
                      activation,
                      amount,
                      rounds,
                  }| {
                self.log
                    .extend((0..rounds).map(|round| (activation + round * period, amount)));
            },
        );
        let model = self.model.charge(used, now);
        let consumed: Nanos = self.log[first..].iter().map(|&(_, amount)| amount).sum();
        assert_eq!(consumed, used, "the observer missed something");
        if self.unlimited {
            let mut logged: Vec<Nanos> = self.log[first..]
                .iter()
                .flat_map(|&(e, n)| std::iter::repeat_n(e, usize::try_from(n).unwrap()))
                .collect();
            logged.sort_unstable();
            assert_eq!(logged, model, "effective activations");
        }
    }

    fn update(&mut self, now: Nanos) -> Level {
        self.server.update(now)
    }

    fn available(&self, now: Nanos) -> Nanos {
        self.server.available(now)
    }

    fn check(&mut self, now: Nanos) {
        self.now = self.now.max(now);
        let before = self.server.available(now);
        let level = self.server.update(now);
        assert_eq!(
            before,
            self.server.available(now),
            "update changed what is available"
        );
        assert_eq!(level, self.server.update(now), "update is not idempotent");
        check_answers(&self.server, level, now);
        check_chunks(&self.server);

        let (server, model) = (unit_times(&self.server), self.model.sorted());
        if self.unlimited {
            assert_eq!(server, model);
            assert_eq!(level, self.model.level(now));
            assert_eq!(before, self.model.available(now));
            assert_eq!(
                self.server.next_replenishment(),
                model.first().copied().filter(|&t| t > now)
            );
        } else {
            // A limit makes budget come later, never earlier.
            assert!(
                server.iter().zip(&model).all(|(s, m)| s >= m),
                "{server:?} before {model:?}"
            );
        }
        let last = server[server.len() - 1];
        assert_eq!(
            self.server.available(last),
            self.server.params().budget(),
            "budget is lost"
        );
    }
}

/// The POSIX server next to the rules.
#[derive(Clone)]
pub struct CheckedPosix {
    pub server: Posix<128>,
    pub model: PosixModel,
    now: Nanos,
}

impl CheckedPosix {
    pub fn new(budget: Nanos, period: Nanos, max_repl: u16) -> Self {
        let server = Posix::new(params(budget, period, max_repl), 0).unwrap();
        Self {
            server,
            model: PosixModel::new(budget, period, max_repl),
            now: 0,
        }
    }
}

impl Machine for CheckedPosix {
    fn activate(&mut self, now: Nanos) {
        self.server.activate(now);
        self.model.activate(now);
    }

    fn block(&mut self, now: Nanos) {
        self.server.block(now);
        self.model.block(now);
    }

    fn charge(&mut self, used: Nanos, now: Nanos) {
        self.server.charge(used, now);
        self.model.charge(used, now);
    }

    fn update(&mut self, now: Nanos) -> Level {
        // The script's clock may be behind; the server remembers the latest time, the model not.
        self.now = self.now.max(now);
        let now = self.now;
        self.model.pass_time(now, false);
        self.server.update(now)
    }

    fn available(&self, now: Nanos) -> Nanos {
        self.server.available(now)
    }

    fn check(&mut self, now: Nanos) {
        let before = self.server.available(now);
        let level = self.update(now);
        assert_eq!(
            before,
            self.server.available(now),
            "available does not foresee update"
        );
        assert_eq!(level, self.server.update(now), "update is not idempotent");
        check_answers(&self.server, level, now);
        assert_eq!(level, self.model.level());
        assert_eq!(self.server.activation_time(), self.model.activation_time);
        let budget = self.server.params().budget();
        let mut pending = self.model.pending.clone();
        pending.sort_by_key(|p| p.0);
        assert_eq!(pairs(self.server.replenishments()), pending);
        assert!(self.server.pending() <= usize::from(self.server.params().max_repl()));
        if level == Level::High {
            assert_eq!(before, self.model.avail);
        }
        // Nothing is lost ever; nothing is gained before the first forgotten overrun.
        let all = self.model.avail
            + self.model.executed.len() as Nanos
            + pending.iter().map(|&(_, amount)| amount).sum::<Nanos>();
        assert!(all >= budget, "budget is lost");
        assert!(all == budget || self.model.overran, "budget from nowhere");
    }
}
