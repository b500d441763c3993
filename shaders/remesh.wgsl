// The dense inverse K^-1 follows a remesh: levels I to III of `src/mechanics/tissue/remesh/levels.rs` on one triangle.
//
// The lower triangle lies in tiles of 128 x 128 values, tile (p, q), q <= p, after tile (p, q - 1), column by column. Tiles are
// spread over as many buffers ("banks") as the binding limit calls for; a pass that walks tiles is dispatched once a bank.
// Values above the diagonal of a diagonal tile carry no meaning, and rows beyond `size` are zero.
//
// Y and Z lie in blocks of 128 rows, each block column by column, `stride` columns whether used or not: a column of a block is
// one stream of 512 bytes. Columns from `rank` to the next multiple of 16 are zero.

struct Params {
    // Rows of the matrix.
    size: u32,
    // Columns of Y and Z in use.
    rank: u32,
    // Columns of Y and Z that there is room for, a multiple of 16.
    stride: u32,
    // The bank: its first tile, and how many.
    first_tile: u32,
    tiles: u32,
    // Entries of the lists of rows and of columns, and where these begin.
    rows: u32,
    columns: u32,
    rows_from: u32,
    columns_from: u32,
    // Whether a sum begins or goes on.
    add: u32,
    // Smallest reciprocal condition of I + dK G.
    limit: f32,
}

@group(0) @binding(0) var<storage, read> params: Params;

const SIDE = 128u;
const TILE = SIDE * SIDE;
// Values of a tile's column, and of a tile, by fours.
const SIDE4 = SIDE / 4u;
const TILE4 = TILE / 4u;
// Columns of Y and Z that a workgroup holds at once: 2 x 16 x 128 values are its 16 KiB.
const DEPTH = 16u;

fn tile_at(p: u32, q: u32) -> u32 {
    return p * (p + 1u) / 2u + q;
}

// Row and column of tiles of a tile.
fn place_of(tile: u32) -> vec2<u32> {
    var p = u32((sqrt(8.0 * f32(tile) + 1.0) - 1.0) * 0.5);
    // The root is off by one at most.
    if tile_at(p, 0u) > tile {
        p -= 1u;
    }
    if tile_at(p + 1u, 0u) <= tile {
        p += 1u;
    }
    return vec2<u32>(p, tile - tile_at(p, 0u));
}

// Where entry (row, column) lies in the bank; beyond it where another bank has it.
fn entry_at(row: u32, column: u32) -> u32 {
    let i = max(row, column);
    let j = min(row, column);
    let tile = tile_at(i / SIDE, j / SIDE) - params.first_tile;
    if tile >= params.tiles {
        return 0xffffffffu;
    }
    return tile * TILE + (j % SIDE) * SIDE + i % SIDE;
}

// Where row i of column k of Y or Z lies.
fn strip_at(i: u32, k: u32) -> u32 {
    return (i / SIDE * params.stride + k) * SIDE + i % SIDE;
}

// ---- Columns of the matrix set aside: Y. Workgroups: blocks of rows, columns up to the padding.

@group(0) @binding(1) var<storage, read> bank: array<f32>;
@group(0) @binding(2) var<storage, read> lists: array<u32>;
@group(0) @binding(3) var<storage, read_write> strip_out: array<f32>;

@compute @workgroup_size(128)
fn take(@builtin(global_invocation_id) id: vec3<u32>) {
    let k = id.y;
    let to = strip_at(id.x, k);
    if k >= params.rank || id.x >= params.size {
        strip_out[to] = 0.0;
        return;
    }
    let source = entry_at(id.x, lists[k]);
    if source != 0xffffffffu {
        strip_out[to] = bank[source];
    }
}

// ---- Entries at the rows and columns of the lists, row by row, less Y Z^T there. Workgroups: columns by 64, rows. They follow
// the first value, which is the reciprocal condition.

@group(0) @binding(3) var<storage, read_write> entries_out: array<f32>;
@group(0) @binding(4) var<storage, read> y_near: array<f32>;
@group(0) @binding(5) var<storage, read> z_near: array<f32>;

