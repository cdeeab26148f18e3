//! One pass over the statements of an OBJ file: every one is checked, and errors name its line.
//!
//! Our own reader replaces the crate `tobj`, because in `tobj` 4.0.5 errors have no line; corners without a texture
//! coordinate or normal repeat the one before; colours on some vertices only, comments after numbers, continued lines
//! and names that are not UTF-8 fail; a fourth coordinate divides the others (it is the weight of rational curves,
//! meaningless for polygons); a face of one or two corners becomes a point or a line; files without faces, NaN and
//! infinity are accepted; an unknown material is forgotten; vertices are numbered in the order of first use. Tests
//! compare both where both can read.

use std::collections::HashMap;

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::statement::{Index, Statements, index, number, shown, split_keyword, text_of, words};
use crate::error::{Error, Result};
use crate::io::polygon::MAX_POLYGON_CORNERS;

/// Index that stands for a missing texture coordinate or normal of a corner.
pub(super) const NONE: u32 = u32::MAX;

/// Largest number of unknown keywords in a warning; a file of garbage must not give a warning as long as itself.
const UNKNOWN_KEYWORDS_NAMED: usize = 8;

/// A corner of a face: indices from 0 into the values in file order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Corner {
    pub(super) vertex: u32,
    pub(super) uv: u32,
    pub(super) normal: u32,
}

/// A face: its corners end here (they start where the face before ends).
pub(super) struct Face {
    pub(super) end: usize,
    pub(super) material: u32,
    line: usize,
}

/// The content of a file that passed all checks.
#[derive(Default)]
pub(super) struct Parsed {
    pub(super) positions: Vec<DVec3>,
    /// Texture coordinates, possibly not finite.
    pub(super) uvs: Vec<Vec2>,
    /// Unit normals; zero where the file gives no direction.
    pub(super) normals: Vec<Vec3>,
    pub(super) corners: Vec<Corner>,
    pub(super) faces: Vec<Face>,
    pub(super) materials: Vec<String>,
    pub(super) material_libraries: Vec<String>,
    pub(super) warnings: Vec<String>,
}

/// Number of occurrences of an event, and its first line.
#[derive(Default)]
struct Tally {
    count: usize,
    first_line: usize,
}

impl Tally {
    fn add(&mut self, line: usize) {
        if self.count == 0 {
            self.first_line = line;
        }
        self.count += 1;
    }

    fn report(&self, warnings: &mut Vec<String>, what: &str) {
        if self.count > 0 {
            warnings.push(format!("{what}: {}, first at line {}", self.count, self.first_line));
        }
    }
}

#[derive(Default)]
struct Parser<'a> {
    name: &'a str,
    line: usize,
    parsed: Parsed,
    /// Vertices that are not finite, in order: index and line.
    not_finite: Vec<(u32, usize)>,
    material_ids: HashMap<String, u32>,
    material: Option<String>,
    /// Index of `material` once a face has used it.
    material_id: Option<u32>,
    weights: Tally,
    colours: Tally,
    points_and_lines: Tally,
    free_forms: Tally,
    trailing_slashes: Tally,
    unknown: Vec<(String, Tally)>,
    more_unknown: Tally,
}

/// Parses the bytes of a file; `name` stands in front of every error.
pub(super) fn parse(bytes: &[u8], name: &str) -> Result<Parsed> {
    let text = text_of(bytes, name)?;
    let mut parser = Parser { name, ..Parser::default() };
    for (line, statement) in Statements::new(text) {
        parser.line = line;
        parser.statement(&statement)?;
    }
    parser.finish()
}

