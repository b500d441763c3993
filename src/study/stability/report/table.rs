//! Aligned text table with wrapped cells.

use std::fmt;

/// Table whose columns are separated by two blanks.
pub struct Table<const N: usize> {
    widths: [usize; N],
    rows: Vec<[Vec<String>; N]>,
}

impl<const N: usize> Table<N> {
    /// Creates a table of columns with the given headings and widths in characters.
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

/// Wraps text at blanks into lines of at most `width` characters; a longer word gets a line of its own.
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
