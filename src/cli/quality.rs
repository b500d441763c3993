//! Choice of open settings of a scene or a scenario by their cost on this machine.

mod frames;
mod steps;

use crate::base::report::machine::Machine;
use crate::imaging::quality::Picked;
use crate::imaging::quality::cache::Cache;
use clap::Args;

use super::failure::Failure;
use super::terminal;

#[derive(Args)]
pub struct QualityArgs {
    /// Repeat the timing used by `quality`, even if this machine was timed before
    #[arg(long)]
    recalibrate: bool,
}

impl QualityArgs {
    /// Returns a cached measurement, or measures now and caches the result. A file that is not `sound` is reported
    /// and measured again.
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

/// Reports the picked settings, and warns if they exceed the budget.
fn tell(picked: &Picked) {
    match picked.met {
        true => terminal::say(format_args!("quality: {}", picked.why)),
        false => terminal::warn(format_args!("quality.{}: {}", picked.asked, picked.why)),
    }
}
