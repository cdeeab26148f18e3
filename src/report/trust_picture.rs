//! The map of where an asset is wrong as it is seen by a camera: a layer of OpenEXR, and false colours with their legend.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::sheet::{letters_in, wrapped};
use super::text::percent;
use crate::error::{Error, Result};
use crate::evaluate::Evaluator;
use crate::evaluate::exitance::MeshPoint;
use crate::io::exr_write::{ExrChannel, ExrLayer, SampleKind};
use crate::io::png::encode_png;
use crate::math::srgb::linear_from_srgb;
use crate::measure::chart::draw::{FONT, fonts};
use crate::measure::trust::{Trust, VertexTrust};
use crate::render::camera::Resolution;
use crate::render::centres::centres;
use crate::render::frame::RenderSettings;

/// Values of the colours from no error to the largest that is shown, sRGB: dark to bright, so that they are told apart without hue.
const COLOURS: [[u8; 3]; 6] =
    [[13, 8, 60], [84, 15, 109], [154, 40, 100], [213, 72, 66], [245, 140, 30], [252, 245, 160]];

/// What is beside the object, and where a radiosity is cut off at 0, sRGB.
const PAPER: [u8; 3] = [32, 32, 32];
const CLAMPED: [u8; 3] = [0, 200, 255];
const INK: RGBColor = RGBColor(225, 225, 225);

/// Height of letters, of a line, of the bar, and room between things, in pixels.
const LETTER: u32 = 15;
const LINE: u32 = 20;
const BAR: u32 = 14;
const GAP: u32 = 6;

/// Share of the places seen that have a colour of their own: the rest is as bright as the largest of them.
const SHOWN: f64 = 0.995;

/// A value of a vertex.
type Of = fn(&VertexTrust) -> f64;

/// Channels of the layer, and what they are of a vertex.
const CHANNELS: [(&str, Of); 6] = [
    ("error", |v| v.error.max_element()),
    ("local", |v| v.local),
    ("worst", |v| v.worst),
    ("between", |v| v.between),
    ("thickness", |v| v.thickness),
    ("clamped", |v| f64::from(u8::from(v.clamped))),
];

/// The map as it is seen, a value for each pixel and channel; 0 beside the object.
pub(crate) struct TrustPicture {
    resolution: Resolution,
    seen: Vec<bool>,
    /// In the order of [`CHANNELS`].
    channels: Vec<Vec<f32>>,
    lights: usize,
}

impl TrustPicture {
    /// The map of an evaluator's asset through the middle of each pixel, linear between the vertices.
    pub(crate) fn new(trust: &Trust, evaluator: &dyn Evaluator, settings: &RenderSettings) -> Self {
        let points = centres(evaluator, (&settings.camera, settings.resolution));
        let of = |value: Of| {
            let at = |point: &MeshPoint| -> f64 {
                let corner = |v: u32| trust.vertices.get(v as usize).map_or(0.0, value);
                point.vertices.iter().zip(point.barycentric).map(|(v, weight)| weight * corner(*v)).sum()
            };
            points.iter().map(|point| point.as_ref().map_or(0.0, |p| (at(p) as f32).clamp(0.0, f32::MAX))).collect()
        };
        Self {
            resolution: settings.resolution,
            seen: points.iter().map(Option::is_some).collect(),
            channels: CHANNELS.iter().map(|(_, value)| of(*value)).collect(),
            lights: trust.lights.len(),
        }
    }

    /// The layer `trust`, 32 bits.
    pub(crate) fn layer(&self) -> ExrLayer {
        let channel = |((name, _), samples): (&(&str, _), &Vec<f32>)| ExrChannel {
            name: (*name).to_owned(),
            kind: SampleKind::Float,
            samples: samples.clone(),
        };
        ExrLayer { name: "trust".to_owned(), channels: CHANNELS.iter().zip(&self.channels).map(channel).collect() }
    }

