#![allow(clippy::unwrap_used)]

use glam::DVec3;

use super::*;
use crate::error::ExitCode;
use crate::io::reader_tests::{check_promises, shared_data};

fn parse(text: &str) -> Result<SourceModel> {
    parse_obj(text.as_bytes(), "model.obj")
}

fn check_guarantees(model: &SourceModel) {
    check_promises(model, 1e-6);
    assert!(model.positions.iter().all(|p| p.is_finite()));
}

fn area(model: &SourceModel) -> f64 {
    let corner = |v: u32| model.positions[v as usize];
    model.triangles.iter().map(|&[a, b, c]| (corner(b) - corner(a)).cross(corner(c) - corner(a)).length() / 2.0).sum()
}

/// The vertices of a file by the shortest code that can read them.
fn naive_vertices(text: &str) -> Vec<DVec3> {
    let lines = text.lines().filter_map(|line| line.trim_start().strip_prefix("v "));
    lines
        .map(|line| {
            let numbers: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap_or(f64::NAN)).collect();
            DVec3::new(numbers[0], numbers[1], numbers[2])
        })
        .collect()
}

/// Compares with the crate `tobj` on the same bytes: where it can read them, positions and attributes of every corner
/// of every face are the same, in the order of the file. Returns whether it can.
fn check_against_second_reader(bytes: &[u8], name: &str) -> bool {
    let options = tobj::LoadOptions { single_index: false, ..tobj::LoadOptions::default() };
    let no_library = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let Ok((models, _)) = tobj::load_obj_buf(&mut &bytes[..], &options, no_library) else { return false };
    let parsed = parse::parse(bytes, name).unwrap();
    let corners =
        models.iter().flat_map(|m| m.mesh.indices.iter().map(|&v| 3 * v as usize).map(|v| &m.mesh.positions[v..v + 3]));
    let own = parsed.corners.iter().map(|c| parsed.positions[c.vertex as usize].to_array());
    assert!(corners.eq(own), "{name}: positions of corners");
    // A corner without a value repeats the one before there.
    if parsed.corners.iter().all(|c| c.uv != NONE) {
        let read = models
            .iter()
            .flat_map(|m| m.mesh.texcoord_indices.iter().map(|&v| &m.mesh.texcoords[2 * v as usize..][..2]));
        let own = parsed.corners.iter().map(|c| parsed.uvs[c.uv as usize].to_array());
        assert!(read.map(|uv| [uv[0] as f32, uv[1] as f32]).eq(own), "{name}: texture coordinates of corners");
    }
    if parsed.corners.iter().all(|c| c.normal != NONE) {
        let read =
            models.iter().flat_map(|m| m.mesh.normal_indices.iter().map(|&v| &m.mesh.normals[3 * v as usize..][..3]));
        for (read, corner) in read.zip(&parsed.corners) {
            let (read, own) = (DVec3::from_slice(read), parsed.normals[corner.normal as usize].as_dvec3());
            let parallel = read.normalize_or_zero().distance(own) < 1e-6;
            assert!(parallel || !read.length_squared().is_normal(), "{name}: normals of corners");
        }
    }
    true
}

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// Four vertices, then a statement that should fail on line 5.
fn error_of(statement: &str) -> String {
    let text = format!("{TRIANGLE}v 1 1 0\n{statement}\nf 1 2 3\n");
    let error = parse(&text).expect_err(statement);
    assert_eq!(error.code(), ExitCode::InvalidInput, "{statement}");
    assert!(error.message().starts_with("model.obj:5: "), "{statement}: {error}");
    error.message().to_owned()
}

