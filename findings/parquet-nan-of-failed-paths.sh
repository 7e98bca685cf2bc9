#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pandas 3.1.1, Polars 2.1.0, DuckDB 2.0.1, pyarrow 26.0.1 (PyPI), Parquet files of one column with the NaN of a failed path.
# Guess: NaN is NaN whoever wrote the file, and a reader takes the same mean of it.
# Seen: pandas, and DuckDB from a table of pandas, write it as missing, Polars and pyarrow as NaN. So Polars, DuckDB and pyarrow
#     leave the failed path out of the mean of the one file, 2.0, and give NaN for the other; pandas leaves it out of both.
# For users of stochastic integrators: whether failed paths are averaged away depends on the package that wrote the table; keep a
#     column of statuses, and select by it.
. "$(dirname "$0")/venv.sh" pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 pyarrow==26.0.1 numpy==2.4.6
python - <<'END'
import math

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet

print("pandas", pd.__version__, "Polars", pl.__version__, "DuckDB", duckdb.__version__, "pyarrow", pa.__version__)
q = np.array([1.0, np.nan, 3.0])
table = pd.DataFrame({"q": q})
table.to_parquet("pandas.parquet")
duckdb.from_df(table).write_parquet("duckdb.parquet")
pl.DataFrame({"q": q}).write_parquet("polars.parquet")
pa.parquet.write_table(pa.table({"q": q}), "pyarrow.parquet")
for writer in ("pandas", "duckdb", "polars", "pyarrow"):
    file = f"{writer}.parquet"
    column = pa.parquet.read_table(file)["q"]
    means = {
        "pandas": pd.read_parquet(file).q.mean(),
        "polars": pl.read_parquet(file)["q"].mean(),
        "duckdb": duckdb.sql(f"select avg(q) from '{file}'").fetchall()[0][0],
        "pyarrow": pa.compute.mean(column).as_py(),
    }
    print("written by", writer, column.to_pylist(), "means", means)
    is_missing = writer in ("pandas", "duckdb")
    assert (column.null_count == 1) == is_missing
    assert all((mean == 2) if is_missing or name == "pandas" else math.isnan(mean) for name, mean in means.items())
END
