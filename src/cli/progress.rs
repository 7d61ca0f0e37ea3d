//! Progress bars on a terminal, nothing elsewhere.
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;

/// A bar over a file's bytes.
pub(super) fn bytes(total: u64, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), target(quiet));
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes} {bytes_per_sec} {eta}") {
        bar.set_style(style);
    }
    bar
}

/// A bar over layers, or a count of them where their number is not known before the end.
pub(super) fn layers(total: Option<u32>, quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(total.map(u64::from), target(quiet));
    let template = if total.is_some() { "{bar:40} layer {pos}/{len} {eta}" } else { "{spinner} layer {pos}" };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

fn target(quiet: bool) -> ProgressDrawTarget {
    if quiet || !std::io::stderr().is_terminal() {
        ProgressDrawTarget::hidden()
    } else {
        ProgressDrawTarget::stderr()
    }
}
