// Exclusive prefix sums over a workgroup, which saturate: addition of non-negative numbers stays associative.
const MAX_UNITS = 0x7fffffffu;
const THREADS = 256u;

var<workgroup> partial: array<u32, THREADS>;

// Sum of the numbers of the threads before one.
fn exclusive(thread: u32, sum: u32) -> u32 {
    // The sums of an earlier call may still be read.
    workgroupBarrier();
    partial[thread] = sum;
    workgroupBarrier();
    for (var reach = 1u; reach < THREADS; reach *= 2u) {
        var before = 0u;
        if thread >= reach {
            before = partial[thread - reach];
        }
        workgroupBarrier();
        partial[thread] = min(partial[thread] + before, MAX_UNITS);
        workgroupBarrier();
    }
    if thread == 0u {
        return 0u;
    }
    return partial[thread - 1u];
}
