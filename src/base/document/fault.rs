//! Error of a file with its key and position.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use super::{Setting, Source};
use crate::blame::Blame;
use crate::text::{MESSAGE, clipped, head, printable, tail};

/// An error of an input file: its cause, the key concerned and the place in the text.
///
/// As text it names key, file and line; the command shows the line with a mark below it.
#[derive(Debug)]
pub struct InputError(Box<Inner>);

#[derive(Debug)]
struct Inner {
    cause: Box<dyn Blame>,
    key: Option<String>,
    /// Name of the file, or the option that sets the key.
    file: Option<String>,
    /// Position of the key in the file.
    place: Option<Excerpt>,
    help: Option<String>,
}

/// The line of an error with its context, shortened to a readable length.
#[derive(Debug)]
pub struct Excerpt {
    /// Name of the file.
    pub name: String,
    /// The line in the file, from 1.
    pub line: usize,
    /// Number of characters before the error in its line.
    pub column: usize,
    /// One to three lines: that of the error and those around it.
    pub text: String,
    /// Number of lines of the file before the excerpt.
    pub lines_before: usize,
    /// Bytes of the error in the excerpt.
    pub span: Range<usize>,
}

impl InputError {
    /// An error whose key and place are not known.
    pub fn new(cause: impl Blame) -> Self {
        Self(Box::new(Inner {
            cause: Box::new(cause),
            key: None,
            file: None,
            place: None,
            help: None,
        }))
    }

    pub(crate) fn in_text(mut self, source: &Arc<Source>, span: Option<Range<usize>>) -> Self {
        let setting = span.as_ref().and_then(|span| source.setting_at(span.start));
        let name = setting.map_or(source.name.as_str(), Setting::option);
        self.0.file = (!name.is_empty()).then(|| name.to_owned());
        let in_file = span.filter(|_| setting.is_none() && source.is_file());
        self.0.place = in_file.map(|span| Excerpt::new(source, &span));
        self
    }

    /// Attaches a key such as `effects.speckle.axial_mm`, with its position if there is a source text.
    pub fn at_key(mut self, key: impl Into<String>, source: Option<&Arc<Source>>) -> Self {
        let key = key.into();
        if let Some(source) = source {
            self = self.in_text(source, source.find(&key));
        }
        self.0.key = Some(key);
        self
    }

    /// Sets what to write instead, if it can be guessed.
    pub fn with_help(mut self, help: Option<String>) -> Self {
        self.0.help = help;
        self
    }

    /// Cause of the error.
    pub fn cause(&self) -> &dyn Blame {
        &*self.0.cause
    }

    /// Path of the key concerned, such as `effects.speckle.axial_mm`, if any.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// What to write instead, if it can be guessed.
    pub fn help(&self) -> Option<&str> {
        self.0.help.as_deref()
    }

    /// The lines of the file around the error, if it has a place in one.
    pub fn excerpt(&self) -> Option<&Excerpt> {
        self.0.place.as_ref()
    }

    /// Name of the file and line (from 1) of the key, if it is written in a file.
    pub fn location(&self) -> Option<(&str, usize)> {
        self.0.place.as_ref().map(|place| (place.name.as_str(), place.line))
    }
}

impl fmt::Display for InputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(key) = &self.0.key {
            write!(f, "{key}: ")?;
        }
        f.write_str(&clipped(&self.0.cause.to_string(), MESSAGE / 4))?;
        match self.location() {
            Some((name, line)) => write!(f, " ({name}, line {line})"),
            None => self.0.file.as_ref().map_or(Ok(()), |name| write!(f, " ({name})")),
        }
    }
}

impl std::error::Error for InputError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.cause.source()
    }
}

impl Blame for InputError {
    fn is_machine(&self) -> bool {
        self.0.cause.is_machine()
    }

    fn input(&self) -> Option<&InputError> {
        Some(self)
    }
}

impl Excerpt {
    fn new(source: &Source, span: &Range<usize>) -> Self {
        /// Maximum columns of text before an error, of the error, after it, and of another line.
        const SHOWN: [usize; 4] = [40, 60, 40, 120];
        let text = source.text.as_str();
        let start = text.floor_char_boundary(span.start);
        let begin = text[..start].rfind('\n').map_or(0, |feed| feed + 1);
        let until_feed = |from: usize| text[from..].find('\n').map_or(text.len(), |feed| from + feed);
        let end = until_feed(start);
        let fault_end = text.ceil_char_boundary(span.end).clamp(start, end);
        let whole = |line: &str| head(line.trim_end_matches('\r'), SHOWN[3]);
        let before = begin.checked_sub(1).map(|feed| {
            let from = text[..feed].rfind('\n').map_or(0, |feed| feed + 1);
            whole(&text[from..feed]) + "\n"
        });
        let after = (end < text.len()).then(|| "\n".to_owned() + &whole(&text[end + 1..until_feed(end + 1)]));
        let line = source.line(start);
        let mut shown = before.clone().unwrap_or_default() + &tail(&text[begin..start], SHOWN[0]);
        let first = shown.len();
        shown += &head(&text[start..fault_end], SHOWN[1]);
        let span = first..shown.len();
        shown += &head(text[fault_end..end].trim_end_matches('\r'), SHOWN[2]);
        shown += &after.unwrap_or_default();
        Self {
            name: printable(&source.name).into_owned(),
            line,
            column: text[begin..start].chars().count(),
            lines_before: line - 1 - usize::from(before.is_some()),
            text: shown,
            span,
        }
    }
}
