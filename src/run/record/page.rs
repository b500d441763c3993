//! Self-contained HTML report of a run.

use super::film::Film;
use crate::run::summary::{Distribution, Summary};
use insonify_base::output::OutputError;
use insonify_base::table::Table;
use insonify_base::text::escape;
use insonify_report::page::{Page, address};
use insonify_report::plot::Plot;

/// Maximum number of rows of a table.
const ROWS: usize = 200;

pub(super) fn page(
    title: &str,
    summary: &Summary,
    film: &Film,
    plots: &[(&str, Plot)],
    others: &[&str],
) -> Result<String, OutputError> {
    let mut page = Page::new(title);
    for warning in &summary.warnings {
        page.paragraph("warning", warning);
    }
    page.table(&Table::new(["", ""]).with(figures(summary)));
    frames(&mut page, film);
    for (_, plot) in plots {
        let untitled = Plot {
            title: String::new(),
            ..plot.clone()
        };
        page.wide_figure(&untitled.svg()?, &plot.title);
    }
    tables(&mut page, summary);
    let links = others
        .iter()
        .map(|name| format!("<a href=\"{0}\">{0}</a>", escape(name)));
    let links = links.collect::<Vec<_>>().join(", ");
    page.put(format_args!("<h2>Files</h2><p>{links}</p>"));
    Ok(page.finish())
}

/// Adds the most informative frames, and the others behind a slider.
fn frames(page: &mut Page, film: &Film) {
    let chosen = film.chosen();
    if chosen.is_empty() {
        return;
    }
    page.put("<h2>Frames</h2>");
    let labelled = chosen
        .iter()
        .map(|(name, shot)| (&shot.picture, format!("{name}: {}", shot.caption())));
    page.pictures(labelled);
    let shots = film.shots.iter();
    let shots: Vec<_> = shots
        .filter_map(|shot| Some((address(&shot.picture).ok()?, shot.caption())))
        .collect();
    page.slider(&shots);
}

fn distribution(ms: &Distribution) -> String {
    format!(
        "median {:.3} ms, 95 % {:.3}, 99 % {:.3}, 99.9 % {:.3}, longest {:.3}",
        ms.median, ms.p95, ms.p99, ms.p999, ms.max
    )
}

fn figures(summary: &Summary) -> Vec<[String; 2]> {
    let ms = &summary.step_ms;
    let remesh = ms.remesh_max.map_or("no step remeshed".to_owned(), |longest_ms| {
        format!("{longest_ms:.3} ms")
    });
    let rows = [
        (
            "Simulated",
            format!("{:.3} s in {} steps", summary.simulated_s, summary.steps),
        ),
        (
            "Mesh",
            format!("{} nodes, {} tetrahedra", summary.nodes, summary.elements),
        ),
        (
            "Largest force on the hand",
            format!("{:.3} N", summary.max_base_force_n),
        ),
        ("Largest tip deflection", format!("{:.3} mm", summary.tip_deflection_mm)),
        ("Largest depth", format!("{:.2} mm", summary.max_inserted_mm)),
        ("Remeshes", summary.remeshes.to_string()),
        ("Time of a step", distribution(&ms.wall)),
        (
            "CPU time of a step",
            ms.cpu.as_ref().map_or("not known".to_owned(), distribution),
        ),
        ("Longest step that remeshes", remesh),
    ];
    let rows = rows.map(|(quantity, figure)| [quantity.to_owned(), figure]).into_iter();
    let force = summary
        .max_probe_force_n
        .map(|force| ["Largest force on the probe".to_owned(), format!("{force:.3} N")]);
    let nearest = summary.targets.iter().map(|target| {
        let quantity = format!("Least distance of the tip from the target ({})", target.name);
        [quantity, format!("{:.2} mm", target.nearest_tip_mm)]
    });
    let seeds = summary.misplacement.iter().map(|misplacement| {
        let (figure, offset) = (misplacement.to_string(), place(misplacement.mean_offset_mm));
        [
            format!("Misplacement of {} seeds", misplacement.seeds),
            format!("{figure}; on average by {offset} mm"),
        ]
    });
    rows.chain(force).chain(nearest).chain(seeds).collect()
}

