//! The `insonify` command: arguments, subcommands and their dispatch.

/// Declares subcommands, each with its arguments, and `run`, which runs the one that was given; where they stand in
/// groups, also `GROUPS`, the title of the group of each.
macro_rules! commands {
    (enum $name:ident { $($title:literal { $($command:ident($arguments:ty),)* })* }) => {
        commands! { enum $name { $($($command($arguments),)*)* } }

        impl $name {
            const GROUPS: &[&str] = &[$($(($title, stringify!($command)).0,)*)*];
        }
    };
    (enum $name:ident { $($command:ident($arguments:ty),)* }) => {
        #[derive(clap::Subcommand)]
        enum $name {
            $($command($arguments),)*
        }

        impl $name {
            fn run(&self) -> Result<(), Error> {
                match self {
                    $(Self::$command(arguments) => arguments.run(),)*
                }
            }
        }
    };
}

mod backend;
mod beam;
mod bench;
mod calibrate;
mod completions;
#[cfg(test)]
mod docs;
mod doctor;
mod excerpt;
mod exercise;
mod failure;
mod groups;
mod identify;
mod info;
mod input;
mod insert;
mod inspect;
mod manipulator;
mod matching;
mod material;
mod mesh;
mod motion;
mod output;
mod path;
mod phantom;
mod plan;
mod puncture;
mod quality;
mod realism;
mod register;
mod render;
mod rf;
mod scene;
mod schema;
mod score;
mod settings;
mod solve;
mod stability;
mod study;
mod terminal;
mod texture;
mod tradeoff;
mod variants;

use std::io;
use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser};
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify render                                  the default scene, to frame.png
  insonify render --labels labels.nii.gz --target kidney -o kidney.png   a segmentation: the probe is placed over the kidney
  insonify scene > my.toml                         the default scene, commented, ready to edit
  insonify render my.toml --depth-mm 120 --set effects.refraction=false   keys of the scene changed for one run
  insonify plan my.toml                            the passes of a frame, and why each runs
  insonify insert liver-biopsy -o out --images     a needle insertion: forces, tissue deformation, frames
  insonify solve problem.toml -o deformed.vtu      how tissue deforms under forces and displacements
  insonify calibrate pivot tip.igs.mha             the tip of a tracked needle
  insonify stability --quick                       hard numerical cases, and whether they pass
  insonify render --help                           every option of a command, with examples

Exit status: 0 success; 2 invalid arguments, files or scenes; 1 a failure of the machine, or nothing in view; 124 --time-limit-s is over.
Environment: INSONIFY_ADAPTER names the GPU adapter where --adapter does not; INSONIFY_CACHE is the folder for phantoms and
textures made before, and for measured costs (`insonify doctor` says which it is).";

/// Synthesises B-mode ultrasound frames from labelled volumes, on the GPU or the CPU.
#[derive(Parser)]
#[command(name = "insonify", version, after_help = EXAMPLES, max_term_width = 100)]
struct Cli {
    /// Print results and errors only: no notes, warnings or progress
    #[arg(short, long, global = true)]
    quiet: bool,
    /// Time after which the program ends, s.
    #[arg(skip)]
    end_after_s: Option<f64>,
    /// Print notes with their details
    #[arg(short, long, global = true, conflicts_with = "quiet")]
    verbose: bool,
    #[command(subcommand)]
    command: Command,
}

commands! {
    enum Command {
        "Images" {
            Render(render::Render),
            Plan(plan::Plan),
            Inspect(inspect::Inspect),
            Realism(realism::Realism),
            Match(matching::Match),
            Texture(Box<texture::TextureArgs>),
            Rf(Box<rf::Rf>),
            Motion(motion::Motion),
        }
        "Tissue and needles" {
            Insert(insert::Insert),
            Path(path::PathArgs),
            Puncture(puncture::Puncture),
            Beam(beam::Beam),
            Solve(solve::Solve),
            Material(material::Material),
            Identify(identify::Identify),
        }
        "Tracking and training" {
            Calibrate(calibrate::Calibrate),
            Register(Box<register::Register>),
            Manipulator(manipulator::Manipulator),
            Exercise(exercise::Exercise),
            Score(score::ScoreArgs),
        }
        "Studies" {
            Bench(bench::Bench),
            Tradeoff(tradeoff::Tradeoff),
            Stability(stability::Stability),
        }
        "Files and setup" {
            Scene(scene::Scene),
            Phantom(phantom::Phantom),
            Mesh(mesh::Mesh),
            Info(info::Info),
            Schema(schema::Schema),
            Doctor(doctor::Doctor),
            Completions(completions::Completions),
        }
    }
}

impl Cli {
    /// The command with its subcommands in groups.
    fn grouped() -> clap::Command {
        limited(groups::grouped(Self::command(), Command::GROUPS))
    }

    /// Parses the arguments of the process; the second value is the name of the subcommand.
    fn from_arguments() -> Result<(Self, String), clap::Error> {
        let matches = Self::grouped().try_get_matches()?;
        let mut name = Vec::new();
        let mut matched = &matches;
        while let Some((command, arguments)) = matched.subcommand() {
            name.push(command);
            matched = arguments;
        }
        let name = name.join(" ");
        let cli = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut Self::grouped()))?;
        let cli = Self {
            end_after_s: limit_of(&matches),
            ..cli
        };
        Ok((cli, name))
    }

    /// Runs the subcommand of this name.
    fn run(self, name: &str) -> Result<(), Error> {
        if self.quiet {
            terminal::quieten();
        }
        if self.verbose {
            terminal::explain();
        }
        let _progress = terminal::watched(name);
        if let Err(cause) = watch() {
            terminal::warn(format_args!("an interrupt would leave temporary files behind: {cause}"));
        }
        if let Some(limit_s) = self.end_after_s {
            end_after(limit_s).map_err(failure::Failure::Thread)?;
        }
        insonify_base::cache::switch_on();
        self.command.run()
    }
}