#[test]
fn errors_name_the_line_and_the_cause() {
    for (statement, part) in [
        ("f 1 2 7", "face refers to vertex 7, but only 4 are defined"),
        ("f 1/1 2/1 3/1", "face refers to texture coordinate 1, but only 0 are defined"),
        ("f 1//1 2//1 3//2", "face refers to normal 1, but only 0 are defined"),
        ("f 1 2 0", "face refers to vertex 0, but indices count from 1"),
        ("f 1/0 2/0 3/0", "texture coordinate 0"),
        ("f -1 -2 -5", "face refers to vertex -5, but only 4 are defined above"),
        ("f", "face with 0 corners"),
        ("f 1", "face with 1 corner;"),
        ("f 1 2", "face with 2 corners"),
        ("f 1// 2//", "face with 2 corners"),
        ("f # 1 2 3", "face with 0 corners"),
        ("f /1 /1 /1", "`/1` is no corner"),
        ("f 1/1/1/1 2 3", "is no corner"),
        ("f 1 2 x", "`x` is not an index of a vertex"),
        ("f 1 2 3.0", "`3.0` is not an index of a vertex"),
        ("f 1 2 99999999999", "`99999999999` is not an index"),
        ("f 1 2 99999999999999999999", "is not an index"),
        ("f 1 2 -9223372036854775808", "but only 4 are defined above"),
        ("f 1 2 4294967295", "vertex 4294967295, but only 4 are defined"),
        ("v 1 2", "vertex with 2 numbers"),
        ("v", "vertex with 0 numbers"),
        ("v 1 2 3 4 5", "vertex with 5 numbers"),
        ("v 1 2 3 4 5 6 7 8 9", "more than 8 numbers"),
        ("v 1 2 3.1+e2", "`3.1+e2` is not a number"),
        ("v 1,5 2 3", "decimals need a point"),
        ("v 1 2 \u{fffd}", "is not a number"),
        ("vt", "texture coordinate with 0 numbers"),
        ("vt 1 2 3 4", "texture coordinate with 4 numbers"),
        ("vn 1 0", "normal with 2 numbers"),
        ("vn a b c", "`a` is not a number"),
    ] {
        let message = error_of(statement);
        assert!(message.contains(part), "{statement}: {message}");
    }
}

#[test]
fn vertices_that_are_not_finite_matter_only_where_used() {
    for word in ["nan", "-NaN", "inf", "-Infinity", "1e999", "1.#IND", "-1.#INF", "-nan(ind)"] {
        let unused = parse(&format!("{TRIANGLE}v 0 {word} 0\nf 1 2 3\n")).unwrap();
        assert_eq!(unused.positions[3], DVec3::ZERO);
        assert!(unused.warnings[0].ends_with("1, first at line 4"), "{:?}", unused.warnings);
        let error = parse(&format!("{TRIANGLE}v 0 {word} 0\nf 1 2 3\nf 1 2 4\n")).unwrap_err();
        assert!(error.message().starts_with("model.obj:6: face uses vertex 4,"), "{error}");
        assert!(error.message().contains("(line 4)"), "{error}");
    }
}

#[test]
fn files_without_faces_are_refused() {
    for (bytes, part) in [
        (&b""[..], "the file is empty"),
        (b"\n", "no vertices and no faces"),
        (b"# nothing\n", "no vertices and no faces"),
        (b"v 0 0 0\n", "1 vertices and no faces"),
        (b"v 0 0 0\nv 1 0 0\nl 1 2\n", "only points or lines"),
        (b"v 0 0 0\ncstype bspline\n", "free-form"),
        (b"solid_thing\nfacet\n", "is this an OBJ file?"),
        (b"ply\nformat ascii 1.0\n", "looks like a PLY file"),
        (b"solid cube\n facet normal 0 0 0\n", "looks like a STL file"),
        (b"glTF\x02\0\0\0", "zero bytes"),
        (b"\xFF\xFEf\0", "UTF-16"),
        (b"\xFE\xFF\0f", "UTF-16"),
        (b"f\0 \x001\0", "zero bytes"),
    ] {
        let error = parse_obj(bytes, "model.obj").unwrap_err();
        assert_eq!(error.code(), ExitCode::InvalidInput);
        assert!(error.message().starts_with("model.obj: ") && error.message().contains(part), "{error}");
    }
}

