//! The formats, and how far a case of each goes: what a command would do with the file, where that is little work.

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use flate2::Compression as Level;
use flate2::write::GzEncoder;
use insonify::Error;
use insonify::input::scenario::{self, ScenarioFile, SceneSource};
use insonify::input::statics::{self, ProblemFile};
use insonify_anatomy::segmentation::{self, Names, Naming};
use insonify_anatomy::volume::texture::{SolidTexture, TextureOptions};
use insonify_anatomy::volume::{load_scalar, save, written};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::table::Stated;
use insonify_imaging::quality::cache::Cache;
use insonify_imaging::quality::{Costs, pick};
use insonify_imaging::rf::bmode::{envelope, grey, white};
use insonify_imaging::rf::file::Echoes;
use insonify_imaging::scene::{self, ImageSpec, SceneFile};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_mechanics::needle::beam::{Compression, fit};
use insonify_mesh::file::{ReadOptions, SurfaceFile, read_mesh, read_mesh_bytes, write_vtu};
use insonify_mesh::generate::{GenerateOptions, LabelGrid, generate};
use insonify_mesh::quality::Quality;
use insonify_study::beam_case::{self, points};
use insonify_study::material_case::{
    self,
    fit::{MaterialFit, Measurements},
};
use insonify_study::realism::picture;
use insonify_study::score::groups;
use insonify_tracking::calibration::Calibration;
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::sequence::Sequence;
use insonify_tracking::trajectory::Trajectory;
use nalgebra::Matrix4;

use crate::corpus;
use crate::mutate::Dice;

/// What is done with a case: its file, the bytes in it, and chances for what is done now and then.
type Run = fn(&Path, &[u8], &mut Dice) -> Result<(), Error>;

/// A format of files.
pub(crate) struct Format {
    pub name: &'static str,
    /// Name of the file of a case.
    pub file: &'static str,
    /// Whether numbers in it are mostly binary.
    pub binary: bool,
    /// Sound files; the first cases are these.
    pub corpus: Vec<Vec<u8>>,
    pub run: Run,
}

