//! In the steady state a frame allocates nothing.

mod simulator;
#[path = "../support/mod.rs"]
mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed};

use insonify_imaging::parity::Case;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, NeedleShaft, Synthesizer};
use nalgebra::Vector3;

use support::scene;

/// The system's allocator, counting.
struct Counting;

static CALLS: AtomicU64 = AtomicU64::new(0);
static HELD: AtomicI64 = AtomicI64::new(0);

// SAFETY: every call goes to the system's allocator with the arguments given; the counters are atomics.
#[allow(unsafe_code, reason = "`GlobalAlloc` is unsafe by definition")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Relaxed);
        HELD.fetch_add(layout.size() as i64, Relaxed);
        // SAFETY: the caller's promise about the layout is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size() as i64, Relaxed);
        // SAFETY: the pointer came from `alloc` with this layout, as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const FRAMES: usize = 100;

/// All effects on tissue that deforms and is remeshed anew each frame, with a bent needle that moves and seeds.
fn scene() -> (Anatomy, Settings, Vec<FrameState>) {
    let (anatomy, settings, _) = scene::everything();
    let states = (0..FRAMES).map(|frame| {
        let mut state = scene::frame_of(&anatomy, frame as u64);
        let mut reference = anatomy.mesh.as_ref().expect("a mesh").nodes().to_vec();
        let moved = frame % reference.len();
        for nodes in state.nodes.iter_mut().chain([&mut reference]) {
            nodes[moved] = nodes[moved].map(|x| x + 0.3);
        }
        state.reference = Some(reference);
        let seed = |at: usize| NeedleShaft::seed([at as f64 - 5.0, 20.0, 0.1 * frame as f64].into(), &Vector3::y());
        state.seeds = (0..10).map(seed).collect();
        state
    });
    let states = states.collect();
    (anatomy, settings, states)
}

/// Allocations and growth of held bytes while `work` runs.
fn count(work: impl FnOnce()) -> (u64, i64) {
    let (calls, bytes) = (CALLS.load(Relaxed), HELD.load(Relaxed));
    work();
    (CALLS.load(Relaxed) - calls, HELD.load(Relaxed) - bytes)
}

// One test alone in this binary: another would allocate meanwhile.
#[test]
fn a_hundred_frames_allocate_nothing() {
    let (anatomy, settings, states) = scene();
    let (calls, bytes) = count(|| drop(std::hint::black_box(vec![0u8; 100])));
    assert_eq!((calls, bytes), (1, 0), "the allocator counts");
    let pool = insonify_base::parallel::Pool::new(2).expect("a pool");
    for backend in [Backend::Cpu, Backend::CpuF64] {
        let mut synthesizer = Synthesizer::new(anatomy.clone(), settings.clone(), backend).expect("a synthesizer");
        let mut run = || {
            for state in &states {
                synthesizer.render(state).expect("a frame");
            }
        };
        // Inside a pool a parallel loop lives on the stacks of its threads: after a first round there is nothing to
        // allocate.
        let (calls, bytes) = pool.install(|| {
            run();
            count(&mut run)
        });
        assert_eq!((calls, bytes), (0, 0), "calls and bytes in {FRAMES} frames");
        // From outside, each parallel loop goes through the pool's queue, which takes a block for every 63 entries and
        // gives it back. A frame has at most 48 loops; no byte is kept beyond two blocks.
        run();
        let (calls, bytes) = count(&mut run);
        println!(
            "{}: {calls} allocations in {FRAMES} frames by the queue of the pool",
            synthesizer.backend()
        );
        assert!(calls <= (FRAMES as u64 * 48).div_ceil(63), "{calls} allocations");
        assert!(bytes.abs() <= 4096, "{bytes} bytes more are held");
    }
    // Far from the origin of the world every state is moved before it is rendered.
    let far = |state: &FrameState| {
        let case = Case::new("", anatomy.clone(), settings.clone(), state.clone());
        case.moved([1e5, -2e4, 300.0]).expect("a case")
    };
    let cases: Vec<Case> = states.iter().map(far).collect();
    let mut synthesizer = cases[0].on(Backend::Cpu).expect("a synthesizer");
    let mut run = || {
        for case in &cases {
            synthesizer.render(&case.state).expect("a frame");
        }
    };
    let (calls, bytes) = pool.install(|| {
        run();
        count(&mut run)
    });
    assert_eq!((calls, bytes), (0, 0), "calls and bytes in {FRAMES} frames far away");
    let synthesizer = Synthesizer::new(anatomy, settings, Backend::Cpu).expect("a synthesizer");
    let mut rounds = simulator::rounds(synthesizer, states[0].probe_to_world, FRAMES);
    let (calls, bytes) = pool.install(|| {
        rounds();
        count(&mut rounds)
    });
    assert_eq!(
        (calls, bytes),
        (0, 0),
        "calls and bytes in {FRAMES} frames of a simulator, ten steps each"
    );
}
