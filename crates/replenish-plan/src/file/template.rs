//! Writing a deployment file that people can go on with.

use crate::span::Exact;
use crate::{Guarantee, Machine};
use replenish_sim::{Releases, Span};
use sporadic::{Low, Policy};
use std::fmt;

/// A file to be written; it prints as TOML that [`Deployment::parse`](super::Deployment::parse)
/// reads.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    /// Lines at the top, without `#`.
    pub header: Vec<String>,
    /// The machine section; `None`: left out, so that the program's own facts hold.
    pub machine: Option<Machine>,
    /// The workers.
    pub workers: Vec<TemplateWorker>,
}

/// One worker to be written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TemplateWorker {
    /// Lines above it, without `#`.
    pub comments: Vec<String>,
    /// Its name.
    pub name: String,
    /// Its handles' ids.
    pub handles: Vec<String>,
    /// Its CPU.
    pub cpu: Option<usize>,
    /// The guarantee that it needs.
    pub guarantee: Option<Guarantee>,
    /// Its policy, if it has no guarantee.
    pub policy: Option<Policy>,
    /// CPU time per callback.
    pub runs: Option<Span>,
    /// Its releases.
    pub releases: Option<Releases>,
}

impl fmt::Display for Template {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &self.header {
            writeln!(f, "# {line}")?;
        }
        if let Some(machine) = &self.machine {
            let (low, high) = (machine.priorities.start(), machine.priorities.end());
            writeln!(f, "\n[machine]")?;
            writeln!(f, "cpus = {:?}", machine.cpus)?;
            writeln!(f, "priorities = [{low}, {high}] # for guaranteed workers")?;
            writeln!(
                f,
                "real_time_share = {:?} # of each CPU, for real-time threads",
                machine.real_time_share
            )?;
        }
        for worker in &self.workers {
            writeln!(f)?;
            worker.fmt(f)?;
        }
        Ok(())
    }
}

impl fmt::Display for TemplateWorker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for line in &self.comments {
            writeln!(f, "# {line}")?;
        }
        writeln!(f, "[[worker]]")?;
        writeln!(f, "name = {}", Quoted(&self.name))?;
        if !self.handles.is_empty() {
            let handles: Vec<String> = self.handles.iter().map(|h| Quoted(h).to_string()).collect();
            writeln!(f, "handles = [{}]", handles.join(", "))?;
        }
        if let Some(cpu) = self.cpu {
            writeln!(f, "cpu = {cpu}")?;
        }
        match (&self.guarantee, &self.policy) {
            (Some(guarantee), _) => writeln!(f, "guarantee = {}", guarantee_text(guarantee))?,
            (None, Some(policy)) => writeln!(f, "policy = {}", policy_text(policy))?,
            (None, None) => writeln!(
                f,
                "# guarantee = {{ budget = \"30 ms\", period = \"100 ms\" }} # time-shared without"
            )?,
        }
        if let Some(releases) = &self.releases {
            writeln!(f, "releases = {}", releases_text(releases))?;
        }
        if let Some(runs) = &self.runs {
            writeln!(f, "runs = {}", span_text(runs))?;
        }
        Ok(())
    }
}

fn guarantee_text(g: &Guarantee) -> String {
    let mut text = if g.per_job {
        format!(
            "{{ rate = \"{} Hz\", takes = \"{}\"",
            1e9 / g.period() as f64,
            Exact(g.amount())
        )
    } else {
        format!(
            "{{ budget = \"{}\", period = \"{}\"",
            Exact(g.amount()),
            Exact(g.period())
        )
    };
    for (key, value) in [
        ("deadline", g.deadline),
        ("minimum", g.minimum),
        ("desired", g.desired),
    ] {
        if let Some(value) = value {
            text += &format!(", {key} = \"{}\"", Exact(value));
        }
    }
    if g.importance != Guarantee::IMPORTANCE {
        text += &format!(", importance = {}", g.importance);
    }
    if g.budget().suspend {
        text += ", suspend = true";
    }
    text + " }"
}

fn policy_text(policy: &Policy) -> String {
    match policy {
        Policy::Other => "{ kind = \"time-shared\" }".into(),
        Policy::Fifo { priority } | Policy::RoundRobin { priority } => {
            format!("{{ kind = \"fifo\", priority = {priority} }}")
        }
        Policy::Sporadic(params) | Policy::KernelSporadic(params) => {
            let low = match params.low() {
                Low::Background(low) => format!("background = {low}"),
                Low::Suspend => "suspend = true".into(),
            };
            format!(
                "{{ kind = \"sporadic\", priority = {}, {low}, budget = \"{}\", period = \"{}\", max_repl = {} }}",
                params.priority(),
                Exact(params.budget()),
                Exact(params.period()),
                params.max_repl()
            )
        }
        Policy::Deadline {
            runtime,
            deadline,
            period,
            ..
        } => format!(
            "{{ kind = \"deadline\", runtime = \"{}\", deadline = \"{}\", period = \"{}\" }}",
            Exact(*runtime),
            Exact(*deadline),
            Exact(*period)
        ),
    }
}

fn releases_text(releases: &Releases) -> String {
    match releases {
        Releases::Never => "{ at = [] }".into(),
        Releases::Periodic {
            offset,
            period,
            jitter,
        } => {
            let mut text = format!("{{ every = \"{}\"", Exact(*period));
            for (key, value) in [("offset", *offset), ("jitter", *jitter)] {
                if value > 0 {
                    text += &format!(", {key} = \"{}\"", Exact(value));
                }
            }
            text + " }"
        }
        Releases::Sporadic { offset, gap } => {
            format!(
                "{{ gap = {}, offset = \"{}\" }}",
                span_text(gap),
                Exact(*offset)
            )
        }
        Releases::Bursty {
            offset,
            period,
            burst,
            spacing,
        } => format!(
            "{{ every = \"{}\", burst = {burst}, spacing = \"{}\", offset = \"{}\" }}",
            Exact(*period),
            Exact(*spacing),
            Exact(*offset)
        ),
        Releases::At(times) => format!("{{ at = {} }}", list(times)),
    }
}

fn span_text(span: &Span) -> String {
    match span {
        Span::Constant(value) => format!("\"{}\"", Exact(*value)),
        Span::Uniform { min, max } => {
            format!("{{ min = \"{}\", max = \"{}\" }}", Exact(*min), Exact(*max))
        }
        Span::Rare {
            usual,
            worst,
            one_in,
        } => format!(
            "{{ usual = \"{}\", worst = \"{}\", one_in = {one_in} }}",
            Exact(*usual),
            Exact(*worst)
        ),
        Span::Samples(values) => format!("{{ samples = {} }}", list(values)),
    }
}

fn list(values: &[crate::Nanos]) -> String {
    let texts: Vec<String> = values
        .iter()
        .map(|v| format!("\"{}\"", Exact(*v)))
        .collect();
    format!("[{}]", texts.join(", "))
}

/// A TOML basic string.
struct Quoted<'t>(&'t str);

impl fmt::Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("\"")?;
        for c in self.0.chars() {
            match c {
                '"' | '\\' => write!(f, "\\{c}")?,
                c if c.is_control() => write!(f, "\\u{:04X}", u32::from(c))?,
                c => write!(f, "{c}")?,
            }
        }
        f.write_str("\"")
    }
}
