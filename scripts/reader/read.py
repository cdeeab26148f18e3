#!/usr/bin/env python3
"""A second reader of .tlux files, written from formats/SPEC.md and its parts; it shares nothing with the crates.

    read.py ASSET [--most 1e-4] --case LIGHT[+LIGHT...] GOLDEN.ply [--case ...]

decodes the asset, computes the radiosity of its vertices slowly and plainly, and fails where that is farther from the PLY's than
`--most`: the RMS of the difference over that of the PLY, of the worst channel. Lights are separated by `+`. Without cases it decodes
the asset, which may be of a version that did not name its form.
"""

import argparse
import sys

import numpy as np

import distant
import factored
import gathered
import normals
import projected
import texture
from container import Bad, File, Provenance, Scene
from lights import parse

FORMS = {
    "factored": factored.open_form,
    "filtered_normals": normals.open_form,
    "gathered": gathered.open_form,
    "harmonics": distant.open_form,
    "quantised_lights": projected.open_form,
    "rows": distant.open_form,
    "texture_space": texture.open_form,
}


def read_ply(path):
    """b_r, b_g, b_b of the vertices of a binary PLY, and s_r, s_g, s_b where they are there."""
    data = open(path, "rb").read()
    head, body = data.split(b"end_header\n", 1)
    fields, count, of_vertex = [], 0, False
    types = {"float": "<f4", "uchar": "u1", "int": "<i4"}
    for words in (line.split() for line in head.decode().splitlines()):
        if words[0] == "element":
            of_vertex = words[1] == "vertex"
            count = int(words[2]) if of_vertex else count
        elif words[0] == "property" and of_vertex:
            fields.append((words[2], types[words[1]]))
    table = np.frombuffer(body, dtype=fields, count=count)
    triple = lambda *names: np.stack([table[name] for name in names], axis=1).astype(np.float64)
    single = triple("s_r", "s_g", "s_b") if "s_r" in table.dtype.names else None
    return triple("b_r", "b_g", "b_b"), single


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("asset")
    arguments.add_argument("--case", action="append", nargs=2, default=[], metavar=("LIGHTS", "GOLDEN"))
    arguments.add_argument("--most", type=float, default=1e-4)
    given = arguments.parse_args()
    file = File(given.asset)
    scene, provenance = Scene(file), Provenance(file)
    scene.facet_corners()
    print(f"method {provenance.method}, {len(provenance.settings)} settings, {len(provenance.ledger)} entries in the ledger")
    if not file.has("form.nam") and not given.case:
        return 0
    record = file.record("form.nam")
    form = record.string()
    record.end()
    if form not in FORMS:
        raise Bad(f"form {form}")
    radiosity, single = FORMS[form](file, scene), distant.open_single(file, scene)
    worst = 0.0
    for lights, path in given.case:
        # Places are without the origin, as positions are.
        lights = [parse(light) for light in lights.split("+")]
        lights = [(kind, where - scene.origin if kind == "point" else where, colour) for kind, where, colour in lights]
        golden, golden_single = read_ply(path)
        worst = max(worst, difference(f"{form}, {path}", radiosity(lights), golden))
        if (single is None) != (golden_single is None):
            raise Bad("light that is scattered once is on one side alone")
        if single is not None:
            worst = max(worst, difference(f"single scattering, {path}", single(lights), golden_single))
    return 0 if worst <= given.most else 1


def difference(what, mine, golden):
    """Relative RMS of the worst channel."""
    if mine.shape != golden.shape or not np.isfinite(mine).all() or not golden.any():
        raise Bad(f"{what}: nothing to compare")
    rms = np.sqrt(((mine - golden) ** 2).mean(axis=0) / (golden**2).mean(axis=0)).max()
    print(f"{what}: {rms:.2e} RMS, worst vertex {np.abs(mine - golden).max() / golden.max():.2e}")
    return rms


if __name__ == "__main__":
    try:
        sys.exit(main())
    except Bad as error:
        print(f"{sys.argv[1]}: {error}", file=sys.stderr)
        sys.exit(2)
