//! `insonify texture`: solid textures from images.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use insonify_anatomy::volume::VolumeError;
use insonify_base::range::numbers;
use insonify_study::realism::picture::{Picture, read};
use insonify_study::texture::synthesis::Exemplars;
use insonify_study::texture::{Content, Preparation, PreparedExemplar, Region, make};

use super::failure::{Error, usage};
use super::output::{self, Force};
use super::realism::pixel;
use super::terminal;

const TEACHING: &str = "\
An exemplar is a region of even tissue in a B-mode image, without writing, calipers or edges of organs. Its columns run along x of the solid and its
rows (depth) along y; it counts for all planes, stretched in the x-z plane so that lengths along z are those along x; --zy and --xz give others.

  structure  only what is coarser than the speckle cell; the scene adds its own speckle (default)
  keep       all of it with its speckle; leave the speckle effect out of the scene, or it is speckled twice

Examples:
  insonify texture liver.png --region 200,150,180,180 --mm-per-pixel 0.3 -o liver.nrrd --page liver.html
  insonify texture muscle-long.png --region 40,60,300,200 --zy muscle-cross.png --zy-region 50,60,200,200 --mm-per-pixel 0.1 -o muscle.nrrd
  insonify texture prostate.igs.mha --region 200,200,160,160 --content keep --size 128 -o prostate.nrrd

The output is periodic. docs/training.md describes the steps from images to a scene.";

/// Ratio of lengths of autocorrelation, or of steps, at which a solid is unlike its exemplar.
const UNLIKE: f64 = 1.5;