/// All of them, with the files that cases name put into `folder`.
pub(crate) fn all(folder: &Path) -> Vec<Format> {
    corpus::beside(folder);
    let saved = |name: &str| corpus::saved(folder, name);
    let nifti = saved("a.nii");
    let nifti_2 = corpus::nifti_2(&nifti);
    let mut pair = nifti[..348].to_vec();
    pair[108..112].fill(0);
    pair[344..348].copy_from_slice(b"ni1\0");
    let text = |all: &[&str]| all.iter().map(|text| text.as_bytes().to_vec()).collect::<Vec<_>>();
    let named = |all: &[(&str, &str)]| all.iter().map(|(_, text)| text.as_bytes().to_vec()).collect::<Vec<_>>();
    let course = format!(
        "{}{}",
        corpus::PROBLEM.replace("linear", "viscoelastic").replace(
            "poisson = 0.4\n",
            "poisson = 0.4\nknee_strain = 0.3\nstiffening = 2.0\n"
        ),
        corpus::COURSE
    );
    let of = |name, file, binary, corpus, run| Format {
        name,
        file,
        binary,
        corpus,
        run,
    };
    vec![
        of("nifti", "case.nii", true, vec![nifti.clone()], labels),
        of("nifti-gz", "case.nii.gz", true, vec![nifti], packed),
        of("nifti-2", "case.nii", true, vec![nifti_2], labels),
        of("nifti-pair", "pair.hdr", true, vec![pair], labels),
        of(
            "written",
            "case.gz",
            true,
            written()
                .map(|written| saved(&format!("a{}", written.ending)))
                .collect(),
            labels,
        ),
        of(
            "nrrd",
            "case.nrrd",
            false,
            vec![corpus::nrrd("encoding: raw\n\n"), saved("a.nrrd"), corpus::texture()],
            labels,
        ),
        of(
            "seg-nrrd",
            "case.seg.nrrd",
            false,
            vec![corpus::nrrd("encoding: raw\n\n"), saved("a.seg.nrrd")],
            labels,
        ),
        of(
            "nhdr",
            "case.nhdr",
            false,
            vec![
                corpus::nrrd("encoding: raw\ndata file: labels.raw\n"),
                corpus::nrrd("encoding: raw\nline skip: 0\nbyte skip: -1\ndata file: LIST\nlabels.raw\n"),
            ],
            labels,
        ),
        of(
            "metaimage",
            "case.mha",
            false,
            vec![
                corpus::metaimage("LOCAL"),
                corpus::metaimage("labels.raw"),
                saved("a.mha"),
            ],
            labels,
        ),
        of(
            "texture",
            "case.nrrd",
            false,
            vec![corpus::texture(), corpus::nrrd("encoding: raw\n\n")],
            texture,
        ),
        of(
            "sequence-mha",
            "case.igs.mha",
            false,
            vec![corpus::sequence(false)],
            sequence,
        ),
        of(
            "sequence-nrrd",
            "case.igs.nrrd",
            false,
            vec![corpus::sequence(true)],
            sequence,
        ),
        of(
            "gmsh",
            "case.msh",
            false,
            vec![corpus::gmsh22(true), corpus::gmsh41(true)],
            mesh,
        ),
        of(
            "gmsh-binary",
            "case.msh",
            true,
            vec![corpus::gmsh22(false), corpus::gmsh41(false)],
            mesh,
        ),
        of(
            "vtk",
            "case.vtk",
            false,
            vec![corpus::vtk(true, false), corpus::vtk(true, true)],
            mesh,
        ),
        of(
            "vtk-binary",
            "case.vtk",
            true,
            vec![corpus::vtk(false, false), corpus::vtk(false, true)],
            mesh,
        ),
        of(
            "vtu",
            "case.vtu",
            false,
            vec![corpus::vtu(folder), corpus::VTU.into()],
            mesh,
        ),
        of(
            "scene",
            "case.toml",
            false,
            [text(&[corpus::SCENE]), named(scene::EXAMPLES)].concat(),
            scene,
        ),
        of(
            "scenario",
            "case.toml",
            false,
            [text(&[corpus::SCENARIO]), named(scenario::EXAMPLES)].concat(),
            scenario,
        ),
        of(
            "problem",
            "case.toml",
            false,
            text(&[corpus::PROBLEM, &course, statics::EXAMPLE, statics::CREEP]),
            problem,
        ),
        of("beam", "case.toml", false, text(&[beam_case::EXAMPLE]), beam),
        of(
            "material",
            "case.toml",
            false,
            text(&[material_case::EXAMPLE]),
            material,
        ),
        of(
            "poses",
            "case.csv",
            false,
            text(&[corpus::POSES, corpus::AIMED, corpus::MATRICES]),
            poses,
        ),
        of("points", "case.csv", false, text(&[corpus::POINTS]), stretches),
        of(
            "dicom",
            "case.dcm",
            true,
            vec![
                corpus::dicom("1.2.840.10008.1.2.1"),
                corpus::dicom("1.2.840.10008.1.2.5"),
                corpus::dicom("1.2.840.10008.1.2.4.50"),
            ],
            pictures,
        ),
        of(
            "png",
            "case.png",
            true,
            vec![corpus::png(true), corpus::png(false)],
            pictures,
        ),
        of("ply", "case.ply", false, vec![corpus::ply(true)], surface),
        of("ply-binary", "case.ply", true, vec![corpus::ply(false)], surface),
        of("stl", "case.stl", false, text(&[corpus::STL]), surface),
        of("obj", "case.obj", false, text(&[corpus::OBJ]), surface),
        of(
            "moduli",
            "case.csv",
            false,
            text(&[corpus::MODULI, corpus::CREEP]),
            measured,
        ),
        of("sessions", "case.csv", false, text(&[corpus::SESSIONS]), sessions),
        of("echoes", "case.igs.mha", false, vec![corpus::echoes()], echoes),
        of("names", "case.csv", false, text(&corpus::NAMES_OF_LABELS), names),
        of("plus-xml", "case.xml", false, text(&[corpus::XML]), calibration),
        of("costs", "case.json", false, text(&[corpus::COSTS]), costs),
    ]
}

fn beside<'a>(path: &'a Path, name: &str) -> (&'a Path, std::path::PathBuf) {
    let folder = path.parent().expect("a folder");
    (folder, folder.join("out").join(name))
}

/// `info`, `mesh make`, `render --labels`, and writing in every format.
fn labels(path: &Path, _: &[u8], dice: &mut Dice) -> Result<(), Error> {
    let opened = segmentation::open(path, &Naming::default())?;
    let volume = &opened.volume;
    let _ = segmentation::SegmentationInfo::new(&opened, path).to_string();
    if volume.voxels().len() > 10_000 {
        return Ok(());
    }
    let endings: Vec<_> = written().map(|written| written.ending).collect();
    let (folder, out) = beside(path, &format!("a{}", endings[dice.below(endings.len())]));
    save(volume, &out)?;
    match dice.below(32) {
        0 => {
            let regions: Vec<(u8, i32)> = (1..volume.labels().len())
                .map(|index| (index as u8, index as i32))
                .collect();
            let grid = LabelGrid {
                labels: volume.voxels(),
                size: volume.size(),
                index_to_world: *volume.index_to_world(),
                regions: &regions,
            };
            let _ = generate(&grid, 60, &GenerateOptions::default(), |_| {});
        }
        1..4 => {
            // Solid textures take longer than all else.
            let mut file = SceneFile::for_labels(path);
            file.effects = Some((&Effects::default()).into());
            let _ = rendered(file, folder);
        }
        _ => {}
    }
    Ok(())
}

