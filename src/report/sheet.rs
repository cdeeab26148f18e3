//! Contact sheets: pictures in rows and columns with their names, as one PNG or as one page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::error::{Error, Result};
use crate::io::png::{decode_png, encode_png};
use crate::math::srgb::linear_from_srgb;
use crate::measure::chart::draw::{FONT, fonts};
use crate::measure::chart::page::escaped;

/// Grey behind the pictures, and the text on it.
const PAPER: u8 = 32;
const INK: RGBColor = RGBColor(225, 225, 225);
/// Height of letters, of a line of them, and room between things, in pixels.
const LETTER: u32 = 15;
const LINE: u32 = 20;
const GAP: u32 = 6;
/// Largest side of a sheet in pixels.
pub(crate) const LARGEST: u32 = 1 << 14;

/// Pictures of equal size in rows and columns.
pub(crate) struct Sheet {
    /// What is below all of it, a line each.
    pub(crate) caption: Vec<String>,
    /// Names of the rows.
    pub(crate) rows: Vec<String>,
    /// Names of groups of columns, all of the same number.
    pub(crate) groups: Vec<String>,
    /// Names of the columns, group after group.
    pub(crate) columns: Vec<String>,
    /// Encoded PNG of each cell, row by row.
    pub(crate) cells: Vec<Vec<u8>>,
    /// Width and height of a cell in pixels.
    pub(crate) cell: [u32; 2],
}

impl Sheet {
    /// Width and height of a sheet as PNG, in pixels, whose longest row name has so many letters.
    pub(crate) fn size(cell: [u32; 2], [rows, columns]: [usize; 2], letters: usize, lines: usize) -> Option<[u32; 2]> {
        let [rows, columns, letters, lines] = [rows, columns, letters, lines].map(|n| u32::try_from(n).ok());
        let left = letters?.checked_mul(LETTER)?.checked_mul(3)? / 5 + 2 * GAP;
        let width = columns?.checked_mul(cell[0].checked_add(GAP)?)?.checked_add(left)?;
        let text = lines?.checked_add(2)?.checked_mul(LINE)?.checked_add(3 * GAP)?;
        let height = rows?.checked_mul(cell[1].checked_add(GAP)?)?.checked_add(text)?;
        (width <= LARGEST && height <= LARGEST).then_some([width, height])
    }

