//! Passes fused into dispatches: order, barriers, and the shaders that are linked of them.

use std::collections::BTreeSet;

use insonify_imaging::effects::buffers::Buffer;
use insonify_imaging::effects::pass::{Grid, Use};
use insonify_imaging::fusion::{Bound, Fused, MAX_BUFFERS, fuse};
use insonify_imaging::plan::Plan;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::linker::{ENTRY, link};
use insonify_imaging::synth::tables::Tables;
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{AddressSpace, StorageAccess};

use super::plans::{everything, scenes};
use super::shaders::tables;
use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene;

/// A pass's place among the dispatches: dispatch, sequence, place in it.
fn place(fused: &[Fused], pass: usize) -> [usize; 3] {
    let mut found = Vec::new();
    for (dispatch, sequences) in fused.iter().enumerate() {
        for (at, sequence) in sequences.iter().enumerate() {
            let own = sequence.passes.iter().position(|&other| other == pass);
            found.extend(own.map(|own| [dispatch, at, own]));
        }
    }
    assert_eq!(found.len(), 1, "pass {pass} is in one dispatch");
    found[0]
}

fn most_buffers(bound: &[Bound], fused: &Fused) -> usize {
    let passes = fused.iter().flat_map(|sequence| &sequence.passes);
    let buffers: BTreeSet<&Buffer> = passes
        .flat_map(|&at| &bound[at].buffers)
        .map(|&(buffer, _)| buffer)
        .collect();
    buffers.len()
}

/// The same passes with reads and writes of every written buffer exchanged, so that reads precede writes.
fn reversed(bound: &[Bound]) -> Vec<Bound> {
    let written = |buffer: &Buffer| {
        let mut uses = bound.iter().flat_map(|pass| &pass.buffers);
        uses.any(|(other, how)| *other == buffer && how.writes())
    };
    let mut passes = bound.to_vec();
    for (buffer, how) in passes.iter_mut().flat_map(|pass| &mut pass.buffers) {
        if written(buffer) {
            *how = match how {
                Use::Read => Use::Write,
                Use::Write => Use::Read,
                Use::ReadLine => Use::WriteLine,
                Use::WriteLine => Use::ReadLine,
                Use::ReadOwn => Use::WriteOwn,
                Use::WriteOwn => Use::ReadOwn,
            };
        }
    }
    passes
}

#[test]
fn passes_that_share_what_one_writes_stay_in_order() {
    let mut barriers = 0;
    let plans = scenes().into_iter().flat_map(|scene| {
        let bound = Plan::new(&tables(&scene)).bound();
        [(scene.name, reversed(&bound)), (scene.name, bound)]
    });
    for (scene, bound) in plans {
        for most in [MAX_BUFFERS, 12, 7] {
            let fused = fuse(&bound, most);
            for of in &fused {
                let alone = of.len() == 1 && of[0].passes.len() == 1;
                assert!(alone || most_buffers(&bound, of) <= most, "{scene}: {of:?}");
            }
            for second in 0..bound.len() {
                for first in 0..second {
                    let shared = bound[first]
                        .buffers
                        .iter()
                        .flat_map(|a| bound[second].buffers.iter().map(move |b| (a, b)));
                    let shared = shared.filter(|((x, a), (y, b))| x == y && (a.writes() || b.writes()));
                    let uses: Vec<Use> = shared.flat_map(|((_, a), (_, b))| [*a, *b]).collect();
                    if uses.is_empty() {
                        continue;
                    }
                    let [a, b] = [first, second].map(|pass| place(&fused, pass));
                    let names = [first, second].map(|pass| bound[pass].pass.name);
                    assert!(a < b, "{scene}: {names:?} in {fused:?}");
                    if a[0] < b[0] {
                        continue;
                    }
                    assert_eq!(a[1], b[1], "{scene}: {names:?} side by side");
                    let anywhere = uses.iter().any(|how| matches!(how, Use::Read | Use::Write));
                    assert!(!anywhere, "{scene}: {names:?} need all that is before");
                    let own = uses.iter().all(|how| matches!(how, Use::ReadOwn | Use::WriteOwn));
                    assert!(own || fused[a[0]][a[1]].by_line, "{scene}: {names:?} need a barrier");
                    barriers += usize::from(!own);
                }
            }
        }
    }
    assert!(barriers > 100, "{barriers}");
}

