//! The drawing of a schedule: a lane per thread, grouped by CPU, budgets above the bars.
//!
//! ```text
//!   CPU 0
//!   name            ╲    ╱╲   what the budget has left
//!   30 ms / 100 ms  ▇▇▇  ░░▇  dark: within the budget, light: background
//!                   ▴    ▴    releases                      ──► ms
//! ```

use super::lanes::{Bar, Lane};
use crate::commands::plan::short;
use crate::report::html::escape;
use replenish_plan::Nanos;
use std::fmt::Write;
use std::ops::Range;

const WIDTH: f64 = 1100.0;
/// The horizontal position of time 0.
const LEFT: f64 = 220.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 40.0;
/// The height of a CPU's name.
const HEADING: f64 = 26.0;
const LANE: f64 = 58.0;
/// The height of a lane without a budget line.
const PLAIN_LANE: f64 = 38.0;
const CURVE: f64 = 22.0;
const BAR: f64 = 16.0;
const FOOT: f64 = 44.0;
/// The width of the narrowest bar.
const NARROWEST: f64 = 1.0;
/// More lanes than that are not drawn.
const MOST_LANES: usize = 60;
/// The most shapes per lane: more cannot be distinguished.
const MOST_SHAPES: usize = 4_000;

/// Draws this part of the lanes; `cpus` are the numbers of the system's CPUs.
pub(in crate::commands) fn draw(lanes: &[Lane], cpus: &[usize], shown: Range<Nanos>) -> String {
    let scale = Scale {
        from: shown.start,
        shown: shown.end.saturating_sub(shown.start).max(1),
    };
    let mut body = String::new();
    let mut y = TOP;
    let left_out = lanes.len().saturating_sub(MOST_LANES);
    let lanes = lanes.get(..MOST_LANES).unwrap_or(lanes);
    let groups = (0..cpus.len()).map(Some).chain(std::iter::once(None));
    for group in groups {
        let members: Vec<&Lane> = lanes.iter().filter(|l| l.cpu == group).collect();
        if members.is_empty() {
            continue;
        }
        let name = match group.and_then(|at| cpus.get(at)) {
            Some(cpu) => format!("CPU {cpu}"),
            None => "any CPU".to_string(),
        };
        text(&mut body, 12.0, y + 18.0, "cpu", &name);
        y += HEADING;
        for lane in members {
            y = draw_lane(&mut body, lane, &scale, y);
        }
    }
    if left_out > 0 {
        let remark = format!("and {left_out} more that are not drawn");
        text(&mut body, 12.0, y + 18.0, "sub", &remark);
        y += HEADING;
    }
    axis(&mut body, &scale, y);
    let height = y + FOOT;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" \
         height=\"{height}\" font-family=\"sans-serif\">\n<style>{STYLE}</style>\n\
         <rect class=\"paper\" width=\"100%\" height=\"100%\"/>\n{}{body}</svg>\n",
        legend()
    )
}

// Edges are crisp: a bar narrower than a pixel must not pale into the colour of the background.
const STYLE: &str = "\
.paper{fill:#fff}.cpu{font-size:16px;font-weight:bold;fill:#1c2733}.name{font-size:14px;fill:#1c2733}\
.sub{font-size:11px;fill:#52606d}.axis{font-size:12px;fill:#52606d}\
.run,.back,.plain,.late{shape-rendering:crispEdges}\
.run{fill:#2563a8}.back{fill:#a9c6e6}.plain{fill:#d97a1e}.curve{fill:#e8f3ec;stroke:#2f855a;stroke-width:1.2}\
.grid{stroke:#e4e7eb}.line{stroke:#9aa5b1}.release{fill:#52606d}.late{fill:#c53030}\
@media(prefers-color-scheme:dark){.paper{fill:#14191f}.cpu,.name{fill:#e6e9ed}.sub,.axis,.release{fill:#a9b4bf}\
.run{fill:#5b9be0}.back{fill:#3b5878}.curve{fill:#1c3328}.grid{stroke:#2a333d}.line{stroke:#5b6876}.late{fill:#f56565}}";

struct Scale {
    from: Nanos,
    shown: Nanos,
}

impl Scale {
    fn x(&self, time: Nanos) -> f64 {
        let since = time.saturating_sub(self.from).min(self.shown);
        let part = since as f64 / self.shown as f64;
        LEFT + part * (WIDTH - LEFT - RIGHT)
    }

    fn to(&self) -> Nanos {
        self.from.saturating_add(self.shown)
    }

    fn has(&self, time: Nanos) -> bool {
        (self.from..=self.to()).contains(&time)
    }
}

