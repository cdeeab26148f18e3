/* What an engine reads of an asset, in C: the same as engine.rs beside it, and the same text.
 *
 *   cargo build --release -p translux-c
 *   cc -std=c99 -I formats/c/include formats/examples/engine.c target/release/libtranslux_c.a -lpthread -ldl -lm -o engine
 *   ./engine A.tlux
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "translux.h"

static uint8_t *read_file(const char *path, size_t *length) {
    FILE *file = fopen(path, "rb");
    uint8_t *bytes = NULL;
    size_t room = 0;
    *length = 0;
    if (!file) return NULL;
    do {
        if (*length == room) {
            uint8_t *larger = realloc(bytes, room = room ? 2 * room : 1 << 16);
            if (!larger) break;
            bytes = larger;
        }
        *length += fread(bytes + *length, 1, room - *length, file);
    } while (!feof(file) && !ferror(file));
    if (ferror(file) || !feof(file)) {
        free(bytes);
        bytes = NULL;
    }
    fclose(file);
    return bytes;
}

static unsigned ones(const uint16_t *masks, size_t first, size_t end) {
    unsigned count = 0;
    for (; first < end; first++)
        for (uint16_t mask = masks[first]; mask; mask &= mask - 1) count++;
    return count;
}

/* A number with three decimals and an exponent, which has no zeros before it. */
static void print_number(double value) {
    char text[32];
    snprintf(text, sizeof text, "%.3e", value);
    char *exponent = strchr(text, 'e');
    *exponent = 0;
    printf("%se%d\n", text, atoi(exponent + 1));
}

/* The first coefficients of the group that the first vertex with a receiver is in: what to multiply the light's details by. */
static TransluxStatus first_vertex(const TransluxFarField *far, TransluxError *error) {
    size_t vertex = 0, index = 0;
    while (vertex < far->vertices && far->receiver_of_vertex[vertex] == TRANSLUX_NONE) vertex++;
    if (vertex == far->vertices) return TRANSLUX_STATUS_OK;
    uint32_t receiver = far->receiver_of_vertex[vertex];
    while (far->group[index].rows_end <= receiver) index++;
    uint32_t first_receiver = index ? far->group[index - 1].rows_end : 0;
    size_t first = index ? far->group[index - 1].coefficients_end : 0, end = far->group[index].coefficients_end;
    /* Values of 8 and of 16 bits lie in lists of their own, in the order of the coefficients and their functions. */
    size_t wide = ones(far->wide_masks, 0, first), narrow = ones(far->masks, 0, first) - wide;
    printf("vertex %zu is receiver %u; of its %zu coefficients:\n", vertex, (unsigned)receiver, end - first);
    for (size_t c = first; c < end && c < first + 5; c++) {
        for (size_t k = 0; k < far->terms; k++) {
            if (!(far->masks[c] >> k & 1)) continue;
            int is_wide = far->wide_masks[c] >> k & 1;
            float row[TRANSLUX_LANES];
            for (size_t lane = 0; lane < TRANSLUX_LANES; lane++)
                row[lane] = is_wide ? far->wide[wide][lane] : far->narrow[narrow][lane];
            *(is_wide ? &wide : &narrow) += 1;
            TransluxStatus status = translux_over_lanes(row, row, error);
            if (status != TRANSLUX_STATUS_OK) return status;
            float value = row[receiver - first_receiver] * far->steps[k];
            printf("  node %u function %zu: ", (unsigned)far->nodes[c], k);
            print_number(value);
        }
    }
    return TRANSLUX_STATUS_OK;
}

/* Everything that goes into an engine's buffers, as text. */
static TransluxStatus describe(const TransluxAsset *asset, TransluxError *error) {
    TransluxStatus status;
    TransluxInfo info;
    TransluxMesh mesh;
    TransluxSamples samples;
    TransluxIrradianceRows rows;
    TransluxFarField far;
    size_t welded = 0;

    if ((status = translux_info(asset, &info, error)) != TRANSLUX_STATUS_OK) return status;
    if ((status = translux_mesh(asset, &mesh, error)) != TRANSLUX_STATUS_OK) return status;
    if ((status = translux_samples(asset, &samples, error)) != TRANSLUX_STATUS_OK) return status;
    for (size_t i = 0; i < mesh.vertices; i++) welded += mesh.weld[i] == i;
    printf("method %.*s\n", (int)info.method.length, info.method.data);
    printf("mesh: %zu vertices, %zu triangles, %zu welded points\n", mesh.vertices, mesh.triangles, welded);
    for (size_t i = 0; i < info.media; i++) {
        TransluxMedium medium;
        if ((status = translux_medium(asset, i, &medium, error)) != TRANSLUX_STATUS_OK) return status;
        const double *s = medium.sigma_s_reduced_per_mm;
        printf("medium %.*s: sigma_s' [%.4f, %.4f, %.4f] 1/mm\n", (int)medium.name.length, medium.name.data, s[0], s[1], s[2]);
    }
    printf("samples: %zu\n", samples.patches);

    status = translux_irradiance_rows(asset, &rows, error);
    if (status == TRANSLUX_STATUS_OK) {
        size_t patch = sizeof *rows.steps + sizeof *rows.scaling_steps + 6 * rows.terms * sizeof *rows.scaling;
        size_t bytes = (rows.patches + 1) * sizeof *rows.offsets + rows.patches * patch +
                       rows.coefficients * (sizeof *rows.indices + rows.terms) + rows.terms * sizeof *rows.functions;
        printf("irradiance rows: cube map of 6 x %zu x %zu, %zu bytes decoded\n", rows.side, rows.side, bytes);
    } else if (status != TRANSLUX_STATUS_ABSENT) {
        return status;
    }

    status = translux_far_field(asset, &far, error);
    if (status == TRANSLUX_STATUS_ABSENT) return TRANSLUX_STATUS_OK;
    if (status != TRANSLUX_STATUS_OK) return status;
    printf("far field: %zu basis functions, %zu of %zu vertices in %zu groups of %d, %zu coefficients\n", far.terms,
           far.receivers, far.vertices, far.groups, TRANSLUX_LANES, far.coefficients);
    return first_vertex(&far, error);
}

int main(int count, char **arguments) {
    TransluxAsset *asset = NULL;
    TransluxError error;
    size_t length;
    if (count < 2) {
        fprintf(stderr, "usage: engine A.tlux\n");
        return 1;
    }
    if (translux_abi() != TRANSLUX_ABI) {
        fprintf(stderr, "engine: the library's interface is %u, the header's %d\n", (unsigned)translux_abi(), TRANSLUX_ABI);
        return 1;
    }
    uint8_t *bytes = read_file(arguments[1], &length);
    if (!bytes) {
        perror(arguments[1]);
        return 2;
    }
    /* Checksums, lengths and indices are verified here; nothing later can be out of range. */
    TransluxStatus status = translux_open(bytes, length, TRANSLUX_DEFAULT_BUDGET, &asset, &error);
    free(bytes);
    if (status == TRANSLUX_STATUS_OK) status = describe(asset, &error);
    translux_close(asset);
    if (status != TRANSLUX_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", arguments[1], error.message);
        return 3;
    }
    return 0;
}
