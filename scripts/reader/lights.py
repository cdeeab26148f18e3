"""Lights, and the irradiance behind the surface that they bring to places on it."""

import numpy as np

from container import Bad
from environment import read_hdr
from physics import diffuse_transmittance, transmittance


def _rgb(text):
    values = [float(v) for v in text.split(",")]
    return np.array(values * 3 if len(values) == 1 else values)


def parse(text):
    """`directional:from=X,Y,Z:irradiance=E`, `point:at=X,Y,Z:intensity=I` (mm), `constant:radiance=L`, `env:path=P.hdr:rotate=D`."""
    kind, *pairs = text.split(":")
    keys = dict(pair.split("=") for pair in pairs)
    if kind == "directional":
        direction = np.array([float(v) for v in keys["from"].split(",")])
        return kind, direction / np.linalg.norm(direction), _rgb(keys["irradiance"])
    if kind == "point":
        return kind, np.array([float(v) for v in keys["at"].split(",")]), _rgb(keys["intensity"])
    if kind == "constant":
        return kind, None, _rgb(keys["radiance"])
    if kind == "env":
        return kind, (read_hdr(keys["path"]), float(keys.get("rotate", 0.0))), np.ones(3)
    raise Bad(f"light {text}")


class Shadows:
    """Rays against all triangles, one after another."""

    def __init__(self, corners):
        self.a, self.e1, self.e2 = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]

    def seen(self, places, own, direction, farthest):
        """True where the ray from a place on the triangle `own` towards `direction` (for each place) meets nothing before `farthest`."""
        result = np.ones(len(places), dtype=bool)
        for t in range(len(self.a)):
            p = np.cross(direction, self.e2[t])
            det = p @ self.e1[t]
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = 1.0 / det
                s = places - self.a[t]
                u = (s * p).sum(axis=1) * inverse
                q = np.cross(s, self.e1[t])
                v = (direction * q).sum(axis=1) * inverse
                along = (q @ self.e2[t]) * inverse
                hit = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (along > 0) & (along < farthest)
            result &= ~hit | (own == t)
        return result


def irradiance(light, places, normals, own, eta, shadows):
    """E behind the surface at places (without the origin; point lights are given so too), RGB."""
    kind, where, colour = light
    if kind == "constant":
        # Nothing is in the way of a convex body.
        return np.tile(np.pi * diffuse_transmittance(eta) * colour, (len(places), 1))
    if kind == "directional":
        direction, distance = np.tile(where, (len(places), 1)), np.full(len(places), np.inf)
        strength = np.ones(len(places))
    else:
        towards = where - places
        distance = np.linalg.norm(towards, axis=1)
        direction, strength = towards / distance[:, None], 1.0 / distance**2
    cosine = (direction * normals).sum(axis=1)
    value = transmittance(eta, cosine) * np.maximum(cosine, 0.0) * strength
    lit = value > 0
    value[lit] *= shadows.seen(places[lit], own[lit], direction[lit], distance[lit])
    return value[:, None] * colour
