//! Area lights through source radiance fields: the product of every sample's irradiance row with what the light sends there.
//!
//! Rows hold the visibility of directions, as far as there is anything: what stands behind a light shadows it as if it stood before it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use glam::DVec3;

use crate::compress::rows::{Rows, WholeRows};
use crate::error::{Error, Result};
use crate::geometry::samples::Samples;
use crate::light::Light;
use crate::light::rectangle_map::UnitRectangle;
use crate::light::source_field::SourceField;
use crate::medium::entrance_basis::MOST_TERMS;
use crate::parallel::*;
use crate::transport::domain::Domain;
use crate::transport::visibility::Observer;

/// Fields that are kept: a new one takes the place of the oldest.
const MOST_FIELDS: usize = 8;

/// Irradiance at most: its sums over a surface stay finite.
const MOST: f64 = 1e280;

/// Source of the radiance that reaches a sample from the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lookup {
    /// Interpolated in the field.
    Field,
    /// By a map of its own.
    OwnMap,
}

/// Cache of the fields made. Each depends on its light only, so which ones are kept affects time alone.
#[derive(Default)]
pub(super) struct Fields {
    made: Mutex<Vec<Arc<SourceField>>>,
}

impl Fields {
    /// Source radiance field of a light, and half the diagonal of the light in mm.
    pub(super) fn of(&self, light: &Light, side: usize) -> Result<(Arc<SourceField>, f64)> {
        let Light::Area { field: Some(points), .. } = light else {
            return Err(Error::unsupported(format!("light `{light}` asks for no source radiance field")));
        };
        let (rectangle, half_diagonal_mm) = UnitRectangle::of(light)?;
        let found = self.made().iter().find(|field| field.is_of(&rectangle, side, *points)).map(Arc::clone);
        if let Some(field) = found {
            return Ok((field, half_diagonal_mm));
        }
        // Not under the lock: a thread that waits for others may take up work that asks for a field.
        let field = Arc::new(SourceField::new(rectangle, side, *points)?);
        let mut made = self.made();
        if made.len() >= MOST_FIELDS {
            made.remove(0);
        }
        made.push(Arc::clone(&field));
        Ok((field, half_diagonal_mm))
    }

    fn made(&self) -> MutexGuard<'_, Vec<Arc<SourceField>>> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes of all fields in memory.
    pub(super) fn bytes(&self) -> usize {
        self.made().iter().map(|field| field.bytes()).sum()
    }

    /// Adds the irradiance of every sample, RGB.
    pub(super) fn add(
        &self,
        light: &Light,
        (rows, entrance_of_patch): (&Rows, impl Fn(usize) -> [f64; MOST_TERMS] + Sync),
        (domain, samples): (Domain, &Samples),
        lookup: Lookup,
        irradiance: &mut [DVec3],
    ) -> Result<()> {
        let side = rows.data().side;
        let (field, half_diagonal_mm) = self.of(light, side)?;
        let Light::Area { at_mm, radiance, .. } = light else { return Ok(()) };
        let (rectangle, _) = UnitRectangle::of(light)?;
        let (corners, centre_mm) = (rectangle.corners(), *at_mm - domain.mesh.origin_mm);
        let memory = || (WholeRows::default(), vec![0.0f32; 6 * side * side], field.memory());
        let mut jobs = Vec::with_capacity(rows.runs().len());
        let mut rest = irradiance;
        for run in rows.runs() {
            let (mine, others) = rest.split_at_mut(((run[1] - run[0]) as usize).min(rest.len()));
            jobs.push((*run, mine));
            rest = others;
        }
        jobs.into_par_iter().for_each_init(memory, |(whole, row, memory), (run, out)| {
            let entrance = entrance_of_patch(run[0] as usize);
            if entrance == [0.0; MOST_TERMS] {
                return;
            }
            rows.decode(run, &entrance, whole);
            for (index, e) in out.iter_mut().enumerate() {
                let observer = Observer::of(domain.mesh, samples.patch(run[0] as usize + index));
                let at = (observer.eye.as_dvec3() - centre_mm) / half_diagonal_mm;
                // A truncated row is not quite 0 below its horizon.
                if !corners.iter().any(|corner| (*corner - at).dot(observer.normal) > 0.0) {
                    continue;
                }
                whole.write(index, row);
                let arriving = match lookup {
                    Lookup::Field => field.product(at, row, memory),
                    Lookup::OwnMap => field.exact(at, row, memory),
                };
                *e = (*e + *radiance * arriving).clamp(DVec3::splat(-MOST), DVec3::splat(MOST));
            }
            whole.erase(row);
        });
        Ok(())
    }
}