#[test]
fn every_way_to_write_a_triangle_gives_the_same() {
    let plain = parse(&format!("{TRIANGLE}f 1 2 3\n")).unwrap();
    check_guarantees(&plain);
    assert_eq!(plain.triangles, [[0, 1, 2]]);
    assert_eq!(plain.materials, ["default"]);
    for text in [
        format!("{TRIANGLE}f 1 2 3"),
        format!("\u{feff}{TRIANGLE}f 1 2 3\n"),
        format!("{TRIANGLE}f 1 2 3\n").replace('\n', "\r\n"),
        format!("{TRIANGLE}f 1 2 3\n").replace('\n', "\r"),
        format!("{TRIANGLE}f 1 \\\n2\\\n 3\n"),
        format!("{TRIANGLE}f 1 \\\r\n2 3\r\n"),
        format!("{TRIANGLE}f 1 2 3 \\"),
        format!("# a path C:\\models\\\n{TRIANGLE}f 1 2 3\n"),
        format!("f 1 2 3\n{TRIANGLE}"),
        format!("{TRIANGLE}f -3 -2 -1\n"),
        format!("{TRIANGLE}f +1 2 3 # a comment\n"),
        format!("{TRIANGLE}fo 1 2 3\n"),
        format!("\t{TRIANGLE}o a\ng b c\ns off\n  f\t1\t2  3\n"),
        "v 0. .0 0e0 # zero\nv +1 0 0 1.0\nv 0 1E0 0\nf 1 2 3".to_owned(),
        format!("{TRIANGLE}vt 0 0\nvn 0 0 1\nf 1 2 3\n"),
    ] {
        assert_eq!(parse(&text).as_ref(), Ok(&plain), "{text:?}");
    }
}

#[test]
fn repairs_are_reported() {
    for (text, part) in [
        (format!("{TRIANGLE}v 1 1 1 2\nf 1 2 3\n"), "weight w other than 1, which polygons ignore: 1, first at line 4"),
        (format!("{TRIANGLE}v 1 1 1 .5 .5 .5\nf 1 2 3\n"), "colours"),
        (format!("{TRIANGLE}f 1 2 3\nl 1 2\np 1\n"), "point and line statements left out: 2"),
        (format!("{TRIANGLE}f 1// 2// 3//\n"), "end with a slash"),
        (format!("{TRIANGLE}f 1 2 3\nF 1 2 3\n"), "unknown statements `F` left out: 1, first at line 5"),
        (format!("{TRIANGLE}f 1 2 3\ncurv2 1 2\n"), "free-form"),
        (format!("{TRIANGLE}vt 0 0\nf 1/1 2 3/1\n"), "1 triangle corners have no texture coordinate"),
        (format!("{TRIANGLE}vn 0 0 0\nf 1//1 2//1 3//1\n"), "1 normals have no direction"),
        (format!("{TRIANGLE}vt 1e99 0\nf 1/1 2/1 3/1\n"), "1 texture coordinates are not finite"),
    ] {
        let model = parse(&text).unwrap();
        check_guarantees(&model);
        assert!(model.warnings.len() == 1 && model.warnings[0].contains(part), "{part}: {:?}", model.warnings);
        assert_eq!(model.triangles, [[0, 1, 2]]);
        assert_eq!(model.positions[..3], [DVec3::ZERO, DVec3::X, DVec3::Y]);
    }
}

#[test]
fn corners_keep_their_own_attributes() {
    let text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nvt 0.5\nvt 0.25 0.75 0\nvt 1 1\nvn 0 0 -2\nvn 1e300 0 0\n\
        f 4/2/2 3/3/1 2/2/1\nf -5//1 -4//1 -2//2\n";
    let model = parse(text).unwrap();
    check_guarantees(&model);
    assert_eq!(model.triangles, [[3, 2, 1], [0, 1, 3]]);
    let (uvs, normals) = (model.uvs.unwrap(), model.normals.unwrap());
    assert_eq!(uvs.values, [Vec2::new(0.5, 0.0), Vec2::new(0.25, 0.75), Vec2::ONE, Vec2::ZERO]);
    assert_eq!(uvs.corners, [[1, 2, 1], [3, 3, 3]]);
    assert_eq!(normals.values, [-Vec3::Z, Vec3::X]);
    assert_eq!(normals.corners, [[1, 0, 0], [0, 0, 1]]);
    assert_eq!(model.positions.len(), 5);
}

#[test]
fn materials_are_named_in_the_order_of_use() {
    let text = format!(
        "mtllib a.mtl\n{TRIANGLE}f 1 2 3\nusemtl never\nusemtl Material #25\nf 1 2 3\nf 3 2 1\n\
        usemtl\tskin\nf 1 2 3\nusemtl Material #25\nf 1 2 3\nusemtl\nf 1 2 3\n"
    );
    let model = parse(&text).unwrap();
    assert_eq!(model.materials, ["default", "Material #25", "skin"]);
    assert_eq!(model.triangle_material, [0, 1, 1, 2, 1, 0]);
    let latin = parse_obj(&[TRIANGLE.as_bytes(), b"usemtl gr\xFCn\n# \xFC\nf 1 2 3\n"].concat(), "m").unwrap();
    assert_eq!(latin.materials, ["gr\u{fffd}n"]);
}

