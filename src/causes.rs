//! An error with its causes on one line, each of them said once.
//!
//! Some errors tell their cause in their own words and name it as their cause besides; anyhow's
//! `{:#}` would say it twice.

/// The error's words, then those of its causes, outermost first, parted by `: `. A cause that the
/// words before it hold already is left out.
pub(crate) fn line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain() {
        let words = cause.to_string();
        if line.contains(&words) {
            continue;
        }
        if !line.is_empty() {
            line += ": ";
        }
        line += &words;
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("cannot make /x: {source}")]
    struct Telling {
        source: std::io::Error,
    }

    #[derive(Debug, thiserror::Error)]
    #[error("cannot read")]
    struct Silent(#[source] std::io::Error);

    #[derive(Debug, thiserror::Error)]
    #[error("no picture ({0}); export it again")]
    struct Within(#[source] std::io::Error);

    #[test]
    fn each_cause_is_told_once() {
        let check = |error: anyhow::Error, expect: &str| assert_eq!(line(&error), expect);
        let read_only = || std::io::Error::other("read-only file system");
        check(anyhow::Error::new(Telling { source: read_only() }), "cannot make /x: read-only file system");
        check(anyhow::Error::new(Silent(read_only())), "cannot read: read-only file system");
        check(
            anyhow::Error::new(Telling { source: read_only() }).context("the data folder"),
            "the data folder: cannot make /x: read-only file system",
        );
        check(anyhow::Error::new(Within(read_only())), "no picture (read-only file system); export it again");
        check(anyhow::anyhow!("alone"), "alone");
    }
}
