//! Options, seed after seed, and the report.

use super::case::Case;
use super::disturbance::Disturbance;
use super::generator::{self, Feature};
use super::judge::{self, Evidence, Finding};
use super::locked_pages::LockedPages;
use super::result::{Distance, Failed, Totals};
use super::{child, kept, shrink, trial};
use clap::ValueEnum as _;
use replenish_cli::machine::cpus::{self, Cpus};
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::{Failure, Outcome};
use replenish_cli::report::files;
use replenish_cli::report::table::Table;
use replenish_cli::signals::Stop;
use replenish_cli::{lock, machine};
use std::path::{Path, PathBuf};

/// A machine that was so many times as slow around all that is broken as in the whole case may be
/// the cause: the case has one more chance.
const SLOW: f64 = 2.0;
/// A case runs again so often, until the machine does not stand still.
const REPEATS: u64 = 4;
/// Runs that the search for the smallest case may take, and how long each.
const SHRINKING: (usize, u64) = (25, 3);

/// Options of `bench torture`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Seconds that each case runs.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=3600))]
    seconds: u64,

    /// The first seed; a seed replays its case.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,

    /// Number of seeds, one after the other.
    #[arg(long, value_name = "K", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    seeds: u64,

    /// Features that the cases may contain besides budgets; all of them if not given.
    #[arg(long, value_name = "FEATURE,…", value_delimiter = ',')]
    case: Option<Vec<Feature>>,

    /// Only budgets that are used.
    #[arg(long, conflicts_with = "case")]
    plain: bool,

    /// A case that an earlier run has printed, instead of a seed's.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["case", "plain", "seeds", "seed"])]
    replay: Option<PathBuf>,

    /// Do not search for the smallest case of a failure.
    #[arg(long)]
    no_shrink: bool,

    /// The CPU to torture; the last one if not given.
    #[arg(long, value_name = "CPU")]
    cpu: Option<usize>,

    /// Add to what the JSON file says already.
    #[arg(long, requires = "json")]
    append: bool,

    #[command(flatten)]
    json: JsonOption,

    /// Keep the kernel's trace and the other evidence of failures in this directory.
    #[arg(long, value_name = "DIR")]
    keep: Option<PathBuf>,

    /// Judge evidence again that `--keep` has kept: its `.json`. Nothing runs.
    #[arg(long, value_name = "PATH", conflicts_with_all = ["case", "plain", "seeds", "seed", "replay", "keep"])]
    judge: Option<PathBuf>,

    /// Write who had the CPU around the worst finding of the last seed to this file.
    #[arg(long, value_name = "PATH")]
    timeline: Option<PathBuf>,

    /// Of this promise only.
    #[arg(long, value_name = "PROMISE", requires = "timeline")]
    promise: Option<String>,

    /// The executor under test.
    #[arg(long, hide = true)]
    child: bool,
}

/// Runs it.
pub(crate) fn run(args: &Args) -> Outcome {
    if args.child {
        return child::run();
    }
    cpus::check("--cpu", args.cpu)?;
    files::check_writable(args.json.json.as_deref())?;
    if let Some(path) = &args.judge {
        return judge_again(args, path);
    }
    let privilege = machine::privilege();
    if !privilege.real_time() {
        return Err(Failure::refused(format!(
            "bench torture needs real-time priority: {privilege}"
        )));
    }
    let chosen = Cpus::choose();
    let measured = args.cpu.unwrap_or(chosen.measured);
    let support = cpus::allowed().into_iter().find(|c| *c != measured);
    let support = support.ok_or_else(|| Failure::refused("bench torture needs two CPUs"))?;
    let bench = Bench {
        cpus: Cpus { measured, support },
        seconds: args.seconds,
        shrinks: !args.no_shrink,
        stop: Stop::on_signals()?,
        keep: args.keep.clone(),
        around: Around::of(args),
    };
    if let Some(directory) = &args.keep {
        std::fs::create_dir_all(directory).map_err(Failure::refused)?;
    }
    let _pages = LockedPages::stay();
    let mut totals = Totals {
        seconds: args.seconds,
        ..Totals::default()
    };
    if args.append {
        totals.merge(earlier(args.json.json.as_deref())?);
    }
    let cases: Box<dyn Iterator<Item = Case>> = match &args.replay {
        Some(path) => Box::new(std::iter::once(replayed(path)?)),
        None => {
            let all = Feature::value_variants().to_vec();
            let features = args.case.clone().unwrap_or(all);
            let features = if args.plain { Vec::new() } else { features };
            let seeds = args.seed..args.seed.saturating_add(args.seeds);
            let seconds = args.seconds;
            Box::new(seeds.map(move |seed| generator::case(seed, seconds, &features)))
        }
    };
    for case in cases {
        if bench.stop.is_triggered() {
            break;
        }
        {
            // Between two cases others may have their turn.
            let _alone = lock::acquire()?;
            bench.seed(&case, &mut totals)?;
        }
        files::replace_json(args.json.json.as_deref(), "bench-torture", &totals)?;
    }
    report(&totals);
    files::write_json(args.json.json.as_deref(), "bench-torture", &totals)?;
    end(&totals)
}

