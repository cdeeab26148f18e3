"""The form `filtered_normals`: normals low-passed over the surface, in local lighting (formats/spec/filtered_normals.md): the filters `heat`
and `spectral`, filtered normals of length 1, and directional light without shadows."""

import numpy as np

from coding import coded
from container import need
from physics import dipoles, transmittance
from projected import surface_points

PLACES = 192


def settings(file):
    """Choices of filter, response, length, shadows and bleeding, with the numbers of a response."""
    record = file.record("form.set")
    record.f64(), record.u32(), record.u32()
    kind = record.u32()
    if kind == 1:
        record.f64()
    elif kind == 2:
        record.u32(), record.u32(), record.f64()
    response = record.u32()
    number = record.f64() if response == 1 else record.option(record.f64) if response == 2 else None
    record.u32()
    record.option(record.f64), record.option(record.f64)
    length, shadows, bleeding = record.u32(), record.u32(), record.u32()
    record.end()
    return kind, response, number, length, shadows, bleeding


def codes(file, scene, of_vertex, columns):
    """Of the points, in the order of `surface_points`, with what their earlier neighbours have added."""
    points = []
    for point in of_vertex:
        if point >= 0 and point not in points:
            points.append(point)
    row_of = {point: row for row, point in enumerate(points)}
    earlier = [set() for _ in points]
    part_of_vertex = scene.vertex_parts()
    for corners, part in zip(scene.triangles, scene.triangle_part):
        if all(part_of_vertex[v] == part for v in corners) and scene.transfers(part):
            rows = [row_of[of_vertex[v]] for v in corners]
            for a in rows:
                earlier[a].update(b for b in rows if b < a)
    integers = coded(bytes(file.array("fln.fld", "u1")), lambda row: max(earlier[row]) if earlier[row] else None)
    need(integers.shape == (len(points), columns), "codes")
    for row, others in enumerate(earlier):
        if others:
            count = len(others)
            # To the nearest, halves upwards.
            integers[row] += (2 * integers[sorted(others)].sum(axis=0) + count) // (2 * count)
    result = np.zeros((len(points), columns))
    result[points] = integers
    return result


def response(choice, number, profile, squared):
    """F of a channel at eigenvalues."""
    if choice == 1:
        return np.exp(-0.5 * squared * number * number)
    sigma = profile.poles[0].sigma
    if choice == 2:
        return (1.0 + squared / (number if number is not None else sigma) ** 2) ** -1.5
    at = lambda s: sum(np.exp(-pole.z * np.sqrt(sigma * sigma + s)) for pole in profile.poles)
    return at(squared) / at(np.zeros(1))


def coefficients(widths, alpha, width, wanted_response):
    """c_0 and those of the rungs: least squares over the eigenvalues."""
    t = np.concatenate([[0.0], widths**2])
    low, high = -np.log10(t[1:].max()) - 1.0, -np.log10(t[1:].min()) + 1.0
    places = np.concatenate([[0.0], 10.0 ** np.linspace(low, high, PLACES - 1)])
    rungs = 1.0 / (1.0 + t[:, None] * places)
    weights = np.where(places == 0.0, 100.0, 1.0)
    wanted = alpha + (1.0 - alpha) * wanted_response(width * width * places)
    normal = (rungs * weights) @ rungs.T + 2e-3**2 * PLACES * np.eye(len(t))
    found = np.linalg.solve(normal, (rungs * weights) @ wanted)
    return found / found.sum() if found.sum() > 0.5 else found


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    kind, choice, number, length, shadows, bleeding = settings(file)
    need(kind < 2 and length == 0 and shadows == 1 and bleeding == 0, "settings that this reader does not evaluate")
    record = file.record("fln.rec")
    widths = np.array(record.many(record.f64))
    own, step, alpha, width = record.u8(), record.f64(), record.f64(), record.f64()
    record.u32()
    record.end()
    need(own == 3 and (np.diff(widths) < 0).all(), "rungs")
    points, of_vertex = surface_points(scene)
    need(len(file.array("fln.opn", "u1")) == len(points.at), "openness")
    fields = codes(file, scene, of_vertex, 3 * len(widths)).reshape(len(points.at), -1, 3) * step
    ladder = np.concatenate([points.normal[:, None], fields], axis=1)
    parts = scene.vertex_parts()
    medium = [scene.medium_of(parts[v]) if parts[v] is not None else None for v in range(len(parts))]

    def radiosity(lights):
        result = np.zeros((len(scene.local), 3))
        for m in {id(m): m for m in medium if m is not None}.values():
            mine = [v for v in range(len(medium)) if medium[v] is m]
            for channel, profile in enumerate(dipoles(m)):
                c = coefficients(widths, alpha, width, lambda s: response(choice, number, profile, s))
                filtered = np.einsum("r,vrx->vx", c, ladder[of_vertex[mine]])
                filtered /= np.linalg.norm(filtered, axis=1, keepdims=True)
                for light in lights:
                    need(light[0] == "directional", "a light that this reader does not evaluate")
                    mu = filtered @ light[1]
                    result[mine, channel] += profile.total() * transmittance(m.eta, mu) * np.maximum(mu, 0.0) * light[2][channel]
        return result

    return radiosity
