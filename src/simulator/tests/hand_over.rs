//! Complete states between two threads.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use super::Fake;
use crate::simulator::haptic::hand_over;
use insonify_mechanics::insertion::Field;

#[test]
fn no_state_is_ever_torn() {
    let (mut publisher, mut latest) = hand_over();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = stop.clone();
    let writer = thread::spawn(move || {
        let mut model = Fake::default();
        while !stopped.load(Ordering::Relaxed) {
            model.step += 1;
            publisher.publish(&mut model);
        }
        model.step
    });
    let mut last_value = 0;
    for _ in 0..100 {
        while !latest.take() {
            thread::yield_now();
        }
        let state = latest.state();
        assert!(state.step > last_value, "{} after {last_value}", state.step);
        last_value = state.step;
        let (step, mark) = (state.step as usize, state.step as f64);
        assert_eq!(state.time_s, mark);
        assert!(state.line.nodes().iter().all(|node| node.1.z == mark));
        assert_eq!(state.line.length_mm(), 1.0 + mark);
        assert_eq!((state.seeds.len(), state.moved.len()), (step % 7, step % 5));
        assert!(state.seeds.iter().all(|seed| seed.x == mark));
        assert!(state.moved.iter().all(|node| node == &(step as u32, [mark; 3])));
        let Field::Displacement(field) = &state.field else {
            panic!("no field")
        };
        assert!(field.len() == 500 && field.iter().all(|node| node == &[mark; 3]));
    }
    stop.store(true, Ordering::Relaxed);
    let written = writer.join().expect("writer");
    // The last one is available, unless it was taken.
    assert!(latest.take() == (last_value < written) && latest.state().step == written);
}
