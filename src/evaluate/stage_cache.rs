//! Results of stages that a bake leaves for later ones of the same input.
//!
//! What a stage computes is named by a hash of everything that it depends on: its name, the revision of the algorithms, what rounds on
//! the machine, and its own input, which a stage tells a [`Key`]. A result that is found is the one that the stage would give, to the bit.

use std::fmt;
use std::sync::Arc;

use bytemuck::Pod;
use translux_format::{Codec, ElementType, Kind, RawSection, Tag};

use super::division::{Division, Keep};
use crate::asset::ALGORITHM_REVISION;
use crate::error::Result;
use crate::geometry::mesh::Mesh;
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::math::machine::Machine;

/// A place for results, or none, and where other processes leave blocks of the same bake. It changes the time of a bake and nothing else: all
/// are equal.
#[derive(Clone, Default)]
pub struct StageCache {
    keep: Option<Arc<dyn Keep>>,
    division: Option<Arc<dyn Division>>,
}

impl PartialEq for StageCache {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for StageCache {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("StageCache")
    }
}

/// A hash of a stage's input. What has no fixed length is hashed with its length, so that no two inputs run into one.
pub struct Key(blake3::Hasher);

impl Key {
    pub(super) fn new(stage: &str) -> Self {
        let mut key = Self(blake3::Hasher::new());
        key.text(stage).number(u64::from(ALGORITHM_REVISION)).text(env!("CARGO_PKG_VERSION"));
        let Machine { architecture, avx512, fma, functions } = Machine::this();
        key.text(&architecture).text(&functions).number(u64::from(avx512)).number(u64::from(fma));
        key
    }

    /// The hash of what was added.
    pub(super) fn name(&self) -> [u8; 32] {
        *self.0.finalize().as_bytes()
    }

    /// Adds a number.
    pub fn number(&mut self, number: u64) -> &mut Self {
        self.0.update(&number.to_le_bytes());
        self
    }

    /// Adds a text.
    pub fn text(&mut self, text: &str) -> &mut Self {
        self.rows(text.as_bytes())
    }

    /// Adds an array.
    pub fn rows<T: Pod>(&mut self, rows: &[T]) -> &mut Self {
        self.number(rows.len() as u64).0.update(bytemuck::cast_slice(rows));
        self
    }

    /// Adds the triangles of a mesh, which shadows and areas follow from.
    pub fn surface(&mut self, mesh: &Mesh) -> &mut Self {
        self.rows(&mesh.origin_mm.to_array()).rows(&mesh.local_mm).rows(&mesh.triangles)
    }

    /// Adds samples.
    pub fn samples(&mut self, samples: &Samples) -> &mut Self {
        let facets: Vec<[u32; 2]> = samples.facets.iter().map(|facet| [facet.triangle, facet.path]).collect();
        self.rows(&facets).rows(&samples.patch_offsets).rows(&samples.part_offsets)
    }

    /// Adds a light, the pixels of an environment among it.
    pub fn light(&mut self, light: &Light) -> &mut Self {
        match light {
            Light::Environment { map, rotate_degrees, scale } => {
                self.text("environment").number(map.width() as u64).number(map.height() as u64).rows(map.pixels());
                self.rows(&[*rotate_degrees]).rows(&scale.to_array())
            }
            // Numbers are written so that they read back to the same bits.
            other => self.text(&format!("{other:?}")),
        }
    }
}

impl StageCache {
    /// A cache that keeps results in a place.
    pub fn new(keep: Arc<dyn Keep>) -> Self {
        Self { keep: Some(keep), division: None }
    }

    /// The same for a bake that several processes share.
    #[must_use]
    pub fn divided(self, division: Arc<dyn Division>) -> Self {
        Self { division: Some(division), ..self }
    }

    pub(super) fn division(&self) -> Option<&dyn Division> {
        self.division.as_deref()
    }

    /// The result of a stage as sections: the kept one, if `suits` finds nothing wrong with it, otherwise the one that `make` makes, which
    /// is kept then. `input` tells everything that `make` depends on.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn sections(
        &self,
        stage: &'static str,
        input: impl FnOnce(&mut Key),
        suits: impl FnOnce(&[RawSection]) -> bool,
        make: impl FnOnce() -> Result<Vec<RawSection>>,
    ) -> Result<Vec<RawSection>> {
        // Whoever finds a result here does without the blocks that it is made of, and the others do not.
        let Some(keep) = self.keep.as_ref().filter(|_| self.division.is_none()) else { return make() };
        let mut key = Key::new(stage);
        input(&mut key);
        let name = key.name();
        let kept = keep.get(stage, &name).and_then(|bytes| decode(&bytes));
        if let Some(sections) = kept.filter(|sections| suits(sections)) {
            return Ok(sections);
        }
        let made = make()?;
        keep.put(stage, &name, &encode(&made));
        Ok(made)
    }
}

/// Bytes of a section before its own: tag, kind, element, codec, 0, components, 0, length.
const HEAD: usize = 24;

