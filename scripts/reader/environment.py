"""Light from far away as a cube map, and rows of irradiance over it (formats/spec/environment_rows.md)."""

import re

import numpy as np

from container import need
from physics import fresnel_integral

PIECES = 16


def read_hdr(path):
    """A Radiance picture of plain pixels, top row first: [row][column][channel]."""
    head, body = open(path, "rb").read().split(b"\n\n", 1)
    need(b"FORMAT=32-bit_rle_rgbe" in head, "a Radiance picture")
    size, body = body.split(b"\n", 1)
    height, width = (int(v) for v in re.fullmatch(rb"-Y (\d+) \+X (\d+)", size).groups())
    need(len(body) == 4 * width * height, "plain pixels")
    rgbe = np.frombuffer(body, dtype="u1").reshape(height, width, 4)
    return rgbe[..., :3] * 2.0 ** (rgbe[..., 3:].astype(np.int64) - 136)


def solid_angles(n):
    """Of the texels of a face, [row][column]."""
    edge = 2.0 * np.arange(n + 1) / n - 1.0
    s, t = edge[None, :], edge[:, None]
    corner = np.arctan2(s * t, np.sqrt(s * s + t * t + 1.0))
    return corner[1:, 1:] + corner[:-1, :-1] - corner[1:, :-1] - corner[:-1, 1:]


def texels(n, direction):
    """Index of the texel that each direction falls on."""
    x, y, z = direction.T
    ax, ay, az = np.abs(direction).T
    on_x, on_y = (ax >= ay) & (ax >= az), ay >= az
    face = np.where(on_x, 0 + (x < 0), np.where(on_y, 2 + (y < 0), 4 + (z < 0)))
    s = np.choose(face, [-z, z, x, x, x, -x])
    t = np.choose(face, [-y, -y, z, -z, -y, -y])
    length = np.where(on_x, ax, np.where(on_y, ay, az))
    cell = lambda u: np.minimum((0.5 * (u / length + 1.0) * n).astype(np.int64), n - 1)
    return (face * n + cell(t)) * n + cell(s)


def centres(n):
    """Directions of the centres of all texels."""
    at = (2.0 * np.arange(n) + 1.0) / n - 1.0
    t, s = np.meshgrid(at, at, indexing="ij")
    one = np.ones_like(s)
    faces = [(one, -t, -s), (-one, -t, s), (s, one, t), (s, -one, -t), (s, -t, one), (-s, -t, -one)]
    all_faces = np.concatenate([np.stack(face, axis=2).reshape(-1, 3) for face in faces])
    return all_faces / np.linalg.norm(all_faces, axis=1, keepdims=True)


