"""The streams of bits and the coded coefficients (formats/spec/coding.md)."""

import numpy as np

from container import need

WORD = (1 << 64) - 1


def varint(data, at):
    """A number of seven bits in a byte, the lowest first; and where it ends."""
    value = shift = 0
    while True:
        need(at < len(data) and shift <= 28, "a varint")
        byte = data[at]
        at += 1
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            need(value < 1 << 32 and (byte > 0 or shift == 7), "a varint longer than needed")
            return value, at


class Stream:
    """Bits under adaptive models, which are numbered by whoever asks: any hashable thing is a model."""

    def __init__(self, data):
        self.data, self.at = bytes(data), 8
        self.range, self.code = WORD, int.from_bytes(self.data[:8].ljust(8, b"\0"), "big")
        self.models = {}

    def _refill(self):
        if self.range < 1 << 32:
            self.range = (self.range << 32) & WORD
            word = int.from_bytes(self.data[self.at:self.at + 4].ljust(4, b"\0"), "big")
            self.code = ((self.code << 32) | word) & WORD
            self.at += 4

    def bit(self, model):
        p, n = self.models.get(model, (1 << 23, 0))
        bound = (self.range >> 16) * max(1, p >> 8)
        s = (n + 2).bit_length() - 1
        if self.code < bound:
            self.range, p, value = bound, p + (((1 << 24) - p) >> s), 0
        else:
            self.code, self.range, p, value = self.code - bound, self.range - bound, p - (p >> s), 1
        self.models[model] = p, min(n + 1, 126)
        if self.range < 1 << 32:
            self._refill()
        return value

    def plain(self, bits):
        self.range >>= bits
        number = min(self.code // self.range, (1 << bits) - 1)
        self.code -= number * self.range
        self._refill()
        return number

    def magnitude(self, lengths, mantissas, known_positive=False):
        """A number of up to 16 bits; models begin with `lengths` and `mantissas`."""
        m = 1 if known_positive else 0
        while m < 16 and self.bit((*lengths, m)):
            m += 1
        if m == 0:
            return 0
        value = 1
        below = min(m - 1, 3)
        for _ in range(below):
            value = 2 * value + self.bit((*mantissas, m, value))
        rest = m - 1 - below
        return (value << rest) + self.plain(rest) if rest else value

    def end(self):
        """Behind the last number: the mark, no byte too many, and the shortest of all streams."""
        need(self.plain(16) == 0xE7D1 and self.plain(16) == 0xA5C3, "the end of a stream")
        need(len(self.data) <= self.at and (not self.data or self.data[-1] != 0), "bytes behind a stream")
        last = int.from_bytes(self.data.ljust(self.at, b"\0")[self.at - 8:self.at], "big")
        low = (last - self.code) & WORD
        best = max((v for b in range(1, 65) if (v := -low & ((1 << b) - 1)) < self.range), default=0)
        need(self.code == best, "a stream that is not the shortest")


def scale(x):
    """h: the size of a number in half octaves."""
    if x < 4:
        return x
    j = x.bit_length() - 1
    return 2 * j + ((x >> (j - 1)) & 1)


def _fine(x):
    j = (x + 16).bit_length() - 1
    return 16 * j + (((x + 16) >> (j - 4)) & 15)


def coded(data, predictor):
    """A matrix of coded coefficients; `predictor(row)` is the row that predicts a row, or None."""
    rows, at = varint(data, 0)
    columns, at = varint(data, at)
    predicted, at = varint(data, at)
    need(predicted <= 1 and columns <= 65535, "head of coded coefficients")
    result = np.zeros((rows, columns), dtype=np.int64)
    if columns == 0:
        return result
    stream = Stream(data[at:])
    bits = columns.bit_length()
    expected, counts = [8192] * columns, []
    classes = [k if k < 32 else 22 + scale(k) for k in range(columns)]
    for r in range(rows):
        source = predictor(r) if predicted else None
        need(source is None or 0 <= source < r, "a predictor")
        guess = counts[source] if source is not None else (counts[-1] if counts else 0)
        slot = min(15, (16 * guess) >> bits)
        c = 1
        for _ in range(min(bits, 7)):
            c = 2 * c + stream.bit(("c", slot, c))
        c -= 1 << min(bits, 7)
        if bits > 7:
            c = (c << (bits - 7)) + stream.plain(bits - 7)
        need(c <= columns, "more columns than there are")
        counts.append(c)
        a = b = 4096
        row = [0] * columns
        for k in range(c):
            level = min(63, max(0, (_fine(expected[k]) + _fine(a) - _fine(b)) // 8))
            v = stream.magnitude(("l", level), ("m", level // 2), k == c - 1)
            if v:
                sign = 0 if source is None else int(np.sign(result[source, k]))
                negative = stream.bit(("s", classes[k], sign))
                need(v < 32768 or (v == 32768 and negative), "a coefficient")
                row[k] = -v if negative else v
            a += (4096 * v - a) // 32
            b += (expected[k] - b) // 32
        s = min(5, (r + 2).bit_length() - 1)
        for k in range(columns):
            expected[k] += (4096 * abs(row[k]) - expected[k]) >> s
        result[r] = row
    stream.end()
    return result