#[test]
fn a_missing_material_library_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.obj");
    std::fs::write(folder.path().join("with space.mtl"), "").unwrap();
    std::fs::write(folder.path().join("b.mtl"), "").unwrap();
    let text = format!("mtllib with space.mtl\nmtllib b.mtl .\\b.mtl\nmtllib gone.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\n");
    std::fs::write(&path, text).unwrap();
    let model = read_obj(&path).unwrap();
    assert_eq!(model.warnings, ["material library `gone.mtl` is missing; the names of its materials are kept"]);
    assert_eq!(model.materials, ["m"]);
    let error = read_obj(&folder.path().join("none.obj")).unwrap_err();
    assert_eq!(error.code(), ExitCode::Io);
    assert_eq!(read_obj(folder.path()).unwrap_err().code(), ExitCode::Io);
}

#[test]
fn polygons_above_the_limit_are_unsupported() {
    let polygon = |corners: usize| format!("{TRIANGLE}f{}\n", " 1 2 3".repeat(corners / 3));
    let error = parse(&polygon(100_002)).unwrap_err();
    assert_eq!(error.code(), ExitCode::Unsupported);
    assert!(error.message().starts_with("model.obj:4: face with 100002 corners"), "{error}");
    assert_eq!(parse(&polygon(15_999)).unwrap().triangles.len(), 15_997);
}

#[test]
fn positions_keep_every_bit_of_the_text() {
    let text =
        "v 0.1 1e-310 14678.000000000001\nv -0.30000000000000004 5e-324 1.7976931348623157e308\nv 1 2 3\nf 1 2 3";
    let model = parse(text).unwrap();
    assert_eq!(model.positions[0].to_array(), [0.1, 1e-310, 14678.000000000001]);
    assert_eq!(model.positions[1].to_array(), [-0.30000000000000004, 5e-324, f64::MAX]);
}

/// Every bad file of the shared data: triangles, or a part of the message behind the file's name.
const BAD: &[(&str, std::result::Result<usize, &str>)] = &[
    ("comments_only.obj", Err(": no vertices and no faces")),
    ("concave_polygon.obj", Ok(64)),
    ("degenerate_all.obj", Ok(1)),
    ("degenerate_some.obj", Ok(4)),
    ("double_sided_teapot.obj", Ok(6320)),
    ("empty.obj", Err(": the file is empty")),
    ("face_partial.obj", Err(":9: face with 2 corners; at least 3")),
    ("face_too_short.obj", Err(":15: face with 1 corner;")),
    ("far_from_origin.obj", Ok(28)),
    ("huge_coords_flt_max.obj", Ok(12)),
    ("index_out_of_range.obj", Err(":12: face refers to vertex 7, but only 6 are defined")),
    ("inf_nan_triangle.obj", Err(":7: face uses vertex 1, whose coordinates are not finite (line 1)")),
    ("lines_only.obj", Err(": 3 vertices and no faces, only points or lines")),
    ("long_line.obj", Ok(944)),
    ("malformed_empty_face.obj", Err(":23: face with 0 corners")),
    ("malformed_indices.obj", Err(":28: face refers to vertex 0, but indices count from 1")),
    ("missing_mtl.obj", Ok(12)),
    ("nan_vertices.obj", Err(":27: face uses vertex 1, whose coordinates are not finite (line 12)")),
    ("negative_indices.obj", Ok(12)),
    ("no_final_newline.obj", Ok(12)),
    ("non_manifold_box.obj", Ok(12)),
    ("non_manifold_edge.obj", Ok(12)),
    ("non_manifold_openscad.obj", Ok(1442)),
    ("number_formats.obj", Err(":11: `3.1+e2` is not a number")),
    ("octagon_ngon.obj", Ok(6)),
    ("points_no_faces.obj", Err(": 8 vertices and no faces; export")),
    ("relative_index_out_of_range.obj", Err(":1: face refers to vertex -4, but only 0 are defined above")),
    ("utf16be.obj", Err(": the text is UTF-16")),
    ("zero_index.obj", Err(":16: face refers to vertex 0, but indices count from 1")),
];

