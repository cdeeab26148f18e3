// Weighted sums over sources that runs of neighbouring receivers share, as in transport/interpolation.rs.

struct Shard {
    first_run: u32,
    runs: u32,
    // Of all runs.
    receivers: u32,
    // Basis functions of a far field.
    terms: u32,
    // Where the receivers begin in what is written.
    first_receiver: u32,
    // 1: negative sums are written as they are, not as 0.
    is_signed: u32,
    // Bit k: function k is filled in.
    functions: u32,
    padding: u32,
}

@group(1) @binding(0) var<uniform> shard: Shard;
// Of each run: where it begins in the sources; and the end.
@group(1) @binding(1) var<storage, read> offsets: array<u32>;
@group(1) @binding(2) var<storage, read> sources: array<u32>;
// [source][receiver of the run], two each.
@group(1) @binding(3) var<storage, read> weights: array<u32>;

// Receivers of a run.
const RECEIVERS: u32 = 16u;
const UNIT: f32 = 1.0 / 16384.0;

// The weight of a source for one of the receivers.
fn weight_of(source: u32, lane: u32) -> f32 {
    let pair = bitcast<i32>(weights[RECEIVERS / 2u * source + lane / 2u]);
    return f32(extractBits(pair, 16u * (lane % 2u), 16u));
}