/// Adds targets, seeds, changes of level and events.
fn tables(page: &mut Page, summary: &Summary) {
    let in_mm = |mm: Option<f64>, otherwise: &str| mm.map_or(otherwise.to_owned(), |mm| format!("{mm:.2}"));
    let targets = summary.targets.iter().map(|target| {
        let (tip, seed) = (
            in_mm(Some(target.nearest_tip_mm), ""),
            in_mm(target.nearest_seed_mm, "none"),
        );
        [target.name.clone(), place(target.at_mm), tip, seed]
    });
    let heads = ["target", "at, mm", "least distance of the tip, mm", "nearest seed, mm"];
    table(page, "Targets", heads, targets);
    let images = summary.images.iter().map(|image| {
        [
            image.name.clone(),
            in_mm(Some(image.time_s), ""),
            in_mm(Some(image.rms_mm), ""),
            place([image.lateral_mm, image.axial_mm, image.elevational_mm]),
            format!("{:.1}", image.turn_deg),
            image.dice.map_or(String::new(), |dice| format!("{dice:.3}")),
        ]
    });
    let heads = [
        "planned image",
        "nearest at, s",
        "points off, RMS, mm",
        "array off: lateral, axial, elevational, mm",
        "turned, deg",
        "organ, Dice",
    ];
    table(page, "Planning study", heads, images);
    let points = summary.points.iter().map(|point| {
        let range = |[least, most]: [f64; 2]| format!("{least:.3} to {most:.3}");
        [
            point.name.clone(),
            place(point.at_mm),
            format!("{:.3} at {:.2} s", point.max_displacement_mm, point.max_at_s),
            range(point.axial_mm),
            range(point.lateral_mm),
            range(point.elevational_mm),
        ]
    });
    let heads = [
        "point",
        "at, mm",
        "largest displacement, mm",
        "axial, mm",
        "lateral, mm",
        "elevational, mm",
    ];
    table(page, "Points", heads, points);
    let seeds = summary.seeds.iter().map(|seed| {
        let [planned, deposited] = [(seed.planned_mm, ""), (seed.deposited_mm, "outside the tissue")]
            .map(|(position, otherwise)| position.map_or(otherwise.to_owned(), place));
        [
            in_mm(Some(seed.time_s), ""),
            planned,
            deposited,
            in_mm(seed.distance_mm, ""),
        ]
    });
    let heads = ["left at, s", "planned, mm", "deposited, mm", "distance, mm"];
    table(page, "Seeds", heads, seeds);
    let changes = summary.level_changes.iter().map(|change| {
        [
            format!("{:.3}", change.time_s),
            format!("{} to {}", change.from, change.to),
            format!("{:.3e}", change.force_jump_n),
            format!("{:.3}", change.seconds),
        ]
    });
    let heads = [
        "at, s",
        "level of remeshing",
        "jump of the force on the hand, N",
        "took, s",
    ];
    table(page, "Changes of level", heads, changes);
    let longest = summary.step_ms.longest.iter().map(|step| {
        let spent = step.spent_ms.iter().map(|(work, ms)| format!("{work} {ms:.3}"));
        [
            step.step.to_string(),
            format!("{:.3}", step.ms),
            step.cpu_ms.map_or("not known".to_owned(), |ms| format!("{ms:.3}")),
            step.remeshes.to_string(),
            step.iterations.to_string(),
            spent.collect::<Vec<_>>().join(", "),
        ]
    });
    let heads = [
        "step",
        "took, ms",
        "CPU time, ms",
        "remeshes",
        "iterations",
        "spent on, ms",
    ];
    table(page, "Longest steps", heads, longest);
    let events = summary
        .events
        .iter()
        .map(|event| [format!("{:.3}", event.time_s), event.text.clone(), place(event.at_mm)]);
    table(page, "Events", ["at, s", "what", "where, mm"], events);
}

fn table<const N: usize>(
    page: &mut Page,
    title: &str,
    heads: [&str; N],
    rows: impl ExactSizeIterator<Item = [String; N]>,
) {
    let count = rows.len();
    if count == 0 {
        return;
    }
    page.put(format_args!("<h2>{title}</h2>"));
    page.table(&Table::new(heads).with(rows.take(ROWS)));
    if count > ROWS {
        page.paragraph("soft", &format!("{} more are in summary.json.", count - ROWS));
    }
}

fn place(at_mm: [f64; 3]) -> String {
    at_mm.map(|x| format!("{x:.1}")).join(", ")
}