def of_map_with_centres(pixels, rotate_degrees, n, pieces=2):
    """Energy of each texel, and the sum of the directions that it comes from, weighted by the sum of its channels: every pixel is
    constant, and cut into pieces that fall on one texel each."""
    height, width, _ = pixels.shape
    across, down = -(-4 * n * pieces // width), -(-2 * n * pieces // height)
    longitude = 2.0 * np.pi * (0.5 - (np.arange(width * across) + 0.5) / (width * across)) + np.radians(rotate_degrees)
    energy, centre = np.zeros((6 * n * n, 3)), np.zeros((6 * n * n, 3))
    step = np.pi / (height * down)
    for row in range(height * down):
        polar = (row + 0.5) * step
        angle = 2.0 * np.pi / (width * across) * 2.0 * np.sin(polar) * np.sin(0.5 * step)
        direction = np.stack([np.sin(polar) * np.sin(longitude), np.full(len(longitude), np.cos(polar)),
                              np.sin(polar) * np.cos(longitude)], axis=1)
        where = texels(n, direction)
        colours = angle * np.repeat(pixels[row // down], across, axis=0)
        for k in range(3):
            energy[:, k] += np.bincount(where, colours[:, k], minlength=6 * n * n)
            centre[:, k] += np.bincount(where, colours.sum(axis=1) * direction[:, k], minlength=6 * n * n)
    return energy, centre


def of_map(pixels, rotate_degrees, n):
    """Mean radiance of each texel, [texel][channel]."""
    energy, _ = of_map_with_centres(pixels, rotate_degrees, n, PIECES)
    return energy / np.tile(solid_angles(n).ravel(), 6)[:, None]


def mean_radiance(light, n):
    """A light from far away on a cube map."""
    kind, what, colour = light
    if kind == "constant":
        return np.tile(colour, (6 * n * n, 1))
    if kind == "directional":
        result = np.zeros((6 * n * n, 3))
        place = texels(n, what[None])[0]
        result[place] = colour / solid_angles(n).ravel()[place % (n * n)]
        return result
    need(kind == "env", f"a {kind} light on a cube map")
    return of_map(what[0], what[1], n) * colour


def transform(faces, weights):
    """The Haar transform of [face][row][column], weighted: the numbers of the last level and the details in their places."""
    faces = faces.copy()
    m = faces.shape[-1]
    weights = np.array(weights, dtype=np.float64)
    while m > 1:
        block = faces[:, :m, :m]
        u, v = weights[:, 0::2], weights[:, 1::2]
        a, b = block[:, :, 0::2], block[:, :, 1::2]
        sums, differences = (np.sqrt(u) * a + np.sqrt(v) * b) / np.sqrt(u + v), (np.sqrt(v) * a - np.sqrt(u) * b) / np.sqrt(u + v)
        of_sums = u + v
        p, q = of_sums[0::2], of_sums[1::2]
        a, b = sums[:, 0::2], sums[:, 1::2]
        h = m // 2
        faces[:, :h, :h] = (np.sqrt(p) * a + np.sqrt(q) * b) / np.sqrt(p + q)
        faces[:, h:m, :h] = (np.sqrt(q) * a - np.sqrt(p) * b) / np.sqrt(p + q)
        d, e = differences[:, 0::2], differences[:, 1::2]
        faces[:, :h, h:m] = (d + e) / np.sqrt(2.0)
        faces[:, h:m, h:m] = (d - e) / np.sqrt(2.0)
        weights, m = p + q, h
    return faces


def light_coefficients(light, n, by_solid_angle=True):
    """[place][channel] of a light as rows take it."""
    radiance = mean_radiance(light, n).reshape(6, n, n, 3)
    weights = solid_angles(n) if by_solid_angle else np.ones((n, n))
    factor = np.sqrt(weights)
    parts = [transform(radiance[..., k] * factor, weights).reshape(-1) for k in range(3)]
    return np.stack(parts, axis=1)


class SparseRows:
    """Rows of coefficients at few places of a cube map; `tag(x)` names the sections."""

    def __init__(self, file, prefix, count, terms=None, steps="stp"):
        self.prefix, self.blocks = prefix, None
        if file.has(prefix + ".blk"):
            self.n, self.terms, self.blocks = (int(v) for v in file.array(prefix + ".blk", "u4", 3, 1)[0])
            need(2 <= self.blocks <= 1024, "patches of a block")
        else:
            self.n, self.terms = (int(v) for v in file.array(prefix + ".dim", "u4", 2, 1)[0])
        need(self.n in (2, 4, 8, 16, 32, 64) and 1 <= self.terms <= 4 and terms in (None, self.terms), "dimensions")
        n, terms = self.n, self.terms
        counts = file.array(prefix + ".cnt", "u2", 1, count).astype(np.int64)
        details = int(counts.sum())
        raw = file.array(prefix + ".idx", "u1", 1, 2 * details).astype(np.int64)
        numbers = raw[:details] | raw[details:] << 8
        self.row = np.repeat(np.arange(count), counts)
        # p[0] = number[0], p[i] = p[i - 1] + 1 + number[i] within a row.
        sums = np.cumsum(numbers + 1)
        firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        base = np.where(firsts > 0, sums[np.maximum(firsts, 1) - 1], 0) if details else np.zeros(count, dtype=np.int64)
        self.place = sums - 1 - base[self.row]
        need((self.place < 6 * n * n).all() and (self.place % (n * n) != 0).all(), "places")
        steps = file.array(f"{prefix}.{steps}", "f4", 1, count).astype(np.float64)
        values = file.array(prefix + ".val", "i1", 1, terms * details).astype(np.float64).reshape(terms, details)
        self.value = values * steps[self.row]
        raw = file.array(prefix + ".sca", "u1", 1, 12 * terms * count).astype(np.uint16)
        half = 6 * terms * count
        scaling = (raw[:half] | raw[half:] << 8).astype(np.uint16).view(np.int16).astype(np.float64).reshape(terms, 6, count)
        self.scaling = scaling * file.array(prefix + ".scs", "f4", 1, count).astype(np.float64)
        self.count = count

    def times(self, light):
        """Sum over places of coefficient times light, [row][term][channel], for light of [place][channel]."""
        result = np.zeros((self.count, self.terms, 3))
        faces = light[:: self.n * self.n]
        for term in range(self.terms):
            result[:, term] = self.scaling[term].T @ faces
            for channel in range(3):
                product = self.value[term] * light[self.place, channel]
                result[:, term, channel] += np.bincount(self.row, product, minlength=self.count)
        return result


class EnvironmentRows(SparseRows):
    """Irradiance of the patches under light from far away."""

    def __init__(self, file, scene, count):
        super().__init__(file, "rows", count)
        self.functions = file.array("rows.fun", "f8", 9, self.terms)
        self.scene = scene

    def irradiance(self, light, etas):
        """Of every patch, RGB; `etas` are those of the parts."""
        products = self.times(light_coefficients(light, self.n))
        ends = self.scene.part_ends
        result = np.zeros((self.count, 3))
        for part, eta in enumerate(etas):
            a, b = int(ends[part]), int(ends[part + 1])
            if eta is not None and b > a:
                result[a:b] = np.einsum("j,ijk->ik", self.of_eta(eta), products[a:b])
                if self.blocks:
                    self._down(result, a, b, None)
        return result

    def _down(self, values, a, b, mean):
        """From means and differences of a piece to its patches; `mean` is None above the blocks."""
        if mean is None and b - a <= self.blocks:
            mean = values[a].copy()
        if b - a == 1:
            values[a] = mean
            return
        h = a + (b - a + 1) // 2
        left = right = None
        if mean is not None:
            u, v = h - a, b - h
            left, right = mean + values[h] * v / (u + v), mean - values[h] * u / (u + v)
        self._down(values, a, h, left)
        self._down(values, h, b, right)

    def of_eta(self, eta):
        """c_j: F_t(eta, mu) mu in the functions of the rows."""
        f = [np.polynomial.Polynomial(np.concatenate([[0.0], row])) for row in self.functions]
        q = np.array([(p * p).integ()(1.0) for p in f])
        g = np.array([p.integ()(1.0) for p in f])
        need((q > 0).all() and (g * g / q).sum() > 1e-3, "functions of the angle")
        b = np.array([fresnel_integral(eta, p) for p in f]) / q
        total = fresnel_integral(eta, lambda mu: 1.0)
        return b + (total - b @ g) / (g * g / q).sum() * g / q
