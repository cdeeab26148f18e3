#![allow(clippy::unwrap_used)]

use super::*;
use crate::error::ExitCode;

fn example(with_s: bool) -> RadiosityPly {
    let values = |scale: f32| (0..5).map(|i| [i as f32 * scale, 0.1, -1.5e-7]).collect::<Vec<_>>();
    RadiosityPly {
        positions: values(1.0),
        colors: (0..5).map(|i| [i * 50, 255, 10]).collect(),
        b: values(0.25),
        s: with_s.then(|| values(0.5)),
        columns: vec![("trust_r", (0..5).map(|i| i as f32 * 0.125).collect())],
        triangles: vec![[0, 1, 2], [2, 3, 4]],
        comments: vec!["material marble".to_owned(), "light env:path=\n\u{7}caf\u{e9}.hdr\r\n".to_owned()],
    }
}

fn ascii(rows: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\ncomment hand made\nelement vertex 2\nproperty float x\nproperty list uchar int l\n\
        property uchar red\nproperty double w\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}"
    )
}

fn error_of(bytes: impl AsRef<[u8]>) -> Error {
    parse_ply(bytes.as_ref(), "a.ply").unwrap_err()
}

#[test]
fn what_is_written_reads_back() {
    for with_s in [false, true] {
        let mut ply = example(with_s);
        for triangles in [vec![[0, 1, 2], [2, 3, 4]], Vec::new()] {
            ply.triangles = triangles;
            let bytes = write_ply(&ply).unwrap();
            assert_eq!(bytes, write_ply(&ply.clone()).unwrap());
            let table = parse_ply(&bytes, "a.ply").unwrap();
            assert_eq!(table.vertex_count, 5);
            assert_eq!(table.columns.len(), if with_s { 13 } else { 10 });
            assert_eq!(table.comments, ["material marble", "light env:path=", "caf\u{e9}.hdr"]);
            let wide = |values: &[[f32; 3]]| values.iter().map(|v| v.map(f64::from)).collect::<Vec<_>>();
            assert_eq!(table.triples(["x", "y", "z"]).unwrap(), wide(&ply.positions));
            assert_eq!(table.triples(["b_r", "b_g", "b_b"]).unwrap(), wide(&ply.b));
            assert_eq!(table.triples(["s_r", "s_g", "s_b"]), ply.s.as_deref().map(wide));
            assert_eq!(table.column("red").unwrap(), [0.0, 50.0, 100.0, 150.0, 200.0]);
            assert_eq!(table.column("trust_r").unwrap(), [0.0, 0.125, 0.25, 0.375, 0.5]);
            assert_eq!(table.column("alpha"), None);
        }
    }
}

#[test]
fn the_layout_is_fixed() {
    let ply = RadiosityPly {
        positions: vec![[1.0, 2.0, 3.0]; 3],
        colors: vec![[1, 2, 3]; 3],
        b: vec![[0.5; 3]; 3],
        triangles: vec![[0, 1, 2]],
        ..RadiosityPly::default()
    };
    let bytes = write_ply(&ply).unwrap();
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty float b_r\n\
        property float b_g\nproperty float b_b\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    assert_eq!(&bytes[..header.len()], header.as_bytes());
    let data = &bytes[header.len()..];
    assert_eq!(data.len(), 3 * 27 + 13);
    assert_eq!(data[..27], *b"\0\0\x80\x3f\0\0\0\x40\0\0\x40\x40\x01\x02\x03\0\0\0\x3f\0\0\0\x3f\0\0\0\x3f");
    assert_eq!(data[81..], *b"\x03\0\0\0\0\x01\0\0\0\x02\0\0\0");
}

#[test]
fn inconsistent_results_are_not_written() {
    let breakages: [fn(&mut RadiosityPly); 9] = [
        |ply| ply.columns[0].1[2] = f32::NAN,
        |ply| ply.columns[0].1.truncate(4),
        |ply| ply.b[3][1] = f32::NAN,
        |ply| ply.positions[0][2] = f32::INFINITY,
        |ply| ply.s.as_mut().unwrap()[4][0] = f32::NAN,
        |ply| ply.triangles.push([0, 1, 5]),
        |ply| ply.colors.truncate(4),
        |ply| ply.b.truncate(4),
        |ply| ply.s.as_mut().unwrap().truncate(4),
    ];
    for breakage in breakages {
        let mut ply = example(true);
        breakage(&mut ply);
        assert_eq!(write_ply(&ply).unwrap_err().code(), ExitCode::Runtime);
    }
}

