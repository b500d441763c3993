//! Options that set keys of the scene or scenario that a command reads.

use std::path::{Path, PathBuf};

use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use insonify_base::document::Setting;
use insonify_imaging::scene::SceneFile;
use insonify_tracking::probe::GridSpec;

use super::failure::{Error, usage};

/// Identifier of `--set`.
const SET: &str = "set";

/// An option for a single key.
struct Shorthand {
    option: &'static str,
    value_name: &'static str,
    /// Key of a scene.
    key: &'static str,
    help: &'static str,
}

/// Options for the keys that are changed most. A command that has an option of the same name keeps its own.
const SHORTHANDS: &[Shorthand] = &[
    Shorthand {
        option: "depth-mm",
        value_name: "MM",
        key: DEPTH,
        help: "Depth of the image",
    },
    Shorthand {
        option: "gain-db",
        value_name: "DB",
        key: "effects.tone.gain_db",
        help: "Gain of the frame",
    },
    Shorthand {
        option: "frequency-mhz",
        value_name: "MHZ",
        key: "probe.frequency_mhz",
        help: "Centre frequency of the probe",
    },
    Shorthand {
        option: "seed",
        value_name: "N",
        key: "seed",
        help: "Seed of speckle, noise and textures",
    },
];

/// Key of the depth of a frame.
const DEPTH: &str = "probe.depth_mm";

/// Keys that options set, in the order of the command line: the last one counts.
#[derive(Default)]
pub(crate) struct Settings(Vec<Given>);

struct Given {
    /// The option; `None` for `--set`.
    shorthand: Option<&'static Shorthand>,
    /// Value of the option.
    value: String,
}

impl Given {
    /// The option as errors name it.
    fn option(&self) -> String {
        format!(
            "--{} {}",
            self.shorthand.map_or(SET, |shorthand| shorthand.option),
            self.value
        )
    }
}

impl Settings {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Settings of a scene.
    pub(crate) fn of_scene(&self) -> Vec<Setting> {
        self.within("")
    }

    /// Settings of a scenario, whose scene lies under `scene`.
    pub(crate) fn of_scenario(&self) -> Vec<Setting> {
        self.within("scene.")
    }

    fn within(&self, scene: &str) -> Vec<Setting> {
        let setting = |given: &Given| {
            let value = &given.value;
            let assignment = given
                .shorthand
                .map(|shorthand| format!("{scene}{}={value}", shorthand.key));
            // Values were parsed as arguments.
            Setting::parse(assignment.as_ref().unwrap_or(value), &given.option()).ok()
        };
        self.0.iter().filter_map(setting).collect()
    }

    /// Refuses `--depth-mm` for frames on the grid of a recording.
    pub(crate) fn check(&self, scene: &SceneFile) -> Result<(), Error> {
        let is_depth = |given: &&Given| given.shorthand.is_some_and(|shorthand| shorthand.key == DEPTH);
        let is_recorded = scene.image.is_some_and(|image| image.grid == GridSpec::Recorded);
        match self.0.iter().find(is_depth) {
            Some(depth) if is_recorded => Err(usage(
                format!(
                    "{}: with `grid = \"recorded\"` frames are as deep as the recorded images",
                    depth.option()
                ),
                "`--set image.grid=fitted` gives up their pixels; `--set probe.depth_mm=MM` changes the scanlines alone",
            )),
            _ => Ok(()),
        }
    }
}

impl Args for Settings {
    fn augment_args(command: Command) -> Command {
        let set = Arg::new(SET)
            .long(SET)
            .value_name("KEY=VALUE")
            .action(ArgAction::Append)
            .value_parser(|text: &str| Setting::parse(text, "").map(|_| text.to_owned()))
            .help(
                "Set a key, as if the file stated it: effects.tone.gain_db=6, effects.refraction=false, tissue.0.name=liver. Repeatable; \
                 the last one of a key counts",
            );
        let mut command = command.arg(set);
        for Shorthand {
            option,
            value_name,
            key,
            help,
        } in SHORTHANDS
        {
            if command.get_arguments().any(|other| other.get_long() == Some(option)) {
                continue;
            }
            let parse = |text: &str| Setting::parse(&format!("key={text}"), "").map(|_| text.to_owned());
            let arg = Arg::new(id(option))
                .long(option)
                .value_name(value_name)
                .allow_negative_numbers(true)
                .action(ArgAction::Append)
                .value_parser(parse)
                .help(format!("{help} (`{key}` of the scene)"));
            command = command.arg(arg);
        }
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// Identifier of a shorthand: not that of a command's own option of the same name.
fn id(option: &str) -> String {
    format!("{SET} {option}")
}

impl FromArgMatches for Settings {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut all = Vec::new();
        for shorthand in std::iter::once(None).chain(SHORTHANDS.iter().map(Some)) {
            let id = shorthand.map_or(SET.to_owned(), |shorthand| id(shorthand.option));
            // A command with an option of the same name does not have the shorthand.
            let values = matches.try_get_many::<String>(&id).ok().flatten();
            let indices = values.is_some().then(|| matches.indices_of(&id)).flatten();
            let values = indices.into_iter().flatten().zip(values.into_iter().flatten());
            all.extend(values.map(|(index, value)| {
                let value = value.clone();
                (index, Given { shorthand, value })
            }));
        }
        all.sort_by_key(|(index, _)| *index);
        Ok(Self(all.into_iter().map(|(_, given)| given).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

/// Sets a key to a path; errors name the path, not the option.
pub(crate) fn path(key: &str, path: &Path) -> Result<Setting, Error> {
    let text = path.to_str().ok_or_else(|| {
        let found = format!("{}: the name is not UTF-8 text, as keys of scenes are", path.display());
        usage(found, "rename the file, or name it by a link")
    })?;
    Ok(Setting::new(key, text))
}

/// Files that settings name, for a scene in this folder.
pub(crate) fn files(settings: &[Setting], folder: &Path) -> Vec<PathBuf> {
    let named = settings.iter().filter_map(Setting::text).map(|text| folder.join(text));
    named.filter(|path| path.is_file()).collect()
}
