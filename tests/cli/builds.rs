//! Bakes in builds: what is current stays, what it depends on is told, what it will take is told before.

use translux::geometry::shapes;

use crate::common::Folder;

const BAKE: &str = "bake ball.obj --unit mm --material jade.toml --samples 150 --method two_pass -o a.tlux";

fn folder() -> Folder {
    let folder = Folder::new();
    folder.obj("ball.obj", &shapes::icosphere(1.5, 2));
    folder.write(
        "jade.toml",
        "sigma_s_reduced_per_mm = [1.0, 1.2, 1.4]\nsigma_a_per_mm = [0.01, 0.02, 0.03]\neta = 1.4\n",
    );
    folder
}

#[test]
fn what_is_current_is_left_alone() {
    let folder = folder();
    let first = folder.run(&format!("{BAKE} --if-changed --json")).ok();
    assert_eq!(first.json()["written"], true);
    let bytes = folder.read("a.tlux");
    let is_new = |line: &str| {
        let report = folder.run(&format!("{line} --if-changed --json")).ok();
        report.json()["written"].as_bool().unwrap()
    };
    assert!(!is_new(BAKE));
    // Threads, order and defaults that are typed change nothing.
    assert!(!is_new(&format!("{BAKE} --threads 1 --set points=4 --strict")));
    assert!(folder.read("a.tlux") == bytes);
    // Another key, another size, another file, a damaged output.
    assert!(is_new(&format!("{BAKE} --set points=2")) && is_new(BAKE));
    assert!(is_new(&BAKE.replace("--unit mm", "--size-mm 20")) && is_new(BAKE));
    folder.write(
        "jade.toml",
        "sigma_s_reduced_per_mm = [1.0, 1.2, 1.5]\nsigma_a_per_mm = [0.01, 0.02, 0.03]\neta = 1.4\n",
    );
    assert!(is_new(BAKE) && !is_new(BAKE));
    folder.obj("ball.obj", &shapes::icosphere(1.6, 2));
    assert!(is_new(BAKE) && !is_new(BAKE));
    folder.write("a.tlux", &bytes[..500]);
    assert!(is_new(BAKE) && !is_new(BAKE));
    std::fs::remove_file(folder.path("jade.toml")).unwrap();
    folder.run(&format!("{BAKE} --if-changed")).fails(2, &["jade.toml"]);
    // Elsewhere the same bytes.
    let other = self::folder();
    std::fs::create_dir(other.path("m")).unwrap();
    std::fs::rename(other.path("jade.toml"), other.path("m/jade.toml")).unwrap();
    other.run(&BAKE.replace("jade.toml", "m/jade.toml")).ok();
    assert!(other.read("a.tlux") == bytes);
}

#[test]
fn dependencies_are_told_as_a_rule() {
    let folder = folder();
    folder.run(&format!("{BAKE} --depfile a.d")).ok();
    assert_eq!(String::from_utf8(folder.read("a.d")).unwrap(), "a.tlux: ball.obj jade.toml\n");
    folder.run(&format!("{BAKE} --depfile none/a.d")).fails(2, &["none/a.d"]);
    folder.run(&format!("{BAKE} --depfile a.tlux")).fails(1, &["--depfile a.tlux"]);
}

#[test]
fn a_dry_run_foresees_and_writes_nothing() {
    let folder = folder();
    // What is calibrated is foreseen in plan::kernels_are_calibrated_unless_a_method_is_named_or_no_part_is_closed.
    let auto = "bake ball.obj --unit mm --material marble --for-lights directional --model dipole -o a.tlux";
    for line in [BAKE, auto] {
        let foreseen = folder.run(&format!("{line} --dry-run --json")).ok().json();
        assert!(!folder.path("a.tlux").exists());
        let made = folder.run(&format!("{line} --json")).ok().json();
        assert_eq!(made["method"], foreseen["method"], "{line}");
        assert!(made["timings"]["estimated_memory_bytes"].as_u64().unwrap() > 16 << 20, "{line}: {made}");
        let ratio = foreseen["bytes"].as_f64().unwrap() / made["bytes"].as_f64().unwrap();
        assert!((0.5..2.0).contains(&ratio), "{line}: {foreseen} for {}", made["bytes"]);
        assert!(foreseen["memory_bytes"].as_u64().unwrap() > 0 && foreseen["seconds"].as_f64().unwrap() > 0.0);
        std::fs::remove_file(folder.path("a.tlux")).unwrap();
    }
    let text = folder.run(&format!("{BAKE} --dry-run")).ok().text();
    assert!(text.contains("of memory, a file of"), "{text}");
}

/// `bake --strict` fails exactly where `validate --strict` does, and what misses leaves the old asset.
#[test]
fn strict_is_one_rule() {
    let folder = Folder::new();
    let mut spare = shapes::icosphere(1.5, 2);
    spare.positions.push(glam::DVec3::ZERO);
    folder.obj("ball.obj", &shapes::icosphere(1.5, 2)).obj("spare.obj", &spare);
    folder.obj("cube.obj", &shapes::cuboid(glam::DVec3::splat(2.0), 1));
    let mut codes = [0; 2];
    for (model, rest) in [
        ("ball", "--method two_pass --samples 150"),
        ("ball", "--method reference --samples 150"),
        ("ball", "--method texture_space --samples 150 --set resolution=32"),
        ("ball", "--method editable --samples 600 --max-rms 20%"),
        ("ball", "--method quantized_lights --samples 150 --set lights=16 --set shells=0 --max-rms 0.1%"),
        ("ball", "--method all_frequency --samples 150 --set coefficients=1 --max-rms 1%"),
        ("spare", "--method two_pass --samples 150"),
        ("cube", "--method two_pass --samples 150"),
        ("cube", "--for-lights directional --model dipole"),
    ] {
        let bake = format!("bake {model}.obj --unit mm --material skin1 {rest} -o a.tlux");
        folder.write("a.tlux", "precious");
        let baked = folder.run(&format!("{bake} --strict --json"));
        let written = baked.json()["written"].as_bool().unwrap();
        assert_eq!(written, baked.code == 0, "{bake}");
        assert_eq!(folder.read("a.tlux") == b"precious", !written, "{bake}");
        // What is written is what is validated; what is not is kept for that.
        if !written {
            folder.run(&format!("{bake} --keep-on-fail --strict"));
        }
        let validated = folder.run("validate a.tlux --strict");
        assert_eq!(baked.code, validated.code, "{bake}: {} {}", baked.stderr, validated.text());
        codes[usize::from(baked.code == 6)] += 1;
        assert!(baked.code == 0 || baked.stderr.contains("--keep-on-fail"), "{}", baked.stderr);
    }
    assert!(codes[0] >= 3 && codes[1] >= 3, "{codes:?}");
}
