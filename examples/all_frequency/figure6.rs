//! The paper's Figure 6: phase functions of few terms, by themselves and in pictures.

use glam::DVec3;
use rayon::prelude::*;
use translux::error::Result;
use translux::geometry::bvh::Bvh;
use translux::light::cube_light::CubeLight;
use translux::light::quantised::directions::lattice;
use translux::math::cube_map::{FACES, direction, solid_angles_sr};
use translux::measure::chart::draw::{Front, Point, Scatter, Unit, as_svg};
use translux::medium::material::OpticalProperties;
use translux::medium::phase::{HenyeyGreenstein, LegendrePhase, LightTerms, MOST_TERMS};
use translux::render::single::Single;
use translux::scene::Scene;
use translux::transport::single_scattering::radiance::{Path, Settings};
use translux::transport::single_scattering::vectors::{Sharing, VectorBaker, VectorSettings};
use translux::transport::single_scattering::{Coefficients, ExitPoint, vertex_points};

use crate::bench::percent;
use crate::common::bench::{Context, table};
use crate::common::runner::summary;
use crate::common::sheet;
use crate::separable::SeparablePhase;
use crate::single::{Picture, Rays, SIDE, SYNTHETIC, Stand, Terms, View, sums, sun_and_sky};

/// Mean cosines.
const MEAN_COSINES: [f64; 5] = [0.25, -0.25, -0.4, 0.7, 0.9];

/// Terms of the pictures; all but 8 are whole bands, where both forms are the same.
const TERMS: [usize; 5] = [1, 4, 8, 9, 16];

/// The number that splits a band.
const SPLIT: usize = 8;

/// Terms of the chart.
const CHARTED: [usize; 7] = [1, 4, 8, 9, 16, 25, 36];

/// Most terms of the decomposition.
const MOST_SEPARABLE: usize = 25;

/// Faces of the quadrature over directions, and directions of the eye.
const FINE: usize = 64;
const EYES: usize = 24;

/// Side of a picture.
const PIXELS: usize = 150;
const FEW_PIXELS: usize = 80;

/// Directions towards an environment.
const DIRECTIONS: u32 = 512;
const FEW_DIRECTIONS: u32 = 256;

/// More depths and rays than the method's defaults, so that the phase function is what is left.
const SHARING: Sharing = Sharing::Adaptive { depths: 6, tolerance: 0.1 };

/// A sun at the centre of a texel: face, column, row.
const SUN: [usize; 3] = [0, 20, 9];

/// A phase function of few terms.
pub(crate) enum Few {
    Legendre(LegendrePhase),
    Separable(SeparablePhase),
}

impl Few {
    pub(crate) fn legendre(g: f64, terms: usize) -> Self {
        Self::Legendre(LegendrePhase::henyey_greenstein(g, terms))
    }

    fn separable(g: f64, terms: usize) -> Result<Self> {
        Ok(Self::Separable(SeparablePhase::new(HenyeyGreenstein::new(g), terms)?))
    }

    fn terms(&self) -> usize {
        match self {
            Self::Legendre(phase) => phase.terms(),
            Self::Separable(phase) => phase.light.terms(),
        }
    }

    fn light(&self, towards_light: DVec3, out: &mut [f64]) {
        match self {
            Self::Legendre(phase) => LegendrePhase::light(phase.terms(), towards_light, out),
            Self::Separable(phase) => phase.light.evaluate(towards_light, out),
        }
    }

    fn view(&self) -> View<'_> {
        match self {
            Self::Legendre(phase) => View::Legendre(phase),
            Self::Separable(phase) => View::Separable(&phase.view),
        }
    }

    fn view_terms(&self, towards_eye: DVec3, out: &mut [f64]) {
        match self {
            Self::Legendre(phase) => phase.view(towards_eye, out),
            Self::Separable(phase) => phase.view.evaluate(towards_eye, out),
        }
    }
}

/// A phase function of few terms against the exact one, over all pairs of directions.
#[derive(Clone, Copy)]
pub(crate) struct Figures {
    /// RMS of the difference over that of the exact function.
    pub(crate) rms: f64,
    /// The least value over the peak of the exact function.
    pub(crate) least: f64,
    /// Integrals over the directions of the light, least and largest over the eyes.
    energy: [f64; 2],
}

