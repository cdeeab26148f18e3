//! Cube maps: faces, texels, directions and solid angles, as `formats/SPEC.md` lays them out.
