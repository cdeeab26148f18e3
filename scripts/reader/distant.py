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


class InRows:
    """What some sections hold in Haar coefficients over a cube map; the terms are the channels."""

    def __init__(self, file, prefix, scene):
        points, self.of_vertex = surface_points(scene)
        self.rows = SparseRows(file, prefix, len(points.at), 3, "vst")
        self.by_solid_angle = transform_of(file) == 0

    def radiosity(self, lights):
        """Of the vertices."""
        total = 0.0
        for light in lights:
            products = self.rows.times(light_coefficients(light, self.rows.n, self.by_solid_angle))
            total = total + np.einsum("ijj->ij", products)
        return np.where((self.of_vertex >= 0)[:, None], total[self.of_vertex], 0.0)


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    record = file.record("aft.rec")
    record.u32()
    part = InHarmonics(file, "aft", scene, 1, record)
    record.end()
    parts = ([part] if part.set else []) + ([InRows(file, "aft", scene)] if file.has("aft.dim") else [])
    return lambda lights: np.maximum(sum(part.radiosity(lights) for part in parts), 0.0)


def open_single(file, scene):
    """The same for light that is scattered once, in the unit of radiosity, where the asset has it for every vertex; else none."""
    if not file.has("afs.rec"):
        return None
    record = file.record("afs.rec")
    terms = record.u32()
    part = InHarmonics(file, "afs", scene, terms, record)
    record.end()
    if terms > 1:
        # Towards an eye alone.
        return None
    if not part.set:
        part = InRows(file, "afs", scene)
    return lambda lights: np.maximum(part.radiosity(lights), 0.0)