/// The number of barriers before each call of a pass in a linked shader.
fn barriers_before(source: &str) -> Vec<usize> {
    let entry = source.split(&format!("fn {ENTRY}(")).nth(1).expect("an entry point");
    let mut barriers = 0;
    let mut before = Vec::new();
    for line in entry.lines() {
        barriers += usize::from(line.contains("workgroupBarrier"));
        if line.ends_with(");") && line.contains("vec3<u32>(") {
            before.push(barriers);
        }
    }
    before
}

#[test]
fn a_barrier_stands_where_passes_meet_on_a_scanline_and_only_there() {
    for scene in scenes() {
        let bound = Plan::new(&tables(&scene)).bound();
        for most in [MAX_BUFFERS, 12, 7] {
            for of in fuse(&bound, most) {
                let linked = link(&bound, &of);
                let before = barriers_before(&linked.source);
                let mut place = 0;
                for sequence in &of {
                    let own = &before[place..][..sequence.passes.len()];
                    place += own.len();
                    let is_shared = |first: usize, second: usize| {
                        let [first, second] = [first, second].map(|at| &bound[sequence.passes[at]]);
                        let by_workgroup = |of: &Bound| matches!(of.pass.grid, Grid::Scanlines | Grid::Workgroups(_));
                        let on_line = first.buffers.iter().any(|(x, a)| {
                            let other = second.buffers.iter().find(|(y, _)| x == y);
                            other.is_some_and(|(_, b)| {
                                let is_own = |how: &Use| matches!(how, Use::ReadOwn | Use::WriteOwn);
                                (a.writes() || b.writes()) && !(is_own(a) && is_own(b))
                            })
                        });
                        on_line || (by_workgroup(first) && by_workgroup(second))
                    };
                    for second in 1..own.len() {
                        let shares = (0..second).any(|first| is_shared(first, second) && own[first] == own[second]);
                        assert!(!shares, "{}: {sequence:?} in {}", scene.name, linked.source);
                        // Not without need.
                        let since = (0..second).filter(|&first| own[first] == own[second - 1]);
                        if own[second] > own[second - 1] {
                            let needed = since.clone().any(|first| is_shared(first, second));
                            assert!(needed, "{}: {sequence:?} in {}", scene.name, linked.source);
                        }
                    }
                }
                assert_eq!(place, before.len(), "{}", linked.source);
            }
        }
    }
}

#[test]
fn dispatches_of_a_very_wide_probe_are_within_the_limits_of_any_device() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let text = r#"
        version = 2
        volume = { phantom = "abdomen", resolution_mm = 5 }
        probe = { kind = "curvilinear", radius_mm = 200.0, angle_deg = 180.0, depth_mm = 1000.0, frequency_mhz = 15.0, lines = 8192, samples = 64 }
        image = { width = 64, height = 64 }
    "#;
    let scene = SceneFile::parse(text, "wide.toml").expect("a scene");
    let scene = scene.resolve(".".as_ref()).expect("a scene");
    let state = scene.states(1).next().expect("a state").expect("a state");
    let settings = scene.settings.clone();
    let mut cpu = Synthesizer::new(scene.anatomy.clone(), settings.clone(), Backend::Cpu).expect("a synthesizer");
    let mut device = Synthesizer::new(scene.anatomy, settings, backend(gpu)).expect("a synthesizer");
    let expected = &cpu.render(&state).expect("a frame").pixels;
    let found = &device.render(&state).expect("a frame").pixels;
    let off = expected.iter().zip(found).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(expected.iter().any(|grey| *grey > 60) && off == 0, "{off} pixels");
}

#[test]
fn a_workgroup_that_shares_a_scanline_has_all_of_it() {
    for scene in scenes() {
        let bound = Plan::new(&tables(&scene)).bound();
        for sequence in fuse(&bound, MAX_BUFFERS).iter().flatten() {
            let shares = sequence
                .passes
                .iter()
                .any(|&at| matches!(bound[at].pass.grid, Grid::Scanlines));
            assert!(sequence.by_line || !shares, "{}: {sequence:?}", scene.name);
        }
    }
}

