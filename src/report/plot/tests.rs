use super::*;
use insonify_base::pareto::front;

fn plot() -> Plot {
    let points = vec![[1.0, 1e-3], [10.0, 1e-7], [100.0, 1e-12], [20.0, 1e-2]];
    Plot {
        title: "error against time".into(),
        x: Axis::log("time, ms"),
        y: Axis::log("relative error"),
        markers: vec!["CPU".into()],
        front: vec![front(&points)],
        equal: false,
        series: vec![Series {
            name: "level I".into(),
            points,
            joined: false,
            marker: Marker::Disc,
            colour: 0,
        }],
    }
}

#[test]
fn svg_and_pixels_show_the_series() {
    let svg = plot().svg().unwrap();
    for text in [
        "error against time",
        "time, ms",
        "relative error",
        "level I",
        "best: none beats them",
        "1e-12",
    ] {
        assert!(svg.contains(text), "{text} is not in the SVG");
    }
    let pixels = plot().rgb().unwrap();
    let blue = pixels.chunks_exact(3).filter(|pixel| *pixel == [0, 114, 178]).count();
    assert!(blue > 4 * 60, "four discs of radius 5: {blue} pixels of their colour");
    // Letters of the title: dark pixels in its rows.
    let dark = pixels[..(3 * SIZE[0] * 40) as usize]
        .chunks_exact(3)
        .filter(|p| p[0] < 100)
        .count();
    assert!(dark > 200, "{dark} dark pixels where the title stands");
    assert_eq!(svg, plot().svg().unwrap());
}

/// Long adapter names are wrapped: no letter is cut off at the right edge.
#[test]
fn long_names_stay_within_the_picture() {
    let mut plot = plot();
    plot.markers = [
        "gpu, llvmpipe (LLVM 15.0.6, 256 bits)",
        "a-name-of-forty-letters-without-any-space",
    ]
    .map(str::to_owned)
    .to_vec();
    let pixels = plot.rgb().unwrap();
    let edge = pixels
        .chunks_exact(3 * SIZE[0] as usize)
        .flat_map(|row| &row[row.len() - 12..]);
    assert!(edge.into_iter().all(|value| *value == 255), "letters at the edge");
    let svg = plot.svg().unwrap();
    for line in [
        "gpu, llvmpipe (LLVM",
        "15.0.6, 256 bits)",
        "a-name-of-forty-letters",
        "-without-any-space",
    ] {
        assert!(svg.lines().any(|text| text.trim() == line), "{line}");
    }
    assert!(
        plot.svg_for_page()
            .unwrap()
            .contains("gpu, llvmpipe (LLVM 15.0.6, 256 bits)")
    );
}

#[test]
fn values_that_an_axis_cannot_show_are_left_out() {
    let mut plot = plot();
    plot.series[0].points = vec![[0.0, 1.0], [f64::NAN, 1.0], [1.0, f64::INFINITY]];
    plot.front.clear();
    plot.svg().unwrap();
    plot.x.log = false;
    plot.series[0].points = vec![[5.0, 5.0]];
    plot.rgb().unwrap();
}

#[test]
fn rounding_at_zero_is_labelled_zero() {
    let mut plot = plot();
    (plot.x, plot.y) = (Axis::linear("time, s"), Axis::linear("force, N"));
    plot.front.clear();
    plot.series.truncate(1);
    plot.series[0].points = vec![[0.0, -0.3], [3.0, 0.6]];
    let svg = plot.svg().unwrap();
    let labels: Vec<&str> = svg.lines().map(str::trim).collect();
    assert!(labels.contains(&"0") && !svg.contains("e-1"), "{svg}");
}

/// A logarithmic axis always includes a power of ten, even if its values are close together.
#[test]
fn a_logarithmic_axis_has_a_number_on_it() {
    let axis = Axis::log("ratio");
    let narrow = axis.range([0.27, 0.3].into_iter());
    assert!(narrow.contains(&0.1) && narrow.contains(&1.0), "{narrow:?}");
    let around = axis.range([0.8, 1.3].into_iter());
    assert!(
        around.contains(&1.0) && around.start > 0.4 && around.end < 2.5,
        "{around:?}"
    );
    assert_eq!(axis.range(std::iter::empty()), 1.0..10.0);
}