/// The bytes inside a compressed file.
fn packed(path: &Path, bytes: &[u8], dice: &mut Dice) -> Result<(), Error> {
    let mut packed = GzEncoder::new(Vec::new(), Level::fast());
    packed
        .write_all(bytes)
        .and_then(|()| std::fs::write(path, packed.finish()?))
        .expect("written");
    labels(path, bytes, dice)
}

fn texture(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let image = load_scalar(path)?;
    let _ = SolidTexture::from_scalar(image.size, image.spacing_mm, image.data, &TextureOptions::default())
        .map(|texture| texture.sample([0.3_f64, -7.0, 1e9]));
    Ok(())
}

fn sequence(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let _ = Sequence::read_poses(path).map_err(|error| error.to_string());
    let sequence = Sequence::read(path)?;
    for frame in 0..sequence.frames.len().min(4) {
        let _ = (sequence.image(frame), sequence.transform(frame, "Probe", "Needle"));
    }
    Ok(())
}

/// `mesh info`, writing, and a static problem on it.
fn mesh(path: &Path, bytes: &[u8], dice: &mut Dice) -> Result<(), Error> {
    let file = read_mesh_bytes(bytes, path, &ReadOptions::default())?;
    let quality = Quality::measure(&file.mesh, &file.current());
    let usable = quality.usable().is_ok();
    let (folder, out) = beside(path, "a.vtu");
    write_vtu(&out, &file.mesh, file.displacements.as_deref())?;
    let again = read_mesh(&out, &ReadOptions::default())?;
    assert_eq!(
        again.mesh.elements(),
        file.mesh.elements(),
        "a mesh that was written reads as another"
    );
    if usable && dice.below(4) == 0 {
        let name = path.file_name().expect("a name").to_string_lossy();
        let text = corpus::PROBLEM.replace("block.msh", &name);
        let _ = ProblemFile::parse(&text, "problem.toml")?
            .resolve(folder)
            .and_then(|problem| problem.solve(true));
    }
    Ok(())
}

/// A number of a file that makes work, cut to a little; what is out of range stays so.
fn cut(number: Option<u32>, default: u32, most: u32, range: u32) -> Option<u32> {
    let number = number.unwrap_or(default);
    Some(if number <= range { number.min(most) } else { number })
}

/// `plan`, and `render` on a small grid.
fn rendered(mut file: SceneFile, folder: &Path) -> Result<(), Error> {
    little(&mut file);
    let small = file.probe.is_some();
    let scene = file.resolve(folder)?;
    let mut state = FrameState::at(Matrix4::identity());
    scene.state(0, scene.frames(), &mut state)?;
    let mut synth = Synthesizer::new(scene.anatomy, scene.settings, Backend::Cpu)?;
    let _ = synth.plan().report(&Default::default()).to_string();
    if small {
        synth.render(&state)?;
    }
    Ok(())
}

fn little(file: &mut SceneFile) {
    if let Some(volume) = file.volume.as_mut().filter(|volume| volume.phantom.is_some()) {
        volume.resolution_mm = volume.resolution_mm.filter(|mm| !(0.3..5.0).contains(mm)).or(Some(5.0));
    }
    if let Some(probe) = &mut file.probe {
        probe.sampling.lines = cut(probe.sampling.lines, 256, 16, 8192);
        probe.sampling.samples = cut(probe.sampling.samples, 512, 32, 16384);
    }
    let image = file.image.get_or_insert_default();
    *image = ImageSpec {
        width: cut(Some(image.width), 0, 24, 16384).unwrap_or(0),
        height: cut(Some(image.height), 0, 16, 16384).unwrap_or(0),
        ..*image
    };
}

fn scene(path: &Path, _: &[u8], dice: &mut Dice) -> Result<(), Error> {
    let mut file = SceneFile::read(path)?;
    // One of eight has its solid textures, which take a hundred times as long as the rest, as do phantoms.
    if dice.below(8) != 0 {
        file.effects.get_or_insert_default().texture = Some(Stated::Switch(false));
    }
    if file.volume.as_ref().is_some_and(|volume| volume.phantom.is_some()) {
        Ok(())
    } else {
        rendered(file, beside(path, "").0)
    }
}

fn scenario(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let mut file = ScenarioFile::read(path)?;
    match &mut file.scene {
        Some(SceneSource::Inline(scene)) if scene.volume.as_ref().is_none_or(|volume| volume.phantom.is_none()) => {
            little(scene)
        }
        _ => return Ok(()),
    }
    if file.tissue.mesh.is_none() {
        file.tissue.nodes = cut(file.tissue.nodes, 3300, 100, 1_000_000);
    }
    let mut scenario = file.resolve(beside(path, "").0, |_| {})?;
    scenario.timing.steps = scenario.timing.steps.min(5);
    let mut model = scenario.model(|_, _| {})?;
    scenario.trial(model.as_mut(), 1.0, Duration::from_millis(20), |_| {})?;
    Ok(())
}