#[test]
fn a_frame_has_few_dispatches() {
    let default = SceneFile::parse(
        "version = 1\nvolume = { phantom = \"abdomen\", resolution_mm = 4 }",
        "default.toml",
    )
    .expect("a scene");
    let default = default.resolve(".".as_ref()).expect("the default scene");
    let plan = Plan::new(&Tables::new(default.anatomy, default.settings).expect("tables"));
    let mut scene = everything();
    let compounded = Plan::new(&tables(&scene));
    scene.settings.effects.compound = None;
    let all = Plan::new(&tables(&scene));
    let looks = compounded.fused(MAX_BUFFERS).len() - all.fused(MAX_BUFFERS).len();
    assert!(looks <= 6, "{}", compounded.report(&Default::default()));
    for plan in [&plan, &all] {
        let (passes, dispatches) = (plan.passes.len(), plan.fused(MAX_BUFFERS).len());
        assert!(
            passes >= 23 && 2 * dispatches < passes,
            "{}",
            plan.report(&Default::default())
        );
    }
    // A device with the least that WebGPU promises.
    assert!(4 * all.fused(7).len() < 3 * all.passes.len(), "{:?}", all.fused(7));
}

#[test]
fn linked_shaders_are_valid_and_bind_what_their_passes_use() {
    for scene in scenes() {
        let bound = Plan::new(&tables(&scene)).bound();
        for most in [MAX_BUFFERS, 7] {
            for fused in fuse(&bound, most) {
                let linked = link(&bound, &fused);
                let place = format!("{}: {fused:?}\n{}", scene.name, linked.source);
                let module = naga::front::wgsl::parse_str(&linked.source)
                    .unwrap_or_else(|error| panic!("{}\n{place}", error.emit_to_string(&linked.source)));
                Validator::new(ValidationFlags::all(), Capabilities::empty())
                    .validate(&module)
                    .unwrap_or_else(|error| panic!("{}\n{place}", error.emit_to_string(&linked.source)));
                assert!(
                    module.entry_points.len() == 1 && module.entry_points[0].name == ENTRY,
                    "{place}"
                );
                assert_eq!(linked.buffers.len(), most_buffers(&bound, &fused), "{place}");
                for (_, variable) in module.global_variables.iter() {
                    let Some(binding) = variable.binding else { continue };
                    let Some(own) = (binding.binding as usize).checked_sub(1).map(|at| &linked.buffers[at]) else {
                        continue;
                    };
                    let passes = fused.iter().flat_map(|sequence| &sequence.passes);
                    let mut uses = passes
                        .flat_map(|&at| &bound[at].buffers)
                        .filter(|(buffer, _)| *buffer == own.buffer);
                    let access = if uses.any(|(_, how)| how.writes()) {
                        StorageAccess::LOAD | StorageAccess::STORE
                    } else {
                        StorageAccess::LOAD
                    };
                    assert_eq!(
                        variable.space,
                        AddressSpace::Storage { access },
                        "{:?} in {place}",
                        own.buffer
                    );
                }
            }
        }
    }
}

/// What a frame costs besides its dispatches.
#[test]
fn a_frame_has_one_upload_one_submission_and_one_wait() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let (anatomy, settings, _) = scene::everything();
    let mut synth = Synthesizer::new(anatomy.clone(), settings, backend(gpu.clone())).expect("a synthesizer");
    let count = |work: &mut dyn FnMut()| {
        let before = gpu.traffic();
        work();
        let spent = gpu.traffic() - before;
        [spent.uploads, spent.submissions, spent.waits]
    };
    let mut states: Vec<_> = (0..14).map(|at| scene::frame_of(&anatomy, at)).collect();
    let pose = states[0].probe_to_world;
    synth.render(&states[0]).expect("a frame");
    states[1].probe_to_world = pose;
    let mesh_moves = count(&mut || {
        synth.render(&states[1]).expect("a frame");
    });
    assert_eq!(mesh_moves, [1, 1, 1], "the mesh moves");
    let probe_moves = count(&mut || {
        synth.render(&states[2]).expect("a frame");
    });
    assert_eq!(
        probe_moves,
        [1, 1, 1],
        "the probe moves, and elements of the reference state are sent"
    );
    let mut batch = |states: &[FrameState]| {
        synth
            .render_batch(states, |_, _| Ok::<_, SynthError>(()))
            .expect("a batch")
    };
    batch(&states[2..]);
    // Twelve frames in three submissions.
    assert_eq!(count(&mut || batch(&states[2..])), [3, 3, 3], "a batch");
}