    /// The sheet as one picture.
    ///
    /// # Errors
    /// A sheet of more than [`LARGEST`] pixels a side; cells that are no pictures of their size (exit 4: a caller's mistake).
    pub(crate) fn to_png(&self) -> Result<Vec<u8>> {
        let letters = self.rows.iter().map(|name| name.chars().count()).max().unwrap_or(0);
        let counts = [self.rows.len(), self.columns.len()];
        let too_large = || Error::runtime("the sheet is too large for one picture");
        let [width, _] = Self::size(self.cell, counts, letters, 0).ok_or_else(too_large)?;
        let caption: Vec<String> = self.caption.iter().flat_map(|text| wrapped(text, letters_in(width))).collect();
        let [width, height] = Self::size(self.cell, counts, letters, caption.len()).ok_or_else(too_large)?;
        let mut buffer = vec![PAPER; 3 * width as usize * height as usize];
        let left = width - counts[1] as u32 * (self.cell[0] + GAP);
        let top = 2 * LINE + GAP;
        let at = |row: usize, column: usize| {
            [left + column as u32 * (self.cell[0] + GAP), top + row as u32 * (self.cell[1] + GAP)]
        };
        fonts();
        let root = BitMapBackend::with_buffer(&mut buffer, (width, height)).into_drawing_area();
        let write = |text: &str, [x, y]: [u32; 2], horizontal: HPos| {
            let style = TextStyle::from((FONT, LETTER).into_font()).color(&INK).pos(Pos::new(horizontal, VPos::Top));
            root.draw_text(text, &style, (x as i32, y as i32)).map_err(|e| Error::runtime(format!("sheet: {e}")))
        };
        for (column, text) in self.columns.iter().enumerate() {
            write(text, [at(0, column)[0] + self.cell[0] / 2, GAP + LINE], HPos::Center)?;
        }
        let of_a_group = counts[1] / self.groups.len().max(1);
        for (group, text) in self.groups.iter().enumerate() {
            let wide = of_a_group as u32 * (self.cell[0] + GAP) - GAP;
            let middle = at(0, group * of_a_group)[0] + wide / 2;
            write(&shortened(text, letters_in(wide + 2 * GAP)), [middle, GAP], HPos::Center)?;
        }
        for (row, name) in self.rows.iter().enumerate() {
            let [_, y] = at(row, 0);
            write(name, [left - GAP, y + self.cell[1] / 2 - LETTER / 2], HPos::Right)?;
        }
        let below = at(self.rows.len(), 0)[1];
        for (line, text) in caption.iter().enumerate() {
            write(text, [GAP, below + line as u32 * LINE], HPos::Left)?;
        }
        root.present().map_err(|e| Error::runtime(format!("sheet: {e}")))?;
        drop(root);
        let paper = linear_from_srgb(f64::from(PAPER) / 255.0) as f32;
        let mut rgb: Vec<[f32; 3]> = buffer
            .as_chunks::<3>()
            .0
            .iter()
            .map(|pixel| pixel.map(|code| linear_from_srgb(f64::from(code) / 255.0) as f32))
            .collect();
        for (index, cell) in self.cells.iter().enumerate() {
            let picture = decode_png(cell)?;
            if [picture.width, picture.height] != self.cell.map(|side| side as usize) {
                return Err(Error::runtime("a cell of the sheet has another size"));
            }
            let [x, y] = at(index / counts[1], index % counts[1]).map(|pixel| pixel as usize);
            for (line, pixels) in picture.rgb.chunks(picture.width).enumerate() {
                for (column, pixel) in pixels.iter().enumerate() {
                    let alpha = picture.alpha.as_ref().map_or(1.0, |alpha| alpha[line * picture.width + column]);
                    let over = pixel.map(|c| alpha * c + (1.0 - alpha) * paper);
                    rgb[(y + line) * width as usize + x + column] = over;
                }
            }
        }
        encode_png(width as usize, height as usize, &rgb, None)
    }

    /// The sheet as a page with its pictures inside.
    pub(crate) fn to_html(&self, title: &str) -> String {
        let columns: String = self.columns.iter().map(|name| format!("<th>{}</th>", escaped(name))).collect();
        let count = self.columns.len().max(1);
        let of_a_group = count / self.groups.len().max(1);
        let groups = self.groups.iter().map(|name| format!("<th colspan=\"{of_a_group}\">{}</th>", escaped(name)));
        let groups: String = groups.collect();
        let row = |(name, cells): (&String, &[Vec<u8>])| {
            let cells: String = cells
                .iter()
                .zip(&self.columns)
                .enumerate()
                .map(|(index, (cell, column))| {
                    let group = self.groups.get(index / of_a_group.max(1)).map_or("", String::as_str);
                    let about = escaped(&format!("{name}, {column}, {group}"));
                    format!(
                        "<td><img alt=\"{about}\" title=\"{about}\" src=\"data:image/png;base64,{}\"></td>",
                        STANDARD.encode(cell)
                    )
                })
                .collect();
            format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", escaped(name))
        };
        let rows: String = self.rows.iter().zip(self.cells.chunks(count)).map(row).collect();
        let caption: String = self.caption.iter().map(|line| format!("<p>{}</p>\n", escaped(line))).collect();
        let title = escaped(title);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{title}</title>\n<style>\n\
             body {{ background: rgb({PAPER} {PAPER} {PAPER}); color: #e1e1e1; font: 15px sans-serif; }}\n\
             th {{ font-weight: normal; padding: 4px; }}\nimg {{ display: block; }}\n</style>\n\
             <table>\n<tr><td></td>{groups}</tr>\n<tr><td></td>{columns}</tr>\n{rows}</table>\n{caption}</html>\n"
        )
    }
}

/// Letters that a line of a width takes between its margins.
pub(super) fn letters_in(width: u32) -> usize {
    (width.saturating_sub(2 * GAP) * 5 / (3 * LETTER)) as usize
}

/// A text in lines of at most so many letters, cut at its spaces; words that are longer have a line each.
pub(super) fn wrapped(text: &str, letters: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.len() - 1;
        let line = &mut lines[last];
        if line.is_empty() {
            line.push_str(word);
        } else if line.chars().count() + 1 + word.chars().count() <= letters {
            line.extend([" ", word]);
        } else {
            lines.push(word.to_owned());
        }
    }
    lines
}

