//! The flags of `check` that have something to say about numbers.
use super::kind::Kind;
use super::{Args, Finding, Overhang};
use crate::cli::model::{not_negative, slope, within};
use clap::{Args as ClapArgs, ValueEnum};
use std::path::{Path, PathBuf};

/// Layer height of a model when none is given, mm.
pub(super) const LAYER_MM: f64 = 0.2;

/// Side of a pixel of the image method when none is given, mm.
pub(super) const PIXEL_MM: f64 = 0.02;

/// Finest pixel of the image method, mm.
const PIXEL_MIN_MM: f64 = 0.001;

/// What counts as held.
#[derive(ClapArgs, Debug)]
pub(super) struct Rules {
    /// The material whose profile gives these, from `outrigger profile list` or a file
    /// [default: the G-code's own filament where it names one, else pla; for resin jobs
    /// resin-standard]
    #[arg(long, value_name = "NAME")]
    pub(super) material: Option<String>,
    /// Steepest overhang that holds itself, from the vertical: 0 is a wall, 90 a ceiling
    #[arg(long, value_name = "DEGREES", value_parser = slope)]
    pub(super) angle_deg: Option<f64>,
    /// Longest bridge between two held ends
    #[arg(long, value_name = "MM", value_parser = not_negative)]
    pub(super) bridge_mm: Option<f64>,
    /// List islands and overhangs smaller than this apart
    #[arg(long, value_name = "MM2", value_parser = not_negative)]
    pub(super) min_area_mm2: Option<f64>,
    /// How far what is held spreads into the layer above
    #[arg(long, value_name = "WAY", value_enum, default_value_t = Growth::Conditional)]
    pub(super) growth: Growth,
    /// Side of a pixel of the image method [default: 0.02]
    #[arg(long, value_name = "MM", value_parser = pixel)]
    pub(super) pixel_mm: Option<f64>,
}

/// How far what is held spreads into the layer above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Growth {
    /// Only inside the layer's own material
    Conditional,
    /// Over gaps too, as most programs do it: for comparison
    Naive,
}

fn pixel(text: &str) -> Result<f64, String> {
    within(text, |mm| (PIXEL_MIN_MM..=1.0).contains(&mm), &format!("from {PIXEL_MIN_MM} to 1 mm"))
}

/// What is drawn, by the name of the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Drawing {
    /// A drawing of lines.
    Svg,
    /// The same of pixels.
    Png,
    /// The page.
    Html,
}

/// What a path's ending asks for.
pub(super) fn drawing(path: &Path) -> Option<Drawing> {
    match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
        "svg" => Some(Drawing::Svg),
        "png" => Some(Drawing::Png),
        "html" | "htm" => Some(Drawing::Html),
        _ => None,
    }
}

pub(super) fn picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match drawing(&path) {
        Some(_) => Ok(path),
        None => Err("its name must end in .svg, .png or .html".to_owned()),
    }
}

/// Why options do not go together.
pub(super) fn at_odds(args: &Args) -> Option<String> {
    if args.fail_on.contains(&Finding::Overhangs) && args.overhang == Overhang::None {
        return Some("--fail-on overhangs looks for none with --overhang none".to_owned());
    }
    if args.fail_on.contains(&Finding::Printer) && args.printer.is_none() {
        return Some("--fail-on printer needs to know which: --printer NAME".to_owned());
    }
    let same =
        |a: &Path, b: &Path| a == b || a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
    for (name, to) in [("--json", &args.json), ("--picture", &args.picture)] {
        if to.as_ref().is_some_and(|to| same(to, &args.file)) {
            return Some(format!("{name} would replace {} itself; name another file", args.file.display()));
        }
    }
    let (Some(json), Some(picture)) = (&args.json, &args.picture) else { return None };
    same(json, picture).then(|| "--json and --picture name the same file".to_owned())
}

/// Why options do not go with a file of this kind.
pub(super) fn unfit(args: &Args, kind: Kind) -> Option<String> {
    let file = args.file.display();
    if kind != Kind::Gcode && args.filament_mm.is_some() {
        return Some(format!("--filament-mm is for G-code; {file} is {}", kind.words()));
    }
    if kind == Kind::Stl && args.printer.is_some() {
        return Some(format!("--printer is for sliced jobs; {file} is {}", kind.words()));
    }
    if kind == Kind::Stl {
        return None;
    }
    let model = &args.model;
    let given = [
        ("--layer-height", model.layer_height.is_some()),
        ("--first-layer-height", model.first_layer_height.is_some()),
        ("--rotate", model.rotate.is_some()),
        ("--height-mm", model.height_mm.is_some()),
        ("--overhang normal", args.overhang == Overhang::Normal),
    ];
    let (name, _) = given.into_iter().find(|(_, given)| *given)?;
    Some(format!("{name} is for models; {file} is {}, which has its own layers", kind.words()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_within_their_range() {
        let check = |found: Result<f64, String>, expect: Option<f64>| assert_eq!(found.ok(), expect);
        check(pixel("0"), None);
    }

    #[test]
    fn a_picture_is_what_its_name_ends_in() {
        let check = |name: &str, expect| assert_eq!(drawing(Path::new(name)), expect, "{name}");
        check("a.svg", Some(Drawing::Svg));
        check("a.b.PNG", Some(Drawing::Png));
        check("a.html", Some(Drawing::Html));
        check("a.pdf", None);
        check("svg", None);
        check("-", None);
    }
}