pub(crate) fn figures(g: f64, phase: &Few) -> Figures {
    let (exact, terms) = (HenyeyGreenstein::new(g), phase.terms());
    let angles = solid_angles_sr(FINE);
    let eyes: Vec<(DVec3, Vec<f64>)> = lattice(EYES, 0.5)
        .into_iter()
        .map(|eye| {
            let mut view = vec![0.0; terms];
            phase.view_terms(eye, &mut view);
            (eye, view)
        })
        .collect();
    // One task for each row of texels, so that sums do not depend on the number of threads.
    let of_row = |row: usize| {
        let (mut error, mut norm, mut least) = (0.0, 0.0, f64::INFINITY);
        let mut energy = [0.0; EYES];
        let mut light = vec![0.0; terms];
        for x in 0..FINE {
            let towards = direction(FINE, row / FINE, x, row % FINE);
            let angle = angles[row % FINE * FINE + x];
            phase.light(towards, &mut light);
            for ((eye, view), energy) in eyes.iter().zip(&mut energy) {
                let p: f64 = light.iter().zip(view).map(|(a, b)| a * b).sum();
                let true_p = exact.density(-towards.dot(*eye));
                error += angle * (p - true_p) * (p - true_p);
                norm += angle * true_p * true_p;
                least = least.min(p);
                *energy += angle * p;
            }
        }
        (error, norm, least, energy)
    };
    let rows: Vec<_> = (0..FACES * FINE).into_par_iter().map(of_row).collect();
    let (mut error, mut norm, mut least, mut energy) = (0.0, 0.0, f64::INFINITY, [0.0; EYES]);
    for (e, n, l, own) in rows {
        error += e;
        norm += n;
        least = least.min(l);
        energy.iter_mut().zip(own).for_each(|(sum, v)| *sum += v);
    }
    let range = energy.iter().fold([f64::INFINITY, 0.0], |[low, high], v| [low.min(*v), f64::max(high, *v)]);
    Figures { rms: (error / norm).sqrt(), least: least / exact.density(g.signum()), energy: range }
}

/// The figure: a chart, a table of the functions, pictures and a table of them.
pub(crate) fn run(context: &Context) -> Result<String> {
    let (chart, functions) = functions(context)?;
    let (shown, pictures, line) = pictures(context)?;
    Ok(format!("{line}{chart}@phase-functions@\n\n{functions}\n{shown}@phase-pictures@\n\n{pictures}"))
}

fn functions(context: &Context) -> Result<(String, String)> {
    let mut scatter = Scatter {
        title: "RMS of phase functions of few terms (Legendre)".to_owned(),
        axes: ["terms".to_owned(), "RMS over that of the function".to_owned()],
        units: [Unit::Number, Unit::Percent],
        points: Vec::new(),
        lines: Vec::new(),
        front: Front::Left,
    };
    let (mut rows, mut seen) = (Vec::new(), Vec::new());
    for g in context.some(&MEAN_COSINES, 2) {
        for terms in CHARTED {
            if terms != SPLIT {
                let found = figures(g, &Few::legendre(g, terms));
                // The mirror image of a function errs as much.
                if !seen.contains(&g.abs()) {
                    let series = format!("g = {} or its negative", g.abs());
                    scatter.points.push(Point { series, x: terms as f64, y: found.rms });
                }
                rows.push(row(g, terms, "Legendre", found));
            }
            if terms <= MOST_SEPARABLE && (terms == SPLIT || !context.quick) {
                rows.push(row(g, terms, "SVD", figures(g, &Few::separable(g, terms)?)));
            }
        }
        seen.push(g.abs());
        context.say(&format!("figure 6: functions of g = {g}"));
    }
    let file = "all_frequency_figure6.svg";
    translux::io::atomic::write(&context.pictures.join(file), as_svg(&scatter)?.as_bytes())?;
    let head = ["g", "K", "form", "RMS", "least value, of the peak", "energy: least, largest"];
    Ok((format!("![{}](pictures/{file})\n\n", scatter.title), table(&head, &rows)))
}

fn row(g: f64, terms: usize, form: &str, found: Figures) -> Vec<String> {
    let [low, high] = found.energy;
    // No minus zero.
    let least = if found.least.abs() < 5e-5 { 0.0 } else { found.least };
    vec![
        g.to_string(),
        terms.to_string(),
        form.to_owned(),
        percent(found.rms),
        percent(least),
        format!("{low:.4}, {high:.4}"),
    ]
}

/// A body of the paper's synthetic material, unreduced, with some g.
fn body(context: &Context, g: f64) -> Result<Scene> {
    let mut scene = context.scene(context.model(), "skin1")?;
    let [sigma_s_per_mm, sigma_a_per_mm] = SYNTHETIC;
    let properties = OpticalProperties {
        sigma_s_reduced_per_mm: (1.0 - g) * sigma_s_per_mm,
        sigma_a_per_mm,
        g,
        eta_inside_over_outside: 1.3,
    };
    scene.media.iter_mut().for_each(|m| m.properties = properties);
    Ok(scene)
}

