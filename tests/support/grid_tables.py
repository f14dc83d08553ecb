"""Networks as pandapower writes them, by hand."""

import json


def frame(columns: list[str], rows: list[list[object]]) -> dict[str, str]:
    table = {"columns": columns, "index": list(range(len(rows))), "data": rows}
    return {"_module": "pandas.core.frame", "_class": "DataFrame", "_object": json.dumps(table)}


def tables(**changes: tuple[list[str], list[list[object]]]) -> bytes:
    """A network of three buses and two lines."""
    line = ["from_bus", "to_bus", "length_km", "x_ohm_per_km", "parallel", "in_service"]
    inside = {
        "sn_mva": 1.0,
        "bus": frame(["vn_kv", "in_service"], [[10.0, True], [10.0, True], [10.0, True]]),
        "line": frame(line, [[0, 1, 2.0, 5.0, 2, True], [1, 2, 1.0, 10.0, 1, True]]),
        "ext_grid": frame(["bus", "in_service"], [[0, True]]),
        **{name: frame(*value) for name, value in changes.items()},
    }
    return json.dumps(
        {"_module": "pandapower.auxiliary", "_class": "pandapowerNet", "_object": inside}
    ).encode()