fn problem(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let file = ProblemFile::read(path)?;
    let long = file.history.as_ref().is_some_and(|history| {
        let end = history.time_s.last().copied().unwrap_or(0.0);
        end / history.step_s > 20.0 || history.time_s.len() > 20
    });
    let problem = file.resolve(beside(path, "").0)?;
    if !long {
        let solved = problem.solve(true)?;
        let _ = insonify::solve::Report::new(&problem, &solved).to_string();
    }
    Ok(())
}

fn beam(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let case = beam_case::CaseFile::read(path)?.resolve()?;
    let length: f64 = case.problem.layers.iter().map(|layer| layer.thickness_mm).sum();
    if length / case.problem.element_mm < 1000.0 {
        let shape = case.solve()?;
        let _ = beam_case::BeamReport::new(&shape).to_string();
    }
    Ok(())
}

fn material(path: &Path, _: &[u8], dice: &mut Dice) -> Result<(), Error> {
    let case = material_case::CaseFile::read(path)?.resolve()?;
    // It is halved until it is exact: thousands of steps.
    if dice.below(16) == 0 {
        let report = case.run()?;
        let _ = (report.warnings(), report.to_string());
    }
    Ok(())
}

fn poses(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let outcome = Trajectory::from_csv(path, Default::default(), Default::default());
    bounded(outcome.map(|path| path.at(0.25)));
    Ok(())
}

fn names(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    Ok(Names::read(path).map(drop)?)
}

fn stretches(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let samples = points::read(path)?;
    for compression in [Compression::UEng, Compression::UTru, Compression::CTru] {
        let _ = fit::Fit::new(&samples, compression);
    }
    Ok(())
}

fn calibration(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    bounded(PlusConfig::read(path).and_then(|read| {
        let matrix = read.transform("Image", "Probe")?;
        Calibration::new(&matrix, read.array_centre_px().unwrap_or_default())
    }));
    Ok(())
}

/// A cache in which the file is the one asked for.
fn costs(path: &Path, bytes: &[u8], _: &mut Dice) -> Result<(), Error> {
    let (_, out) = beside(path, "cache");
    let cache = Cache::at(&out, "machine");
    cache.put(&["thing"], &())?;
    let kept = std::fs::read_dir(&out)
        .expect("a folder")
        .flatten()
        .next()
        .expect("a file")
        .path();
    std::fs::write(kept, bytes).expect("written");
    let sound = |costs: &Costs| {
        costs
            .settings
            .iter()
            .all(|setting| setting.is_sound(|_, value| !value.is_empty()))
    };
    if let Ok(Some(costs)) = cache.get(&["thing"], sound) {
        for budget in [0.0, 3.0, 1e9] {
            let _ = pick("frame_ms", &costs, budget, |_| true);
        }
    }
    Ok(())
}

/// `realism` on two frames.
fn pictures(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    Ok(picture::read(&[path.to_owned()], 2, None).map(drop)?)
}

fn surface(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let surface = SurfaceFile::read(path)?;
    assert!(surface.longest_side().is_finite());
    Ok(())
}

/// `material fit`.
fn measured(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let mut measured = Measurements::default();
    measured.add(path)?;
    if let Ok(fit) = MaterialFit::new(&measured, None, Default::default()) {
        finite(&fit.to_string());
        fit.warnings.iter().for_each(|warning| finite(warning));
    }
    Ok(())
}

/// `score --groups`.
fn sessions(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    finite(&groups::compare(&groups::read(path)?).to_string());
    Ok(())
}

/// `rf --bmode` of the first frame.
fn echoes(path: &Path, _: &[u8], _: &mut Dice) -> Result<(), Error> {
    let echoes = Echoes::read(path)?;
    let envelope = envelope(&echoes, 0);
    assert!(
        grey(&envelope, white(&envelope), 60.0)
            .iter()
            .all(|grey| grey.is_finite())
    );
    Ok(())
}

/// Checks that a text states no number that is none.
fn finite(text: &str) {
    let mut words = text.split(|c: char| !c.is_alphanumeric());
    assert!(!words.any(|word| word == "NaN" || word == "inf"), "{text}");
}

/// Checks the message of an error.
fn bounded<T, E: std::fmt::Display>(outcome: Result<T, E>) {
    if let Err(error) = outcome {
        let length = error.to_string().len();
        assert!((1..20_000).contains(&length), "a message of {length} bytes");
    }
}
