"""Dicts of parameters as TOML, the form that the library reads."""
import json
import numbers


def _value(key, value):
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, bool) or type(value).__name__ == "bool_":  # NumPy's
        return "true" if value else "false"
    if isinstance(value, numbers.Integral):
        if not -2**63 <= value < 2**63:
            raise OverflowError(f"parameter {key}: {value} is too large for an integer")
        return str(int(value))
    if isinstance(value, numbers.Real):
        return repr(float(value))
    raise TypeError(f"parameter {key}: a {type(value).__name__} is no number, text or truth value")


def _lines(table, path):
    plain, inner = [], []
    for key, value in table.items():
        if not isinstance(key, str):
            raise TypeError(f"parameter names are texts, not {key!r}")
        (inner if isinstance(value, dict) else plain).append((key, value))
    if path and (plain or not inner):
        yield "[" + ".".join(json.dumps(p) for p in path) + "]"
    for key, value in plain:
        yield f"{json.dumps(key)} = {_value('.'.join([*path, key]), value)}"
    for key, value in inner:
        yield from _lines(value, [*path, key])


def toml_text(table):
    """A dict of numbers, texts, truth values and such dicts as TOML. TypeError, OverflowError for anything else."""
    return "\n".join(_lines(table, [])) + "\n"
