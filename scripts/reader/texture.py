"""The form `texture_space`: light in the texels of an atlas (formats/spec/texture_space.md), with samples that are `shared` or `clusters`."""

import numpy as np

from atlas import Atlas
from container import need
from lights import Shadows, irradiance
from physics import dipoles


def clipped(polygon, axis, at, sign):
    """What of a polygon of [corner][u, v, barycentric x 3] lies on one side of a line."""
    result = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0)):
        a, b = sign * (p[axis] - at), sign * (q[axis] - at)
        if a >= 0:
            result.append(p)
        if (a >= 0) != (b >= 0):
            result.append(p + (q - p) * (a / (a - b)))
    return np.array(result)


def pieces(places, n):
    """Texels that a triangle of the map meets, with the share of its area and the barycentric centroid of each piece."""
    cell = lambda x: int(min(max(np.floor(x * n), 0), n - 1))
    a, b = places[1] - places[0], places[2] - places[0]
    whole = abs(a[0] * b[1] - a[1] * b[0])
    if whole == 0.0:
        u, v = places.mean(axis=0)
        yield (cell(u), cell(v)), 1.0, np.full(3, 1 / 3)
        return
    triangle = np.concatenate([places, np.eye(3)], axis=1)
    (u0, v0), (u1, v1) = places.min(axis=0), places.max(axis=0)
    for y in range(cell(v0), cell(v1) + 1):
        row = clipped(clipped(triangle, 1, y / n, 1), 1, (y + 1) / n, -1)
        for x in range(cell(u0), cell(u1) + 1):
            piece = clipped(clipped(row, 0, x / n, 1), 0, (x + 1) / n, -1) if len(row) else row
            if len(piece) < 3:
                continue
            area, centre = 0.0, np.zeros(3)
            for p, q in zip(piece[1:-1], piece[2:]):
                d, e = p[:2] - piece[0, :2], q[:2] - piece[0, :2]
                own = abs(d[0] * e[1] - d[1] * e[0])
                area, centre = area + own, centre + own * (piece[0] + p + q)[2:] / 3.0
            if area > 0.0:
                yield (x, y), area / whole, centre / area


def morton(x, y):
    return sum((x >> bit & 1) << 2 * bit | (y >> bit & 1) << 2 * bit + 1 for bit in range(16))


def mean_square(places, texel, n, corners, centre):
    """Of the distance of a piece's points from its centroid: 0 for a triangle without area in the map."""
    a, b = places[1] - places[0], places[2] - places[0]
    if a[0] * b[1] - a[1] * b[0] == 0.0:
        return ((corners - centre) ** 2).sum() / 12.0
    piece = np.concatenate([places, np.eye(3)], axis=1)
    for axis in (1, 0):
        piece = clipped(clipped(piece, axis, texel[axis] / n, 1), axis, (texel[axis] + 1) / n, -1)
    at = piece[:, 2:] @ corners - centre
    moment = area = 0.0
    for p, q in zip(at[1:-1], at[2:]):
        own = np.linalg.norm(np.cross(p - at[0], q - at[0]))
        moment += own * ((at[0] ** 2).sum() + (p**2).sum() + (q**2).sum() + ((at[0] + p + q) ** 2).sum()) / 12.0
        area += own
    return moment / area


def drawn(sums, weight, middle, count):
    """Shared samples: places and flux."""
    total = weight.sum()
    chosen = np.searchsorted(np.cumsum(weight), (np.arange(count) + 0.5) / count * total, side="right")
    return middle[chosen], sums[chosen] / weight[chosen][:, None] * total / count


def boxes(order, places):
    """The texels in the order of the hierarchy of boxes."""
    if len(order) <= 1:
        return order
    half = 1 << (len(order) - 1).bit_length() - 1
    extent = places[order].max(axis=0) - places[order].min(axis=0)
    axis = int(np.argmax(extent))
    order = sorted(order, key=lambda i: (places[i][axis], i))
    return boxes(order[:half], places) + boxes(order[half:], places)


