//! The front: which packages, in which way, into which directory.

use crate::emit::{self, Emit, Owned};
use crate::error::Error;
use crate::model::Interface;
use crate::package;
use crate::registry::{Bounds, Registry};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{env, fs};

/// The variable in which `replenish-interfaces` tells a build script where its packages are.
const SHARE: &str = "DEP_REPLENISH_INTERFACES_SHARE";

/// The same of a crate that depends on `replenish`, which has those packages, too.
const SHARE_OF_REPLENISH: &str = "DEP_REPLENISH_SHARE";

/// Generates Rust from interface packages.
#[derive(Clone, Debug)]
#[must_use = "nothing is generated before `generate`"]
pub struct Generator {
    packages: Vec<PathBuf>,
    dependencies: Vec<(PathBuf, String)>,
    reused: BTreeMap<String, String>,
    runtime: Option<String>,
    owned: Owned,
    bounds: Bounds,
}

impl Default for Generator {
    fn default() -> Self {
        Self::new()
    }
}

impl Generator {
    /// A generator without packages.
    pub fn new() -> Self {
        Self {
            packages: Vec::new(),
            dependencies: Vec::new(),
            reused: BTreeMap::new(),
            runtime: None,
            owned: Owned::Always,
            bounds: Bounds::default(),
        }
    }

    /// Generates the package in `dir`, whose last component is the package's name.
    pub fn package_dir(mut self, dir: impl Into<PathBuf>) -> Self {
        self.packages.push(dir.into());
        self
    }

    /// Says that the package in `dir` is in Rust already, as module `path`, such as
    /// `::robot_msgs::arm_msgs`. Its files are read all the same: they are part of the type hashes.
    pub fn dependency_dir(mut self, dir: impl Into<PathBuf>, path: impl Into<String>) -> Self {
        self.dependencies.push((dir.into(), path.into()));
        self
    }

    /// Uses the Rust type `path` for `name` (`std_msgs/msg/Int32`) instead of generating one. It
    /// has to be that message, and without unbounded fields.
    pub fn reuse(mut self, name: impl Into<String>, path: impl Into<String>) -> Self {
        self.reused.insert(name.into(), path.into());
        self
    }

    /// The path of the crate `replenish-msg` in the generated code. Unless said otherwise it is
    /// `::replenish::msg` in the build script of a crate that depends on `replenish` and not on
    /// `replenish-interfaces`, and `::replenish_msg` elsewhere.
    pub fn runtime(mut self, path: impl Into<String>) -> Self {
        self.runtime = Some(path.into());
        self
    }

    /// Generates owned structs of types with unbounded fields under `#[cfg(feature = "NAME")]`.
    pub fn owned_feature(mut self, name: impl Into<String>) -> Self {
        self.owned = Owned::Feature(name.into());
        self
    }

    /// Generates no owned structs of types with unbounded fields, for programs without a heap:
    /// views alone, and with them no `Service` or `Action` that has such parts.
    pub fn without_heap(mut self) -> Self {
        self.owned = Owned::Never;
        self
    }

    /// Holds strings without a bound as inline strings of at most `bytes` (at least 1). Longer ones
    /// from outside are errors. Names and hashes of types stay what they are.
    pub fn bound_strings(mut self, bytes: usize) -> Self {
        self.bounds.text = Some(bytes.max(1));
        self
    }

    /// Holds sequences without a bound as inline vectors of at most `elements` (at least 1). Longer
    /// ones from outside are errors. Names and hashes of types stay what they are.
    pub fn bound_sequences(mut self, elements: usize) -> Self {
        self.bounds.sequence = Some(elements.max(1));
        self
    }

    /// As [`generate`](Self::generate) into Cargo's `OUT_DIR`; tells Cargo to run the build script
    /// again when a package changes. For build scripts only.
    ///
    /// # Errors
    /// As `generate`; without `OUT_DIR`.
    pub fn generate_for_cargo(self) -> Result<(), Error> {
        let Some(dir) = env::var_os("OUT_DIR") else {
            let message = "OUT_DIR is not set: only in a build script is it";
            return Err(Error::whole(Path::new("build.rs"), message));
        };
        for dir in self
            .packages
            .iter()
            .chain(self.dependencies.iter().map(|(dir, _)| dir))
        {
            println!("cargo::rerun-if-changed={}", dir.display());
        }
        self.generate(PathBuf::from(dir))
    }