fn draw_lane(body: &mut String, lane: &Lane, scale: &Scale, y: f64) -> f64 {
    let budgeted = lane.full > 0;
    let bar_top = y + if budgeted { CURVE + 8.0 } else { 8.0 };
    text(body, 24.0, bar_top + 2.0, "name", &lane.name);
    text(body, 24.0, bar_top + 16.0, "sub", &lane.policy);
    let base = bar_top + BAR;
    shape(
        body,
        format_args!(
            "<line class=\"line\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{base:.1}\" y2=\"{base:.1}\"/>",
            WIDTH - RIGHT
        ),
    );
    if budgeted {
        curve(body, lane, scale, y + 4.0);
    }
    let bars = lane.bars.iter();
    let bars = bars.filter(|b| b.to > scale.from && b.from < scale.to());
    let mut bars: Vec<_> = bars.take(MOST_SHAPES).collect();
    bars.sort_by_key(|bar| !bar.background); // a narrow bar within the budget is not covered
    for bar in bars {
        let class = match (budgeted, bar.background) {
            (_, true) => "back",
            (true, false) => "run",
            (false, false) => "plain",
        };
        let (from, to) = (scale.x(bar.from), scale.x(bar.to));
        let width = (to - from).max(NARROWEST);
        let title = title(lane, bar);
        shape(
            body,
            format_args!(
                "<rect class=\"{class}\" x=\"{from:.2}\" y=\"{bar_top:.1}\" width=\"{width:.2}\" height=\"{BAR}\"><title>{title}</title></rect>"
            ),
        );
    }
    let releases = lane.releases.iter().filter(|r| scale.has(**r));
    for release in releases.take(MOST_SHAPES) {
        let x = scale.x(*release);
        let (left, right, foot) = (x - 2.5, x + 2.5, base + 5.0);
        shape(
            body,
            format_args!(
                "<path class=\"release\" d=\"M{x:.2} {base:.1}L{right:.2} {foot:.1}L{left:.2} {foot:.1}Z\"/>"
            ),
        );
    }
    for late in lane
        .late
        .iter()
        .filter(|l| scale.has(**l))
        .take(MOST_SHAPES)
    {
        let x = scale.x(*late) - 1.5;
        let (top, height) = (bar_top - 3.0, BAR + 6.0);
        let title = format!("{}: ends late, at {}", escape(&lane.name), short(*late));
        shape(
            body,
            format_args!(
                "<rect class=\"late\" x=\"{x:.2}\" y=\"{top:.1}\" width=\"3\" height=\"{height}\"><title>{title}</title></rect>"
            ),
        );
    }
    y + if budgeted { LANE } else { PLAIN_LANE }
}

/// The text under the pointer.
fn title(lane: &Lane, bar: &Bar) -> String {
    let how = match (lane.full > 0, bar.background) {
        (_, true) => ", in the background",
        (true, false) => ", within its budget",
        (false, false) => "",
    };
    let took = short(bar.to.saturating_sub(bar.from));
    let name = escape(&lane.name);
    format!("{name}: runs {took} from {} on{how}", short(bar.from))
}

/// CPU time left in the budget, as an area.
fn curve(body: &mut String, lane: &Lane, scale: &Scale, top: f64) {
    let foot = top + CURVE;
    let height = |left: Nanos| foot - CURVE * left as f64 / lane.full as f64;
    let corners = visible(&lane.budget, scale);
    // Nothing is known before the first reading.
    let mut end = corners.first().map_or(LEFT, |(time, _)| scale.x(*time));
    let mut path = format!("M{end:.2} {foot:.1}");
    for (time, left) in corners.into_iter().take(MOST_SHAPES) {
        end = scale.x(time);
        append(&mut path, format_args!("L{end:.2} {:.2}", height(left)));
    }
    append(&mut path, format_args!("L{end:.2} {foot:.1}Z"));
    shape(body, format_args!("<path class=\"curve\" d=\"{path}\"/>"));
}

/// The corners that can be seen, cut at both ends.
fn visible(line: &[(Nanos, Nanos)], scale: &Scale) -> Vec<(Nanos, Nanos)> {
    let at = |time: Nanos| {
        let after = line.partition_point(|(t, _)| *t <= time);
        let (&(t0, v0), next) = (line.get(after.checked_sub(1)?)?, line.get(after));
        let Some(&(t1, v1)) = next else {
            return Some((time, v0));
        };
        let part = (time - t0) as f64 / (t1 - t0).max(1) as f64;
        let left = v0 as f64 + (v1 as f64 - v0 as f64) * part;
        #[expect(clippy::cast_sign_loss, reason = "between two amounts")]
        Some((time, left as Nanos))
    };
    let inside = line.iter().copied();
    let inside = inside.filter(|(t, _)| *t > scale.from && *t <= scale.to());
    let ends = [at(scale.from), at(scale.to())];
    let [first, last] = ends;
    first.into_iter().chain(inside).chain(last).collect()
}

