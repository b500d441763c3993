//! Cases of image synthesis.

mod broken;
mod drawn;
mod grain;
mod passes;
mod places;

use super::{Group, HardCase};

/// All backends: both precisions of the CPU, and each available GPU.
const ALL: &[&str] = &["cpu f64", "cpu f32", "every gpu"];

/// Group of image cases.
pub(crate) const GROUP: Group = Group {
    name: "Images",
    cases: &[
        HardCase {
            name: "samples on voxel faces",
            criterion: "samples on faces, edges and corners, planes between two layers: where nothing rounds the same labels on all backends, \
                        elsewhere within rounding of a face, sample by sample",
            covers: ALL,
            seed: 101,
            run: places::on_faces,
        },
        HardCase {
            name: "far from the origin",
            criterion: "probe 1e5 mm from the origin with samples down to 0.016 mm, voxels of 1e-3 and 1e3 mm: places and label boundaries \
                        within a tenth of a sample of double precision",
            covers: ALL,
            seed: 102,
            run: places::away,
        },
        HardCase {
            name: "tone at its ends",
            criterion: "echoes of 0, 1e-45 to 1e10, gain to +-200 dB: no NaN, grey levels monotone to rounding; dynamic ranges of 1 and \
                        200 dB refused",
            covers: ALL,
            seed: 103,
            run: passes::ends,
        },
        HardCase {
            name: "attenuation without bound",
            criterion: "0 to 1e6 dB/cm over 8,192 samples: transmittance monotone, never negative, underflow to black; Beer and Lambert for a \
                        pulse to the fixed point's rounding",
            covers: ALL,
            seed: 104,
            run: passes::any_attenuation,
        },
        HardCase {
            name: "apertures at their ends",
            criterion: "one element, f-numbers of 0.5 and 20, bandwidths of 5 and 150 %, foci at the array: speckle of unit power to 1 dB, \
                        every backend within rounding of double precision after every pass",
            covers: ALL,
            seed: 110,
            run: passes::any_aperture,
        },
        HardCase {
            name: "looks at their ends",
            criterion: "looks from beyond a narrow array, within a degree, on scanlines farther apart than they turn, on a sharp curve: as \
                        bright as one look to 0.5 dB, every backend within rounding of double precision after every pass",
            covers: ALL,
            seed: 111,
            run: passes::any_looks,
        },
        HardCase {
            name: "blur of any width",
            criterion: "width 0 is the identity; one sample wide the impulse response is the kernel; wider than the sector the energy is kept",
            covers: ALL,
            seed: 105,
            run: passes::any_blur,
        },
        HardCase {
            name: "broken meshes",
            criterion: "inverted, flat, overlapping elements and nodes that are no number: everything defined, counted once an update, the \
                        rest of the image as without them",
            covers: ALL,
            seed: 106,
            run: broken::meshes,
        },
        HardCase {
            name: "speckle of any seed and frame",
            criterion: "seeds 0 and 2^64-1, 1e4 frames: amplitudes stay Rayleigh, noise Gaussian, and hashes equal bit for bit",
            covers: ALL,
            seed: 107,
            run: grain::any,
        },
        HardCase {
            name: "random scenes",
            criterion: "100 scenes: every backend within rounding of double precision after every pass; labels differ only within rounding of \
                        a voxel face, proven sample by sample",
            covers: ALL,
            seed: 108,
            run: drawn::scenes,
        },
        HardCase {
            name: "scenes moved far away",
            criterion: "scenes of every kind, moved as a whole: 1e5 mm off by whole metres the same pixels on every backend, and places come \
                        out in the world to 1e-9 mm; anywhere else within rounding of double precision after every pass",
            covers: ALL,
            seed: 109,
            run: places::moved_scenes,
        },
    ],
};
