//! Units of length.

/// Prefixes with their letters, and the millimetres that they make of a metre.
const PREFIXES: [(&str, &str, f64); 8] = [
    ("pico", "p", 1e-9),
    ("nano", "n", 1e-6),
    ("micro", "u", 1e-3),
    ("milli", "m", 1.0),
    ("centi", "c", 10.0),
    ("deci", "d", 100.0),
    ("", "", 1000.0),
    ("kilo", "k", 1e6),
];

/// Millimetres of a unit by its name, in either spelling and number, or its sign; `None` if it is no unit of length.
pub(super) fn millimetres(unit: &str) -> Option<f64> {
    let unit = unit.trim().to_lowercase().replace(['\u{b5}', '\u{3bc}'], "u");
    let name = unit.strip_suffix('s').unwrap_or(&unit);
    if name == "micron" {
        return Some(1e-3);
    }
    if matches!(name, "inch" | "inche" | "in") {
        return Some(25.4);
    }
    PREFIXES.iter().find_map(|(prefix, letter, mm)| {
        let spelled = |word: &str| name.strip_prefix(prefix) == Some(word);
        (spelled("metre") || spelled("meter") || unit == format!("{letter}m")).then_some(*mm)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_have_names_plurals_and_signs() {
        for (units, mm) in [
            (&["m", "metre", "meters", "Meter"][..], 1000.0),
            (&["mm", "MM", "millimeter", "millimetres"], 1.0),
            (&["cm", "centimetre", "centimeters"], 10.0),
            (
                &["um", "µm", "μm", "micron", "microns", "micrometers", "micrometre"],
                1e-3,
            ),
            (&["nm", "nanometres"], 1e-6),
            (&["in", "inch", "inches"], 25.4),
        ] {
            for unit in units {
                assert_eq!(millimetres(unit), Some(mm), "{unit}");
            }
        }
        for other in ["", "s", "ms", "pixel", "mms", "metric", "meterss", "furlong"] {
            assert_eq!(millimetres(other), None, "{other}");
        }
    }
}
