#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;
use crate::math::random;

fn env(path: &str, rotate_degrees: f64, scale: f64) -> LightSpec {
    LightSpec::Environment { source: MapSource::File(path.into()), rotate_degrees, scale: DVec3::splat(scale) }
}

#[test]
fn every_kind_is_read() {
    assert_eq!(parse("constant:radiance=1").unwrap(), LightSpec::Analytic(Light::Constant { radiance: DVec3::ONE }));
    let LightSpec::Analytic(Light::Directional { from, irradiance }) =
        parse("directional:from=0.3,0.8,0.5:irradiance=3,2,1").unwrap()
    else {
        panic!("wrong kind")
    };
    assert!((from - DVec3::new(0.3, 0.8, 0.5).normalize()).length() < 1e-15);
    assert_eq!(irradiance, DVec3::new(3.0, 2.0, 1.0));
    assert_eq!(
        parse(" point:intensity=900:at=0,10, -30 ").unwrap(),
        LightSpec::Analytic(Light::Point { at_mm: DVec3::new(0.0, 10.0, -30.0), intensity: DVec3::splat(900.0) })
    );
    let spot = parse("spot:at=0,40,60:to=0,1,0:angle=30:intensity=3600").unwrap();
    let cone = Cone { to_mm: DVec3::Y, angle_degrees: 30.0, blend: DEFAULT_BLEND };
    let (at_mm, intensity) = (DVec3::new(0.0, 40.0, 60.0), DVec3::splat(3600.0));
    assert_eq!(spot, LightSpec::Analytic(Light::Spot { at_mm, cone, intensity }));
    let LightSpec::Analytic(Light::Area { normal, u, size_mm, .. }) =
        parse("area:at=0,40,0:normal=0,-2,0:size=20,10:radiance=5").unwrap()
    else {
        panic!("wrong kind")
    };
    assert_eq!((normal, size_mm), (DVec3::NEG_Y, [20.0, 10.0]));
    assert_eq!(u, DVec3::X, "Z x -Y");
    let field = parse("area:at=0,40,0:normal=0,-2,0:size=20,10:field=32:radiance=5").unwrap();
    assert!(matches!(&field, LightSpec::Analytic(Light::Area { field: Some(32), .. })));
    assert!(field.to_string().ends_with(":field=32"), "{field}");
    assert_eq!(parse("env:path=sky.hdr:rotate=90:scale=2").unwrap(), env("sky.hdr", 90.0, 2.0));
    assert_eq!(
        parse("sky:rotate=-30").unwrap(),
        LightSpec::Environment { source: MapSource::Sky, rotate_degrees: -30.0, scale: DVec3::ONE }
    );
    assert!(examples().all(|e| parse(e).is_ok()));
}

#[test]
fn the_first_edge_is_perpendicular_to_the_normal() {
    let edge = |text: &str| match parse(text).unwrap() {
        LightSpec::Analytic(Light::Area { normal, u, .. }) => (normal, u),
        other => panic!("{other}"),
    };
    let (_, u) = edge("area:at=0,0,0:normal=0,0,1:size=1,1:radiance=1");
    assert_eq!(u, DVec3::X);
    for text in ["normal=1,2,3", "normal=0.05,0.02,1", "normal=0,1,0:u=1,1,0", "normal=1,1e-3,0:u=1,0,0"] {
        let (n, u) = edge(&format!("area:at=0,0,0:{text}:size=1,1:radiance=1"));
        assert!(n.dot(u).abs() < 1e-15 && (u.length() - 1.0).abs() < 1e-15, "{text}: {u}");
    }
}

