//! Where a profile has the pictures of a resin job go.
//!
//! Takes a profile, gives the display that it names, open.
use crate::printer::lcd::folder::Folder;
use crate::printer::lcd::framebuffer::{Framebuffer, Place};
use crate::printer::lcd::layout::{Layout, Order, Pixels};
use crate::printer::lcd::{LcdError, Sink};
use crate::profile::Msla;
use crate::profile::msla;
use std::path::Path;

/// The panel of a profile.
pub(crate) fn layout(lcd: &msla::Lcd) -> Layout {
    let pixels = match lcd.pixels {
        msla::Pixels::Grey => Pixels::Grey,
        msla::Pixels::Rgb => Pixels::Packed { order: Order::Rgb },
        msla::Pixels::Bgr => Pixels::Packed { order: Order::Bgr },
    };
    Layout { width_px: lcd.width_px, height_px: lcd.height_px, pixels }
}

/// Its display; a folder that is given takes its place.
///
/// # Errors
/// There is none, or it is not what the profile says.
pub(crate) fn open(msla: &Msla, folder: Option<&Path>) -> Result<Box<dyn Sink>, LcdError> {
    let layout = layout(&msla.lcd);
    Ok(match (folder, &msla.lcd.sink) {
        (Some(folder), _) => Box::new(Folder::open(layout, folder, true)?),
        (None, msla::Sink::Folder(folder)) => Box::new(Folder::open(layout, folder, false)?),
        (None, msla::Sink::Framebuffer(name)) => Box::new(Framebuffer::open(layout, &Place::named(name))?),
    })
}
