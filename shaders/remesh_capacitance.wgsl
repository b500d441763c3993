// C = (I + dK G)^-1 dK of one change, in f64, appended to `remesh.wgsl` where the device has f64. One workgroup.
//
// The inverse of I + dK G comes from Gauss-Jordan elimination with row pivoting, in place (N. J. Higham, "Accuracy and Stability
// of Numerical Algorithms", section 14.4), so its condition in the 1-norm is known and not estimated. Below the limit C is zero,
// and the result -1 says so. G are the rows of Y at the listed columns.

// Largest rank: a loop of an invocation then ends well before 65,535 rounds.
const MAX = 128u;
// Replaces NaN, so that NaN never enters a comparison.
const HUGE = 1e300lf;

@group(0) @binding(3) var<storage, read> change: array<f64>;
@group(0) @binding(4) var<storage, read_write> matrix: array<f64>;
@group(0) @binding(5) var<storage, read_write> c_out: array<f32>;
@group(0) @binding(6) var<storage, read_write> result: array<f32>;

// Pivot row before and after its division, and pivot column.
var<workgroup> pivot_row: array<f64, MAX>;
var<workgroup> scaled_row: array<f64, MAX>;
var<workgroup> pivot_column: array<f64, MAX>;
// A reduction: values, and where they were found.
var<workgroup> largest: array<f64, MAX>;
var<workgroup> found_at: array<u32, MAX>;
// Where a column of the inverse lies.
var<workgroup> order: array<u32, MAX>;
var<workgroup> swapped: array<u32, MAX>;

// Moves the largest of the values to the front; the first of equals.
fn reduce(own: u32) {
    workgroupBarrier();
    for (var span = MAX / 2u; span > 0u; span /= 2u) {
        if own < span && largest[own + span] > largest[own] {
            largest[own] = largest[own + span];
            found_at[own] = found_at[own + span];
        }
        workgroupBarrier();
    }
}

// Largest absolute column sum.
fn norm_one(own: u32) -> f64 {
    var sum = 0.0lf;
    if own < params.rank {
        for (var i = 0u; i < params.rank; i++) {
            sum += abs(matrix[own * params.rank + i]);
        }
    }
    if own < MAX {
        largest[own] = select(HUGE, sum, sum < HUGE);
    }
    reduce(own);
    let norm = largest[0];
    workgroupBarrier();
    return norm;
}

@compute @workgroup_size(256)
fn capacitance(@builtin(local_invocation_index) own: u32) {
    let rank = params.rank;
    let entries = rank * rank;
    for (var at = own; at < entries; at += 256u) {
        let i = at % rank;
        let j = at / rank;
        var sum = select(0.0lf, 1.0lf, i == j);
        for (var k = 0u; k < rank; k++) {
            sum += change[k * rank + i] * f64(y[strip_at(lists[k], j)]);
        }
        matrix[at] = sum;
    }
    storageBarrier();
    let norm = norm_one(own);

    for (var k = 0u; k < rank; k++) {
        if own < MAX {
            largest[own] = -1.0lf;
            found_at[own] = k;
            if own >= k && own < rank {
                largest[own] = abs(matrix[k * rank + own]);
                found_at[own] = own;
            }
        }
        reduce(own);
        let pivot_at = found_at[0];
        if own < rank {
            let taken = matrix[own * rank + pivot_at];
            matrix[own * rank + pivot_at] = matrix[own * rank + k];
            pivot_row[own] = taken;
        }
        storageBarrier();
        workgroupBarrier();
        if own < rank {
            // A pivot of zero makes the inverse, and with it the condition, infinite.
            scaled_row[own] = select(pivot_row[own], 1.0lf, own == k) / pivot_row[k];
            pivot_column[own] = matrix[k * rank + own];
        }
        if own == k {
            swapped[k] = pivot_at;
        }
        workgroupBarrier();
        for (var at = own; at < entries; at += 256u) {
            let i = at % rank;
            let j = at / rank;
            let before = select(matrix[at], 0.0lf, j == k);
            matrix[at] = select(before - pivot_column[i] * scaled_row[j], scaled_row[j], i == k);
        }
        storageBarrier();
        workgroupBarrier();
    }

    let condition = norm * norm_one(own);
    // The exchanges of rows, undone in the columns.
    if own == 0u {
        for (var k = 0u; k < rank; k++) {
            order[k] = k;
        }
        for (var k = rank; k > 0u; k--) {
            let other = swapped[k - 1u];
            let kept = order[k - 1u];
            order[k - 1u] = order[other];
            order[other] = kept;
        }
    }
    workgroupBarrier();

    let reciprocal = f32(1.0lf / condition);
    let solved = condition < HUGE && reciprocal >= params.limit;
    let wide = padded();
    for (var at = own; at < rank * wide; at += 256u) {
        let i = at / wide;
        let j = at % wide;
        if j >= rank {
            c_out[at] = 0.0;
        }
        if j >= rank || i > j {
            continue;
        }
        var sum = 0.0lf;
        for (var k = 0u; k < rank; k++) {
            let row = matrix[order[k] * rank + i] * change[j * rank + k];
            let column = matrix[order[k] * rank + j] * change[i * rank + k];
            sum += row + column;
        }
        let mean = select(0.0, f32(0.5lf * sum), solved);
        c_out[j * wide + i] = mean;
        c_out[i * wide + j] = mean;
    }
    if own == 0u {
        result[0] = select(-1.0, reciprocal, solved);
    }
}
