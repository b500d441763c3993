// Sums over a workgroup that decay from thread to thread.
const LANES = 256u;

var<workgroup> lanes: array<f32, LANES>;

// Sum of the numbers of the threads before one, decaying by `fading` (log2) per thread.
fn decaying_sum(thread: u32, sum: f32, fading: f32) -> f32 {
    // The sums of an earlier call may still be read.
    workgroupBarrier();
    lanes[thread] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < LANES; reach *= 2u) {
        var before = 0.0;
        if thread >= reach {
            before = lanes[thread - reach];
        }
        workgroupBarrier();
        lanes[thread] += before * exp2(fading * f32(reach));
        workgroupBarrier();
    }
    if thread == 0u {
        return 0.0;
    }
    return lanes[thread - 1u];
}
