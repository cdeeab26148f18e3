/* translux.h: .tlux assets for C and whatever speaks its ABI. Made of formats/c/src by its test; not edited by hand.
 *
 * Everything that is borrowed from an asset lives until `translux_close`. An asset never changes: any number of threads may read it at once.
 * Where a function fails it writes nothing but its error. Arrays without elements are NULL. Lengths are mm, coefficients 1/mm, colours
 * linear sRGB; texts are UTF-8 with a length and no zero at their end. formats/SPEC.md says what the numbers mean.
 */

#ifndef TRANSLUX_H
#define TRANSLUX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// An index that is none: the part of a triangle without one, the medium of an opaque part, the receiver of a vertex without one.
#define TRANSLUX_NONE UINT32_MAX

// Neighbouring receivers in a row of a far field.
#define TRANSLUX_LANES 16

// Bytes of a section's tag, its zero included.
#define TRANSLUX_TAG_BYTES 9

// Bytes of a message, its zero included.
#define TRANSLUX_MESSAGE_BYTES 512

// Version of this interface, raised when a program that was compiled with an earlier header would no longer work.
#define TRANSLUX_ABI 1

// Budget in bytes that suits most assets, for `translux_open`.
#define TRANSLUX_DEFAULT_BUDGET 2147483648

// The result of a call. 1 to 99 are the errors of the format (`formats/SPEC.md`), whose numbers never change their meaning.
enum TransluxStatus
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // Done.
  TRANSLUX_STATUS_OK = 0,
  // The bytes do not begin with the magic.
  TRANSLUX_STATUS_BAD_MAGIC = 1,
  // The bytes end inside the header or the directory.
  TRANSLUX_STATUS_TOO_SHORT = 2,
  // Written by an incompatible version.
  TRANSLUX_STATUS_UNSUPPORTED_VERSION = 3,
  // The header states another length.
  TRANSLUX_STATUS_FILE_LENGTH = 4,
  // Header and directory do not match their checksum.
  TRANSLUX_STATUS_HEADER_CHECKSUM = 5,
  // A byte that must be zero is not.
  TRANSLUX_STATUS_NOT_ZERO = 6,
  // More sections than the format allows.
  TRANSLUX_STATUS_TOO_MANY_SECTIONS = 7,
  // A tag is empty or has characters that tags may not have.
  TRANSLUX_STATUS_BAD_TAG = 8,
  // Two sections have one tag.
  TRANSLUX_STATUS_DUPLICATE_TAG = 9,
  // A code of the directory has no meaning.
  TRANSLUX_STATUS_UNKNOWN_CODE = 10,
  // A section is not where it must be.
  TRANSLUX_STATUS_OFFSET = 11,
  // A section ends beyond the file, or the file goes on after the last one.
  TRANSLUX_STATUS_SECTION_END = 12,
  // The lengths of a section contradict each other.
  TRANSLUX_STATUS_SECTION_LENGTH = 13,
  // Decoding takes more memory than the budget.
  TRANSLUX_STATUS_OVER_BUDGET = 14,
  // The machine has no memory for a section.
  TRANSLUX_STATUS_OUT_OF_MEMORY = 15,
  // A section does not match its checksum.
  TRANSLUX_STATUS_SECTION_CHECKSUM = 16,
  // Compressed bytes are damaged, or this library was built without the means to read them.
  TRANSLUX_STATUS_COMPRESSION = 17,
  // A section that must be there is not.
  TRANSLUX_STATUS_MISSING_SECTION = 18,
  // A section holds another type, width or kind.
  TRANSLUX_STATUS_WRONG_TYPE = 19,
  // A record does not parse.
  TRANSLUX_STATUS_RECORD = 20,
  // A section parses and its content is not valid.
  TRANSLUX_STATUS_INVALID = 21,
  // The asset is whole and has nothing of the kind.
  TRANSLUX_STATUS_ABSENT = 100,
  // A pointer that must not be null is.
  TRANSLUX_STATUS_NULL_ARGUMENT = 101,
  // An index or a length is beyond its end.
  TRANSLUX_STATUS_OUT_OF_RANGE = 102,
  // A fault of the library.
  TRANSLUX_STATUS_INTERNAL = 103,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum TransluxStatus TransluxStatus;
