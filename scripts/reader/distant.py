"""The forms `harmonics` and `rows`: light from far away alone (formats/spec/projected.md, rows.md), and light that is scattered once
(formats/spec/single_scattering.md)."""

import numpy as np

from environment import SparseRows, light_coefficients
from projected import Components, Net, distant, expanded, harmonics, surface_points


def transform_of(file):
    record = file.record("form.set")
    # Density, then the texels along an edge.
    record.f64(), record.u32(), record.u32(), record.u32()
    return record.u32()


def in_axes(d):
    """The pole of the functions is +Y."""
    return d[:, [2, 0, 1]]


class InHarmonics:
    """What one record and its sections hold in harmonics, `terms` values for each channel."""

    def __init__(self, file, prefix, scene, terms, record):
        self.order = record.u32()
        self.spacing = record.f64()
        channels = record.many(record.f64)
        step = record.f32()
        self.points, self.of_vertex = surface_points(scene)
        self.scene = scene
        self.set = None
        if self.order:
            self.net = Net(self.points, self.spacing)
            self.set = Components(file, prefix, self.order**2, terms, channels, step, self.net, None)

    def radiosity(self, lights):
        """Of the vertices, not negative."""
        weights = np.zeros((1, self.order**2, 3))
        for light in lights:
            where, irradiance = distant(light)
            weights[0] += harmonics(self.order, in_axes(where)).T @ irradiance
        return expanded(self.scene, self.points, self.of_vertex, self.net, self.spacing, self.set.radiosity(weights))


def in_rows(file, prefix, scene, lights):
    """Of the vertices, the part in Haar coefficients."""
    points, of_vertex = surface_points(scene)
    rows = SparseRows(file, prefix, len(points.at), 3, "vst")
    by_solid_angle = transform_of(file) == 0
    total = np.zeros((len(points.at), 3))
    for light in lights:
        products = rows.times(light_coefficients(light, rows.n, by_solid_angle))
        total += np.einsum("ijj->ij", products)
    return np.where((of_vertex >= 0)[:, None], total[of_vertex], 0.0)


def radiosity(file, scene, lights):
    record = file.record("aft.rec")
    record.u32()
    part = InHarmonics(file, "aft", scene, 1, record)
    record.end()
    total = part.radiosity(lights) if part.set else 0.0
    if file.has("aft.dim"):
        total = total + in_rows(file, "aft", scene, lights)
    return np.maximum(total, 0.0)


def single_scattering(file, scene, lights):
    """Light that is scattered once, in the unit of radiosity, where the asset has it for every vertex; else none."""
    if not file.has("afs.rec"):
        return None
    record = file.record("afs.rec")
    terms = record.u32()
    part = InHarmonics(file, "afs", scene, terms, record)
    record.end()
    if terms > 1:
        # Towards an eye alone.
        return None
    value = part.radiosity(lights) if part.set else in_rows(file, "afs", scene, lights)
    return np.maximum(value, 0.0)
