//! Where what was found goes: the table, the JSON, the picture.
use super::flags::{Drawing, drawing};
use super::source::Checked;
use super::{Args, stdout_is_taken, words};
use crate::cli::files;
use crate::report::survey::{Survey, page, picture};
use anyhow::Context;
use std::path::Path;

/// Writes all that was asked for.
///
/// # Errors
/// A file cannot be written.
pub(super) fn write(args: &Args, checked: &Checked) -> anyhow::Result<()> {
    let report = &checked.report;
    if !args.quiet {
        let table = words::table(report, &checked.mended_words);
        if stdout_is_taken(args) { eprintln!("{table}") } else { crate::cli::say(&table) }
    }
    if let Some(to) = &args.json {
        let text = report.json().context("cannot write the report")?;
        if to == Path::new("-") {
            crate::cli::say(text.trim_end());
        } else {
            files::write_whole(text.as_bytes(), to, "report")?;
        }
    }
    if let (Some(to), Some(survey)) = (&args.picture, &checked.survey) {
        files::write_whole(&drawn(report, survey, to)?, to, "picture")?;
    }
    Ok(())
}

fn drawn(report: &crate::report::check::Report, survey: &Survey, to: &Path) -> anyhow::Result<Vec<u8>> {
    Ok(match drawing(to) {
        Some(Drawing::Html) => page::html(report, survey).context("cannot make the page")?.into_bytes(),
        Some(Drawing::Png) => picture::png(report, survey)?,
        Some(Drawing::Svg) | None => picture::svg(report, survey).into_bytes(),
    })
}