#else
typedef int32_t TransluxStatus;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// An open asset. It never changes, but for what it decodes when it is first asked for, once for all threads.
typedef struct TransluxAsset TransluxAsset;

// What a failed call has to say. A call that succeeds leaves it alone.
typedef struct {
  // The same as the call's result.
  TransluxStatus status;
  // Tag of the section at fault, ended by a zero; empty where the error concerns none.
  char section[TRANSLUX_TAG_BYTES];
  // One line of UTF-8 for people, ended by a zero; cut where it is longer.
  char message[TRANSLUX_MESSAGE_BYTES];
} TransluxError;

// UTF-8 without a zero at its end: `printf("%.*s", (int)text.length, text.data)`.
typedef struct {
  // Its bytes; null where there are none.
  const char *data;
  // Number of bytes.
  size_t length;
} TransluxText;

// What an asset is, and how much of it there is.
typedef struct {
  // Name of the method that made it.
  TransluxText method;
  // Name of the form that its transport is kept in; empty where the file says none that is a text.
  TransluxText form;
  // Revision of the algorithms that made it.
  uint32_t algorithm_revision;
  // Number of parts.
  size_t parts;
  // Number of media.
  size_t media;
  // Number of the method's own sections.
  size_t sections;
} TransluxInfo;

// A triangle mesh in mm, vertices in the order of the source.
typedef struct {
  // World position of the local origin, in mm.
  double origin_mm[3];
  // Number of vertices.
  size_t vertices;
  // Positions relative to `origin_mm`, in mm: `vertices` rows.
  const float (*positions_mm)[3];
  // For each vertex, the first vertex at the same place.
  const uint32_t *weld;
  // Number of triangles.
  size_t triangles;
  // Corners, counter-clockwise seen from outside: `triangles` rows.
  const uint32_t (*corners)[3];
  // Part of each triangle, or `TRANSLUX_NONE`.
  const uint32_t *triangle_part;
  // Index of each triangle's material in the source.
  const uint32_t *triangle_material;
  // Number of shading normals; 0 where the mesh has none.
  size_t normals;
  // Shading normals: `normals` rows; zero where the source has none.
  const float (*normal_values)[3];
  // For each corner of each triangle, a row of `normal_values`; null where the mesh has none.
  const uint32_t (*normal_corners)[3];
  // Number of texture coordinates; 0 where the mesh has none.
  size_t uvs;
  // Texture coordinates, v up: `uvs` rows.
  const float (*uv_values)[2];
  // For each corner of each triangle, a row of `uv_values`; null where the mesh has none.
  const uint32_t (*uv_corners)[3];
} TransluxMesh;

// Triangles that light travels between inside one medium, or an opaque object that only casts shadows.
typedef struct {
  // Name for people.
  TransluxText name;
  // Index of its medium; `TRANSLUX_NONE` where an opaque part has none.
  uint32_t medium;
  // Whether it only casts shadows.
  bool opaque;
} TransluxPart;

// Optical properties of a medium, for red, green and blue.
typedef struct {
  // Name for people.
  TransluxText name;
  // Reduced scattering coefficient sigma_s' = sigma_s (1 - g), in 1/mm.
  double sigma_s_reduced_per_mm[3];
  // Absorption coefficient, in 1/mm.
  double sigma_a_per_mm[3];
  // Mean cosine of the phase function, positive forward.
  double g;
  // Refractive index inside over outside.
  double eta_inside_over_outside;
} TransluxMedium;

// Surface samples. A facet is a triangle or a piece of one, a patch (a sample) a range of facets, a part a range of patches.
typedef struct {
  // Number of patches.
  size_t patches;
  // Number of facets.
  size_t facets;
  // Triangle and path of each facet: `facets` rows. Path 1 is the whole triangle; SPEC.md names the halves that its bits select.
  const uint32_t (*facet)[2];
  // Patch `i` has the facets from `patch_offsets[i]` to `patch_offsets[i + 1]`: `patches + 1` numbers.
  const uint32_t *patch_offsets;
  // Part `p` has the patches from `part_offsets[p]` to `part_offsets[p + 1]`: one number more than parts.
  const uint32_t *part_offsets;
} TransluxSamples;

