//! Declaration of a study: what it is called, its options on the command line, and the function that runs it.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;
use std::time::Duration;

use schemars::Schema;

use super::Study;
use super::gather::{Devices, Progress};
use crate::StudyError;
use crate::stability::Effort;
use insonify::Error;

/// A study with its settings.
pub(crate) struct Entry<S: 'static> {
    /// Names and texts.
    pub about: About,
    /// Options on the command line, in the order of the help.
    pub options: &'static [StudyOption<S>],
    /// Settings of the study by itself.
    pub settings: fn(Effort) -> S,
    /// Settings in the report of all studies.
    pub in_report: fn(Effort) -> S,
    /// Function that runs the study.
    pub run: fn(&S, Context<'_>) -> Result<Study, Error>,
}

/// Names and texts of a study.
#[derive(Clone, Copy, Debug)]
pub struct About {
    /// Name of the study and of its subcommand.
    pub name: &'static str,
    /// Title of its chapter.
    pub title: &'static str,
    /// Question that the study answers.
    pub question: &'static str,
    /// Description of the subcommand, in a line.
    pub help: &'static str,
    /// Examples and remarks at the end of the help.
    pub examples: &'static str,
    /// Backends that may be chosen.
    pub backends: Backends,
}

/// Backends that a study may be limited to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backends {
    /// The study runs on the CPU.
    Cpu,
    /// All backends.
    All,
    /// All but the CPU in double precision, for this reason.
    Single(&'static str),
}

/// Devices and receivers that a study runs with.
pub struct Context<'a> {
    /// Devices to measure.
    pub devices: &'a Devices,
    /// Receives warnings about the input.
    pub warn: &'a dyn Fn(&str),
    /// Receives the current task and the completed fraction.
    pub progress: Progress<'a>,
}

/// Option of a study with settings `S`.
pub(crate) struct StudyOption<S> {
    flag: Flag,
    set: Set<S>,
    /// Default in the help.
    default: Option<fn(&S) -> String>,
}

/// Option as the command line shows it.
#[derive(Clone, Copy, Debug)]
pub struct Flag {
    /// Name after the two dashes.
    pub name: &'static str,
    /// Name of its value in the help; `None` for a switch.
    pub value: Option<&'static str>,
    /// Meaning.
    pub help: &'static str,
    /// Whether it takes several values, separated by commas.
    pub is_list: bool,
    /// Whether a value may begin with a minus.
    pub is_signed: bool,
    /// Whether the help omits it.
    pub is_hidden: bool,
    /// Other name.
    pub alias: Option<&'static str>,
    /// Option that it excludes.
    pub excludes: Option<&'static str>,
    /// Schema of an enumeration of the possible values.
    pub choices: Option<fn() -> Schema>,
}

/// Change of settings by an option.
enum Set<S> {
    Switch(fn(&mut S)),
    Number(fn(&mut S) -> &mut f64),
    Texts(fn(&mut S, &[&str]) -> Result<(), String>),
}

/// Option that asks for small settings, of every study.
const QUICK: &str = "quick";

impl<S> StudyOption<S> {
    const fn of(name: &'static str, value: Option<&'static str>, help: &'static str, set: Set<S>) -> Self {
        let flag = Flag {
            name,
            value,
            help,
            is_list: false,
            is_signed: matches!(set, Set::Number(_)),
            is_hidden: false,
            alias: None,
            excludes: None,
            choices: None,
        };
        StudyOption {
            flag,
            set,
            default: None,
        }
    }

    /// Declares `--quick`.
    pub(crate) const fn quick(help: &'static str) -> Self {
        Self::switch(QUICK, help, |_| ())
    }

    /// Declares a switch.
    pub(crate) const fn switch(name: &'static str, help: &'static str, set: fn(&mut S)) -> Self {
        Self::of(name, None, help, Set::Switch(set))
    }

    /// Declares a number, whose default the help shows.
    pub(crate) const fn number(
        name: &'static str,
        value: &'static str,
        help: &'static str,
        field: fn(&mut S) -> &mut f64,
    ) -> Self {
        Self::of(name, Some(value), help, Set::Number(field))
    }

    /// Declares an option whose value is parsed by `set`.
    pub(crate) const fn value(
        name: &'static str,
        value: &'static str,
        help: &'static str,
        set: fn(&mut S, &[&str]) -> Result<(), String>,
    ) -> Self {
        Self::of(name, Some(value), help, Set::Texts(set))
    }

    /// Shows a default in the help.
    pub(crate) const fn shown(mut self, default: fn(&S) -> String) -> Self {
        self.default = Some(default);
        self
    }

    /// Takes several values.
    pub(crate) const fn list(mut self) -> Self {
        self.flag.is_list = true;
        self
    }

    /// Takes values that begin with a minus.
    pub(crate) const fn signed(mut self) -> Self {
        self.flag.is_signed = true;
        self
    }

    /// Omits the option from the help.
    pub(crate) const fn hidden(mut self) -> Self {
        self.flag.is_hidden = true;
        self
    }

    /// Adds another name.
    pub(crate) const fn alias(mut self, name: &'static str) -> Self {
        self.flag.alias = Some(name);
        self
    }