    /// Writes `interfaces.rs` into `dir`, and beside it a file per interface that it includes. In a
    /// build script the packages of `replenish-interfaces` are taken as
    /// [dependencies](Self::dependency_dir) if the crate depends on it or on `replenish`, and those
    /// given here are not among them.
    ///
    /// # Errors
    /// [`Error`] with the place, for anything wrong with the files, and for types that are not
    /// there.
    pub fn generate(mut self, dir: impl AsRef<Path>) -> Result<(), Error> {
        self.add_shared()?;
        let mut registry = Registry::new(self.bounds);
        let mut own = Vec::new();
        for package in &self.packages {
            own.extend(package::read(package)?);
        }
        for interface in &own {
            let path = self.reused.get(&interface.name.to_string());
            registry.add(interface, path.map(String::as_str));
        }
        // Types of other crates have their own bounds.
        for (package, path) in &self.dependencies {
            for interface in package::read(package)? {
                let name = &interface.name;
                for part in &interface.parts {
                    let path = format!("{path}::{}::{}", name.kind, part.name.rust());
                    let one = Interface {
                        parts: vec![part.clone()],
                        ..interface.clone()
                    };
                    registry.add(&one, Some(&path));
                }
            }
        }
        for part in own.iter().flat_map(|i| &i.parts) {
            registry.check(&part.name)?;
        }
        check_names(&registry, &own)?;
        self.write(dir.as_ref(), &registry, &own)
    }

    /// The packages of `replenish-interfaces`, if this is a build script of a crate that uses it.
    fn add_shared(&mut self) -> Result<(), Error> {
        let shared = |name, root| Some((PathBuf::from(env::var_os(name)?), root));
        let direct = shared(SHARE, "::replenish_interfaces");
        let through = || shared(SHARE_OF_REPLENISH, "::replenish::interfaces");
        if direct.is_none() && through().is_some() {
            self.runtime
                .get_or_insert_with(|| "::replenish::msg".into());
        }
        let Some((share, root)) = direct.or_else(through) else {
            return Ok(());
        };
        let wrong = |e: std::io::Error| Error::whole(&share, e.to_string());
        let given = self
            .packages
            .iter()
            .chain(self.dependencies.iter().map(|d| &d.0));
        let given: Vec<_> = given
            .filter_map(|d| Some(d.file_name()?.to_owned()))
            .collect();
        for entry in fs::read_dir(&share).map_err(wrong)? {
            let dir = entry.map_err(wrong)?.path();
            let Some(name) = dir.file_name().filter(|n| !given.iter().any(|g| g == n)) else {
                continue;
            };
            let path = format!("{root}::{}", name.to_string_lossy());
            if dir.is_dir() {
                self.dependencies.push((dir, path));
            }
        }
        Ok(())
    }

    fn write(&self, dir: &Path, registry: &Registry, own: &[Interface]) -> Result<(), Error> {
        let emit = Emit {
            registry,
            runtime: self.runtime.as_deref().unwrap_or("::replenish_msg"),
            owned: &self.owned,
        };
        let interfaces: Vec<_> = own.iter().collect();
        for interface in &interfaces {
            put(
                &dir.join(emit::file(&interface.name)),
                &emit.interface(interface),
            )?;
        }
        put(&dir.join("interfaces.rs"), &emit::root(&interfaces))
    }
}

/// Checks that no two interfaces want the same Rust name or the same file, such as `Map`, which has
/// a `MapView`, and `MapView`.
fn check_names(registry: &Registry, own: &[Interface]) -> Result<(), Error> {
    let mut taken = BTreeMap::new();
    for interface in own {
        let name = &interface.name;
        let mut wanted = vec![emit::file(name)];
        if name.kind != "msg" {
            wanted.push(name.rust());
        }
        for part in &interface.parts {
            wanted.push(part.name.rust());
            if !registry.facts(&part.name).inline {
                wanted.push(format!("{}View", part.name.rust()));
            }
        }
        for wanted in wanted {
            let key = (&name.package, name.kind, wanted);
            if let Some(other) = taken.get(&key) {
                let message = format!("`{name}` and `{other}` are both `{}` in Rust", key.2);
                return Err(Error::whole(&interface.file, message));
            }
            taken.insert(key, name);
        }
    }
    Ok(())
}

fn put(path: &Path, text: &str) -> Result<(), Error> {
    let wrong = |e: std::io::Error| Error::whole(path, e.to_string());
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent).map_err(wrong)?;
    }
    fs::write(path, text).map_err(wrong)
}
