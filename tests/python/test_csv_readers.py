# SPDX-License-Identifier: BSD-3-Clause
"""Every installed reader of tables reads our tables as the same numbers."""

import csv
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from conftest import table_of
from symsde.cli import command_line
from symsde.show import tables

SPECIAL = [0.1, -0.0, 1e300, 5e-324, np.nan, np.inf, -np.inf, 1e22, 2.2250738585072014e-308, 1.7976931348623157e308]
ABOUT = {
    "plain": "x",
    "quotes": 'some "quotes", and',
    "one": "it's \"",
    "scene": "[model]\n\nx = [1,  # y",
    "empty": "",
}
SCENE = """
[model]
H = "(px**2 + x**2)/2 + x**4"
q = "x"
p = "px"
noise = ["s*x"]
params = {s = 0.3}
[run]
step = 0.1
steps = 20
paths = 64
q0 = 1.0
p0 = 0.0
[output]
moments = true
[[observe]]
kind = "passage"
of = "x"
high = 1.01
absorb = true
"""


def hostile(place):
    """Numbers of random bits, NaN and infinities."""
    bits = np.random.default_rng(5).integers(0, 2**64, 4000, dtype=np.uint64).view(float)
    bits[~np.isfinite(bits)] = 1 / 3
    columns = {
        "t": np.arange(4000) * 0.1,
        "n_ok": np.arange(4000),
        "mean x": bits,
        "var, \u03bc": np.resize(SPECIAL, 4000),
    }
    tables.write(place / "hostile.csv", columns, ABOUT)
    return place / "hostile.csv", columns


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One file of each kind that is written."""
    place = tmp_path_factory.mktemp("tables")
    (place / "scene.toml").write_text(SCENE, encoding="utf-8")
    assert command_line.main(["run", str(place / "scene.toml"), "--out", str(place), "--error-check", "--quiet"]) == 0
    kubo = {"q0": 1.0, "p0": 0.0, "steps": [4, 8], "paths": 40, "repeats": 5}
    ss.work_precision(ss.models.kubo(), schemes=["midpoint", "heun"], **kubo).save(place)
    hostile(place)
    return [place / f"{name}.csv" for name in ("hostile", "moments", "error-check", "work-precision")]


def test_there_is_one_form(files):
    """One line ending, one word for NaN, all digits; no file of another form is left out."""
    assert not any(b"\r" in file.read_bytes() for file in files)
    rows = "".join(line for file in files for line in table_of(file)[1:])
    assert "NaN" in rows and "nan" not in rows and "-inf" in rows
    name, columns = hostile(files[0].parent)
    header, *rows = csv.reader(table_of(name))
    assert header == list(columns)
    for found, known in zip(np.array(rows, float).T, columns.values(), strict=True):
        np.testing.assert_array_equal(found, known)
        assert (np.signbit(found) == np.signbit(known))[np.isfinite(known)].all()
    sources = Path(ss.__file__).parent.rglob("*.py")
    assert [file.name for file in sources if "csv.writer" in file.read_text(encoding="utf-8")] == ["tables.py"]


def lines_before(file):
    """The lines that begin with #."""
    return sum(line.startswith("#") for line in file.read_text(encoding="utf-8").splitlines())


def by_pandas(file):
    frame = pytest.importorskip("pandas").read_csv(file, comment="#")
    return {name: frame[name].to_numpy() for name in frame.columns}


def by_polars(file):
    frame = pytest.importorskip("polars").read_csv(file, comment_prefix="#")
    return {name: frame[name].to_numpy() for name in frame.columns}


def by_duckdb(file):
    found = pytest.importorskip("duckdb").read_csv(str(file), comment="#", header=True, skiprows=0)
    return dict(zip(found.columns, zip(*found.fetchall(), strict=True), strict=True))


def by_pyarrow(file):
    reader = pytest.importorskip("pyarrow.csv")
    table = reader.read_csv(file, read_options=reader.ReadOptions(skip_rows=lines_before(file)))
    return dict(zip(table.column_names, (column.to_pylist() for column in table.columns), strict=True))


def by_program(file, tmp_path, *command):
    """Columns of numbers that a program has read and written, column by column."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    out = tmp_path / "numbers"
    values = {"FILE": str(file), "OUT": str(out), "LINES": str(lines_before(file) + 1)}
    subprocess.run([_filled(x, values) for x in command], check=True)
    header, *rows = csv.reader(table_of(file))
    return dict(zip(header, np.fromfile(out).reshape(len(header), len(rows)), strict=True))


def _filled(text, values):
    for key, value in values.items():
        text = text.replace(key, value)
    return text


R = """x <- read.csv("FILE", comment.char="#", check.names=FALSE); out <- file("OUT", "wb")
x[!sapply(x, is.numeric)] <- 0; writeBin(as.double(as.matrix(x)), out); close(out)"""
OCTAVE = 'x = dlmread("FILE", ",", LINES, 0); out = fopen("OUT", "wb"); fwrite(out, x, "double"); fclose(out);'
READERS = {
    "pandas": lambda file, _: by_pandas(file),
    "polars": lambda file, _: by_polars(file),
    "duckdb": lambda file, _: by_duckdb(file),
    "pyarrow": lambda file, _: by_pyarrow(file),
    "R": lambda file, place: by_program(file, place, "Rscript", "-e", R),
    "Octave": lambda file, place: by_program(file, place, "octave-cli", "--norc", "--eval", OCTAVE),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_reader_has_equal_numbers(reader, files, tmp_path):
    """Every reader finds each number of each file to the last bit, except R, and columns of text as text."""
    for file in files:
        if reader == "Octave" and file.name == "work-precision.csv":
            continue  # this table holds text, which dlmread reads as zero
        header, *rows = csv.reader(table_of(file))
        found = READERS[reader](file, tmp_path)
        assert list(found) == header, file.name
        for name, cells in zip(header, zip(*rows, strict=True), strict=True):
            try:
                known = np.array([cell or "nan" for cell in cells], float)
            except ValueError:
                assert reader == "R" or list(found[name]) == list(cells), (file.name, name)
                continue
            numbers = np.array(found[name], float)
            if reader == "R":  # R's own literals of 17 digits are off by one unit in the last place, one in 5000
                differing = (numbers != known) & ~np.isnan(known)
                assert differing.mean() <= 1 / len(known) + 1e-3
                is_number = np.isfinite(known)
                np.testing.assert_array_equal(numbers[~is_number], known[~is_number])
                np.testing.assert_array_max_ulp(numbers[is_number], known[is_number], 1)
            else:
                np.testing.assert_array_equal(numbers, known, err_msg=f"{file.name}, {name}")
