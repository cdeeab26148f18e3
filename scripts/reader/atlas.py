"""Texture atlases (formats/spec/atlas.md)."""

import numpy as np

from coding import Stream
from container import need


def signed(stream, name):
    value = stream.magnitude((name, "l"), (name, "m"))
    return -value if value and stream.bit((name, "s")) else value


def wedges(data, triangles):
    """The wedge of every corner, and how many there are."""
    stream = Stream(data)
    of_vertex, last, count = {}, {}, 0
    result = np.zeros(triangles.shape, dtype=np.int64)
    for t, corners in enumerate(triangles):
        before = 0
        for k, v in enumerate(corners):
            mine = of_vertex.setdefault(v, [])
            if not mine:
                mine.append(count)
                last[v], count = count, count + 1
            else:
                c = len(mine)
                other = stream.bit(("other", before, min(c, 3)))
                before = 1 + other
                if other:
                    low, high = signed(stream, "low"), signed(stream, "high")
                    number = c - (low + 65536 * high)
                    need(0 <= number <= c, "a wedge")
                    if number == c:
                        mine.append(count)
                        count += 1
                    need(mine[number] != last[v], "the wedge that was used last")
                    last[v] = mine[number]
            result[t, k] = last[v]
    stream.end()
    return result, count


def places(data, corners, count):
    """u and v of every wedge, in 1/65535."""
    stream = Stream(data)
    across, around = {}, [[] for _ in range(count)]
    for t, w in enumerate(corners):
        for k in range(3):
            across.setdefault(frozenset((w[(k + 1) % 3], w[(k + 2) % 3])), []).append((t, w[k]))
        for wedge in dict.fromkeys(w):
            around[wedge].append(t)
    for list_of in across.values():
        list_of.sort()
    known = np.zeros((count, 2), dtype=np.int64)
    for w in range(count):
        found, beside, size = [], [], 0
        for t in around[w]:
            k = list(corners[t]).index(w)
            a, b = (int(corners[t][(k + i) % 3]) for i in (1, 2))
            beside += [x for x in (a, b) if x < w]
            if a < w and b < w:
                others = [c for triangle, c in across[frozenset((a, b))][:2] if triangle != t and c < w]
                if others:
                    c = others[0]
                    found.append(known[a] + known[b] - known[c])
                    size = max(size, np.abs(known[a] - known[b]).max(), np.abs(known[a] - known[c]).max())
        if found:
            kind, bits, expected = 0, min(16, int(size).bit_length()), mean(found)
        elif beside:
            kind, bits, expected = 1, 0, mean([known[x] for x in beside])
        else:
            kind, bits, expected = 2, 0, known[w - 1] if w else np.zeros(2, dtype=np.int64)
        for axis in range(2):
            known[w, axis] = expected[axis] + signed(stream, (kind, bits, axis))
        need(((known[w] >= 0) & (known[w] <= 65535)).all(), "a place")
    stream.end()
    return known


def mean(values):
    """Rounded to the nearest, halves upwards."""
    count = len(values)
    return np.clip((2 * np.sum(values, axis=0) + count) // (2 * count), 0, 65535)


class Atlas:
    """The places of the corners of every triangle, in the unit square: [triangle][corner][u, v]."""

    def __init__(self, file, scene):
        triangles = scene.weld[scene.triangles]
        corners, count = wedges(bytes(file.array("atl.crn", "u1")), triangles)
        self.places = places(bytes(file.array("atl.uvs", "u1")), corners, count)[corners] / 65535.0
        record = file.record("atl.rec")
        record.u32(), record.truth(), record.u32()
        occupancy, overlap, stretch, low, high, least = record.some(6, record.f64)
        folded = record.u32()
        record.end()
        # What the record says of the map is checked by the map.
        a, b = self.places[:, 1] - self.places[:, 0], self.places[:, 2] - self.places[:, 0]
        area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        need((area == 0).sum() == folded and 0 <= occupancy <= 1, "triangles without area in the map")
        covered = area.sum() * (1.0 - overlap)
        need(abs(covered - occupancy) < 0.02, "occupancy")
