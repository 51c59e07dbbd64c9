//! Replays calls on a reservation and prints its state after each, for `proofs/differential.py`.
//!
//! One call a line, as in `judge 30 12 interval 5 10 20`; `new N B T min_chunk slack min_rearm
//! max_backoff` starts afresh.

use sporadic::{
    BlockedInterval, Corrected, Level, Low, Nanos, ParamError, Params, Readings, Reservation,
    Tuning, Verdict,
};
use std::io::{BufWriter, Write, stdin, stdout};

type Replayed = Reservation<Corrected<8>>;

fn start(numbers: &[Nanos]) -> Result<Replayed, ParamError> {
    let at = |i: usize| numbers.get(i).copied().unwrap_or(0);
    let max_repl = u16::try_from(at(0)).unwrap_or(1);
    let params = Params::new(60, Low::Background(6), at(1), at(2), max_repl)?;
    let server = Corrected::new(params, 0)?.with_min_chunk(at(3));
    let tuning = Tuning {
        slack: at(4),
        min_rearm: at(5),
        max_backoff: at(6),
    };
    Ok(Reservation::new(server, tuning, 0, 0))
}

/// The call's answer; `None` for an unknown call.
fn call(
    r: &mut Replayed,
    name: &str,
    numbers: &[Nanos],
    readings: Readings<'_>,
) -> Option<Verdict> {
    let nothing = Verdict { change: None };
    let at = |i: usize| numbers.get(i).copied();
    match name {
        "activate" => r.activate(at(0)?, at(1)?, at(2)?),
        "block" => r.block(at(0)?, at(1)?, readings),
        "judge" => return Some(r.judge(at(0)?, at(1)?, readings)),
        "observe" => r.observe(at(0)?, at(1)?, readings),
        "raised" => {
            let _ = r.applied(Level::High, at(0)?, at(1)?);
        }
        "lowered" => {
            let _ = r.applied(Level::Low, at(0)?, at(1)?);
        }
        "refused" => r.refused(at(0)?),
        "owe" => r.owe(at(0)?, at(1)?),
        "pull_in" => {
            let _ = r.pull_in(at(0)?);
        }
        _ => return None,
    }
    Some(nothing)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut replayed = start(&[1, 1, 1])?;
    let mut out = BufWriter::new(stdout().lock());
    for line in stdin().lines() {
        let line = line?;
        let mut words = line.split_whitespace();
        let name = words.next().unwrap_or_default();
        let (mut numbers, mut intervals, mut unknown) = (Vec::new(), Vec::new(), false);
        while let Some(word) = words.next() {
            let mut next = || words.next().unwrap_or_default().parse::<Nanos>();
            match word {
                "interval" => {
                    let (ran, out_at, in_at) = (next()?, next()?, next()?);
                    intervals.push(BlockedInterval { ran, out_at, in_at });
                }
                "unknown" => unknown = true,
                number => numbers.push(number.parse()?),
            }
        }
        let readings = if unknown {
            Readings::Unknown
        } else {
            Readings::Exact(&intervals)
        };
        let mut verdict = None;
        if name == "new" {
            replayed = start(&numbers)?;
        } else {
            let answer = call(&mut replayed, name, &numbers, readings);
            verdict = answer.ok_or(line)?.change;
        }
        let (r, c) = (&replayed, replayed.counters());
        for chunk in r.server().chunks() {
            write!(out, "{} {} ", chunk.time, chunk.amount)?;
        }
        writeln!(
            out,
            "| {verdict:?} {:?} {} {:?} {} | {} {} {} {}",
            r.level(),
            r.is_runnable(),
            r.check_at(),
            r.is_backed_off(),
            c.cpu_high,
            c.cpu_low,
            c.blocked_inside,
            c.owed
        )?;
    }
    Ok(())
}