@compute @workgroup_size(64)
fn entries(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.columns {
        return;
    }
    let row = lists[params.rows_from + id.y];
    let column = lists[params.columns_from + id.x];
    let source = entry_at(row, column);
    if source == 0xffffffffu {
        return;
    }
    // As level I has it: Y of the lower row, Z of the upper.
    var sum = 0.0;
    for (var k = 0u; k < params.rank; k++) {
        sum += y_near[strip_at(max(row, column), k)] * z_near[strip_at(min(row, column), k)];
    }
    entries_out[1u + id.y * params.columns + id.x] = bank[source] - sum;
}

// ---- Z = Y C. Workgroups: blocks of rows, 16 columns. A row of C is as long as the rank with its padding, which is zero.

@group(0) @binding(1) var<storage, read> y: array<f32>;
@group(0) @binding(2) var<storage, read> c4: array<vec4<f32>>;

// Columns in use, with their padding.
fn padded() -> u32 {
    return (params.rank + DEPTH - 1u) / DEPTH * DEPTH;
}

fn set_aside(to: u32, values: vec4<f32>) {
    strip_out[to] = values.x;
    strip_out[to + SIDE] = values.y;
    strip_out[to + 2u * SIDE] = values.z;
    strip_out[to + 3u * SIDE] = values.w;
}

@compute @workgroup_size(128)
fn product(@builtin(global_invocation_id) id: vec3<u32>) {
    let first = id.y * DEPTH;
    let wide4 = padded() / 4u;
    let own = strip_at(id.x, 0u);
    var s0 = vec4<f32>();
    var s1 = vec4<f32>();
    var s2 = vec4<f32>();
    var s3 = vec4<f32>();
    for (var k = 0u; k < params.rank; k++) {
        let left = y[own + k * SIDE];
        let at = k * wide4 + first / 4u;
        s0 += left * c4[at];
        s1 += left * c4[at + 1u];
        s2 += left * c4[at + 2u];
        s3 += left * c4[at + 3u];
    }
    let to = strip_at(id.x, first);
    set_aside(to, s0);
    set_aside(to + 4u * SIDE, s1);
    set_aside(to + 8u * SIDE, s2);
    set_aside(to + 12u * SIDE, s3);
}

// ---- Level I: A -= Y Z^T, tile by tile. Workgroups: the tiles of the bank.
//
// An invocation holds 4 rows of 16 columns: 64 sums, fed for each k by one group of four of Y, which neighbours read as one
// line, and four of Z, which all 32 of a row share. The tile itself is read and written once, line by line; at the end, so that
// the sum rounds at its own size and not, at each term, at that of the tile.

@group(0) @binding(1) var<storage, read_write> bank4: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> y4: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> z4: array<vec4<f32>>;

var<workgroup> y_part: array<vec4<f32>, 512>;
var<workgroup> z_part: array<vec4<f32>, 512>;

@compute @workgroup_size(256)
fn update_all(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) own: u32) {
    let place = place_of(params.first_tile + group.x);
    let row = own % SIDE4;
    let first_column = own / SIDE4 * 16u;
    let zero = vec4<f32>();
    var a0 = zero;
    var a1 = zero;
    var a2 = zero;
    var a3 = zero;
    var a4 = zero;
    var a5 = zero;
    var a6 = zero;
    var a7 = zero;
    var a8 = zero;
    var a9 = zero;
    var a10 = zero;
    var a11 = zero;
    var a12 = zero;
    var a13 = zero;
    var a14 = zero;
    var a15 = zero;
    for (var done = 0u; done < params.rank; done += DEPTH) {
        let y_from = (place.x * params.stride + done) * SIDE4;
        let z_from = (place.y * params.stride + done) * SIDE4;
        y_part[own] = y4[y_from + own];
        z_part[own] = z4[z_from + own];
        y_part[own + 256u] = y4[y_from + own + 256u];
        z_part[own + 256u] = z4[z_from + own + 256u];
        workgroupBarrier();
        for (var k = 0u; k < DEPTH; k++) {
            let left = y_part[k * SIDE4 + row];
            let at = k * SIDE4 + first_column / 4u;
            let r0 = z_part[at];
            let r1 = z_part[at + 1u];
            let r2 = z_part[at + 2u];
            let r3 = z_part[at + 3u];
            a0 += left * r0.x;
            a1 += left * r0.y;
            a2 += left * r0.z;
            a3 += left * r0.w;
            a4 += left * r1.x;
            a5 += left * r1.y;
            a6 += left * r1.z;
            a7 += left * r1.w;
            a8 += left * r2.x;
            a9 += left * r2.y;
            a10 += left * r2.z;
            a11 += left * r2.w;
            a12 += left * r3.x;
            a13 += left * r3.y;
            a14 += left * r3.z;
            a15 += left * r3.w;
        }
        workgroupBarrier();
    }
    let to = group.x * TILE4 + first_column * SIDE4 + row;
    bank4[to] -= a0;
    bank4[to + SIDE4] -= a1;
    bank4[to + 2u * SIDE4] -= a2;
    bank4[to + 3u * SIDE4] -= a3;
    bank4[to + 4u * SIDE4] -= a4;
    bank4[to + 5u * SIDE4] -= a5;
    bank4[to + 6u * SIDE4] -= a6;
    bank4[to + 7u * SIDE4] -= a7;
    bank4[to + 8u * SIDE4] -= a8;
    bank4[to + 9u * SIDE4] -= a9;
    bank4[to + 10u * SIDE4] -= a10;
    bank4[to + 11u * SIDE4] -= a11;
    bank4[to + 12u * SIDE4] -= a12;
    bank4[to + 13u * SIDE4] -= a13;
    bank4[to + 14u * SIDE4] -= a14;
    bank4[to + 15u * SIDE4] -= a15;
}

