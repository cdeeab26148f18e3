"""Fresnel terms, the dipole, and its integral over triangles: "Light and media" of formats/SPEC.md."""

import numpy as np

LEGENDRE = {n: np.polynomial.legendre.leggauss(n) for n in (16, 24, 64)}


def integral(f, a, b, n=64):
    x, w = LEGENDRE[n]
    return 0.5 * (b - a) * np.sum(w * f(0.5 * (b - a) * x + 0.5 * (b + a)))


def transmittance(eta, mu):
    """F_t(eta, mu), unpolarised, from outside; 0 at and below the horizon and where the light is reflected totally."""
    mu = np.minimum(np.asarray(mu, dtype=np.float64), 1.0)
    if eta == 1.0:
        return np.where(mu > 0.0, 1.0, 0.0)
    square = mu * mu + (eta * eta - 1.0)
    m = np.sqrt(np.maximum(square, 0.0)) / eta
    with np.errstate(divide="ignore", invalid="ignore"):
        value = 2.0 * eta * mu * m * (1.0 / (mu + eta * m) ** 2 + 1.0 / (eta * mu + m) ** 2)
    return np.where((mu > 0.0) & (square > 0.0), value, 0.0)


def fresnel_integral(eta, weight):
    """Int_0^1 F_t(eta, mu) mu weight(mu) dmu."""
    if eta > 1.0:
        # mu = k sinh u: the layer near mu = 0, where F_t falls, is as wide as any other.
        k = np.sqrt(eta * eta - 1.0)
        mu = lambda u: k * np.sinh(u)
        return integral(lambda u: transmittance(eta, mu(u)) * mu(u) * weight(mu(u)) * k * np.cosh(u), 0.0, np.arcsinh(1.0 / k))
    if eta < 1.0:
        # mu^2 = critical^2 + v^2 from the critical angle on.
        critical = np.sqrt(1.0 - eta * eta)
        mu = lambda v: np.sqrt(critical * critical + v * v)
        return integral(lambda v: transmittance(eta, mu(v)) * v * weight(mu(v)), 0.0, eta)
    return integral(lambda mu: mu * weight(mu), 0.0, 1.0)


def diffuse_transmittance(eta):
    """C = 2 Int F_t mu dmu."""
    return 2.0 * fresnel_integral(eta, lambda mu: 1.0)


def boundary_a(eta):
    """A of the dipole."""
    if eta == 1.0:
        inside = 0.0
    elif 1.0 < eta <= 3.0:
        inside = -1.440 / eta**2 + 0.710 / eta + 0.668 + 0.0636 * eta
    elif 0.4 <= eta < 1.0:
        inside = -0.4399 + 0.7099 / eta - 0.3319 / eta**2 + 0.0636 / eta**3
    else:
        inside = 1.0 - diffuse_transmittance(1.0 / eta)
    return (1.0 + inside) / (1.0 - inside)


class Pole:
    """weight (1 + s d) exp(-s d) / d^3 with d^2 = r^2 + z^2."""

    def __init__(self, weight, z, sigma):
        self.weight, self.z, self.sigma = weight, z, sigma

    def at_square(self, s):
        d = np.sqrt(s + self.z * self.z)
        x = self.sigma * d
        return self.weight * (1.0 + x) * np.exp(-x) / d**3

    def tail(self, r):
        """Int_r^infinity of the pole times r dr."""
        d = np.hypot(r, self.z)
        return self.weight * np.exp(-self.sigma * d) / d

    def derivatives(self, s):
        """The pole and its first two derivatives in r^2."""
        d = np.sqrt(s + self.z * self.z)
        x = self.sigma * d
        scale = self.weight * np.exp(-x) / d**3
        first = -0.5 * scale * (3.0 + 3.0 * x + x * x) / d**2
        second = 0.25 * scale * (15.0 + 15.0 * x + 6.0 * x * x + x**3) / d**4
        return scale * (1.0 + x), first, second


class Dipole:
    """R_d of one channel."""

    def __init__(self, sigma_s_reduced, sigma_a, eta):
        extinction = sigma_s_reduced + sigma_a
        if extinction == 0.0:
            self.poles = []
            return
        albedo, z = sigma_s_reduced / extinction, 1.0 / extinction
        sigma_tr = np.sqrt(3.0 * sigma_a * extinction)
        heights = [z, z * (1.0 + 4.0 / 3.0 * boundary_a(eta))]
        self.poles = [Pole(albedo * h / (4.0 * np.pi), h, sigma_tr) for h in heights]

    def at_square(self, s):
        return sum(pole.at_square(s) for pole in self.poles)

    def tail(self, r):
        return sum(pole.tail(r) for pole in self.poles)

    def total(self):
        return 2.0 * np.pi * self.tail(0.0)

    def derivatives(self, s):
        return [sum(terms) for terms in zip(*(pole.derivatives(s) for pole in self.poles))]