/// A text of at most so many letters, the rest of which is left out.
fn shortened(text: &str, letters: usize) -> String {
    if text.chars().count() <= letters {
        return text.to_owned();
    }
    let kept: String = text.chars().take(letters.saturating_sub(1)).collect();
    kept + "…"
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Two rows and three columns of plain cells, each of another grey.
    fn sheet() -> Sheet {
        let cell = |grey: usize| encode_png(60, 40, &[[0.1 + 0.1 * grey as f32; 3]; 2400], None).unwrap();
        Sheet {
            caption: vec!["<one> bake".to_owned()],
            rows: vec!["wax".to_owned(), "jade".to_owned()],
            groups: vec!["sky".to_owned()],
            columns: (0..3).map(|i| format!("{i} mm")).collect(),
            cells: (0..6).map(cell).collect(),
            cell: [60, 40],
        }
    }

    #[test]
    fn cells_stand_where_their_names_say() {
        let sheet = sheet();
        let picture = decode_png(&sheet.to_png().unwrap()).unwrap();
        let [width, height] = Sheet::size([60, 40], [2, 3], 4, 1).unwrap().map(|side| side as usize);
        assert_eq!((picture.width, picture.height), (width, height));
        let (left, top) = (width - 3 * (60 + GAP as usize), (2 * LINE + GAP) as usize);
        for (index, grey) in (0..6).map(|i| (i, 0.1 + 0.1 * i as f32)) {
            let (x, y) = (left + index % 3 * (60 + GAP as usize), top + index / 3 * (40 + GAP as usize));
            let seen = picture.rgb[(y + 3) * width + x + 4];
            assert!((seen[0] - grey).abs() < 0.01, "{index}: {seen:?}");
        }
        // Names are written, above and at the side.
        let is_ink = |i: &usize| picture.rgb[*i][0] > 0.2;
        let above = (0..top * width).filter(is_ink).count();
        let beside = (top * width..height * width).filter(|i| i % width < left - GAP as usize).filter(is_ink).count();
        assert!(above > 20 && beside > 20, "{above} {beside}");
        assert!(
            Sheet::size([4096, 10], [1, 5], 4, 1).is_none() && Sheet::size([8, 6], [usize::MAX, 1], 4, 1).is_none()
        );
    }

    #[test]
    fn captions_of_narrow_sheets_take_more_lines() {
        let text = "one bake of some samples and a name_that_is_longer_than_a_line";
        assert_eq!(wrapped(text, 12), ["one bake of", "some samples", "and a", "name_that_is_longer_than_a_line"]);
        assert_eq!(wrapped(text, 99), [text]);
        let of = |caption: &str| {
            let sheet = Sheet { caption: vec![caption.to_owned()], ..sheet() };
            decode_png(&sheet.to_png().unwrap()).unwrap()
        };
        let (short, long) = (of("one bake"), of("one bake of many samples with a small error and a name"));
        assert_eq!(short.width, long.width);
        let lines = (long.height - short.height) / LINE as usize;
        assert!((2..8).contains(&lines), "{lines}");
        // Nothing is written over the right margin.
        let below = short.height - LINE as usize - GAP as usize;
        let margin = (below * long.width..long.height * long.width).filter(|i| i % long.width + 2 >= long.width);
        assert!(margin.into_iter().all(|i| (long.rgb[i][0] - long.rgb[0][0]).abs() < 0.01));
    }

    #[test]
    fn pages_hold_their_pictures_and_escape_their_text() {
        let page = sheet().to_html("a & b");
        assert_eq!(page.matches("data:image/png;base64,").count(), 6);
        assert!(page.contains("<title>a &amp; b</title>") && page.contains("&lt;one&gt; bake"), "{page}");
        assert!(page.contains("jade, 2 mm, sky") && !page.contains("http"));
    }
}
