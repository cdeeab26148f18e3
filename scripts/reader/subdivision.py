"""Samples that a file names by the rule of "Samples that are made again" (formats/spec/samples.md)."""

import heapq
import zlib

import numpy as np

from checks import need

UNITS = float(2**52)


def areas_of(corners):
    """Areas of triangles, [triangle][corner][axis], every operation in the order of the page."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    x = u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1]
    y = u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2]
    z = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    return 0.5 * np.sqrt((x * x + y * y) + z * z)


def longest_axis(points):
    extent = points.max(axis=0) - points.min(axis=0)
    return int(np.argmax(extent))


class Subdivision:
    """Clusters of triangles and pieces of them; `items` are triangles, those of a part together."""

    def __init__(self, scene):
        transfers = np.array([scene.transfers(part) for part in range(len(scene.parts))] + [False])
        part = np.where(scene.triangle_part < len(scene.parts), scene.triangle_part, len(scene.parts))
        of_parts = np.flatnonzero(transfers[part])
        areas = areas_of(scene.local[scene.triangles[of_parts]])
        total = 0.0
        for area in areas:
            total += area
        with np.errstate(invalid="ignore", divide="ignore"):
            units = np.nan_to_num(np.floor(areas / total * UNITS))
        order = np.argsort(part[of_parts], kind="stable")
        self.triangle, self.units = of_parts[order], units[order].astype(np.int64)
        corners = scene.local[scene.triangles[self.triangle]]
        self.centroid = ((corners[:, 0] + corners[:, 1]) + corners[:, 2]) / 3.0
        self.nodes, self.roots = [], []
        parts = part[self.triangle]
        for index in np.unique(parts):
            first, end = np.searchsorted(parts, index), np.searchsorted(parts, index, side="right")
            self.roots.append(int(index))
            self.nodes.append(self.cluster(np.arange(first, end)))

    def cluster(self, items):
        return [float(self.units[items].sum()), items, None, None]

    def key(self, index, own_triangles):
        area, items, _, _ = self.nodes[index]
        is_cluster = items is not None and len(items) > 1
        return (not (own_triangles and is_cluster), -area, index)

    def split_until(self, count):
        own_triangles = count >= len(self.triangle)
        heap = [self.key(index, own_triangles) for index in range(len(self.nodes))]
        heapq.heapify(heap)
        leaves = len(heap)
        while leaves < count and heap:
            index = heapq.heappop(heap)[2]
            children = self.children(index)
            if children is None:
                continue
            first = len(self.nodes)
            self.nodes[index][3] = first
            self.nodes += children
            for child in (first, first + 1):
                heapq.heappush(heap, self.key(child, own_triangles))
            leaves += 1

    def children(self, index):
        area, items, facet, _ = self.nodes[index]
        if items is not None and len(items) > 1:
            axis = longest_axis(self.centroid[items])
            items = items[np.lexsort((self.triangle[items], self.centroid[items, axis]))]
            before = np.concatenate(([0], np.cumsum(self.units[items])[:-1]))
            low = int(np.searchsorted(2 * before, before[-1] + self.units[items[-1]], side="right")) - 1
            middle = min(max(low + 1, 1), len(items) - 1)
            return [self.cluster(items[:middle]), self.cluster(items[middle:])]
        triangle, path = facet if items is None else (int(self.triangle[items[0]]), 1)
        if path >= 1 << 30:
            return None
        return [[0.5 * area, None, (triangle, path << 1 | bit), None] for bit in (0, 1)]

    def patches(self):
        """Facets of every patch of each part, depth first."""
        for root, part in enumerate(self.roots):
            found, stack = [], [root]
            while stack:
                _, items, facet, first = self.nodes[stack.pop()]
                if first is not None:
                    stack += [first + 1, first]
                elif items is None:
                    found.append([facet])
                else:
                    found.append([(int(triangle), 1) for triangle in sorted(self.triangle[items])])
            yield part, found


def centre(scene, facets):
    moment, total = np.zeros(3), 0.0
    for triangle, path in facets:
        corners = np.array(scene._corners(triangle, path))
        area = areas_of(corners[None])[0]
        moment = moment + area / 3.0 * ((corners[0] + corners[1]) + corners[2])
        total += area
    return moment / total if total > 0.0 else np.zeros(3)


def in_tree_order(centres, patches):
    """Halves by number along the longest axis, the first the larger."""
    if len(patches) <= 1:
        return list(patches)
    axis = longest_axis(centres[patches])
    order = patches[np.lexsort((patches, centres[patches, axis]))]
    half = (len(order) + 1) // 2
    # Within a half the order does not matter: it is split again.
    return in_tree_order(centres, np.sort(order[:half])) + in_tree_order(centres, np.sort(order[half:]))


def samples(scene, rule, part_ends):
    """Facets and ends of patches, as `samp.fac` and `samp.off` would have them."""
    order, checksum = (int(x) for x in rule)
    need(order <= 1, "order of samples")
    subdivision = Subdivision(scene)
    subdivision.split_until(int(part_ends[-1]))
    facets, ends, ends_of_parts = [], [0], [0] * (len(scene.parts) + 1)
    for part, patches in subdivision.patches():
        if order == 1:
            centres = np.array([centre(scene, patch) for patch in patches])
            patches = [patches[i] for i in in_tree_order(centres, np.arange(len(patches)))]
        for patch in patches:
            facets += patch
            ends.append(len(facets))
        for later in range(part + 1, len(ends_of_parts)):
            ends_of_parts[later] = len(ends) - 1
    facets, ends = np.array(facets, dtype="<u4").reshape(-1, 2), np.array(ends, dtype="<u4")
    crc = zlib.crc32(np.array(ends_of_parts, dtype="<u4").tobytes(), zlib.crc32(ends.tobytes(), zlib.crc32(facets.tobytes())))
    need(crc == checksum, "checksum of samples that are made again")
    return facets.astype(np.int64), ends.astype(np.int64)
