//! The `insonify` command: arguments, subcommands and their dispatch.

/// Declares subcommands, each with its arguments, and `run`, which runs the one that was given.
macro_rules! commands {
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
mod doctor;
mod excerpt;
mod exercise;
mod failure;
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
mod solve;
mod stability;
mod study;
mod terminal;
mod texture;
mod tradeoff;
mod variants;

use std::io;
use std::process::ExitCode;

use clap::Parser;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify render                                  the default scene, to frame.png
  insonify render --labels liver.nii.gz            a label file alone: the body is completed, the probe placed
  insonify render --labels ct.nii.gz --target kidney -o kidney.png
  insonify scene > my.toml                         the default scene, commented, ready to edit
  insonify scene sweep > sweep.toml                a scene whose probe moves
  insonify render sweep.toml -o frames             its frames: a folder of numbered pictures
  insonify plan my.toml                            the passes of a frame, and why each runs
  insonify inspect my.toml --at 320,240            what made one pixel
  insonify realism frame.png --against real/       how near frames are to real ones, measure by measure
  insonify match real.png --depth-mm 160 -o my.toml  probe and effects from a real frame
  insonify calibrate pivot tip.igs.mha             tip of a tracked needle; its shaft, the plane of a probe's image
  insonify register ct.nii.gz --surface touched.csv --fit fit.toml   anatomy fitted to a mannequin
  insonify texture liver.png --region 200,150,180,180 -o liver.nrrd   a solid texture from an image
  insonify insert liver-biopsy -o out --images     a needle insertion: forces, tissue deformation, frames
  insonify path liver-puncture --target vessel -o plan   needle paths that allow for the deformation
  insonify exercise make liver-biopsy --organ liver -o tasks   training tasks with random targets
  insonify identify case.toml -o found             force parameters and moduli from a measured insertion
  insonify score run                               how well a needle was guided to its target: ten metrics
  insonify manipulator inverse poses.csv           a needle guide on the probe: its slides for poses of the needle
  insonify solve problem.toml -o deformed.vtu      how tissue deforms under forces and displacements
  insonify material creep.toml -o creep.svg        how tissue creeps, relaxes and stiffens
  insonify beam case.toml -o shape.svg             how a needle bends in tissue when its base is moved
  insonify stability --quick                       hard numerical cases, and whether they pass
  insonify mesh info organs.msh                    regions, volumes and element quality of a mesh
  insonify doctor                                  the GPU adapters of this machine, and the backend used

Exit status: 0 success; 2 invalid arguments, files or scenes; 1 a failure of the machine.
Environment: INSONIFY_ADAPTER names the GPU adapter where --adapter does not; INSONIFY_CACHE is the folder for phantoms and
textures made before, and for measured costs (`insonify doctor` says which it is).";

/// Synthesises B-mode ultrasound frames from labelled volumes, on the GPU or the CPU.
#[derive(Parser)]
#[command(name = "insonify", version, after_help = EXAMPLES, max_term_width = 100)]
struct Cli {
    /// Print results and errors only: no notes, warnings or progress
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

commands! {
    enum Command {
        Render(render::Render),
        Plan(plan::Plan),
        Inspect(inspect::Inspect),
        Realism(realism::Realism),
        Match(matching::Match),
        Bench(bench::Bench),
        Tradeoff(tradeoff::Tradeoff),
        Info(info::Info),
        Calibrate(calibrate::Calibrate),
        Register(Box<register::Register>),
        Texture(Box<texture::TextureArgs>),
        Insert(insert::Insert),
        Path(path::PathArgs),
        Rf(Box<rf::Rf>),
        Motion(motion::Motion),
        Manipulator(manipulator::Manipulator),
        Identify(identify::Identify),
        Score(score::ScoreArgs),
        Exercise(exercise::Exercise),
        Solve(solve::Solve),
        Material(material::Material),
        Beam(beam::Beam),
        Puncture(puncture::Puncture),
        Stability(stability::Stability),
        Phantom(phantom::Phantom),
        Mesh(mesh::Mesh),
        Scene(scene::Scene),
        Schema(schema::Schema),
        Doctor(doctor::Doctor),
        Completions(completions::Completions),
    }
}

impl Cli {
    /// Runs the subcommand.
    fn run(self) -> Result<(), Error> {
        if self.quiet {
            terminal::quieten();
        }
        if let Err(cause) = watch() {
            terminal::warn(format_args!("an interrupt would leave temporary files behind: {cause}"));
        }
        insonify_base::cache::switch_on();
        self.command.run()
    }
}

/// Keeps Mesa's device selection layer, loaded by every adapter query, from printing an error where there is no display.
#[allow(unsafe_code, reason = "the environment is set before any other thread runs")]
fn quiet_mesa() {
    if std::env::var_os("NODEVICE_SELECT").is_none() {
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") }
    }
}

/// Parses the arguments, runs the command and returns its exit status.
fn main() -> ExitCode {
    quiet_mesa();
    let result = match Cli::try_parse() {
        Ok(cli) => cli.run(),
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

/// Ends the program on SIGINT, SIGTERM and SIGHUP with the conventional shell status, after removing unfinished output; a file that
/// exceeds the size limit is a write error.
#[cfg(unix)]
pub fn watch() -> io::Result<()> {
    use std::sync::Arc;
    use std::thread;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    use signal_hook::iterator::Signals;
    use signal_hook::{flag, low_level};

    flag::register(SIGXFSZ, Arc::default())?;
    let mut signals = Signals::new([SIGINT, SIGTERM, SIGHUP])?;
    thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if let Some(signal) = signals.forever().next() {
            insonify_base::output::abandon();
            low_level::exit(128 + signal);
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
    use clap::CommandFactory;

    #[test]
    fn arguments_of_every_command_go_together() {
        super::Cli::command().debug_assert();
    }
}
