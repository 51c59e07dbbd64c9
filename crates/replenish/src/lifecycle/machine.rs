//! The states of a managed node and how one follows another: the state machine of ROS 2. Pure.
//!
//! ```text
//!                      configure                          activate
//!   UNCONFIGURED ────────────────► INACTIVE ─────────────────────────► ACTIVE
//!        │  ▲ ◄──── cleanup ────────── │ ◄───────── deactivate ──────────│
//!        │  │                          │                                 │
//!        │  │ success                  │ shutdown                        │
//!        │  └── ERRORPROCESSING ◄──────┼── any callback's error ◄────────┤
//!        │           │ failure, error  │                                 │
//!        │           ▼                 ▼                                 │
//!        └─ shutdown ─────────────► FINALIZED ◄──────────── shutdown ────┘
//!
//!   each arrow:   start ── request ──► …ING ── success ──► goal
//!                   ▲                   │ └─── error ────► ERRORPROCESSING
//!                   └───── failure ─────┘                  (shutdown: failure ──► FINALIZED, too)
//! ```
//!
//! Numbers and labels are those of `lifecycle_msgs` and of ROS 2's `rcl_lifecycle`, so that its
//! tools know them.

/// A state: the four a node can be in for long, and the six it passes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum State {
    /// The node has not been set up.
    Unconfigured,
    /// Set up, and not at work.
    Inactive,
    /// At work.
    Active,
    /// The end.
    Finalized,
    /// The callback of `configure` runs.
    Configuring,
    /// The callback of `cleanup` runs.
    CleaningUp,
    /// The callback of `shutdown` runs.
    ShuttingDown,
    /// The callback of `activate` runs.
    Activating,
    /// The callback of `deactivate` runs.
    Deactivating,
    /// The callback for errors runs.
    ErrorProcessing,
}

impl State {
    /// All of them, by their numbers.
    pub(crate) const ALL: [Self; 10] = [
        Self::Unconfigured,
        Self::Inactive,
        Self::Active,
        Self::Finalized,
        Self::Configuring,
        Self::CleaningUp,
        Self::ShuttingDown,
        Self::Activating,
        Self::Deactivating,
        Self::ErrorProcessing,
    ];

    /// The number in `lifecycle_msgs/msg/State`.
    #[must_use]
    pub const fn id(self) -> u8 {
        match self {
            Self::Unconfigured => 1,
            Self::Inactive => 2,
            Self::Active => 3,
            Self::Finalized => 4,
            Self::Configuring => 10,
            Self::CleaningUp => 11,
            Self::ShuttingDown => 12,
            Self::Activating => 13,
            Self::Deactivating => 14,
            Self::ErrorProcessing => 15,
        }
    }

    /// The label that ROS 2 gives it.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Unconfigured => "unconfigured",
            Self::Inactive => "inactive",
            Self::Active => "active",
            Self::Finalized => "finalized",
            Self::Configuring => "configuring",
            Self::CleaningUp => "cleaningup",
            Self::ShuttingDown => "shuttingdown",
            Self::Activating => "activating",
            Self::Deactivating => "deactivating",
            Self::ErrorProcessing => "errorprocessing",
        }
    }

    pub(crate) fn of_id(id: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.id() == id)
    }
}

/// A transition that can be asked of a managed node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Transition {
    /// Unconfigured to inactive.
    Configure,
    /// Inactive to unconfigured.
    Cleanup,
    /// Inactive to active.
    Activate,
    /// Active to inactive.
    Deactivate,
    /// Leads to finalized, from any state that the node can stay in.
    Shutdown,
}

impl Transition {
    /// The label that ROS 2 gives it.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Configure => "configure",
            Self::Cleanup => "cleanup",
            Self::Activate => "activate",
            Self::Deactivate => "deactivate",
            Self::Shutdown => "shutdown",
        }
    }
}

/// A callback's verdict on its work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Outcome {
    /// The transition is done.
    Success,
    /// The transition could not be done, and everything is as it was.
    Failure,
    /// Something is broken: the callback for errors is next.
    Error,
}

/// One arrow of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Arrow {
    pub(crate) id: u8,
    pub(crate) label: &'static str,
    pub(crate) from: State,
    pub(crate) to: State,
}