impl Parser<'_> {
    fn wrong(&self, message: &str) -> Error {
        self.wrong_at(self.line, message)
    }

    fn wrong_at(&self, line: usize, message: &str) -> Error {
        Error::input(format!("{}:{line}: {message}", self.name))
    }

    fn statement(&mut self, statement: &[u8]) -> Result<()> {
        let (keyword, rest) = split_keyword(statement);
        match keyword {
            b"v" => self.vertex(rest),
            b"vt" => self.uv(rest),
            b"vn" => self.normal(rest),
            b"f" | b"fo" => self.face(rest),
            b"usemtl" => {
                self.material = (!rest.is_empty()).then(|| String::from_utf8_lossy(rest).into_owned());
                self.material_id = None;
                Ok(())
            }
            b"mtllib" => {
                let library = String::from_utf8_lossy(rest).into_owned();
                if !rest.is_empty() && !self.parsed.material_libraries.contains(&library) {
                    self.parsed.material_libraries.push(library);
                }
                Ok(())
            }
            _ => {
                self.other(keyword);
                Ok(())
            }
        }
    }

    /// Handles statements that hold no polygons.
    fn other(&mut self, keyword: &[u8]) {
        match keyword {
            // Names, smoothing and display attributes say nothing about geometry or materials.
            b"" | b"o" | b"g" | b"s" | b"mg" | b"bevel" | b"c_interp" | b"d_interp" | b"lod" | b"maplib"
            | b"usemap" | b"shadow_obj" | b"trace_obj" => {}
            _ if keyword[0] == b'#' => {}
            b"p" | b"l" => self.points_and_lines.add(self.line),
            b"vp" | b"cstype" | b"deg" | b"bmat" | b"step" | b"curv" | b"curv2" | b"surf" | b"parm" | b"trim"
            | b"hole" | b"scrv" | b"sp" | b"end" | b"con" | b"ctech" | b"stech" => self.free_forms.add(self.line),
            _ => {
                let word = shown(keyword);
                if let Some((_, tally)) = self.unknown.iter_mut().find(|(known, _)| *known == word) {
                    tally.add(self.line);
                } else if self.unknown.len() < UNKNOWN_KEYWORDS_NAMED {
                    let mut tally = Tally::default();
                    tally.add(self.line);
                    self.unknown.push((word, tally));
                } else {
                    self.more_unknown.add(self.line);
                }
            }
        }
    }

    /// Parses up to eight numbers of a statement; more are an error in any statement.
    fn numbers(&self, keyword: &str, rest: &[u8]) -> Result<([f64; 8], usize)> {
        let mut values = [0.0; 8];
        let mut count = 0;
        for word in words(rest) {
            let Some(value) = values.get_mut(count) else {
                return Err(self.wrong(&format!("`{keyword}` with more than 8 numbers")));
            };
            *value = number(word).ok_or_else(|| {
                let hint = if word.contains(&b',') { " (decimals need a point)" } else { "" };
                self.wrong(&format!("`{}` is not a number{hint}", shown(word)))
            })?;
            count += 1;
        }
        Ok((values, count))
    }

    fn check_count(&self, count: usize, what: &str) -> Result<()> {
        if count >= NONE as usize {
            return Err(Error::unsupported(format!("{}: more than {NONE} {what}; split the model", self.name)));
        }
        Ok(())
    }

    fn vertex(&mut self, rest: &[u8]) -> Result<()> {
        let (values, count) = self.numbers("v", rest)?;
        match count {
            3 => {}
            4 if values[3] != 1.0 => self.weights.add(self.line),
            4 => {}
            6 | 7 => self.colours.add(self.line),
            _ => {
                return Err(
                    self.wrong(&format!("vertex with {count} numbers; x y z are needed, w or r g b may follow"))
                );
            }
        }
        self.check_count(self.parsed.positions.len(), "vertices")?;
        let position = DVec3::new(values[0], values[1], values[2]);
        if position.is_finite() {
            self.parsed.positions.push(position);
        } else {
            self.not_finite.push((self.parsed.positions.len() as u32, self.line));
            self.parsed.positions.push(DVec3::ZERO);
        }
        Ok(())
    }

    fn uv(&mut self, rest: &[u8]) -> Result<()> {
        let (values, count) = self.numbers("vt", rest)?;
        if !(1..=3).contains(&count) {
            return Err(self.wrong(&format!("texture coordinate with {count} numbers; one to three are needed")));
        }
        self.check_count(self.parsed.uvs.len(), "texture coordinates")?;
        // A missing v is 0, as the format has it.
        self.parsed.uvs.push(DVec2::new(values[0], values[1]).as_vec2());
        Ok(())
    }

    fn normal(&mut self, rest: &[u8]) -> Result<()> {
        let (values, count) = self.numbers("vn", rest)?;
        if count != 3 {
            return Err(self.wrong(&format!("normal with {count} numbers; three are needed")));
        }
        self.check_count(self.parsed.normals.len(), "normals")?;
        let value = DVec3::new(values[0], values[1], values[2]);
        // The largest component first: squares of the largest and smallest doubles leave the range.
        let unit = (value / value.abs().max_element()).normalize_or_zero();
        self.parsed.normals.push(if value.is_finite() { unit.as_vec3() } else { Vec3::ZERO });
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<()> {
        let start = self.parsed.corners.len();
        for word in words(rest) {
            let corner = self.corner(word)?;
            self.parsed.corners.push(corner);
        }
        let count = self.parsed.corners.len() - start;
        if count < 3 {
            let corners = if count == 1 { "corner" } else { "corners" };
            return Err(self.wrong(&format!("face with {count} {corners}; at least 3 are needed")));
        }
        if count > MAX_POLYGON_CORNERS {
            return Err(Error::unsupported(format!(
                "{}:{}: face with {count} corners; at most {MAX_POLYGON_CORNERS} are supported: cut it into triangles",
                self.name, self.line
            )));
        }
        let material = match self.material_id {
            Some(id) => id,
            None => self.use_material(),
        };
        self.parsed.faces.push(Face { end: self.parsed.corners.len(), material, line: self.line });
        Ok(())
    }

    /// The index of the current material, which is entered at its first face.
    fn use_material(&mut self) -> u32 {
        let name = self.material.as_deref().unwrap_or("default").to_owned();
        let materials = &mut self.parsed.materials;
        let id = *self.material_ids.entry(name).or_insert_with_key(|name| {
            materials.push(name.clone());
            materials.len() as u32 - 1
        });
        self.material_id = Some(id);
        id
    }

    fn corner(&mut self, word: &[u8]) -> Result<Corner> {
        let mut parts = word.split(|&b| b == b'/');
        let [vertex, uv, normal] = [parts.next(), parts.next(), parts.next()].map(Option::unwrap_or_default);
        if vertex.is_empty() || parts.next().is_some() {
            let word = shown(word);
            return Err(self.wrong(&format!("`{word}` is no corner of a face; v, v/vt, v//vn or v/vt/vn are")));
        }
        if word.ends_with(b"/") {
            self.trailing_slashes.add(self.line);
        }
        Ok(Corner {
            vertex: self.resolve(vertex, self.parsed.positions.len(), "vertex")?,
            uv: self.resolve(uv, self.parsed.uvs.len(), "texture coordinate")?,
            normal: self.resolve(normal, self.parsed.normals.len(), "normal")?,
        })
    }

    /// An index counted from 0. Absolute ones may refer to lines below, so their range is checked at the end.
    fn resolve(&self, word: &[u8], above: usize, what: &str) -> Result<u32> {
        if word.is_empty() {
            return Ok(NONE);
        }
        match index(word) {
            Some(Index::Absolute(value)) if value < u64::from(NONE) => Ok(value as u32),
            Some(Index::Back(value)) if value <= above as u64 => Ok((above as u64 - value) as u32),
            Some(Index::Back(value)) => Err(self.wrong(&format!(
                "face refers to {what} -{value}, but only {above} are defined above; negative indices count back from \
                 the line of the face"
            ))),
            Some(Index::Zero) => {
                Err(self.wrong(&format!("face refers to {what} 0, but indices count from 1 (or back from -1)")))
            }
            Some(Index::Absolute(_)) | None => {
                Err(self.wrong(&format!("`{}` is not an index of a {what}", shown(word))))
            }
        }
    }

    fn finish(self) -> Result<Parsed> {
        if self.parsed.faces.is_empty() {
            return Err(self.without_faces());
        }
        self.check_ranges()?;
        self.check_finite()?;
        Ok(Parsed { warnings: self.warnings(), ..self.parsed })
    }

    fn without_faces(&self) -> Error {
        let name = self.name;
        let vertices = self.parsed.positions.len();
        let unknown: usize = self.unknown.iter().map(|(_, tally)| tally.count).sum::<usize>() + self.more_unknown.count;
        Error::input(if vertices == 0 && unknown > 0 {
            format!("{name}: no vertices, no faces and {unknown} unknown statements; is this an OBJ file?")
        } else if vertices == 0 {
            format!("{name}: no vertices and no faces")
        } else if self.free_forms.count > 0 {
            format!("{name}: no faces, only free-form curves or surfaces; export the model as polygons")
        } else if self.points_and_lines.count > 0 {
            format!("{name}: {vertices} vertices and no faces, only points or lines; export the model with its faces")
        } else {
            format!("{name}: {vertices} vertices and no faces; export the model with its faces")
        })
    }

    /// Refuses the first face in the file that refers to something undefined.
    fn check_ranges(&self) -> Result<()> {
        let mut corners = self.parsed.corners.iter().enumerate();
        let outside = corners.find_map(|(at, corner)| {
            [
                (corner.vertex, self.parsed.positions.len(), "vertex"),
                (corner.uv, self.parsed.uvs.len(), "texture coordinate"),
                (corner.normal, self.parsed.normals.len(), "normal"),
            ]
            .into_iter()
            .find(|&(index, count, what)| index as usize >= count && (index != NONE || what == "vertex"))
            .map(|found| (at, found))
        });
        let Some((at, (index, count, what))) = outside else { return Ok(()) };
        let number = u64::from(index) + 1;
        Err(self.wrong_at(
            self.line_of_corner(at),
            &format!(
                "face refers to {what} {number}, but only {count} are defined in the file; it may be cut off, or its \
                 indices may count per object"
            ),
        ))
    }

    /// Refuses faces with vertices that are not finite; unused ones have become zero.
    fn check_finite(&self) -> Result<()> {
        if self.not_finite.is_empty() {
            return Ok(());
        }
        let line_of = |vertex: u32| {
            self.not_finite.binary_search_by_key(&vertex, |&(v, _)| v).ok().map(|found| self.not_finite[found].1)
        };
        let used =
            self.parsed.corners.iter().enumerate().find_map(|(at, c)| line_of(c.vertex).map(|l| (at, c.vertex, l)));
        let Some((at, vertex, line)) = used else { return Ok(()) };
        Err(self.wrong_at(
            self.line_of_corner(at),
            &format!(
                "face uses vertex {}, whose coordinates are not finite (line {line}); correct the vertex or delete the \
                 face",
                u64::from(vertex) + 1
            ),
        ))
    }

    fn line_of_corner(&self, corner: usize) -> usize {
        let face = self.parsed.faces.partition_point(|face| face.end <= corner);
        self.parsed.faces.get(face).map_or(self.line, |face| face.line)
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(&(_, first_line)) = self.not_finite.first() {
            Tally { count: self.not_finite.len(), first_line }
                .report(&mut warnings, "vertices that are not finite, set to zero as no face uses them");
        }
        self.weights.report(&mut warnings, "vertices with a weight w other than 1, which polygons ignore");
        self.colours.report(&mut warnings, "vertices with colours, which are left out");
        self.points_and_lines.report(&mut warnings, "point and line statements left out");
        self.free_forms.report(&mut warnings, "statements of free-form curves and surfaces left out");
        self.trailing_slashes.report(&mut warnings, "face corners that end with a slash, read as if they did not");
        for (keyword, tally) in &self.unknown {
            tally.report(&mut warnings, &format!("unknown statements `{keyword}` left out"));
        }
        self.more_unknown.report(&mut warnings, "more unknown statements left out");
        warnings
    }
}
