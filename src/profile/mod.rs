//! Profiles of printers and materials: TOML in, valid data out.
//!
//! Takes the name of a profile that is built into the binary, or the path of a
//! user's own file; gives a [`Profile`] or a [`Material`] whose every value is
//! in range, or one error that names the file, the line and the way out. A key
//! that nobody reads is an error. Knows no printer and no wire.
//!
//! # Layout
//! [`keys`] documents and bounds every key · `check` walks a file along them ·
//! [`printer`], [`msla`] and [`material`] are the data · [`macros`] proves a cancel
//! macro safe, [`resume`] those of the way back, `msla/proof` what a resin printer needs · `builtin` embeds `profiles/` · [`explain`] prints a profile
//! with its documentation.
use material::MaterialKind;
use printer::Kind;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

mod builtin;
mod check;
pub mod explain;
pub mod keys;
pub mod macros;
pub mod material;
pub mod msla;
pub mod printer;
pub mod resume;

pub(crate) use check::{check, line_of, nearest};
pub use macros::Macro;
pub use material::{Material, SelfSupport};
pub use msla::Msla;
pub use printer::{Fdm, NotFdm, Profile};

/// Largest profile or macro file: the longest of ours has under 4 KiB, and
/// anything of this size is another kind of file.
const FILE_BYTES_MAX: u64 = 64 * 1024;

/// What is wrong, without where.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// Not TOML.
    #[error("{message}")]
    Syntax {
        /// The parser's words.
        message: String,
    },
    /// A key that nobody reads.
    #[error("unknown key {key}{}", nearest.as_ref().map(|n| format!("; did you mean {n}?")).unwrap_or_default())]
    UnknownKey {
        /// Its path.
        key: String,
        /// The nearest right one.
        nearest: Option<String>,
    },
    /// A key that must be there.
    #[error("{key} is missing ({doc})")]
    Missing {
        /// Its path.
        key: String,
        /// What it means.
        doc: &'static str,
    },
    /// A value of the wrong type, out of range or unsafe.
    #[error("{key} {message}")]
    Value {
        /// The key's path.
        key: String,
        /// Why it is refused.
        message: String,
    },
}

/// A fault and the line, from 1, on which it stands.
#[derive(Debug)]
pub struct Located {
    /// Line of the file, from 1.
    pub line: usize,
    /// What is wrong there.
    pub fault: Fault,
}

/// Why there is no profile.
#[derive(Debug, thiserror::Error)]
pub enum ProfileError {
    /// The file cannot be read.
    #[error("{}: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The system's word.
        source: std::io::Error,
    },
    /// The file is no profile by its size.
    #[error("{}: larger than {FILE_BYTES_MAX} bytes, so it is no profile", file.display())]
    TooLarge {
        /// The file.
        file: PathBuf,
    },
    /// The file's content.
    #[error("{file}, line {}: {}", at.line, at.fault)]
    Content {
        /// The file, or the built-in profile's name.
        file: String,
        /// Where and what.
        at: Located,
    },
    /// No built-in profile has this name.
    #[error("there is no {kind} profile {name:?}{}; `outrigger profile list` shows all, and a path ending in .toml names your own", nearest.as_ref().map(|n| format!(": did you mean {n}?")).unwrap_or_default())]
    UnknownName {
        /// `printer` or `material`.
        kind: &'static str,
        /// What was asked for.
        name: String,
        /// The nearest right one.
        nearest: Option<String>,
    },
}

/// Either kind of profile, for a verb that takes both.
#[derive(Clone, Debug, PartialEq)]
pub enum Any {
    /// A printer's.
    Printer(Box<Profile>),
    /// A material's.
    Material(Material),
}

/// The names of the built-in printers, sorted.
pub fn printer_names() -> impl Iterator<Item = &'static str> {
    builtin::PRINTERS.iter().map(|(name, _)| *name)
}

/// The names of the built-in materials, sorted.
pub fn material_names() -> impl Iterator<Item = &'static str> {
    builtin::MATERIALS.iter().map(|(name, _)| *name)
}

/// Loads a printer: a built-in one by name, or a file by its path (anything
/// that ends in `.toml` or has a `/`).
///
/// # Errors
/// [`ProfileError`]: unreadable, invalid, or an unknown name.
pub fn load_printer(name_or_path: &str) -> Result<Profile, ProfileError> {
    let source = Source::find("printer", builtin::PRINTERS, name_or_path)?;
    source.printer()
}

/// Loads a material, as [`load_printer`] does a printer.
///
/// # Errors
/// [`ProfileError`]: unreadable, invalid, or an unknown name.
pub fn load_material(name_or_path: &str) -> Result<Material, ProfileError> {
    let source = Source::find("material", builtin::MATERIALS, name_or_path)?;
    source.material()
}

