// Radial functions by linear pieces of the squared distance, as in transport/kernel/radial_table.rs.

struct RadialTable {
    // s^2, which is added to r^2, and its upper bits, which are those of the first segment.
    scale2: f32,
    bits: u32,
    // Of its segments among all; the last one is zero.
    first: u32,
    last: u32,
}

fn looked_up(table: RadialTable, r2: f32) -> vec3<f32> {
    let x = max(r2, 0.0) + table.scale2;
    let bits = bitcast<u32>(x) >> SHIFT;
    let at = 2u * (table.first + min(bits - min(table.bits, bits), table.last));
    return segments[at].xyz + segments[at + 1u].xyz * (x - bitcast<f32>(bits << SHIFT));
}
