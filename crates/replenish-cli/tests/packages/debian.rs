//! `tools/deb.sh`: the package says what it needs, has every file, and its program runs.

use crate::{empty, missing, repository, succeeds};
use replenish_testkit::harness::{Trial, peer_trial};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

const PROGRAM: &str = env!("CARGO_BIN_EXE_replenish");

pub(crate) fn trials() -> Vec<Trial> {
    let missing = missing("dpkg-deb", "dpkg");
    vec![peer_trial("the_package_is_complete", missing, complete)]
}

fn complete() {
    let dir = empty("debian");
    let script = repository().join("tools/deb.sh");
    let said = succeeds(
        Command::new(script)
            .arg(&dir)
            .env("REPLENISH_PROGRAM", PROGRAM)
            .env("DEB_COMPRESSION", "none"),
    );
    let package = PathBuf::from(said.trim());
    let version = env!("CARGO_PKG_VERSION");
    assert!(said.contains(&format!("/replenish_{version}_")), "{said}");

    let info = succeeds(Command::new("dpkg-deb").arg("--info").arg(&package));
    for line in [
        "Package: replenish",
        "Depends: libc6 (>= 2.",
        "Architecture: ",
    ] {
        assert!(info.contains(line), "{line}: {info}");
    }
    let contents = succeeds(Command::new("dpkg-deb").arg("--contents").arg(&package));
    assert!(
        contents.lines().all(|l| l.contains(" root/root ")),
        "{contents}"
    );
    let strangers = contents
        .lines()
        .filter(|l| l.get(8..9) == Some("w"))
        .count();
    assert_eq!(strangers, 0, "nobody else may write: {contents}");

    let root = dir.join("unpacked");
    succeeds(Command::new("dpkg-deb").arg("-R").arg(&package).arg(&root));
    for file in [
        "usr/bin/replenish",
        "usr/share/man/man1/replenish.1.gz",
        "usr/share/man/man1/replenish-agent.1.gz",
        "usr/share/bash-completion/completions/replenish",
        "usr/share/zsh/vendor-completions/_replenish",
        "usr/share/fish/vendor_completions.d/replenish.fish",
        "usr/lib/systemd/system/replenish-agent.service",
        "usr/share/doc/replenish/copyright",
        "usr/share/doc/replenish/changelog.gz",
    ] {
        let size = std::fs::metadata(root.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(size.len() > 0, "{file}");
    }
    let ran = succeeds(Command::new(root.join("usr/bin/replenish")).arg("--version"));
    assert_eq!(ran.trim(), format!("replenish {version}"));
    // The service starts the program where the package has it.
    let unit = text(&root, "usr/lib/systemd/system/replenish-agent.service");
    assert!(
        unit.contains("ExecStart=/usr/bin/replenish agent"),
        "{unit}"
    );
    // A file in /etc that a user changed is kept.
    let kept = text(&root, "DEBIAN/conffiles");
    let limits = text(&root, kept.trim().trim_start_matches('/'));
    for right in ["@realtime - rtprio 99", "@realtime - memlock unlimited"] {
        assert!(limits.lines().any(|l| l == right), "{limits}");
    }
    for script in ["postinst", "prerm"] {
        let path = root.join("DEBIAN").join(script);
        let mode = std::fs::metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o755, "{script}");
        succeeds(Command::new("sh").arg("-n").arg(&path));
    }
    assert!(text(&root, "DEBIAN/postinst").contains("groupadd --system realtime"));
    std::fs::remove_dir_all(dir).ok();
}

fn text(root: &Path, file: &str) -> String {
    std::fs::read_to_string(root.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}
