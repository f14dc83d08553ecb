"""The table of a sweep in files: CSV and JSON lines by the standard library, Parquet through DuckDB."""

from __future__ import annotations

import csv
import io
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dobc_design.certificate.files import write_atomically
from dobc_design.errors import SpecError

if TYPE_CHECKING:
    import pandas as pd

Rows = Sequence[Mapping[str, Any]]
KINDS = (".csv", ".jsonl", ".parquet")
TABLE = "results"  # name of the files that a sweep leaves in its folder
_MISSING = (
    "the extra packages of dobc_design[store] (duckdb, pandas, pyarrow) are needed for this, and are not installed."
)
_CURE = "`dobc doctor` says how to install them; .csv and .jsonl need none."


def write_table(path: Path, rows: Rows, columns: Mapping[str, str], *, force: bool) -> Path:
    """Write the rows as the ending of ``path`` says.  Raises: SpecError for another ending, or a file that is there."""
    if path.suffix.lower() not in KINDS:
        raise SpecError(
            f"a table is saved as {', '.join(KINDS)}; got {path.name[:40]!r}.", key="path", cure="Choose one of these."
        )
    if path.exists() and not force:
        raise SpecError(f"{str(path)!r} exists already.", key="path", cure="Replace it with force=True.")
    make = {".csv": csv_bytes, ".jsonl": jsonl_bytes, ".parquet": parquet_bytes}[path.suffix.lower()]
    write_atomically(path, make(rows, columns))
    return path


def export_tables(folder: Path, rows: Rows, columns: Mapping[str, str]) -> list[Path]:
    """results.csv, and results.parquet where DuckDB is installed, in the folder of a sweep; the paths written."""
    written = [folder / f"{TABLE}.csv"]
    write_atomically(written[0], csv_bytes(rows, columns))
    try:
        data = parquet_bytes(rows, columns)
    except SpecError:  # without the extra the journal and the CSV file hold everything
        return written
    write_atomically(folder / f"{TABLE}.parquet", data)
    return [*written, folder / f"{TABLE}.parquet"]


def csv_bytes(rows: Rows, columns: Mapping[str, str]) -> bytes:
    """The rows as CSV with a header, UTF-8; nothing stands for what is not there."""
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(columns)
    for row in rows:
        writer.writerow([_plain(row[name]) for name in columns])
    return text.getvalue().encode("utf-8")


def jsonl_bytes(rows: Rows, columns: Mapping[str, str]) -> bytes:
    """The rows as one JSON object per line."""
    lines = (json.dumps({name: row[name] for name in columns}, ensure_ascii=False) for row in rows)
    return "".join(f"{line}\n" for line in lines).encode("utf-8")


def parquet_bytes(rows: Rows, columns: Mapping[str, str]) -> bytes:
    """The rows as a Parquet file, written by DuckDB.  Raises: SpecError without the extra."""
    duckdb, table = _table(rows, columns)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"{TABLE}.parquet"
        with duckdb.connect() as connection:
            connection.from_arrow(table).write_parquet(str(place), compression="zstd")
        return place.read_bytes()


def make_frame(rows: Rows, columns: Mapping[str, str]) -> pd.DataFrame:
    """The rows as a pandas table.  Raises: SpecError without pandas."""
    try:
        import pandas as pd
    except ImportError:
        raise SpecError(_MISSING, key="frame", cure=_CURE) from None
    return pd.DataFrame(list(rows), columns=list(columns))


def ask(rows: Rows, columns: Mapping[str, str], sql: str) -> pd.DataFrame:
    """The answer to a question in SQL about the table "sweep".  Raises: SpecError."""
    duckdb, table = _table(rows, columns)
    with duckdb.connect(config={"enable_external_access": "false"}) as connection:
        connection.register("sweep", table)
        try:
            answer: pd.DataFrame = connection.execute(sql).df()
        except duckdb.Error as error:
            raise SpecError(
                f"DuckDB cannot answer that: {str(error).splitlines()[0][:200]}.",
                key="sql",
                cure=f"The table is sweep; its columns (those with dots in double quotes) are {', '.join(columns)}.",
            ) from None
    return answer


def _table(rows: Rows, columns: Mapping[str, str]) -> tuple[Any, Any]:
    """DuckDB, and the rows as an Arrow table with the types of the columns."""
    try:
        import duckdb
        import pandas as pd  # noqa: F401 - what DuckDB answers with
        import pyarrow as pa
    except ImportError:
        raise SpecError(_MISSING, key="path", cure=_CURE) from None
    types = {"text": pa.string(), "number": pa.float64(), "truth": pa.bool_(), "count": pa.int64()}
    table = pa.table({name: pa.array([row[name] for row in rows], type=types[kind]) for name, kind in columns.items()})
    return duckdb, table


def _plain(value: Any) -> Any:
    return "" if value is None else str(value).lower() if isinstance(value, bool) else value