    /// The largest error that has a colour of its own: one, two or five of a power of ten.
    fn top(&self) -> f64 {
        let mut seen: Vec<f32> =
            self.channels[0].iter().zip(&self.seen).filter(|(_, seen)| **seen).map(|(value, _)| *value).collect();
        seen.sort_unstable_by(f32::total_cmp);
        let rank = ((SHOWN * seen.len() as f64).ceil() as usize).saturating_sub(1);
        let largest = seen.get(rank).map_or(0.0, |value| f64::from(*value));
        if largest <= 0.0 {
            return 1.0;
        }
        let decade = 10f64.powf(largest.log10().floor());
        [1.0, 2.0, 5.0].map(|step| step * decade).into_iter().find(|top| *top >= largest).unwrap_or(10.0 * decade)
    }

    /// False colours of the expected error, with a legend below that says what they mean.
    ///
    /// # Errors
    /// As [`encode_png`].
    pub(crate) fn to_png(&self) -> Result<Vec<u8>> {
        let Resolution { width, height, .. } = self.resolution;
        let top = self.top();
        let failed = |e: &dyn std::fmt::Display| Error::runtime(format!("legend: {e}"));
        let text = format!(
            "Expected error of the radiosity, worst channel, over its RMS on the surface: mean over {} lights. Cyan: cut off at 0.",
            self.lights
        );
        let wide = u32::try_from(width).map_err(|e| failed(&e))?;
        let lines = wrapped(&text, letters_in(wide));
        let below = 4 * GAP + BAR + LINE * (lines.len() as u32 + 1);
        let mut legend = PAPER.repeat(width * below as usize);
        let bar = wide.saturating_sub(2 * GAP).max(1);
        for x in 0..bar.min(wide) {
            let colour = colour(f64::from(x) / f64::from(bar));
            for y in GAP..GAP + BAR {
                let at = 3 * (y as usize * width + (GAP + x).min(wide - 1) as usize);
                legend[at..at + 3].copy_from_slice(&colour);
            }
        }
        fonts();
        {
            let root = BitMapBackend::with_buffer(&mut legend, (wide, below)).into_drawing_area();
            let write = |text: &str, x: u32, y: u32, horizontal: HPos| {
                let style =
                    TextStyle::from((FONT, LETTER).into_font()).color(&INK).pos(Pos::new(horizontal, VPos::Top));
                root.draw_text(text, &style, (x as i32, y as i32)).map_err(|e| failed(&e))
            };
            let y = 2 * GAP + BAR;
            write("0", GAP, y, HPos::Left)?;
            write(&percent(0.5 * top), wide / 2, y, HPos::Center)?;
            write(&percent(top), wide.saturating_sub(GAP), y, HPos::Right)?;
            for (line, text) in lines.iter().enumerate() {
                write(text, GAP, y + GAP + LINE * (line as u32 + 1), HPos::Left)?;
            }
            root.present().map_err(|e| failed(&e))?;
        }
        let last = CHANNELS.len() - 1;
        let of = |index: usize| match self.seen[index] {
            false => PAPER,
            true if self.channels[last][index] > 0.5 => CLAMPED,
            true => colour(f64::from(self.channels[0][index]) / top),
        };
        let codes = (0..width * height).map(of).chain(legend.as_chunks::<3>().0.iter().copied());
        let linear = |code: u8| linear_from_srgb(f64::from(code) / 255.0) as f32;
        let rgb: Vec<[f32; 3]> = codes.map(|code| code.map(linear)).collect();
        encode_png(width, height + below as usize, &rgb, None)
    }
}

/// The colour of a share of the largest error, sRGB.
fn colour(share: f64) -> [u8; 3] {
    let at = share.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f64;
    let first = (at as usize).min(COLOURS.len() - 2);
    let (low, high, between) = (COLOURS[first], COLOURS[first + 1], at - first as f64);
    std::array::from_fn(|c| (f64::from(low[c]) * (1.0 - between) + f64::from(high[c]) * between).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_grow_brighter_from_end_to_end() {
        let brightness = |share: f64| colour(share).map(u32::from).iter().sum::<u32>();
        assert_eq!((colour(-1.0), colour(2.0)), (COLOURS[0], COLOURS[5]));
        assert!((0..100).all(|i| brightness(f64::from(i) / 100.0) <= brightness(f64::from(i + 1) / 100.0)));
    }
}
