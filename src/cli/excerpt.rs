//! A failure as text: its message, the lines of the file concerned with a mark below the error, and help.

use std::fmt::Write;
use std::iter::repeat_n;

use insonify_base::document::Excerpt;
use unicode_width::UnicodeWidthChar;

/// Columns between tab stops.
const TAB: usize = 4;

/// Colours and attributes of a terminal (parameters of the control sequence SGR, ECMA-48).
const RED: &str = "31";
const CYAN: &str = "36";
const CYAN_UNDERLINED: &str = "36;1;4";
const MAGENTA: &str = "35;1";
const DIM: &str = "2";

/// Encloses text in control sequences, if wanted.
#[derive(Clone, Copy)]
struct Paint(bool);

impl Paint {
    fn styled(self, style: &str, text: &str) -> String {
        if self.0 {
            format!("\x1b[{style}m{text}\x1b[0m")
        } else {
            text.to_owned()
        }
    }
}

/// Returns the text of a failure, each line complete. Message and help are lines without control characters; none is
/// wrapped, which a terminal does itself.
pub(crate) fn drawn(message: &str, help: Option<&str>, excerpt: Option<&Excerpt>, coloured: bool) -> String {
    let paint = Paint(coloured);
    let line = |head: &str, text: &str| format!("{head}{}\n", text.trim_end_matches(' '));
    let mut out = line(&format!("  {} ", paint.styled(RED, "×")), message);
    out.extend(excerpt.map(|excerpt| framed(excerpt, paint)));
    out.extend(help.map(|help| line(&paint.styled(CYAN, "  help: "), help)));
    out
}

/// Numbered lines of a file between a heading, which names file, line and column (from 1), and a foot.
fn framed(excerpt: &Excerpt, paint: Paint) -> String {
    let lines: Vec<&str> = excerpt.text.split_inclusive('\n').collect();
    let last_number = match lines.len() {
        0 => 0,
        count => excerpt.lines_before + count,
    };
    let digits = last_number.to_string().len();
    let margin = " ".repeat(digits + 2);
    let location = format!("{}:{}:{}", excerpt.name, excerpt.line, excerpt.column + 1);
    let mut out = format!("{margin}╭─[{}]\n", paint.styled(CYAN_UNDERLINED, &location));
    let mut begin = 0;
    for (number, line) in (excerpt.lines_before + 1..).zip(lines) {
        let number = paint.styled(DIM, &format!("{number:digits$}"));
        let text = line.trim_end_matches('\n');
        let _ = writeln!(out, " {number} │ {}", expanded(text).0);
        if (begin..begin + line.len()).contains(&excerpt.span.start) {
            let [start, end] = [excerpt.span.start, excerpt.span.end]
                .map(|offset| expanded(&text[..text.floor_char_boundary(offset - begin)]).1);
            for mark in marks(start, end, excerpt.span.is_empty()) {
                let _ = writeln!(out, "{margin}· {}", paint.styled(MAGENTA, &mark));
            }
        }
        begin += line.len();
    }
    out + &format!("{margin}╰────\n")
}

/// Two lines that mark columns from `start` to before `end`, at least one, or a point.
fn marks(start: usize, end: usize, point: bool) -> [String; 2] {
    let end = end.max(start + 1);
    let middle = (start + end) / 2;
    let [left, right] = [middle - start, end - middle - 1].map(|count| "─".repeat(count));
    let stem = if point { '▲' } else { '┬' };
    [
        format!("{:start$}{left}{stem}{right}", ""),
        format!("{:middle$}╰── here", ""),
    ]
}

