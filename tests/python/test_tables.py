# SPDX-License-Identifier: BSD-3-Clause
"""Results as tables: data frames, what notebooks show, and files that are loaded again."""

import re

import numpy as np
import pytest
import symsde as ss
from conftest import table_of

START = np.full((2, 30), 0.3)
START[:, 0] = 20.0  # fails in the first steps
RUN = {"q0": START, "p0": 0.1, "step": 0.1, "steps": 40, "save_every": 10, "paths": 30, "scheme": "stormer_verlet"}


@pytest.fixture(scope="module")
def model():
    return ss.models.henon_heiles(sigma1=0.2)


@pytest.fixture(scope="module")
def run(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.simulate(model, **RUN)


@pytest.fixture(scope="module")
def moments(model):
    with pytest.warns(ss.PathsFailedWarning):
        return ss.moments(model, observables={"<b> & r": "q1*q1"}, **RUN)


def test_data_frames(run, moments, tmp_path):
    pandas = pytest.importorskip("pandas")
    paths, means = run.to_pandas(), moments.to_pandas()
    assert paths.shape == (30 * 5, 4) and list(paths.index.names) == ["path", "t"]
    np.testing.assert_array_equal(paths.loc[7, "p_2"], run.p[:, 1, 7])
    np.testing.assert_array_equal(paths["q_1"].xs(run.t[2], level="t"), run.q[2, 0])
    moments.save(tmp_path / "moments.csv")
    known = pandas.read_csv(tmp_path / "moments.csv", comment="#", index_col="t")
    pandas.testing.assert_frame_equal(means, known, check_exact=True)
    assert table_of(tmp_path / "moments.csv")[0].split(",")[1:] == list(means.columns)


def cells(page):
    return [re.findall(r"<t[dh]>(.*?)</t[dh]>", row) for row in re.findall(r"<tr>(.*?)</tr>", page)]


def test_what_notebooks_show(run, moments):
    header, *rows = cells(moments._repr_html_())
    assert header == ["t", "paths", "mean q_1", "mean p_1", "mean energy", "mean &lt;b&gt; &amp; r"]
    assert len(rows) == 5 and rows[-1][:2] == ["4", "29"]
    assert rows[-1][2] == f"{moments.mean_q[-1, 0]:.6g} ± {moments.se_mean_q[-1, 0]:.2g}"
    assert "<b>" not in moments._repr_html_()
    header, *rows = cells(run._repr_html_())
    assert header == ["path", "status", "last q_1", "last q_2", "last p_1", "last p_2"]
    assert len(rows) == 11 and rows[0][1].endswith(f"at step {run.failed_step[0]}") and rows[1][1] == "ok"
    assert rows[4][2:] == [f"{x:.6g}" for x in (*run.last_q[:, 4], *run.last_p[:, 4])]
    assert "and 19 paths more" in run._repr_html_()
    assert "henon_heiles" in run._repr_html_()


def test_a_failure_in_the_first_step_is_told(model):
    with pytest.warns(ss.PathsFailedWarning):
        run = ss.simulate(model, **{**RUN, "q0": 1e200, "paths": 1})
    assert run.failed_step[0] == 0 and f"<td>{ss.status_text(int(run.status[0]))} at step 0</td>" in run._repr_html_()