/// Makes a solid texture from regions of ultrasound images
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct TextureArgs {
    /// Image of the x-y plane: PNG, JPEG, DICOM, or an image sequence (.mha, .mhd, .nrrd), of which the first frame is used
    #[arg(value_name = "IMAGE")]
    image: PathBuf,
    /// Region of even tissue: left column, upper row, columns, rows
    #[arg(long, value_name = "X,Y,W,H", value_parser = numbers::<4>)]
    region: [f64; 4],
    /// Image of the z-y plane, for tissue with a direction [default: IMAGE]
    #[arg(long, value_name = "IMAGE", requires = "zy_region")]
    zy: Option<PathBuf>,
    /// Region of the z-y image
    #[arg(long, value_name = "X,Y,W,H", value_parser = numbers::<4>, requires = "zy")]
    zy_region: Option<[f64; 4]>,
    /// Image of the x-z plane
    #[arg(long, value_name = "IMAGE", requires = "xz_region")]
    xz: Option<PathBuf>,
    /// Region of the x-z image
    #[arg(long, value_name = "X,Y,W,H", value_parser = numbers::<4>, requires = "xz")]
    xz_region: Option<[f64; 4]>,
    /// Curved array: column and row of the virtual apex, at which the scanlines meet: above the region, or below where
    /// the array is at the bottom; the largest rectangle of angle and depth in the region is resampled to beam space
    #[arg(long, value_name = "X,Y", value_parser = numbers::<2>, allow_hyphen_values = true)]
    apex: Option<[f64; 2]>,
    /// Side of a pixel, if the image does not state it
    #[arg(long, value_name = "MM", value_parser = pixel)]
    mm_per_pixel: Option<f64>,
    /// Dynamic range of the image: decibels from black to white
    #[arg(long, value_name = "DB", default_value_t = 60.0)]
    range_db: f64,
    /// What the texture holds
    #[arg(long, value_enum, default_value_t = KeptDetail::Structure)]
    content: KeptDetail,
    /// Voxels along each side: a multiple of 4 from 32 to 256
    #[arg(long, value_name = "N", default_value_t = 64)]
    size: usize,
    /// Side of a voxel [default: the side of a pixel; of `structure` half a speckle cell]
    #[arg(long, value_name = "MM", value_parser = pixel)]
    voxel_mm: Option<f64>,
    /// Seed
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// File to write
    #[arg(short, long, value_name = "FILE.nrrd")]
    output: PathBuf,
    /// Write a page that compares the texture with the image
    #[arg(long, value_name = "PAGE.html")]
    page: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON: the figures of the comparison
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum KeptDetail {
    /// Only what is coarser than the speckle cell
    Structure,
    /// All of it, with its speckle
    Keep,
}

impl TextureArgs {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let inputs: Vec<PathBuf> = [Some(&self.image), self.zy.as_ref(), self.xz.as_ref()]
            .into_iter()
            .flatten()
            .cloned()
            .collect();
        self.force.check_ending([&self.output], "nrrd", "textures", &inputs)?;
        self.force.check_ending(&self.page, "html", "pages", &inputs)?;
        if !(10.0..=200.0).contains(&self.range_db) {
            return Err(usage(format!("--range-db {}", self.range_db), "give 10 to 200 dB"));
        }
        let first = self.prepared(&self.image, self.region, self.voxel_mm)?;
        if let Some(([column, row], db)) = first.uneven() {
            terminal::warn(format_args!(
                "the region is not even: around {:.0} % of its width and {:.0} % of its height it is {:.0} dB {} than the rest, which \
                 becomes blots or stripes of the texture; take a region of one even tissue",
                100.0 * column,
                100.0 * row,
                db.abs(),
                if db < 0.0 { "darker" } else { "brighter" }
            ));
        }
        let prepared_view = |image: &Option<PathBuf>, region: Option<[f64; 4]>| match (image, region) {
            (Some(image), Some(region)) => self.prepared(image, region, Some(first.voxel_mm)).map(Some),
            _ => Ok(None),
        };
        let (zy, xz) = (
            prepared_view(&self.zy, self.zy_region)?,
            prepared_view(&self.xz, self.xz_region)?,
        );
        let exemplar = |prepared: PreparedExemplar| prepared.exemplar;
        let exemplars = Exemplars::of(first.exemplar.clone(), zy.map(exemplar), xz.map(exemplar));
        let solid = terminal::with_share("synthesis", |share| {
            make(&first, exemplars, self.size, self.seed, &mut |done| share(done))
        })?;
        let extent_mm = solid.side as f64 * solid.voxel_mm;
        let longest = solid
            .figures
            .exemplar_correlation_mm
            .into_iter()
            // Where correlation does not fall off within the image, its length is unknown: the solid is taken
            // as too small for it.
            .map(|mm| mm.unwrap_or(extent_mm));
        let longest = longest.fold(0.0, f64::max);
        if 4.0 * longest > extent_mm {
            terminal::warn(format_args!(
                "the solid is {extent_mm:.1} mm wide, and the structure of the image {longest:.1} mm: it repeats \
                 visibly; take a larger --size or --voxel-mm"
            ));
        }
        let lengths = solid
            .figures
            .correlation_mm
            .iter()
            .zip(solid.figures.exemplar_correlation_mm);
        let lengths = lengths.filter_map(|(solid_mm, exemplar_mm)| Some((*solid_mm)? / exemplar_mm?));
        if lengths.clone().any(|ratio| !(1.0 / UNLIKE..UNLIKE).contains(&ratio)) {
            terminal::warn(
                "the structure of the solid is not as long as that of the image: look at the page, and take a region of one even tissue",
            );
        }
        let seam = solid.figures.seam.into_iter().fold(0.0, f64::max);
        if seam >= UNLIKE {
            terminal::warn(format_args!(
                "the texture does not close: steps across its border are {seam:.1} times those within, a seam in large organs; \
                 take a region of one even tissue, or a larger --size"
            ));
        }
        solid.write(&self.output)?;
        let name = self
            .output
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let lines = format!(
            "[[texture]]\nname = {:?}\nfile = {:?}\nseam = \"periodic\"\n",
            name,
            self.output.display().to_string()
        );
        output::requested(&self.page, || solid.page(&lines))?;
        terminal::show(&solid.figures, self.json, || format!("{}\n{lines}", solid.figures))
    }

    fn prepared(&self, image: &PathBuf, region: [f64; 4], voxel_mm: Option<f64>) -> Result<PreparedExemplar, Error> {
        let pictures = read(std::slice::from_ref(image), 1, self.mm_per_pixel)?;
        let picture: &Picture = pictures
            .first()
            .ok_or_else(|| usage(format!("{}: no image", image.display()), "name a picture or a sequence"))?;
        let Some(pixel_mm) = picture.mm else {
            let found = format!("{}: the size of a pixel is not stated", image.display());
            return Err(usage(found, "give --mm-per-pixel"));
        };
        if region.iter().any(|side| *side < 0.0 || side.fract() != 0.0) {
            return Err(VolumeError::new(format!("region {region:?}; expected whole numbers from 0")).into());
        }
        let preparation = Preparation {
            pixel_mm,
            range_db: self.range_db,
            content: match self.content {
                KeptDetail::Structure => Content::Structure,
                KeptDetail::Keep => Content::Keep,
            },
            voxel_mm,
        };
        let region = Region {
            window: region.map(|side| side as usize),
            apex_px: self.apex,
        };
        Ok(preparation.prepare(picture, &region)?)
    }
}
