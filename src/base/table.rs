//! Tables of formatted cells, as text, Markdown, CSV and HTML.

use crate::text::escape;

/// Table cell, or heading of a column.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Text, aligned as its column.
    Plain(String),
    /// Left-aligned text, whatever its column.
    Text(String),
    /// Left-aligned text with a softer second line.
    Pair(String, String),
    /// Right-aligned number; as a heading, that of a column of numbers.
    Number(String),
    /// Heading of a column of numbers, with an explanation.
    Explained(String, String),
    /// Small labels, each with its CSS class.
    Tags(Vec<(&'static str, String)>),
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Cell::Plain(text.into())
    }
}

impl Cell {
    /// Creates a number, or the heading of a column of numbers.
    pub fn number(text: impl Into<String>) -> Self {
        Cell::Number(text.into())
    }

    /// Returns whether the cell heads a column of numbers.
    fn is_number(&self) -> bool {
        matches!(self, Cell::Number(_) | Cell::Explained(..))
    }

    /// Returns the main text of the cell.
    fn words(&self) -> String {
        match self {
            Cell::Plain(text) | Cell::Text(text) | Cell::Pair(text, _) | Cell::Number(text) => text.clone(),
            Cell::Explained(text, _) => text.clone(),
            Cell::Tags(tags) => {
                let tags: Vec<&str> = tags.iter().map(|(_, tag)| tag.as_str()).collect();
                tags.join(", ")
            }
        }
    }

    /// Returns the cell as an HTML element with the given name and attributes, in a column of numbers or of text.
    fn html(&self, name: &str, attributes: &str, number: bool) -> String {
        let whole = |inner: &str, class: &str| format!("<{name}{class}{attributes}>{inner}</{name}>");
        match self {
            Cell::Plain(text) if number => whole(&unbroken(text), " class=\"n\""),
            Cell::Number(text) => whole(&unbroken(text), " class=\"n\""),
            Cell::Plain(text) | Cell::Text(text) => whole(&unbroken(text), ""),
            Cell::Pair(text, below) => {
                let [text, below] = [text, below].map(|part| unbroken(part));
                whole(&format!("{text}<br><small class=\"soft\">{below}</small>"), "")
            }
            Cell::Explained(text, meaning) => {
                whole(&escape(text), &format!(" class=\"n\" title=\"{}\"", escape(meaning)))
            }
            Cell::Tags(tags) => {
                let tags = tags
                    .iter()
                    .map(|(class, text)| format!("<span class=\"tag {class}\">{}</span>", escape(text)));
                whole(&tags.collect::<Vec<_>>().join(" "), "")
            }
        }
    }
}

/// Replaces spaces within products such as 256 x 512 so that they do not break across lines.
fn unbroken(text: &str) -> String {
    let mut joined = String::new();
    for (index, part) in text.split(" x ").enumerate() {
        if index > 0 {
            let is_digit = |character: char| character.is_ascii_digit();
            let numbers = joined.ends_with(is_digit) && part.starts_with(is_digit);
            joined += if numbers { "\u{a0}x\u{a0}" } else { " x " };
        }
        joined += part;
    }
    escape(&joined)
}

/// Table: headings of its columns, and rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    head: Vec<Cell>,
    rows: Vec<(&'static str, Vec<Cell>)>,
}

impl Table {
    /// Creates a table without rows.
    pub fn new<C: Into<Cell>>(head: impl IntoIterator<Item = C>) -> Self {
        Table {
            head: head.into_iter().map(C::into).collect(),
            rows: Vec::new(),
        }
    }

    /// Returns the table with more rows.
    pub fn with<C: Into<Cell>, R: IntoIterator<Item = C>>(mut self, rows: impl IntoIterator<Item = R>) -> Self {
        rows.into_iter().for_each(|row| self.row("", row));
        self
    }

    /// Adds a row with a CSS class.
    pub fn row<C: Into<Cell>>(&mut self, class: &'static str, cells: impl IntoIterator<Item = C>) {
        self.rows.push((class, cells.into_iter().map(C::into).collect()));
    }

    /// Returns whether the table has no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Returns the table as text, its columns separated by `gap`: of the given widths, or as wide as their longest cell
    /// where that is 0 or not given.
    pub fn text(&self, gap: &str, widths: &[usize]) -> String {
        let words = |row: &Vec<Cell>| row.iter().map(Cell::words).collect::<Vec<_>>();
        let lines: Vec<Vec<String>> = std::iter::once(&self.head)
            .chain(self.rows.iter().map(|(_, row)| row))
            .map(words)
            .collect();
        let width = |column: usize| match widths.get(column) {
            None | Some(0) => {
                let cells = lines.iter().filter_map(|line| line.get(column));
                cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
            }
            Some(width) => *width,
        };
        let widths: Vec<usize> = (0..self.head.len()).map(width).collect();
        let mut text = String::new();
        for line in &lines {
            let cells = line.iter().zip(self.head.iter().zip(&widths));
            let cells = cells.map(|(cell, (head, &width))| {
                if head.is_number() {
                    format!("{cell:>width$}")
                } else {
                    format!("{cell:<width$}")
                }
            });
            text += cells.collect::<Vec<_>>().join(gap).trim_end();
            text.push('\n');
        }
        text
    }

