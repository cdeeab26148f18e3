//! (temporary) errors of the calibrated kernel against the volumetric truth.
use std::time::Instant;
use glam::DVec3;
use translux::light::Light;
use translux::progress::Silent;
use translux::transport::calibration::{Orders, Walks, surface::CalibratedSurface};
use translux::transport::irradiance::LightSampling;
use translux::transport::random_walk::{model_error::project, tally::Hats};
use translux::{ImportOptions, MaterialChoice, Scale, load};

fn main() {
    let data = std::env::args().nth(1).unwrap();
    let photons: u64 = std::env::args().nth(2).unwrap_or("200000".into()).parse().unwrap();
    for material in ["marble", "skin1"] {
        let options = ImportOptions { scale: Some(Scale::DiagonalMm(30.0)), materials: MaterialChoice::plain(material), ..ImportOptions::default() };
        let scene = load(std::path::Path::new(&format!("{data}/meshes/bunny_3k.obj")), &options).unwrap().scene;
        for orders in [Orders::FromOne, Orders::FromTwo] {
            let t = Instant::now();
            let walks = Walks { photons, orders, ..Walks::default() };
            let body = CalibratedSurface::new(scene.domain(), 65_536, walks, &Silent).unwrap();
            println!("{material} {orders:?}: {:.2} s", t.elapsed().as_secs_f64());
            if orders == Orders::FromOne {
            let p = body.told.parts[0].as_ref().unwrap();
            for c in 0..3 {
                let l = &p.layers[c];
                let rs: Vec<f64> = (0..12).map(|k| 0.2 * 1.5f64.powi(k)).collect();
                println!("  photons {} a {:?}", p.photons[c], rs.iter().map(|&r| (100.0 * l.single(r)).round() / 100.0).collect::<Vec<_>>());
                println!("      slope {:?}", rs.iter().map(|&r| (1000.0 * r * l.slope_per_mm(r)).round() / 1000.0).collect::<Vec<_>>());
            }
            }
            let s: f64 = body.calibrated.scale.iter().map(|s| s.x).sum::<f64>() / body.calibrated.scale.len() as f64;
            println!("  mean scale {s:.3}");
            let hats = Hats::new(&scene.mesh, &scene.parts);
            for (name, light) in [("directional", Light::Directional { from: DVec3::new(0.3, 0.8, 0.5).normalize(), irradiance: DVec3::ONE }), ("constant", Light::Constant { radiance: DVec3::ONE })] {
                let sampling = LightSampling { points_per_patch: 4, directions: 256, area_side: 8 };
                let t = Instant::now();
                let b = body.radiosity(&[light], sampling, &Silent).unwrap();
                let b = hats.to_vertices(&project(&hats, &b).unwrap());
                let mut line = format!("  {name} {:.2} s:", t.elapsed().as_secs_f64());
                for (c, channel) in ["r", "g", "b"].iter().enumerate() {
                    let file = format!("{data}/../truth/volumetric/bunny_3k_30mm_{material}_{channel}_{name}.f32");
                    let bytes = std::fs::read(file).unwrap();
                    let values: Vec<f32> = bytes.chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect();
                    let (mut e, mut t2, mut d, mut m, mut area) = (0.0, 0.0, 0.0, 0.0, 0.0);
                    let (mut all, mut d0) = (0.0, 0.0);
                    for (v, row) in values.chunks(8).enumerate() {
                        let row: Vec<f64> = row.iter().map(|&x| f64::from(x)).collect();
                        let k = if orders == Orders::FromOne { 1.0 } else { 0.0 };
                        let (h1, h2) = (row[4] + k * row[2], row[5] + k * row[3]);
                        let a = row[7];
                        e += a * (b[v][c] - h1) * (b[v][c] - h2);
                        t2 += a * h1 * h2;
                        all += a * (row[4] + row[2]) * (row[5] + row[3]);
                        d += a * (b[v][c] - 0.5 * (h1 + h2));
                        m += a * 0.5 * (h1 + h2);
                        d0 += a;
                    }
                    area += d0;
                    let _ = area;
                    line += &format!(" {channel} {:.1} % (of >=1 {:.1} %, bias {:.3})", 100.0 * (e / t2).max(0.0).sqrt(), 100.0 * (e / all).max(0.0).sqrt(), 1.0 + d / m);
                }
                println!("{line}");
            }
        }
    }
}
