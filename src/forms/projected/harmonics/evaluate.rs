//! Transport as coefficients at reference points over a basis of spherical harmonics: a light becomes its projection on the
//! harmonics, that a vector over the columns, and radiosity at a reference point is a dot product.

use glam::DVec3;
use translux_format::distant_transport::Harmonics as File;
use translux_format::quantised_lights::tags;

use crate::compress::prediction::Net;
use crate::error::Result;
use crate::forms::distant::far_away;
use crate::forms::projected::components::{
    Coded, Components, LightBasis, LightFunctions, Lit, Rows, Transport, Weighted,
};
use crate::light::Light;
use crate::light::harmonics::coefficients;
use crate::scene::Scene;
use crate::transport::receivers::Receivers;

/// Spherical harmonics up to an order.
pub(crate) struct HarmonicBasis {
    order: usize,
}

/// The transport of a file with a number of shells, ready to be lit.
pub(crate) fn components(
    file: &File,
    (tags, shells): (tags::Set, usize),
    scene: &Scene,
    receivers: &Receivers,
) -> Result<Components<HarmonicBasis>> {
    let order = file.order as usize;
    let net = Net::unpredicted(order * order);
    let coded = [Coded { set: &file.set, tags, shells: 0..shells, net: &net, rows: Rows::Harmonics }];
    let transport = Transport::new(&coded, (scene, receivers), file.spacing_mm, |basis, functions| {
        LightFunctions::stored(&basis, functions)
    })?;
    Ok(Components { basis: HarmonicBasis { order }, transport })
}

impl HarmonicBasis {
    /// Coefficients of all lights together, RGB for each harmonic.
    pub(crate) fn projected(&self, lights: &[Light]) -> Result<Vec<[f64; 3]>> {
        let mut sums = vec![DVec3::ZERO; self.order * self.order];
        for light in lights {
            far_away(light)?;
            let own = coefficients(light, self.order)?;
            sums.iter_mut().zip(own).for_each(|(sum, c)| *sum += c);
        }
        Ok(sums.iter().map(DVec3::to_array).collect())
    }
}

impl LightBasis for HarmonicBasis {
    const STAGE: &'static str = "transport in harmonics";

    fn lit(&self, transport: &Transport, lights: &[Light]) -> Result<Lit> {
        transport.lit(vec![Weighted { shells: vec![self.projected(lights)?], factors: Vec::new() }])
    }
}
