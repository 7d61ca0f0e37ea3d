//! Archives and pictures made for tests, here and in the rooms that read jobs.
use png::Encoder;
pub(crate) use png::{BitDepth, ColorType};
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// The settings of a panel of 1 mm pixels, upright.
pub(crate) fn sl1_settings(width: u32, height: u32) -> String {
    format!(
        "display_width = {width}\ndisplay_height = {height}\ndisplay_pixels_x = {width}\ndisplay_pixels_y = {height}\ndisplay_orientation = landscape\ndisplay_mirror_x = 0\ndisplay_mirror_y = 0\ninitial_layer_height = 0.1\n"
    )
}

/// The head of a job "job" of some layers of 0.05 mm.
pub(crate) fn sl1_config(layers: usize) -> String {
    format!(
        "expTime = 5\nexpTimeFirst = 25\njobDir = job\nlayerHeight = 0.05\nnumFade = 4\nnumFast = {layers}\nnumSlow = 0\n"
    )
}

/// An SL1 job of upright pictures with pixels of 1 mm.
pub(crate) fn sl1(width: u32, height: u32, layers: &[Vec<u8>]) -> Vec<u8> {
    let mut entries = vec![
        ("config.ini".to_owned(), sl1_config(layers.len()).into_bytes()),
        ("prusaslicer.ini".to_owned(), sl1_settings(width, height).into_bytes()),
    ];
    for (i, pixels) in layers.iter().enumerate() {
        entries.push((format!("job{i:05}.png"), grey(width, height, pixels)));
    }
    archive(&entries)
}

/// A zip archive of some entries, packed as slicers do.
pub(crate) fn archive<N: AsRef<str>, B: AsRef<[u8]>>(entries: &[(N, B)]) -> Vec<u8> {
    zipped(entries, SimpleFileOptions::default())
}

/// A zip archive of some entries, not packed.
pub(crate) fn stored<N: AsRef<str>, B: AsRef<[u8]>>(entries: &[(N, B)]) -> Vec<u8> {
    zipped(entries, SimpleFileOptions::default().compression_method(CompressionMethod::Stored))
}

fn zipped<N: AsRef<str>, B: AsRef<[u8]>>(entries: &[(N, B)], options: SimpleFileOptions) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, bytes) in entries {
        zip.start_file(name.as_ref(), options).expect("a new entry");
        zip.write_all(bytes.as_ref()).expect("written");
    }
    zip.finish().expect("a whole archive").into_inner()
}

/// An 8-bit grey PNG.
pub(crate) fn grey(width: u32, height: u32, pixels: &[u8]) -> Vec<u8> {
    picture(width, height, ColorType::Grayscale, BitDepth::Eight, pixels)
}

/// A PNG of any kind.
pub(crate) fn picture(width: u32, height: u32, colour: ColorType, depth: BitDepth, bytes: &[u8]) -> Vec<u8> {
    let mut png = Vec::new();
    let mut encoder = Encoder::new(&mut png, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == ColorType::Indexed {
        encoder.set_palette(vec![0, 0, 0, 255, 255, 255]);
    }
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(bytes).expect("as many bytes as the picture has");
    writer.finish().expect("a whole picture");
    png
}

/// A PNG that is nothing but a header.
pub(crate) fn header(width: u32, height: u32) -> Vec<u8> {
    let mut png = grey(1, 1, &[0]);
    png[16..20].copy_from_slice(&width.to_be_bytes());
    png[20..24].copy_from_slice(&height.to_be_bytes());
    let mut crc = flate2::Crc::new();
    crc.update(&png[12..29]);
    png[29..33].copy_from_slice(&crc.sum().to_be_bytes());
    png.truncate(33);
    png
}

/// A layer of 1 mm that ends at this height, mm.
pub(crate) fn layer(top_mm: f64) -> super::job::JobLayer {
    super::job::JobLayer { entry: 0, top_mm, height_mm: 1.0, exposure_s: 2.0 }
}
