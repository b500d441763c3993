//! Built-in measurements: benchmarks, accuracy studies, robustness cases and analyses of rendered frames.
//!
//! | module | contents |
//! |---|---|
//! | [`mod@bench`] | render times per frame and per pass, and with effects removed one by one |
//! | [`mod@identify`] | parameters of tissue layers from a measured insertion |
//! | [`mod@inspect`] | explanation of a single pixel |
//! | [`beam_case`], [`identification`], [`material_case`] | case files of needles, insertions and material tests |
//! | [`calibration`], [`registration`] | reports of both |
//! | [`beam`] | published centres of motion of a needle in tissue, reproduced |
//! | [`tradeoff`] | accuracy against computing time |
//! | [`matching`] | probe and effects estimated from a real frame |
//! | [`path`] | straight needle paths to a target that allow for the deformation |
//! | [`puncture`] | needle insertion into a slice of liver with a vein |
//! | [`realism`] | image statistics of rendered and real frames, compared |
//! | [`score`] | how well a needle was guided to its target |
//! | [`texture`] | solid textures from images |
//! | [`stability`] | hard cases for the numerics, with acceptance limits |
//! | [`step_costs`] | cost of an insertion step for each setting, used by the `quality` of the command |

pub mod beam;
pub mod beam_case;
pub mod bench;
pub mod calibration;
mod error;
mod fractional;
pub mod identification;
pub mod identify;
pub mod inspect;
pub mod matching;
pub mod material_case;
pub mod path;
pub mod puncture;
pub mod realism;
pub mod registration;
pub mod score;
mod search;
pub mod stability;
pub mod step_costs;
#[cfg(test)]
pub mod testing;
pub mod texture;
pub mod tradeoff;

pub use error::StudyError;