// ---- Levels II and III: the same in the rows and columns of the list of rows, ascending. Workgroups: blocks of rows, the list.

@group(0) @binding(1) var<storage, read_write> bank_rows: array<f32>;
@group(0) @binding(3) var<storage, read> z: array<f32>;
@group(0) @binding(4) var<storage, read> named: array<u32>;

// Whether a row is on the list.
fn is_named(row: u32) -> bool {
    var low = 0u;
    var high = params.rows;
    while low < high {
        let middle = (low + high) / 2u;
        if named[params.rows_from + middle] < row {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low < params.rows && named[params.rows_from + low] == row;
}

@group(0) @binding(2) var<storage, read> y_rows: array<f32>;

@compute @workgroup_size(128)
fn update_rows(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    let r = named[params.rows_from + id.y];
    // An entry of two named rows belongs to the one with the larger number.
    if i >= params.size || (i > r && is_named(i)) {
        return;
    }
    let to = entry_at(i, r);
    if to == 0xffffffffu {
        return;
    }
    // As level I has it: Y of the lower row, Z of the upper.
    let lower = max(i, r);
    let upper = min(i, r);
    var sum = 0.0;
    for (var k = 0u; k < params.rank; k++) {
        sum += y_rows[strip_at(lower, k)] * z[strip_at(upper, k)];
    }
    bank_rows[to] -= sum;
}

// ---- Sum of the columns of Y, each times its weight. Workgroups: blocks of rows.

@group(0) @binding(2) var<storage, read> weights: array<f32>;

@compute @workgroup_size(128)
fn combine(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.size {
        return;
    }
    var sum = 0.0;
    if params.add != 0u {
        sum = strip_out[id.x];
    }
    for (var k = 0u; k < params.rank; k++) {
        sum += y[strip_at(id.x, k)] * weights[k];
    }
    strip_out[id.x] = sum;
}

// ---- The matrix times a vector: what the tiles of the bank add to it. Workgroups: blocks of rows.

@compute @workgroup_size(128)
fn multiply(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x;
    if i >= params.size {
        return;
    }
    var sum = 0.0;
    if params.add != 0u {
        sum = strip_out[i];
    }
    let own = i / SIDE;
    let blocks = (params.size + SIDE - 1u) / SIDE;
    for (var other = 0u; other < blocks; other++) {
        let tile = tile_at(max(own, other), min(own, other)) - params.first_tile;
        if tile >= params.tiles {
            continue;
        }
        let end = min(SIDE, params.size - other * SIDE);
        for (var k = 0u; k < end; k++) {
            let j = other * SIDE + k;
            sum += bank[tile * TILE + (min(i, j) % SIDE) * SIDE + max(i, j) % SIDE] * weights[j];
        }
    }
    strip_out[i] = sum;
}
