//! Changes of decoded sections: numbers at the ends of their ranges, rows that are elsewhere, sections that are missing.

use translux_format::{ElementType, RawSection};

use crate::bytes::{Random, mutate};

/// Changes one section; its tag and what was done to it.
pub(crate) fn change(random: &mut Random, sections: &mut Vec<RawSection>, whole: &[RawSection]) -> Option<String> {
    let index = random.below(sections.len());
    let section = sections.get_mut(index)?;
    let tag = section.tag.to_string();
    let size = section.element.size() as usize;
    let (row, elements) = (size * usize::from(section.components), section.bytes.len() / size);
    if section.element == ElementType::Record {
        record(random, &mut section.bytes);
        return Some(format!("{tag} as a record"));
    }
    let done = match random.below(12) {
        0 => {
            mutate(random, &mut section.bytes);
            let whole_rows = section.bytes.len() / row * row;
            section.bytes.truncate(whole_rows);
            "some bytes"
        }
        1 if elements > 0 => {
            let rows = section.bytes.len() / row;
            let (a, b) = (random.below(rows), random.below(rows));
            for i in 0..row {
                section.bytes.swap(a * row + i, b * row + i);
            }
            "two rows swapped"
        }
        2 if elements > 0 => {
            section.bytes.truncate(random.below(section.bytes.len() / row) * row);
            "rows cut off"
        }
        3 if elements > 0 => {
            let again = section.bytes[..row].to_vec();
            section.bytes.extend(again);
            "a row more"
        }
        4 => {
            sections.remove(index);
            "removed"
        }
        5 => {
            let other = whole[random.below(whole.len())].bytes.clone();
            let rows = other.len() / row * row;
            section.bytes = other[..rows].to_vec();
            "the bytes of another"
        }
        6 if elements > 0 => {
            let value = number(random, section.element, &section.bytes[..size]);
            section.bytes = value.repeat(elements);
            "one number everywhere"
        }
        _ if elements > 0 => {
            for _ in 0..=random.below(3) {
                let at = random.below(elements) * size;
                let value = number(random, section.element, &section.bytes[at..at + size]);
                section.bytes[at..at + size].copy_from_slice(&value);
            }
            "numbers"
        }
        _ => return None,
    };
    Some(format!("{tag} {done}"))
}

/// Another number in the place of one.
fn number(random: &mut Random, element: ElementType, old: &[u8]) -> Vec<u8> {
    match element {
        ElementType::F32 => {
            let old = f32::from_le_bytes(old.try_into().unwrap());
            float(random, f64::from(old), [f64::from(f32::MAX), f64::from(f32::MIN_POSITIVE)], |v| {
                (v as f32).to_le_bytes().to_vec()
            })
        }
        ElementType::F64 => {
            let old = f64::from_le_bytes(old.try_into().unwrap());
            float(random, old, [f64::MAX, f64::MIN_POSITIVE], |v| v.to_le_bytes().to_vec())
        }
        _ => {
            let mut wide = [0; 8];
            wide[..old.len()].copy_from_slice(old);
            let old_value = u64::from_le_bytes(wide);
            let new = match random.below(9) {
                0 => 0,
                1 => u64::MAX,
                2 => u64::MAX - 1,
                3 => old_value.wrapping_add(1),
                4 => old_value.wrapping_sub(1),
                5 => 1 << (8 * old.len() - 1),
                6 => (1 << (8 * old.len() - 1)) - 1,
                7 => old_value ^ 1 << random.below(8 * old.len()),
                _ => random.next() >> random.below(64),
            };
            new.to_le_bytes()[..old.len()].to_vec()
        }
    }
}

fn float(random: &mut Random, old: f64, [most, least]: [f64; 2], bytes: impl Fn(f64) -> Vec<u8>) -> Vec<u8> {
    bytes(match random.below(14) {
        0 => 0.0,
        1 => -0.0,
        2 => most,
        3 => -most,
        4 => least,
        5 => f64::NAN,
        6 => f64::INFINITY,
        7 => -old,
        8 => old * 1e3,
        9 => old * 1e-3,
        10 => old * 1e12,
        11 => old * 10f64.powi(random.below(76) as i32 - 38),
        12 => 10f64.powi(random.below(76) as i32 - 38),
        _ => f64::from_bits(random.next()),
    })
}

/// Changes of a record: words at any place, or bytes.
fn record(random: &mut Random, bytes: &mut Vec<u8>) {
    if bytes.len() < 8 || random.below(4) == 0 {
        mutate(random, bytes);
        return;
    }
    for _ in 0..=random.below(2) {
        let at = random.below(bytes.len() - 7);
        let old: [u8; 8] = bytes[at..at + 8].try_into().unwrap();
        let as_float = f64::from_le_bytes(old);
        let element = match random.below(6) {
            0 => ElementType::U8,
            1 => ElementType::U32,
            2 => ElementType::F32,
            3 => ElementType::U64,
            // Most numbers of records are such.
            _ if as_float != 0.0 && as_float.abs() > 1e-12 && as_float.abs() < 1e12 => ElementType::F64,
            _ => ElementType::U32,
        };
        let size = element.size() as usize;
        let value = number(random, element, &old[..size]);
        bytes[at..at + size].copy_from_slice(&value);
    }
}
