//! Agreement of simulation and measurement.

use crate::testbench::summary::{Summary, Topic, round};

/// The deviation of measured counts from simulated ones, at one point.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Deviation {
    /// The counts of the topic that is worse, over all windows, divided by the windows.
    pub(super) per_window: f64,
    /// The largest difference of one topic in one window.
    pub(super) worst_window: u64,
}

impl Deviation {
    /// `None` where nothing was simulated.
    pub(super) fn of(summary: &Summary) -> Option<Self> {
        let of = |topic: &Topic| Some(topic.answered.abs_diff(topic.simulated?));
        let total = of(&summary.high)?.max(of(&summary.low)?);
        Some(Self {
            per_window: round(total as f64 / summary.windows.max(1) as f64),
            worst_window: summary.simulated_worst_difference?,
        })
    }
}

/// Agreement of simulation and measurement, in one sentence, for all points of an experiment.
pub(super) fn agreement(points: impl Iterator<Item = Option<Deviation>>) -> String {
    let points: Vec<Deviation> = points.flatten().collect();
    if points.is_empty() {
        return "Nothing was simulated.".into();
    }
    let worst = points
        .into_iter()
        .fold(Deviation::default(), |a, b| Deviation {
            per_window: a.per_window.max(b.per_window),
            worst_window: a.worst_window.max(b.worst_window),
        });
    let verdict = if worst.per_window <= 1.0 {
        "agree within 1 answer"
    } else {
        "DIFFER by more than 1 answer"
    };
    format!(
        "Simulated and measured counts {verdict} per window: at worst {:.1} per window at one \
         point, {} in one window.",
        worst.per_window, worst.worst_window
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreement_is_judged_by_point_and_tells_the_worst_window() {
        let summary = |answered, simulated, worst| Summary {
            high: Topic {
                answered,
                simulated,
                ..Topic::default()
            },
            low: Topic {
                simulated: Some(0),
                ..Topic::default()
            },
            windows: 10,
            simulated_worst_difference: worst,
            ..Summary::default()
        };
        let near = Deviation::of(&summary(300, Some(310), Some(3)));
        let far = Deviation::of(&summary(300, Some(289), Some(2)));
        let none = Deviation::of(&summary(300, None, None));
        assert_eq!(none, None);
        let text = agreement([near, none].into_iter());
        assert!(
            text.contains("agree") && text.contains("1.0 per window"),
            "{text}"
        );
        assert!(text.contains("3 in one window"), "{text}");
        let text = agreement([near, far].into_iter());
        assert!(
            text.contains("DIFFER") && text.contains("1.1 per"),
            "{text}"
        );
    }
}
