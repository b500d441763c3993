use super::*;
use crate::effects::receiver::Receiver;
use crate::study::anatomies::{self, Frame};
use crate::synth::tables::Anatomy;
use crate::tracking::probe::ProbeShape;
use nalgebra::Matrix4;

const CURVED: ProbeShape = ProbeShape::Curvilinear {
    radius_mm: 60.0,
    angle_deg: 66.0,
};
const STRAIGHT: ProbeShape = ProbeShape::Linear { width_mm: 38.0 };

/// Settings that are to be found again.
struct Known {
    shape: ProbeShape,
    depth_mm: f64,
    size: [usize; 2],
    axial_mm: f64,
    lateral_mm: f64,
    range_db: f64,
    gain_db: f64,
    /// dB per cm on top of the compensation of average tissue, about the middle.
    slope_db_cm: f64,
}

const KNOWN: Known = Known {
    shape: CURVED,
    depth_mm: 140.0,
    size: [520, 400],
    axial_mm: 1.0,
    lateral_mm: 2.0,
    range_db: 60.0,
    gain_db: 0.0,
    slope_db_cm: 0.0,
};

impl Known {
    fn effects(&self) -> Effects {
        let slope = self.slope_db_cm * self.depth_mm / 20.0;
        Effects {
            speckle: Some(Speckle {
                axial_mm: Some(self.axial_mm),
                lateral_mm: Some(self.lateral_mm),
                focal_zone_mm: Some(self.depth_mm),
                ..Speckle::default()
            }),
            tone: Some(Tone {
                gain_db: self.gain_db,
                tgc_points: vec![[0.0, -slope], [self.depth_mm, slope]],
                dynamic_range_db: self.range_db,
                ..Tone::linear()
            }),
            ..Effects::usual()
        }
    }

    fn frame(&self, anatomy: Anatomy, effects: Effects) -> Picture {
        let probe = Probe::new(self.shape, self.depth_mm).unwrap();
        let settings = Settings {
            seed: 77,
            probe,
            image: ImageSize {
                width: self.size[0],
                height: self.size[1],
                margin: 0.03,
                fill: 0,
                placed: None,
            },
            effects,
            has_needle: false,
        };
        let mut synth = Synthesizer::new(anatomy, settings, Backend::Cpu).unwrap();
        let frame = synth.render(&FrameState::at(Matrix4::identity())).unwrap();
        Picture {
            name: "real.png".to_owned(),
            width: frame.width,
            height: frame.height,
            grey: frame.pixels.iter().map(|&grey| f64::from(grey)).collect(),
            mm: Some([frame.pixel_mm; 2]),
            ..Picture::default()
        }
    }

    fn uniform(&self) -> Picture {
        let soft = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..PLAIN
        };
        self.frame(anatomies::uniform(soft), self.effects())
    }
}

fn value(found: &Match, key: &str) -> f64 {
    let figure = found.figures.iter().find(|it| it.key.ends_with(key));
    figure.unwrap_or_else(|| panic!("{key}: {:?}", found.figures)).value
}

fn near(what: &str, found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "{what}: {found}, not {expected} +- {tolerance}"
    );
}

#[test]
fn explore() {
    let phased = ProbeShape::Phased { angle_deg: 84.0 };
    let cases = [
        KNOWN,
        Known {
            range_db: 45.0,
            gain_db: -4.0,
            ..KNOWN
        },
        Known {
            range_db: 70.0,
            gain_db: 4.0,
            axial_mm: 0.7,
            lateral_mm: 1.4,
            ..KNOWN
        },
        Known {
            slope_db_cm: 0.8,
            ..KNOWN
        },
        Known {
            shape: phased,
            lateral_mm: 3.0,
            ..KNOWN
        },
        Known {
            shape: STRAIGHT,
            depth_mm: 50.0,
            axial_mm: 0.35,
            lateral_mm: 0.7,
            ..KNOWN
        },
        Known {
            shape: STRAIGHT,
            depth_mm: 50.0,
            axial_mm: 0.5,
            lateral_mm: 1.2,
            range_db: 70.0,
            gain_db: 3.0,
            slope_db_cm: -2.0,
            ..KNOWN
        },
    ];
    for case in cases {
        let picture = case.uniform();
        match fit(&picture, None, 0) {
            Ok(found) => {
                eprintln!(
                    "==== {:?} depth {} axial {} lateral {} range {} gain {} slope {}",
                    case.shape,
                    case.depth_mm,
                    case.axial_mm,
                    case.lateral_mm,
                    case.range_db,
                    case.gain_db,
                    case.slope_db_cm
                );
                eprintln!("{found}");
                eprintln!("{:?} residual {} ", found.sector, found.residual);
                for (real, own) in found.real.depths.iter().zip(&found.matched.depths) {
                    eprintln!("{real:?}\n   {own:?}");
                }
                eprintln!(
                    "{}",
                    found
                        .scene
                        .split("tgc_points")
                        .nth(1)
                        .unwrap_or_default()
                        .split('\n')
                        .next()
                        .unwrap()
                );
            }
            Err(error) => eprintln!("==== {error}"),
        }
    }
}

#[test]
fn explore_dark() {
    for (noise, clutter, decay) in [(-200.0, -8.0, 1.0), (-200.0, -20.0, 0.0), (-62.0, -200.0, 4.0)] {
        let mut effects = KNOWN.effects();
        effects.receiver = Some(Receiver {
            noise_db: noise,
            clutter_db: clutter,
            clutter_decay_db_cm: decay,
            ring_down_db: 14.0,
        });
        let soft = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..PLAIN
        };
        let fluid = Acoustics {
            attenuation_db_cm_mhz: SOFT_TISSUE_DB_CM_MHZ,
            ..SILENT
        };
        let frame = Frame::around([0.0, 80.0, 0.0], [110, 110, 30], 2.0);
        let picture = KNOWN.frame(
            anatomies::ball(frame, [0.0, 70.0, 0.0], 35.0, &[SILENT, soft, fluid]),
            effects,
        );
        eprintln!("==== noise {noise} clutter {clutter} decay {decay}");
        eprintln!("{}", fit(&picture, None, 0).unwrap());
    }
}
