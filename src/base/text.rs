//! Text from files for a terminal, with control characters escaped and long text truncated, and for HTML and XML.

use std::borrow::Cow;

use unicode_width::{UnicodeWidthChar, UnicodeWidthStr};

/// Maximum length of a message about a file, columns.
pub const MESSAGE: usize = 2000;
/// Maximum width of a name in a table, columns.
pub const WIDEST_NAME: usize = 48;
const ELLIPSIS: char = '…';

/// Whether a character changes how a terminal shows others: controls, and marks that change the writing direction.
fn is_control(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns the text with control characters escaped, except line feeds and tabs.
pub fn printable(text: &str) -> Cow<'_, str> {
    let foreign = |c: char| is_control(c) && !matches!(c, '\n' | '\t');
    if !text.contains(foreign) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if foreign(c) {
            out.extend(c.escape_default())
        } else {
            out.push(c)
        }
    }
    Cow::Owned(out)
}

/// Escapes text for HTML and for attributes of XML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Resolves the entities of XML.
pub fn unescape(text: &str) -> String {
    text.replace("&lt;", "<")
        .replace("&gt;", ">")
        .replace("&quot;", "\"")
        .replace("&apos;", "'")
        .replace("&amp;", "&")
}

/// Returns one line of at most `columns` columns: control characters escaped, tabs as spaces, the end truncated.
pub fn head(text: &str, columns: usize) -> String {
    match fitting(text.chars(), columns) {
        (all, true) => all.concat(),
        _ => fitting(text.chars(), columns - 1).0.concat() + &ELLIPSIS.to_string(),
    }
}

/// Returns one line as [`head`] does, with the beginning truncated.
pub fn tail(text: &str, columns: usize) -> String {
    let (mut parts, whole) = fitting(text.chars().rev(), columns);
    if !whole {
        parts = fitting(text.chars().rev(), columns - 1).0;
        parts.push(ELLIPSIS.to_string());
    }
    parts.into_iter().rev().collect()
}

/// Returns one line as [`head`] does, with the middle cut out and numbers of very many digits in scientific
/// notation.
pub fn clipped(text: &str, columns: usize) -> String {
    let end = |room| {
        fitting(text.chars().rev(), room)
            .0
            .into_iter()
            .rev()
            .collect::<String>()
    };
    shortened(&match fitting(text.chars(), columns) {
        (all, true) => all.concat(),
        _ => head(text, columns / 2) + &end(columns / 2),
    })
}

/// Lists the first names and the number of the others.
pub fn some_of(names: &[String]) -> String {
    first_of(names, 16, ", ")
}

/// Lists the first `shown` texts and the number of the others.
pub fn first_of(texts: &[String], shown: usize, between: &str) -> String {
    match texts.len().saturating_sub(shown) {
        0 => texts.join(between),
        more => format!("{} and {more} more", texts[..shown].join(between)),
    }
}

/// Formats a left-aligned table column: the heading, then the names, padded to one width.
pub fn column<'a>(heading: &'a str, names: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut cells: Vec<String> = std::iter::once(heading)
        .chain(names)
        .map(|name| head(name, WIDEST_NAME))
        .collect();
    let width = cells.iter().map(|cell| cell.width()).max().unwrap_or(0);
    for cell in &mut cells {
        let missing = width - cell.width();
        cell.extend(std::iter::repeat_n(' ', missing));
    }
    cells
}

/// Writes numbers with too many digits to read, such as 1e308 written out, in scientific notation.
fn shortened(text: &str) -> String {
    const DIGITS: usize = 40;
    let of_number = |c: char| c.is_ascii_digit() || c == '.';
    let parts = text.split_inclusive(|c| !of_number(c)).map(|part| {
        let number = part.trim_end_matches(|c| !of_number(c));
        match number.parse::<f64>() {
            Ok(value) if number.len() > DIGITS && value.is_finite() => format!("{value:e}{}", &part[number.len()..]),
            _ => part.to_owned(),
        }
    });
    parts.collect()
}

/// Returns the first characters as displayed, and whether all of them fit.
fn fitting(chars: impl Iterator<Item = char>, columns: usize) -> (Vec<String>, bool) {
    let (mut parts, mut used) = (Vec::new(), 0);
    for c in chars {
        let (part, width) = match c {
            '\t' => (" ".to_owned(), 1),
            c if is_control(c) => (c.escape_default().to_string(), c.escape_default().count()),
            // Zero-width marks count too: any number of them may follow a letter.
            c => (c.to_string(), c.width().unwrap_or(1).max(1)),
        };
        used += width;
        if used > columns {
            return (parts, false);
        }
        parts.push(part);
    }
    (parts, true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn controls_are_escaped_and_words_are_not() {
        assert_eq!(
            printable("a\u{1b}[2J\u{9b}\u{202e}\u{7f}\r\n\tÄ"),
            "a\\u{1b}[2J\\u{9b}\\u{202e}\\u{7f}\\r\n\tÄ"
        );
        assert_eq!(head("a\nerror: b\tc", 40), "a\\nerror: b c");
    }

    #[test]
    fn long_text_is_cut_where_asked() {
        assert_eq!(head("abcdef", 6), "abcdef");
        assert_eq!(head("abcdefg", 6), "abcde…");
        assert_eq!(tail("abcdefg", 6), "…cdefg");
        assert_eq!(clipped("abcdefgh", 6), "ab…fgh");
        assert_eq!(clipped(&format!("a = {}, 0.5", -1e308), 900), "a = -1e308, 0.5");
        assert_eq!(clipped(&format!("{} mm", 1e-300), 900), "1e-300 mm");
        assert_eq!(head("漢字漢字", 5), "漢字…");
        assert_eq!(head(&"\u{301}".repeat(1000), 5).chars().count(), 5);
        assert_eq!(tail("ab\u{1b}", 4), "…");
    }

    #[test]
    fn a_column_is_as_wide_as_its_widest_name_and_bounded() {
        assert_eq!(column("name", ["漢字", "liver"]), ["name ", "漢字 ", "liver"]);
        let long = "x".repeat(70_000);
        let cells = column("name", [long.as_str(), ""]);
        assert!(cells.iter().all(|cell| cell.width() == WIDEST_NAME), "{cells:?}");
    }
}