#[test]
fn text_files_are_read() {
    for text in [
        ascii("0.1 2 7 8 255 1e-3\n-1 0 0 2\n3 0 1 0\n"),
        ascii("0.1 2 7 8 255 1e-3\n\n  -1 0\t0 2\n3 0 1 0"),
        ascii("0.1 2 7 8 255 1e-3\n-1 0 0 2\n3 0 1 0\n\n").replace('\n', "\r\n"),
    ] {
        let table = parse_ply(text.as_bytes(), "a.ply").unwrap();
        assert_eq!(table.comments, ["hand made"]);
        let columns: Vec<(&str, &[f64])> = table.columns.iter().map(|(n, v)| (n.as_str(), v.as_slice())).collect();
        assert_eq!(columns, [("x", &[f64::from(0.1f32), -1.0][..]), ("red", &[255.0, 0.0]), ("w", &[1e-3, 2.0])]);
    }
}

#[test]
fn text_and_binary_give_the_same_table() {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nelement skipped 2\nproperty short a\nelement vertex 2\nproperty int8 a\n\
            property uint8 b\nproperty int16 c\nproperty ushort d\nproperty list ushort double l\nproperty int e\n\
            property uint32 f\nproperty float32 g\nproperty float64 h\nelement empty 7\nend_header\n"
        )
    };
    let text = header("ascii")
        + "1\n2\n-128 255 -32768 65535 1 0.5 -2147483648 4294967295 0.1 0.1\n127 0 1 2 0 3 4 1e38 -1e300\n";
    let mut binary = (header("binary_little_endian") + "abcd").into_bytes();
    binary.extend([0x80, 0xFF, 0, 0x80, 0xFF, 0xFF, 1, 0]);
    binary.extend(0.5f64.to_le_bytes());
    binary.extend([0, 0, 0, 0x80, 0xFF, 0xFF, 0xFF, 0xFF]);
    binary.extend(0.1f32.to_le_bytes());
    binary.extend(0.1f64.to_le_bytes());
    binary.extend([127, 0, 1, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0]);
    binary.extend(1e38f32.to_le_bytes());
    binary.extend((-1e300f64).to_le_bytes());
    let table = parse_ply(&binary, "a.ply").unwrap();
    assert_eq!(table, parse_ply(text.as_bytes(), "a.ply").unwrap());
    assert_eq!(table.column("e").unwrap(), [-2147483648.0, 3.0]);
    assert_eq!(table.column("h").unwrap(), [0.1, -1e300]);
}

#[test]
fn malformed_text_names_the_line() {
    for (rows, part) in [
        ("", "cut off"),
        ("0.1 0 255 1\n1 0 0 2\n", "cut off"),
        ("0.1 0 255\n-1 0 0 2\n3 0 1 0\n", "line 12: row 0 of `vertex` has no `w`"),
        ("0.1 0 255 1 9\n-1 0 0 2\n3 0 1 0\n", "line 12: row 0 of `vertex` has too many values"),
        ("0.1 0 256 1\n-1 0 0 2\n3 0 1 0\n", "line 12: `256` is no uchar for `red`"),
        ("0.1 0 25 1\n-1 0 0 nan\n3 0 1 0\n", "line 13: `w` of vertex 1 is not finite"),
        ("0.1 0 25 1\n1e99 0 0 1\n3 0 1 0\n", "line 13: `x` of vertex 1 is not finite"),
        ("0.1 0 25 1\n-1 0 0 2\n3 0 1\n", "line 14: row 0 of `face` has no `vertex_indices`"),
        ("0.1 0 25 1\n-1 0 0 2\n-3 0 1 2\n", "line 14: `-3` is no uchar"),
        ("0.1 0 25 1\n-1 0 0 2\n3 0 1 2\n7\n", "line 15: more rows"),
    ] {
        let error = error_of(ascii(rows));
        assert_eq!(error.code(), ExitCode::InvalidInput);
        assert!(error.message().starts_with("a.ply: ") && error.message().contains(part), "{error}");
    }
}

