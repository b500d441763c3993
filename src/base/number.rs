//! Numbers as text.

/// Fraction of a linear axis below which a tick is the rounding error of zero.
pub const ZERO: f64 = 1e-9;

/// Largest number that a text file may state, in any unit: products of several stay finite.
pub const LARGEST: f64 = 1e30;

/// Parses a number of a text file; `None` unless it is finite and at most [`LARGEST`] in size.
pub fn parsed(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.abs() <= LARGEST)
}

/// Returns the number of decimals that three significant digits take, at most `limit`.
fn decimals(value: f64, limit: f64) -> usize {
    (2.0 - value.abs().log10().floor()).clamp(0.0, limit) as usize
}

/// Formats a number with three significant digits and at most three decimals.
pub fn fixed(value: f64) -> String {
    format!("{value:.*}", decimals(value, 3.0))
}

/// Formats a number with three significant digits, with a power of ten if it is small or large.
pub fn significant(value: f64) -> String {
    match value.abs().log10().floor() {
        _ if value == 0.0 => "0".to_owned(),
        -3.0..6.0 => format!("{value:.*}", decimals(value, 5.0)),
        _ => format!("{value:.1e}"),
    }
}

/// Formats a number as [`significant`] does, but integers in full, in groups of three digits from 10,000 on.
pub fn grouped(value: f64) -> String {
    if value.fract() != 0.0 || value.abs() >= 1e12 {
        return significant(value);
    }
    let digits = format!("{:.0}", value.abs());
    let mut text = if value < 0.0 { "-" } else { "" }.to_owned();
    for (index, digit) in digits.chars().enumerate() {
        if digits.len() > 4 && index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Formats a tick label: in scientific notation if it would be long, and 0 up to `smallest`.
pub fn tick(value: f64, smallest: f64) -> String {
    match value.abs().log10().floor() {
        _ if value.abs() <= smallest => "0".to_owned(),
        -3.0..5.0 => {
            let text = format!("{value:.*}", decimals(value, 5.0));
            if text.contains('.') {
                text.trim_end_matches('0').trim_end_matches('.').to_owned()
            } else {
                text
            }
        }
        _ => format!("{value:.0e}"),
    }
}

/// Formats an error beside its limit: integers in full, otherwise three decimals, or one with a power of ten.
pub fn figure(value: f64) -> String {
    match value.abs() {
        0.0 => "0".to_owned(),
        1e-2..1e5 if value.fract() == 0.0 => format!("{value:.0}"),
        1e-2..1e5 => format!("{value:.3}"),
        _ => format!("{value:.1e}"),
    }
}

/// Formats a time in ms.
pub fn milliseconds(ms: f64) -> String {
    format!("{ms:.*}", if ms.abs() < 10.0 { 2 } else { 0 })
}

/// Formats with `digits` decimals, at most six, of a number rounded to six, so that no negative zero appears.
pub fn decimal(value: f64, digits: usize) -> String {
    format!("{:.digits$}", (value * 1e6).round() / 1e6 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_files_are_finite_and_not_too_large() {
        for (text, number) in [("1e30", Some(1e30)), ("-2.5", Some(-2.5)), ("0", Some(0.0))] {
            assert_eq!(parsed(text), number);
        }
        for text in ["inf", "-inf", "nan", "1e999", "1.1e30", "-1e308", "", "1,5", " 1"] {
            assert_eq!(parsed(text), None, "{text}");
        }
    }

    #[test]
    fn ticks_are_short() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (0.25, "0.25"),
            (0.001, "0.001"),
            (1e-12, "1e-12"),
            (1500.0, "1500"),
            (1e5, "1e5"),
        ];
        for (value, text) in cases {
            assert_eq!(tick(value, 0.0), text);
        }
    }

    #[test]
    fn three_digits_are_shown() {
        assert_eq!(
            [0.0, 0.1234, 12.34, 1234.5].map(fixed),
            ["0.000", "0.123", "12.3", "1234"]
        );
        assert_eq!(
            [0.0, 0.00123, 12.34, 123_456.0, 1e-4, 1e6].map(significant),
            ["0", "0.00123", "12.3", "123456", "1.0e-4", "1.0e6"]
        );
        assert_eq!(
            [-12_345.0, 123_456.0, 1234.0, 1.5].map(grouped),
            ["-12,345", "123,456", "1234", "1.50"]
        );
        assert_eq!(
            [0.0, 3.0, 0.5, 1e-9, f64::NAN].map(figure),
            ["0", "3", "0.500", "1.0e-9", "NaN"]
        );
        assert_eq!([1.234, 16.7].map(milliseconds), ["1.23", "17"]);
        assert_eq!(decimal(-1e-9, 6), "0.000000");
    }
}
