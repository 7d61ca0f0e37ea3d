//! The job of `demo --resin`: a twisted column, and a gallows whose lamp begins in the air.
//!
//! Takes nothing, gives the bytes of an SL1 archive, always the same ones. No two of its pictures are alike, so that
//! each tells which layer it is.
//!
//! ```text
//!   z                          ___________     layer 39
//!   |    _____                |  __________|   arm, from layer 34
//!   |    \   /                | |      |_|     lamp: begins in the air at layer 28
//!   |    /   \                | |
//!   |____\___/________________|_|___________   layer 0, on the plate
//! ```
use crate::resin::archive::write::{ArchiveWriter, Packed};
use crate::resin::image::{Image, Packing, Panel};
use anyhow::Context;
use std::io::Cursor;

/// Pixels of the panel, and the side of one, mm.
pub(super) const PANEL_PX: [u32; 2] = [240, 160];
const PIXEL_MM: f64 = 0.1;

/// Layers, and the height of one, mm.
pub(super) const LAYERS: u32 = 40;
const LAYER_MM: f64 = 0.1;

/// The lamp's first layer, and the arm's.
pub(super) const LAMP: u32 = 28;
const ARM: u32 = 34;

/// Exposure of the first layer and of most, s; and over how many layers the one becomes the other.
const FIRST_S: f64 = 8.0;
const USUAL_S: f64 = 2.0;
const FADE: u32 = 5;

/// Samples of a pixel along each side: edges are grey, as slicers draw them.
const SAMPLES: u32 = 3;

/// An archive as a slicer writes it.
///
/// # Errors
/// Memory takes every archive: none but the program's own mistakes.
pub(super) fn sl1() -> anyhow::Result<Vec<u8>> {
    let [width_px, height_px] = PANEL_PX;
    let panel = Panel { width_px, height_px, packing: Packing::Grey };
    let mut zip = ArchiveWriter::new(Cursor::new(Vec::new()));
    zip.add("config.ini", config().as_bytes(), Packed::Deflated)?;
    zip.add("prusaslicer.ini", slicer().as_bytes(), Packed::Deflated)?;
    for layer in 0..LAYERS {
        let packed = panel.pack(&picture(layer)).context("the demo's own picture")?;
        zip.add(&format!("lamp{layer:05}.png"), &packed, Packed::Stored)?;
    }
    Ok(zip.finish()?.into_inner())
}

fn config() -> String {
    format!(
        "action = print\nexpTime = {USUAL_S}\nexpTimeFirst = {FIRST_S}\njobDir = lamp\nlayerHeight = {LAYER_MM}\n\
         materialName = demo\nnumFade = {FADE}\nnumFast = {LAYERS}\nnumSlow = 0\n"
    )
}

fn slicer() -> String {
    let [wide, high] = PANEL_PX;
    let [wide_mm, high_mm] = PANEL_PX.map(|px| f64::from(px) * PIXEL_MM);
    format!(
        "display_height = {high_mm}\ndisplay_mirror_x = 0\ndisplay_mirror_y = 0\ndisplay_orientation = landscape\n\
         display_pixels_x = {wide}\ndisplay_pixels_y = {high}\ndisplay_width = {wide_mm}\n\
         initial_layer_height = {LAYER_MM}\nlayer_height = {LAYER_MM}\nprinter_technology = SLA\n"
    )
}

fn picture(layer: u32) -> Image {
    let [width_px, height_px] = PANEL_PX;
    let place_mm =
        |px: u32, sample: u32| (f64::from(px) + (f64::from(sample) + 0.5) / f64::from(SAMPLES)) * PIXEL_MM;
    let mut pixels = Vec::with_capacity(width_px as usize * height_px as usize);
    for v in 0..height_px {
        for u in 0..width_px {
            let samples =
                (0..SAMPLES * SAMPLES).map(|n| (place_mm(u, n % SAMPLES), place_mm(v, n / SAMPLES)));
            let inside = samples.filter(|(x, y)| is_part(*x, *y, layer)).count() as u32;
            // At most 255.
            pixels.push((255 * inside / (SAMPLES * SAMPLES)) as u8);
        }
    }
    Image { width_px, height_px, pixels }
}

/// Whether a place of a layer, mm from the picture's upper left corner, is part.
fn is_part(x: f64, y: f64, layer: u32) -> bool {
    let within = |x0: f64, x1: f64, y0: f64, y1: f64| (x0..x1).contains(&x) && (y0..y1).contains(&y);
    let post = within(14.0, 16.0, 7.0, 9.0);
    let arm = layer >= ARM && within(14.0, 21.0, 7.0, 9.0);
    post || arm || is_lamp(x - 20.0, y - 8.0, layer) || is_column(x - 7.0, y - 8.0, layer)
}

/// A bulb that hangs point down: one tip of a support holds most of where it begins.
fn is_lamp(x: f64, y: f64, layer: u32) -> bool {
    (LAMP..ARM).contains(&layer) && x.hypot(y) < 0.3 + 0.08 * f64::from(layer - LAMP)
}

/// A star of five rounded points that turns as it rises.
fn is_column(x: f64, y: f64, layer: u32) -> bool {
    let turned = y.atan2(x) - f64::from(layer).to_radians();
    x.hypot(y) < 4.2 + 0.6 * (5.0 * turned).cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use std::collections::BTreeSet;

    #[test]
    fn it_is_a_small_job_of_pictures_that_all_differ() {
        let bytes = sl1().unwrap();
        assert!(bytes.len() < 100_000, "{}", bytes.len());
        assert_eq!(bytes, sl1().unwrap());
        let mut job = resin::open(Cursor::new(bytes)).unwrap();
        assert_eq!(job.layers().len() as u32, LAYERS);
        let exposures: Vec<f64> = job.layers().iter().map(|layer| layer.exposure_s).collect();
        assert_eq!((exposures[0], exposures[FADE as usize], exposures[39]), (FIRST_S, USUAL_S, USUAL_S));
        assert!(exposures[..6].is_sorted_by(|a, b| a > b), "{exposures:?}");
        let pictures: BTreeSet<_> = (0..LAYERS).map(|layer| job.image(layer).unwrap().pixels).collect();
        assert_eq!(pictures.len() as u32, LAYERS);
    }
}