#[test]
fn malformed_headers_are_refused() {
    let start = "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\n";
    assert_eq!(parse_ply(format!("{start}end_header\n").as_bytes(), "a").unwrap().vertex_count, 0);
    for (text, part) in [
        (String::new(), "no PLY file"),
        ("plyx\n".to_owned(), "no PLY file"),
        (start.to_owned(), "no line `end_header`"),
        ("ply\nend_header\n".to_owned(), "no line `format`"),
        ("ply\nformat ascii 1.0\nend_header\n".to_owned(), "no element `vertex`"),
        ("ply\nformat ascii 1.0\nelement vertex 9\nend_header\n".to_owned(), "no scalar property"),
        ("ply\nformat ascii 2.0\n".to_owned(), "line 2: `format ascii 2.0` is no line"),
        ("ply\nproperty float x\n".to_owned(), "line 2: a property before"),
        (format!("{start}property float x\n"), "line 5: a second property `x`"),
        (format!("{start}property half y\n"), "line 5: `property half y`"),
        (format!("{start}property list float int y\n"), "`property list float int y`"),
        (format!("{start}property list int y\n"), "`property list int y`"),
        (format!("{start}element vertex 3\n"), "a second element `vertex`"),
        (format!("{start}element face -3\n"), "`element face -3`"),
        (format!("{start}element face 99999999999999999999999\n"), "is no line"),
        (format!("{start}nonsense\n"), "line 5: `nonsense`"),
    ] {
        let error = error_of(&text);
        assert_eq!(error.code(), ExitCode::InvalidInput);
        assert!(error.message().contains(part), "{text}: {error}");
    }
    let big = error_of("ply\nformat binary_big_endian 1.0\n");
    assert_eq!(big.code(), ExitCode::Unsupported);
}

#[test]
fn counts_are_checked_before_memory_is_asked_for() {
    for format in ["ascii", "binary_little_endian"] {
        for count in ["18446744073709551615", "4611686018427387904", "1000000000000"] {
            let columns = "property float x\nproperty double y\nproperty float z\n";
            let text = format!("ply\nformat {format} 1.0\nelement vertex {count}\n{columns}end_header\n0 0 0\n");
            assert!(error_of(&text).message().contains("cut off"));
            let text = format!(
                "ply\nformat {format} 1.0\nelement a {count}\nproperty list uchar int l\nelement vertex 1\n\
                property uchar x\nend_header\n0 0 0\n"
            );
            assert!(error_of(&text).message().contains("cut off"));
        }
    }
    let long_list = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uchar x\n\
        property list uint double l\nend_header\n\x01\xff\xff\xff\xff";
    assert!(error_of(long_list).message().contains("cut off"));
}

#[test]
fn cut_or_longer_files_are_refused_at_every_byte() {
    let bytes = write_ply(&example(true)).unwrap();
    for end in 0..bytes.len() {
        assert_eq!(error_of(&bytes[..end]).code(), ExitCode::InvalidInput, "cut at {end}");
    }
    let mut longer = bytes;
    longer.push(0);
    assert!(error_of(&longer).message().contains("1 bytes more"));
}

#[test]
fn two_thousand_mutations_never_break_a_guarantee() {
    let seeds = [
        write_ply(&example(true)).unwrap(),
        write_ply(&example(false)).unwrap(),
        ascii("0.1 2 7 8 255 1e-3\n-1 0 0 2\n3 0 1 0\n").into_bytes(),
    ];
    let mut state = 42u64;
    let mut random = move |range: usize| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % range
    };
    let (mut accepted, mut refused) = (0, 0);
    for round in 0..2000 {
        let mut bytes = seeds[round % seeds.len()].clone();
        if random(8) == 0 {
            bytes.truncate(random(bytes.len() + 1));
        }
        for _ in 0..1 + random(3) {
            if !bytes.is_empty() {
                let at = random(bytes.len());
                bytes[at] = if random(2) == 0 { b"0123456789 \n\xFF\0"[random(14)] } else { random(256) as u8 };
            }
        }
        match parse_ply(&bytes, "m") {
            Ok(table) => {
                accepted += 1;
                for (_, values) in &table.columns {
                    assert_eq!(values.len(), table.vertex_count);
                    assert!(values.iter().all(|value| value.is_finite()));
                }
            }
            Err(error) => {
                refused += 1;
                assert!(error.message().starts_with("m: "), "{error}");
                assert_ne!(error.code(), ExitCode::Runtime);
            }
        }
    }
    assert!(accepted > 100 && refused > 100, "{accepted} {refused}");
}

#[test]
fn files_that_cannot_be_opened_are_io_errors() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(read_ply(&folder.path().join("none.ply")).unwrap_err().code(), ExitCode::Io);
    let path = folder.path().join("a.ply");
    std::fs::write(&path, write_ply(&example(true)).unwrap()).unwrap();
    assert_eq!(read_ply(&path).unwrap().vertex_count, 5);
}