fn settings(phase: LightTerms) -> VectorSettings {
    VectorSettings { coefficients: Coefficients::Unreduced, phase, sharing: SHARING, ..VectorSettings::DEFAULT }
}

/// Pictures, their table, and the line of the first table.
fn pictures(context: &Context) -> Result<(String, String, String)> {
    let side = if context.quick { FEW_PIXELS } else { PIXELS };
    let directions = if context.quick { FEW_DIRECTIONS } else { DIRECTIONS };
    let lights = sun_and_sky(context, SUN)?;
    let cubes: Vec<CubeLight> = lights.iter().map(|(_, light)| CubeLight::new(light, SIDE)).collect::<Result<_>>()?;
    let first = body(context, 0.0)?;
    let (bvh, stand) = (Bvh::new(&first.mesh), Stand::new(&first, side)?);
    let seen = stand.seen()?;
    let mut points = vertex_points(first.domain());
    points.iter_mut().zip(&seen).filter(|(_, seen)| !**seen).for_each(|(p, _)| *p = ExitPoint::default());
    // Light sides of harmonics are the same for every g.
    let most = TERMS.into_iter().max().unwrap_or(1).min(MOST_TERMS);
    let harmonics =
        sums(&VectorBaker::new(first.domain(), &bvh, settings(LightTerms::Harmonics(most)))?, &points, &cubes);
    context.say("figure 6: vectors");
    let (mut sheets, mut rows, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    for g in context.some(&MEAN_COSINES, 2) {
        let scene = body(context, g)?;
        let separable = Few::separable(g, SPLIT)?;
        let Few::Separable(phase) = &separable else { continue };
        let split = sums(
            &VectorBaker::new(scene.domain(), &bvh, settings(LightTerms::Maps(phase.light.clone())))?,
            &points,
            &cubes,
        );
        for (index, (name, light)) in lights.iter().enumerate() {
            let rays = Settings { coefficients: Coefficients::Unreduced, directions, ..Settings::REFERENCE };
            let by = |path, key| stand.traced((&scene, &bvh), light, Rays { settings: rays, path, key });
            let exact = by(Path::InverseNormal, 0)?;
            let mut cells = vec![g.to_string(), (*name).to_owned()];
            let mut shown: Vec<Picture> = Vec::new();
            for terms in TERMS {
                let few = if terms == SPLIT { Few::separable(g, SPLIT)? } else { Few::legendre(g, terms) };
                let (sums, stride) = if terms == SPLIT { (&split[index], SPLIT) } else { (&harmonics[index], most) };
                let eta = scene.media.first().map_or(1.0, |m| m.properties.eta_inside_over_outside);
                let triangles = &scene.mesh.triangles;
                let of_terms = Terms { triangles, sums, stride, view: few.view(), eta };
                let picture = stand.picture(Single::TowardsEye(&of_terms))?;
                let rms = picture.error(&exact).rms;
                cells.push(format!("{:.1}", 1e3 * rms));
                errors.push((g, terms, rms));
                shown.push(picture);
            }
            let refracted = by(Path::Refracted, 0)?;
            cells.push(format!("{:.1}", 1e3 * exact.error(&refracted).rms));
            rows.push(cells);
            if index == 0 {
                let white = exact.exposure();
                sheets.push(shown.iter().chain([&exact]).map(|p| p.shown(white)).collect());
            }
        }
        context.say(&format!("figure 6: pictures of g = {g}"));
    }
    let file = "all_frequency_figure6.png";
    translux::io::atomic::write(&context.pictures.join(file), &sheet::png(stand.side, &sheets)?)?;
    let head = ["g", "light", "K = 1", "4", "8 (SVD)", "9", "16", "the inverse normal itself, to the refracted path"];
    let of = |g: f64| {
        let four = errors.iter().filter(|e| e.0.abs() == g && e.1 == 4).map(|e| e.2);
        four.fold(None, |worst: Option<f64>, e| Some(worst.map_or(e, |w| w.max(e))))
    };
    let four = [0.25, 0.4, 0.7, 0.9].map(|g| of(g).map_or("?".to_owned(), |e| format!("{:.0}", 1e3 * e)));
    let line = summary(
        "four terms of a phase function, image RMS of single scattering, 1e-3, for g of +- 0.25, 0.4, 0.7, 0.9",
        "used for all figures",
        "measured",
        &four.join(", "),
    );
    Ok((
        "![Single scattering by phase functions of few terms](pictures/all_frequency_figure6.jpg)\n\n".to_owned(),
        table(&head, &rows),
        line,
    ))
}
