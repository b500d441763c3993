//! Runs the built command in a folder of its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde::de::DeserializeOwned;
use serde_json::Value;
use tempfile::TempDir;

/// A coarse phantom under a small probe: every command on it takes a moment.
pub(crate) const SCENE: &str = r#"
version = 2
seed = 3
[volume]
phantom = "two-layer"
resolution_mm = 3
[probe]
kind = "linear"
width_mm = 38
depth_mm = 60
lines = 32
samples = 64
[image]
width = 48
height = 40
"#;

/// A folder that the command runs in.
pub(crate) struct Bench {
    folder: TempDir,
}

impl Bench {
    /// An empty folder but for `scene.toml`.
    pub(crate) fn new() -> Self {
        let bench = Self {
            folder: tempfile::tempdir().expect("a folder"),
        };
        bench.write("scene.toml", SCENE);
        bench
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).expect("written");
    }

    /// A text file of the folder.
    pub(crate) fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// A JSON file of the folder.
    pub(crate) fn read<T: DeserializeOwned>(&self, name: &str) -> T {
        serde_json::from_str(&self.text(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Names of the files there but for the lists that runs keep of them and what they keep in the cache, sorted.
    pub(crate) fn files(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).expect("a folder");
        let mut names: Vec<String> = entries
            .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
            .collect();
        names.retain(|name| {
            !["insonify.json", "cache", "made"].contains(&name.as_str()) && !name.starts_with("manifest.")
        });
        names.sort();
        names
    }

    /// The command with space-separated arguments, ready to run. Each test has its own cache folder; phantoms and
    /// textures in it are shared by all tests.
    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = self.program(env!("CARGO_BIN_EXE_insonify"));
        command.args(arguments.split_whitespace());
        command
    }

    /// A line of shell commands, ready to run, that finds the command by its name.
    pub(crate) fn shell(&self, line: &str) -> Command {
        let mut command = self.program("sh");
        let folder = Path::new(env!("CARGO_BIN_EXE_insonify")).parent().expect("a folder");
        let path = std::env::var("PATH").unwrap_or_default();
        command
            .args(["-c", line])
            .env("PATH", format!("{}:{path}", folder.display()));
        command
    }

    fn program(&self, program: &str) -> Command {
        let cache = self.path("cache");
        #[cfg(unix)]
        if !cache.exists() {
            let shared_cache = concat!(env!("CARGO_TARGET_TMPDIR"), "/made");
            std::fs::create_dir_all(shared_cache).expect("a folder");
            std::fs::create_dir(&cache).expect("a folder");
            std::os::unix::fs::symlink(shared_cache, cache.join("made")).expect("a link");
        }
        let mut command = Command::new(program);
        command
            .current_dir(self.folder.path())
            .env("NODEVICE_SELECT", "1")
            .env("INSONIFY_CACHE", cache)
            .env_remove("INSONIFY_ADAPTER");
        command
    }

    pub(crate) fn run(&self, arguments: &str) -> Run {
        Run::of(self.command(arguments), arguments)
    }

    /// Runs it on a machine without GPU adapters.
    pub(crate) fn run_without_gpu(&self, arguments: &str) -> Run {
        let mut command = self.command(arguments);
        command
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent");
        Run::of(command, arguments)
    }
}

/// What a run says, but for the lines that it says only on a slow machine.
fn without_progress(stderr: &str) -> String {
    let lines = stderr.split_inclusive('\n');
    lines.filter(|line| !line.starts_with("progress: ")).collect()
}

/// What a run left.
pub(crate) struct Run {
    pub arguments: String,
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    pub(crate) fn of(mut command: Command, arguments: &str) -> Self {
        let Output { status, stdout, stderr } = command.output().expect("it runs");
        let run = Self {
            arguments: arguments.to_owned(),
            status: status.code(),
            stdout: String::from_utf8(stdout).expect("text"),
            stderr: without_progress(&String::from_utf8(stderr).expect("text")),
        };
        assert!(!run.stderr.contains("panicked"), "{run:?}");
        run
    }

    /// Its standard output, if it succeeded.
    pub(crate) fn text(&self) -> &str {
        assert_eq!(self.status, Some(0), "{self:?}");
        &self.stdout
    }

    /// Its standard output as JSON, if it succeeded.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(self.text()).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// Checks that it failed with a status, said all of `words`, and left nothing on standard output.
    pub(crate) fn fails(&self, status: i32, words: &[&str]) {
        assert_eq!(self.status, Some(status), "{self:?}");
        assert_eq!(self.stdout, "", "{self:?}");
        for word in words {
            assert!(self.stderr.contains(word), "no {word:?} in {self:?}");
        }
    }
}

impl std::fmt::Debug for Run {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            arguments,
            status,
            stdout,
            stderr,
        } = self;
        write!(
            f,
            "insonify {arguments}: status {status:?}\n--- stdout\n{stdout}\n--- stderr\n{stderr}"
        )
    }
}

/// Size and grey levels of a PNG.
pub(crate) fn grey(path: &Path) -> ((u32, u32), Vec<u8>) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let image = image.as_luma8().expect("8-bit grey").clone();
    (image.dimensions(), image.into_raw())
}

/// Size and values of a 16-bit PNG.
pub(crate) fn grey16(path: &Path) -> ((u32, u32), Vec<u16>) {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let image = image.as_luma16().expect("16-bit grey").clone();
    (image.dimensions(), image.into_raw())
}

/// Names in a list of objects.
pub(crate) fn names(list: &Value) -> Vec<&str> {
    let items = list.as_array().expect("a list");
    items
        .iter()
        .map(|item| item["name"].as_str().expect("a name"))
        .collect()
}
