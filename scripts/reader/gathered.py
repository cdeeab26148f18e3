"""The form `gathered`: samples alone, summed over all pairs (formats/spec/samples.md)."""

import numpy as np

from environment import EnvironmentRows
from lights import Shadows, irradiance
from physics import RULE_POINTS, RULE_WEIGHTS, dipoles, over_triangles


class Samples:
    """Facets of the patches, and light on them."""

    def __init__(self, scene):
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
        self.part = np.searchsorted(scene.part_ends, np.arange(len(self.patch_area)), side="right") - 1

    def irradiance(self, file, lights):
        """Mean irradiance of every patch, RGB: through the rows, where there are any, for what they serve; otherwise by rays."""
        scene = self.scene
        rows = EnvironmentRows(file, scene, len(self.patch_area)) if file.has("rows.cnt") else None
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


def radiosity(file, scene, lights):
    samples = Samples(scene)
    light = samples.irradiance(file, lights)
    result = np.zeros((len(scene.local), 3))
    for vertex, parts in enumerate(scene.vertex_parts()):
        # A vertex that several parts have is one of the first.
        for part in sorted(parts)[:1]:
            result[vertex] = gather(scene, samples, part, scene.local[vertex], light)
    return result


def gather(scene, samples, part, receiver, light):
    """Int R_d E dA over a part."""
    medium = scene.medium_of(part)
    mine = samples.facets_of_part(part)
    scale = 1.0 / (medium.sigma_s_reduced + medium.sigma_a).max()
    transfer = over_triangles(dipoles(medium), receiver, samples.corners[mine], samples.area[mine], scale)
    return (transfer * light[samples.patch[mine]]).sum(axis=0)