#[test]
fn a_colon_splits_only_before_a_known_key() {
    for (text, path) in [
        ("sky.hdr", "sky.hdr"),
        (r"C:\maps\sky.hdr", r"C:\maps\sky.hdr"),
        (r"env:path=C:\maps\sky.hdr", r"C:\maps\sky.hdr"),
        ("env:path=a:b=c.exr", "a:b=c.exr"),
        ("dir/a:b.hdr", "dir/a:b.hdr"),
        ("env:path=env:sky", "env:sky"),
        ("12:30.hdr", "12:30.hdr"),
        ("env:path=sky", "sky"),
        ("lights/constant:radiance=1.hdr", "lights/constant:radiance=1.hdr"),
        ("name with spaces.hdr", "name with spaces.hdr"),
    ] {
        assert_eq!(parse(text).unwrap(), env(path, 0.0, 1.0), "{text}");
    }
    assert_eq!(parse(r"C:\a.hdr:rotate=90").unwrap(), env(r"C:\a.hdr", 90.0, 1.0));
    assert_eq!(parse("studio:scale=2:rotate=90").unwrap(), env("studio", 90.0, 2.0));
    assert_eq!(parse("env:scale=2:path=a:b.hdr").unwrap(), env("a:b.hdr", 0.0, 2.0));
}

