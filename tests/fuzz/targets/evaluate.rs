//! Assets whose checksums are right and whose sections hold what the fuzzer wants: whatever that is, commands answer with a result that is
//! finite or with an error, and nothing that validates fails to be evaluated. The input is the number of a recipe, and a list of (section, offset
//! u16, length u8, that many bytes to put there; an offset beyond the end appends, and without bytes the section is cut there).
#![no_main]
#![allow(clippy::unwrap_used)]

use std::path::Path;
use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;
use translux::evaluate::Registry;
use translux::evaluate::memory::Limits;
use translux::methods::built_in;
use translux::progress::Silent;
use translux::report::validation::examine;
use translux_format::RawSection;

#[path = "../../../formats/tests/common/mod.rs"]
mod bytes;
#[path = "../../damaged/subjects.rs"]
mod subjects;

static SUBJECTS: LazyLock<(Registry, Vec<Vec<RawSection>>)> = LazyLock::new(|| {
    let registry = built_in();
    let assets = subjects::assets(&registry, true);
    (registry, assets)
});

// The bakes are no execution.
fuzz_target!(init: { LazyLock::force(&SUBJECTS); }, |input: &[u8]| {
    let [recipe, rest @ ..] = input else { return };
    let (registry, assets) = &*SUBJECTS;
    let mut sections = assets[usize::from(*recipe) % assets.len()].clone();
    let (mut rest, mut number, mut settings) = (rest, 0u64, false);
    while let [section, low, high, length, tail @ ..] = rest {
        let (new, tail) = tail.split_at(tail.len().min(usize::from(*length)));
        let index = usize::from(*section) % sections.len();
        let RawSection { tag, element, components, bytes, .. } = &mut sections[index];
        // Other settings within their ranges may take minutes of rays.
        settings |= tag.to_string() == "form.set";
        let at = usize::from(u16::from_le_bytes([*low, *high])).min(bytes.len());
        let end = (at + new.len()).min(bytes.len());
        if new.is_empty() {
            bytes.truncate(at);
        } else {
            drop(bytes.splice(at..end, new.iter().copied()));
        }
        let row = element.size() as usize * usize::from(*components).max(1);
        bytes.truncate(bytes.len() / row * row);
        number = number.wrapping_mul(31).wrapping_add(u64::from(*low) + u64::from(*length));
        rest = tail;
    }
    let file = bytes::build(&sections.iter().map(bytes::Entry::raw).collect::<Vec<_>>());
    let found = examine(Path::new("a.tlux"), &file, (registry, Limits::none()), &Silent).unwrap();
    match subjects::use_asset(registry, &file, number, !settings) {
        Ok(Ok(())) => {}
        Ok(Err(absurd)) => panic!("{absurd}"),
        Err(error) => assert!(found.errors > 0, "valid and refused: {error}"),
    }
});