def dipoles(medium):
    """R_d of the channels R, G, B."""
    return [Dipole(s, a, medium.eta) for s, a in zip(medium.sigma_s_reduced, medium.sigma_a)]


# Points and weights of a rule on the triangle that is exact to degree 5 (Radon).
_A, _B = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_WA, _WB = (155.0 - np.sqrt(15.0)) / 1200.0, (155.0 + np.sqrt(15.0)) / 1200.0
RULE = [([1 / 3, 1 / 3, 1 / 3], 9 / 40)]
for a, w in ((_A, _WA), (_B, _WB)):
    RULE += [([1 - 2 * a, a, a], w), ([a, 1 - 2 * a, a], w), ([a, a, 1 - 2 * a], w)]
RULE_POINTS, RULE_WEIGHTS = np.array([r[0] for r in RULE]), np.array([r[1] for r in RULE])


def over_triangles(profiles, receiver, corners, areas, scale):
    """Int R_d over each triangle, [triangle][profile]: by the rule, cut further where it is near, in closed form where it is nearest.

    `scale` is the length on which the profiles change at r = 0.
    """
    result = np.zeros((len(corners), len(profiles)))
    centres = corners.mean(axis=1)
    radius = np.sqrt(((corners - centres[:, None]) ** 2).sum(axis=2).max(axis=1))
    distance = np.sqrt(((centres - receiver) ** 2).sum(axis=1))
    near = np.maximum(distance - radius, 0.0) ** 2 + scale * scale < (4.0 * radius) ** 2
    points = np.einsum("pc,tcx->tpx", RULE_POINTS, corners[~near])
    squares = ((points - receiver) ** 2).sum(axis=2)
    for k, profile in enumerate(profiles):
        result[~near, k] = areas[~near] * (profile.at_square(squares) @ RULE_WEIGHTS)
        result[near, k] = exact_over_triangles(profile, receiver, corners[near])
    return result


def exact_over_triangles(profile, receiver, corners):
    """Int R_d over each triangle, pole by pole."""
    return sum((over_radial(pole.tail, pole.z, receiver, corners) for pole in profile.poles), np.zeros(len(corners)))


def over_radial(tail, width, receiver, corners):
    """Int f(|x - receiver|) dA over each triangle, from `tail(r) = Int_r^infinity f r dr`, which changes over `width` at r = 0:
    the sum over the edges of Int (tail(H) - tail(d)) dphi, phi the angle about the foot of the receiver.

    On an edge whose line lies `o` from the foot the place is s = D sinh u, D^2 = H^2 + width^2 + o^2: a smooth integrand.
    """
    if len(corners) == 0:
        return np.zeros(0)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0, length, 1.0)[:, None]
    height = ((receiver - corners[:, 0]) * normal).sum(axis=1)
    foot = receiver - height[:, None] * normal
    x, w = LEGENDRE[24]
    base, d0 = tail(np.abs(height)), np.hypot(height, width)
    total = np.zeros(len(corners))
    for k in range(3):
        a, b = corners[:, k] - foot, corners[:, (k + 1) % 3] - foot
        edge = b - a
        size = np.linalg.norm(edge, axis=1)
        along = edge / np.where(size > 0, size, 1.0)[:, None]
        offset = (np.cross(a, along) * normal).sum(axis=1)
        reach = np.hypot(d0, offset)
        from_u, to_u = np.arcsinh((a * along).sum(axis=1) / reach), np.arcsinh((b * along).sum(axis=1) / reach)
        half, middle = 0.5 * (to_u - from_u), 0.5 * (to_u + from_u)
        u = middle[:, None] + half[:, None] * x
        s = reach[:, None] * np.sinh(u)
        rho2 = s * s + (offset * offset)[:, None]
        rho2 = np.where(rho2 > 0, rho2, 1.0)
        value = (base[:, None] - tail(np.sqrt(rho2 + (height * height)[:, None]))) / rho2
        total += (value * (reach[:, None] * np.cosh(u)) @ w) * half * offset
    return total