// Irradiance of every patch from light that is far away: quantised Haar coefficients over a cube map of 6 x `side` x `side`.
typedef struct {
  // Texels along an edge of a face.
  size_t side;
  // Number of functions of the angle.
  size_t terms;
  // Largest number of patches of a block; 0 where every row is its patch's own (`formats/spec/environment_rows.md`).
  size_t block;
  // Number of patches.
  size_t patches;
  // Number of coefficients of all patches.
  size_t coefficients;
  // Patch `i` has the coefficients from `offsets[i]` to `offsets[i + 1]`: `patches + 1` numbers.
  const uint32_t *offsets;
  // Position of each coefficient: `(face * side + row) * side + column`.
  const uint16_t *indices;
  // Values patch by patch, for each term those of all its coefficients: `terms * coefficients` numbers, in units of the patch's step.
  const int8_t *values;
  // Step of each patch's values.
  const float *steps;
  // First coefficient of each face: `[patches][terms][6]`, in units of the patch's scaling step.
  const int16_t *scaling;
  // Step of each patch's scaling coefficients.
  const float *scaling_steps;
  // Each term's function of the cosine with the normal: the coefficients of its powers 1 to 9, `terms` rows.
  const double (*functions)[9];
} TransluxIrradianceRows;

// A run of rows of neighbouring receivers of one part, at most `TRANSLUX_LANES`, that share a list of coefficients.
typedef struct {
  // Part whose patches the group gathers from.
  uint32_t part;
  // End of its rows, which begin where those of the group before end.
  uint32_t rows_end;
  // End of its coefficients, likewise.
  uint32_t coefficients_end;
  // Basis functions of its rows: bit `k`.
  uint16_t functions;
} TransluxGroup;

// Transport from afar of each function of a profile basis, as quantised Haar coefficients over the tree of patches
// (`formats/spec/factored.md`).
typedef struct {
  // Number of basis functions.
  size_t terms;
  // Number of vertices.
  size_t vertices;
  // Receiver of each vertex, or `TRANSLUX_NONE`: its radiosity from afar is interpolated.
  const uint32_t *receiver_of_vertex;
  // Number of receivers. Row `i` is receiver `i`'s, as far as there are receivers.
  size_t receivers;
  // Number of rows beyond those of the receivers.
  size_t others;
  // Receiver of each of these rows.
  const uint32_t *receiver_of_other;
  // Number of groups.
  size_t groups;
  // The groups.
  const TransluxGroup *group;
  // Number of coefficients.
  size_t coefficients;
  // Node of each coefficient, ascending within a group: the first patch of the node's right child.
  const uint32_t *nodes;
  // Functions that each coefficient keeps: bit `k`.
  const uint16_t *masks;
  // Those of them whose values have 16 bits.
  const uint16_t *wide_masks;
  // Step of each function's values: `terms` numbers.
  const float *steps;
  // Number of rows of 8-bit values.
  size_t narrow_rows;
  // 8-bit values: for each coefficient its functions, ascending, for each of these the Haar transform over the lanes.
  const int8_t (*narrow)[TRANSLUX_LANES];
  // Number of rows of 16-bit values.
  size_t wide_rows;
  // 16-bit values, in the same order.
  const int16_t (*wide)[TRANSLUX_LANES];
  // Sum of each row: `[receivers + others][terms]`.
  const float *row_sums;
} TransluxFarField;