/// Loads whichever the name or the file's `kind` says.
///
/// # Errors
/// [`ProfileError`]: unreadable, invalid, or an unknown name.
pub fn load_any(name_or_path: &str) -> Result<Any, ProfileError> {
    let all: Vec<_> = [builtin::PRINTERS, builtin::MATERIALS].concat();
    let source = Source::find("printer or material", &all, name_or_path)?;
    // A file that does not say is taken for a printer, whose check then says
    // that `kind` is missing.
    let material = matches!(source.kind().as_deref(), Some("filament" | "resin"));
    Ok(if material { Any::Material(source.material()?) } else { Any::Printer(Box::new(source.printer()?)) })
}

/// The text of a profile and where it came from.
struct Source {
    text: String,
    name: String,
    /// The folder in which a macro's file is looked for first.
    folder: Option<PathBuf>,
}

impl Source {
    fn find(
        kind: &'static str,
        known: &[(&'static str, &'static str)],
        name_or_path: &str,
    ) -> Result<Self, ProfileError> {
        if name_or_path.ends_with(".toml") || name_or_path.contains('/') {
            let path = Path::new(name_or_path);
            return Ok(Self {
                text: read(path)?,
                name: name_or_path.to_owned(),
                folder: Some(path.parent().unwrap_or(Path::new("")).to_owned()),
            });
        }
        let found = known.iter().find(|(name, _)| *name == name_or_path);
        let (name, text) = found.ok_or_else(|| ProfileError::UnknownName {
            kind,
            name: name_or_path.to_owned(),
            nearest: check::nearest(name_or_path, known.iter().map(|(name, _)| *name)).map(str::to_owned),
        })?;
        Ok(Self { text: (*text).to_owned(), name: format!("built-in profile {name}"), folder: None })
    }

    fn error(&self, at: Located) -> ProfileError {
        ProfileError::Content { file: self.name.clone(), at }
    }

    fn value(&self, key: &str, message: String) -> ProfileError {
        let line = check::line_of_key(&self.text, key);
        self.error(Located { line, fault: Fault::Value { key: key.to_owned(), message } })
    }

    fn printer(&self) -> Result<Profile, ProfileError> {
        let kind = self.kind();
        let (keys, others, owner) = match kind.as_deref() {
            Some("fdm") => (keys::fdm(), keys::MSLA, "a resin printer"),
            Some("msla") => (keys::msla(), keys::FDM, "a printer of filament"),
            // What is wrong then is `kind` itself.
            _ => ([keys::fdm().as_slice(), keys::MSLA].concat(), &[][..], ""),
        };
        let elsewhere = |e| of_the_other_kind(e, others, owner, kind.as_deref().unwrap_or_default());
        let mut table = self.checked(&keys).map_err(elsewhere)?;
        self.resolve_macros(&mut table)?;
        let profile: Profile = self.build(table)?;
        let macros = &profile.macros;
        for (key, text) in [
            ("macros.start", &macros.start),
            ("macros.end", &macros.end),
            ("macros.pause", &macros.pause),
            ("macros.cancel", &macros.cancel),
        ] {
            if let Some(why) = macros::unsendable(text, profile.serial.max_line) {
                return Err(self.value(key, format!("cannot be sent: {why}")));
            }
        }
        match &profile.kind {
            Kind::Fdm(fdm) => self.fdm(&profile, fdm)?,
            Kind::Msla(msla) => {
                if let Some((key, why)) = msla::proof::wrong(&profile, msla) {
                    return Err(self.value(key, why));
                }
            }
        }
        Ok(profile)
    }

    /// What a printer of filament says holds together.
    fn fdm(&self, profile: &Profile, fdm: &Fdm) -> Result<(), ProfileError> {
        let delta = profile.bed.shape == printer::BedShape::Circle;
        if let Some(why) = macros::unsafe_cancel(&profile.macros.cancel, delta) {
            return Err(self.value("macros.cancel", format!("is not safe: {why}")));
        }
        if let Some(why) = macros::unsafe_pause(&profile.macros.pause, delta) {
            return Err(self.value("macros.pause", format!("is not safe: {why}")));
        }
        match &profile.resume {
            Some(way_back) => self.resume(way_back, profile, fdm),
            None => Ok(()),
        }
    }

