//! `bake --shard` and `merge`: a bake that several processes share has the bytes of the whole one, and what does not belong together is named.

use translux::geometry::shapes;

use crate::common::Folder;

/// Bakes that have something to share, on a small model.
const BAKES: [&str; 5] = [
    "--material skin1 --method quantized_lights --samples 300 --set lights=200 --set shells=1",
    "--material skin1 --method all_frequency --samples 300 --set coefficients=25",
    "--material skin1 --method all_frequency --samples 300 --model calibrated --photons 2048 --set coefficients=16 --set inter-reflection=1 --set inter-reflection-rays=16",
    "--material marble --method editable --samples 200 --set transport=stored --set coefficients=16",
    "--material skin1 --method editable --samples 200 --set coefficients=16",
];

fn folder() -> Folder {
    let folder = Folder::new();
    folder.obj("head.obj", &shapes::bumpy_head(1.0, 2));
    folder
}

#[test]
fn shards_put_together_are_the_whole_bake() {
    let folder = folder();
    for (index, bake) in BAKES.into_iter().enumerate() {
        // So small that the walks of what is calibrated leave soon.
        let line = format!("bake head.obj --size-mm 6 {bake} -q");
        folder.run(&format!("{line} -o whole.tlux")).ok();
        // On other numbers of threads, and in any order.
        let report = folder.run(&format!("{line} --shard 2/2 --threads 1 -o 2.shard --json")).ok().json();
        assert_eq!((report["shard"].as_u64(), report["shards"].as_u64()), (Some(2), Some(2)), "{report}");
        let blocks = report["blocks"].as_u64().unwrap();
        let line_of_first = format!("{line} --shard 1/2 --from-shard 2.shard --threads 2 -o 1.shard --json");
        let report = folder.run(&line_of_first).ok().json();
        assert!(blocks + report["blocks"].as_u64().unwrap() >= 2, "{bake}: {report}");
        folder.run("merge 2.shard 1.shard -o merged.tlux -q").ok();
        assert!(folder.read("merged.tlux") == folder.read("whole.tlux"), "{bake}");
        // One that failed is baked again alone, to the same bytes; what one shard has for all is not in another.
        if index < 2 {
            let before = folder.read("1.shard");
            folder.run(&format!("{line} --shard 1/2 --from-shard 2.shard --threads 1 -o 1.shard")).ok();
            assert!(folder.read("1.shard") == before, "{bake}");
            folder.run(&format!("{line} --shard 1/2 -o 1.shard")).ok();
            assert!(folder.read("1.shard").len() > before.len(), "{bake}");
        }
    }
}

#[test]
fn one_shard_and_more_than_there_are_blocks_are_the_whole_bake_too() {
    let folder = folder();
    let line = format!("bake head.obj --size-mm 20 {} -q", BAKES[1]);
    folder.run(&format!("{line} -o whole.tlux")).ok();
    folder.run(&format!("{line} --shard 1/1 -o 1.shard")).ok();
    let report = folder.run("merge 1.shard -o merged.tlux -q --json").ok().json();
    assert!(folder.read("merged.tlux") == folder.read("whole.tlux"));
    assert_eq!(report["written"].as_bool(), Some(true), "{report}");
    // From a file of options.
    std::fs::write(folder.path("bake.toml"), format!("input = \"head.obj\"\nsize-mm = 20\n{}", options(BAKES[1])))
        .unwrap();
    folder.run("bake --config bake.toml -q --shard 1/30 -o many1.shard").ok();
    let all: Vec<String> = (1..=30).map(|i| format!("many{i}.shard")).collect();
    for (index, name) in all.iter().enumerate().skip(1) {
        folder
            .run(&format!("bake --config bake.toml -q --shard {}/30 --from-shard many1.shard -o {name}", index + 1))
            .ok();
    }
    folder.run(&format!("merge {} -o merged.tlux -q", all.join(" "))).ok();
    assert!(folder.read("merged.tlux") == folder.read("whole.tlux"));
}

/// Options of a command line as a file has them.
fn options(line: &str) -> String {
    let words: Vec<&str> = line.split_whitespace().collect();
    let set: Vec<String> =
        words.chunks(2).filter(|pair| pair[0] == "--set").map(|pair| format!("{:?}", pair[1])).collect();
    let others = words.chunks(2).filter(|pair| pair[0] != "--set");
    let others: String = others.map(|pair| format!("{} = {:?}\n", pair[0].trim_start_matches('-'), pair[1])).collect();
    format!("{others}set = [{}]\n", set.join(", "))
}

