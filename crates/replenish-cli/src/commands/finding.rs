//! [`Finding`]: one line of `replenish doctor`.

/// Meaning of a fact for real-time threads and for ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Verdict {
    /// As it should be.
    Good,
    /// It works, with a limit.
    Limited,
    /// It does not work.
    Missing,
}

/// One fact about the machine.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Finding {
    pub(super) topic: &'static str,
    pub(super) verdict: Verdict,
    pub(super) value: String,
    pub(super) advice: Option<String>,
}

impl Finding {
    pub(super) fn good(topic: &'static str, value: impl Into<String>) -> Self {
        Self {
            topic,
            verdict: Verdict::Good,
            value: value.into(),
            advice: None,
        }
    }

    pub(super) fn limited(
        topic: &'static str,
        value: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        let advice = Some(advice.into());
        Self {
            topic,
            verdict: Verdict::Limited,
            value: value.into(),
            advice,
        }
    }

    pub(super) fn missing(
        topic: &'static str,
        value: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self {
            verdict: Verdict::Missing,
            ..Self::limited(topic, value, advice)
        }
    }
}