def clusters(sums, middle, moment, order, count):
    """Nodes that hold all light, the ones with the largest second moments opened first."""
    # Flux, mean place and second moment; nodes below.
    level = [(sums[i], middle[i], moment[i], ()) for i in order]
    while len(level) > 1:
        above = []
        for pair in (level[i:i + 2] for i in range(0, len(level), 2)):
            lit = [node for node in pair if node[0].sum() > 0]
            flux = sum((node[0] for node in pair), np.zeros(3))
            if not lit:
                above.append((flux, np.zeros(3), 0.0, ()))
                continue
            at = sum(node[0].sum() * node[1] for node in lit) / flux.sum()
            spread = sum(node[2] + node[0].sum() * ((node[1] - at) ** 2).sum() for node in lit)
            above.append((flux, at, spread, tuple(lit)))
        level = above
    opened, closed = [level[0]], []
    while opened:
        node = opened.pop(max(range(len(opened)), key=lambda i: opened[i][2]))
        if not node[3] or len(opened) + len(closed) + len(node[3]) > count:
            closed.append(node)
        else:
            opened += node[3]
    return np.array([node[1] for node in closed]), np.array([node[0] for node in closed])


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    record = file.record("form.set")
    record.f64(), record.u32(), record.u32(), record.u32(), record.option(record.u32)
    choice = record.u32()
    need(choice < 2, "samples that this reader does not draw")
    record = file.record("tex.rec")
    n, count, _ = record.u32(), record.u32(), record.u32()
    record.end()
    atlas = Atlas(file, scene)
    parts = {part: [] for part in range(len(scene.parts)) if scene.transfers(part)}
    for t, part in enumerate(scene.triangle_part):
        for (x, y), share, centre in pieces(atlas.places[t], n) if part in parts else ():
            corners = scene.local[scene.triangles[t]]
            spread = mean_square(atlas.places[t], (x, y), n, corners, centre @ corners) if choice else 0.0
            parts[part].append((morton(x, y), t, share * scene.areas[t], centre @ corners, spread))
    shadows = Shadows(scene.local[scene.triangles])
    vertices = scene.vertex_parts()

    def radiosity(lights):
        result = np.zeros((len(scene.local), 3))
        for part, patches in parts.items():
            medium = scene.medium_of(part)
            key, triangle = np.array([p[0] for p in patches]), np.array([p[1] for p in patches])
            area, place = np.array([p[2] for p in patches]), np.array([p[3] for p in patches])
            light = sum(irradiance(l, place, scene.normals[triangle], triangle, medium.eta, shadows) for l in lights)
            flux = light * area[:, None]
            texel, first, of_patch = np.unique(key, return_index=True, return_inverse=True)
            sums = np.stack([np.bincount(of_patch, flux[:, k]) for k in range(3)], axis=1)
            weight = sums.sum(axis=1)
            middle = np.stack([np.bincount(of_patch, flux.sum(axis=1) * place[:, k]) for k in range(3)], axis=1)
            middle /= np.where(weight > 0, weight, 1.0)[:, None]
            if choice == 0:
                at, colour = drawn(sums, weight, middle, count)
            else:
                apart = ((place - middle[of_patch]) ** 2).sum(axis=1) + np.array([p[4] for p in patches])
                moment = np.bincount(of_patch, flux.sum(axis=1) * apart)
                at, colour = clusters(sums, middle, moment, boxes(list(range(len(texel))), place[first]), count)
            mine = [v for v, p in enumerate(vertices) if p == part]
            squares = ((scene.local[mine][:, None] - at[None]) ** 2).sum(axis=2)
            for k, profile in enumerate(dipoles(medium)):
                result[mine, k] = profile.at_square(squares) @ colour[:, k]
        return result

    return radiosity