#[test]
fn what_does_not_belong_together_is_named() {
    let folder = folder();
    let line = format!("bake head.obj --size-mm 20 {} -q", BAKES[1]);
    for shard in ["1/2", "2/2", "3/3"] {
        folder.run(&format!("{line} --shard {shard} -o {}.shard", shard.replace('/', "of"))).ok();
    }
    let (merge, to) = ("merge -q", "-o merged.tlux");
    folder.run(&format!("{merge} 1of2.shard {to}")).fails(3, &["of 2 shards 2 is missing"]);
    folder.run(&format!("{merge} 3of3.shard {to}")).fails(3, &["of 3 shards 1, 2 are missing"]);
    folder
        .run(&format!("{merge} 1of2.shard 2of2.shard 2of2.shard {to}"))
        .fails(3, &["2of2.shard: shard 2 of 2 is in 2of2.shard too"]);
    let foreign = ["3of3.shard: not of the same bake as 1of2.shard", "it is one of 3 shards, not of 2"];
    folder.run(&format!("{merge} 1of2.shard 2of2.shard 3of3.shard {to}")).fails(3, &foreign);
    folder.run(&format!("{line} --max-rms 3% --shard 2/2 -o other.shard")).ok();
    folder.run(&format!("{merge} 1of2.shard other.shard {to}")).fails(3, &["other.shard", "a bake with other options"]);
    folder
        .run(&format!("{line} --shard 1/2 --from-shard other.shard -o a.shard"))
        .fails(3, &["other.shard: --from-shard: not of this bake", "other options"]);
    // A block that is damaged, and a file that is cut or none.
    let bytes = folder.read("2of2.shard");
    let damaged = |name: &str, bytes: &[u8]| std::fs::write(folder.path(name), bytes).unwrap();
    let mut changed = bytes.clone();
    let of_text = u64::from_le_bytes(bytes[bytes.len() - 40..bytes.len() - 32].try_into().unwrap());
    changed[bytes.len() - 40 - of_text as usize - 4] ^= 1;
    damaged("damaged.shard", &changed);
    folder
        .run(&format!("{merge} 1of2.shard damaged.shard {to}"))
        .fails(3, &["damaged.shard: damaged", "bake shard 2 of 2 again"]);
    damaged("cut.shard", &bytes[..bytes.len() - 100]);
    folder.run(&format!("{merge} 1of2.shard cut.shard {to}")).fails(3, &["cut.shard", "cut"]);
    folder.run(&format!("{merge} 1of2.shard head.obj {to}")).fails(3, &["head.obj: no shard of a bake"]);
    folder.run(&format!("{merge} 1of2.shard none.shard {to}")).fails(2, &["none.shard"]);
    // The model has changed since.
    folder.obj("head.obj", &shapes::bumpy_head(1.01, 2));
    let stale = ["1of2.shard: not what this bake is now", "head.obj"];
    folder.run(&format!("{merge} 1of2.shard 2of2.shard {to}")).fails(3, &stale);
    assert!(!folder.path("merged.tlux").exists());
}

#[test]
fn bakes_without_anything_to_share_say_so() {
    let folder = folder();
    let line = "bake head.obj --size-mm 20 --material skin1 -q";
    folder.run(&format!("{line} --shard 1/2 -o a.shard")).fails(1, &["--method auto", "name the method"]);
    folder
        .run(&format!("{line} --method two_pass --shard 1/2 -o a.shard"))
        .fails(5, &["`two_pass`", "nothing that processes could share"]);
    for odd in ["0/2", "3/2", "1", "1/0", "a/2", "1/70000"] {
        folder.run(&format!("{line} --method editable --shard {odd} -o a.shard")).fails(1, &["I/N is needed"]);
    }
    folder.run(&format!("{line} --method editable --shard 1/2 -o a.tlux")).fails(1, &["must end in .shard"]);
    folder.run(&format!("{line} --method editable --from-shard a.shard -o a.tlux")).fails(1, &["--shard"]);
    folder.run(&format!("{line} --method editable --shard 1/2 --cache c -o a.shard")).fails(1, &["--cache"]);
    std::fs::write(folder.path("list.toml"), "[[job]]\ninput = \"head.obj\"\noutput = \"a.shard\"\nshard = \"1/2\"\n")
        .unwrap();
    folder.run("bake --jobs list.toml").fails(1, &["list.toml:1", "a command of its own"]);
    folder.run("merge -o a.tlux").fails(1, &["SHARD"]);
}