    /// Returns the table as text with a rule below the headings, cells wrapped to the widths of their columns.
    pub fn wrapped(&self, widths: &[usize]) -> String {
        let rule = widths.iter().map(|width| Cell::from("-".repeat(*width))).collect();
        let rows = self.rows.iter().map(|(_, row)| row);
        let mut text = String::new();
        for row in [&self.head, &rule].into_iter().chain(rows) {
            let cells = row.iter().zip(widths);
            let cells: Vec<_> = cells
                .map(|(cell, width)| wrapped(&cell.words(), *width, false))
                .collect();
            for line in 0..cells.iter().map(Vec::len).max().unwrap_or(0) {
                let parts = cells.iter().zip(widths).map(|(cell, width)| {
                    let part = cell.get(line).map_or("", String::as_str);
                    format!("  {part:<width$}")
                });
                text += parts.collect::<String>().trim_end();
                text.push('\n');
            }
        }
        text
    }

    /// Returns the table in Markdown.
    pub fn markdown(&self) -> String {
        let line = |cells: &[Cell]| {
            let cells = cells
                .iter()
                .map(|cell| cell.words().replace('|', "\\|").replace('\n', " "));
            format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
        };
        let rule = self
            .head
            .iter()
            .map(|head| if head.is_number() { "---:|" } else { "---|" });
        let rows = self.rows.iter().map(|(_, row)| line(row));
        format!(
            "{}|{}\n{}",
            line(&self.head),
            rule.collect::<String>(),
            rows.collect::<String>()
        )
    }

    /// Returns comma-separated values with a header.
    pub fn csv(&self) -> String {
        let rows = self.rows.iter().map(|(_, row)| row);
        let line = |row: &Vec<Cell>| {
            row.iter()
                .map(|cell| quoted(&cell.words()))
                .collect::<Vec<_>>()
                .join(",")
                + "\n"
        };
        std::iter::once(&self.head).chain(rows).map(line).collect()
    }

    /// Returns the table in HTML. With `stacked`, its rows become blocks on a narrow screen, with the first cell as
    /// heading.
    pub fn html(&self, stacked: bool) -> String {
        let class = if stacked { "stack" } else { "" };
        let head: String = self.head.iter().map(|cell| cell.html("th", "", false)).collect();
        let mut html =
            format!("<div class=\"wide\"><table class=\"{class}\">\n<thead><tr>{head}</tr></thead><tbody>\n");
        for (class, cells) in &self.rows {
            let cells = cells.iter().zip(&self.head).map(|(cell, head)| {
                // In block layout, each cell carries its column's heading.
                let label = match head.words() {
                    words if stacked && !words.is_empty() => format!(" data-label=\"{}\"", escape(&words)),
                    _ => String::new(),
                };
                cell.html("td", &label, head.is_number())
            });
            html += &format!("<tr class=\"{class}\">{}</tr>\n", cells.collect::<String>());
        }
        html + "</tbody></table></div>"
    }
}

/// Quotes a cell of comma-separated values where necessary.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// Wraps text at blanks into lines of at most `width` characters; a longer word is `cut`, or gets a line of its own.
pub fn wrapped(text: &str, width: usize, cut: bool) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let letters: Vec<char> = word.chars().collect();
        for piece in letters.chunks(if cut { width } else { usize::MAX }) {
            match lines.last_mut() {
                Some(line) if line.is_empty() => line.extend(piece),
                Some(line) if line.chars().count() + 1 + piece.len() <= width => {
                    line.push(' ');
                    line.extend(piece);
                }
                _ => lines.push(piece.iter().collect()),
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let head = [Cell::from("way"), Cell::number("time, ms"), Cell::from("")];
        let mut table = Table::new(head).with([["slow | exact", "10", ""], ["fast, \"x\"", "1.5", "best"]]);
        table.row(
            "wrong",
            [
                Cell::from("256 x 512"),
                Cell::Text("none".to_owned()),
                Cell::Tags(vec![("bad", "off".to_owned())]),
            ],
        );
        table
    }

    #[test]
    fn text_aligns_columns_and_trims_lines() {
        let expected = "way           time, ms\nslow | exact        10\nfast, \"x\"          1.5  best\n256 x 512         none  off\n";
        assert_eq!(table().text("  ", &[]), expected);
        let expected = "way       ms\na      1.000\nlonger 1.000\n";
        let head = || [Cell::from("way"), Cell::number("ms")];
        let table = Table::new(head()).with([["a", "1.000"], ["longer", "1.000"]]);
        assert_eq!(table.text(" ", &[6, 0]), expected);
        let wrapped = Table::new(["what", "is"]).with([["two words", "it"]]);
        assert_eq!(
            wrapped.wrapped(&[5, 2]),
            "  what   is\n  -----  --\n  two    it\n  words\n"
        );
    }

    #[test]
    fn markdown_csv_and_html_escape_what_they_show() {
        let table = table();
        assert!(
            table
                .markdown()
                .starts_with("| way | time, ms |  |\n|---|---:|---|\n| slow \\| exact | 10 |  |\n")
        );
        assert!(table.csv().contains("\"fast, \"\"x\"\"\",1.5,best\n"));
        let html = table.html(true);
        for part in [
            "<th class=\"n\">time, ms</th>",
            "<td class=\"n\" data-label=\"time, ms\">1.5</td>",
            "<tr class=\"wrong\"><td data-label=\"way\">256\u{a0}x\u{a0}512</td><td data-label=\"time, ms\">none</td>",
            "<td><span class=\"tag bad\">off</span></td>",
            "fast, &quot;x&quot;",
        ] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }
}
