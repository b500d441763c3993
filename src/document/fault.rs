//! What is wrong with a file, and where in it.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, SourceCode};

use super::Source;

/// What is wrong with a file, the key that it is about and where that stands in the text.
///
/// As a [`miette::Diagnostic`] it shows the line with a caret; as text it names key, file and line.
#[derive(Debug)]
pub struct Fault<P>(Box<Inner<P>>);

#[derive(Debug)]
struct Inner<P> {
    problem: P,
    key: Option<String>,
    /// Name of the file.
    file: Option<String>,
    /// Where in it the key is written.
    place: Option<Place>,
    help: Option<String>,
}

#[derive(Debug)]
struct Place {
    source: Arc<Source>,
    span: Range<usize>,
}

impl<P> Fault<P> {
    pub(crate) fn new(problem: impl Into<P>) -> Self {
        Self(Box::new(Inner {
            problem: problem.into(),
            key: None,
            file: None,
            place: None,
            help: None,
        }))
    }

    pub(crate) fn in_text(mut self, source: &Arc<Source>, span: Option<Range<usize>>) -> Self {
        let source = Arc::clone(source);
        self.0.file = Some(source.name().to_owned());
        self.0.place = span.map(|span| Place { source, span });
        self
    }

    /// About a key such as `effects.speckle.axial_mm`, in the text where there is one.
    pub(crate) fn at_key(mut self, key: impl Into<String>, source: Option<&Arc<Source>>) -> Self {
        let key = key.into();
        if let Some(source) = source {
            self = self.in_text(source, source.find(&key));
        }
        self.0.key = Some(key);
        self
    }

    pub(crate) fn with_help(mut self, help: Option<String>) -> Self {
        self.0.help = help;
        self
    }

    /// The same fault of a file that holds this one.
    pub(crate) fn map<Q>(self, problem: impl FnOnce(P) -> Q) -> Fault<Q> {
        let inner = *self.0;
        Fault(Box::new(Inner {
            problem: problem(inner.problem),
            key: inner.key,
            file: inner.file,
            place: inner.place,
            help: inner.help,
        }))
    }

    /// What is wrong.
    pub fn problem(&self) -> &P {
        &self.0.problem
    }

    /// Path of the key that it is about, such as `effects.speckle.axial_mm`, where it is about one.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// Name of the file and line (from 1), where the key is written in one.
    pub fn location(&self) -> Option<(&str, usize)> {
        let place = self.0.place.as_ref()?;
        Some((place.source.name(), place.source.line(place.span.start)))
    }
}

impl<P: fmt::Display> fmt::Display for Fault<P> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(key) = &self.0.key {
            write!(f, "{key}: ")?;
        }
        write!(f, "{}", self.0.problem)?;
        match self.location() {
            Some((name, line)) => write!(f, " ({name}, line {line})"),
            None => self.0.file.as_ref().map_or(Ok(()), |name| write!(f, " ({name})")),
        }
    }
}

impl<P: std::error::Error> std::error::Error for Fault<P> {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.problem.source()
    }
}

impl<P: std::error::Error> Diagnostic for Fault<P> {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.0.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.place.as_ref().map(|place| place as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.0.place.as_ref()?.span.clone();
        let label = LabeledSpan::new_primary_with_span(Some("here".to_owned()), span);
        Some(Box::new(std::iter::once(label)))
    }
}

impl SourceCode for Place {
    fn read_span<'a>(
        &'a self,
        span: &miette::SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn miette::SpanContents<'a> + 'a>, miette::MietteError> {
        let inner = self.source.text().read_span(span, before, after)?;
        Ok(Box::new(miette::MietteSpanContents::new_named(
            self.source.name().to_owned(),
            inner.data(),
            *inner.span(),
            inner.line(),
            inner.column(),
            inner.line_count(),
        )))
    }
}