#[test]
fn bad_files_give_the_documented_result() {
    let Some(folder) = shared_data("bad") else { return };
    let mut seen = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "obj") {
            continue;
        }
        let name = path.file_name().unwrap().to_str().unwrap();
        let (_, expected) = BAD.iter().find(|(known, _)| *known == name).expect(name);
        seen += 1;
        match (read_obj(&path), expected) {
            (Ok(model), Ok(triangles)) => {
                check_guarantees(&model);
                assert_eq!(model.triangles.len(), *triangles, "{name}");
                let text = std::fs::read_to_string(&path).unwrap();
                assert_eq!(model.positions, naive_vertices(&text), "{name}");
            }
            (Err(error), Err(part)) => {
                assert_eq!(error.code(), ExitCode::InvalidInput, "{name}");
                let start = format!("{}{part}", path.display());
                assert!(error.message().starts_with(&start), "{name}: {error}");
            }
            (result, _) => panic!("{name}: {result:?}"),
        }
    }
    assert_eq!(seen, BAD.len());
}

#[test]
fn bad_files_that_load_are_what_they_should_be() {
    let Some(folder) = shared_data("bad") else { return };
    let concave = read_obj(&folder.join("concave_polygon.obj")).unwrap();
    assert_eq!(concave.materials, ["test"]);
    // A ring between circles of 0.7425 and 0.69, as 32-gons and slightly irregular: the shoelace formula by hand.
    let text = std::fs::read_to_string(folder.join("concave_polygon.obj")).unwrap();
    let face = text.lines().find_map(|line| line.strip_prefix("f ")).unwrap();
    let outline: Vec<DVec3> = face
        .split_whitespace()
        .map(|corner| concave.positions[corner.split('/').next().unwrap().parse::<usize>().unwrap() - 1])
        .collect();
    let shoelace: f64 = (0..outline.len())
        .map(|i| (outline[i], outline[(i + 1) % outline.len()]))
        .map(|(a, b)| (a.y * b.z - a.z * b.y) / 2.0)
        .sum();
    assert_eq!(outline.len(), 66);
    assert!((area(&concave) - shoelace.abs()).abs() < 1e-12, "{} {shoelace}", area(&concave));

    let cube = read_obj(&folder.join("negative_indices.obj")).unwrap();
    assert!((area(&cube) - 24.0).abs() < 1e-12 && cube.warnings.is_empty());
    let (uvs, normals) = (cube.uvs.unwrap(), cube.normals.unwrap());
    assert_eq!((uvs.values.len(), normals.values.len()), (14, 6));
    assert_eq!(uvs.corners[0][0], 1);
    for (triangle, corners) in cube.triangles.iter().zip(&normals.corners) {
        let [a, b, c] = triangle.map(|v| cube.positions[v as usize].as_vec3());
        assert_eq!((b - a).cross(c - a).normalize(), normals.values[corners[0] as usize]);
    }

    let jacked = read_obj(&folder.join("missing_mtl.obj")).unwrap();
    assert_eq!(jacked.materials, ["material0"]);
    assert!(jacked.warnings.iter().any(|w| w.contains("`nonexistent.mtl` is missing")), "{:?}", jacked.warnings);
}

#[test]
fn a_written_model_loads_in_its_order_to_the_bit() {
    let source = crate::geometry::shapes::still_life(1.5);
    let mut text: String = source.positions.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z)).collect();
    let mut current = None;
    for (t, &material) in source.triangles.iter().zip(&source.triangle_material) {
        if current.replace(material) != Some(material) {
            text += &format!("usemtl {}\n", source.materials[material as usize]);
        }
        text += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
    }
    let model = parse(&text).unwrap();
    check_guarantees(&model);
    assert!(model.positions == source.positions && model.positions == naive_vertices(&text));
    assert_eq!((&model.triangles, &model.triangle_material), (&source.triangles, &source.triangle_material));
    assert_eq!(model.materials, source.materials);
    assert!(check_against_second_reader(text.as_bytes(), "still life"));
}