/// The results of an earlier run; none if there is no such file.
fn earlier(path: Option<&Path>) -> Result<Totals, Failure> {
    let text = path
        .and_then(|p| std::fs::read_to_string(p).ok())
        .unwrap_or_default();
    if text.trim().is_empty() {
        Ok(Totals::default())
    } else {
        serde_json::from_str(&text).map_err(Failure::refused)
    }
}

/// A case from a file.
fn replayed(path: &Path) -> Result<Case, Failure> {
    let failed = |e: &dyn std::fmt::Display| Failure::refused(format!("{}: {e}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|e| failed(&e))?;
    serde_json::from_str(&text).map_err(|e| failed(&e))
}

/// The options that all seeds share.
struct Bench {
    cpus: Cpus,
    seconds: u64,
    shrinks: bool,
    /// Somebody wants the end.
    stop: Stop,
    keep: Option<PathBuf>,
    around: Around,
}

/// The surroundings of interest, and the file that they go into.
#[derive(Default)]
struct Around {
    timeline: Option<PathBuf>,
    promise: Option<String>,
}

/// The findings of a case that ran on a machine that did its part.
struct Judged {
    findings: Vec<Finding>,
    faults: Vec<String>,
    fallbacks: Vec<String>,
    /// The machine did not do its part, and the case counts all the same.
    disturbed: bool,
}

impl Judged {
    fn fails(&self) -> bool {
        !self.faults.is_empty() || self.broken().next().is_some()
    }

    fn broken(&self) -> impl Iterator<Item = &Finding> {
        self.findings.iter().filter(|f| f.beyond() > 0)
    }

    /// A sentence for each broken promise.
    fn said(&self, case: &Case) -> impl Iterator<Item = String> {
        self.broken().map(|f| {
            let d = Distance::of(case, f);
            format!(
                "{} of {}: {:.1} us, allowed {:.1} us, at {:.3} s",
                d.promise,
                d.worker,
                d.measured_us,
                d.bound_us,
                f.at as f64 / 1e9
            )
        })
    }

    /// How slow the machine was around all that is broken, if it was too slow around each.
    fn slowness(&self, case: &Case, evidence: &Evidence) -> Option<f64> {
        let slowness = |f: &Finding| {
            let period = case.workers.get(f.worker).map_or(0, |w| w.period);
            judge::slowness(evidence, f, period).unwrap_or(0.0)
        };
        let least = self.broken().map(slowness).min_by(f64::total_cmp);
        least.filter(|slow| self.faults.is_empty() && *slow >= SLOW)
    }
}

impl Bench {
    /// Runs a case, again while the machine stands still; `None` if it always does.
    fn judged(
        &self,
        case: &Case,
        seconds: u64,
        repeated: &mut u64,
    ) -> Result<Option<Judged>, Failure> {
        let mut excused = false;
        for _ in 0..REPEATS {
            let trace = self.keep.as_deref().map(kept::trace);
            let shown = trial::run(case, seconds, self.cpus, trace.as_deref(), &self.stop)?;
            let machine = Disturbance::of(&shown, seconds);
            if machine.voids(!shown.faults.is_empty()) {
                eprintln!("  repeated: {machine}");
                *repeated += 1;
                continue;
            }
            let case = &shown.case;
            let findings = if shown.faults.is_empty() {
                judge::judge(case, &shown.evidence)
            } else {
                Vec::new()
            };
            self.around.write(case, &shown.evidence, &findings)?;
            let judged = Judged {
                findings,
                faults: shown.faults,
                fallbacks: shown.fallbacks,
                disturbed: machine.excuses(),
            };
            if let (Some(directory), Some(trace)) = (&self.keep, trace) {
                if judged.fails() {
                    let path = kept::keep(directory, case, self.cpus.measured, &shown.evidence)?;
                    eprintln!("  kept: {}", path.display());
                } else {
                    std::fs::remove_file(trace).ok();
                }
            }
            if machine.excuses() && judged.fails() && judged.faults.is_empty() {
                let broken: Vec<String> = judged.said(case).collect();
                eprintln!("  repeated: {}; {machine}", broken.join("; "));
                *repeated += 1;
                continue;
            }
            // Rounds may take long for a reason of our own: what breaks twice is broken.
            if let Some(slow) = judged.slowness(case, &shown.evidence).filter(|_| !excused) {
                eprintln!("  repeated, once: broken while the machine was {slow:.1} times as slow");
                excused = true;
                *repeated += 1;
                continue;
            }
            return Ok(Some(judged));
        }
        Ok(None)
    }

    fn seed(&self, case: &Case, totals: &mut Totals) -> Outcome {
        eprintln!("seed {}: {case}", case.seed);
        let judged = match self.judged(case, self.seconds, &mut totals.repeated) {
            Err(_) if self.stop.is_triggered() => return Ok(()), // it did not run to its end
            judged => judged?,
        };
        totals.seeds += 1;
        totals.ran.push(case.seed);
        let Some(judged) = judged else {
            totals.unjudged.push(case.seed);
            return Ok(());
        };
        totals
            .disturbed
            .extend(judged.disturbed.then_some(case.seed));
        totals.add(judged.findings.iter().map(|f| Distance::of(case, f)));
        let told = judged.fallbacks.iter().map(|f| (case.seed, f.clone()));
        totals.fallbacks.extend(told);
        if !judged.fails() {
            return Ok(());
        }
        let faults = judged.faults.iter().cloned();
        let said: Vec<String> = judged.said(case).chain(faults).collect();
        totals.violations += said.len() as u64;
        for text in &said {
            eprintln!("  BROKEN: {text}");
        }
        let smallest = self.shrinks.then(|| self.smallest(case));
        if let Some(smallest) = &smallest
            && let Ok(text) = serde_json::to_string(smallest)
        {
            eprintln!("  smallest case, for --replay: {text}");
        }
        totals.failures.push(Failed {
            seed: case.seed,
            text: said.join("; "),
            smallest,
        });
        Ok(())
    }

    fn smallest(&self, case: &Case) -> Case {
        let alike = Self {
            keep: None, // the failure's own evidence stays
            around: Around::default(),
            stop: self.stop.clone(),
            ..*self
        };
        let (runs, seconds) = SHRINKING;
        shrink::shrink(case.clone(), runs, |less| {
            let judged = alike.judged(less, seconds.min(self.seconds), &mut 0);
            judged.is_ok_and(|j| j.is_some_and(|j| j.fails()))
        })
    }
}

impl Around {
    fn of(args: &Args) -> Self {
        Self {
            timeline: args.timeline.clone(),
            promise: args.promise.clone(),
        }
    }

    /// Writes who had the CPU around the worst finding of interest.
    fn write(&self, case: &Case, evidence: &Evidence, findings: &[Finding]) -> Outcome {
        let wanted = |f: &&Finding| self.promise.as_deref().is_none_or(|p| p == f.promise);
        let worst = findings.iter().filter(wanted).max_by_key(|f| f.beyond());
        let (Some(path), Some(worst)) = (&self.timeline, worst) else {
            return Ok(());
        };
        let period = case.workers.get(worst.worker).map_or(0, |w| w.period);
        let around = judge::around(evidence, worst, period, 2 * period);
        files::write(path, &format!("{worst:?}\n{around}"))
    }
}

/// Judges evidence that was kept.
fn judge_again(args: &Args, path: &Path) -> Outcome {
    let (case, evidence) = kept::read(path)?;
    println!("seed {}: {case}", case.seed);
    let findings = judge::judge(&case, &evidence);
    Around::of(args).write(&case, &evidence, &findings)?;
    let mut totals = Totals {
        seeds: 1,
        ..Totals::default()
    };
    totals.violations = findings.iter().filter(|f| f.beyond() > 0).count() as u64;
    totals.add(findings.iter().map(|f| Distance::of(&case, f)));
    report(&totals);
    files::write_json(args.json.json.as_deref(), "bench-torture", &totals)?;
    end(&totals)
}

fn end(totals: &Totals) -> Outcome {
    match totals.violations {
        0 => Ok(()),
        n => Err(Failure::refused(format!("{n} promises broken"))),
    }
}

fn report(totals: &Totals) {
    let mut table = Table::new(&[
        "seed",
        "promise",
        "bound us",
        "measured us",
        "beyond us",
        "worker",
    ]);
    for d in &totals.worst {
        table.row([
            d.seed.to_string(),
            d.promise.clone(),
            format!("{:.1}", d.bound_us),
            format!("{:.1}", d.measured_us),
            format!("{:.1}", d.measured_us - d.bound_us),
            d.worker.clone(),
        ]);
    }
    println!("{}", table.to_text());
    println!(
        "  {} seeds of {} s, {} violations, {} repeated, {} on a machine that stood still, {} not \
         judged",
        totals.seeds,
        totals.seconds,
        totals.violations,
        totals.repeated,
        totals.disturbed.len(),
        totals.unjudged.len()
    );
}
