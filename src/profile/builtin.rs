//! The files of `profiles/`, embedded in the binary.
//!
//! Each list is sorted by name and complete: a test compares it to the folder.

macro_rules! embed {
    ($folder:literal, $extension:literal, [$($name:literal),* $(,)?]) => {
        &[$((
            $name,
            include_str!(concat!(
                env!("CARGO_MANIFEST_DIR"), "/profiles/", $folder, "/", $name, $extension
            )),
        )),*]
    };
}

/// Name and text of each printer.
pub(crate) const PRINTERS: &[(&str, &str)] = embed!("printers", ".toml", ["generic-marlin", "prusa-mk3s"]);

/// Name and text of each material.
pub(crate) const MATERIALS: &[(&str, &str)] = embed!("materials", ".toml", ["pla"]);

/// File name and text of each shared macro.
pub(crate) const MACROS: &[(&str, &str)] = embed!(
    "macros",
    "",
    [
        "delta-cancel.gcode",
        "klipper-cancel.gcode",
        "klipper-start.gcode",
        "marlin-cancel.gcode",
        "marlin-start.gcode",
    ]
);