#[test]
fn real_meshes_load_in_source_order_with_the_documented_counts() {
    let Some(folder) = shared_data("meshes") else { return };
    let sources = std::fs::read_to_string(folder.join("../SOURCES.md")).unwrap();
    let mut seen = 0;
    for row in sources.lines().filter(|row| row.starts_with("| ") && row.contains(".obj |")) {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let path = folder.join(cells[1]);
        let (Ok(vertices), Ok(triangles)) =
            (cells[2].replace(',', "").parse::<usize>(), cells[3].replace(',', "").parse::<usize>())
        else {
            continue;
        };
        seen += 1;
        let start = std::time::Instant::now();
        let model = read_obj(&path).unwrap();
        println!("{}: {:?} {:?}", cells[1], start.elapsed(), model.warnings);
        check_guarantees(&model);
        let naive = naive_vertices(&std::fs::read_to_string(&path).unwrap());
        assert_eq!((model.positions.len(), model.triangles.len()), (vertices, triangles), "{}", cells[1]);
        assert!(model.positions == naive, "{}: vertex order", cells[1]);
        check_against_second_reader(&std::fs::read(&path).unwrap(), cells[1]);
    }
    let files =
        std::fs::read_dir(&folder).unwrap().filter(|f| f.as_ref().unwrap().path().extension().unwrap() == "obj");
    assert_eq!(seen, files.count());
}

/// Texts that use every statement, and small real files.
fn mutation_seeds() -> Vec<Vec<u8>> {
    let everything = format!(
        "# a comment\nmtllib a.mtl\no thing\n{TRIANGLE}v 1 1 0.5 1\nv 2 0 1 0.1 0.2 0.3\nv nan 0 0\nvt 0 0\nvt 1 0\n\
        vt 0.5\nvn 0 0 1\nvn 1 0 0\ng a b\ns 1\nf 1/1/1 2/2/1 3/3/2\nusemtl skin\nf -5//1 -4//1 -3//2 -2//2\nl 1 2\n\
        f 1/1 2/2 \\\n 4/3 3/1\nusemtl bone\nf 1 2 5 4 3\nf 1 2 3 4 5 1 2\np 1\ncurv 0 1 1 2\n"
    );
    let mut grid = String::new();
    for i in 0..64 {
        grid += &format!("v {} {} {}\n", i % 8, i / 8, f64::from(i * i % 7) * 0.1);
    }
    for i in (0..55).filter(|i| i % 8 != 7) {
        grid += &format!("f {} {} {} {}\n", i + 1, i + 2, i + 10, i + 9);
    }
    let mut seeds = vec![everything.into_bytes(), grid.into_bytes()];
    if let Some(folder) = shared_data("bad") {
        for name in ["concave_polygon.obj", "negative_indices.obj", "missing_mtl.obj", "far_from_origin.obj"] {
            seeds.push(std::fs::read(folder.join(name)).unwrap());
        }
        seeds.push(std::fs::read(folder.join("../meshes/suzanne.obj")).unwrap());
    }
    seeds
}

#[test]
fn ten_thousand_mutations_never_break_a_guarantee() {
    let seeds = mutation_seeds();
    let mut state = 42u64;
    let mut random = move |range: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % range
    };
    let (mut accepted, mut refused, mut compared) = (0, 0, 0);
    for round in 0..10_000 {
        // The one large seed in one round of twenty only.
        let small = seeds.iter().filter(|seed| seed.len() < 10_000).count();
        let mut bytes = seeds[if round % 20 == 0 { round / 20 % seeds.len() } else { round % small }].clone();
        match random(4) {
            0 => bytes.truncate(random(bytes.len() + 1)),
            1 => {
                let from = random(bytes.len());
                let to = (from + random(40)).min(bytes.len());
                bytes.drain(from..to);
            }
            _ => {}
        }
        for _ in 0..random(4) {
            if !bytes.is_empty() {
                let at = random(bytes.len());
                // Half of the time a byte that means something in an OBJ.
                bytes[at] = if random(2) == 0 { b"0123456789-+./ \\\n#vfnte"[random(23)] } else { random(256) as u8 };
            }
        }
        match parse_obj(&bytes, "m") {
            Ok(model) => {
                check_guarantees(&model);
                accepted += 1;
                compared += usize::from(model.warnings.is_empty() && check_against_second_reader(&bytes, "m"));
            }
            Err(error) => {
                assert_ne!(error.code(), ExitCode::Runtime, "{error}");
                assert!(error.message().starts_with("m:"), "{error}");
                refused += 1;
            }
        }
    }
    println!("{accepted} accepted, {refused} refused, {compared} read by tobj too");
    assert!(accepted > 1000 && refused > 1000 && compared > 500);
}
