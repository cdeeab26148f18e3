//! `filtered_normals`: normals low-passed over the surface in local lighting, nothing else at run time (Patro 2007). An approximation by
//! design: its error is stated, and nothing makes it small.

use crate::error::{Error, Result};
use crate::evaluate::keys::{Auto, Key, Keys, Number, OneOf};
use crate::evaluate::{About, AnyForm, BakeSettings, Method};
use crate::forms::density::Density;
use crate::forms::filtered_normals::{
    Bleeding, Filter, FilteredNormals as Form, Length, Response, Shadows, Sum, Weights,
};

/// The method.
pub struct FilteredNormals;

/// Of the samples that its error is measured against.
const DENSITY: Density = Density { spacing: 0.35, least: 1 << 15, most: 1 << 16 };

/// A body of a dozen triangles or one that casts shadows on itself may be off by all its light and more: that is worth a warning.
const DECLARED: f64 = 1.0;

/// How the ladder of normals is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Made {
    Heat,
    Spectral,
    Geometric,
}

/// The shape of the response.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Material,
    Gaussian,
    Exponential,
}

const FILTER: Key<OneOf<Made>> = Key::new(
    "filter",
    "heat",
    OneOf(&[("heat", Made::Heat), ("spectral", Made::Spectral), ("geometric", Made::Geometric)]),
    "how normals are filtered: heat (implicit steps on the surface, scales to millions of vertices), spectral (the paper's manifold \
     harmonics) or geometric (the paper's sums over neighbours)",
);

const RESPONSE: Key<OneOf<Shape>> = Key::new(
    "response",
    "material",
    OneOf(&[("material", Shape::Material), ("gaussian", Shape::Gaussian), ("exponential", Shape::Exponential)]),
    "shape of the filter: that of R_d of each channel, a Gaussian on the surface, or an exponential of the distance",
);

const ALPHA: Key<Auto<Number<f64>>> =
    Key::new("alpha", "auto", Auto(Number(0.0, 1.0)), "share of the unfiltered normal; auto: fitted on probe lights");

const WIDTH: Key<Auto<Number<f64>>> = Key::new(
    "width",
    "auto",
    Auto(Number(0.01, 100.0)),
    "factor of the width that the response has; auto: fitted on probe lights",
);

const GAUSSIAN_MM: Key<Number<f64>> =
    Key::new("gaussian-mm", "1", Number(1e-6, 1e6), "standard deviation of the Gaussian on the surface, mm");

const SIGMA_TR: Key<Auto<Number<f64>>> = Key::new(
    "sigma-tr",
    "auto",
    Auto(Number(1e-6, 1e6)),
    "fall of the exponential, 1/mm; auto: sigma_tr of each channel",
);

const LENGTH: Key<OneOf<Length>> = Key::new(
    "length",
    "spread",
    OneOf(&[("spread", Length::Spread), ("kept", Length::Kept), ("unit", Length::Unit)]),
    "length of filtered normals: spread (shorter ones stand for normals that differ, and light falls on all of these), kept (it \
     multiplies the light) or unit (renormalised, the paper's)",
);

const SHADOWS: Key<OneOf<Shadows>> = Key::new(
    "shadows",
    "cast",
    OneOf(&[("cast", Shadows::Cast), ("off", Shadows::Off)]),
    "cast: rays from the vertices, and their openness to the sky; off: none, as in the paper",
);

const BLEEDING: Key<OneOf<Bleeding>> = Key::new(
    "bleeding",
    "off",
    OneOf(&[("off", Bleeding::Off), ("irradiance", Bleeding::Irradiance)]),
    "irradiance: the filter is applied to the shadowed irradiance for each light, so that light bleeds across shadow boundaries",
);

const RUNGS: Key<Number<u32>> =
    Key::new("rungs", "8", Number(2, 16), "widths that filtered normals are stored at; filters are sums over them")
        .expert();

const WAVELENGTH: Key<Number<f64>> = Key::new(
    "wavelength",
    "10",
    Number(2.0, 1e6),
    "shortest wavelength of the harmonics in mean edges; about 2.7 / wavelength^2 of the vertices' number are needed",
)
.expert();

