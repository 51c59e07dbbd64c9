//! The names of the stages.

/// A part of CI that can be run alone.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Stage {
    /// Formatting, spelling, circles, lints of our workspaces and feature sets, documentation.
    Lint,
    /// The part of `lint` that looks at the other workspaces and at images.
    LintOthers,
    /// Lints of the workspaces that stand on other libraries, and the book.
    LintForeign,
    /// The README's test command, and the XRCE client as a microcontroller has it.
    Test,
    /// Every interleaving of the concurrent protocols.
    Loom,
    /// The emulated boards, `NuttX`, and what images take.
    Board,
    /// The paper's experiments on the emulated boards.
    BoardExperiments,
    /// Half a minute of fuzzing from the kept corpus.
    Fuzz,
    /// Foreign implementations against ours.
    Peers,
    /// The part of `peers` that builds in folders of its own.
    BuildPeers,
    /// Other architectures and C libraries, and the oldest compiler.
    Arch,
    /// Licences, sources and packages of the published crates.
    Supply,
    /// The part of `supply` that packs the published crates.
    Package,
    /// Waits until an installation that runs beside has ended.
    Installed,
}

impl Stage {
    /// Its name on the command line.
    pub(super) fn word(self) -> String {
        let value = clap::ValueEnum::to_possible_value(&self);
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }
}
