//! What a scene or a scenario leaves open, picked from what it costs here.

mod frames;
mod steps;

use clap::Args;
use insonify::quality::Picked;
use insonify::quality::cache::Cache;
use insonify::study::machine::Machine;

use super::failure::Failure;
use super::terminal;

#[derive(Args)]
pub struct QualityArgs {
    /// Repeat the timing that `quality` chooses from, even where this machine was timed before
    #[arg(long)]
    recalibrate: bool,
}

impl QualityArgs {
    /// What was measured before, or is measured now and kept. A file that is not `sound` is named and measured anew.
    fn kept<T>(
        &self,
        thing: &[&str],
        what: &str,
        sound: impl Fn(&T) -> bool,
        measure: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<T, Failure>
    where
        T: serde::Serialize + serde::de::DeserializeOwned,
    {
        let cache = Cache::of_user(&Machine::here().to_string());
        if !self.recalibrate {
            match cache.get(thing, sound) {
                Ok(Some(known)) => return Ok(known),
                Ok(None) => {}
                Err(bad) => terminal::warn(format_args!("the kept costs are ignored: {bad}")),
            }
        }
        terminal::say(format_args!("quality: {what}; it is kept for the next time"));
        let unkept = |error: &dyn std::fmt::Display| {
            terminal::warn(format_args!("what is measured cannot be kept: {error}"));
        };
        let kept = cache.check(thing).inspect_err(|error| unkept(error)).is_ok();
        let found = measure()?;
        if kept {
            let _ = cache.put(thing, &found).inspect_err(|error| unkept(error));
        }
        Ok(found)
    }
}

/// Says what was picked, and warns where it does not suffice.
fn tell(picked: &Picked) {
    match picked.met {
        true => terminal::say(format_args!("quality: {}", picked.why)),
        false => terminal::warn(format_args!("quality.{}: {}", picked.asked, picked.why)),
    }
}
