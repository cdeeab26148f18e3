//! Writes the narrow dialect of OBJ that `tobj` reads without guessing.

use super::preflight::{Corner, NONE};
use super::statement::words;

/// A statement with the first words of the original, which `tobj` then parses to the same numbers.
pub(super) fn append_words(text: &mut Vec<u8>, keyword: &[u8], rest: &[u8], count: usize) {
    text.extend_from_slice(keyword);
    for word in words(rest).take(count) {
        text.push(b' ');
        text.extend_from_slice(word);
    }
    text.push(b'\n');
}

/// A face that counts through all values; `counts` are those of vertices, texture coordinates and normals.
pub(super) fn append_counting_face(text: &mut Vec<u8>, corners: usize, counts: [usize; 3]) {
    text.push(b'f');
    for i in 0..corners {
        let [vertex, uv, normal] = counts.map(|count| match count {
            0 => NONE,
            _ if i < count => i as u32,
            _ => 0,
        });
        append_corner(text, Corner { vertex, uv, normal });
    }
    text.push(b'\n');
}

/// The faces of the file, with absolute indices; `ends` says where in `corners` each of them ends.
pub(super) fn append_faces(text: &mut Vec<u8>, corners: &[Corner], ends: impl Iterator<Item = usize>) {
    text.reserve(9 * corners.len());
    let mut start = 0;
    for end in ends {
        text.push(b'f');
        for &corner in &corners[start..end] {
            append_corner(text, corner);
        }
        text.push(b'\n');
        start = end;
    }
}

fn append_corner(text: &mut Vec<u8>, corner: Corner) {
    text.push(b' ');
    append_number(text, corner.vertex);
    if corner.uv != NONE || corner.normal != NONE {
        text.push(b'/');
    }
    if corner.uv != NONE {
        append_number(text, corner.uv);
    }
    if corner.normal != NONE {
        text.push(b'/');
        append_number(text, corner.normal);
    }
}

/// An index from 0 as OBJ writes it, from 1.
fn append_number(text: &mut Vec<u8>, index: u32) {
    let mut digits = [0u8; 10];
    let mut at = digits.len();
    let mut value = u64::from(index) + 1;
    while value > 0 {
        at -= 1;
        digits[at] = b'0' + (value % 10) as u8;
        value /= 10;
    }
    text.extend_from_slice(&digits[at..]);
}
