"""Damage to a file's bytes. Each mutation takes (bytes, random.Random) and gives other bytes.

None of them keeps to a format: what the result means is for statements.py to say.
"""
import re
import struct

NUMBER = re.compile(rb"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
ODD_NUMBERS = (b"nan", b"inf", b"-inf", b"0", b"-1", b"1e300", b"-1e300", b"1e-300", b"1e999", b"4294967296",
               b"99999999999999999999", b"", b"none", b"0x10", b"1,5")
UNITS = ((b"_mm", b"_m"), (b"_mm", b"_cm"), (b"_s", b"_ms"), (b"time_s", b"time_ms"), (b"_N", b"_mN"), (b'"mm"', b'"cm"'),
         (b'"mm"', b'"um"'), (b"_j_per_mm3", b"_j_per_m3"), (b"rev_s", b"rpm"), (b"mm", b"in"))


def place(data, random):
    """Where to change something: half of the time near the beginning, where headers are."""
    if not data:
        return 0
    return random.randrange(min(len(data), 600)) if random.random() < 0.5 else random.randrange(len(data))


def bit_flip(data, random):
    data, at = bytearray(data), place(data, random)
    data[at] ^= 1 << random.randrange(8)
    return bytes(data)


def bytes_run(data, random):
    at, count = place(data, random), random.randint(1, 64)
    return data[:at] + random.randbytes(min(count, len(data) - at)) + data[at + count:]


def zeros(data, random):
    at, count = place(data, random), random.choice((1, 4, 16, 256, 4096))
    return data[:at] + bytes(min(count, len(data) - at)) + data[at + count:]


def truncation(data, random):
    return data[:random.choice((random.randrange(len(data)), len(data) - random.randint(1, min(16, len(data)))))]


def duplication(data, random):
    at, count = place(data, random), random.choice((1, 2, 4, 16, 80, 1000))
    return data[:at] + data[at:at + count] + data[at:]


def deletion(data, random):
    at, count = place(data, random), random.choice((1, 2, 4, 16, 80, 1000))
    return data[:at] + data[at + count:]


def exchange(data, random):
    count = random.choice((1, 4, 16, 256))
    a, b = sorted((place(data, random), place(data, random)))
    if a + count > b or b + count > len(data):
        return data[::-1]
    return data[:a] + data[b:b + count] + data[a + count:b] + data[a:a + count] + data[b + count:]


def garbage(data, random):
    at = random.choice((0, place(data, random), len(data)))
    text = random.choice((random.randbytes(random.randint(1, 200)), b"\xef\xbb\xbf", b"\0", b"\r\n", b"\x1b[31m", b"=1+1",
                          b"\xff\xfe", b"a" * 5000))
    return data[:at] + text + data[at:]


def text_number(data, random):
    """A number written as text: another digit, another size, or none at all."""
    numbers = [m for m in NUMBER.finditer(data[:20000])]
    if not numbers:
        return binary_number(data, random)
    match = random.choice(numbers)
    text = match.group()
    odd = random.choice(ODD_NUMBERS)
    digit = random.randrange(len(text))
    other = random.choice((odd, odd, b"-" + text.lstrip(b"-+"), text + b"000", text + b"e3", text + b"e-3",
                           text[:digit] + b"%d" % random.randrange(10) + text[digit + 1:], text[:-1] or b"7",
                           b"0." + text.lstrip(b"-+").replace(b".", b"")))
    return data[:match.start()] + other + data[match.end():]


def binary_number(data, random):
    """A number of 2, 4 or 8 bytes, at a multiple of 2."""
    value = random.choice((0, -1, 1, 0x7FFF, 0x8000, float("nan"), float("inf"), -1.0, 0.0, 1e30, 1e-30))
    if isinstance(value, float):
        new = struct.pack(random.choice("<>") + random.choice("fd"), value)
    else:
        size = random.choice((2, 4, 8))
        new = (value % (1 << 8 * size)).to_bytes(size, random.choice(("little", "big")))
    at = place(data, random) // 2 * 2
    return data[:at] + new + data[at + len(new):]


def unit(data, random):
    there = [pair for pair in UNITS if pair[0] in data[:20000]]
    if not there:
        return bytes_run(data, random)
    return data.replace(*random.choice(there), random.choice((1, -1)))


def line(data, random):
    """A line gone, doubled, or exchanged with another."""
    lines = data.split(b"\n")
    if len(lines) < 3:
        return deletion(data, random)
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    what = random.randrange(3)
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(a, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def empty(data, random):
    return random.choice((b"", b"", b"\n", data[:1]))


MUTATIONS = {"bit flip": bit_flip, "run of bytes": bytes_run, "zeros": zeros, "truncation": truncation,
             "duplication": duplication, "deletion": deletion, "exchange": exchange, "garbage": garbage,
             "number as text": text_number, "binary number": binary_number, "unit": unit, "line": line,
             "empty": empty}
# How often, 1 if not said: what is most likely to leave a file that can be read.
WEIGHTS_OF_TEXT = {"number as text": 8, "line": 4, "unit": 3, "bit flip": 2, "binary number": 0.3, "zeros": 0.3,
                   "run of bytes": 0.3, "empty": 0.2}
WEIGHTS_OF_BINARY = {"number as text": 2, "bit flip": 4, "binary number": 4, "run of bytes": 2, "empty": 0.2, "line": 0.5}


# ---- Tables, changed in what they say rather than in their bytes

def other_values(values, random):
    """(what was done, a column's values with it): what a wrong unit, clock or sensor makes of a recording."""
    import numpy as np
    values = np.array(values, dtype=float)
    at = random.randrange(len(values))
    what = random.choice(("times 1000", "divided by 1000", "one sample huge", "one sample not a number", "turned",
                          "constant", "one sample repeated", "jittered"))
    if what == "times 1000":
        values *= 1000
    elif what == "divided by 1000":
        values /= 1000
    elif what == "one sample huge":
        values[at] = random.choice((1e20, -1e6, 1e4))
    elif what == "one sample not a number":
        values[at] = np.nan
    elif what == "turned":
        values = -values
    elif what == "constant":
        values[:] = values[at]
    elif what == "one sample repeated":
        values[at] = values[at - 1]
    else:
        values += np.random.default_rng(random.randrange(1 << 30)).normal(0, np.abs(values).max() / 20, values.shape)
    return what, values


def other_csv(path, random):
    with open(path, encoding="ascii") as file:
        rows = [line.split(",") for line in file.read().splitlines()]
    column = random.randrange(len(rows[0]))
    what, values = other_values([float(row[column]) for row in rows[1:]], random)
    for row, value in zip(rows[1:], values):
        row[column] = f"{value:.9g}"
    with open(path, "w", encoding="ascii") as file:
        file.write("".join(",".join(row) + "\n" for row in rows))
    return "column: " + what


def other_hdf5(path, random):
    """A column's values, or the unit that it says, or the whole of it gone."""
    import h5py
    import numpy as np
    with h5py.File(path, "r+") as file:
        names = []
        file.visititems(lambda name, thing: names.append(name) if isinstance(thing, h5py.Dataset) else None)
        name = random.choice(sorted(names))
        data = file[name]
        what = random.random()
        if what < 0.1:
            del file[name]
            return "column: gone"
        if what < 0.2:
            data.attrs["units"] = random.choice(("m", "ms", "mN", "inch", ""))
            return "column: other unit"
        values = data[...]
        if values.ndim == 1:
            what, new = other_values(values, random)
        else:
            column = random.randrange(values.shape[1])
            what, changed = other_values(values[:, column], random)
            new = values.astype(float)
            new[:, column] = changed
        with np.errstate(invalid="ignore"):  # not a number, as an integer
            data[...] = new.astype(data.dtype)
    return "column: " + what


def mutated(data, random):
    """(name of the mutation, other bytes)."""
    if not data:
        return "garbage", random.randbytes(random.randint(1, 200))
    names, weights = list(MUTATIONS), WEIGHTS_OF_BINARY if b"\0" in data else WEIGHTS_OF_TEXT
    for _ in range(20):
        name = random.choices(names, [weights.get(n, 1) for n in names])[0]
        result = MUTATIONS[name](data, random)
        if result != data:
            return name, result
    return "empty", b""
