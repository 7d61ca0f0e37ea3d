//! Times for people: seconds since 1970 as words.
//!
//! Takes a time and what the time is now, gives text. Knows no time zone: dates are
//! those of Greenwich, and say so.

/// `3 min ago`; a clock that was set back gives `just now`.
pub(super) fn ago(at_unix_s: u64, now_unix_s: u64) -> String {
    let s = now_unix_s.saturating_sub(at_unix_s);
    let (count, unit) = match s {
        0..60 => return "just now".to_owned(),
        60..3600 => (s / 60, "min"),
        3600..172_800 => (s / 3600, "h"),
        _ => (s / 86_400, "days"),
    };
    format!("{count} {unit} ago")
}

/// `2026-11-22 12:05 UTC`.
pub(super) fn date(unix_s: u64) -> String {
    let (days, s) = (unix_s / 86_400, unix_s % 86_400);
    // Years of 400 have the same days; a year that begins with March ends with its odd day.
    let day = days + 719_468;
    let (era, day) = (day / 146_097, day % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let of_month = day - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    let year = era * 400 + year + next;
    format!("{year:04}-{month:02}-{of_month:02} {:02}:{:02} UTC", s / 3600, s / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told() {
        let check = |s, expect: &str| assert_eq!(date(s), expect);
        check(0, "1970-01-01 00:00 UTC");
        check(951_782_400, "2000-02-29 00:00 UTC");
        check(951_868_799, "2000-02-29 23:59 UTC");
        check(951_868_800, "2000-03-01 00:00 UTC");
        check(1_795_349_100, "2026-11-22 12:05 UTC");
        check(4_107_542_400, "2100-03-01 00:00 UTC");
        assert!(!date(u64::MAX).is_empty());
        let check = |s, expect: &str| assert_eq!(ago(1000, 1000 + s), expect);
        check(59, "just now");
        check(60, "1 min ago");
        check(7300, "2 h ago");
        check(200_000, "2 days ago");
        assert_eq!(ago(1000, 10), "just now");
    }
}