    /// The macros of the way back can be sent, and each does its step only.
    fn resume(&self, way_back: &printer::Resume, profile: &Profile, fdm: &Fdm) -> Result<(), ProfileError> {
        for (key, text, proof) in [
            ("resume.z_set", &way_back.z_set, resume::unsafe_z_set as resume::Proof),
            ("resume.home", &way_back.home, resume::unsafe_home),
            ("resume.levelling", &way_back.levelling, resume::unsafe_levelling),
            ("resume.prime", &way_back.prime, resume::unsafe_prime),
        ] {
            if let Some(why) = macros::unsendable(text, profile.serial.max_line) {
                return Err(self.value(key, format!("cannot be sent: {why}")));
            }
            if let Some(why) = proof(text) {
                return Err(self.value(key, format!("is not safe: {why}")));
            }
        }
        let delta = profile.bed.shape == printer::BedShape::Circle;
        if delta && way_back.homes_xy_alone {
            let why = "is true of a round bed, which is a delta's: it homes all towers at once";
            return Err(self.value("resume.homes_xy_alone", why.to_owned()));
        }
        if way_back.soften_c.0 > fdm.limits.nozzle_c.0 {
            return Err(self.value("resume.soften_c", "is above limits.nozzle_c".to_owned()));
        }
        Ok(())
    }

    /// What the file says that it is, if it is TOML and says so.
    fn kind(&self) -> Option<String> {
        let table = self.text.parse::<toml::Table>().ok()?;
        Some(table.get("kind")?.as_str()?.to_owned())
    }

    fn material(&self) -> Result<Material, ProfileError> {
        let resin = self.kind().as_deref() == Some("resin");
        let keys = if resin { keys::MATERIAL.to_vec() } else { keys::filament() };
        let elsewhere = |e| of_the_other_kind(e, keys::FILAMENT, "a filament", "resin");
        let material: Material = self.build(self.checked(&keys).map_err(elsewhere)?)?;
        let MaterialKind::Filament(filament) = material.kind else { return Ok(material) };
        for (key, range) in [("nozzle_c", filament.nozzle_c), ("bed_c", filament.bed_c)] {
            if !(range.min <= range.usual && range.usual <= range.max) {
                return Err(self.value(key, "must have min <= usual <= max".to_owned()));
            }
        }
        if filament.fan_percent.min > filament.fan_percent.max {
            return Err(self.value("fan_percent", "must have min <= max".to_owned()));
        }
        Ok(material)
    }

    fn checked(&self, keys: &[keys::Key]) -> Result<toml::Table, ProfileError> {
        check::check(&self.text, keys).map_err(|at| self.error(at))?;
        self.text.parse().map_err(|e| self.error(check::syntax(&self.text, &e)))
    }

    fn build<T: DeserializeOwned>(&self, table: toml::Table) -> Result<T, ProfileError> {
        table.try_into().map_err(|e| self.error(check::syntax(&self.text, &e)))
    }

    /// Puts the text of a macro's file in the place of its name: beside the
    /// user's profile, or else one of the shared ones in the binary.
    fn resolve_macros(&self, table: &mut toml::Table) -> Result<(), ProfileError> {
        for room in ["macros", "resume", "light", "plate"] {
            if let Some(macros) = table.get_mut(room).and_then(|m| m.as_table_mut()) {
                self.resolve_those_of(room, macros)?;
            }
        }
        Ok(())
    }

    fn resolve_those_of(&self, room: &str, macros: &mut toml::Table) -> Result<(), ProfileError> {
        for (key, value) in macros.iter_mut() {
            let Some(name) = value.get("file").and_then(|f| f.as_str()) else {
                continue;
            };
            let own = self.folder.as_ref().map(|folder| folder.join(name));
            let text = match own.filter(|path| path.is_file()) {
                Some(path) => read(&path)?,
                None => match builtin::MACROS.iter().find(|(n, _)| *n == name) {
                    Some((_, text)) => (*text).to_owned(),
                    None => {
                        let known: Vec<_> = builtin::MACROS.iter().map(|(n, _)| *n).collect();
                        return Err(self.value(
                            &format!("{room}.{key}"),
                            format!(
                                "names the file {name:?}, which is neither beside the profile nor one of {}",
                                known.join(", ")
                            ),
                        ));
                    }
                },
            };
            *value = toml::Value::String(text);
        }
        Ok(())
    }
}

/// A key of the other kind is not unknown: it is in the wrong place. `others` are that kind's
/// keys, `owner` who has them, `kind` what the file says that it is.
fn of_the_other_kind(error: ProfileError, others: &[keys::Key], owner: &str, kind: &str) -> ProfileError {
    match error {
        ProfileError::Content { file, at: Located { line, fault: Fault::UnknownKey { key, .. } } }
            if others.iter().any(|k| k.path == key) =>
        {
            let message = format!("belongs to {owner}, and `kind` says {kind:?}");
            ProfileError::Content { file, at: Located { line, fault: Fault::Value { key, message } } }
        }
        other => other,
    }
}

/// Reads a small text file.
fn read(path: &Path) -> Result<String, ProfileError> {
    use std::io::Read;
    let failed = |source| ProfileError::Read { file: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(failed)?;
    let mut text = String::new();
    // One byte more than the limit is enough to know that it was passed.
    file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > FILE_BYTES_MAX {
        return Err(ProfileError::TooLarge { file: path.to_owned() });
    }
    Ok(text)
}

#[cfg(test)]
mod tests;