fn encode(sections: &[RawSection]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(sections.iter().map(|section| HEAD + section.bytes.len()).sum());
    for RawSection { tag, kind, element, components, codec, bytes: own } in sections {
        bytes.extend(tag.to_bytes());
        bytes.extend([kind.code(), element.code(), codec.code(), 0]);
        bytes.extend(components.to_le_bytes());
        bytes.extend([0; 2]);
        bytes.extend((own.len() as u64).to_le_bytes());
        bytes.extend(own);
    }
    bytes
}

/// The sections of [`encode`]; none where the bytes are others.
fn decode(mut bytes: &[u8]) -> Option<Vec<RawSection>> {
    let mut sections = Vec::new();
    while !bytes.is_empty() {
        let (head, rest) = bytes.split_first_chunk::<HEAD>()?;
        let [tag @ .., _, _, _, _, _, _, _, _, _, _, _, _, _, _, _, _] = *head;
        let [_, _, _, _, _, _, _, _, kind, element, codec, _, low, high, ..] = *head;
        let [.., a, b, c, d, e, f, g, h] = *head;
        let length = usize::try_from(u64::from_le_bytes([a, b, c, d, e, f, g, h])).ok()?;
        let (own, rest) = rest.split_at_checked(length)?;
        sections.push(RawSection {
            tag: Tag::from_bytes(tag)?,
            kind: Kind::from_code(kind)?,
            element: ElementType::from_code(element)?,
            components: u16::from_le_bytes([low, high]),
            codec: Codec::from_code(codec)?,
            bytes: own.to_vec(),
        });
        bytes = rest;
    }
    Some(sections)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::collections::HashMap;
    use std::sync::Mutex;

    use super::*;
    use crate::error::Error;

    #[derive(Default)]
    struct Memory(Mutex<HashMap<[u8; 32], Vec<u8>>>);

    impl Keep for Memory {
        fn get(&self, _: &'static str, name: &[u8; 32]) -> Option<Vec<u8>> {
            self.0.lock().unwrap().get(name).cloned()
        }

        fn put(&self, _: &'static str, name: &[u8; 32], bytes: &[u8]) {
            self.0.lock().unwrap().insert(*name, bytes.to_vec());
        }
    }

    fn sections(value: f64) -> Vec<RawSection> {
        let tag = |text| Tag::new(text).unwrap();
        vec![
            RawSection::from_rows(tag("a"), Kind::Method, Codec::Raw, &[[value, 1.0, -0.0]]),
            RawSection::from_rows(tag("long.tag"), Kind::Environment, Codec::Zstd, &[1u16, 2]),
            RawSection::from_rows::<u8>(tag("none"), Kind::Mesh, Codec::Raw, &[]),
        ]
    }

    #[test]
    fn what_is_kept_is_made_once_for_each_input_and_stage() {
        let memory = Arc::new(Memory::default());
        let cache = StageCache::new(memory.clone());
        let failing = || Err(Error::runtime("made again"));
        let get = |stage, input: f64, make: &dyn Fn() -> Result<Vec<RawSection>>| {
            cache.sections(
                stage,
                |key| {
                    key.rows(&[input]);
                },
                |_| true,
                make,
            )
        };
        assert_eq!(get("a", 1.0, &|| Ok(sections(1.0))).unwrap(), sections(1.0));
        assert_eq!(get("a", 1.0, &failing).unwrap(), sections(1.0));
        assert!(
            get("b", 1.0, &failing).is_err() && get("a", -1.0, &failing).is_err() && get("a", 0.5, &failing).is_err()
        );
        // Neither what does not suit nor what does not decode is taken.
        assert!(
            cache
                .sections(
                    "a",
                    |key| {
                        key.rows(&[1.0]);
                    },
                    |_| false,
                    failing
                )
                .is_err()
        );
        for bytes in memory.0.lock().unwrap().values_mut() {
            bytes.pop();
        }
        assert_eq!(get("a", 1.0, &|| Ok(sections(2.0))).unwrap(), sections(2.0));
        assert!(StageCache::default().sections("a", |_| (), |_| true, failing).is_err());
        assert_eq!(cache, StageCache::default());
    }

    #[test]
    fn bytes_that_are_cut_or_changed_are_no_sections() {
        let bytes = encode(&sections(3.0));
        assert_eq!(decode(&bytes), Some(sections(3.0)));
        for length in 1..bytes.len() {
            assert!(decode(&bytes[..length]).is_none_or(|cut| cut.len() < 3), "{length}");
        }
        assert_eq!(decode(&[0xff; 40]), None);
    }

    #[test]
    fn inputs_that_lie_otherwise_in_their_arrays_are_others() {
        let name = |tell: &dyn Fn(&mut Key)| {
            let mut key = Key::new("stage");
            tell(&mut key);
            key.0.finalize()
        };
        let of = [
            name(&|key| {
                key.rows(&[1u32, 2]).rows(&[3u32]);
            }),
            name(&|key| {
                key.rows(&[1u32]).rows(&[2u32, 3]);
            }),
            name(&|key| {
                key.rows(&[1u32, 2, 3]);
            }),
            name(&|key| {
                key.text("ab").text("c");
            }),
            name(&|key| {
                key.text("a").text("bc");
            }),
        ];
        assert!((0..of.len()).all(|i| (0..i).all(|j| of[i] != of[j])));
    }
}
