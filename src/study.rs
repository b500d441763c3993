//! Measurements that the program makes of itself, and what it can say of its own frames.
//!
//! | file | what it holds |
//! |---|---|
//! | [`anatomies`] | volumes with closed forms |
//! | [`mod@bench`] | times of frames, of passes, and of frames from which effects are taken away |
//! | [`mod@inspect`] | what made one pixel |
//! | [`beam`] | the published centres of motion of a needle in tissue |
//! | [`tradeoff`] | what accuracy costs in time |
//! | `block` | what studies put needles into |
//! | `page` | HTML of reports |
//! | [`matching`] | probe and effects with which frames look like a real one |
//! | [`parity`] | whether backends agree, sample by sample |
//! | [`plot`] | points and lines on two axes, as SVG and pixels |
//! | [`puncture`] | a needle goes into a slice of liver with a vein |
//! | [`realism`] | frames against real frames: the same measures on both |
//! | [`spread`] | medians and percentiles of times |
//! | [`stability`] | hard cases, and whether they hold |
//! | [`statistics`] | moments and correlations of samples |
//! | [`step_costs`] | what a step of an insertion costs with each choice, for `quality` to pick from |
//! | [`machine`] | what the CPU backend runs on |

pub mod anatomies;
pub mod beam;
pub mod bench;
mod block;
mod fractional;
pub mod inspect;
pub mod machine;
pub mod matching;
pub(crate) mod page;
pub mod parity;
pub mod plot;
pub mod puncture;
pub mod realism;
pub mod spread;
pub mod stability;
pub mod statistics;
pub mod step_costs;
#[cfg(test)]
pub(crate) mod testing;
pub mod tradeoff;
