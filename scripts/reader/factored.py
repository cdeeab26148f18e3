"""The form `factored`: a profile basis and the far field (formats/spec/factored.md)."""

import numpy as np

from coding import Stream, scale, varint
from container import NONE, need
from gathered import Samples
from physics import dipoles, over_triangles

# Samples within so many radii are more than points, however small the split radius is.
EXTENDED = 24.0
BANDS = [0, 1, 2, 2] + [3] * 4 + [4] * 8


class Node:
    """A node of the tree over the samples of a part: samples [a, b), cut at m; leaves have none."""

    __slots__ = ("a", "b", "m")

    def __init__(self, a, b):
        self.a, self.b, self.m = a, b, a + (b - a + 1) // 2


class FarField:
    """Row sums and coefficients, decoded."""

    def __init__(self, file, scene):
        self.receiver = file.array("far.rcv", "u4", 1, len(scene.local)).astype(np.int64)
        self.groups = file.array("far.grp", "u4", 3).astype(np.int64)
        self.steps = file.array("far.stp", "f4").astype(np.float64)
        functions, groups = len(self.steps), len(self.groups)
        need(1 <= functions <= 16 and (self.steps > 0).all(), "steps")
        self.functions = functions
        whole = (1 << functions) - 1
        self.masks = file.array("far.fun", "u2", 1, groups).astype(int) if file.has("far.fun") else np.full(groups, whole)
        need((self.masks > 0).all() and (self.masks <= whole).all(), "functions of groups")
        extra = file.array("far.row", "u4").astype(np.int64) if file.has("far.row") else np.zeros(0, dtype=np.int64)
        self.row_ends = self.groups[:, 1]
        rows = int(self.row_ends[-1]) if groups else 0
        receivers = rows - len(extra)
        self.row_receiver = np.concatenate([np.arange(receivers), extra])
        self.receivers = receivers
        need((self.receiver[self.receiver != NONE] < receivers).all(), "receivers")
        # Sums: differences of the bits along the rows, byte after byte.
        planes = file.array("far.sum", "u1", 1, 4 * functions * rows).reshape(functions, 4, rows).astype(np.uint32)
        z = planes[:, 0] | planes[:, 1] << 8 | planes[:, 2] << 16 | planes[:, 3] << 24
        d = (z >> 1) ^ (0 - (z & 1)).astype(np.uint32)
        bits = np.cumsum(d, axis=1, dtype=np.uint64).astype(np.uint32)
        self.sums = bits.view(np.float32).astype(np.float64).T
        need(np.isfinite(self.sums).all(), "row sums")
        # For each group its coefficients: node, and the 16 values of each function that it keeps.
        self.coefficients = []
        if file.has("far.cod"):
            self._coded(file, scene)
        else:
            self._plain(file, scene)

    def _plain(self, file, scene):
        nodes, at = bytes(file.array("far.nod", "u1")), 0
        masks, wide = file.array("far.msk", "u2").astype(int), file.array("far.wid", "u2").astype(int)
        need(((wide & ~masks) == 0).all(), "wide functions")
        small = file.array("far.val", "i1", 16).astype(np.float64)
        big = file.array("far.big", "u1", 16).astype(np.int64).reshape(-1, 16)
        half = len(big) // 2
        z = big[:half] | big[half:] << 8
        big = ((z >> 1) ^ -(z & 1)).astype(np.float64)
        values = [dict() for _ in masks]
        for rows, kept in ((small, masks & ~wide), (big, wide)):
            at_row = 0
            for k in range(self.functions):
                for c in np.flatnonzero(kept >> k & 1):
                    values[c][k] = rows[at_row]
                    at_row += 1
            need(at_row == len(rows), "rows of values")
        first = 0
        for part, _, end in self.groups:
            last = int(scene.part_ends[part])
            mine = []
            for c in range(first, int(end)):
                step, at = varint(nodes, at)
                last += step + 1
                mine.append((last, values[c]))
            self.coefficients.append(mine)
            first = int(end)
        need(at == len(nodes) and first == len(masks), "nodes")

    def _coded(self, file, scene):
        data = bytes(file.array("far.cod", "u1"))
        count, at = varint(data, 0)
        need(count <= 4, "streams")
        heads = []
        for _ in range(count):
            groups, at = varint(data, at)
            rows, at = varint(data, at)
            length, at = varint(data, at)
            heads.append((groups, rows, length))
        first = 0
        for groups, rows, length in heads:
            found = self._stream(Stream(data[at:at + length]), scene, range(first, first + groups))
            need(found == rows, "rows of a stream")
            at, first = at + length, first + groups
        need(at == len(data) and first == len(self.groups), "streams")

    def _stream(self, stream, scene, groups):
        before, seen, total = {}, {}, 0
        ends = self.groups[:, 2]
        for g in groups:
            mine = []
            self.coefficients.append(mine)
            if ends[g] == (ends[g - 1] if g else 0):
                continue
            part = self.groups[g, 0]
            of_group = [k for k in range(self.functions) if self.masks[g] >> k & 1]
            # Nodes still to visit: samples, level, the parent's coefficient, and that of the left sibling or None without one.
            def visit(node, level, parent, left):
                nonlocal total
                if node.b - node.a < 2:
                    return None
                m = node.m
                kept_by_parent = len(parent) if parent else 0
                size = 0 if kept_by_parent == 0 else 1 if kept_by_parent < 3 else 2 if kept_by_parent < 7 else 3
                history = seen.get(m)
                past = 0 if history is None else 2 if history == g_index - 1 else 1
                if not stream.bit(("any", min(level, 19), size, past)):
                    return {}
                seen[m] = g_index
                earlier = before.get(m)
                state = lambda rows, k: 0 if rows is None else 2 if k in rows else 1
                mask, previous = [], 0
                for k in of_group:
                    # Bit k - 1 is that of function k - 1, which is 0 where the group has not this function.
                    low = 1 if k - 1 in mask else 0
                    if stream.bit(("mask", k, state(earlier, k), state(parent, k), state(left, k), low)):
                        mask.append(k)
                rows, beside = {}, [0] * 16
                for k in mask:
                    beside = rows[k] = self._row(stream, k, beside, (earlier or {}).get(k, ZEROS), (parent or {}).get(k, ZEROS))
                    total += 1
                if rows:
                    before[m] = rows
                    mine.append((m, rows))
                first = visit(Node(node.a, m), level + 1, rows or None, None)
                visit(Node(m, node.b), level + 1, rows or None, first or {})
                return rows

            g_index = g - groups[0]
            visit(Node(int(scene.part_ends[part]), int(scene.part_ends[part + 1])), 0, None, None)
            mine.sort()
            need(len(mine) == ends[g] - (ends[g - 1] if g else 0), "coefficients of a group")
        stream.end()
        return total

    @staticmethod
    def _row(stream, function, beside, before, parent):
        q, x = [0] * 16, [0] * 16
        sign = lambda v: 0 if v == 0 else 1 if v > 0 else 2
        for i in range(16):
            if i == 0:
                own, others = abs(beside[0]), abs(before[0])
            else:
                if i == 1:
                    own = x[0] // 2
                elif i in (2, 4, 8):
                    own = 2 * x[i // 2]
                elif i == 3:
                    own = x[1] + x[2]
                elif i in (5, 9):
                    own = x[i // 2] + x[i - 1]
                else:
                    own = (2 * x[i // 2] + x[i - 1] + x[i - 2]) // 2
                others = (abs(before[i]) + abs(beside[i])) // 2 + abs(parent[i]) // 2
            band, o, e = BANDS[i], min(13, scale(own)), min(13, scale(others))
            x[i] = stream.magnitude(("l", band, o, e), ("m", band, e))
            q[i] = x[i]
            if x[i] and stream.bit(("s", function, band, sign(beside[i]), sign(before[i]), sign(parent[i]))):
                q[i] = -x[i]
            need(-32768 <= q[i] <= 32767, "a value")
        return q

    def values(self, scene, means):
        """value_k of every row, [row][function][channel], from the mean irradiance of the samples by `means(a, b)`."""
        result = np.zeros((len(self.row_receiver), self.functions, 3))
        first = 0
        for g, (part, end, _) in enumerate(self.groups):
            a, b = (int(scene.part_ends[part + i]) for i in (0, 1))
            details = means.details(a, b)
            sums = np.zeros((self.functions, 16, 3))
            for node, rows in self.coefficients[g]:
                for k, q in rows.items():
                    sums[k] += np.outer(q, details[node])
            lanes = from_haar(sums) * self.steps[:, None, None]
            count = end - first
            result[first:end] = self.sums[first:end, :, None] * means.of(a, b) + lanes[:, :count].transpose(1, 0, 2)
            first = end
        return result


ZEROS = [0] * 16


def from_haar(q):
    """Along axis 1 of [function][16][channel]."""
    s = q[:, :1]
    for h in (1, 2, 4, 8):
        d = q[:, h:2 * h]
        s = np.stack([(s - d) / np.sqrt(2.0), (s + d) / np.sqrt(2.0)], axis=2).reshape(len(q), 2 * h, -1)
    return s


class Means:
    """mean[a, b) of the irradiance, weighted by area."""

    def __init__(self, area, light):
        self.area = np.concatenate([[0.0], np.cumsum(area)])
        self.flux = np.concatenate([np.zeros((1, 3)), np.cumsum(area[:, None] * light, axis=0)])

    def of(self, a, b):
        return (self.flux[b] - self.flux[a]) / (self.area[b] - self.area[a])

    def details(self, a, b):
        result, todo = {}, [(a, b)]
        while todo:
            a, b = todo.pop()
            if b - a > 1:
                m = Node(a, b).m
                result[m] = self.of(a, m) - self.of(m, b)
                todo += [(a, m), (m, b)]
        return result


class Basis:
    """Functions of the distance, and the coefficients of a profile in them."""

    def __init__(self, file, functions):
        record = file.record("bas.rec")
        self.split = record.f64()
        record.end()
        self.radii, self.weights = file.array("bas.nod", "f8"), file.array("bas.wgt", "f8")
        need((np.diff(self.radii) > 0).all() and len(self.weights) == len(self.radii), "radii")
        self.values = file.array("bas.fun", "f4", 1, functions * len(self.radii)).reshape(functions, -1).astype(np.float64)
        self.totals = file.array("bas.tot", "f8", 1, functions) if file.has("bas.tot") else None

    def coefficients(self, profile):
        taylor = Taylor(profile, self.split)
        wanted = taylor.far(self.radii)
        if self.totals is None:
            return self.values @ (self.weights * wanted)
        reach = self.radii[-1]
        total = 2.0 * np.pi * (taylor.far_integral() + profile.tail(self.split) - profile.tail(max(reach, self.split)))
        return least_squares(self.values.T, self.weights, wanted, self.totals, total)


class Taylor:
    """The far profile: R_d, and within the split radius its expansion in r^2 about it."""

    def __init__(self, profile, split):
        self.profile, self.split = profile, split
        self.terms = profile.derivatives(split * split)

    def far(self, r):
        v = np.minimum(r * r - self.split**2, 0.0)
        value, first, second = self.terms
        return np.where(r >= self.split, self.profile.at_square(r * r), value + v * first + 0.5 * v * v * second)

    def far_integral(self):
        """Int_0^split of the far profile times r dr."""
        v = -self.split**2
        value, first, second = self.terms
        return -0.5 * (v * value + v * v * first / 2.0 + v**3 * second / 6.0)


def least_squares(matrix, weights, wanted, totals, total):
    """min Sum w (matrix s - wanted)^2 with s >= 0 and totals . s = total, by the method of active sets over all faces of few functions."""
    normal, right = matrix.T @ (weights[:, None] * matrix), matrix.T @ (weights * wanted)
    free = list(range(len(totals)))
    for _ in range(4 * len(totals) + 1):
        count = len(free)
        system = np.zeros((count + 1, count + 1))
        system[:count, :count] = normal[np.ix_(free, free)]
        system[:count, count] = system[count, :count] = totals[free]
        size = np.abs(np.diag(system))[:count].max()
        system[:count, :count] /= size
        solution = np.linalg.solve(system, np.append(right[free] / size, total))
        s = np.zeros(len(totals))
        s[free] = solution[:count]
        if s.min() < 0.0:
            free.remove(int(np.argmin(s)))
            continue
        # What a function at 0 would gain: the gradient less the multiplier's part.
        gain = right - normal @ s - size * solution[count] * totals
        gain[free] = 0.0
        gain[gain < 1e-12 * np.abs(right).max()] = 0.0
        if not gain.any():
            return s
        free = sorted(free + [int(np.argmax(gain))])
    raise ArithmeticError("no least squares")


def kriging(places, targets, near):
    """Weights of the `near` nearest places for each target: (indices, weights)."""
    for target in targets:
        d2 = ((places - target) ** 2).sum(axis=1)
        order = np.argsort(d2, kind="stable")[:near]
        if d2[order[0]] == 0.0:
            yield order[:1], np.ones(1)
            continue
        farthest = d2[order[-1]]
        chosen = places[order]
        between = ((chosen[:, None] - chosen[None]) ** 2).sum(axis=2)
        covariance = lambda squares: -np.sqrt(2.5**2 + squares / farthest)
        count, ridge = len(order), 1e-7
        while True:
            system = np.ones((count + 1, count + 1))
            system[count, count] = 0.0
            system[:count, :count] = covariance(between) + ridge * np.eye(count)
            weights = np.linalg.solve(system, np.append(covariance(d2[order]), 1.0))[:count]
            if np.abs(weights).sum() <= 8.0 or ridge >= 1e-4:
                break
            ridge *= 10.0
        yield order, weights


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    samples = Samples(scene, file)
    far = FarField(file, scene)
    basis = Basis(file, far.functions)
    counts = np.diff(np.concatenate([[0], far.row_ends]))
    row_part, row_mask = np.repeat(far.groups[:, 0], counts), np.repeat(far.masks, counts)
    place = np.zeros((far.receivers, 3))
    for v in range(len(scene.local) - 1, -1, -1):
        if far.receiver[v] != NONE:
            place[far.receiver[v]] = scene.local[v]
    vertex_parts = scene.vertex_parts()
    transferring = [part for part in range(len(scene.parts)) if scene.transfers(part)]
    vertices_of = {part: [v for v, p in enumerate(vertex_parts) if p == part] for part in transferring}
    near = {part: near_field(scene, samples, basis, part, vertices_of[part]) for part in transferring}

    def radiosity(lights):
        light = samples.irradiance(lights)
        values = far.values(scene, Means(samples.patch_area, light))
        result = np.zeros((len(scene.local), 3))
        for part in transferring:
            mine = np.unique(far.row_receiver[row_part == part])
            if len(mine) > 0:
                of_profile = np.stack([basis.coefficients(p) for p in dipoles(scene.medium_of(part))], axis=1)
                radiosities = np.zeros((far.receivers, 3))
                for k in range(far.functions):
                    rows = np.flatnonzero((row_part == part) & (row_mask >> k & 1 == 1))
                    owners = far.row_receiver[rows]
                    radiosities[owners] += of_profile[k] * values[rows, k]
                    others = np.setdiff1d(mine, owners)
                    for r, (sources, weights) in zip(others, kriging(place[owners], place[others], 32)):
                        radiosities[r] += of_profile[k] * (weights @ values[rows[sources], k])
                own = [v for v in vertices_of[part] if far.receiver[v] != NONE]
                result[own] = radiosities[far.receiver[own]]
                rest = [v for v in vertices_of[part] if far.receiver[v] == NONE]
                for v, (sources, weights) in zip(rest, kriging(place[mine], scene.local[rest], 32)):
                    result[v] = weights @ radiosities[mine[sources]]
            for v, patches, transfer in near[part]:
                result[v] += (transfer * light[patches]).sum(axis=0)
        return result

    return radiosity


def near_field(scene, samples, basis, part, vertices):
    """What the far field, a sum over the centroids of the samples, leaves of R_d over the samples nearby: for each vertex samples and factors."""
    medium = scene.medium_of(part)
    mine = samples.facets_of_part(part)
    patch = samples.patch[mine]
    depth = 1.0 / (medium.sigma_s_reduced + medium.sigma_a).max()
    profiles = dipoles(medium)
    far = [Taylor(profile, basis.split).far for profile in profiles]
    result = []
    for v in vertices:
        distance = np.linalg.norm(samples.centroid - scene.local[v], axis=1)
        close = distance < np.maximum(basis.split, EXTENDED * samples.radius)
        facets = mine[close[patch]]
        transfer = over_triangles(profiles, scene.local[v], samples.corners[facets], samples.area[facets], depth)
        which = np.flatnonzero(close & (samples.part == part))
        points = np.stack([f(distance[which]) for f in far], axis=1) * samples.patch_area[which, None]
        result.append((v, np.concatenate([samples.patch[facets], which]), np.concatenate([transfer, -points])))
    return result
