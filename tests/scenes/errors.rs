//! Every mistake is named, with its key, its line and a caret on it.

use insonify_base::blame::Blame;
use insonify_base::document::InputError;
use insonify_base::range::OutOfRange;

use super::support::{fault, small};

/// The text that the caret stands under.
fn marked(error: &InputError) -> String {
    let excerpt = error.excerpt().expect("a place");
    excerpt.text[excerpt.span.clone()].to_owned()
}

/// Scene text, what the caret marks, what the message says.
fn check(text: &str, mark: &str, says: &[&str]) {
    let error = fault(text);
    let shown = error.to_string();
    assert_eq!(marked(&error), mark, "{shown}\nof\n{text}");
    let help = error.help().unwrap_or_default();
    for part in says {
        assert!(
            shown.contains(part) || help.contains(part),
            "{shown}\n{help}\nlacks {part}"
        );
    }
    assert!(!error.is_machine());
}

#[test]
fn text_that_is_no_toml() {
    check("version = 1\n[volume\nphantom = 3", "", &["test.toml, line 2"]);
    check(&small("seed = = 3"), "=", &["line 5"]);
}

#[test]
fn unknown_keys_get_a_suggestion() {
    check(
        &small("[probe]\nkind = \"phased\"\nangle_deg = 80\ndepht_mm = 160"),
        "depht_mm",
        &["unknown key", "did you mean `depth_mm`?", "line 8"],
    );
    check(&small("[effects.speckel]"), "speckel", &["did you mean `speckle`?"]);
    check(&small("[image]\ndepth_mm = 3"), "depth_mm", &["belongs in [probe]"]);
    check(
        &small("[image]\ndynamic_range_db = 50"),
        "dynamic_range_db",
        &["belongs in [effects.tone]"],
    );
    check(
        &small("[deform.field]\nkind = \"swirl\"\ncentre_mm = [0,0,0]\naxis = [0,0,1]\nangel_deg = 3\nradius_mm = 4"),
        "angel_deg",
        &["did you mean `angle_deg`?"],
    );
    check(
        &small("[[tissue]]\nname = \"liver\"\n[[tissue]]\nname = \"x\"\nyoung = 3"),
        "young",
        &["young_kpa"],
    );
    check(&small("[colour]"), "colour", &["belongs in [[tissue]]"]);
    check(
        &small("[image]\nscanner = \"raw\""),
        "scanner",
        &["belongs before all tables"],
    );
    check(
        &small("[scanner]\nkind = \"raw\""),
        "[scanner]",
        &["found a table", "\"raw\" or \"clinical\""],
    );
    check(&small("[zzz]"), "zzz", &["known here", "effects"]);
}

#[test]
fn unknown_words_get_a_suggestion() {
    check(
        "version = 1\n[volume]\nphantom = \"abdomne\"",
        "\"abdomne\"",
        &["did you mean \"abdomen\"?"],
    );
    check(
        &small("[pose]\ntarget = \"livre\""),
        "\"livre\"",
        &["pose.target", "did you mean \"liver\"?"],
    );
    check(
        &small("[[tissue]]\nname = \"liver\"\ntexture = \"fatt\""),
        "\"fatt\"",
        &["tissue[0].texture", "did you mean \"fat\"?"],
    );
    check(
        &small("[[tissue]]\nname = \"x\"\nlike = \"bon\""),
        "\"bon\"",
        &["tissue[0].like"],
    );
}

#[test]
fn numbers_out_of_range_are_marked() {
    check(
        &small("[effects.speckle]\naxial_mm = 99"),
        "99",
        &["effects.speckle.axial_mm", "0.05 to 10", "line 6"],
    );
    check(
        &small("[effects.tone]\ntgc_points = [[0, 0], [2, 900]]"),
        "900",
        &["tgc_points[1][1]"],
    );
    check(
        &small("[probe]\nkind = \"phased\"\nangle_deg = 0\ndepth_mm = 160"),
        "0",
        &["probe.angle_deg", "1 to 120"],
    );
    check(
        &small("[probe]\nkind = \"phased\"\nangle_deg = 80\ndepth_mm = nan"),
        "nan",
        &["probe.depth_mm", "NaN"],
    );
    check(&small("[image]\nmargin = 0.5"), "0.5", &["image.margin", "0.45"]);
    check(&small("[image]\nwidth = 0"), "0", &["image.width", "16384"]);
    check(&small("[image]\nheight = 16385"), "16385", &["image.height"]);
    check(&small("[image]\nfill = 256"), "256", &["256", "from 0 to 255"]);
    check(
        &small("[[tissue]]\nname = \"a\"\n[[tissue]]\nname = \"liver\"\npoisson = 0.5"),
        "0.5",
        &["tissue[1].poisson"],
    );
    check(&small("[motion]\nframes = 0"), "0", &["motion.frames", "1 to 1000000"]);
    check(
        "version = 1\n[volume]\nphantom = \"spine\"\nresolution_mm = 0.1",
        "0.1",
        &["volume.resolution_mm", "0.3 to 5"],
    );
    check(
        &small(
            "[deform]\nnodes = 3\n[deform.field]\nkind = \"affine\"\nmatrix = [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]",
        ),
        "3",
        &["deform.nodes"],
    );
    check(
        &small(
            "[deform]\nramp_s = -1\nfield = { kind = \"compression\", fixed_mm = [0,0,0], direction = [0,0,1], strain = 0.1 }",
        ),
        "-1",
        &["deform.ramp_s"],
    );
}