/// Replaces tabs by spaces up to the next tab stop; also returns the number of columns.
fn expanded(text: &str) -> (String, usize) {
    let (mut out, mut columns) = (String::with_capacity(text.len()), 0);
    for c in text.chars() {
        let width = match c {
            '\t' => TAB - columns % TAB,
            c => c.width().unwrap_or(0),
        };
        match c {
            '\t' => out.extend(repeat_n(' ', width)),
            c => out.push(c),
        }
        columns += width;
    }
    (out, columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An excerpt whose error, enclosed in `«»`, is in its first or second line.
    fn excerpt(lines_before: usize, text: &str) -> Excerpt {
        let start = text.find('«').expect("a beginning");
        let end = text.find('»').expect("an end") - '«'.len_utf8();
        let begin = text[..start].rfind('\n').map_or(0, |feed| feed + 1);
        Excerpt {
            name: "a.toml".to_owned(),
            line: lines_before + 1 + text[..start].matches('\n').count(),
            column: text[begin..start].chars().count(),
            text: text.replace(['«', '»'], ""),
            lines_before,
            span: start..end,
        }
    }

    #[test]
    fn marks_are_below_the_error() {
        let cases = [
            (
                excerpt(0, "[volume]\nphantom = «\"spleen\"»\nseed = 3"),
                "   ╭─[a.toml:2:11]
 1 │ [volume]
 2 │ phantom = \"spleen\"
   ·           ────┬───
   ·               ╰── here
 3 │ seed = 3
   ╰────
",
            ),
            // A point at the end of a line, which takes a column of its own.
            (
                excerpt(0, "[volume«»\n"),
                "   ╭─[a.toml:1:8]
 1 │ [volume
   ·        ▲
   ·        ╰── here
   ╰────
",
            ),
            // Behind the last line there is no place.
            (
                excerpt(0, "[volume«»"),
                "   ╭─[a.toml:1:8]
 1 │ [volume
   ╰────
",
            ),
            // Numbers of one and two digits, an empty line, characters of two columns and of none.
            (
                excerpt(8, "\n漢e\u{301} = «漢字»x\n"),
                "    ╭─[a.toml:10:7]
  9 │ \n 10 │ 漢e\u{301} = 漢字x
    ·       ──┬─
    ·         ╰── here
    ╰────
",
            ),
            // A tab reaches to the next multiple of four columns.
            (
                excerpt(0, "a\tb\t=«\t»1"),
                "   ╭─[a.toml:1:6]
 1 │ a   b   =   1
   ·          ─┬─
   ·           ╰── here
   ╰────
",
            ),
            // An error without a column of its own.
            (
                excerpt(0, "e«\u{301}» = 1"),
                "   ╭─[a.toml:1:2]
 1 │ e\u{301} = 1
   ·  ┬
   ·  ╰── here
   ╰────
",
            ),
            (
                Excerpt {
                    name: "a.toml".to_owned(),
                    line: 1,
                    column: 0,
                    text: String::new(),
                    lines_before: 0,
                    span: 0..0,
                },
                "   ╭─[a.toml:1:1]
   ╰────
",
            ),
        ];
        for (excerpt, expected) in cases {
            let text = drawn("wrong", None, Some(&excerpt), false);
            assert_eq!(text, format!("  × wrong\n{expected}"));
        }
    }

    #[test]
    fn help_follows_and_lines_are_neither_wrapped_nor_padded() {
        let long = "word ".repeat(400);
        let expected = format!("  × {}\n  help: a b\n", long.trim_end());
        assert_eq!(drawn(&long, Some("a b  "), None, false), expected);
        assert_eq!(drawn("", None, None, false), "  × \n");
    }

    #[test]
    fn colours_enclose_parts_of_the_text_and_end() {
        let excerpt = excerpt(0, "«a» = 1");
        let text = drawn("wrong", Some("right"), Some(&excerpt), true);
        let expected = "  \x1b[31m×\x1b[0m wrong
   ╭─[\x1b[36;1;4ma.toml:1:1\x1b[0m]
 \x1b[2m1\x1b[0m │ a = 1
   · \x1b[35;1m┬\x1b[0m
   · \x1b[35;1m╰── here\x1b[0m
   ╰────
\x1b[36m  help: \x1b[0mright
";
        assert_eq!(text, expected);
    }
}