#[test]
fn errors_say_what_is_wrong_and_what_to_type() {
    for (text, part) in [
        ("", "empty"),
        ("constant", "`radiance` is missing"),
        ("constant:1", "`1` is not one of its keys"),
        ("constant:radianc=1", "`radianc` is not one of its keys"),
        ("constant:radiance=", "not a number"),
        ("constant:radiance=one", "not a number"),
        ("constant:radiance=1,2", "one number or R,G,B"),
        ("constant:radiance=-1", "must not be negative"),
        ("constant:radiance=1,NaN,1", "finite"),
        ("constant:radiance=inf", "finite"),
        ("constant:radiance=1e999", "finite"),
        ("constant:radiance=1:radiance=2", "given twice"),
        ("constant:radiance=1:intensity=2", "`intensity` is not one of its keys"),
        ("directional:from=0,0,0:irradiance=3", "zero vector"),
        ("directional:from=0,1:irradiance=3", "takes X,Y,Z"),
        ("directional:from=0,1,0", "`irradiance` is missing"),
        ("point:at=0,0,nan:intensity=1", "finite"),
        ("point:at=0,0,0:intensity=-5", "must not be negative"),
        ("area:at=0,0,0:normal=0,0,0:size=1,1:radiance=1", "zero vector"),
        ("area:at=0,0,0:normal=0,1,0:size=0,1:radiance=1", "positive lengths"),
        ("area:at=0,0,0:normal=0,1,0:size=1,-1:radiance=1", "positive lengths"),
        ("area:at=0,0,0:normal=0,1,0:size=1:radiance=1", "two lengths"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:u=0,-3,0", "parallel"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:u=0,0,0", "zero vector"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:field=3", "4 to 64"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:field=65", "4 to 64"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:field=8.5", "whole number"),
        ("area:at=0,0,0:normal=0,1,0:size=1,1:radiance=1:field=", "whole number"),
        ("point:at=0,0,0:intensity=1:field=8", "`field` is not one of its keys"),
        ("env:sky.hdr", "not one of its keys"),
        ("env:path=", "path is empty"),
        ("env:path=a.hdr:rotate=north", "not a number"),
        ("env:path=a.hdr:scale=-1", "must not be negative"),
        ("env:path=a.hdr:rotate=1,2", "one number"),
        ("a.hdr:path=b.hdr", "given twice"),
        ("spot:at=0,0,0:to=0,0,0:angle=30:intensity=1", "the light's own place"),
        ("spot:at=0,0,0:to=0,0,1:angle=0:intensity=1", "at most 180 degrees"),
        ("spot:at=0,0,0:to=0,0,1:angle=200:intensity=1", "at most 180 degrees"),
        ("spot:at=0,0,0:to=0,0,1:angle=30:blend=1.5:intensity=1", "from 0 (a sharp edge) to 1"),
        ("spot:at=0,0,0:to=0,0,1:intensity=1", "`angle` is missing"),
        ("torch:at=0,0,0", "`torch` is no kind of light"),
        ("constnt:radiance=1", "`constnt` is no kind of light"),
        ("constnt:radiance=1", "a path goes as env:path=constnt:radiance=1"),
        ("environment:path=a.hdr", "type for example env:path=sky.hdr"),
        ("sun:from=0,1,0:irradiance=1", "`sun` is no kind of light"),
        ("dir:from=0,1,0:irradiance=1", "type for example directional:from="),
    ] {
        let error = parse(text).expect_err(text);
        assert_eq!(error.code(), ExitCode::CommandLine, "{text}");
        assert!(error.message().contains(part), "{text}: {error}");
        assert!(error.message().starts_with("light `"), "{error}");
    }
}

#[test]
fn the_canonical_text_reads_back_bit_for_bit() {
    let number = |i: u64, d: u64| {
        let scale = [1.0, 1e-9, 1e12, 1e150][(random::bits(3, i, d) % 4) as usize];
        (random::uniform(2, i, d) - 0.5) * scale
    };
    let triple = |i: u64, d: u64| format!("{},{},{}", number(i, d), number(i, d + 1), number(i, d + 2));
    let positive = |i: u64, d: u64| format!("{},{}", number(i, d).abs(), number(i, d + 1).abs());
    let mut read = 0;
    for i in 0..3000 {
        let texts = [
            format!("constant:radiance={}", number(i, 0).abs()),
            format!("directional:from={}:irradiance={},1", triple(i, 0), positive(i, 4)),
            format!("point:at={}:intensity={},0", triple(i, 0), positive(i, 4)),
            format!(
                "spot:at={}:to={}:angle={}:intensity={},2",
                triple(i, 0),
                triple(i, 3),
                0.01 + number(i, 6).abs() % 179.0,
                positive(i, 7)
            ),
            format!("area:at={}:normal={}:size={}:radiance=1", triple(i, 0), triple(i, 3), positive(i, 6)),
            format!("area:at=0,0,0:normal={}:u={}:size=1,2:radiance=1", triple(i, 3), triple(i, 8)),
            format!("area:at=0,0,0:normal={}:size=1,2:radiance=1:field={}", triple(i, 3), 4 + i % 61),
            format!("env:path=a:b {i}.hdr:rotate={}:scale={},0.5", number(i, 9), positive(i, 7)),
            format!("sky:scale={}", number(i, 9).abs()),
        ];
        for text in texts {
            // Random normals and edges can be parallel to 1e-6, which is an error by design.
            let Ok(light) = parse(&text) else { continue };
            assert_eq!(parse(&light.to_string()).unwrap(), light, "{text} -> {light}");
            read += 1;
        }
    }
    assert!(read > 21_000, "{read}");
}

#[test]
fn random_text_never_panics() {
    let words = [
        "constant", "env", "sky", "area", ":", ":", "=", "=", ",", "radiance", "path", "rotate", "1", "-", "NaN", "at",
        "ü", " ", "e9", "size", "0,1,0",
    ];
    for i in 0..20_000 {
        let length = random::bits(8, i, 99) % 12;
        let text: String = (0..length).map(|d| words[(random::bits(8, i, d) % words.len() as u64) as usize]).collect();
        if let Ok(light) = parse(&text) {
            assert_eq!(parse(&light.to_string()).as_ref(), Ok(&light), "{text}");
        }
    }
}

#[test]
fn resolving_loads_files_only() {
    let constant = parse("constant:radiance=2").unwrap();
    assert!(constant.resolve(|_| panic!("no file")).is_ok());
    let sky = parse("sky:rotate=90").unwrap().resolve(|_| panic!("no file")).unwrap();
    assert!(matches!(sky, Light::Environment { rotate_degrees: 90.0, .. }));
    let error = parse("env:path=x.hdr").unwrap().resolve(|p| Err(Error::input(p.display().to_string())));
    assert_eq!(error.unwrap_err().message(), "x.hdr");
}
