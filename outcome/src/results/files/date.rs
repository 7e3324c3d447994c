//! Dates and times in UTC.

/// Returns year, month and day, and hour, minute and second, of a Unix time in seconds.
pub fn date_and_time(unix_s: u64) -> ([u64; 3], [u64; 3]) {
    let (days, of_day) = (unix_s / 86_400, unix_s % 86_400);
    // Civil date from a day count, with eras of 400 years and years that begin in March.
    let shifted = days + 719_468;
    let (era, of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    ([year, month, day], [of_day / 3600, of_day / 60 % 60, of_day % 60])
}

/// Formats a Unix time as `20261121-041500`, for file names.
pub fn format_for_file_name(unix_s: u64) -> String {
    let ([year, month, day], [hour, minute, second]) = date_and_time(unix_s);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// Formats a Unix time as `2026-11-21 04:15:00 UTC`.
pub fn format_date(unix_s: u64) -> String {
    let ([year, month, day], [hour, minute, second]) = date_and_time(unix_s);
    format!("{year}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn date_matches_the_calendar() {
        for (unix_s, expected) in [
            (0, "1970-01-01 00:00:00 UTC"),
            (951_782_399, "2000-02-28 23:59:59 UTC"),
            (951_782_400, "2000-02-29 00:00:00 UTC"),
            (1_709_251_199, "2024-02-29 23:59:59 UTC"),
            (1_735_689_599, "2024-12-31 23:59:59 UTC"),
            (4_107_542_400, "2100-03-01 00:00:00 UTC"),
        ] {
            assert_eq!(format_date(unix_s), expected);
        }
        assert_eq!(format_for_file_name(1_795_233_599), "20261121-035959");
    }
}