/// Name of the time limit in matches.
const END_AFTER: &str = "end_after_s";

/// Adds `--time-limit-s` to a command and its subcommands, but for those that measure within one of their own.
fn limited(command: clap::Command) -> clap::Command {
    const LONG: &str = "time-limit-s";
    let has_own = command
        .get_arguments()
        .any(|argument| argument.get_long() == Some(LONG));
    let limit = (!has_own).then(|| {
        clap::Arg::new(END_AFTER)
            .long(LONG)
            .value_name("S")
            .value_parser(seconds)
            .help("End after this time with status 124: unfinished output is removed")
    });
    command.args(limit).mut_subcommands(limited)
}

/// The time limit that was given, s.
fn limit_of(matches: &clap::ArgMatches) -> Option<f64> {
    let here = matches.try_get_one(END_AFTER).ok().flatten().copied();
    let below = matches.subcommand().and_then(|(_, matches)| limit_of(matches));
    below.or(here)
}

/// Status of a run that its time limit ends, as of `timeout` of the shell.
const OVER_TIME: i32 = 124;

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = insonify_base::number::parsed(text).filter(|seconds| (1e-3..=1e9).contains(seconds));
    seconds.ok_or_else(|| "expected 0.001 to 1e9 seconds".to_owned())
}

/// Ends the program when the time is over, whatever it is doing, after removing unfinished output as an interrupt does.
fn end_after(limit_s: f64) -> io::Result<()> {
    let thread = std::thread::Builder::new().name("time limit".to_owned());
    thread.spawn(move || {
        std::thread::sleep(std::time::Duration::from_secs_f64(limit_s));
        insonify_base::output::abandon();
        terminal::report(&failure::Failure::OverTime(limit_s).into());
        end(OVER_TIME)
    })?;
    Ok(())
}

/// Ends the process at once: other threads are at work, and what they use must not be torn down under them.
fn end(status: i32) -> ! {
    #[cfg(unix)]
    signal_hook::low_level::exit(status);
    #[cfg(not(unix))]
    std::process::exit(status)
}

/// Keeps Mesa's device selection layer, loaded by every adapter query, from printing an error where there is no
/// display.
#[allow(unsafe_code, reason = "the environment is set before any other thread runs")]
fn quiet_mesa() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") }
    }
}

/// Parses the arguments, runs the command and returns its exit status.
fn main() -> ExitCode {
    quiet_mesa();
    let result = match Cli::from_arguments() {
        Ok((cli, name)) => cli.run(&name),
        Err(error) => {
            // A closed terminal must not cause a failure.
            let _ = error.print();
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            terminal::report(&error);
            ExitCode::from(error.exit_status())
        }
    }
}

// Handling of interrupts, termination requests and system limits.

/// Ends the program on SIGINT, SIGTERM and SIGHUP with the conventional shell status, after removing unfinished output;
/// a file that exceeds the size limit is a write error.
#[cfg(unix)]
pub fn watch() -> io::Result<()> {
    use std::sync::Arc;
    use std::thread;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::flag;
    use signal_hook::iterator::Signals;

    flag::register(SIGXFSZ, Arc::default())?;
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            insonify_base::output::abandon();
            end(128 + signal);
        }
    })?;
    Ok(())
}

/// On other systems, the next run removes what an interrupt leaves.
#[cfg(not(unix))]
pub fn watch() -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_of_every_command_go_together() {
        Cli::grouped().debug_assert();
    }

    #[test]
    fn every_command_is_listed_once_under_its_group() {
        let help = Cli::grouped().render_help().to_string();
        let list = help
            .split_once("Usage:")
            .and_then(|(_, after_usage)| after_usage.split_once("\nOptions:"));
        let mut group = "";
        let mut listed = Vec::new();
        for line in list.map_or("", |(list, _)| list).lines().skip(1) {
            match line.strip_prefix("  ").map(|line| line.split_once(' ')) {
                Some(entry) => listed.extend(entry.map(|(name, about)| (group, name, about.trim()))),
                None => group = line.trim_end_matches(':'),
            }
        }
        let command = Cli::command();
        let declared = command.get_subcommands().zip(Command::GROUPS);
        let abouts: Vec<String> = command
            .get_subcommands()
            .map(|subcommand| subcommand.get_about().map_or_else(String::new, ToString::to_string))
            .collect();
        let declared: Vec<_> = declared
            .zip(&abouts)
            .map(|((subcommand, group), about)| (*group, subcommand.get_name(), about.as_str()))
            .collect();
        assert_eq!(declared.len(), abouts.len());
        assert_eq!(listed, declared);
        // Wider terminals are rare, and clap does not break lines here.
        for line in help.lines() {
            assert!(line.chars().count() <= 140, "{line}");
        }
    }

    #[test]
    fn completions_name_the_group() {
        let command = groups::prefixed(Cli::command(), Command::GROUPS);
        for (subcommand, group) in command.get_subcommands().zip(Command::GROUPS) {
            let about = subcommand.get_about().map_or_else(String::new, ToString::to_string);
            assert!(about.starts_with(&format!("{group}: ")), "{about}");
        }
    }
}
