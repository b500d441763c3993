//! Notes for the user: what was assumed or done, each as one short line with details.

use std::borrow::Borrow;
use std::fmt::{self, Debug, Display};
use std::ops::Deref;

use serde::{Serialize, Serializer};

/// A note. As text (`Deref`, `Display`, in JSON) it is the line and, after a semicolon, its details.
#[derive(Clone, PartialEq, Eq)]
pub struct Note {
    text: String,
    head_length: usize,
}

impl Note {
    /// A note of a line and details that are shown on request.
    pub fn new(head: impl Display, details: impl Display) -> Self {
        let mut note = Self::from(head.to_string());
        note.text.push_str(&format!("{SEPARATOR}{details}"));
        note
    }

    /// The line.
    pub fn head(&self) -> &str {
        &self.text[..self.head_length]
    }

    /// The details, if there are any.
    pub fn details(&self) -> Option<&str> {
        self.text[self.head_length..].strip_prefix(SEPARATOR)
    }

    /// The note with its subject before it.
    pub fn about(&self, subject: impl Display) -> Self {
        let subject = format!("{subject}: ");
        Self {
            text: format!("{subject}{}", self.text),
            head_length: subject.len() + self.head_length,
        }
    }
}

/// Stands between a line and its details.
const SEPARATOR: &str = "; ";

impl<T: Into<String>> From<T> for Note {
    fn from(head: T) -> Self {
        let text = head.into();
        Self {
            head_length: text.len(),
            text,
        }
    }
}

impl Deref for Note {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}

impl AsRef<str> for Note {
    fn as_ref(&self) -> &str {
        &self.text
    }
}

impl Borrow<str> for Note {
    fn borrow(&self) -> &str {
        &self.text
    }
}

impl Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Debug for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Debug::fmt(&self.text, f)
    }
}

impl Serialize for Note {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.text)
    }
}

/// Notes in the order in which they are told.
#[derive(Clone, Default, PartialEq, Eq, Serialize)]
pub struct Notes(Vec<Note>);

impl Notes {
    /// Adds a note, or a line without details.
    pub fn push(&mut self, note: impl Into<Note>) {
        self.0.push(note.into());
    }
}

impl<N: Into<Note>> Extend<N> for Notes {
    fn extend<I: IntoIterator<Item = N>>(&mut self, notes: I) {
        self.0.extend(notes.into_iter().map(Into::into));
    }
}

impl<N: Into<Note>> FromIterator<N> for Notes {
    fn from_iter<I: IntoIterator<Item = N>>(notes: I) -> Self {
        Self(notes.into_iter().map(Into::into).collect())
    }
}

impl IntoIterator for Notes {
    type Item = Note;
    type IntoIter = std::vec::IntoIter<Note>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl Deref for Notes {
    type Target = [Note];

    fn deref(&self) -> &[Note] {
        &self.0
    }
}

impl Debug for Notes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        Debug::fmt(&self.0, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_note_is_its_line_and_its_details() {
        let note = Note::new("the body was closed", "gaps were filled; skin is 2 mm");
        assert_eq!(note.about("ct").head(), "ct: the body was closed");
        assert_eq!(note.about("ct").details(), Some("gaps were filled; skin is 2 mm"));
        assert_eq!(&*note, "the body was closed; gaps were filled; skin is 2 mm");
        assert_eq!(Note::from("plain; as it is").details(), None);
    }
}
