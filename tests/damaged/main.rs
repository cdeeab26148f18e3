//! Assets whose checksums are right and whose contents are not: whatever they hold, commands answer with a result that is finite
//! or with an error, and nothing that validates fails to be evaluated.
//!
//! `TRANSLUX_MUTATIONS=1000000 cargo test --release --test damaged -- --nocapture` tries as many as it is told, over all recipes;
//! `TRANSLUX_FIRST=N` starts at another number. A failure names the number that makes it again.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../../formats/tests/common/mod.rs"]
mod bytes;
mod changes;
mod subjects;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use bytes::{Entry, Random, build};
use subjects::{RECIPES, assets, use_asset};
use translux::asset::Asset;
use translux::evaluate::Registry;
use translux::evaluate::memory::Limits;
use translux::methods::built_in;
use translux::progress::Silent;
use translux::report::validation::{Validation, examine};
use translux_format::RawSection;

/// Mutations of a run in which nobody asks for more.
const FEW: u64 = 900;

/// No mutation of such a small asset takes nearly this long.
const LONG: Duration = Duration::from_secs(20);

/// One mutation, from its number alone; the fault that it shows.
fn attempt(registry: &Registry, assets: &[Vec<RawSection>], number: u64) -> Option<String> {
    let mut random = Random(number);
    let recipe = (number % assets.len() as u64) as usize;
    let mut sections = assets[recipe].clone();
    let names: Vec<String> =
        (0..=random.below(2)).filter_map(|_| changes::change(&mut random, &mut sections, &assets[recipe])).collect();
    let file = build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
    // Other settings within their ranges may take minutes of rays: most of those are only opened.
    let settings = names.iter().any(|name| name.starts_with("form.set"));
    let is_lit = !settings || (number / assets.len() as u64).is_multiple_of(16);
    let began = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let found = examine(Path::new("a.tlux"), &file, (registry, Limits::none()), &Silent).unwrap();
        let valid = found.errors == 0;
        match use_asset(registry, &file, number, is_lit) {
            Ok(Ok(())) => {
                LIT[usize::from(valid)].fetch_add(1, Ordering::Relaxed);
                None
            }
            Ok(Err(absurd)) => Some(absurd),
            Err(error) if valid => Some(format!("valid and refused: {error}")),
            Err(_) => None,
        }
    }));
    let took = began.elapsed();
    TIMES.lock().unwrap_or_else(PoisonError::into_inner)[recipe] += took;
    let fault = match outcome {
        Ok(None) if took < LONG => return None,
        Ok(None) => format!("took {took:?}"),
        Ok(Some(fault)) => fault,
        Err(_) => format!("panicked: {}", PANIC.lock().unwrap_or_else(PoisonError::into_inner)),
    };
    let told = format!("{number}: {} after {}: {fault}", RECIPES[recipe].0, names.join(", "));
    println!("{told}");
    Some(told)
}

/// Time that the mutations of each recipe took.
static TIMES: Mutex<[Duration; RECIPES.len()]> = Mutex::new([Duration::ZERO; RECIPES.len()]);

/// Mutations that gave a result, of files that are not valid and of valid ones.
static LIT: [AtomicU64; 2] = [const { AtomicU64::new(0) }; 2];

/// Where and why the last panic was.
static PANIC: Mutex<String> = Mutex::new(String::new());

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |text| text.parse().unwrap())
}

/// What is found of an asset, and comes of its use, one number of which lets it shine a million times as bright.
fn shining(
    registry: &Registry,
    (recipe, whole): (usize, &[RawSection]),
    tag: &str,
) -> (Validation, translux::error::Result<()>) {
    let mut sections = whole.to_vec();
    let section = sections.iter_mut().find(|section| section.tag.to_string() == tag);
    let section = section.unwrap_or_else(|| panic!("{:?} has no {tag}", RECIPES[recipe]));
    let first: [u8; 4] = section.bytes[..4].try_into().unwrap();
    section.bytes[..4].copy_from_slice(&(1e6 * f32::from_le_bytes(first)).to_le_bytes());
    let file = build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
    let found = examine(Path::new("a.tlux"), &file, (registry, Limits::none()), &Silent).unwrap();
    let opened = Asset::from_bytes(&file).and_then(|asset| {
        let form = registry.form(&asset)?;
        form.open(Arc::new(asset)).map(drop)
    });
    (found, opened)
}

#[test]
fn nothing_that_validates_fails_and_nothing_panics() {
    let registry = built_in();
    // Walks take longer than all else: not where few mutations are asked for.
    let assets = assets(&registry, std::env::var_os("TRANSLUX_MUTATIONS").is_some());
    for (recipe, sections) in RECIPES.iter().zip(&assets) {
        let file = build(&sections.iter().map(Entry::raw).collect::<Vec<_>>());
        let found = examine(Path::new("a.tlux"), &file, (&registry, Limits::none()), &Silent).unwrap();
        assert_eq!(found.errors, 0, "{recipe:?}: {found}");
        for number in [0, 3, 6, 9, 12] {
            let used = use_asset(&registry, &file, number, true);
            assert!(matches!(used, Ok(Ok(()))), "{recipe:?}: {:?}", used.err());
        }
    }
    for (recipe, tag) in [(5, "qlt.stp"), (5, "qln.stp"), (5, "qln.uni"), (7, "aft.stp")] {
        let (found, used) = shining(&registry, (recipe, &assets[recipe]), tag);
        assert!(found.errors > 0, "{tag}: {found}");
        assert!(used.is_err(), "{tag}");
    }
    std::panic::set_hook(Box::new(|info| {
        *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = info.to_string().replace('\n', " ");
    }));
    let (first, count) = (number("TRANSLUX_FIRST", 0), number("TRANSLUX_MUTATIONS", FEW));
    let faults: Vec<String> = (first..first + count).filter_map(|n| attempt(&registry, &assets, n)).collect();
    let _ = std::panic::take_hook();
    let [invalid, valid] = LIT.each_ref().map(|lit| lit.load(Ordering::Relaxed));
    println!("{count} mutations: {valid} valid ones gave a result, {invalid} others");
    println!("times: {:?}", TIMES.lock().unwrap_or_else(PoisonError::into_inner));
    // Mutations that nothing accepts would test nothing.
    assert!(10 * valid > count, "{valid} of {count} were valid");
    assert!(faults.is_empty(), "{} of {count} mutations:\n{}", faults.len(), faults.join("\n"));
}
