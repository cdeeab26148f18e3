//! `.tlux` assets for C: [`translux_format`] behind a small ABI, and the only `unsafe` code of the format.
//!
//! An asset is opened from bytes ([`translux_open`]), lends its arrays, and is closed ([`translux_close`]). `include/translux.h` is made of
//! this crate by `tests/c.rs`, which also compiles `formats/examples/engine.c` with it and runs that.
//!
//! What is given may be null, and the bytes anything: the answer is a [`Status`]. Only a pointer that is neither null nor valid breaks the
//! rules of this library, as those of C itself. A panic would be a fault of ours; it is caught and answered with [`Status::Internal`].

mod asset;
mod error;
mod views;

use std::ffi::{CStr, c_char};

pub use asset::Asset;
use asset::{borrowed, bytes_of, write};
pub use error::{Error, MESSAGE_BYTES, Status};
use error::{Fault, guarded, name_of};
use translux_format::{Budget, Tag, far_field};
pub use views::{
    FarField, Group, Info, IrradianceRows, LANES, Medium, Mesh, NONE, Part, Samples, Section, TAG_BYTES, Text,
};

/// Version of this interface, raised when a program that was compiled with an earlier header would no longer work.
pub const ABI: u32 = 1;

/// Budget in bytes that suits most assets, for `translux_open`.
pub const DEFAULT_BUDGET: u64 = 2147483648;

/// The version of the library's interface; a program compares it with the header's `TRANSLUX_ABI`.
#[unsafe(no_mangle)]
pub extern "C" fn translux_abi() -> u32 {
    ABI
}

/// The name of a status as `formats/SPEC.md` has it, ended by a zero; `"Unknown"` for a number that is none.
#[unsafe(no_mangle)]
pub extern "C" fn translux_status_name(status: i32) -> *const c_char {
    name_of(status).as_ptr()
}

/// Reads a whole asset, checks all of it, and stores it in `asset`. `bytes` are not needed afterwards. Whatever `length` bytes there are, the
/// answer is an asset or an error, and takes no more than `max_decoded_bytes` and 2 MiB of memory beside them; irradiance rows and
/// far fields, which are decoded when they are first asked for, take as much again.
///
/// # Safety
/// `bytes` has `length` readable bytes, `asset` and `error` can be written, or are null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_open(
    bytes: *const u8,
    length: usize,
    max_decoded_bytes: u64,
    asset: *mut *mut Asset,
    error: *mut Error,
) -> Status {
    guarded(error, || {
        // SAFETY: the caller's promise.
        let bytes = unsafe { bytes_of(bytes, length) }?;
        if asset.is_null() {
            return Err(Fault::null("asset"));
        }
        let opened = Box::new(Asset::open(bytes, Budget::bytes(max_decoded_bytes))?);
        // SAFETY: not null, and the caller's promise.
        unsafe { asset.write(Box::into_raw(opened)) };
        Ok(())
    })
}

/// Frees an asset and everything that was borrowed from it. Null is allowed.
///
/// # Safety
/// `asset` comes from `translux_open` and was not closed before, or is null; nothing borrowed from it is used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_close(asset: *mut Asset) {
    guarded(std::ptr::null_mut(), || {
        if !asset.is_null() {
            // SAFETY: by the caller's promise the pointer is that of a box which nobody else has.
            drop(unsafe { Box::from_raw(asset) });
        }
        Ok(())
    });
}

/// What the asset is, and how much of it there is.
///
/// # Safety
/// `asset` is open; `out` and `error` can be written; or they are null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_info(asset: *const Asset, out: *mut Info, error: *mut Error) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.info()) })
}

/// The mesh.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_mesh(asset: *const Asset, out: *mut Mesh, error: *mut Error) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.mesh()) })
}

/// The part with this index, below `TransluxInfo.parts`.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_part(asset: *const Asset, index: usize, out: *mut Part, error: *mut Error) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.part(index)?) })
}

/// The medium with this index, below `TransluxInfo.media`.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_medium(
    asset: *const Asset,
    index: usize,
    out: *mut Medium,
    error: *mut Error,
) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.medium(index)?) })
}

/// The surface samples.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_samples(asset: *const Asset, out: *mut Samples, error: *mut Error) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.samples()) })
}

/// Irradiance of every patch over a cube map, decoded by the first call; `TRANSLUX_STATUS_ABSENT` where the asset has none.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_irradiance_rows(
    asset: *const Asset,
    out: *mut IrradianceRows,
    error: *mut Error,
) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.irradiance_rows()?) })
}

/// The stored far field of a profile basis, decoded by the first call; `TRANSLUX_STATUS_ABSENT` where the asset has none.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_far_field(asset: *const Asset, out: *mut FarField, error: *mut Error) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.far_field()?) })
}

/// From a row of a far field's coefficients to the values of the receivers of its group: undoes the orthonormal Haar transform over the lanes.
/// Both have `TRANSLUX_LANES` numbers and may be the same array.
///
/// # Safety
/// `coefficients` can be read and `values` written, so many numbers, or they are null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_over_lanes(coefficients: *const f32, values: *mut f32, error: *mut Error) -> Status {
    guarded(error, || {
        if coefficients.is_null() {
            return Err(Fault::null("coefficients"));
        }
        // SAFETY: not null, and the caller's promise, in both.
        unsafe {
            write(values.cast::<[f32; LANES]>(), far_field::over_lanes(coefficients.cast::<[f32; LANES]>().read()))
        }
    })
}

/// The section of the asset's method with this index, below `TransluxInfo.sections`, in the order of the file.
///
/// # Safety
/// As `translux_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_section(
    asset: *const Asset,
    index: usize,
    out: *mut Section,
    error: *mut Error,
) -> Status {
    // SAFETY: the caller's promise, in both.
    guarded(error, || unsafe { write(out, borrowed(asset)?.section(index)?) })
}

/// The section of the asset's method with this tag, a text of 1 to 8 characters ended by a zero; `TRANSLUX_STATUS_ABSENT` where there is none.
/// Those that all assets have (mesh, parts, samples, provenance, ledger) are not among them.
///
/// # Safety
/// As `translux_info`; `tag` ends with a zero, or is null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn translux_find_section(
    asset: *const Asset,
    tag: *const c_char,
    out: *mut Section,
    error: *mut Error,
) -> Status {
    guarded(error, || {
        // SAFETY: the caller's promise.
        let asset = unsafe { borrowed(asset) }?;
        if tag.is_null() {
            return Err(Fault::null("tag"));
        }
        // SAFETY: not null, and the caller's promise.
        let text = unsafe { CStr::from_ptr(tag) }.to_str().ok();
        let found = text.and_then(Tag::new).and_then(|tag| asset.find(tag));
        // SAFETY: the caller's promise.
        unsafe { write(out, found.ok_or_else(|| Fault::absent("no section of the method has this tag"))?) }
    })
}
