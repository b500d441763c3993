//! An aligned table of text whose cells wrap.

use std::fmt;

/// Columns between which two blanks stand.
pub struct Table<const N: usize> {
    widths: [usize; N],
    rows: Vec<[Vec<String>; N]>,
}

impl<const N: usize> Table<N> {
    /// A table of columns with these headings, each so many characters wide.
    pub fn new(headings: [&str; N], widths: [usize; N]) -> Self {
        let mut table = Table {
            widths,
            rows: Vec::new(),
        };
        table.row(headings);
        table.rows.push(widths.map(|width| vec!["-".repeat(width)]));
        table
    }

    /// Adds a row.
    pub fn row(&mut self, cells: [&str; N]) {
        self.rows.push(std::array::from_fn(|column| {
            wrapped(cells[column], self.widths[column])
        }));
    }
}

/// Lines of at most `width` characters, broken at blanks; a longer word stands alone.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let Some(line) = lines.last_mut() else { break };
        if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(word.to_owned());
        } else {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

impl<const N: usize> fmt::Display for Table<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for row in &self.rows {
            let height = row.iter().map(Vec::len).max().unwrap_or(0);
            for line in 0..height {
                let mut text = String::new();
                for (cell, width) in row.iter().zip(self.widths) {
                    let part = cell.get(line).map_or("", String::as_str);
                    text.push_str(&format!("  {part:<width$}"));
                }
                writeln!(f, "{}", text.trim_end())?;
            }
        }
        Ok(())
    }
}
