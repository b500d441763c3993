//! `insonify tradeoff STUDY`: subcommands made of the registry of studies.

use clap::builder::{PossibleValuesParser, ValueParser};
use clap::error::ErrorKind;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches, Subcommand};
use insonify_study::tradeoff::STUDIES;
use insonify_study::tradeoff::entry::{AnyEntry, Backends, Context, Flag};
use insonify_study::tradeoff::gather::Devices;

use crate::backend::{BackendArgs, BackendName};
use crate::failure::{Error, usage};
use crate::study::Printed;
use crate::terminal;
use crate::variants::names_in;

/// A study with the values given to its options.
pub(super) struct GivenStudy {
    study: &'static dyn AnyEntry,
    /// Options that are given, each with its values; those of a switch are none.
    given: Vec<(&'static str, Vec<String>)>,
    backend: BackendArgs,
    printed: Printed,
}

impl GivenStudy {
    pub(super) fn run(&self) -> Result<(), Error> {
        let devices = self.devices()?;
        self.printed.run(|progress| {
            let context = Context {
                devices: &devices,
                warn: &|warning| terminal::warn(warning),
                progress,
            };
            let mut study = self.study.run(&self.given, context)?;
            study.notes.extend(devices.missing.iter().cloned());
            Ok(study)
        })
    }

    fn devices(&self) -> Result<Devices, Error> {
        let backends = self.study.about().backends;
        if backends == Backends::Cpu {
            return Ok(Devices::default());
        }
        self.backend.check()?;
        self.printed.check()?;
        match (backends, self.backend.backend) {
            (Backends::Single(reason), BackendName::CpuF64) => Err(usage(
                format!("--backend cpu-f64: {reason}"),
                "ask for auto, cpu or gpu",
            )),
            _ => self.backend.gpus(),
        }
    }
}

impl FromArgMatches for GivenStudy {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let Some((name, matches)) = matches.subcommand() else {
            return Err(clap::Error::new(ErrorKind::MissingSubcommand));
        };
        let Some(&study) = STUDIES.iter().find(|study| study.about().name == name) else {
            return Err(clap::Error::new(ErrorKind::InvalidSubcommand));
        };
        let values = |flag: &Flag| match flag.value {
            None => matches.get_flag(flag.name).then(Vec::new),
            Some(_) => Some(matches.get_many(flag.name)?.cloned().collect()),
        };
        let flags = study.flags().into_iter();
        let given = flags.filter_map(|(flag, _)| Some((flag.name, values(&flag)?)));
        Ok(Self {
            study,
            given: given.collect(),
            backend: match study.about().backends {
                Backends::Cpu => BackendArgs::default(),
                Backends::All | Backends::Single(_) => BackendArgs::from_arg_matches(matches)?,
            },
            printed: Printed::from_arg_matches(matches)?,
        })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for GivenStudy {
    fn augment_subcommands(command: Command) -> Command {
        command.subcommands(STUDIES.iter().map(|study| subcommand(*study)))
    }

    fn augment_subcommands_for_update(command: Command) -> Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        STUDIES.iter().any(|study| study.about().name == name)
    }
}

fn subcommand(study: &'static dyn AnyEntry) -> Command {
    let about = study.about();
    let command = Command::new(about.name).after_help(about.examples);
    let command = command.args(
        study
            .flags()
            .into_iter()
            .map(|(flag, default)| arg(study, flag, default)),
    );
    let command = match about.backends {
        Backends::Cpu => command,
        Backends::All | Backends::Single(_) => BackendArgs::augment_args(command),
    };
    // Groups of options bring descriptions of their own.
    Printed::augment_args(command).about(about.help)
}

fn arg(study: &'static dyn AnyEntry, flag: Flag, default: Option<String>) -> Arg {
    let arg = Arg::new(flag.name)
        .long(flag.name)
        .help(flag.help)
        .hide(flag.is_hidden)
        .allow_negative_numbers(flag.is_signed)
        .conflicts_with_all(flag.excludes)
        .aliases(flag.alias);
    let Some(value) = flag.value else {
        return arg.action(ArgAction::SetTrue);
    };
    let parser = match flag.choices {
        Some(schema) => PossibleValuesParser::new(names_in(&schema())).into(),
        None => ValueParser::from(move |text: &str| study.check(flag.name, text).map(|()| text.to_owned())),
    };
    let arg = arg.value_name(value).value_parser(parser);
    // Once for each run of the program.
    let arg = arg.default_values(default.map(|default| &*default.leak()));
    if flag.is_list {
        arg.action(ArgAction::Append).value_delimiter(',')
    } else {
        arg
    }
}
