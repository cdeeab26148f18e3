"""Pictures as arrays: reads scan-line OpenEXR (none, ZIPS, ZIP; half, float, uint), writes 8-bit PNG."""

import struct
import zlib

import numpy as np

TYPES = {0: np.dtype("<u4"), 1: np.dtype("<f2"), 2: np.dtype("<f4")}
ROWS = {0: 1, 2: 1, 3: 16}


def _text(data, at):
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def _header(data):
    if data[:4] != b"\x76\x2f\x31\x01" or struct.unpack_from("<I", data, 4)[0] & 0x1A00:
        raise ValueError("no OpenEXR picture of one part in scan lines")
    at, attributes = 8, {}
    while data[at]:
        name, at = _text(data, at)
        _, at = _text(data, at)
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    channels, k, table = [], 0, attributes["channels"]
    while table[k]:
        name, k = _text(table, k)
        channels.append((name, TYPES[struct.unpack_from("<i", table, k)[0]]))
        k += 16
    return attributes, channels, at + 1


def _unpacked(packed, size):
    if len(packed) == size:
        return packed
    raw = np.frombuffer(zlib.decompress(packed), np.uint8).astype(np.int64)
    raw[1:] -= 128
    raw = np.cumsum(raw).astype(np.uint8)
    half, whole = (len(raw) + 1) // 2, np.empty(len(raw), np.uint8)
    whole[0::2], whole[1::2] = raw[:half], raw[half:]
    return whole.tobytes()


def read_exr(path):
    """Channels by name, each an array of rows from the top, float64."""
    with open(path, "rb") as file:
        data = file.read()
    attributes, channels, at = _header(data)
    compression = attributes["compression"][0]
    if compression not in ROWS:
        raise ValueError(f"{path}: compression {compression} is not read; write ZIP")
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height, rows = x1 - x0 + 1, y1 - y0 + 1, ROWS[compression]
    out = {name: np.zeros((height, width)) for name, _ in channels}
    line = sum(kind.itemsize for _, kind in channels) * width
    for offset in struct.unpack_from(f"<{-(-height // rows)}Q", data, at):
        y, size = struct.unpack_from("<ii", data, offset)
        count = min(rows, y1 + 1 - y)
        block = _unpacked(data[offset + 8 : offset + 8 + size], count * line)
        k = 0
        for row in range(y - y0, y - y0 + count):
            for name, kind in channels:
                out[name][row] = np.frombuffer(block, kind, width, k)
                k += kind.itemsize * width
    return out


def rgb(layers, prefix=""):
    return np.stack([layers[prefix + c] for c in "RGB"], axis=-1)


def write_png(path, picture):
    """`picture`: rows x columns x 3 in [0, 1], already as the screen wants it."""
    pixels = (np.clip(np.nan_to_num(picture), 0, 1) * 255 + 0.5).astype(np.uint8)
    height, width, _ = pixels.shape
    lines = np.concatenate([np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)], axis=1)
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)))
        file.write(chunk(b"IDAT", zlib.compress(lines.tobytes(), 6)) + chunk(b"IEND", b""))


def display(linear):
    """sRGB transfer of linear colours."""
    x = np.clip(linear, 0, None)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
