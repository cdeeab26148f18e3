"""The form `gathered`: samples alone, summed over all pairs (formats/spec/samples.md)."""

import numpy as np

from container import need
from environment import EnvironmentRows
from lights import Shadows, irradiance
from physics import RULE_POINTS, RULE_WEIGHTS, dipoles, over_triangles


class Samples:
    """Facets of the patches, and light on them."""

    def __init__(self, scene, file):
        self.scene = scene
        self.corners = scene.facet_corners()
        self.triangle = scene.facets[:, 0]
        cross = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
        self.area = 0.5 * np.linalg.norm(cross, axis=1)
        self.normal = scene.normals[self.triangle]
        self.patch = np.repeat(np.arange(len(scene.patch_ends) - 1), np.diff(scene.patch_ends))
        self.patch_area = np.bincount(self.patch, self.area)
        weighted = self.corners.mean(axis=1) * self.area[:, None]
        self.centroid = np.stack([np.bincount(self.patch, weighted[:, k]) for k in range(3)], axis=1) / self.patch_area[:, None]
        away = np.linalg.norm(self.corners - self.centroid[self.patch][:, None], axis=2).max(axis=1)
        self.radius = np.zeros(len(self.patch_area))
        np.maximum.at(self.radius, self.patch, away)
        self.rows = EnvironmentRows(file, scene, len(self.patch_area)) if file.has("rows.cnt") else None
        self.part = np.searchsorted(scene.part_ends, np.arange(len(self.patch_area)), side="right") - 1

    def irradiance(self, lights):
        """Mean irradiance of every patch, RGB: through the rows, where there are any, for what they serve; otherwise by rays."""
        scene, rows = self.scene, self.rows
        far = [light for light in lights if rows and light[0] in ("constant", "env")]
        etas = [scene.medium_of(p).eta if scene.transfers(p) else None for p in range(len(scene.parts))]
        by_rays = self.by_rays([light for light in lights if light not in far])
        return sum((rows.irradiance(light, etas) for light in far), by_rays)

    def by_rays(self, lights):
        scene = self.scene
        shadows = Shadows(scene.local[scene.triangles])
        points = np.einsum("pc,fcx->fpx", RULE_POINTS, self.corners)
        total = np.zeros((len(self.patch_area), 3))
        for part in range(len(scene.parts)):
            if not scene.transfers(part):
                continue
            eta = scene.medium_of(part).eta
            mine = np.flatnonzero(self.part[self.patch] == part)
            count = points.shape[1]
            places = points[mine].reshape(-1, 3)
            normals, own = np.repeat(self.normal[mine], count, axis=0), np.repeat(self.triangle[mine], count)
            for light in lights:
                values = irradiance(light, places, normals, own, eta, shadows).reshape(len(mine), count, 3)
                means = np.einsum("fpk,p->fk", values, RULE_WEIGHTS) * self.area[mine][:, None]
                np.add.at(total, self.patch[mine], means)
        return total / self.patch_area[:, None]

    def facets_of_part(self, part):
        return np.flatnonzero(self.part[self.patch] == part)


def open_form(file, scene):
    """A function from lights to the radiosity of the vertices."""
    samples = Samples(scene, file)
    if file.has("mls.num"):
        # What nets need; all pairs need none.
        record = file.record("mls.num")
        asked, spacing, radius, facets, pieces = record.some(5, record.f64)
        record.end()
        need(0 < asked <= 1 and 0.1 <= spacing <= 1024 and 1 <= radius <= 1024 and 0 <= min(facets, pieces), "nets")
    # Int R_d dA over the facets of the part of each vertex.
    transfers = []
    for vertex, part in enumerate(scene.vertex_parts()):
        if part is not None:
            medium = scene.medium_of(part)
            mine = samples.facets_of_part(part)
            scale = 1.0 / (medium.sigma_s_reduced + medium.sigma_a).max()
            transfer = over_triangles(dipoles(medium), scene.local[vertex], samples.corners[mine], samples.area[mine], scale)
            transfers.append((vertex, samples.patch[mine], transfer))

    def radiosity(lights):
        light = samples.irradiance(lights)
        result = np.zeros((len(scene.local), 3))
        for vertex, patches, transfer in transfers:
            result[vertex] = (transfer * light[patches]).sum(axis=0)
        return result

    return radiosity
