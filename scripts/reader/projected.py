"""The forms `quantised_lights` and `harmonics`: reference points over a basis of the light (formats/spec/projected.md)."""

import numpy as np

from coding import coded
from container import Bad, need
from environment import centres, of_map_with_centres, solid_angles, texels

WORD = (1 << 64) - 1


def mix(z):
    z = (z + 0x9E3779B97F4A7C15) & WORD
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
    return z ^ (z >> 31)


class Points:
    """Places with normals, and the runs of them that are parts."""

    def __init__(self, at, normal, parts):
        self.at, self.normal, self.parts = at, normal, parts


def surface_points(scene):
    """The vertices that transferring parts use, welded, part after part, in the order of their groups; and the point of each vertex."""
    owner = {}
    for corners, part in zip(scene.triangles, scene.triangle_part):
        if scene.transfers(part):
            for v in scene.weld[corners]:
                owner[v] = min(owner.get(v, part), part)
    order, parts = [], []
    for part in sorted(set(owner.values())):
        first = len(order)
        order += grouped(sorted(v for v, p in owner.items() if p == part), scene.local)
        parts.append((first, len(order)))
    of_weld = {v: i for i, v in enumerate(order)}
    normals = np.zeros((len(order), 3))
    corners = scene.local[scene.triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    of_vertex = np.full(len(scene.local), -1)
    for t, corners in enumerate(scene.triangles):
        for v in corners:
            point = of_weld.get(scene.weld[v], -1)
            if point >= 0:
                normals[point] += cross[t]
                of_vertex[v] = point
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return Points(scene.local[order], normals / np.where(length > 0, length, 1.0), parts), of_vertex


def grouped(order, places, capacity=16):
    """Halved along the longest axis into groups of at most 16, ascending in each."""
    if len(order) <= capacity:
        return sorted(order)
    k = min(-(-(len(order) // 2) // capacity) * capacity, len(order) - 1)
    extent = places[order].max(axis=0) - places[order].min(axis=0)
    axis = int(np.argmax(extent))
    order = sorted(order, key=lambda i: (places[i][axis], i))
    return grouped(order[:k], places) + grouped(order[k:], places)


class Net:
    """Points in the order of their rows, with what predicts each."""

    SOURCES = 12

    def __init__(self, points, spacing):
        levels = [self._choose(points, first, end, spacing) for first, end in points.parts]
        depth = max((len(l) for l in levels), default=0)
        self.point, self.sources, self.weights = [], [], []
        rows = [[] for _ in levels]
        for level in range(depth):
            h = spacing * 2.0 ** (depth - 1 - level)
            added = []
            for part, of_part in enumerate(levels):
                at = level + len(of_part) - depth
                members = of_part[at] if at >= 0 else []
                known = [self.point[r] for r in rows[part]]
                for member in members:
                    near, weights = nearest_weights(points, known, member, h, self.SOURCES)
                    self.sources.append([rows[part][i] for i in near])
                    self.weights.append(weights)
                added.append(members)
            for part, members in enumerate(added):
                rows[part] += range(len(self.point), len(self.point) + len(members))
                self.point += members

    @staticmethod
    def _choose(points, first, end, spacing):
        count = end - first
        at, normal = points.at[first:end], points.normal[first:end]
        order = sorted(range(count), key=lambda i: (mix(mix(mix(0x72656670) ^ i)), i))
        extent = (at.max(axis=0) - at.min(axis=0)).max()
        if not spacing > 0.0:
            return [list(range(first, end))]
        halvings = int(np.floor(np.log2(max(1.0, 0.25 * extent / spacing))))
        taken, levels = np.zeros(count, dtype=bool), []
        for level in range(halvings, -1, -1):
            h = spacing * 2.0**level
            members = []
            for i in order:
                if taken[i]:
                    continue
                others = np.flatnonzero(taken)
                d2 = ((at[others] - at[i]) ** 2).sum(axis=1) + (0.5 * h) ** 2 * ((normal[others] - normal[i]) ** 2).sum(axis=1)
                if not (d2 < h * h).any():
                    taken[i] = True
                    members.append(first + i)
            levels.append(sorted(members))
        return levels

    def similar(self, row):
        return self.sources[row][0] if self.sources[row] else None

    def reconstruct(self, integers, steps):
        need(len(integers) == len(self.point), "rows of coefficients")
        known = np.zeros(integers.shape)
        for row in range(len(known)):
            known[row] = integers[row] * steps
            if self.sources[row]:
                known[row] += self.weights[row] @ known[self.sources[row]]
        return known


def nearest_weights(points, sources, target, h, count):
    """Which of `sources`, nearest first, and the weights of kriging."""
    if not sources:
        return [], np.zeros(0)
    at, normal = points.at[sources], points.normal[sources]
    normal2 = ((normal - points.normal[target]) ** 2).sum(axis=1)
    d2 = ((at - points.at[target]) ** 2).sum(axis=1) + (0.5 * h) ** 2 * normal2
    remote = d2 + 8.0 * (0.5 * h) ** 2 * np.maximum(normal2 - 2.0, 0.0) ** 2
    order = np.argsort(remote, kind="stable")[:count]
    d2, at, normal = d2[order], at[order], normal[order]
    farthest = d2.max()
    if len(order) < 2 or farthest <= 0.0 or d2[0] <= 1e-14 * farthest:
        return list(order), np.eye(len(order))[0]
    between = ((at[:, None] - at[None]) ** 2).sum(axis=2) + (0.5 * h) ** 2 * ((normal[:, None] - normal[None]) ** 2).sum(axis=2)
    n = len(order)
    system = np.ones((n + 1, n + 1))
    system[n, n] = 0.0
    system[:n, :n] = -np.sqrt(1.0 + between / farthest) + 1e-4 * np.eye(n)
    return list(order), np.linalg.solve(system, np.append(-np.sqrt(1.0 + d2 / farthest), 1.0))[:n]


class Components:
    """One set of sections, decoded: functions of the light, and the coefficients of every reference point."""

    def __init__(self, file, prefix, lights, shells, channels, step, net, light_net):
        units = file.array(prefix + ".uni", "f4", 1, lights).astype(np.float64)
        steps = file.array(prefix + ".stp", "f4").astype(np.float64)
        need((units > 0).all() and (steps > 0).all() and step > 0, "units and steps")
        functions, planes = len(steps), 3 * shells
        if light_net:
            rows = light_net.reconstruct(coded(bytes(file.array(prefix + ".bas", "u1")), light_net.similar), steps)
            basis = np.zeros((lights, functions))
            basis[light_net.point] = rows
        else:
            basis = coded(bytes(file.array(prefix + ".bas", "u1")), lambda row: None) * steps
        need(basis.shape == (lights, functions), "rows of functions")
        self.basis = basis * units[:, None]
        columns = file.array(prefix + ".col", "u2").astype(np.int64)
        need((columns < planes * functions).all() and len(set(columns)) == len(columns), "columns")
        integers = coded(bytes(file.array(prefix + ".cof", "u1")), net.similar)
        need(integers.shape[1] == len(columns), "columns")
        self.values = net.reconstruct(integers, step)
        self.function, self.plane = columns // planes, columns % planes
        self.channels = np.array(channels).reshape(planes, 3, shells)

    def radiosity(self, weights):
        """Of the rows, for weights [shell][light][channel]."""
        of_functions = np.einsum("slc,lf->sfc", weights, self.basis)
        per_column = np.einsum("kcs,ksc->kc", self.channels[self.plane], of_functions[:, self.function].transpose(1, 0, 2))
        return self.values @ per_column


def directions(count):
    """The lattice, each direction moved to the centre of its texel."""
    i = np.arange(count)
    y = 1.0 - 2.0 * (i + 0.25) / (count - 0.5)
    azimuth = 2.0 * np.pi * ((i * (0.5 * (np.sqrt(5.0) - 1.0))) % 1.0)
    radius = np.sqrt(np.maximum(1.0 - y * y, 0.0))
    lattice = np.stack([radius * np.sin(azimuth), y, radius * np.cos(azimuth)], axis=1)
    return centres(64)[texels(64, lattice)]


def harmonics(order, d):
    """Real orthonormal spherical harmonics with the pole +Z, (l, m) at l l + l + m: [direction][function]."""
    x, y, z = d.T
    result = np.zeros((len(d), order * order))
    sectoral = np.full(len(d), np.sqrt(1.0 / (4.0 * np.pi)))
    powers = np.ones(len(d), dtype=complex)
    for m in range(order):
        if m:
            sectoral = -np.sqrt((2 * m + 1) / (2 * m)) * sectoral
            powers = powers * (x + 1j * y)
        below, here = np.zeros(len(d)), sectoral
        for l in range(m, order):
            for sign, part in ((1, powers.real), (-1, powers.imag)):
                if m or sign == 1:
                    result[:, l * l + l + sign * m] = (np.sqrt(2.0) if m else 1.0) * here * part
            a = np.sqrt((4.0 * (l + 1) ** 2 - 1.0) / ((l + 1) ** 2 - m * m))
            b = np.sqrt((l * l - m * m) / (4.0 * l * l - 1.0)) if l > m else 0.0
            below, here = here, a * (z * here - b * below)
    return result


def interpolation(choice, set_of, wanted):
    """Weights of the directions of a set for some unit vectors, [wanted][set]."""
    count = len(set_of)
    if choice == 0:
        result = np.zeros((len(wanted), count))
        for row, w in zip(result, wanted):
            chord2 = ((set_of - w) ** 2).sum(axis=1)
            near = np.argsort(chord2, kind="stable")[:4]
            angles = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord2[near]), 1.0))
            row[near] = [1, 0, 0, 0] if angles[0] <= 1e-12 else angles**-2.0 / (angles**-2.0).sum()
        return result
    if choice == 2:
        order = 2 if count < 16 else 3
        kernel = lambda a, b: (((a[:, None] - b[None]) ** 2).sum(axis=2) + 0.04) ** 1.5
        y = harmonics(order, set_of)
        system = np.zeros((count + order * order,) * 2)
        system[:count, :count], system[:count, count:], system[count:, :count] = kernel(set_of, set_of), y, y.T
        right = np.concatenate([kernel(wanted, set_of), harmonics(order, wanted)], axis=1)
        return np.linalg.solve(system, right.T).T[:, :count]
    if choice == 3:
        order = min(20, max(1, int(np.sqrt(0.6 * count))))
        y = harmonics(order, set_of)
        return harmonics(order, wanted) @ np.linalg.solve(y.T @ y, y.T)
    raise Bad("interpolation over triangles of directions")


def distant(light):
    """Light from far away as unit vectors and irradiances."""
    kind, what, colour = light
    if kind == "directional":
        return what[None], colour[None]
    if kind == "env":
        energy, centre = of_map_with_centres(what[0], what[1], 64)
        lit = energy.any(axis=1)
        return centre[lit] / np.linalg.norm(centre[lit], axis=1, keepdims=True), energy[lit] * colour
    need(kind == "constant", f"a {kind} light from far away")
    return centres(64), np.tile(solid_angles(64).ravel(), 6)[:, None] * colour


def bounding_sphere(scene):
    corners = scene.triangles[[scene.transfers(p) for p in scene.triangle_part]].ravel()
    places = scene.local[corners]
    centre = 0.5 * (places.min(axis=0) + places.max(axis=0))
    return centre, np.linalg.norm(places - centre, axis=1).max()


def between_shells(choice, shells, u):
    if choice == 1:
        others = lambda k: [x for j, x in enumerate(shells) if j != k]
        return np.array([np.prod([(u - x) / (shells[k] - x) for x in others(k)]) for k in range(len(shells))])
    return np.array([np.interp(u, shells, np.eye(len(shells))[k]) for k in range(len(shells))])


def expanded(scene, points, of_vertex, net, spacing, of_rows):
    """Radiosity of the vertices from that of the reference points; none is negative."""
    chosen = sorted(range(len(net.point)), key=lambda row: net.point[row])
    values = np.zeros((len(points.at), 3))
    for first, end in points.parts:
        rows = [row for row in chosen if first <= net.point[row] < end]
        sources = [net.point[row] for row in rows]
        for point in range(first, end):
            near, weights = nearest_weights(points, sources, point, spacing, 10)
            values[point] = weights @ of_rows[[rows[i] for i in near]]
    values = np.maximum(values, 0.0)
    return np.where((of_vertex >= 0)[:, None], values[of_vertex], 0.0)


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    record = file.record("form.set")
    # Density, and the number of directions that was asked for.
    record.f64(), record.u32(), record.u32(), record.option(record.u64)
    scheme, blend = record.u32(), record.u32()
    record = file.record("qlt.rec")
    count = record.u32()
    shells = record.many(record.f64)
    spacing, of_directions = record.f64(), record.f64()
    record.u32()
    channels = record.many(lambda: record.many(record.f64))
    steps = record.many(record.f32)
    record.end()
    set_of = directions(count)
    light_net = Net(Points(set_of, np.zeros((count, 3)), [(0, count)]), of_directions)
    points, of_vertex = surface_points(scene)
    net = Net(points, spacing)
    sets = [Components(file, "qlt", count, 1, channels[0], steps[0], net, light_net)]
    if len(shells) > 1:
        sets.append(Components(file, "qln", count, len(shells) - 1, channels[1], steps[1], net, light_net))
    centre, radius = bounding_sphere(scene)

    def weights_of(light):
        if light[0] == "point":
            towards = light[1] - centre
            distance = np.linalg.norm(towards)
            need(len(shells) > 1 and radius / distance <= shells[-1] * (1 + 1e-12), "a light nearer than the shells")
            of_direction = interpolation(scheme, set_of, towards[None] / distance)[0]
            of_shell = between_shells(blend, np.array(shells), radius / distance)
            return of_shell[:, None, None] * of_direction[:, None] * light[2] / distance**2
        where, irradiance = distant(light)
        result = np.zeros((len(shells), count, 3))
        result[0] = interpolation(scheme, set_of, where).T @ irradiance
        return result

    def radiosity(lights):
        weights = sum(weights_of(light) for light in lights)
        of_rows = sets[0].radiosity(weights[:1])
        if len(sets) > 1:
            of_rows = of_rows + sets[1].radiosity(weights[1:])
        return expanded(scene, points, of_vertex, net, spacing, of_rows)

    return radiosity
