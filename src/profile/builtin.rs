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
pub(crate) const PRINTERS: &[(&str, &str)] = embed!(
    "printers",
    ".toml",
    [
        "anet-a8",
        "anycubic-i3-mega",
        "anycubic-kobra",
        "anycubic-kossel-plus",
        "cr-10",
        "ender-3",
        "ender-3-v2",
        "ender-5",
        "generic-marlin",
        "generic-msla",
        "generic-msla-rgb",
        "lulzbot-taz-6",
        "prusa-mini",
        "prusa-mk3s",
        "prusa-mk4",
        "sidewinder-x1",
        "sidewinder-x2",
        "sovol-sv06",
        "ultimaker-2",
        "voron-0",
        "voron-2.4-350"
    ]
);

/// Name and text of each material.
pub(crate) const MATERIALS: &[(&str, &str)] = embed!(
    "materials",
    ".toml",
    [
        "abs",
        "asa",
        "hips",
        "pa",
        "pc",
        "petg",
        "pla",
        "pp",
        "resin-castable",
        "resin-standard",
        "resin-tough",
        "tpu"
    ]
);

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
        "msla-cancel.gcode",
    ]
);
