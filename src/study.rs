//! Built-in measurements: benchmarks, accuracy studies, robustness cases and analyses of rendered frames.
//!
//! | module | contents |
//! |---|---|
//! | [`anatomies`] | synthetic volumes with closed-form geometry |
//! | [`mod@bench`] | render times per frame and per pass, and with effects removed one by one |
//! | [`mod@inspect`] | explanation of a single pixel |
//! | [`beam`] | published centres of motion of a needle in tissue, reproduced |
//! | [`tradeoff`] | accuracy against computing time |
//! | `block` | tissue blocks and needles shared by the studies |
//! | `page` | HTML reports |
//! | [`matching`] | probe and effects estimated from a real frame |
//! | [`parity`] | agreement between backends, sample by sample |
//! | [`plot`] | scatter and line plots as SVG and pixels |
//! | [`puncture`] | needle insertion into a slice of liver with a vein |
//! | [`realism`] | image statistics of rendered and real frames, compared |
//! | [`spread`] | medians and percentiles of times |
//! | [`stability`] | hard cases for the numerics, with acceptance limits |
//! | [`statistics`] | moments and correlations of samples |
//! | [`step_costs`] | cost of an insertion step for each setting, used by `quality` |
//! | [`machine`] | description of the CPU in use |

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