// A section of the asset's method as it is in the file, decompressed.
typedef struct {
  // Its name, ended by a zero.
  char tag[TRANSLUX_TAG_BYTES];
  // Type of its numbers, by its code in SPEC.md: 0 a record, 1 `u8`, 2 `i8`, 3 `u16`, 4 `i16`, 5 `u32`, 6 `i32`, 7 `u64`, 8 `i64`,
  // 9 half, 10 float, 11 double.
  uint8_t element;
  // Purpose, by its code: 0 mesh, 1 samples, 2 method, 3 metadata, 4 environment.
  uint8_t kind;
  // Numbers in a row.
  uint16_t components;
  // Number of rows; of a record, its length in bytes.
  size_t rows;
  // Number of bytes.
  size_t length;
  // The bytes, little-endian, not aligned.
  const uint8_t *data;
} TransluxSection;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The version of the library's interface; a program compares it with the header's `TRANSLUX_ABI`.
uint32_t translux_abi(void);

// The name of a status as `formats/SPEC.md` has it, ended by a zero; `"Unknown"` for a number that is none.
const char *translux_status_name(int32_t status);

// Reads a whole asset, checks all of it, and stores it in `asset`. `bytes` are not needed afterwards. Whatever `length` bytes there are, the
// answer is an asset or an error, and takes no more than `max_decoded_bytes` and 2 MiB of memory beside them; irradiance rows and
// far fields, which are decoded when they are first asked for, take as much again.
//
// # Safety
// `bytes` has `length` readable bytes, `asset` and `error` can be written, or are null.
TransluxStatus translux_open(const uint8_t *bytes,
                             size_t length,
                             uint64_t max_decoded_bytes,
                             TransluxAsset **asset,
                             TransluxError *error);

// Frees an asset and everything that was borrowed from it. Null is allowed.
//
// # Safety
// `asset` comes from `translux_open` and was not closed before, or is null; nothing borrowed from it is used any more.
void translux_close(TransluxAsset *asset);

// What the asset is, and how much of it there is.
//
// # Safety
// `asset` is open; `out` and `error` can be written; or they are null.
TransluxStatus translux_info(const TransluxAsset *asset, TransluxInfo *out, TransluxError *error);

// The mesh.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_mesh(const TransluxAsset *asset, TransluxMesh *out, TransluxError *error);

// The part with this index, below `TransluxInfo.parts`.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_part(const TransluxAsset *asset, size_t index, TransluxPart *out, TransluxError *error);

// The medium with this index, below `TransluxInfo.media`.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_medium(const TransluxAsset *asset, size_t index, TransluxMedium *out, TransluxError *error);

// The surface samples.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_samples(const TransluxAsset *asset, TransluxSamples *out, TransluxError *error);

// Irradiance of every patch over a cube map, decoded by the first call; `TRANSLUX_STATUS_ABSENT` where the asset has none.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_irradiance_rows(const TransluxAsset *asset,
                                        TransluxIrradianceRows *out,
                                        TransluxError *error);

// The stored far field of a profile basis, decoded by the first call; `TRANSLUX_STATUS_ABSENT` where the asset has none.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_far_field(const TransluxAsset *asset,
                                  TransluxFarField *out,
                                  TransluxError *error);

// From a row of a far field's coefficients to the values of the receivers of its group: undoes the orthonormal Haar transform over the lanes.
// Both have `TRANSLUX_LANES` numbers and may be the same array.
//
// # Safety
// `coefficients` can be read and `values` written, so many numbers, or they are null.
TransluxStatus translux_over_lanes(const float *coefficients,
                                   float *values,
                                   TransluxError *error);

// The section of the asset's method with this index, below `TransluxInfo.sections`, in the order of the file.
//
// # Safety
// As `translux_info`.
TransluxStatus translux_section(const TransluxAsset *asset, size_t index, TransluxSection *out, TransluxError *error);

// The section of the asset's method with this tag, a text of 1 to 8 characters ended by a zero; `TRANSLUX_STATUS_ABSENT` where there is none.
// Those that all assets have (mesh, parts, samples, provenance, ledger) are not among them.
//
// # Safety
// As `translux_info`; `tag` ends with a zero, or is null.
TransluxStatus translux_find_section(const TransluxAsset *asset,
                                     const char *tag,
                                     TransluxSection *out,
                                     TransluxError *error);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* TRANSLUX_H */
