//! The sRGB transfer function, and colours as they are typed.

use glam::DVec3;

/// The sRGB transfer function (IEC 61966-2-1): linear light to code value, both in [0, 1].
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The inverse of [`srgb_from_linear`].
pub fn linear_from_srgb(code: f64) -> f64 {
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// A colour as it is typed on the web, `#e8c4b0` or `#abc` (the `#` may be missing from six digits), as linear sRGB.
pub fn linear_from_hex(text: &str) -> Option<DVec3> {
    let (digits, is_marked) = text.strip_prefix('#').map_or((text, false), |digits| (digits, true));
    if !digits.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let code = |range: std::ops::Range<usize>| u8::from_str_radix(digits.get(range)?, 16).ok();
    let codes = match (digits.len(), is_marked) {
        (6, _) => [code(0..2)?, code(2..4)?, code(4..6)?],
        (3, true) => [17 * code(0..1)?, 17 * code(1..2)?, 17 * code(2..3)?],
        _ => return None,
    };
    Some(DVec3::from_array(codes.map(|code| linear_from_srgb(f64::from(code) / 255.0))))
}

/// The nearest colour of [`linear_from_hex`], with six digits; channels are clamped to [0, 1].
pub fn hex_from_linear(colour: DVec3) -> String {
    let code = |v: f64| (255.0 * srgb_from_linear(v.clamp(0.0, 1.0))).round() as u8;
    let [r, g, b] = colour.to_array().map(code);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_transfer_is_invertible_and_meets_known_values() {
        assert!((srgb_from_linear(0.214_041_14) - 0.5).abs() < 1e-7);
        assert!(srgb_from_linear(0.0) == 0.0 && (srgb_from_linear(1.0) - 1.0).abs() < 1e-15);
        for i in 0..=1000 {
            let code = f64::from(i) / 1000.0;
            assert!((srgb_from_linear(linear_from_srgb(code)) - code).abs() < 2e-8);
        }
    }

    #[test]
    fn colours_are_read_as_they_are_typed() {
        let known = DVec3::new(0.806_952_3, 0.552_011_4, 0.434_153_7);
        for text in ["#e8c4b0", "e8c4b0", "#E8C4B0"] {
            let read = linear_from_hex(text).expect("a colour");
            assert!((read - known).abs().max_element() < 1e-6, "{text}: {read}");
            assert_eq!(hex_from_linear(read), "#e8c4b0");
        }
        assert_eq!(linear_from_hex("#fff"), Some(DVec3::ONE));
        assert_eq!(linear_from_hex("#0a0"), linear_from_hex("00aa00"));
        for bad in ["", "#", "fff", "#ffff", "#12345g", "#1234567", "e8c4bé", "+8c4b0", "#é12"] {
            assert_eq!(linear_from_hex(bad), None, "{bad}");
        }
    }
}
