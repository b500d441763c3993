//! README.md and the pages of `docs/`: the commands, named blocks and file tables that they show, and the commands that
//! sources mention.

use std::fs;
use std::path::{Path, PathBuf};

/// Folder of the workspace.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A text with its place in the workspace.
pub struct Page {
    /// Path below the workspace.
    pub name: String,
    /// Its contents.
    pub text: String,
}

/// A fenced block of a page.
pub struct Block<'a> {
    /// Language behind the fence, such as `sh`.
    pub language: &'a str,
    /// File that the block is, if the line before it ends in its name and a colon.
    pub file: Option<&'a str>,
    /// Number of its first line.
    pub line: usize,
    /// Its lines.
    pub text: String,
}

/// README.md and the pages of `docs/`.
///
/// # Panics
/// If a file cannot be read.
#[must_use]
pub fn pages() -> Vec<Page> {
    let mut pages = vec![read(&root().join("README.md"))];
    gather(&root().join("docs"), &["md"], &mut pages);
    pages
}

/// Sources, examples and bundled files, which mention commands in comments and messages.
///
/// # Panics
/// If a file cannot be read.
#[must_use]
pub fn sources() -> Vec<Page> {
    let mut sources = Vec::new();
    for folder in ["src", "examples", "assets", "bench"] {
        gather(&root().join(folder), &["rs", "toml", "sh"], &mut sources);
    }
    sources
}

fn gather(folder: &Path, endings: &[&str], pages: &mut Vec<Page>) {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.expect("an entry").path())
        .collect();
    paths.sort();
    for path in paths {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        if path.is_dir() {
            gather(&path, endings, pages);
        } else if endings.contains(&ending) {
            pages.push(read(&path));
        }
    }
}

fn read(path: &Path) -> Page {
    let name = path.strip_prefix(root()).expect("below the workspace");
    Page {
        name: name.display().to_string(),
        text: fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())),
    }
}

impl Page {
    /// Its fenced blocks.
    #[must_use]
    pub fn blocks(&self) -> Vec<Block<'_>> {
        let mut blocks: Vec<Block<'_>> = Vec::new();
        let (mut open, mut before) = (false, "");
        for (line, text) in self.text.lines().enumerate() {
            if let Some(language) = text.strip_prefix("```") {
                open = !open;
                if open {
                    let name = before.strip_suffix("`:").and_then(|rest| rest.rsplit('`').next());
                    let file = name.filter(|name| name.contains('.') && !name.contains(' '));
                    blocks.push(Block {
                        language,
                        file,
                        line: line + 2,
                        text: String::new(),
                    });
                }
                before = "";
            } else if open {
                let block = &mut blocks.last_mut().expect("an open block").text;
                block.push_str(text);
                block.push('\n');
            } else if !text.is_empty() {
                before = text;
            }
        }
        blocks
    }

    /// Its text outside fenced blocks, with the number of each line.
    fn prose(&self) -> impl Iterator<Item = (usize, &str)> {
        let mut open = false;
        self.text.lines().enumerate().filter_map(move |(line, text)| {
            let fence = text.starts_with("```");
            open ^= fence;
            (!fence && !open).then_some((line + 1, text))
        })
    }

    /// Spans in backticks outside fenced blocks, each with the number of the line where it ends. In sources a span ends
    /// with its line.
    #[must_use]
    pub fn spans(&self) -> Vec<(usize, String)> {
        let mut spans = Vec::new();
        let mut open: Option<String> = None;
        for (number, line) in self.prose() {
            if line.trim().is_empty() || !self.name.ends_with(".md") {
                open = None;
            }
            for (at, part) in line.split('`').enumerate() {
                if at > 0 {
                    open = match open {
                        Some(span) => {
                            spans.push((number, span));
                            None
                        }
                        None => Some(String::new()),
                    };
                }
                if let Some(span) = &mut open {
                    span.push_str(part);
                }
            }
            if let Some(span) = &mut open {
                span.push(' ');
            }
        }
        spans
    }

    /// The lines of its blocks of shell commands, without comments, each with its number.
    #[must_use]
    pub fn commands(&self) -> Vec<(usize, String)> {
        let mut commands = Vec::new();
        for block in self.blocks().iter().filter(|block| block.language == "sh") {
            let mut whole = String::new();
            for (at, line) in block.text.lines().enumerate() {
                let line = line.split(" # ").next().unwrap_or(line).trim();
                match line.strip_suffix('\\') {
                    Some(begun) => whole.push_str(begun),
                    None if line.is_empty() || line.starts_with('#') => {}
                    None => commands.push((block.line + at, std::mem::take(&mut whole) + line)),
                }
            }
        }
        commands
    }
}

/// The pages, and the bundled files with their comments.
///
/// # Panics
/// If a file cannot be read.
#[must_use]
pub fn texts() -> Vec<Page> {
    let mut texts = pages();
    gather(&root().join("assets"), &["toml"], &mut texts);
    texts
}

impl Page {
    /// Its passages: paragraphs and rows of tables, or a line of a file with the comments that go on below it, each
    /// with the number of its first line.
    fn passages(&self) -> Vec<(usize, String)> {
        let mut passages: Vec<(usize, String)> = Vec::new();
        let mut goes_on = false;
        for (at, line) in self.text.lines().enumerate() {
            let apart = if self.name.ends_with(".md") {
                line.starts_with(['|', '-'])
            } else {
                !line.trim_start().starts_with("# ") && !line.starts_with(' ')
            };
            match passages.last_mut() {
                Some((_, passage)) if goes_on && !apart && !line.trim().is_empty() => *passage += &format!(" {line}"),
                _ => passages.push((at + 1, line.to_owned())),
            }
            goes_on = !line.trim().is_empty();
        }
        passages
    }

    /// Passages that quote most of these names but not all: lists that lack one. Fewer than three names make no list,
    /// and one that refers to `insonify schema`, or is the `only` of a scene, may leave names out.
    #[must_use]
    pub fn incomplete(&self, names: &[String]) -> Vec<String> {
        let lists = self.passages().into_iter().filter_map(|(line, text)| {
            // `insonify calibrate pivot` quotes `pivot`.
            let is_quoted = |name: &&String| {
                let quotes = [format!("`{name}`"), format!("\"{name}\""), format!(" {name}`")];
                quotes.iter().any(|quote| text.contains(quote))
            };
            let lacking: Vec<&str> = names
                .iter()
                .filter(|name| !is_quoted(name))
                .map(String::as_str)
                .collect();
            let quoted = names.len() - lacking.len();
            // `only` is a choice of effects.
            let is_choice = text.contains("only = [") || text.contains("insonify schema");
            let is_list = quoted >= 3 && 2 * quoted > names.len() && !lacking.is_empty() && !is_choice;
            is_list.then(|| format!("{}:{line}: a list lacks {}", self.name, lacking.join(", ")))
        });
        lists.collect()
    }
}

/// The invocations of `insonify` in a line of shell commands, as words, without what the shell takes.
#[must_use]
pub fn invocations(line: &str) -> Vec<Vec<String>> {
    line.split(['|', ';', '&'])
        .map(|command| command.split('>').next().unwrap_or(command).trim())
        .filter_map(|command| {
            let command = command.strip_prefix("cargo run --release -- ").or_else(|| {
                let rest = command.strip_prefix("insonify")?;
                rest.strip_prefix(' ').or_else(|| rest.is_empty().then_some(rest))
            })?;
            Some(
                std::iter::once("insonify".to_owned())
                    .chain(shlex::Shlex::new(command))
                    .collect(),
            )
        })
        .collect()
}
