//! When a light group is lit: on-intervals as typed, and normalised.

use super::raw::Value;
use dataset::Result;

/// Lit all day.
pub(super) const ALWAYS: [f64; 2] = [0.0, 24.0];

const EXPECTED: &str = r#""always", or a list of [from, to] as "HH:MM" or hours, e.g. [["18:00", "06:00"]]"#;

/// Reads `on`: `"always"`, or a list of intervals.
pub(super) fn read(value: &Value) -> Result<Vec<[f64; 2]>> {
    if value.is_text() {
        return match value.text(EXPECTED)? {
            "always" => Ok(vec![ALWAYS]),
            _ => Err(value.error(format!("expected {EXPECTED}"))),
        };
    }
    let mut intervals = Vec::new();
    for interval in value.array(EXPECTED)? {
        let ends = interval.array(EXPECTED)?;
        let [from, to] = &ends[..] else { return Err(interval.error("expected [from, to]")) };
        let (from, to) = (hour(from, false)?, hour(to, true)?);
        if from == to {
            return Err(interval.error(r#"expected two different hours; use on = "always" for all day"#));
        }
        intervals.push([from, to]);
    }
    if intervals.is_empty() {
        return Err(value.error("expected at least one interval"));
    }
    Ok(normalise(&intervals))
}

/// An hour as a number or `HH:MM[:SS]`, rounded to 10⁻⁹; 24 only where an interval ends.
fn hour(value: &Value, end: bool) -> Result<f64> {
    let expected =
        if end { r#""HH:MM" or hours, 0 to 24"# } else { r#""HH:MM" or hours, from 0 to below 24"# };
    let hours = match value.text(expected) {
        Ok(text) => clock(text).ok_or_else(|| value.error(format!("expected {expected}")))?,
        Err(_) => value.number(expected, |_| true)?,
    };
    let hours = (hours * 1e9).round() / 1e9;
    if (0.0..24.0).contains(&hours) || (end && hours == 24.0) {
        Ok(hours)
    } else {
        Err(value.error(format!("expected {expected}")))
    }
}

/// Hours of `HH:MM` or `HH:MM:SS`.
fn clock(text: &str) -> Option<f64> {
    let mut fields = text.split(':').map(|field| {
        let digits = (1..=2).contains(&field.len()) && field.bytes().all(|b| b.is_ascii_digit());
        digits.then(|| field.parse::<u32>().ok()).flatten()
    });
    let (h, m) = (fields.next()??, fields.next()??);
    let s = match fields.next() {
        Some(seconds) => seconds?,
        None => 0,
    };
    let ok = fields.next().is_none() && m < 60 && s < 60 && h * 3600 + m * 60 + s <= 24 * 3600;
    ok.then(|| f64::from(h) + f64::from(m) / 60.0 + f64::from(s) / 3600.0)
}

/// Merges overlapping and touching intervals of the day's circle; sorted, the one across midnight last as
/// `from > to`.
fn normalise(intervals: &[[f64; 2]]) -> Vec<[f64; 2]> {
    // Cut at midnight.
    let mut pieces: Vec<[f64; 2]> = intervals
        .iter()
        .flat_map(|&[from, to]| if from < to { vec![[from, to]] } else { vec![[from, 24.0], [0.0, to]] })
        .filter(|[from, to]| from < to)
        .collect();
    pieces.sort_by(|a, b| a[0].total_cmp(&b[0]));
    // Merge along the day.
    let mut merged: Vec<[f64; 2]> = Vec::new();
    for [from, to] in pieces {
        match merged.last_mut() {
            Some(last) if from <= last[1] => last[1] = last[1].max(to),
            _ => merged.push([from, to]),
        }
    }
    // Join what touches at midnight.
    if merged.len() > 1 && merged[0][0] == 0.0 && merged[merged.len() - 1][1] == 24.0 {
        let morning = merged.remove(0);
        let last = merged.len() - 1;
        merged[last][1] = morning[1];
    }
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_merge_on_the_circle() {
        assert_eq!(normalise(&[[18.0, 6.0]]), [[18.0, 6.0]]);
        assert_eq!(normalise(&[[18.0, 24.0], [0.0, 6.0]]), [[18.0, 6.0]]);
        assert_eq!(
            normalise(&[[20.0, 22.0], [6.0, 8.0], [8.0, 9.0], [7.0, 7.5]]),
            [[6.0, 9.0], [20.0, 22.0]]
        );
        assert_eq!(normalise(&[[22.0, 3.0], [2.0, 5.0], [12.0, 13.0]]), [[12.0, 13.0], [22.0, 5.0]]);
        assert_eq!(normalise(&[[18.0, 6.0], [5.0, 19.0]]), [ALWAYS]);
        assert_eq!(normalise(&[[12.0, 24.0], [0.0, 12.0]]), [ALWAYS]);
        assert_eq!(normalise(&[[18.0, 0.0]]), [[18.0, 24.0]]);
    }

    #[test]
    fn clock_times_are_parsed() {
        assert_eq!(clock("06:30"), Some(6.5));
        assert_eq!(clock("24:00"), Some(24.0));
        assert_eq!(clock("18:00:36").map(|h| (h * 1e9).round() / 1e9), Some(18.01));
        for bad in
            ["", "6", "06:60", "25:00", "24:01", "06:30:00:00", "-1:30", "a:b", "06:", "006:00", "+6:00"]
        {
            assert_eq!(clock(bad), None, "{bad}");
        }
    }
}