const WEIGHTS: Key<OneOf<Weights>> = Key::new(
    "weights",
    "area",
    OneOf(&[("area", Weights::Area), ("count", Weights::Count)]),
    "weight of a neighbour: the area around it, or 1 (the paper's: dense parts of a mesh weigh more)",
)
.expert();

const SUM: Key<OneOf<Sum>> = Key::new(
    "sum",
    "plain",
    OneOf(&[("plain", Sum::Plain), ("mean", Sum::Mean)]),
    "what stands beside alpha times the normal: the sum over neighbours (the paper's) or their mean",
)
.expert();

const REACH: Key<Number<f64>> = Key::new(
    "reach",
    "4.6",
    Number(0.1, 100.0),
    "distance up to which neighbours count, in 1 / sigma_tr (d of the paper)",
)
.expert();

impl Method for FilteredNormals {
    fn about(&self) -> About {
        About {
            name: "filtered_normals",
            summary: "normals filtered over the surface in local lighting; an approximation (Patro 2007)",
            choose_when: "Nothing may be computed at run time but local lighting, and a look is enough: errors of tens \
                of percent are usual, and stated.",
            keys: &[
                &FILTER,
                &RESPONSE,
                &ALPHA,
                &WIDTH,
                &GAUSSIAN_MM,
                &SIGMA_TR,
                &LENGTH,
                &SHADOWS,
                &BLEEDING,
                &RUNGS,
                &WAVELENGTH,
                &WEIGHTS,
                &SUM,
                &REACH,
            ],
            // Nothing that a bake does brings the error down to what is asked: more than it declares is worth a warning.
            default_max_rms: DECLARED,
            declared_error: Some(DECLARED),
            ladder: &[
                "",
                "--set filter=geometric",
                "--set filter=spectral",
                "--set length=kept",
                "--set length=unit",
                "--set bleeding=irradiance",
            ],
        }
    }

    fn planned(&self) -> &'static [&'static [(&'static str, &'static str)]] {
        &[&[]]
    }

    fn form(&self, keys: &Keys, _: &BakeSettings) -> Result<Box<dyn AnyForm>> {
        let filter = match keys.get(&FILTER)? {
            Made::Heat => Filter::Heat,
            Made::Spectral => Filter::Spectral { wavelength: keys.get(&WAVELENGTH)? },
            Made::Geometric => {
                Filter::Geometric { weights: keys.get(&WEIGHTS)?, sum: keys.get(&SUM)?, reach: keys.get(&REACH)? }
            }
        };
        let response = match keys.get(&RESPONSE)? {
            Shape::Material => Response::Material,
            Shape::Gaussian => Response::Gaussian(keys.get(&GAUSSIAN_MM)?),
            Shape::Exponential => Response::Exponential(keys.get(&SIGMA_TR)?),
        };
        let bleeding = keys.get(&BLEEDING)?;
        if let Filter::Geometric { .. } = filter {
            if let Response::Gaussian(_) = response {
                return Err(Error::command_line(
                    "--set response=gaussian: sums over neighbours fall exponentially; use filter=heat or filter=spectral",
                ));
            }
            if bleeding != Bleeding::Off {
                return Err(Error::command_line(
                    "--set bleeding=irradiance: light is filtered over the surface; use filter=heat or filter=spectral",
                ));
            }
        }
        // With bleeding neither normals nor their length are looked at.
        let (length, shadows) = match bleeding {
            Bleeding::Off => (keys.get(&LENGTH)?, keys.get(&SHADOWS)?),
            Bleeding::Irradiance => (Length::Kept, Shadows::Cast),
        };
        Ok(Box::new(Form {
            density: DENSITY,
            filter,
            response,
            rungs: keys.get(&RUNGS)?,
            alpha: keys.get(&ALPHA)?,
            width: keys.get(&WIDTH)?,
            length,
            shadows,
            bleeding,
        }))
    }
}