    /// Excludes another option.
    pub(crate) const fn excludes(mut self, name: &'static str) -> Self {
        self.flag.excludes = Some(name);
        self
    }

    /// Takes the values of an enumeration.
    pub(crate) const fn choices(mut self, schema: fn() -> Schema) -> Self {
        self.flag.choices = Some(schema);
        self
    }

    fn apply(&self, settings: &mut S, values: &[&str]) -> Result<(), String> {
        match self.set {
            Set::Switch(set) => set(settings),
            Set::Number(field) => *field(settings) = parsed(values)?,
            Set::Texts(set) => set(settings, values)?,
        }
        Ok(())
    }
}

/// Parses the only value.
pub(crate) fn parsed<T: FromStr<Err: Display>>(values: &[&str]) -> Result<T, String> {
    values.concat().parse().map_err(|error: T::Err| error.to_string())
}

/// Parses the only value, within a range.
pub(crate) fn within<T: FromStr<Err: Display> + PartialOrd + Display>(
    values: &[&str],
    range: RangeInclusive<T>,
) -> Result<T, String> {
    let number = parsed(values)?;
    if range.contains(&number) {
        Ok(number)
    } else {
        Err(format!("{number} is not in {}..={}", range.start(), range.end()))
    }
}

/// Parses values within a range; `expected` describes the range in the error.
pub(crate) fn all_ranged<T: FromStr + PartialOrd>(
    values: &[&str],
    range: RangeInclusive<T>,
    expected: &str,
) -> Result<Vec<T>, String> {
    let number = |text: &&str| text.trim().parse().ok().filter(|number| range.contains(number));
    let numbers = values.iter().map(number).collect::<Option<_>>();
    numbers.ok_or_else(|| format!("expected {expected}"))
}

/// Parses the only value within a range; `expected` describes the range in the error.
pub(crate) fn ranged<T: FromStr + PartialOrd>(
    values: &[&str],
    range: RangeInclusive<T>,
    expected: &str,
) -> Result<T, String> {
    let last_value = all_ranged(values, range, expected)?.pop();
    last_value.ok_or_else(|| format!("expected {expected}"))
}

/// Parses the only value as seconds.
pub(crate) fn seconds(values: &[&str]) -> Result<Duration, String> {
    ranged(values, 0.0..=3600.0, "a number of seconds from 0 to 3600").map(Duration::from_secs_f64)
}

/// A study with settings of any type.
pub trait AnyEntry: Sync {
    /// Names and texts.
    fn about(&self) -> &About;

    /// Options in the order of the help, each with its default where the help shows it.
    fn flags(&self) -> Vec<(Flag, Option<String>)>;

    /// Checks a value of an option.
    ///
    /// # Errors
    /// The expected value, in words.
    fn check(&self, name: &str, value: &str) -> Result<(), String>;

    /// Runs the study by itself with the values of options; those of a switch are none.
    ///
    /// # Errors
    /// An error of the study.
    fn run(&self, arguments: &[(&str, Vec<String>)], context: Context<'_>) -> Result<Study, Error>;

    /// Runs the study as a part of the report of all.
    ///
    /// # Errors
    /// An error of the study.
    fn run_in_report(&self, effort: Effort, context: Context<'_>) -> Result<Study, Error>;
}

impl<S> AnyEntry for Entry<S> {
    fn about(&self) -> &About {
        &self.about
    }

    fn flags(&self) -> Vec<(Flag, Option<String>)> {
        let mut settings = (self.settings)(Effort::Whole);
        let flag = |option: &StudyOption<S>| {
            let default = match option.set {
                Set::Number(field) => Some(field(&mut settings).to_string()),
                _ => option.default.map(|default| default(&settings)),
            };
            (option.flag, default)
        };
        self.options.iter().map(flag).collect()
    }

    fn check(&self, name: &str, value: &str) -> Result<(), String> {
        let mut settings = (self.settings)(Effort::Whole);
        let mut options = self.options.iter();
        match options.find(|option| option.flag.name == name) {
            Some(option) => option.apply(&mut settings, &[value]),
            None => Err(format!("there is no option --{name}")),
        }
    }

    fn run(&self, arguments: &[(&str, Vec<String>)], context: Context<'_>) -> Result<Study, Error> {
        let is_quick = arguments.iter().any(|(name, _)| *name == QUICK);
        let mut settings = (self.settings)(if is_quick { Effort::Quick } else { Effort::Whole });
        // Switches set several values at once, which others then change.
        for switches in [true, false] {
            for option in self
                .options
                .iter()
                .filter(|option| option.flag.value.is_none() == switches)
            {
                for (_, values) in arguments.iter().filter(|(name, _)| *name == option.flag.name) {
                    let values: Vec<&str> = values.iter().map(String::as_str).collect();
                    let refused = |reason| StudyError::refused(format!("--{}: {reason}", option.flag.name));
                    option.apply(&mut settings, &values).map_err(refused)?;
                }
            }
        }
        (self.run)(&settings, context)
    }

    fn run_in_report(&self, effort: Effort, context: Context<'_>) -> Result<Study, Error> {
        (self.run)(&(self.in_report)(effort), context)
    }
}