#[test]
fn poses_and_needles_are_marked() {
    check(
        &small("[pose]\nposition_mm = [0, 0, 0]\ndirection = [0, 0, 0]"),
        "[0, 0, 0]",
        &["pose.direction"],
    );
    check(&small("[pose]\ntilt_deg = inf"), "inf", &["pose.tilt_deg"]);
    check(
        &small("[pose]\ntarget = \"liver\"\nposition_mm = [0,0,0]"),
        "[pose]",
        &["`target`"],
    );
    check(
        &small("[pose]\nmatrix = \"2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\""),
        "\"2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1\"",
        &["pose.matrix", "off a rotation"],
    );
    check(
        &small("[needle]\ntip_mm = [0, 0, 0]\nentry_mm = [0, 0, 9]\ndiameter_mm = 20"),
        "20",
        &["needle.diameter_mm", "0.05 to 10"],
    );
    check(&small("[needle]"), "[needle]", &["tip_mm"]);
    check(
        &small(
            "[needle]\ntip_mm = [0,0,0]\ndirection = [0,0,1]\n[needle.bending]\nentry_mm = [0,0,0]\nentry_direction = [0,0,1]",
        ),
        "[needle.bending]",
        &["needle.motion"],
    );
    check(
        &small("[deform.field]\nkind = \"compression\"\nfixed_mm = [0,0,0]\ndirection = [0,0,1]\nstrain = 2"),
        "2",
        &["deform.field[0].strain", "below 1"],
    );
    check(
        &small("[[deform.field]]\nkind = \"swirl\"\ncentre_mm = [0,0,0]\naxis = [0,0,1]\nangle_deg = 3\nradius_mm = 0"),
        "0",
        &["deform.field[0].radius_mm"],
    );
}

#[test]
fn tables_that_do_not_go_together_are_explained() {
    check(
        "version = 1\n[volume]\nct = \"ct.nrrd\"",
        "[volume]",
        &["neither `phantom` nor `file`"],
    );
    check(
        "version = 1\n[volume]\nphantom = \"spine\"\nfile = \"a.nii\"",
        "[volume]",
        &["both"],
    );
    check(&small("muscle_mm = 3"), "3", &["volume.muscle_mm", "with a phantom"]);
    check(&small("fat_mm = 3"), "3", &["volume.fat_mm", "with a phantom"]);
    check(
        "version = 3\n[volume]\nphantom = \"spine\"",
        "3",
        &["found version 3", "expected 1 or 2"],
    );
    check(&small("[deform]"), "[deform]", &["neither `field` nor `mesh`"]);
    check(
        &small(
            "[pose]\ntarget = \"liver\"\nrock_deg = 5\n[[motion.keyframes]]\ntime_s = 0\nposition_mm = [0,0,0]\ndirection = [0,1,0]",
        ),
        "[pose]",
        &["`[motion]`"],
    );
    check(
        &small("[probe]\nkind = \"linear\"\nwidth_mm = 30\ndepth_mm = 50\nangle_deg = 3"),
        "3",
        &["no meaning for a linear probe"],
    );
    check(
        &small("[probe]\nwidth_mm = 50"),
        "50",
        &["no meaning for a curvilinear probe", "state the `kind`"],
    );
}

#[test]
fn missing_files_are_named_with_their_key() {
    let one = "version = 1\n[volume]\nfile = \"nowhere.nii.gz\"";
    check(one, "\"nowhere.nii.gz\"", &["volume.file", "nowhere.nii.gz", "line 3"]);
    check(
        &small("[motion]\ncsv = \"p.csv\""),
        "\"p.csv\"",
        &["motion.csv", "p.csv"],
    );
    check(
        &small("[motion.sequence]\nfile = \"s.mha\""),
        "\"s.mha\"",
        &["motion.sequence.file", "s.mha"],
    );
    check(&small("[motion.sequence]"), "[motion.sequence]", &["no `file`"]);
    check(
        &small("[needle.motion]\ncsv = \"n.csv\""),
        "\"n.csv\"",
        &["needle.motion.csv", "n.csv"],
    );
    check(
        &small("[[texture]]\nname = \"a\"\nfile = \"t.nrrd\""),
        "\"t.nrrd\"",
        &["texture[0].file", "t.nrrd"],
    );
    check(
        &small("[deform]\nmesh = \"m.vtu\""),
        "\"m.vtu\"",
        &["deform.mesh", "m.vtu"],
    );
}

#[test]
fn an_error_has_file_line_column_and_cause() {
    let error = fault(&small("[effects.blur]\nwidth_mm = -2"));
    assert!((error.cause() as &dyn std::error::Error).is::<OutOfRange>());
    let excerpt = error.excerpt().expect("a place");
    assert_eq!(
        (excerpt.name.as_str(), excerpt.line, excerpt.column),
        ("test.toml", 6, 11)
    );
    assert_eq!(excerpt.text.lines().nth(1), Some("width_mm = -2"));
}