const fn arrow(id: u8, label: &'static str, from: State, to: State) -> Arrow {
    Arrow {
        id,
        label,
        from,
        to,
    }
}

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// The whole machine.
pub(crate) const GRAPH: [Arrow; 25] = {
    use State::{
        Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized,
        Inactive, ShuttingDown, Unconfigured,
    };
    [
        arrow(1, "configure", Unconfigured, Configuring),
        arrow(10, SUCCESS, Configuring, Inactive),
        arrow(11, FAILURE, Configuring, Unconfigured),
        arrow(12, ERROR, Configuring, ErrorProcessing),
        arrow(2, "cleanup", Inactive, CleaningUp),
        arrow(20, SUCCESS, CleaningUp, Unconfigured),
        arrow(21, FAILURE, CleaningUp, Inactive),
        arrow(22, ERROR, CleaningUp, ErrorProcessing),
        arrow(3, "activate", Inactive, Activating),
        arrow(30, SUCCESS, Activating, Active),
        arrow(31, FAILURE, Activating, Inactive),
        arrow(32, ERROR, Activating, ErrorProcessing),
        arrow(4, "deactivate", Active, Deactivating),
        arrow(40, SUCCESS, Deactivating, Inactive),
        arrow(41, FAILURE, Deactivating, Active),
        arrow(42, ERROR, Deactivating, ErrorProcessing),
        arrow(5, "shutdown", Unconfigured, ShuttingDown),
        arrow(6, "shutdown", Inactive, ShuttingDown),
        arrow(7, "shutdown", Active, ShuttingDown),
        arrow(50, SUCCESS, ShuttingDown, Finalized),
        arrow(51, FAILURE, ShuttingDown, Finalized),
        arrow(52, ERROR, ShuttingDown, ErrorProcessing),
        arrow(60, SUCCESS, ErrorProcessing, Unconfigured),
        arrow(61, FAILURE, ErrorProcessing, Finalized),
        arrow(62, ERROR, ErrorProcessing, Finalized),
    ]
};

/// The arrows that leave a state.
pub(crate) fn from(state: State) -> impl Iterator<Item = &'static Arrow> + Clone {
    GRAPH.iter().filter(move |a| a.from == state)
}

/// The arrow that a request takes: by its label if it has one, else by its number.
pub(crate) fn requested(state: State, id: u8, label: &str) -> Option<&'static Arrow> {
    let fits = |a: &&Arrow| match label {
        "" => a.id == id,
        label => a.label == label,
    };
    // Outcomes are for callbacks to say.
    from(state).filter(|a| a.id < 10).find(fits)
}

/// The arrow that the outcome of a callback takes.
pub(crate) fn concluded(state: State, outcome: Outcome) -> Option<&'static Arrow> {
    let label = match outcome {
        Outcome::Success => SUCCESS,
        Outcome::Failure => FAILURE,
        Outcome::Error => ERROR,
    };
    from(state).find(|a| a.label == label)
}

#[cfg(test)]
mod tests {
    use super::*;
    use State::*;

    /// Every state, every request, every outcome: where it leads, or that it leads nowhere.
    #[test]
    fn every_transition() {
        let requests = [
            ("configure", 1, vec![(Unconfigured, Configuring)]),
            ("cleanup", 2, vec![(Inactive, CleaningUp)]),
            ("activate", 3, vec![(Inactive, Activating)]),
            ("deactivate", 4, vec![(Active, Deactivating)]),
            ("shutdown", 5, vec![(Unconfigured, ShuttingDown)]),
            ("shutdown", 6, vec![(Inactive, ShuttingDown)]),
            ("shutdown", 7, vec![(Active, ShuttingDown)]),
        ];
        for state in State::ALL {
            for (label, id, arrows) in &requests {
                let goal = arrows.iter().find(|(s, _)| *s == state).map(|(_, g)| *g);
                assert_eq!(
                    requested(state, *id, "").map(|a| a.to),
                    goal,
                    "{state:?} {id}"
                );
                let all = requests.iter().filter(|r| r.0 == *label).flat_map(|r| &r.2);
                let goal = all.clone().find(|(s, _)| *s == state).map(|(_, g)| *g);
                assert_eq!(requested(state, 0, label).map(|a| a.to), goal);
            }
            for outcome in 10..=u8::MAX {
                assert_eq!(requested(state, outcome, ""), None, "not for others to say");
            }
            assert_eq!(requested(state, 0, SUCCESS), None);
            let ends = |o| concluded(state, o).map(|a| a.to);
            let ends = [
                ends(Outcome::Success),
                ends(Outcome::Failure),
                ends(Outcome::Error),
            ];
            let to = |s, f, e| [Some(s), Some(f), Some(e)];
            let expected = match state {
                Configuring => to(Inactive, Unconfigured, ErrorProcessing),
                CleaningUp => to(Unconfigured, Inactive, ErrorProcessing),
                Activating => to(Active, Inactive, ErrorProcessing),
                Deactivating => to(Inactive, Active, ErrorProcessing),
                ShuttingDown => to(Finalized, Finalized, ErrorProcessing),
                ErrorProcessing => to(Unconfigured, Finalized, Finalized),
                Unconfigured | Inactive | Active | Finalized => [None; 3],
            };
            assert_eq!(ends, expected, "{state:?}");
            assert_eq!(State::of_id(state.id()), Some(state));
        }
        let mut ids: Vec<u8> = GRAPH.iter().map(|a| a.id).collect();
        ids.sort_unstable();
        ids.dedup();
        assert_eq!(ids.len(), 25);
    }
}