fn axis(body: &mut String, scale: &Scale, y: f64) {
    let step = step(scale.shown);
    let mut grid = String::new();
    let mut time = scale.from.div_ceil(step) * step;
    while time <= scale.to() {
        let x = scale.x(time);
        shape(
            &mut grid,
            format_args!(
                "<line class=\"grid\" x1=\"{x:.2}\" x2=\"{x:.2}\" y1=\"{TOP}\" y2=\"{y:.1}\"/>"
            ),
        );
        let label = format!("{}", time as f64 / 1e6);
        shape(
            body,
            format_args!(
                "<text class=\"axis\" text-anchor=\"middle\" x=\"{x:.2}\" y=\"{:.1}\">{label}</text>",
                y + 18.0
            ),
        );
        time += step;
    }
    let middle = (LEFT + WIDTH - RIGHT) / 2.0;
    shape(
        body,
        format_args!(
            "<text class=\"axis\" text-anchor=\"middle\" x=\"{middle:.1}\" y=\"{:.1}\">time, ms</text>",
            y + 36.0
        ),
    );
    body.insert_str(0, &grid);
}

/// A round distance of marks: 1, 2 or 5 times a power of ten, at most 12 of them.
fn step(shown: Nanos) -> Nanos {
    let mut unit: Nanos = 1;
    loop {
        for factor in [1, 2, 5] {
            let step = unit.saturating_mul(factor);
            if shown / step <= 12 {
                return step;
            }
        }
        unit = unit.saturating_mul(10);
    }
}

fn legend() -> String {
    let mut legend = String::new();
    let boxes = [
        ("run", "runs within its budget"),
        ("back", "runs in the background"),
        ("plain", "runs, has no budget"),
        ("curve", "what the budget has left"),
        ("late", "ends late"),
    ];
    for (x, (class, name)) in [LEFT, 400.0, 585.0, 755.0, 950.0].into_iter().zip(boxes) {
        shape(
            &mut legend,
            format_args!("<rect class=\"{class}\" x=\"{x}\" y=\"14\" width=\"14\" height=\"12\"/>"),
        );
        text(&mut legend, x + 20.0, 24.0, "axis", name);
    }
    legend
}

fn text(body: &mut String, x: f64, y: f64, class: &str, content: &str) {
    let content = escape(content);
    shape(
        body,
        format_args!("<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{content}</text>"),
    );
}

fn shape(body: &mut String, shape: std::fmt::Arguments<'_>) {
    append(body, shape);
    body.push('\n');
}

fn append(body: &mut String, what: std::fmt::Arguments<'_>) {
    body.write_fmt(what).ok(); // writing to a string does not fail
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawing_names_its_threads_and_escapes_them() {
        let lane = Lane {
            name: "a<b".into(),
            policy: "30 ms / 100 ms, priority 60".into(),
            cpu: Some(0),
            bars: vec![Bar {
                from: 0,
                to: 5,
                background: false,
            }],
            budget: vec![(0, 10), (5, 5), (10, 5)],
            full: 10,
            releases: vec![0],
            late: vec![5],
        };
        let later = Lane {
            budget: vec![(5, 5), (10, 5)],
            ..lane.clone()
        };
        let begins = |lane: &Lane| {
            let svg = draw(std::slice::from_ref(lane), &[3], 0..10);
            let (_, path) = svg.split_once("class=\"curve\" d=\"M").unwrap();
            let (x, _) = path.split_once(' ').unwrap();
            x.parse::<f64>().unwrap()
        };
        assert!(begins(&lane) < begins(&later), "where its budget is known");
        let svg = draw(&[lane], &[3], 0..10);
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in [
            "CPU 3",
            "a&lt;b",
            "class=\"curve\"",
            "class=\"late\"",
            "time, ms",
        ] {
            assert!(svg.contains(text), "{text}");
        }
        assert!(!svg.contains("a<b"));
    }

    #[test]
    fn a_narrow_bar_keeps_its_colour() {
        let bar = |from, to, background| Bar {
            from,
            to,
            background,
        };
        let lane = Lane {
            name: "w".into(),
            policy: String::new(),
            cpu: Some(0),
            bars: vec![bar(0, 1, false), bar(1, 900_000, true)],
            budget: Vec::new(),
            full: 10,
            releases: Vec::new(),
            late: Vec::new(),
        };
        let svg = draw(&[lane], &[0], 0..1_000_000);
        let budget = svg.find("<rect class=\"run\" x=\"220.00\"").unwrap();
        let background = svg.find("<rect class=\"back\" x=\"220.00\"").unwrap();
        assert!(
            background < budget,
            "the budget is drawn over the background"
        );
        assert!(svg[budget..].contains("width=\"1.00\""));
        assert!(
            svg[budget..].contains("<title>w: runs 1 ns from 0 ns on, within its budget</title>")
        );
        assert!(STYLE.contains("crispEdges"));
    }

    #[test]
    fn marks_are_round_and_few() {
        for (shown, expected) in [(400_000_000, 50_000_000), (100_000_000, 10_000_000), (7, 1)] {
            assert_eq!(step(shown), expected);
        }
        assert!(step(Nanos::MAX) > 0);
    }
}
