"""The container of a .tlux file and the sections that all files have: "The `.tlux` format" (formats/SPEC.md)."""

import struct
import zlib

import numpy as np
import zstandard

import subdivision
from checks import Bad, need

MAGIC = b"\x89TLUX\r\n\x1a"
ELEMENTS = ["record", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]
NONE = 0xFFFFFFFF


class Record:
    """Fields in order, without names, padding or alignment."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def number(self, kind):
        size = struct.calcsize("<" + kind)
        need(self.at + size <= len(self.data), "a record ends early")
        (value,) = struct.unpack_from("<" + kind, self.data, self.at)
        self.at += size
        return value

    def u8(self):
        return self.number("B")

    def u32(self):
        return self.number("I")

    def u64(self):
        return self.number("Q")

    def f32(self):
        return self.number("f")

    def f64(self):
        return self.number("d")

    def truth(self):
        value = self.u8()
        need(value <= 1, "a truth value above 1")
        return value == 1

    def string(self):
        length = self.u64()
        need(self.at + length <= len(self.data), "a record ends early")
        text = bytes(self.data[self.at:self.at + length]).decode("utf-8")
        self.at += length
        return text

    def many(self, field):
        return [field() for _ in range(self.u64())]

    def some(self, count, field):
        return [field() for _ in range(count)]

    def option(self, field):
        return field() if self.truth() else None

    def end(self):
        need(self.at == len(self.data), "a record has bytes left over")


class File:
    """Sections by tag; every length, checksum and offset is verified."""

    def __init__(self, path):
        data = open(path, "rb").read()
        need(data[:8] == MAGIC, "not a .tlux file")
        need(len(data) >= 32, "the file ends inside the header")
        major, self.minor, count, length, checksum, zero = struct.unpack_from("<HHIQII", data, 8)
        need(major == 0, f"version {major}.{self.minor}")
        need(length == len(data) and zero == 0 and count <= 1024, "header")
        head = 32 + 48 * count
        need(len(data) >= head, "the file ends inside the directory")
        need(zlib.crc32(data[:24] + bytes(4) + data[28:head]) == checksum, "checksum of header and directory")
        self.sections, end = {}, head
        for i in range(count):
            tag, element, codec, columns, kind, z1, z2, offset, stored, decoded, crc, z3 = struct.unpack_from(
                "<8sBBHBBHQQQII", data, 32 + 48 * i)
            name = tag.rstrip(b"\0").decode("ascii")
            need(name and name not in self.sections, f"tag {tag}")
            need(element <= 11 and codec <= 1 and columns >= 1 and z1 == z2 == z3 == 0, f"entry of {name}")
            aligned = (end + 63) // 64 * 64
            need(offset == aligned and not any(data[end:aligned]), f"offset of {name}")
            end = offset + stored
            need(end <= len(data), f"{name} ends beyond the file")
            body = data[offset:end]
            need(zlib.crc32(body) == crc, f"checksum of {name}")
            if codec == 1:
                need(zstandard.frame_content_size(body) == decoded, f"length of {name}")
                body = zstandard.ZstdDecompressor().decompress(body)
            need(len(body) == decoded, f"length of {name}")
            self.sections[name] = (ELEMENTS[element], columns, kind, body)
        need(end == len(data), "the file goes on")

    def has(self, tag):
        return tag in self.sections

    def record(self, tag):
        need(tag in self.sections, f"{tag} is missing")
        element, _, _, body = self.sections[tag]
        need(element == "record", f"type of {tag}")
        return Record(body)

    def array(self, tag, element, columns=1, rows=None):
        need(tag in self.sections, f"{tag} is missing")
        found, width, _, body = self.sections[tag]
        need((found, width) == (element, columns), f"type of {tag}")
        values = np.frombuffer(body, dtype="<" + element)
        need(len(values) % columns == 0, f"length of {tag}")
        if columns > 1:
            values = values.reshape(-1, columns)
        need(rows is None or len(values) == rows, f"rows of {tag}")
        return values


class Medium:
    def __init__(self, name, sigma_s_reduced, sigma_a, g, eta):
        self.name, self.g, self.eta = name, g, eta
        self.sigma_s_reduced, self.sigma_a = np.array(sigma_s_reduced), np.array(sigma_a)


class Scene:
    """Mesh, parts, media, samples."""

    def __init__(self, file):
        self.origin = file.array("mesh.org", "f8", 3, 1)[0]
        self.local = file.array("mesh.pos", "f4", 3).astype(np.float64)
        self.triangles = file.array("mesh.tri", "u4", 3).astype(np.int64)
        vertices, count = len(self.local), len(self.triangles)
        need(np.isfinite(self.origin).all() and np.isfinite(self.local).all(), "positions")
        need((self.triangles < vertices).all(), "corners")
        self.weld = np.arange(vertices) - file.array("mesh.wld", "u4", 1, vertices).astype(np.int64)
        need((self.weld >= 0).all() and (self.weld[self.weld] == self.weld).all(), "welds")
        self.triangle_part = file.array("part.tri", "u4", 1, count).astype(np.int64)

        record = file.record("part.rec")
        self.parts = record.many(lambda: (record.string(), record.truth(), record.u32()))
        record.end()
        record = file.record("part.med")
        rgb = lambda: record.some(3, record.f64)
        self.media = record.many(lambda: Medium(record.string(), rgb(), rgb(), record.f64(), record.f64()))
        record.end()
        need(((self.triangle_part < len(self.parts)) | (self.triangle_part == NONE)).all(), "parts of triangles")

        self._names_and_corners(file, vertices, count)
        self.part_ends = file.array("samp.prt", "u4", 1, len(self.parts) + 1).astype(np.int64)
        if file.has("samp.rul"):
            need(not file.has("samp.fac") and not file.has("samp.off"), "samples are stored, and there is a rule")
            rule = file.array("samp.rul", "u4", 2, 1)[0]
            self.facets, self.patch_ends = subdivision.samples(self, rule, self.part_ends)
        else:
            self.facets = file.array("samp.fac", "u4", 2).astype(np.int64)
            self.patch_ends = file.array("samp.off", "u4").astype(np.int64)
        need((self.facets[:, 0] < count).all() and (self.facets[:, 1] > 0).all(), "facets")
        corners = self.local[self.triangles]
        self.normals, self.areas = normals_and_areas(corners)

    def _names_and_corners(self, file, vertices, count):
        """Materials, and the shading normals and texture coordinates of corners, which no evaluator here needs."""
        record = file.record("mesh.mtn")
        names = record.many(record.string)
        record.end()
        need((file.array("mesh.mat", "u4", 1, count) < len(names)).all(), "materials")
        for values, corners, width in (("mesh.nrm", "mesh.nri", 3), ("mesh.uv", "mesh.uvi", 2)):
            need(file.has(values) == file.has(corners), f"{values} and {corners}")
            if file.has(values):
                table = file.array(values, "f4", width)
                need(np.isfinite(table).all() and (file.array(corners, "u4", 3, count) < len(table)).all(), values)

    def transfers(self, part):
        return part != NONE and not self.parts[part][1]

    def medium_of(self, part):
        return self.media[self.parts[part][2]]

    def facet_corners(self):
        """Corners of every facet without the origin, [facet][corner][axis]."""
        return np.array([self._corners(*facet) for facet in self.facets]).reshape(-1, 3, 3)

    def _corners(self, triangle, path):
        v = [self.local[i] for i in self.triangles[triangle]]
        for bit in bin(path)[3:]:
            d = [v[(k + 1) % 3] - v[k] for k in range(3)]
            squares = [(e[0] * e[0] + e[1] * e[1]) + e[2] * e[2] for e in d]
            k = squares.index(max(squares))
            a, b, c = v[k], v[(k + 1) % 3], v[(k + 2) % 3]
            m = (a + b) * 0.5
            v = [m, b, c] if bit == "1" else [a, m, c]
        return v

    def vertex_parts(self):
        """The part that each vertex belongs to: the first transferring one with a triangle at its place; none elsewhere."""
        of_weld = {}
        for corners, part in zip(self.weld[self.triangles], self.triangle_part):
            if self.transfers(part):
                for v in corners:
                    of_weld[v] = min(of_weld.get(v, part), part)
        used = np.zeros(len(self.local), dtype=bool)
        used[self.triangles.ravel()] = True
        return [of_weld.get(weld) if used[v] else None for v, weld in enumerate(self.weld)]


def normals_and_areas(corners):
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = np.where(length[:, None] > 0, cross / length[:, None], 0.0)
    return normals, 0.5 * length


class Provenance:
    """Where an asset comes from, and the ledger of its errors."""

    def __init__(self, file):
        record = file.record("meta.src")
        self.revision, self.method = record.u32(), record.string()
        self.settings = record.many(lambda: (record.string(), record.string()))
        self.seed = record.u64()
        self.inputs = record.many(lambda: (record.string(), bytes(record.some(32, record.u8)), record.u64()))
        self.unit, self.millimetres = record.string(), record.f64()
        self.notes = record.many(record.string)
        record.end()
        keys = [key.encode() for key, _ in self.settings]
        need(all(a < b for a, b in zip(keys, keys[1:])), "order of the settings")
        need(np.isfinite(self.millimetres) and self.millimetres > 0, "millimetres of a unit")
        record = file.record("meta.err")
        self.ledger = record.many(lambda: (record.string(), record.some(4, record.f64), record.string()))
        record.end()
        errors = np.array([numbers for _, numbers, _ in self.ledger]).reshape(-1, 4)
        need(np.isfinite(errors).all() and (errors[:, [0, 2, 3]] >= 0).all(), "errors")
        if file.has("meta.drk"):
            dark = file.array("meta.drk", "f8", 1, len(self.ledger))
            need(np.isfinite(dark).all() and (dark >= 0).all(), "dark errors")
