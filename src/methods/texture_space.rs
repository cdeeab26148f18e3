//! `texture_space`: irradiance in the texels of an atlas, summed from few samples of them (Chang et al. 2008).

use super::keys;
use crate::error::Result;
use crate::evaluate::keys::{Auto, Key, Keys, Number, OneOf, PowerOfTwo};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::texture_space::{Far, Local, Sampling, TextureSpace as Form};
use crate::geometry::atlas::Map;
use crate::transport::near_rule::NearField;

/// The method.
pub struct TextureSpace;

/// Of the texels: fine enough for shadow boundaries inside the kernel.
const DENSITY: Density = Density { spacing: 0.5, least: 1 << 15, most: 1 << 17 };

/// How samples are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Choice {
    Product,
    Clusters,
    Shared,
    Hybrid,
}

const SAMPLING: Key<OneOf<Choice>> = Key::new(
    "sampling",
    "product",
    OneOf(&[
        ("product", Choice::Product),
        ("clusters", Choice::Clusters),
        ("shared", Choice::Shared),
        ("hybrid", Choice::Hybrid),
    ]),
    "how samples are chosen: product (for each place, by irradiance and R_d), clusters (shared by all places, by irradiance), shared \
     (the paper's draws by irradiance) or hybrid (the paper's, with nearby light from an image that the light sees)",
);

const RESOLUTION: Key<Auto<PowerOfTwo>> = Key::new(
    "resolution",
    "auto",
    Auto(PowerOfTwo(16, 4096)),
    "texels along each edge of the texture; auto: half of the shortest mean free path, 256 to 2048",
);

const MAP: Key<OneOf<Map>> = Key::new(
    "map",
    "auto",
    OneOf(&[
        ("auto", Map::Auto),
        ("own", Map::Own),
        ("shape", Map::Shape),
        ("conformal", Map::Conformal),
        ("area", Map::Area),
    ]),
    "map to the texture: own (the model's texture coordinates), shape (as rigid as possible), conformal, area (area-preserving, the \
     paper's) or auto (own where nothing overlaps, else shape)",
);

const IMPORTANCE: Key<Number<f64>> = Key::new(
    "importance",
    "0.1",
    Number(1e-9, 1e3),
    "lower bound c of 2 pi r R_d, 1/mm, that parts near and far light of the hybrid method",
)
.expert();

const SHARPNESS: Key<Number<f64>> =
    Key::new("sharpness", "1.5", Number(1e-3, 1e3), "sharpness K of that division, 1/mm").expert();

const RINGS: Key<Number<u32>> = Key::new("rings", "20", Number(1, 1000), "circles L of samples nearby").expert();

const OF_RING: Key<Number<u32>> =
    Key::new("of-ring", "20", Number(1, 1000), "samples C on each of these circles").expert();

const IMAGE: Key<PowerOfTwo> =
    Key::new("image", "1024", PowerOfTwo(16, 4096), "pixels along each edge of the image that the light sees").expert();

const FAR: Key<OneOf<Far>> = Key::new(
    "far",
    "clusters",
    OneOf(&[("clusters", Far::Clusters), ("drawn", Far::Drawn)]),
    "shared samples of the far part: clusters (that hold all of the light) or drawn (the paper's)",
)
.expert();

const DIRECTIONS: Key<Auto<Number<u32>>> = Key::new(
    "directions",
    "auto",
    Auto(Number(1, 65536)),
    "shadow rays of each piece of a texel towards an environment; a constant light takes a quarter of them; auto: 64, down to 8 where there are many",
)
.expert();
const AREA_SIDE: Key<Number<u32>> = keys::area_side("4");

impl Method for TextureSpace {
    fn about(&self) -> About {
        About {
            name: "texture_space",
            summary: "an atlas only; light in its texels, few samples of them for each place (Chang et al. 2008)",
            choose_when: "Light, material and size all change at run time, nothing may be precomputed but a texture \
                atlas, and a tenth of a second for each change is fast enough.",
            keys: &[
                &SAMPLING,
                &RESOLUTION,
                &MAP,
                &IMPORTANCE,
                &SHARPNESS,
                &RINGS,
                &OF_RING,
                &IMAGE,
                &FAR,
                &DIRECTIONS,
                &AREA_SIDE,
            ],
            default_max_rms: 0.01,
            declared_error: None,
            ladder: &[
                "",
                "--samples 100",
                "--samples 400",
                "--samples 1600",
                "--set sampling=clusters --samples 1600",
                "--set sampling=shared --samples 1600",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[]]
    }

    fn form(&self, keys: &Keys, settings: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let sampling = match keys.get(&SAMPLING)? {
            Choice::Product => Sampling::Product,
            Choice::Clusters => Sampling::Clusters,
            Choice::Shared => Sampling::Shared,
            Choice::Hybrid => Sampling::Hybrid(Local {
                importance: keys.get(&IMPORTANCE)?,
                sharpness: keys.get(&SHARPNESS)?,
                rings: keys.get(&RINGS)?,
                of_ring: keys.get(&OF_RING)?,
                image: keys.get(&IMAGE)?,
                far: keys.get(&FAR)?,
            }),
        };
        Ok(Box::new(Form {
            density: DENSITY,
            map: keys.get(&MAP)?,
            resolution: keys.get(&RESOLUTION)?,
            sampling,
            count: settings.samples.map(|count| count.clamp(1, u32::MAX as usize) as u32),
            directions: keys.get(&DIRECTIONS)?,
            area_side: keys.get(&AREA_SIDE)?,
            near: NearField::for_error(settings.max_rms),
        }))
    }
}
